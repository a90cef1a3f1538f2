//! Activations, and the derivative of each as an operation of its own: a field's spatial gradient is written with
//! ordinary operations, so its training needs the derivative's derivative.

use crate::autodiff::{At, Op, Tape, Var};
use crate::simd::{kernel, sigmoid_slice, softplus_sigmoid_slice};
use crate::tensor::{Tensor, map, map_to_two, map2};
use std::sync::Arc;

kernel! {
    fn relu_slice(out: &mut [f32], x: &[f32]) {
        // Written so that NaN stays NaN, which `max` would turn into 0.
        for (o, &x) in out.iter_mut().zip(x) { *o = if x <= 0.0 { 0.0 } else { x }; }
    }
}
kernel! {
    fn step_slice(out: &mut [f32], x: &[f32]) {
        for (o, &x) in out.iter_mut().zip(x) { *o = if x > 0.0 { 1.0 } else { 0.0 }; }
    }
}
kernel! {
    fn relu_gradient(out: &mut [f32], d: &[f32], x: &[f32]) {
        for ((o, &d), &x) in out.iter_mut().zip(d).zip(x) { *o = if x > 0.0 { d } else { 0.0 }; }
    }
}
kernel! {
    /// out = d s, with s the sigmoid of beta x.
    fn times(out: &mut [f32], d: &[f32], s: &[f32]) {
        for ((o, &d), &s) in out.iter_mut().zip(d).zip(s) { *o = d * s; }
    }
}
kernel! {
    /// out = beta d s (1 - s).
    fn sigmoid_gradient(out: &mut [f32], d: &[f32], s: &[f32], beta: f32) {
        for ((o, &d), &s) in out.iter_mut().zip(d).zip(s) { *o = beta * d * (s * (1.0 - s)); }
    }
}

/// max(x, 0).
struct Relu;

impl Op<1> for Relu {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        (map(x, relu_slice), ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        [Some(map2(dy, at.x[0], relu_gradient))]
    }
}

/// 1 where x > 0, else 0; constant almost everywhere, so its gradient is 0.
struct Step;

impl Op<1> for Step {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        (map(x, step_slice), ())
    }
    fn vjp(&self, _: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        [Some(dy.zeros_like_pool(dy.dims()))]
    }
}

/// ln(1 + e^(beta x)) / beta.
struct Softplus {
    beta: f32,
}

/// Softplus and its derivative from one pass over x.
fn softplus_pair(x: &Tensor, beta: f32) -> (Tensor, Tensor) {
    let (mut value, mut slope) = (x.uninit_like(x.dims()), x.uninit_like(x.dims()));
    map_to_two(&mut value, &mut slope, x, |value, slope, x| softplus_sigmoid_slice(value, slope, x, beta));
    (value, slope)
}

impl Op<1> for Softplus {
    /// The derivative at x.
    type Saved = Arc<Tensor>;
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, Self::Saved) {
        let (value, slope) = softplus_pair(x, self.beta);
        (value, Arc::new(slope))
    }
    fn vjp(&self, at: At<'_, 1, Self::Saved>, dy: &Tensor) -> [Option<Tensor>; 1] {
        [Some(map2(dy, at.saved, times))]
    }
}

/// 1 / (1 + e^(-beta x)), the derivative of [`Softplus`].
struct Sigmoid {
    beta: f32,
}

impl Op<1> for Sigmoid {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        (map(x, |o, x| sigmoid_slice(o, x, self.beta)), ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        [Some(map2(dy, at.y, |o, d, s| sigmoid_gradient(o, d, s, self.beta)))]
    }
}

impl Tape {
    /// max(x, 0). Gradient: 0 at 0.
    pub fn relu(&mut self, x: Var) -> Var {
        self.apply(Relu, [x])
    }

    /// The derivative of [`relu`](Self::relu): 1 where x > 0, else 0. Gradient: 0 everywhere.
    pub fn relu_derivative(&mut self, x: Var) -> Var {
        self.apply(Step, [x])
    }

    /// ln(1 + e^(beta x)) / beta, a smooth ReLU whose corner is about 1 / beta wide.
    pub fn softplus(&mut self, x: Var, beta: f32) -> Var {
        self.apply(Softplus { beta }, [x])
    }

    /// [`softplus`](Self::softplus) and [`softplus_derivative`](Self::softplus_derivative) of the same x, computed
    /// together at little more than the cost of one.
    pub fn softplus_and_derivative(&mut self, x: Var, beta: f32) -> (Var, Var) {
        let (value, slope) = softplus_pair(self.value(x), beta);
        let slope = Arc::new(slope);
        let y = self.record(Softplus { beta }, [x], Arc::new(value), slope.clone());
        let s = self.record(Sigmoid { beta }, [x], slope, ());
        (y, s)
    }

    /// The derivative of [`softplus`](Self::softplus): 1 / (1 + e^(-beta x)).
    pub fn softplus_derivative(&mut self, x: Var, beta: f32) -> Var {
        self.apply(Sigmoid { beta }, [x])
    }
}

#[cfg(test)]
mod tests {
    use crate::autodiff::Tape;
    use crate::ops::testing::{check, matrix, normal, same_both_ways};
    use crate::simd::testing::rows;
    use crate::tensor::Tensor;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set([x, dy] in rows(0..70), beta in 0.5f32..100.0) {
            let x = [matrix(&[x])];
            same_both_ways(|t, x| t.relu(x[0]), &x, &dy);
            same_both_ways(|t, x| t.relu_derivative(x[0]), &x, &dy);
            same_both_ways(|t, x| t.softplus(x[0], beta), &x, &dy);
            same_both_ways(|t, x| t.softplus_derivative(x[0], beta), &x, &dy);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..6, c in 1usize..6, beta in 0.5f32..5.0, seed: u64) {
            let x = normal(&[n, c], seed);
            check(|t, x| t.relu(x[0]), std::slice::from_ref(&x), seed);
            check(|t, x| t.softplus(x[0], beta), std::slice::from_ref(&x), seed);
            check(|t, x| t.softplus_derivative(x[0], beta), std::slice::from_ref(&x), seed);
            check(|t, x| { let (y, s) = t.softplus_and_derivative(x[0], beta); t.concat_cols([y, s]) }, &[x], seed);
        }
    }

    #[test]
    fn derivatives_are_those_of_the_activations() {
        let x = normal(&[5, 3], 7);
        let mut t = Tape::new();
        let v = t.input(x.clone());
        let y = t.softplus(v, 3.0);
        let s = t.softplus_derivative(v, 3.0);
        let ones = Tensor::full(&[5, 3], 1.0);
        for (a, b) in t.pull([(y, ones.clone())]).get(v).unwrap().data().iter().zip(t.value(s).data()) {
            assert!((a - b).abs() < 1e-6);
        }
        let (both_y, both_s) = t.softplus_and_derivative(v, 3.0);
        assert_eq!(t.value(both_y), t.value(y));
        assert!(t.value(both_s).data().iter().zip(t.value(s).data()).all(|(a, b)| (a - b).abs() < 1e-6));
        let y = t.relu(v);
        let s = t.relu_derivative(v);
        assert_eq!(t.pull([(y, ones)]).get(v).unwrap(), t.value(s));
    }

    #[test]
    fn nan_is_not_hidden() {
        let mut t = Tape::new();
        let x = t.constant(Tensor::scalar(f32::NAN));
        for y in [t.relu(x), t.softplus(x, 100.0), t.softplus_derivative(x, 100.0)] {
            assert!(t.value(y).item().is_nan());
        }
    }
}
