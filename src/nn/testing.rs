//! What the tests of the layers share.

use super::{Bound, Params, Scope};
use crate::autodiff::check::{CheckOptions, gradient};
use crate::autodiff::{Tape, Var};
use crate::ops::testing::normal;
use crate::random::Random;
use crate::tensor::Tensor;

/// A layer with its parameters, named `layer. ...`, and random inputs.
pub(crate) struct Layer<L, F> {
    layer: L,
    params: Params,
    inputs: Vec<Tensor>,
    forward: F,
}

impl<L, F: Fn(&L, &mut Tape, &Bound, &[Var]) -> Var> Layer<L, F> {
    pub(crate) fn new(
        shapes: &[[usize; 2]],
        make: impl FnOnce(&mut Scope<'_>, &mut Random) -> L,
        forward: F,
    ) -> Self {
        let mut params = Params::new();
        let layer = make(&mut params.scope("layer"), &mut Random::new(11));
        // Parameters that start at 0 or 1 would hide errors.
        for (i, value) in params.values_mut().iter_mut().enumerate() {
            let noise = normal(value.dims(), 100 + i as u64);
            let value = std::sync::Arc::make_mut(value);
            value.data_mut().iter_mut().zip(noise.data()).for_each(|(v, n)| *v += 0.2 * n);
        }
        let inputs = shapes.iter().enumerate().map(|(i, s)| normal(s, 50 + i as u64)).collect();
        Layer { layer, params, inputs, forward }
    }

    /// Checks the gradients of all inputs and all parameters.
    #[track_caller]
    pub(crate) fn check(&self, seed: u64) {
        let mut all = self.inputs.clone();
        all.extend(self.params.iter().map(|(_, _, value)| value.clone()));
        let cut = self.inputs.len();
        let f = |t: &mut Tape, x: &[Var]| {
            (self.forward)(&self.layer, t, &Bound::new(x[cut..].to_vec()), &x[..cut])
        };
        // A layer has many ReLUs; a short step keeps most directions clear of all their kinks.
        let options = CheckOptions { seed, step: 2e-3, ..CheckOptions::default() };
        if let Err(failure) = gradient(f, &all, options) {
            panic!("{failure}; inputs, then {:?}", self.params.names().collect::<Vec<_>>());
        }
    }

    /// Every parameter has a finite gradient, and exactly those in `dead` have none above rounding.
    #[track_caller]
    pub(crate) fn assert_alive(&self, dead: &[&str]) {
        let mut tape = Tape::new();
        let bound = self.params.bind(&mut tape, true);
        let x: Vec<Var> = self.inputs.iter().map(|x| tape.input(x.clone())).collect();
        let y = (self.forward)(&self.layer, &mut tape, &bound, &x);
        let seed = normal(tape.value(y).dims(), 77);
        let gradients = bound.collect(&mut tape.pull([(y, seed)]));
        for ((_, name, _), gradient) in self.params.iter().zip(gradients) {
            let largest = gradient.map_or(0.0, |g| {
                assert!(g.is_finite(), "{name}: gradient {g:?}");
                g.data().iter().fold(0.0f32, |m, v| m.max(v.abs()))
            });
            assert_eq!(largest < 1e-5, dead.contains(&name), "{name}: largest gradient {largest:e}");
        }
    }
}
