//! `reconstruct`: from a cloud to a mesh.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use bijective_sdf::bsp::Parameterization;
use bijective_sdf::geometry::{Bounds, Topology, clean_cloud};
use bijective_sdf::io::Format;
use bijective_sdf::reconstruct::{Config, Hints, Preset, Reconstruction, Saved, SavedKind};
use bijective_sdf::{Error, ErrorKind};
use clap::Args;

use super::Common;
use super::carry::{Carried, check_format, vertex_attributes};
use super::cleaning::{Outliers, doubts, strays, without};
use super::codes::CodesFiles;
use super::coverage::{coverage_json, coverage_text};
use super::failure::Failure;
use super::files::{
    CLOUD_FORMATS, Input, MESH_FORMATS, Output, check_apart, check_writable, format_parser, is_pipe,
    is_same_file, offset_text, print, say, say_all_but_last, write_bytes,
};
use super::fineness::FinenessArgs;
use super::interrupt::Interrupt;
use super::json::{Object, list, number, quoted};
use super::lock::Lock;
use super::preview::{View, ViewArgs, check_picture, render};
use super::reading::ReadArgs;
use super::report::{gate, gate_open, passes_gate, topology_json};
use super::settings::Settings;
use super::sides::{SidesArgs, three_numbers};
use super::train::{Trained, TrainingPlan, train};
use super::trim::TrimArgs;

/// Seconds between two checkpoints.
const CHECKPOINT_SECONDS: u64 = 60;

/// Arguments of `reconstruct`.
#[derive(Debug, Args)]
pub struct ReconstructArgs {
    /// The point cloud, or `-`; `bijective-sdf reconstruct --help` lists the formats at --format
    input: PathBuf,
    /// The mesh to write (ply, obj, stl, off, glb), or `-`
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    settings: Settings,
    #[command(flatten)]
    fineness: FinenessArgs,
    #[command(flatten)]
    reading: ReadArgs,
    /// Points that belong to no surface, far from all others and off the surface that these suggest
    #[arg(long, value_enum, default_value_t)]
    outliers: Outliers,
    #[command(flatten)]
    sides: SidesArgs,
    /// What the axes are multiplied by for the work, for points that lie closer along one direction than along others:
    /// `1,1,0.2` for slices across z that are far apart. The mesh and the field are in the frame of the input
    #[arg(long, value_name = "X,Y,Z", value_parser = three_numbers, allow_hyphen_values = true)]
    anisotropy: Option<[f64; 3]>,
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
    /// Go on from a checkpoint of the same cloud, with its options; those that are given must agree with it
    #[arg(long, value_name = "FILE")]
    resume: Option<PathBuf>,
    /// Stop after this time, in whichever phase, and write the mesh of the field as it is then
    #[arg(long, value_name = "SECONDS", value_parser = seconds, allow_negative_numbers = true)]
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
    /// Write the field, for the commands `sdf` and `mesh`. Until the mesh is written it is kept in any case, beside it
    #[arg(long, value_name = "FILE")]
    save_field: Option<PathBuf>,
    /// Give each vertex of the mesh what the input has beside the coordinates of the point nearest to it, such as
    /// colours, intensities and classes (ply; obj and glb: colours only)
    #[arg(long)]
    carry: bool,
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
    let (config, preset) = match &args.resume {
        Some(path) => resumed(path, args)?,
        None => args.settings.build().map(|(config, preset)| (config, preset.name()))?,
    };
    let outputs = Outputs::of(args)?;
    if args.surface_points.is_some() && config.parameterization == Parameterization::None {
        return Err(Failure::Usage(
            "--surface-points needs an S, which parameterization=none has not".into(),
        ));
    }
    if args.codes.is_some() && config.parameterization != Parameterization::Bsp {
        return Err(Failure::Usage("--codes needs codes, which only parameterization=bsp has".into()));
    }
    args.fineness.check(&config, common)?;
    // Held to the end.
    let _lock = args.checkpoint.as_deref().map(Lock::on).transpose()?;
    let interrupt = Interrupt::install("giving up the step and writing a checkpoint")?;
    let input = if args.carry {
        args.reading.with_attributes(&args.input)?
    } else {
        args.reading.input(&args.input)?
    };
    let cloud = input.cloud()?;
    common.tell(&cloud.warnings, &cloud.notices);
    // The same check as the library's, here for its numbers and for an error that names the file.
    let clean = clean_cloud(&cloud.points).map_err(|e| Failure::Input(e.in_file(input.path())))?;
    if clean.duplicates_merged > 0 {
        common.note(&format!("left out {} points that repeat others", clean.duplicates_merged));
    }
    let (stray, told) = strays(&clean.points, args.outliers);
    let left_out = if args.outliers == Outliers::Keep { &[][..] } else { &stray };
    let points = without(&clean.points, left_out);
    let mut warnings = cloud.warnings.clone();
    let rest = clean_cloud(&points).map_err(|e| Failure::Input(e.in_file(input.path())))?;
    let doubts: Vec<String> = told.into_iter().chain(doubts(&rest)).collect();
    common.tell(&doubts, &[]);
    warnings.extend(doubts);
    let kept_points = without(&clean.given, left_out);
    let sides = args.sides.of(&cloud, &points, &kept_points);
    common.tell(&sides.warnings, &sides.notes);
    warnings.extend(sides.warnings);
    let (notices, rows_left_out) = (cloud.notices.clone(), cloud.left_out);
    let (carried, left_behind) = if args.carry {
        Carried::new(cloud, &kept_points, &outputs.mesh, common)
    } else {
        Default::default()
    };
    warnings.extend(left_behind);
    let offset = Bounds::of(&points)?.offset();
    if offset != [0.0; 3] {
        common.note(&format!(
            "the coordinates are large: the work is done about the offset {}, which is in all results again",
            offset_text(offset)
        ));
    }
    common.note(&format!("{} points, preset {preset}, seed {}", points.len(), config.seed));

