//! What the gradient checks of the operations share.

use crate::autodiff::check::{CheckOptions, Failure, gradient};
use crate::autodiff::{Tape, Var};
use crate::simd::testing::same_at_all;
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

/// If a gradient can be compared in fewer directions than this, its input is taken to lie near a kink and is moved.
const MIN_COMPARED: usize = 3;

/// Checks the gradient of `f` and panics with what disagrees.
///
/// Random inputs lie on a kink of `f` now and then, where in most directions nothing can be compared. Then they are
/// scaled, each value by a random factor near 1, and the check is made there; it panics if eight such inputs all lie on
/// a kink.
#[track_caller]
pub(crate) fn check(f: impl Fn(&mut Tape, &[Var]) -> Var, inputs: &[Tensor], seed: u64) {
    let mut moved = inputs.to_vec();
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x6b69_6e6b);
    for left in (0..=8).rev() {
        let failure = match gradient(&f, &moved, CheckOptions { seed, ..CheckOptions::default() }) {
            // The last inputs will do with one direction.
            Ok(compared) if compared >= MIN_COMPARED || left == 0 => return,
            Ok(_) => None,
            Err(failure) => Some(failure),
        };
        if let Some(failure) = failure.filter(|f| left == 0 || matches!(f, Failure::Mismatch { .. })) {
            let shapes: Vec<_> = inputs.iter().map(Tensor::shape).collect();
            panic!("{failure}; shapes {shapes:?}, seed {seed}")
        }
        for (moved, input) in moved.iter_mut().zip(inputs) {
            for (value, &from) in moved.data_mut().iter_mut().zip(input.data()) {
                let normal: f32 = StandardNormal.sample(&mut rng);
                *value = from * (1.0 + 0.05 * normal);
            }
        }
    }
}

/// The value of `f` and its gradients at all inputs, one after the other; the gradient that comes in at the value is
/// `dy`, over and over.
pub(crate) fn both_ways(f: &dyn Fn(&mut Tape, &[Var]) -> Var, inputs: &[Tensor], dy: &[f32]) -> Vec<f32> {
    let mut t = Tape::new();
    let x: Vec<Var> = inputs.iter().map(|x| t.input(x.clone())).collect();
    let y = f(&mut t, &x);
    let shape = t.value(y).shape();
    let seed = dy.iter().cycle().take(shape.len()).copied().collect();
    let gradients = t.pull([(y, Tensor::from_vec(shape.dims(), seed))]);
    let mut all = t.value(y).data().to_vec();
    x.iter().for_each(|&x| all.extend(gradients.get(x).expect("an input that f depends on").data()));
    all
}

/// Asserts that the value of `f` and its gradients are the same at every instruction set; see [`both_ways`].
#[track_caller]
pub(crate) fn same_both_ways(f: impl Fn(&mut Tape, &[Var]) -> Var, inputs: &[Tensor], dy: &[f32]) {
    same_at_all(|| both_ways(&f, inputs, dy));
}

/// Rows of one length as a matrix.
pub(crate) fn matrix(rows: &[Vec<f32>]) -> Tensor {
    Tensor::from_vec(&[rows.len(), rows[0].len()], rows.concat())
}

/// Values and gradients of two functions of (q, k, v) agree.
pub(crate) fn same(
    inputs: [Tensor; 3],
    a: impl Fn(&mut Tape, [Var; 3]) -> Var,
    b: impl Fn(&mut Tape, [Var; 3]) -> Var,
) {
    let run = |f: &dyn Fn(&mut Tape, [Var; 3]) -> Var| {
        let mut t = Tape::new();
        let x = inputs.clone().map(|x| t.input(x));
        let y = f(&mut t, x);
        let seed = normal(t.value(y).dims(), 99);
        let mut gradients = t.pull([(y, seed)]);
        let mut out = vec![t.value(y).clone()];
        out.extend(x.map(|x| gradients.take(x).unwrap()));
        out
    };
    for (i, (a, b)) in run(&a).iter().zip(run(&b)).enumerate() {
        assert_eq!(a.shape(), b.shape());
        for (a, b) in a.data().iter().zip(b.data()) {
            assert!((a - b).abs() < 1e-5 * (1.0 + b.abs()), "result {i}: {a} {b}");
        }
    }
}

/// Queries n x c, keys m x c and values m x d.
pub(crate) fn attention_inputs(n: usize, m: usize, c: usize, d: usize, seed: u64) -> [Tensor; 3] {
    [normal(&[n, c], seed), normal(&[m, c], seed ^ 1), normal(&[m, d], seed ^ 2)]
}
