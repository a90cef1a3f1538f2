//! Checks gradients by finite differences: whoever writes an [`Op`](super::Op) can test it here.
//!
//! The function under test maps input tensors to one output tensor. Its output is weighted with fixed random numbers
//! and summed in f64; along random directions in the space of each input, the central difference of that sum is
//! compared with the directional derivative that the tape gives. A direction that crosses a kink (ReLU at 0, a switch
//! of neighbours) is drawn again: there the central difference changes when the step is halved, or the two one-sided
//! differences do not approach each other.
//!
//! The values are f32, so a difference carries a rounding error of about eps (|w y| + |g x|) / step, the lengths of
//! the weighted outputs and of the gradient times the input. Where a derivative happens to be smaller than that, only
//! agreement within a few such errors can be asked for.

use super::{Tape, Var};
use crate::tensor::Tensor;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::fmt;

/// How a gradient is checked.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct CheckOptions {
    /// Random directions per input.
    pub directions: usize,
    /// Step along a direction whose n entries have unit variance; divided by the fourth root of n.
    pub step: f32,
    /// Largest |analytic - numeric| / (1e-3 + max of both).
    pub tolerance: f64,
    /// Seed of directions and weights.
    pub seed: u64,
}

impl Default for CheckOptions {
    fn default() -> Self {
        CheckOptions { directions: 6, step: 1e-2, tolerance: 5e-3, seed: 0 }
    }
}

/// Why a gradient is not known to be right.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Failure {
    /// It does not agree with finite differences.
    Mismatch {
        /// Which input, from 0.
        input: usize,
        /// The derivative that the tape gives along a random direction.
        analytic: f64,
        /// The derivative along it by central differences.
        numeric: f64,
    },
    /// Every direction that was tried crosses a kink of the function, so nothing was compared.
    NotCompared {
        /// Which input, from 0.
        input: usize,
    },
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Mismatch { input, analytic, numeric } => {
                write!(f, "input {input}: the tape gives {analytic:.6}, differences give {numeric:.6}")
            }
            Failure::NotCompared { input } => {
                write!(
                    f,
                    "input {input}: it lies on a kink of the function, so its gradient was not compared"
                )
            }
        }
    }
}

impl std::error::Error for Failure {}

/// Compares the gradient of `f` at `inputs` with finite differences, for every input.
///
/// Returns the number of directions in which they were compared, of the input that had fewest: at least 1, and fewer
/// than asked for near kinks. Inputs without values are passed over.
///
/// # Errors
/// [`Failure::Mismatch`] with the first direction in which they disagree, [`Failure::NotCompared`] if an input lies on
/// a kink, so that nothing was learnt about it.
///
/// # Panics
/// If `f` fails on the shapes, or the number of directions is 0.
///
/// ```
/// use bijective_sdf::autodiff::check;
/// use bijective_sdf::tensor::Tensor;
///
/// let x = Tensor::from_vec(&[2, 2], vec![0.1, -0.4, 0.9, 0.3]);
/// let compared = check::gradient(|tape, x| tape.tanh(x[0]), &[x], check::CheckOptions::default()).unwrap();
/// assert_eq!(compared, 6);
/// ```
pub fn gradient(
    f: impl Fn(&mut Tape, &[Var]) -> Var,
    inputs: &[Tensor],
    options: CheckOptions,
) -> Result<usize, Failure> {
    assert!(options.directions > 0, "check: no directions to compare in");
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    let mut tape = Tape::new();
    let vars: Vec<Var> = inputs.iter().map(|x| tape.input(x.clone())).collect();
    let y = f(&mut tape, &vars);
    let weights = normal(&mut rng, tape.value(y).dims());
    let gradients = tape.pull([(y, weights.clone())]);
    let scale = product_length(tape.value(y), &weights);
    let base = weighted_sum(tape.value(y), &weights);

    let evaluate = |input: usize, direction: &Tensor, step: f64| {
        let mut tape = Tape::new();
        let mut vars = Vec::with_capacity(inputs.len());
        for (i, x) in inputs.iter().enumerate() {
            let mut x = x.clone();
            if i == input {
                for (v, d) in x.data_mut().iter_mut().zip(direction.data()) {
                    *v = (f64::from(*v) + step * f64::from(*d)) as f32;
                }
            }
            vars.push(tape.constant(x));
        }
        let y = f(&mut tape, &vars);
        weighted_sum(tape.value(y), &weights)
    };

    let mut fewest = options.directions;
    for (i, x) in inputs.iter().enumerate() {
        if x.is_empty() {
            continue;
        }
        let mut accepted = 0;
        let magnitude = scale + gradients.get(vars[i]).map_or(0.0, |g| product_length(g, x));
        for _ in 0..8 * options.directions {
            if accepted == options.directions {
                break;
            }
            let direction = normal(&mut rng, x.dims());
            let analytic = gradients.get(vars[i]).map_or(0.0, |g| weighted_sum(g, &direction));
            let step = f64::from(options.step) / (x.len() as f64).sqrt().max(1.0).sqrt();
            let verdict = |step: f64| {
                let along = |h: f64| evaluate(i, &direction, h);
                compare(&along, base, analytic, step, magnitude, options.tolerance)
            };
            // Several kinks at once can look like a smooth function at one step, but not at a much smaller one too.
            match verdict(step) {
                Verdict::Agrees => accepted += 1,
                Verdict::Kink => accepted += usize::from(matches!(verdict(step / 8.0), Verdict::Agrees)),
                Verdict::Differs(numeric) => match verdict(step / 8.0) {
                    Verdict::Differs(_) => return Err(Failure::Mismatch { input: i, analytic, numeric }),
                    Verdict::Agrees | Verdict::Kink => {}
                },
            }
        }
        if accepted == 0 {
            return Err(Failure::NotCompared { input: i });
        }
        fewest = fewest.min(accepted);
    }
    Ok(fewest)
}