    let mut trained = {
        let hints = Hints { normals: sides.normals.as_deref(), anisotropy: args.anisotropy };
        train(&points, &config, &hints, &plan(args, common), Some(&interrupt))?
    };
    if trained.timed_out {
        common.note(&format!(
            "the time limit ended the run after step {} of {}{}; the result depends on the speed of the machine",
            trained.steps,
            trained.total,
            trained.last.map_or(String::new(), |r| format!(", in the phase {}", r.phase))
        ));
    }
    // What cost the time first: whatever fails from here on, the mesh can be made again from the field.
    let mut report = Written::default();
    let kept_field =
        outputs.kept_field.as_deref().filter(|path| report.wrote(path, write_field(path, &trained.field)));
    if let Some(path) = kept_field {
        interrupt.kept(format!("the field is kept: go on with {}", go_on(path, args)));
    }
    report.failures.extend(std::mem::replace(&mut trained.checkpoint, Ok(())).err());
    let meshing = Instant::now();
    let fineness = args.fineness.of(trained.field.cloud().len());
    let meshed = fineness.mesh(&trained.field).map_err(Failure::from);
    let part = meshed.and_then(|mesh| args.trim.part(mesh, trained.field.cloud(), common));
    let mesh_seconds = meshing.elapsed().as_secs_f64();
    let part = part.and_then(|mut part| {
        let attributes = vertex_attributes(part.support.take(), carried.at(&part.mesh.verts)?);
        outputs.mesh.write_mesh(&part.mesh, &attributes).map(|()| part)
    });
    let part = match part {
        Ok(part) => part,
        Err(failure) => {
            report.failures.push(failure);
            return Err(report.end(kept_field.map(|path| go_on(path, args))));
        }
    };
    report.files.push(args.output.clone());
    let topology = part.mesh.topology();
    if let Some(output) = &outputs.surface_points {
        report.wrote(output.path(), output.write_cloud(&trained.field.surface_points()));
    }
    if let Some(path) = &args.view.preview {
        let picture = render(trained.field.cloud(), &part.mesh, &View::from(&args.view));
        report.wrote(path, picture.and_then(|picture| write_bytes(path, &picture.to_png())));
    }
    // Last, as the grid of the training may fail to find what that of the mesh has found.
    if let Some(files) = &outputs.codes {
        let none = || Err(Error::new(ErrorKind::Diverged, "the parameterization is not finite"));
        let coded = trained.coded.take().unwrap_or_else(none).map_err(Failure::from);
        report.failures.extend(coded.and_then(|coded| files.write(&coded)).err());
    }
    if let Some(path) = kept_field.filter(|_| args.save_field.is_none()) {
        // It was for the case that the mesh fails.
        let _ = fs::remove_file(path);
        report.files.retain(|file| file != path);
    }

