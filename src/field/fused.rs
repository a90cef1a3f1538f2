//! The field as one operation on the tape: from all its parameters to its values at many points.

use super::pass::FieldPass;
use super::{Field, FieldVars};
use crate::autodiff::{At, Op, Tape, Var};
use crate::tensor::Tensor;
use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, PoisonError};

/// Memory for passes over fields, used again from step to step. Clones share it.
#[derive(Clone, Default)]
pub struct FieldMemory {
    idle: Arc<Mutex<Vec<FieldPass>>>,
}

/// A pass that goes back to the memory that lent it when it is dropped.
pub(crate) struct LentPass {
    pass: FieldPass,
    home: FieldMemory,
}

impl FieldMemory {
    /// A pass that no one else uses, with the buffers of an earlier one if there is one.
    pub(crate) fn lend(&self) -> LentPass {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        LentPass { pass: idle.unwrap_or_default(), home: self.clone() }
    }
}

impl Deref for LentPass {
    type Target = FieldPass;
    fn deref(&self) -> &FieldPass {
        &self.pass
    }
}

impl DerefMut for LentPass {
    fn deref_mut(&mut self) -> &mut FieldPass {
        &mut self.pass
    }
}

impl Drop for LentPass {
    fn drop(&mut self) {
        let mut pass = std::mem::take(&mut self.pass);
        pass.release();
        self.home.idle.lock().unwrap_or_else(PoisonError::into_inner).push(pass);
    }
}

/// All parameters, 1 x P, to all values at n points: n x 4, or n x 7 with a displacement.
struct FusedField {
    /// The network, whose own parameters do not count.
    field: Field,
    /// n x 3, working frame.
    points: Vec<[f32; 3]>,
    memory: FieldMemory,
}

impl Op<1> for FusedField {
    /// The forward pass, which the backward pass goes back through.
    type Saved = Mutex<LentPass>;

    fn forward(&self, [parameters]: [&Tensor; 1]) -> (Tensor, Self::Saved) {
        let field = self.field.with_parameters(parameters.data());
        let mut pass = self.memory.lend();
        let mut values = parameters.uninit_like(&[self.points.len(), field.value_cols()]);
        pass.forward(&field, &self.points, values.data_mut());
        (values, Mutex::new(pass))
    }

    fn vjp(&self, at: At<'_, 1, Self::Saved>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let mut pass = at.saved.lock().unwrap_or_else(PoisonError::into_inner);
        [Some(Tensor::from_vec(at.x[0].dims(), pass.backward(dy.data())))]
    }
}

