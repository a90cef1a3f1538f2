//! The phases of a run. A step of each takes the setup, a state, what it works on and a workspace, and returns an
//! [`Update`] of the state.
//!
//! The field learns the first shape that is found among the points ([`start`]); then the parameterization is trained
//! alone, to cover it ([`pretrain`]); then field, grid and parameterization together ([`train`]). The first two are
//! quick against the third, and are counted, reported, saved and recovered like it.

pub(super) mod pretrain;
mod report;
pub(super) mod start;
pub(super) mod train;

pub use report::StepReport;

use crate::autodiff::Tape;
use crate::error::{Error, ErrorKind};
use crate::field::FieldMemory;
use crate::geometry::{Isosurface, TriangleBvh};
use crate::optim::gradient_norm;
use crate::tensor::Tensor;

/// Gradients of a network, parameter by parameter.
pub(super) type ParamGradients = Vec<Option<Tensor>>;

/// What a step does to the state: gradients, known to be finite, for the optimisers, and a new part of S.
pub(super) struct Update {
    /// The report of the step, with the learning rates of the schedules. The trainer lowers these after recoveries, and
    /// fills in what follows from the place of the step in the run.
    pub report: StepReport,
    /// Gradients by the parameters of the field, if the step trains it.
    pub field: Option<ParamGradients>,
    /// Gradients by the parameters of the parameterization, if the step trains it.
    pub map: Option<ParamGradients>,
    /// A block and its part of S, if the step computed that.
    pub part_of_s: Option<(usize, Vec<[f32; 3]>)>,
}

/// Buffers reused between steps; no training state.
#[derive(Default)]
pub(super) struct Workspace {
    pub tape: Tape,
    /// For passes over the field.
    pub memory: FieldMemory,
    /// The extracted surface.
    pub iso: Isosurface,
    /// The search tree over the faces of the extracted surface, rebuilt in each step that needs it.
    pub tree: Option<TriangleBvh>,
    /// For tests of gradients: the first step stores its samples on the faces here, and later steps use them again,
    /// since the loss jumps where a sample moves to another face.
    #[cfg(test)]
    pub held_samples: Option<std::sync::OnceLock<crate::gdo::FaceSamples>>,
}

impl Workspace {
    /// Lets go of the parameters that the last step has put on the tape: they would be copied when they change.
    pub fn clear(&mut self) {
        self.tape.clear();
    }
}

/// The largest coordinate, working frame; beyond it the training has diverged.
pub(super) const MAX_COORDINATE: f32 = 1e6;

/// The error for values that are not finite or far away.
pub(super) fn diverged(message: impl Into<String>) -> Error {
    Error::new(ErrorKind::Diverged, message)
}

/// Called between the parts of a step; true abandons the step.
pub(super) type Stop<'a> = &'a (dyn Fn() -> bool + Sync);

/// The end of a step that is given up.
///
/// # Errors
/// [`ErrorKind::Cancelled`] if `stop` returns true.
pub(super) fn go_on(stop: Stop<'_>) -> Result<(), Error> {
    if stop() { Err(Error::new(ErrorKind::Cancelled, "the step was given up")) } else { Ok(()) }
}

/// Refuses coordinates that neighbour searches cannot take.
pub(super) fn check_near(what: &str, points: &[f32]) -> Result<(), Error> {
    // Written so that NaN is refused.
    if points.iter().all(|x| x.abs() < MAX_COORDINATE) {
        return Ok(());
    }
    Err(diverged(format!("{what} is not finite or far away")))
}

/// Refuses gradients that are not finite.
pub(super) fn check_gradients(what: &str, gradients: &[Option<Tensor>]) -> Result<(), Error> {
    if gradient_norm(gradients).is_finite() {
        return Ok(());
    }
    Err(diverged(format!("the gradient of {what} is not finite")))
}