enum Verdict {
    Agrees,
    Differs(f64),
    Kink,
}

/// Compares a directional derivative with central differences of `along` (whose value at 0 is `base`).
fn compare(
    along: &dyn Fn(f64) -> f64,
    base: f64,
    analytic: f64,
    step: f64,
    magnitude: f64,
    tolerance: f64,
) -> Verdict {
    // The central difference, and by how much the forward difference exceeds the backward one.
    let difference = |h: f64| {
        let (above, below) = (along(h), along(-h));
        ((above - below) / (2.0 * h), (above - 2.0 * base + below) / h)
    };
    let ((numeric, bend), (half, half_bend)) = (difference(step), difference(step / 2.0));
    let rounding = 4.0 * f64::from(f32::EPSILON) * magnitude / step;
    // One kink between 0 and the step shifts the differences by at most four times the larger of these two.
    let strict = tolerance / 5.0;
    let bend_off = (half_bend - bend / 2.0).abs();
    if !close(numeric, half, strict, rounding) || bend_off > strict * (1e-3 + half.abs()) + 4.0 * rounding {
        return Verdict::Kink;
    }
    let refined = half + (half - numeric) / 3.0;
    let agrees = [numeric, half, refined].iter().any(|&n| close(analytic, n, tolerance, rounding));
    if agrees { Verdict::Agrees } else { Verdict::Differs(half) }
}

fn close(a: f64, b: f64, tolerance: f64, rounding: f64) -> bool {
    (a - b).abs() <= tolerance * (1e-3 + a.abs().max(b.abs())) + rounding
}

/// The length of the elementwise product of two tensors.
fn product_length(a: &Tensor, b: &Tensor) -> f64 {
    let square = |(a, b): (&f32, &f32)| (f64::from(*a) * f64::from(*b)).powi(2);
    a.data().iter().zip(b.data()).map(square).sum::<f64>().sqrt()
}

fn weighted_sum(x: &Tensor, weights: &Tensor) -> f64 {
    x.data().iter().zip(weights.data()).map(|(x, w)| f64::from(*x) * f64::from(*w)).sum()
}

