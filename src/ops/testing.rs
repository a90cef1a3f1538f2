//! What the gradient checks of the operations share.

use crate::autodiff::check::{Options, gradient};
use crate::autodiff::{Tape, Var};
use crate::tensor::Tensor;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Standard normal values.
pub(crate) fn normal(dims: &[usize], seed: u64) -> Tensor {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut t = Tensor::zeros(dims);
    t.data_mut().iter_mut().for_each(|v| *v = StandardNormal.sample(&mut rng));
    t
}

/// Values between 0.5 and about 3.
pub(crate) fn positive(dims: &[usize], seed: u64) -> Tensor {
    let mut t = normal(dims, seed);
    t.data_mut().iter_mut().for_each(|v| *v = 0.5 + v.abs());
    t
}

/// Checks the gradient of `f` and panics with what disagrees. Returns in how many directions it was compared.
#[track_caller]
pub(crate) fn check(f: impl Fn(&mut Tape, &[Var]) -> Var, inputs: &[Tensor], seed: u64) -> usize {
    let options = Options { seed, ..Options::default() };
    gradient(f, inputs, options).unwrap_or_else(|mismatch| {
        let shapes: Vec<_> = inputs.iter().map(Tensor::shape).collect();
        panic!("{mismatch}; shapes {shapes:?}, seed {seed}")
    })
}