    common.note(&topology.to_string());
    if trained.field.is_turned() {
        common.note(
            "the points were seen from within, as those of a room: the free space is inside of the mesh, where distances \
             are positive and which its faces look into",
        );
    }
    trained.field.coverage().iter().flat_map(|c| coverage_text(c)).for_each(|line| common.note(&line));
    if args.json {
        let json = Object::new()
            .path("input", Some(&args.input))
            .path("output", Some(outputs.mesh.path()))
            .count("points", points.len())
            .count("duplicates", clean.duplicates_merged)
            .count("left_out", rows_left_out)
            .raw("offset", list(offset.map(|x| number(Some(x)))))
            .text("outliers", args.outliers.name())
            .raw(
                "strays",
                list(stray.iter().map(|&i| list(clean.points[i as usize].map(|x| number(Some(x)))))),
            )
            .raw("warnings", list(warnings.iter().map(|w| quoted(w))))
            .raw("notices", list(notices.iter().map(|n| quoted(n))))
            .text("sides", sides.source)
            .raw("anisotropy", args.anisotropy.map_or("null".into(), |a| list(a.map(|x| number(Some(x))))))
            .flag("turned", trained.field.is_turned())
            .text("preset", preset)
            .raw("seed", config.seed)
            .raw("resolution", fineness.json());
        let seconds = Object::new()
            .number("train", trained.seconds)
            .number("mesh", mesh_seconds)
            .number("total", began.elapsed().as_secs_f64())
            .finish();
        let json = describe(json, &trained, &topology)
            .raw("trim", part.json())
            .flag("support", args.trim.support)
            .raw("carried", carried.json())
            .raw("seconds", seconds)
            .path("surface_points", args.surface_points.as_deref())
            .raw(
                "codes",
                outputs.codes.as_ref().map_or("null".to_string(), |files| {
                    list(files.paths.iter().map(|path| quoted(&path.to_string_lossy())))
                }),
            )
            .path("field", args.save_field.as_deref())
            .path("preview", args.view.preview.as_deref())
            .path("checkpoint", args.checkpoint.as_deref());
        print(format!("{}\n", json.finish()))?;
    }
    if !report.failures.is_empty() {
        return Err(report.end(None));
    }
    if part.cut.is_some() { gate_open(&topology) } else { gate(&topology) }
}

/// The options to go on from a checkpoint with, and where they come from: those of the command, if they are those that
/// the run was started with, else those of the run, with what is given over them. What does not agree is refused later.
fn resumed(path: &Path, args: &ReconstructArgs) -> Result<(Config, &'static str), Failure> {
    let input = Input::read(path, None)?;
    let saved = Saved::from_bytes(input.bytes()).map_err(|e| Failure::Input(e.in_file(input.path())))?;
    if saved.kind == SavedKind::Result {
        let error = Error::new(ErrorKind::Checkpoint, "it is a field, not a checkpoint").in_file(path);
        return Err(Failure::Input(error.advise("make a mesh of it with `bijective-sdf mesh`")));
    }
    let (config, preset) = args.settings.build()?;
    let mut run = saved.config.clone();
    // A run may go on with others of these two, see `MAY_CHANGE` in `reconstruct/save/checkpoint.rs`.
    (run.finish, run.min_component) = (config.finish, config.min_component);
    if config.clone().for_points(saved.points) == run {
        return Ok((config, preset.name()));
    }
    let (config, preset) = args.settings.build_on(Some(&saved.config))?;
    // Who gives no preset goes on with that of the run, which has no name any more.
    Ok((config, preset.map_or("of the checkpoint", Preset::name)))
}

