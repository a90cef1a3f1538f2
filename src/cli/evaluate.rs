//! `evaluate`: how far predictions are from ground truths.

use std::path::{Path, PathBuf};

use bijective_sdf::evaluate::{Frame, GroundTruth, Options, Report, Table, evaluate};
use clap::{Args, ValueEnum};

use super::Common;
use super::failure::Failure;
use super::files::{Content, Input, print};
use super::json::Object;
use super::report::{report_json, report_text, topology_json};

/// Arguments of `evaluate`.
#[derive(Debug, Args)]
pub struct EvaluateArgs {
    /// Ground truth (mesh or cloud) and prediction (mesh); more pairs may follow
    #[arg(required = true, num_args = 2.., value_names = ["GT", "PRED"])]
    files: Vec<PathBuf>,
    /// Samples of each surface
    #[arg(long, default_value_t = 100_000)]
    samples: usize,
    /// Seed of the samples
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Threshold of the F-score, in units of the frame
    #[arg(long, default_value_t = 0.01)]
    tau: f64,
    /// Frame of all numbers
    #[arg(long, value_enum, default_value_t = FrameArg::Unit)]
    frame: FrameArg,
    /// Measure also from samples to triangles, which has no sampling floor
    #[arg(long)]
    surface: bool,
    /// Print also the normal consistency summed over components, as some published tables have it
    #[arg(long)]
    ntps: bool,
    /// Print one JSON object a pair
    #[arg(long, group = "style")]
    json: bool,
    /// Print a table of comma-separated values
    #[arg(long, group = "style")]
    csv: bool,
    /// Print a Markdown table
    #[arg(long, group = "style")]
    markdown: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum FrameArg {
    /// Longest side of the ground truth is 1
    Unit,
    /// Units of the files
    AsIs,
}

/// Compares pairs of files.
pub fn run(args: &EvaluateArgs, common: Common) -> Result<(), Failure> {
    if !args.files.len().is_multiple_of(2) {
        return Err(Failure::Usage(format!(
            "{} files are not pairs; give a ground truth and a prediction each",
            args.files.len()
        )));
    }
    let options = Options {
        samples: args.samples,
        seed: args.seed,
        tau: args.tau,
        frame: match args.frame {
            FrameArg::Unit => Frame::GroundTruthUnit,
            FrameArg::AsIs => Frame::AsIs,
        },
        surface: args.surface,
        floor: true,
    };
    let mut reports = Vec::new();
    for pair in args.files.chunks_exact(2) {
        let (gt, pred) = (&pair[0], &pair[1]);
        let truth = Input::read(gt, None)?.content()?;
        let mesh = Input::read(pred, None)?.mesh()?;
        let truth = match &truth {
            Content::Mesh(mesh) => GroundTruth::Mesh(mesh),
            Content::Cloud(cloud) => {
                common.note(&format!("{} has no faces and is used as points", gt.display()));
                GroundTruth::Cloud { points: &cloud.points, normals: None }
            }
        };
        let report = evaluate(truth, &mesh, &options)?;
        reports.push((name(pred), report, mesh.topology()));
    }
    let rows = || Table::of_reports(reports.iter().map(|(n, r, _)| (n.as_str(), Some(r))));
    let with_ntps = |mut table: Table| {
        if args.ntps {
            table.add_column("NC ntps", reports.iter().map(|(_, r, _)| r.metrics.nc_ntps()));
        }
        table
    };
    if args.json {
        let mut text = String::new();
        for (name, report, topology) in &reports {
            text += &Object::new()
                .raw("report", report_json(name, report, args.ntps))
                .raw("mesh", topology_json(topology))
                .finish();
            text.push('\n');
        }
        print(text)
    } else if args.csv {
        print(with_ntps(rows()).to_csv())
    } else if args.markdown {
        print(with_ntps(rows()).to_markdown())
    } else if let [(name, report, topology)] = reports.as_slice() {
        print(format!("{}{topology}\n", headed(name, report, args.ntps)))
    } else {
        print(with_ntps(rows()).to_text())
    }
}

fn headed(name: &str, report: &Report, ntps: bool) -> String {
    format!(
        "{name}: {} samples against {}, 1 unit is {} of the file's\n{}",
        report.pred_samples,
        report.gt_samples,
        report.scale,
        report_text(report, ntps)
    )
}

fn name(path: &Path) -> String {
    path.file_stem().map_or_else(|| path.display().to_string(), |s| s.to_string_lossy().into_owned())
}
