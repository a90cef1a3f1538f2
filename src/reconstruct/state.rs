//! Everything that a step changes.

use super::bridges::Bridges;
use super::phases::Update;
use crate::bsp::{Neighbourhood, SurfaceMap};
use crate::field::Field;
use crate::nn::Params;
use crate::optim::{Adam, AdamOptions};

/// Everything that a step changes: with the [`Setup`](super::setup::Setup), all that the rest of a run depends on. A
/// state to come back to is a clone.
#[derive(Clone, Debug)]
pub(super) struct State {
    /// Steps done, of all phases.
    pub step: usize,
    pub field: Field,
    pub field_adam: Adam,
    /// The map from the denoised points to S; none without a parameterization.
    pub map: Option<SurfaceMap>,
    pub map_adam: Option<Adam>,
    /// S as last computed, working frame; empty without a map, zeros before the training proper.
    pub surface: Vec<[f32; 3]>,
    /// Points that the loss draws inside the surface, so that near parts of it stay joined.
    pub bridges: Bridges,
}

impl State {
    /// The state before the first step; S has `points_of_s` points.
    pub fn new(field: Field, map: Option<SurfaceMap>, points_of_s: usize) -> Self {
        State {
            step: 0,
            field_adam: fresh_adam(field.params()),
            field,
            map_adam: map.as_ref().map(|map| fresh_adam(map.params())),
            map,
            surface: vec![[0.0; 3]; points_of_s],
            bridges: Bridges::default(),
        }
    }

    /// Steps along the gradients of an update, puts its part of S in place, and counts the step. `blocks` are
    /// those of the map.
    pub fn apply(&mut self, blocks: &[Neighbourhood], update: &Update) {
        let report = &update.report;
        if let Some(gradients) = &update.field {
            self.field_adam.step(self.field.params_mut().values_mut(), gradients, report.field_rate);
        }
        if let (Some(map), Some((block, part))) = (&self.map, &update.part_of_s) {
            map.place(&blocks[*block], part, &mut self.surface);
        }
        if let (Some(map), Some(adam), Some(gradients)) = (&mut self.map, &mut self.map_adam, &update.map) {
            adam.step(map.params_mut().values_mut(), gradients, report.bsp_rate);
        }
        self.step += 1;
    }
}

/// An optimiser that has not made a step.
pub(super) fn fresh_adam(params: &Params) -> Adam {
    Adam::new(params.values(), AdamOptions::default())
}