fn write_field(path: &Path, field: &Reconstruction) -> Result<(), Failure> {
    write_bytes(path, &field.to_bytes().map_err(Failure::Output)?)
}

/// The command that makes the mesh from the field.
fn go_on(field: &Path, args: &ReconstructArgs) -> String {
    let mut options = args.fineness.again();
    options += &args.trim.trim.map_or(String::new(), |factor| format!(" --trim={factor}"));
    if args.trim.support {
        options += " --support";
    }
    if args.carry {
        options += &format!(" --carry {}", args.input.display());
    }
    format!("`bijective-sdf mesh {} -o {}{options}`", field.display(), args.output.display())
}

/// What came of writing the results.
#[derive(Default)]
struct Written {
    files: Vec<PathBuf>,
    failures: Vec<Failure>,
}

impl Written {
    /// Notes whether a file was written, and returns that.
    fn wrote(&mut self, path: &Path, outcome: Result<(), Failure>) -> bool {
        match outcome {
            Ok(()) => self.files.push(path.to_path_buf()),
            Err(failure) => self.failures.push(failure),
        }
        self.files.last().is_some_and(|file| file == path)
    }

    /// Prints all failures but the last, which it returns, and what was written nevertheless.
    fn end(self, advice: Option<String>) -> Failure {
        let last = say_all_but_last(self.failures).unwrap_or(Failure::Closed);
        if !self.files.is_empty() {
            let names: Vec<String> = self.files.iter().map(|file| file.display().to_string()).collect();
            let advice = advice.map_or(String::new(), |command| format!("; go on with {command}"));
            say(&format!("note: written: {}{advice}", names.join(", ")));
        }
        last
    }
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
struct Outputs {
    mesh: Output,
    /// Where the field is kept until the mesh is there, or for good.
    kept_field: Option<PathBuf>,
    surface_points: Option<Output>,
    codes: Option<CodesFiles>,
}

impl Outputs {
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
            if is_pipe(path) && *option == "--checkpoint" {
                return Err(Failure::Usage(format!("{option} needs a file, not a pipe")));
            }
            if *option == "--preview" {
                check_picture(path)?;
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
        let beside =
            || Some(&args.output).filter(|path| is_ordinary(path)).map(|path| behind(path, ".field"));
        let mesh = Output::new(&args.output, args.output_format, args.ascii, &MESH_FORMATS)?;
        check_format(&mesh, args.carry, args.trim.support)?;
        Ok(Outputs {
            codes,
            kept_field: args.save_field.clone().or_else(beside),
            mesh,
            surface_points: match &args.surface_points {
                Some(path) => Some(Output::new(path, None, args.ascii, &CLOUD_FORMATS)?),
                None => None,
            },
        })
    }
}

/// A file name with something behind it.
fn behind(path: &Path, more: &str) -> PathBuf {
    let mut name = path.as_os_str().to_os_string();
    name.push(more);
    PathBuf::from(name)
}

/// Whether a path is that of a regular file, or of one that is yet to come; beside devices nothing is kept.
fn is_ordinary(path: &Path) -> bool {
    !is_pipe(path) && fs::metadata(path).map_or(true, |m| m.is_file())
}

fn plan(args: &ReconstructArgs, common: Common) -> TrainingPlan {
    TrainingPlan {
        checkpoint: args.checkpoint.clone().map(|path| (path, Duration::from_secs(args.checkpoint_every))),
        on_interrupt: (!is_pipe(&args.output)).then(|| behind(&args.output, ".checkpoint")),
        resume: args.resume.clone(),
        time_limit: args.time_limit,
        codes: args.codes.is_some(),
        quiet: common.quiet,
    }
}
