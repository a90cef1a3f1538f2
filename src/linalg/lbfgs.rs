//! L-BFGS: the minimum of a smooth function of many numbers, without second derivatives.

use std::collections::VecDeque;

/// When [`lbfgs`] stops, and what it remembers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LbfgsOptions {
    /// Pairs of steps and gradient differences that stand for the second derivatives.
    pub memory: usize,
    /// Iterations at most.
    pub iterations: usize,
    /// An iteration that lowers the value by less than this share of it is the last.
    pub tolerance: f64,
}

impl Default for LbfgsOptions {
    fn default() -> Self {
        LbfgsOptions { memory: 10, iterations: 200, tolerance: 1e-5 }
    }
}

/// Where [`lbfgs`] ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LbfgsReport {
    /// The lowest value found, that of the returned point.
    pub value: f64,
    /// Iterations made.
    pub iterations: usize,
}

/// Share of the decrease that the slope promises which a step must bring.
const SUFFICIENT: f64 = 1e-4;
/// Halvings of a step before the search ends.
const HALVINGS: usize = 30;

/// Moves `x` downhill: `f` writes the gradient at its first argument to its second and returns the value.
///
/// Directions come from the two-loop recursion (Nocedal and Wright 2006, algorithm 7.4), steps from halving until the
/// value falls enough; a pair that shows no positive curvature is not remembered. The value never rises. Ends early
/// where no step lowers it, as at a minimum or where the value is not finite.
pub fn lbfgs(
    x: &mut [f64],
    mut f: impl FnMut(&[f64], &mut [f64]) -> f64,
    options: &LbfgsOptions,
) -> LbfgsReport {
    let n = x.len();
    let (mut gradient, mut next, mut next_gradient) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut pairs: VecDeque<Pair> = VecDeque::with_capacity(options.memory);
    let mut value = f(x, &mut gradient);
    let mut report = LbfgsReport { value, iterations: 0 };
    while report.iterations < options.iterations {
        let mut direction = direction(&gradient, &pairs);
        let mut slope = dot(&gradient, &direction);
        if slope >= 0.0 {
            // The pairs mislead; start again along the gradient.
            pairs.clear();
            direction = gradient.iter().map(|g| -g).collect();
            slope = dot(&gradient, &direction);
        }
        if !(slope < 0.0 && slope.is_finite()) {
            break;
        }
        // Without a notion of scale, the first step is one unit long.
        let mut step = if pairs.is_empty() { 1.0 / (-slope).sqrt().max(1e-300) } else { 1.0 };
        let mut lowered = None;
        for _ in 0..HALVINGS {
            for ((next, x), d) in next.iter_mut().zip(&*x).zip(&direction) {
                *next = x + step * d;
            }
            let there = f(&next, &mut next_gradient);
            if there <= value + SUFFICIENT * step * slope {
                lowered = Some(there);
                break;
            }
            step *= 0.5;
        }
        let Some(there) = lowered else { break };
        let s: Vec<f64> = next.iter().zip(&*x).map(|(a, b)| a - b).collect();
        let y: Vec<f64> = next_gradient.iter().zip(&gradient).map(|(a, b)| a - b).collect();
        let sy = dot(&s, &y);
        if sy > 1e-12 * dot(&y, &y) && options.memory > 0 {
            if pairs.len() == options.memory {
                pairs.pop_front();
            }
            pairs.push_back(Pair { s, y, sy });
        }
        x.copy_from_slice(&next);
        std::mem::swap(&mut gradient, &mut next_gradient);
        let fall = value - there;
        value = there;
        report = LbfgsReport { value, iterations: report.iterations + 1 };
        if fall <= options.tolerance * value.abs() {
            break;
        }
    }
    report
}

/// A step, what it changed the gradient by, and their product.
struct Pair {
    s: Vec<f64>,
    y: Vec<f64>,
    sy: f64,
}

/// Minus the gradient times the inverse of the second derivatives, as far as the pairs know them.
fn direction(gradient: &[f64], pairs: &VecDeque<Pair>) -> Vec<f64> {
    let mut d: Vec<f64> = gradient.iter().map(|g| -g).collect();
    let mut shares = Vec::with_capacity(pairs.len());
    for p in pairs.iter().rev() {
        let share = dot(&p.s, &d) / p.sy;
        add(&mut d, -share, &p.y);
        shares.push(share);
    }
    if let Some(p) = pairs.back() {
        let scale = p.sy / dot(&p.y, &p.y);
        d.iter_mut().for_each(|d| *d *= scale);
    }
    for (p, share) in pairs.iter().zip(shares.iter().rev()) {
        let back = dot(&p.y, &d) / p.sy;
        add(&mut d, share - back, &p.s);
    }
    d
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn add(a: &mut [f64], by: f64, b: &[f64]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += by * b);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn exact() -> LbfgsOptions {
        LbfgsOptions { tolerance: 1e-15, ..LbfgsOptions::default() }
    }

    #[test]
    fn finds_the_bottom_of_the_banana_valley() {
        let mut x = vec![-1.2, 1.0];
        let rosenbrock = |x: &[f64], g: &mut [f64]| {
            let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
            g[0] = -2.0 * a - 400.0 * x[0] * b;
            g[1] = 200.0 * b;
            a * a + 100.0 * b * b
        };
        let report = lbfgs(&mut x, rosenbrock, &exact());
        assert!((x[0] - 1.0).abs() < 1e-6 && (x[1] - 1.0).abs() < 1e-6, "{x:?} after {report:?}");
        // Along the gradient alone this takes thousands.
        assert!(report.iterations < 80, "{report:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn solves_quadratics(scales in prop::collection::vec(0.01f64..100.0, 1..12), start in -10.0f64..10.0) {
            let mut x = vec![start; scales.len()];
            let quadratic = |x: &[f64], g: &mut [f64]| {
                let mut sum = 0.0;
                for (i, (x, s)) in x.iter().zip(&scales).enumerate() {
                    g[i] = s * (x - i as f64);
                    sum += 0.5 * s * (x - i as f64).powi(2);
                }
                sum
            };
            let report = lbfgs(&mut x, quadratic, &LbfgsOptions { iterations: 1000, ..exact() });
            prop_assert!(report.value < 1e-10, "{report:?}");
            for (i, x) in x.iter().enumerate() {
                prop_assert!((x - i as f64).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn the_value_never_rises_and_a_bad_function_ends_the_search() {
        let mut x = vec![3.0];
        // The gradient has the wrong sign: no step lowers the value.
        let report = lbfgs(
            &mut x,
            |x, g| {
                g[0] = -2.0 * x[0];
                x[0] * x[0]
            },
            &exact(),
        );
        assert_eq!((x[0], report.value, report.iterations), (3.0, 9.0, 0));
        let report = lbfgs(
            &mut x,
            |_, g| {
                g[0] = f64::NAN;
                f64::NAN
            },
            &exact(),
        );
        assert_eq!((x[0], report.iterations), (3.0, 0));
        let mut none: Vec<f64> = Vec::new();
        assert_eq!(lbfgs(&mut none, |_, _| 1.0, &exact()).iterations, 0);
    }
}
