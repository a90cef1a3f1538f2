//! The phases of a run, and the steps of those before the training proper.
//!
//! The field learns the first shape that is found among the points; then the parameterization is trained alone, to
//! cover it. Both are quick against the training, and counted, reported, saved and taken back like it.

use crate::reconstruct::Trainer;
use crate::reconstruct::first_shape::{FirstShape, shape_term};
use crate::reconstruct::trainer::untrained;
use train::{check_gradients, check_near, diverged, forward_map, para_term};
pub(super) mod train;

pub use train::StepReport;

use crate::error::Error;
use crate::geometry::TetGrid;
use crate::optim::{Schedule, gradient_norm};
use std::fmt;

/// Steps between two states that are kept to fall back to.
const KEEP_EVERY: usize = 20;

/// What a step of a run is for, in the order of the run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Phase {
    /// The field learns its first shape by regression (`start.steps`).
    #[default]
    Start,
    /// The parameterization is trained alone, on L_para (`bsp.pretrain`).
    Pretrain,
    /// The training proper (`stages`): field, grid and parameterization together.
    Train,
}

impl Phase {
    /// All phases, in order.
    pub const ALL: [Phase; 3] = [Phase::Start, Phase::Pretrain, Phase::Train];

    /// The name: `start`, `pretrain` or `train`.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Start => "start",
            Phase::Pretrain => "pretrain",
            Phase::Train => "train",
        }
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Trainer {
    /// The phase that the next step belongs to; the training once all steps are done.
    pub fn phase(&self) -> Phase {
        self.config.phase_at(self.step).0
    }

    /// The number of the step within the training proper; 0 before it.
    pub(in crate::reconstruct) fn train_step(&self) -> usize {
        match self.config.phase_at(self.step) {
            (Phase::Train, step) => step,
            _ => 0,
        }
    }

    /// Finds the first shape and takes over what it says of the cloud: the points without their noise and, by their
    /// normals, the parts in which S is made.
    pub(in crate::reconstruct) fn find_shape(&mut self) -> Result<(), Error> {
        let samples = self.map.as_ref().map_or(0, |m| m.surface_len(self.cloud.len()));
        self.shape = FirstShape::find(&self.cloud, &self.config, samples)?;
        if let Some(shape) = self.shape.as_ref().filter(|shape| shape.cloud.moved > 0.0) {
            self.cloud.clone_from(&shape.cloud.points);
            self.map.iter_mut().for_each(|map| map.set_cloud(&self.cloud));
        }
        let normals = self.shape.as_ref().map(|s| &s.normals[..]);
        let size = self.config.batch.centres;
        self.blocks = self.map.as_ref().map_or_else(Vec::new, |m| m.blocks(&self.cloud, normals, size));
        Ok(())
    }

    /// One step of the regression. On an error the parameters are as before it.
    pub(in crate::reconstruct) fn try_start(&mut self) -> Result<StepReport, Error> {
        let shape = self.shape.as_mut().expect("the phase has no steps without a shape");
        let fit = shape.fit.step(&self.field, &mut self.work.pass, self.step);
        let gradient_norm = gradient_norm(&fit.gradients);
        if !fit.loss.is_finite() {
            return Err(diverged("the field is not finite while it learns its first shape"));
        }
        check_gradients("the field", &fit.gradients)?;
        self.keep(self.step);

        let steps = self.config.steps_in(Phase::Start);
        // A rate that falls fits the first shape better and ends worse (0.066 for 0.062): with the webs between fingers
        // and the like, which are not so sharp otherwise, and which the training does not take back.
        let schedule = Schedule { warmup: steps / 20, ..Schedule::constant(self.config.start.rate) };
        let field_rate = self.rate_factor() * schedule.rate_at(self.step, steps);
        self.field_adam.step(self.field.params_mut().values_mut(), &fit.gradients, field_rate);
        let report = StepReport { loss: fit.loss, field_rate, gradient_norm, ..self.blank_report() };
        self.step += 1;
        Ok(report)
    }

    /// One step of the parameterization alone, on L_para. On an error the parameters are as before it.
    pub(in crate::reconstruct) fn try_pretrain(&mut self) -> Result<StepReport, Error> {
        let (_, step) = self.config.phase_at(self.step);
        let map = self.map.as_ref().expect("the phase has no steps without a map");
        let block = &self.blocks[step % self.blocks.len()];
        let tape = &mut self.work.tape;
        tape.clear();
        let p = map.params().bind(tape, true);
        let (surface, context) = forward_map(tape, map, &p, &self.cloud, block)?;
        let slack = map.slack(block, self.cloud.len());
        let para = match &self.shape {
            Some(shape) if self.config.bsp_pretrain_on_shape => {
                let around = shape.around(block);
                shape_term(tape, surface, context, block, &around, slack)
            }
            _ => para_term(tape, surface, context, block, slack),
        };
        let loss = tape.value(para).item();
        let gradients = p.collect(&mut tape.backward(para));
        // Parameters that the tape holds would be copied.
        tape.clear();
        let gradient_norm = gradient_norm(&gradients);
        if !loss.is_finite() {
            return Err(diverged("the loss of the parameterization is not finite"));
        }
        check_gradients("the parameterization", &gradients)?;
        self.keep(step);

        let rate = self.config.bsp_rate.rate_at(step, self.config.steps_in(Phase::Pretrain));
        let bsp_rate = self.rate_factor() * rate;
        if let (Some(map), Some(adam)) = (&mut self.map, &mut self.map_adam) {
            adam.step(map.params_mut().values_mut(), &gradients, bsp_rate);
        }
        let report = StepReport { loss, para: loss, bsp_rate, gradient_norm, ..self.blank_report() };
        self.step += 1;
        Ok(report)
    }

    /// Where the regression left most points outside, as it may for a blade that is thin against what the network can
    /// learn in its steps, moves the field's level, so that the middle one of the points is half a cube of the grid
    /// inside. Returns whether it did; done once, it is not done again.
    pub(in crate::reconstruct) fn lower_to_points(&mut self) -> Result<bool, Error> {
        let mut values = self.field.sdf(&self.cloud);
        values.sort_by(f32::total_cmp);
        let middle = values[values.len() / 2];
        let cube = TetGrid::working_frame(self.resolution_at(0))?.spacing();
        let outside = self.shape.is_some() && middle > -0.25 * cube;
        if outside {
            self.field.lower(middle + 0.5 * cube);
        }
        Ok(outside)
    }

    /// What comes before the first step of the training proper; doing it again changes nothing.
    pub(in crate::reconstruct) fn begin_training(&mut self) -> Result<(), Error> {
        // The moments of the regression say nothing about the losses to come.
        self.field_adam = untrained(self.field.params());
        if let Some(map) = &self.map {
            let surface = map.surface(&self.cloud, &self.blocks);
            check_near("the parameterized surface", surface.as_flattened())?;
            self.surface = surface;
        }
        Ok(())
    }

    /// Keeps the present state to fall back to, now and then. It is known to have a finite loss and finite gradients.
    fn keep(&mut self, step: usize) {
        if step.is_multiple_of(KEEP_EVERY) {
            self.good = self.snapshot();
        }
    }

    fn blank_report(&self) -> StepReport {
        StepReport {
            step: self.step,
            total: self.total_steps(),
            phase: self.phase(),
            recoveries: self.recoveries,
            ..Default::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::field::Field;
    use crate::reconstruct::tests::{at_training, ball, tiny};

    #[test]
    fn a_field_without_an_inside_is_lowered_to_the_points() {
        let mut trainer = at_training(&ball(60), &tiny());
        trainer.field.lower(-0.6);
        let outside = trainer.field.clone();
        let report = trainer.step().unwrap();
        assert!(report.surface_verts > 0 && report.recoveries == 0, "{report:?}");
        let lowered = |field: &Field| {
            let mut values = field.sdf(&trainer.cloud);
            values.sort_by(f32::total_cmp);
            values[30]
        };
        // Of a cube of a tenth of the grid half is left, and a step's change.
        assert!(
            lowered(&outside) > 0.2 && (-0.12..0.0).contains(&lowered(&trainer.field)),
            "{}",
            lowered(&trainer.field)
        );
        // It is no way out of what it has led to.
        assert!(!trainer.lower_to_points().unwrap());
    }
}
