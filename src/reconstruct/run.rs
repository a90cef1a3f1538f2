//! The whole run, with a callback that can stop it.

use super::{Config, Reconstruction, StepReport, Trainer};
use crate::error::{Error, ErrorKind};
use crate::geometry::Position;
use std::ops::ControlFlow;

/// What a run tells while it goes.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Event<'a> {
    /// The cloud was accepted; the shape that the field learns first is found next, which takes up to some seconds
    /// for thousands of points.
    Started {
        /// Distinct points.
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

/// Reconstructs the surface that `points` (n x 3, any frame, of 32 or 64 bits) were taken from.
///
/// Coordinates may be large or small and far from the origin: the work is done about the middle of the cloud.
///
/// `on_event` sees every event and ends the run by returning [`ControlFlow::Break`]. For a run that is stopped early
/// and still gives a result, or that is saved on its way, drive a [`Trainer`] instead.
///
/// # Errors
/// [`ErrorKind::Data`] for unusable points, [`ErrorKind::Config`] for unusable options, [`ErrorKind::Cancelled`] if the
/// callback said so, [`ErrorKind::Diverged`] or [`ErrorKind::NoSurface`] if training failed four times.
pub fn reconstruct<P: Position>(
    points: &[P],
    config: &Config,
    on_event: &mut dyn FnMut(&Event<'_>) -> ControlFlow<()>,
) -> Result<Reconstruction, Error> {
    let tell =
        |event: Event<'_>, on_event: &mut dyn FnMut(&Event<'_>) -> ControlFlow<()>| match on_event(&event) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Error::new(ErrorKind::Cancelled, "the run was cancelled")),
        };
    let start = super::trainer::prepare(points, config)?;
    let event = Event::Started {
        points: start.input.len(),
        merged: start.merged,
        total_steps: start.config.total_steps(),
    };
    tell(event, on_event)?;
    let mut trainer = Trainer::from_prepared(start)?;
    let mut recoveries = 0;
    while !trainer.is_done() {
        let report = trainer.step()?;
        if report.recoveries > recoveries {
            recoveries = report.recoveries;
            let reason = trainer.last_recovery().unwrap_or_default();
            tell(Event::Recovered { step: report.step, reason }, on_event)?;
        }
        tell(Event::Step(&report), on_event)?;
    }
    Ok(trainer.finish())
}
