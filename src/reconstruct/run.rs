//! The whole run, in the order in which it happens.

use super::setup::prepare;
use super::{Config, Hints, Reconstruction, StepReport, Trainer};
use crate::error::{Error, ErrorKind};
use crate::geometry::Position;
use std::ops::ControlFlow;

/// What a run reports to its observer.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Event<'a> {
    /// The input points were accepted; the shape that the field learns first is found next, which takes
    /// some seconds.
    Started {
        /// Distinct input points.
        points: usize,
        /// Points left out because an earlier one lies at the same place.
        merged: usize,
        /// Steps of all phases.
        total_steps: usize,
    },
    /// A step is done.
    Step(&'a StepReport),
    /// The training went wrong, once or more in a row, and goes on from an earlier state, with half the learning rate
    /// for each time.
    Recovered {
        /// The step it goes on from.
        step: usize,
        /// What went wrong the last time.
        reason: &'a str,
    },
}

/// How a run ended.
#[must_use]
pub enum Outcome {
    /// All steps are done.
    Done(Box<Reconstruction>),
    /// The observer stopped it. The trainer can go on, be saved, or give the result so far.
    Stopped(Box<Trainer>),
}

impl Outcome {
    /// The result: final if all steps are done, else that of the trainer's present state.
    pub fn finish(self) -> Reconstruction {
        match self {
            Outcome::Done(result) => *result,
            Outcome::Stopped(trainer) => trainer.finish(),
        }
    }
}

/// Reconstructs the surface that `points` (n x 3, any frame, of 32 or 64 bits) were taken from.
///
/// The order of the points makes no difference. Coordinates may be large or small and far from the origin: the work is
/// done in the working frame, which is centred on the points.
///
/// # Errors
/// [`ErrorKind::Data`] for unusable points, [`ErrorKind::Config`] for unusable options, [`ErrorKind::NoSurface`] if no
/// first shape is found or the field has no surface when the training begins, [`ErrorKind::Diverged`] or
/// [`ErrorKind::NoSurface`] if steps failed four times.
pub fn reconstruct<P: Position>(points: &[P], config: &Config) -> Result<Reconstruction, Error> {
    reconstruct_with(points, config, &mut |_| ControlFlow::Continue(())).map(Outcome::finish)
}

/// [`reconstruct`] with an observer, which sees every event and ends the run by returning [`ControlFlow::Break`].
///
/// # Errors
/// As [`reconstruct`], and [`ErrorKind::Cancelled`] if the observer stopped the run at [`Event::Started`], when there
/// is no state to return yet.
pub fn reconstruct_with<P: Position>(
    points: &[P],
    config: &Config,
    observer: &mut dyn FnMut(&Event<'_>) -> ControlFlow<()>,
) -> Result<Outcome, Error> {
    // Options are checked and adapted, duplicates merged, and the working frame is laid around the input points.
    let prepared = prepare(points, config, &Hints::default())?;
    let (points, total_steps) = (prepared.input.len(), prepared.config.total_steps());
    if observer(&Event::Started { points, merged: prepared.merged, total_steps }).is_break() {
        return Err(Error::new(ErrorKind::Cancelled, "the run was cancelled before its first step"));
    }
    // The input points become the working points (thinned if there are many and they are to be trained). The Gauss
    // formula finds a rough shape among them, with its normals noise is taken off, which leaves the denoised points,
    // and the first shape is made from these. Field and map get their initial weights.
    let mut trainer = Trainer::from_prepared(prepared)?;
    // The field learns the first shape (`phases::start`), S learns to cover it (`phases::pretrain`), and both are
    // trained together with the grid (`phases::train`).
    let mut recoveries = 0;
    while !trainer.is_done() {
        let report = trainer.step()?;
        if report.recoveries > recoveries {
            recoveries = report.recoveries;
            let reason = trainer.last_recovery().unwrap_or_default();
            if observer(&Event::Recovered { step: report.step, reason }).is_break() {
                return Ok(Outcome::Stopped(Box::new(trainer)));
            }
        }
        if observer(&Event::Step(&report)).is_break() {
            return Ok(Outcome::Stopped(Box::new(trainer)));
        }
    }
    // The field is corrected at the denoised points, where it should be 0 (`finish`).
    Ok(Outcome::Done(Box::new(trainer.finish())))
}
