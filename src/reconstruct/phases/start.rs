//! The first phase: the field learns the first shape by regression.

use super::{ParamGradients, StepReport, Update, Workspace, check_gradients, diverged};
use crate::error::Error;
use crate::optim::{Schedule, gradient_norm};
use crate::reconstruct::Phase;
use crate::reconstruct::first_shape::FirstShape;
use crate::reconstruct::setup::Setup;
use crate::reconstruct::state::State;

/// One step of the regression of the field to `shape`.
///
/// # Errors
/// [`ErrorKind::Diverged`](crate::ErrorKind::Diverged) if the field or its gradients are not finite.
pub(in crate::reconstruct) fn step(
    setup: &Setup,
    state: &State,
    shape: &FirstShape,
    work: &mut Workspace,
) -> Result<Update, Error> {
    let config = &setup.config;
    let (_, step) = config.phase_at(state.step);
    let fit = shape.fit.step(&state.field, &mut work.memory.lend(), step);
    let gradients: ParamGradients = fit.gradients;
    let gradient_norm = gradient_norm(&gradients);
    if !fit.loss.is_finite() {
        return Err(diverged("the field is not finite while it learns its first shape"));
    }
    check_gradients("the field", &gradients)?;

    let steps = config.steps_in(Phase::Start);
    // Constant rate: a decaying one also fits the first shape's faults, such as webs between fingers, which the
    // training does not remove.
    let schedule = Schedule { warmup: steps / 20, ..Schedule::constant(config.start.rate) };
    let field_rate = schedule.rate_at(step, steps);
    Ok(Update {
        report: StepReport { loss: fit.loss, field_rate, gradient_norm, ..StepReport::default() },
        field: Some(gradients),
        map: None,
        part_of_s: None,
    })
}
