//! The report of a step.

use crate::reconstruct::objective::Terms;
use crate::reconstruct::phase::Phase;

/// What happened in a step. Losses are in the working frame, before their weights; 0 where the weight is 0, and where
/// the phase does not have them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct StepReport {
    /// The step, from 0, counted through all phases.
    pub step: usize,
    /// Steps of all phases.
    pub total: usize,
    /// The phase of the step.
    pub phase: Phase,
    /// Cubes along each side of the grid; `None` before the training proper, which has none.
    pub resolution: Option<usize>,
    /// The loss that the step minimised: in the training proper the weighted sum of all terms, in the pretraining
    /// L_para, in the start the mean difference between the field and the distance to its first shape (plus a small
    /// multiple of that of their gradients).
    pub loss: f32,
    /// The terms of the loss, before their weights.
    pub terms: Terms,
    /// Learning rate of the field; 0 in steps of the pretraining.
    pub field_rate: f32,
    /// Learning rate of the parameterization, in steps that train it; 0 in steps of the start.
    pub bsp_rate: f32,
    /// Length of the gradient, before it was clipped: that of the parameterization in the pretraining, otherwise that
    /// of the field.
    pub gradient_norm: f64,
    /// Grid vertices that the step worked on.
    pub active_verts: usize,
    /// Vertices of the extracted surface.
    pub surface_verts: usize,
    /// How often the run has gone back to an earlier state so far.
    pub recoveries: usize,
}
