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
pub struct Options {
    /// Random directions per input.
    pub directions: usize,
    /// Step along a direction whose n entries have unit variance; divided by the fourth root of n.
    pub step: f32,
    /// Largest |analytic - numeric| / (1e-3 + max of both).
    pub tolerance: f64,
    /// Seed of directions and weights.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Options { directions: 6, step: 1e-2, tolerance: 5e-3, seed: 0 }
    }
}

/// A gradient that does not agree with finite differences.
#[derive(Clone, Debug, PartialEq)]
pub struct Mismatch {
    /// Which input.
    pub input: usize,
    /// The derivative that the tape gives along the direction.
    pub analytic: f64,
    /// The derivative by central differences.
    pub numeric: f64,
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Mismatch { input, analytic, numeric } = self;
        write!(f, "input {input}: the tape gives {analytic:.6}, differences give {numeric:.6}")
    }
}

impl std::error::Error for Mismatch {}

/// Compares the gradient of `f` at `inputs` with finite differences, for every input.
///
/// Returns the number of directions in which they were compared, of the input that had fewest: less than asked for
/// near kinks, and 0 if some input lies on one, so that nothing was learnt about it.
///
/// # Errors
/// The first direction in which they disagree.
///
/// # Panics
/// If `f` fails on the shapes.
///
/// ```
/// use bijective_sdf::autodiff::check;
/// use bijective_sdf::tensor::Tensor;
///
/// let x = Tensor::from_vec(&[2, 2], vec![0.1, -0.4, 0.9, 0.3]);
/// let compared = check::gradient(|tape, x| tape.tanh(x[0]), &[x], check::Options::default()).unwrap();
/// assert!(compared > 0);
/// ```
pub fn gradient(
    f: impl Fn(&mut Tape, &[Var]) -> Var,
    inputs: &[Tensor],
    options: Options,
) -> Result<usize, Mismatch> {
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
                    Verdict::Differs(_) => return Err(Mismatch { input: i, analytic, numeric }),
                    Verdict::Agrees | Verdict::Kink => {}
                },
            }
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

    /// x^2 with a gradient scaled by a factor that should be 1.
    struct Square {
        factor: f32,
    }

    impl Op<1> for Square {
        type Saved = ();
        fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
            let mut y = x.clone();
            y.data_mut().iter_mut().for_each(|v| *v *= *v);
            (y, ())
        }
        fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
            let mut dx = dy.clone();
            let scaled = |(d, x): (&mut f32, &f32)| *d *= 2.0 * self.factor * x;
            dx.data_mut().iter_mut().zip(at.x[0].data()).for_each(scaled);
            [Some(dx)]
        }
    }

    fn run(factor: f32) -> Result<usize, Mismatch> {
        let x = Tensor::from_vec(&[3, 2], vec![0.5, -1.0, 2.0, 0.1, -0.3, 0.7]);
        gradient(|tape, x| tape.apply(Square { factor }, [x[0]]), &[x], Options::default())
    }

    #[test]
    fn accepts_the_right_gradient_and_rejects_wrong_ones() {
        assert_eq!(run(1.0), Ok(6));
        for factor in [0.0, 0.98, 1.02, -1.0, 2.0] {
            assert!(run(factor).is_err(), "factor {factor}");
        }
        assert_eq!(run(0.0).unwrap_err().analytic, 0.0);
    }
}