fn normal(rng: &mut ChaCha8Rng, dims: &[usize]) -> Tensor {
    let mut t = Tensor::zeros(dims);
    t.data_mut().iter_mut().for_each(|v| *v = StandardNormal.sample(rng));
    t
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autodiff::{At, Op};

    /// x y by entries, with gradients that can be made wrong.
    #[derive(Clone, Copy)]
    struct Product {
        /// What the gradient of each input is multiplied by: 1 is right.
        factors: [f32; 2],
        /// The entry that is multiplied alone; all of them without.
        entry: Option<usize>,
        /// Whether the second input gets no gradient at all.
        missing: bool,
    }

    const RIGHT: Product = Product { factors: [1.0; 2], entry: None, missing: false };

    impl Op<2> for Product {
        type Saved = ();
        fn forward(&self, [x, y]: [&Tensor; 2]) -> (Tensor, ()) {
            let mut z = x.clone();
            z.data_mut().iter_mut().zip(y.data()).for_each(|(z, y)| *z *= y);
            (z, ())
        }
        fn vjp(&self, at: At<'_, 2, ()>, dz: &Tensor) -> [Option<Tensor>; 2] {
            std::array::from_fn(|i| {
                let mut d = dz.clone();
                for (k, (d, other)) in d.data_mut().iter_mut().zip(at.x[1 - i].data()).enumerate() {
                    let wrong = self.entry.is_none_or(|entry| entry == k);
                    *d *= other * if wrong { self.factors[i] } else { 1.0 };
                }
                (i == 0 || !self.missing).then_some(d)
            })
        }
    }

    fn run(op: Product) -> Result<usize, Failure> {
        let x = Tensor::from_vec(&[3, 2], vec![0.5, -1.0, 2.0, 0.1, -0.3, 0.7]);
        let y = Tensor::from_vec(&[3, 2], vec![1.5, 0.4, -0.8, -2.0, 0.9, 0.6]);
        gradient(|tape, x| tape.apply(op, [x[0], x[1]]), &[x, y], CheckOptions::default())
    }

    /// The input that a gradient was found to be wrong for.
    #[track_caller]
    fn wrong_input(op: Product) -> usize {
        match run(op).unwrap_err() {
            Failure::Mismatch { input, .. } => input,
            other => panic!("{other}"),
        }
    }

    #[test]
    fn accepts_the_right_gradient_and_rejects_scaled_ones() {
        assert_eq!(run(RIGHT), Ok(6));
        for factor in [0.0, 0.98, 1.02, -1.0, 2.0] {
            assert_eq!(wrong_input(Product { factors: [factor, 1.0], ..RIGHT }), 0, "factor {factor}");
            assert_eq!(wrong_input(Product { factors: [1.0, factor], ..RIGHT }), 1, "factor {factor}");
        }
    }

    #[test]
    fn rejects_one_wrong_entry() {
        for entry in 0..6 {
            let op = Product { factors: [1.2, 1.0], entry: Some(entry), ..RIGHT };
            assert_eq!(wrong_input(op), 0, "entry {entry}");
        }
    }

    #[test]
    #[should_panic(expected = "no gradient for input 1")]
    fn rejects_an_operation_without_a_gradient() {
        let _ = run(Product { missing: true, ..RIGHT });
    }

    #[test]
    fn rejects_an_input_that_the_tape_does_not_lead_to() {
        let x = Tensor::from_vec(&[1, 2], vec![0.5, -1.0]);
        let detached = |tape: &mut Tape, x: &[Var]| {
            let copy = tape.value(x[1]).clone();
            let copy = tape.constant(copy);
            tape.apply(RIGHT, [x[0], copy])
        };
        let failure = gradient(detached, &[x.clone(), x], CheckOptions::default()).unwrap_err();
        assert!(matches!(failure, Failure::Mismatch { input: 1, analytic: 0.0, .. }), "{failure}");
    }

    /// The sizes of all entries, with a gradient scaled by a factor.
    struct Abs {
        factor: f32,
    }

    impl Op<1> for Abs {
        type Saved = ();
        fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
            let mut y = x.clone();
            y.data_mut().iter_mut().for_each(|v| *v = v.abs());
            (y, ())
        }
        fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
            let mut dx = dy.clone();
            let signed = |(d, x): (&mut f32, &f32)| *d *= self.factor * x.signum();
            dx.data_mut().iter_mut().zip(at.x[0].data()).for_each(signed);
            [Some(dx)]
        }
    }

    #[test]
    fn kinks_are_passed_over_and_hide_no_wrong_gradient() {
        let run = |factor: f32, x: Vec<f32>| {
            let x = Tensor::from_vec(&[1, x.len()], x);
            gradient(|tape, x| tape.apply(Abs { factor }, [x[0]]), &[x], CheckOptions::default())
        };
        // Some directions cross the kink of the first entry, others do not.
        let near = vec![1e-3, 1.0, -2.0];
        assert!((1..=6).contains(&run(1.0, near.clone()).unwrap()));
        assert!(matches!(run(1.1, near), Err(Failure::Mismatch { input: 0, .. })));
        // All directions cross the one at 0, whatever the gradient there.
        for factor in [1.0, 5.0] {
            assert_eq!(run(factor, vec![0.0, 1.0]), Err(Failure::NotCompared { input: 0 }));
        }
    }
}
