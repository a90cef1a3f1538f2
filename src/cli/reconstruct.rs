//! `reconstruct`: from a cloud to a mesh.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use bijective_sdf::bsp::Parameterization;
use bijective_sdf::geometry::{Topology, clean_cloud};
use bijective_sdf::io::Format;
use bijective_sdf::{Error, ErrorKind};
use clap::Args;
use clap::builder::TypedValueParser;

use super::Common;
use super::codes::CodesFiles;
use super::coverage::{coverage_json, coverage_text};
use super::failure::Failure;
use super::files::{
    CLOUD_FORMATS, MESH_FORMATS, Output, check_apart, check_writable, format_parser, is_pipe, is_same_file,
    print, write_bytes,
};
use super::interrupt::Interrupt;
use super::json::{Object, list, quoted};
use super::preview::{View, ViewArgs, render};
use super::reading::ReadArgs;
use super::report::{gate, gate_open, passes_gate, topology_json};
use super::settings::Settings;
use super::train::{Plan, Trained, train};
use super::trim::TrimArgs;

/// Cubes along the longest side of the grid that a mesh is taken from.
pub const RESOLUTION: usize = 128;
/// Seconds between two checkpoints.
const CHECKPOINT_SECONDS: u64 = 60;

/// Parses the resolution of a mesh.
pub fn resolution_parser() -> impl TypedValueParser<Value = usize> {
    clap::value_parser!(u16).range(8..=1024).map(usize::from)
}

/// Arguments of `reconstruct`.
#[derive(Debug, Args)]
pub struct ReconstructArgs {
    /// The point cloud, or `-`; `bijective-sdf reconstruct --help` lists the formats at --format
    input: PathBuf,
    /// The mesh to write (ply, obj, stl, off), or `-`
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    settings: Settings,
    /// Cubes along the longest side of the grid that the mesh is taken from; what is thinner than a cube may get lost
    #[arg(long, default_value_t = RESOLUTION, value_parser = resolution_parser())]
    resolution: usize,
    #[command(flatten)]
    reading: ReadArgs,
    /// Format of the mesh [default: by extension; ply for `-`]
    #[arg(long, value_parser = format_parser())]
    output_format: Option<Format>,
    /// Write text where the format also has a binary form
    #[arg(long)]
    ascii: bool,
    /// Write checkpoints to this file now and then and at the end
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Seconds between two checkpoints
    #[arg(long, value_name = "SECONDS", default_value_t = CHECKPOINT_SECONDS, requires = "checkpoint")]
    checkpoint_every: u64,
    /// Go on from a checkpoint of the same cloud and options
    #[arg(long, value_name = "FILE")]
    resume: Option<PathBuf>,
    /// Stop after this time, in whichever phase, and write the mesh of the field as it is then
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    time_limit: Option<Duration>,
    /// Write the denser points that the surface was drawn to (ply, xyz, csv)
    #[arg(long, value_name = "FILE")]
    surface_points: Option<PathBuf>,
    /// Write point clouds in the colours of their codes on the sphere, rgb = (code + 1) / 2, to draw the
    /// parameterization with: STEM-points.ply (the points Q), STEM-codes.ply (their codes U), STEM-surface.ply (the
    /// denser points S), STEM-patches.ply (the codes P of S), STEM-grid.ply (the vertices V of the training's grid
    /// around the surface) and STEM-moved.ply (V', the same moved along the field); a vertex has the code of the point
    /// of S nearest to it in V'
    #[arg(long, value_name = "STEM")]
    codes: Option<PathBuf>,
    /// Write the field, for the commands `sdf` and `mesh`
    #[arg(long, value_name = "FILE")]
    save_field: Option<PathBuf>,
    #[command(flatten)]
    trim: TrimArgs,
    #[command(flatten)]
    view: ViewArgs,
    /// Print one JSON object about the run
    #[arg(long)]
    json: bool,
}

fn seconds(text: &str) -> Result<Duration, String> {
    text.parse::<f64>()
        .ok()
        .and_then(|s| Duration::try_from_secs_f64(s).ok())
        .ok_or_else(|| "a number of seconds expected".into())
}

