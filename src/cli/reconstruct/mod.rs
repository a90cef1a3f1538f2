//! `reconstruct`: from a cloud to a mesh.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use bijective_sdf::bsp::Parameterization;
use bijective_sdf::reconstruct::{Config, Hints, Preset, Reconstruction, Saved, SavedKind};
use bijective_sdf::{Error, ErrorKind};

use super::Common;
use super::carry::vertex_attributes;
use super::console::print;
use super::coverage::coverage_text;
use super::failure::Failure;
use super::input::Input;
use super::interrupt::Interrupt;
use super::lock::{Lock, Use};
use super::output::write_bytes;
use super::paths::is_pipe;
use super::preview::{View, render};
use super::report::{gate, gate_open};
use super::train::{TrainingPlan, train};

mod args;
mod cloud;
mod outputs;
mod summary;

pub use args::ReconstructArgs;
pub use summary::describe;

use cloud::PreparedCloud;
use outputs::{Outputs, Written, behind};
use summary::Run;

/// Tells that a cloud of more than `limit` points keeps its first shape, if the options would train a smaller one, and
/// returns what was told.
///
/// # Errors
/// [`Failure::Usage`] if something is asked for that only a training makes.
fn untrained(
    args: &ReconstructArgs,
    config: &Config,
    limit: usize,
    common: Common,
) -> Result<Option<String>, Failure> {
    if config.stages.is_empty() || !config.scale_with_points {
        return Ok(None);
    }
    let asked = [(args.surface_points.is_some(), "--surface-points"), (args.codes.is_some(), "--codes")];
    if let Some((_, option)) = asked.iter().find(|(given, _)| *given) {
        return Err(Failure::Usage(format!(
            "{option} needs a training, which clouds of more than {limit} points do not have unless \
             --set train_up_to=all is given"
        )));
    }
    let told = format!(
        "nothing is trained for more than {limit} points: their first shape is the better one (--set train_up_to=all \
         trains in any case)"
    );
    common.note(&told);
    Ok(Some(told))
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
            "--surface-points needs an S; the preset start and parameterization=none have none".into(),
        ));
    }
    if args.codes.is_some() && config.parameterization != Parameterization::Bsp {
        return Err(Failure::Usage(
            "--codes needs parameterization=bsp; the preset start and other parameterizations have no codes"
                .into(),
        ));
    }
    let asked = [(args.surface_points.is_some(), "--surface-points"), (args.codes.is_some(), "--codes")];
    if let Some((_, option)) = asked.iter().find(|(given, _)| *given && config.stages.is_empty()) {
        return Err(Failure::Usage(format!("{option} needs a training, which stages=none leaves out")));
    }
    // Held to the end.
    let _lock = args.checkpoint.as_deref().map(|path| Lock::on(path, Use::Checkpoints)).transpose()?;
    let interrupt = Interrupt::install("giving up the step and writing a checkpoint")?;
    let mut cloud = PreparedCloud::read(args, &outputs.mesh, common)?;
    let count = cloud.points.len();
    args.fineness.check(&config.clone().for_points(count), common)?;
    common.note(&format!("{count} points, preset {preset}, seed {}", config.seed));
    if let (false, Some(limit)) = (config.trains(count), config.train_up_to) {
        cloud.notices.extend(untrained(args, &config, limit, common)?);
    }
    let mut trained = {
        let mut hints = Hints::default();
        (hints.normals, hints.anisotropy) = (cloud.normals.as_deref(), args.anisotropy);
        train(&cloud.points, &config, &hints, &plan(args, common), Some(&interrupt))?
    };
    if trained.timed_out {
        common.note(&format!(
            "the time limit ended the run after step {} of {}{}; the result depends on the speed of the machine",
            trained.steps,
            trained.total,
            trained.last.map_or(String::new(), |r| format!(", in the phase {}", r.phase))
        ));
    }
    if let Some(limit) = args.time_limit.filter(|limit| trained.before_steps > limit.as_secs_f64()) {
        let told = format!(
            "--time-limit {}: what comes before the first step, such as finding the first shape, alone took {:.1} s; the \
             limit only ends steps",
            limit.as_secs_f64(),
            trained.before_steps
        );
        common.warn(&told);
        cloud.warnings.push(told);
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
    let fineness = args.fineness.of(trained.field.input_points().len());
    args.fineness.tell(trained.field.input_points().len(), common);
    let meshed = fineness.mesh(&trained.field).map_err(Failure::from);
    let part = meshed.and_then(|mesh| args.trim.part(mesh, trained.field.input_points(), common));
    let mesh_seconds = meshing.elapsed().as_secs_f64();
    let part = part.and_then(|mut part| {
        let attributes = vertex_attributes(part.support.take(), cloud.carried.at(&part.mesh.verts)?);
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
        let picture = render(trained.field.input_points(), &part.mesh, &View::from(&args.view));
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

    trained.field.notices().iter().for_each(|notice| common.note(notice));
    common.note(&topology.to_string());
    if trained.field.is_turned() {
        common.note(
            "the points were seen from within, as those of a room: the free space is inside of the mesh, where distances \
             are positive and which its faces look into",
        );
    }
    trained.field.coverage().iter().flat_map(|c| coverage_text(c)).for_each(|line| common.note(&line));
    if args.json {
        let run = Run {
            args,
            outputs: &outputs,
            cloud: &cloud,
            preset,
            seed: config.seed,
            trained: &trained,
            fineness,
            part: &part,
            topology: &topology,
            mesh_seconds,
            total_seconds: began.elapsed().as_secs_f64(),
        };
        print(format!("{}\n", run.json()))?;
    }
    if !report.failures.is_empty() {
        return Err(report.end(None));
    }
    if part.cut.is_some() { gate_open(&topology) } else { gate(&topology) }
}

/// Options for resuming, and the name of their preset: those of the command if they equal the saved ones; otherwise the
/// saved ones with the command's changes applied. Changes that a run cannot take are refused later.
fn resumed(path: &Path, args: &ReconstructArgs) -> Result<(Config, &'static str), Failure> {
    let input = Input::read(path, None)?;
    let saved = Saved::from_bytes(input.bytes()).map_err(|e| Failure::Input(e.in_file(input.path())))?;
    if saved.kind == SavedKind::Result {
        let error = Error::new(ErrorKind::Checkpoint, "it is a field, not a checkpoint").in_file(path);
        return Err(Failure::Input(error.advise("make a mesh of it with `bijective-sdf mesh`")));
    }
    let (config, preset) = args.settings.build()?;
    let mut run = saved.config.clone();
    // A run may go on with another one, see `MAY_CHANGE` in `reconstruct/save/checkpoint.rs`.
    run.finish = config.finish;
    if config.clone().for_points(saved.points) == run {
        return Ok((config, preset.name()));
    }
    let (config, preset) = args.settings.build_on(Some(&saved.config))?;
    // Without `--preset` the saved options are the base; the preset's name is not saved.
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