impl Field {
    /// g, grad g and the displacement at n points (n x 3, working frame) from the parameters in one row, 1 x P as
    /// [`Params::flat`](crate::nn::Params::flat) puts them; those of `self` do not count.
    ///
    /// Gradient: to the parameters; the points are constant.
    ///
    /// # Panics
    /// If there are not P parameters.
    #[track_caller]
    pub fn fused(
        &self,
        tape: &mut Tape,
        parameters: Var,
        points: &[[f32; 3]],
        memory: &FieldMemory,
    ) -> FieldVars {
        let op = FusedField { field: self.clone(), points: points.to_vec(), memory: memory.clone() };
        let values = tape.apply(op, [parameters]);
        FieldVars {
            points: tape.constant(Tensor::from_points(points)),
            sdf: tape.slice_cols(values, 0..1),
            gradient: tape.slice_cols(values, 1..4),
            offset: self.has_offset().then(|| tape.slice_cols(values, 4..7)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{FieldActivation, FieldConfig};
    use crate::ops::testing::{check, normal};
    use crate::random::Random;
    use proptest::prelude::*;

    fn field(skip: bool, octaves: usize, offset: bool, seed: u64) -> Field {
        let config = FieldConfig {
            width: 7,
            depth: 3,
            octaves,
            frequency: 1.5,
            activation: FieldActivation::Softplus { beta: 4.0 },
            skip: skip.then_some(2),
            radius: 0.4,
        };
        let mut rng = Random::new(seed);
        if offset { Field::with_offset(config, &mut rng) } else { Field::new(config, &mut rng) }
    }

    /// Parameters that have left the geometric start, at which the waves are silent.
    fn parameters(field: &Field, seed: u64) -> Tensor {
        let mut all = field.params().flat();
        let noise = normal(all.dims(), seed ^ 77);
        all.data_mut().iter_mut().zip(noise.data()).for_each(|(w, n)| *w += 0.1 * n);
        all
    }

    fn points(n: usize, seed: u64) -> Vec<[f32; 3]> {
        normal(&[n, 3], seed).to_points().into_iter().map(|p| p.map(|x| 0.3 * x)).collect()
    }

    fn all_values(tape: &mut Tape, out: FieldVars) -> Var {
        let both = tape.concat_cols([out.sdf, out.gradient]);
        match out.offset {
            Some(offset) => tape.concat_cols([both, offset]),
            None => both,
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn gradients(skip: bool, offset: bool, octaves in 0usize..3, seed: u64) {
            let field = field(skip, octaves, offset, seed);
            let (p, x) = (parameters(&field, seed), points(6, seed));
            let memory = FieldMemory::default();
            check(|t, v| { let out = field.fused(t, v[0], &x, &memory); all_values(t, out) }, &[p], seed);
        }

        #[test]
        fn agrees_with_tape_operations(skip: bool, offset: bool, octaves in 0usize..3, n in 0usize..12, seed: u64) {
            let field = field(skip, octaves, offset, seed);
            let (p, x) = (parameters(&field, seed), points(n, seed));
            let mut tape = Tape::new();
            let flat = tape.input(p.clone());
            let out = field.fused(&mut tape, flat, &x, &FieldMemory::default());
            let fused = all_values(&mut tape, out);
            let twin = field.with_parameters(p.data());
            let bound = twin.params().bind(&mut tape, true);
            let out = twin.outputs(&mut tape, &bound, &x);
            let plain = all_values(&mut tape, out);
            let seeds = normal(tape.value(plain).dims(), seed ^ 1);
            let [a, b] = [fused, plain].map(|var| tape.pull([(var, seeds.clone())]));
            let plain_gradients: Vec<f32> = { let mut b = b; bound.collect(&mut b) }
                .iter().zip(twin.params().values())
                .flat_map(|(g, like)| g.as_ref().map_or(vec![0.0; like.len()], |g| g.data().to_vec()))
                .collect();
            let pairs = [
                (tape.value(fused).data(), tape.value(plain).data()),
                (a.get(flat).unwrap().data(), &plain_gradients[..]),
            ];
            for (a, b) in pairs {
                let scale = b.iter().fold(1.0f32, |m, x| m.max(x.abs()));
                prop_assert_eq!(a.len(), b.len());
                prop_assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-5 * scale));
            }
        }
    }

    #[test]
    fn two_fields_on_one_tape_do_not_share_a_pass_and_memory_comes_back() {
        let (field, memory) = (field(false, 1, false, 1), FieldMemory::default());
        let mut tape = Tape::new();
        let p = tape.input(parameters(&field, 1));
        // Of equal numbers of points, so that a pass taken for the other would not be noticed by its size.
        let both = [2, 3].map(|seed| field.fused(&mut tape, p, &points(9, seed), &memory));
        let alone = [2, 3].map(|seed| {
            let mut tape = Tape::new();
            let p = tape.input(parameters(&field, 1));
            let out = field.fused(&mut tape, p, &points(9, seed), &memory);
            tape.pull([(out.sdf, normal(&[9, 1], seed))]).take(p).unwrap()
        });
        for (i, seed) in [(0, 2), (1, 3)] {
            let gradient = tape.pull([(both[i].sdf, normal(&[9, 1], seed))]);
            assert_eq!(gradient.get(p).unwrap(), &alone[i]);
        }
        tape.clear();
        assert_eq!(memory.idle.lock().unwrap().len(), 3);
    }
}