/// Reconstructs a cloud.
pub fn run(args: &ReconstructArgs, common: Common) -> Result<(), Failure> {
    let began = Instant::now();
    let (config, preset) = args.settings.build()?;
    let places = Places::of(args)?;
    if args.surface_points.is_some() && config.parameterization == Parameterization::None {
        return Err(Failure::Usage(
            "--surface-points needs an S, which parameterization=none has not".into(),
        ));
    }
    if args.codes.is_some() && config.parameterization != Parameterization::Bsp {
        return Err(Failure::Usage("--codes needs codes, which only parameterization=bsp has".into()));
    }
    let interrupt = Interrupt::install("finishing the step and writing a checkpoint")?;
    let input = args.reading.input(&args.input)?;
    let cloud = input.cloud()?;
    common.tell(&cloud.warnings, &cloud.notices);
    // The same check as the library's, here for its numbers and for an error that names the file.
    let clean = clean_cloud(&cloud.points).map_err(|e| Failure::Input(e.in_file(input.path())))?;
    if clean.duplicates_merged > 0 {
        common.note(&format!("left out {} points that repeat others", clean.duplicates_merged));
    }
    common.note(&format!("{} points, preset {preset}, seed {}", clean.points.len(), config.seed));

    let mut trained = train(&cloud.points, &config, &plan(args, common), Some(&interrupt))?;
    if trained.timed_out {
        common.note(&format!(
            "the time limit ended the run after step {} of {}{}; the result depends on the speed of the machine",
            trained.steps,
            trained.total,
            trained.last.map_or(String::new(), |r| format!(", in the phase {}", r.phase))
        ));
    }
    let meshing = Instant::now();
    let part = args.trim.part(trained.field.mesh(args.resolution)?, trained.field.cloud(), common)?;
    let mesh = &part.mesh;
    let mesh_seconds = meshing.elapsed().as_secs_f64();
    let topology = mesh.topology();

    // Everything that can fail by its content is made before anything is written.
    let preview = match &args.view.preview {
        Some(path) => Some((path, render(trained.field.cloud(), mesh, &View::from(&args.view))?.to_png())),
        None => None,
    };
    if let Some(path) = &args.save_field {
        trained.field.save(path).map_err(Failure::Output)?;
    }
    if let Some(output) = &places.surface_points {
        output.write_cloud(&trained.field.surface_points())?;
    }
    if let Some((path, png)) = preview {
        write_bytes(path, &png)?;
    }
    places.mesh.write_mesh(mesh)?;
    // Last, as the grid of the training may fail to find what that of the mesh has found.
    if let Some(files) = &places.codes {
        let none = || Err(Error::new(ErrorKind::Diverged, "the parameterization is not finite"));
        files.write(&trained.coded.take().unwrap_or_else(none)?)?;
    }

    common.note(&topology.to_string());
    trained.field.coverage().iter().flat_map(|c| coverage_text(c)).for_each(|line| common.note(&line));
    if args.json {
        let json = Object::new()
            .path("input", Some(&args.input))
            .path("output", Some(places.mesh.path()))
            .count("points", clean.points.len())
            .count("duplicates", clean.duplicates_merged)
            .count("left_out", cloud.left_out)
            .raw("warnings", list(cloud.warnings.iter().map(|w| quoted(w))))
            .raw("notices", list(cloud.notices.iter().map(|n| quoted(n))))
            .text("preset", preset.name())
            .raw("seed", config.seed)
            .count("resolution", args.resolution);
        let seconds = Object::new()
            .number("train", trained.seconds)
            .number("mesh", mesh_seconds)
            .number("total", began.elapsed().as_secs_f64())
            .finish();
        let json = describe(json, &trained, &topology)
            .raw("trim", part.json())
            .raw("seconds", seconds)
            .path("surface_points", args.surface_points.as_deref())
            .raw(
                "codes",
                places.codes.as_ref().map_or("null".to_string(), |files| {
                    list(files.paths.iter().map(|path| quoted(&path.to_string_lossy())))
                }),
            )
            .path("field", args.save_field.as_deref())
            .path("preview", args.view.preview.as_deref())
            .path("checkpoint", args.checkpoint.as_deref());
        print(format!("{}\n", json.finish()))?;
    }
    if part.cut.is_some() { gate_open(&topology) } else { gate(&topology) }
}

