//! `evaluate`: how far predictions are from ground truths.

use std::path::PathBuf;

use bijective_sdf::evaluate::{CompareOptions, Frame, Protocol, Report, Table, evaluate_with_scan};
use bijective_sdf::geometry::Topology;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};

use super::Common;
use super::console::{print, say_all_but_last};
use super::failure::Failure;
use super::input::{Content, Input, Local};
use super::json::Object;
use super::paths::name;
use super::points::{self, Style};
use super::report::topology_json;
use super::report::{published_json, published_text, report_json, report_text, summary_json, table_json};

const AFTER: &str = "Tables hold the usual columns or, with --protocol, those of its published tables; --csv holds all \
                     columns. --json prints one object a pair, with the facts of the mesh too, and, of several pairs, \
                     one with the summary. A pair that cannot be compared has an empty row or an object with \
                     \"error\"; the others are still compared, and the exit code is that of the last failure.";

/// Arguments of `evaluate`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub struct EvaluateArgs {
    /// Ground truth (mesh or cloud) and prediction (mesh); more pairs may follow
    #[arg(required = true, num_args = 2.., value_names = ["GT", "PRED"])]
    files: Vec<PathBuf>,
    /// Sample, measure and print as these published tables do [default: the samples of onet, all usual columns]
    #[arg(long, value_name = "NAME", value_parser = protocol_parser())]
    protocol: Option<Protocol>,
    /// Samples of each surface [default: 100000, or as the protocol has it]
    #[arg(long, value_name = "N")]
    samples: Option<usize>,
    /// Seed of the samples
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Threshold of the F-score, in units of the frame [default: 0.01]
    #[arg(long, allow_negative_numbers = true)]
    tau: Option<f64>,
    /// Frame of all numbers [default: unit, or as the protocol has it]
    #[arg(long, value_enum)]
    frame: Option<FrameArg>,
    /// Measure also from samples to triangles, which has no sampling floor
    #[arg(long)]
    surface: bool,
    /// The files come in threes, GT PRED SCAN: measure also between the prediction and the raw scan (mesh or cloud)
    #[arg(long)]
    scan: bool,
    /// The predictions are points, such as a cloud and the denser one of `reconstruct --surface-points`: print how many
    /// are distinct, their mean distance to the truth and its to them, and what as many points of the truth would have
    #[arg(long, conflicts_with_all = ["scan", "surface", "ntps", "tau"])]
    points: bool,
    /// Print also the normal consistency summed over components, as some published tables have it
    #[arg(long)]
    ntps: bool,
    /// Print one JSON object a pair, and one with the summary
    #[arg(long, group = "style")]
    json: bool,
    /// Print a table of comma-separated values
    #[arg(long, group = "style")]
    csv: bool,
    /// Print a Markdown table
    #[arg(long, group = "style")]
    markdown: bool,
    /// Print a LaTeX table
    #[arg(long, group = "style")]
    latex: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum FrameArg {
    /// Longest side of the ground truth is 1
    Unit,
    /// Units of the files
    AsIs,
}

fn protocol_parser() -> impl TypedValueParser<Value = Protocol> {
    PossibleValuesParser::new(Protocol::ALL.map(Protocol::name))
        .map(|name| name.parse().expect("a listed name"))
}

impl EvaluateArgs {
    /// The protocol's options, and what was said explicitly over them.
    fn options(&self) -> CompareOptions {
        let mut options = self.protocol.unwrap_or_default().options();
        (options.seed, options.surface) = (self.seed, self.surface);
        if let Some(samples) = self.samples {
            (options.samples, options.gt_samples, options.scan_samples) = (samples, None, None);
        }
        if let Some(tau) = self.tau {
            options.tau = tau;
        }
        match self.frame {
            Some(FrameArg::Unit) => options.frame = Frame::GroundTruthUnit,
            Some(FrameArg::AsIs) => options.frame = Frame::AsIs,
            None => {}
        }
        options
    }

    fn style(&self) -> Style {
        match self {
            EvaluateArgs { json: true, .. } => Style::Json,
            EvaluateArgs { csv: true, .. } => Style::Csv,
            EvaluateArgs { markdown: true, .. } => Style::Markdown,
            EvaluateArgs { latex: true, .. } => Style::Latex,
            _ => Style::Text,
        }
    }
}

/// A pair: its name, and its figures with the facts of the predicted mesh, or why it has none.
struct Compared {
    name: String,
    outcome: Result<(Report, Topology), Failure>,
}

impl Compared {
    fn report(&self) -> Option<&Report> {
        self.outcome.as_ref().ok().map(|(report, _)| report)
    }

    /// Itself, or why it has no figures.
    fn succeeded(self) -> Result<Compared, Failure> {
        let outcome = Ok(self.outcome?);
        Ok(Compared { name: self.name, outcome })
    }
}

