//! The training loop as a program runs it: with progress, checkpoints, a time limit and Ctrl-C.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use bijective_sdf::Error;
use bijective_sdf::reconstruct::{Coded, Config, Hints, Reconstruction, StepReport, Trainer};

use super::failure::Failure;
use super::interrupt::Interrupt;
use super::progress::Progress;

/// When to stop and what to write on the way.
#[derive(Clone, Debug, Default)]
pub struct TrainingPlan {
    /// Where to write checkpoints now and then, and the time between two.
    pub checkpoint: Option<(PathBuf, Duration)>,
    /// Where to write a checkpoint on Ctrl-C.
    pub on_interrupt: Option<PathBuf>,
    /// A checkpoint to go on from.
    pub resume: Option<PathBuf>,
    /// Stop training after this time.
    pub time_limit: Option<Duration>,
    /// Keep points, S and grid vertices with their codes.
    pub codes: bool,
    /// Show no progress.
    pub quiet: bool,
}

/// A trained field and how it came about.
pub struct Trained {
    pub field: Reconstruction,
    /// Points, S and grid vertices with their codes, if they are to be kept and there are some, or why there are none.
    pub coded: Option<Result<Coded, Error>>,
    /// Steps made, those before a resumed checkpoint included.
    pub steps: usize,
    /// Steps planned.
    pub total: usize,
    /// How far the points were moved to take their noise off, root of the mean square, in the input's unit.
    pub noise_removed: f64,
    /// The last step of this run that had all losses.
    pub last: Option<StepReport>,
    /// Seconds until the first step could be made: the search for the first shape, or reading a checkpoint.
    pub before_steps: f64,
    /// Whether the time limit ended the training.
    pub timed_out: bool,
    /// Seconds of this run, preparation included.
    pub seconds: f64,
    /// Why a checkpoint was not written, the last time that it was tried.
    pub checkpoint: Result<(), Failure>,
}

/// Trains until done, out of time, or interrupted.
pub fn train(
    points: &[[f64; 3]],
    config: &Config,
    hints: &Hints<'_>,
    plan: &TrainingPlan,
    interrupt: Option<&Interrupt>,
) -> Result<Trained, Failure> {
    let began = Instant::now();
    let mut trainer = match &plan.resume {
        Some(path) => Trainer::resume_with_hints(path, points, config, hints).map_err(Failure::Input)?,
        None => Trainer::with_hints(points, config, hints)?,
    };
    let before_steps = began.elapsed().as_secs_f64();
    let mut progress = Progress::new(&trainer, plan.quiet);
    if let Some(path) = &plan.resume {
        progress.note(&format!("going on after step {} of {}", trainer.steps_done(), path.display()));
    }
    let noise_removed = trainer.noise_removed();
    if noise_removed > 0.0 {
        progress.note(&format!(
            "the points scatter about a smooth surface and were moved onto it, by {noise_removed:.2e} on average (root \
             of the mean square); --set denoise=false leaves them"
        ));
    }
    if let Some(interrupt) = interrupt {
        interrupt.begin();
    }
    let mut saved = Instant::now();
    let mut checkpoint = Ok(());
    let mut last = None;
    let mut timed_out = false;
    while !trainer.is_done() {
        // A step of a large cloud or a fine grid takes long: it is given up, and the checkpoint is of the one before.
        let Some(report) = trainer.step_unless(&|| interrupt.is_some_and(Interrupt::asked))? else { break };
        // Not every step trains the parameterization; showing those without its loss would flicker.
        if report.terms.para > 0.0
            || last.is_none_or(|l: StepReport| l.terms.para == 0.0 || l.phase != report.phase)
        {
            last = Some(report);
        }
        progress.step(&trainer, last.as_ref().unwrap_or(&report));
        if interrupt.is_some_and(Interrupt::asked) {
            break;
        }
        if plan.time_limit.is_some_and(|limit| began.elapsed() >= limit) && !trainer.is_done() {
            timed_out = true;
            break;
        }
        if let Some((path, every)) = &plan.checkpoint
            && saved.elapsed() >= *every
        {
            // A full disk may have room again the next time; the run goes on.
            checkpoint = trainer.save_checkpoint(path).map_err(Failure::Output);
            if let Err(failure) = &checkpoint {
                progress.note(&format!("no checkpoint: {}", failure.text()));
            }
            saved = Instant::now();
        }
    }
    progress.finish();
    if interrupt.is_some_and(Interrupt::end) && !trainer.is_done() {
        return Err(interrupted(&trainer, plan)?);
    }
    let (steps, total) = (trainer.steps_done(), trainer.total_steps());
    if let Some((path, _)) = &plan.checkpoint {
        checkpoint = trainer.save_checkpoint(path).map_err(Failure::Output);
    }
    let coded = if plan.codes { trainer.coded().transpose() } else { None };
    let field = trainer.finish();
    Ok(Trained {
        field,
        coded,
        steps,
        total,
        noise_removed,
        last,
        before_steps,
        timed_out,
        seconds: began.elapsed().as_secs_f64(),
        checkpoint,
    })
}

fn interrupted(trainer: &Trainer, plan: &TrainingPlan) -> Result<Failure, Failure> {
    let at = format!("after step {} of {}", trainer.steps_done(), trainer.total_steps());
    // Beside the output, if the place for checkpoints has no room.
    let paths = plan.checkpoint.iter().map(|(path, _)| path).chain(&plan.on_interrupt);
    let mut failed = None;
    for path in paths {
        match trainer.save_checkpoint(path) {
            Ok(()) => {
                let text = format!("{at}; go on with the same command and --resume {}", path.display());
                return Ok(Failure::Interrupted(text));
            }
            Err(e) => failed = Some(Failure::Output(e)),
        }
    }
    failed.map_or_else(
        || Ok(Failure::Interrupted(format!("{at}; nothing was kept, as --checkpoint gives no file"))),
        Err,
    )
}