/// Adds what training and meshing came to.
pub fn describe(json: Object, trained: &Trained, topology: &Topology) -> Object {
    let losses = trained.last.as_ref().map_or("null".to_string(), |r| {
        let loss = Object::new().number("loss", f64::from(r.loss));
        let terms = r.terms.each().into_iter();
        terms.fold(loss, |json, (name, value)| json.number(name, f64::from(value))).finish()
    });
    json.count("steps", trained.steps)
        .count("total_steps", trained.total)
        .raw("phase", trained.last.map_or("null".to_string(), |r| format!("\"{}\"", r.phase)))
        .text("ended", if trained.timed_out { "time-limit" } else { "done" })
        .number("noise_removed", trained.noise_removed)
        .raw("losses", losses)
        .raw("coverage", coverage_json(trained.field.coverage()))
        .raw("mesh", topology_json(topology))
        .flag("closed_and_oriented", passes_gate(topology))
}

/// Where results go, checked before the work starts.
struct Places {
    mesh: Output,
    surface_points: Option<Output>,
    codes: Option<CodesFiles>,
}

impl Places {
    fn of(args: &ReconstructArgs) -> Result<Self, Failure> {
        let codes = args.codes.as_ref().map(|stem| CodesFiles::new(stem, args.ascii));
        if args.codes.as_deref().is_some_and(is_pipe) {
            return Err(Failure::Usage("--codes needs the beginning of file names, not a pipe".into()));
        }
        let coded = codes.iter().flat_map(|files| &files.paths).map(|path| ("--codes", Some(path)));
        let files: Vec<(&str, &Path)> = [
            ("--output", Some(&args.output)),
            ("--surface-points", args.surface_points.as_ref()),
            ("--save-field", args.save_field.as_ref()),
            ("--preview", args.view.preview.as_ref()),
            ("--checkpoint", args.checkpoint.as_ref()),
        ]
        .into_iter()
        .chain(coded)
        .filter_map(|(option, path)| path.map(|p| (option, p.as_path())))
        .collect();
        for (i, (option, path)) in files.iter().enumerate() {
            if let Some((other, _)) = files[..i].iter().find(|(_, p)| p == path || is_same_file(p, path)) {
                return Err(Failure::Usage(format!("{other} and {option} are both {}", path.display())));
            }
            if is_pipe(path) && ["--save-field", "--checkpoint"].contains(option) {
                return Err(Failure::Usage(format!("{option} needs a file, not a pipe")));
            }
            if is_pipe(path) && args.json {
                return Err(Failure::Usage(format!("{option} - and --json would mix on standard output")));
            }
            check_apart(option, path, &args.input)?;
            // A run may go on in the checkpoint that it came from.
            if let Some(resume) = args.resume.as_deref().filter(|_| *option != "--checkpoint") {
                check_apart(option, path, resume)?;
            }
            check_writable(path)?;
        }
        Ok(Places {
            codes,
            mesh: Output::new(&args.output, args.output_format, args.ascii, &MESH_FORMATS)?,
            surface_points: match &args.surface_points {
                Some(path) => Some(Output::new(path, None, args.ascii, &CLOUD_FORMATS)?),
                None => None,
            },
        })
    }
}

fn plan(args: &ReconstructArgs, common: Common) -> Plan {
    let beside = |path: &Path| {
        let mut name = path.as_os_str().to_os_string();
        name.push(".checkpoint");
        PathBuf::from(name)
    };
    Plan {
        checkpoint: args.checkpoint.clone().map(|path| (path, Duration::from_secs(args.checkpoint_every))),
        on_interrupt: (!is_pipe(&args.output)).then(|| beside(&args.output)),
        resume: args.resume.clone(),
        time_limit: args.time_limit,
        codes: args.codes.is_some(),
        quiet: common.quiet,
    }
}