/// Compares pairs of files.
pub fn run(args: &EvaluateArgs, common: Common) -> Result<(), Failure> {
    let (group, what) = if args.scan { (3, "threes") } else { (2, "pairs") };
    if !args.files.len().is_multiple_of(group) {
        return Err(Failure::Usage(format!(
            "{} files are not {what}; give a ground truth and a prediction each{}",
            args.files.len(),
            if args.scan { ", and a scan" } else { "" }
        )));
    }
    let options = args.options();
    if args.points {
        return points::run(&args.files, &options, args.style(), common);
    }
    let mut compared: Vec<Compared> = args
        .files
        .chunks_exact(group)
        .map(|files| Compared { name: name(&files[1]), outcome: compare(files, &options, common) })
        .collect();
    // Wrong options are wrong for every pair.
    let refused = |c: &Compared| c.outcome.as_ref().is_err_and(|failure| failure.code() == 2);
    if compared.len() == 1 || compared.iter().all(refused) {
        compared = compared.into_iter().map(Compared::succeeded).collect::<Result<_, _>>()?;
    }
    let rows = || compared.iter().map(|c| (c.name.as_str(), c.report()));
    let table = || {
        let mut table = match args.protocol {
            Some(protocol) => Table::of_columns(protocol.columns(), rows()),
            None => Table::of_reports(rows()),
        };
        if args.ntps && !table.columns().iter().any(|c| c == "NC ntps") {
            table
                .add_column("NC ntps", compared.iter().map(|c| c.report().and_then(|r| r.metrics.nc_ntps())));
        }
        table
    };
    if args.json {
        print(json(&compared, args, &options))?;
    } else if args.csv {
        print(Table::of_everything(rows()).to_csv())?;
    } else if args.markdown {
        print(table().to_markdown())?;
    } else if args.latex {
        print(table().to_latex())?;
    } else if let [Compared { name, outcome: Ok((report, topology)) }] = compared.as_slice() {
        let published = args.protocol.map_or(String::new(), |p| published_text(p.columns(), report));
        print(format!("{}{published}{topology}\n", headed(name, report, args.ntps)))?;
    } else {
        print(table().to_text())?;
    }
    let failed = compared.into_iter().filter_map(|c| c.outcome.err()).collect();
    say_all_but_last(failed).map_or(Ok(()), Err)
}

/// Reads and compares one ground truth, one prediction and, if there is one, one scan.
fn compare(
    files: &[PathBuf],
    options: &CompareOptions,
    common: Common,
) -> Result<(Report, Topology), Failure> {
    let pred = &files[1];
    let truth = Input::read(&files[0], None)?.content()?;
    let mesh = Input::read(pred, None)?.mesh()?;
    let scan = files.get(2).map(|path| Input::read(path, None)?.content()).transpose()?;
    if let Content::Cloud(cloud) = &truth {
        let normals = if cloud.normals.is_some() { "with" } else { "without" };
        common.note(&format!("{} has no faces and is used as points {normals} normals", files[0].display()));
        common.tell(&cloud.warnings, &cloud.notices);
    }
    if let Some(Content::Cloud(cloud)) = &scan {
        common.tell(&cloud.warnings, &[]);
    }
    // All sides about the offset of the truth, so that they stay where they are to each other.
    let offset = truth.offset();
    let (truth, scan) = (truth.relative_to(offset), scan.map(|scan| scan.relative_to(offset)));
    let report = evaluate_with_scan(
        truth.ground_truth(),
        &mesh.relative_to(offset),
        scan.as_ref().map(Local::ground_truth),
        options,
    )?;
    Ok((report, mesh.topology()))
}

/// One line a pair and, of several, one with the summary.
fn json(compared: &[Compared], args: &EvaluateArgs, options: &CompareOptions) -> String {
    let protocol = args.protocol.unwrap_or_default();
    let frame = if options.frame == Frame::AsIs { "as-is" } else { "unit" };
    // What is measured and how, with what was said explicitly over the protocol's.
    let how = |object: Object| {
        object
            .text("protocol", protocol.name())
            .text("frame", frame)
            .count("samples", options.samples)
            .raw("seed", options.seed)
            .number("tau", options.tau)
    };
    let mut text = String::new();
    for Compared { name, outcome } in compared {
        let result = match outcome {
            Ok((report, topology)) => Object::new()
                .raw("report", report_json(name, report))
                .raw("published", published_json(protocol.columns(), report))
                .raw("mesh", topology_json(topology)),
            Err(failure) => {
                Object::new().text("name", name).text("error", &failure.line().unwrap_or_default())
            }
        };
        text += &result.raw("options", how(Object::new()).finish()).finish();
        text.push('\n');
    }
    if compared.len() > 1 {
        let good: Vec<&(Report, Topology)> =
            compared.iter().filter_map(|c| c.outcome.as_ref().ok()).collect();
        let reports: Vec<&Report> = good.iter().map(|(report, _)| report).collect();
        let rows = compared.iter().map(|c| (c.name.as_str(), c.report()));
        let published = Table::of_columns(protocol.columns(), rows);
        let counts =
            Object::new().count("pairs", compared.len()).count("failed", compared.len() - good.len());
        let summary = how(counts)
            .count("closed", good.iter().filter(|(_, t)| t.closed && t.oriented).count())
            .raw("report", summary_json(&reports))
            .raw("published", table_json(&published))
            .finish();
        text += &Object::new().raw("summary", summary).finish();
        text.push('\n');
    }
    text
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
