//! From working points to denoised points: noisy points are moved onto a smooth surface near them, in five steps:
//!
//! 1. *Forecast*: a thin plate through all other points predicts each point, without smoothing and with several
//!    smoothings ([`forecasts`]).
//! 2. *Compare*: the smoothings are compared by how probable they make the points ([`log_densities`]).
//! 3. *Choose*: the least smooth one that is about as good as the best, if it is better than none ([`choose`]) and
//!    stands for enough noise ([`noise`]).
//! 4. *Settle*: the choice is made again with its own normals, until it stays ([`settled`]).
//! 5. *Move*: the points go onto that plate ([`on_surface`]), or a less smooth one, by no more than their noise
//!    ([`within`]).
//!
//! The surface is a smoothing thin plate: the one of least bending that may miss the points (see
//! [`ThinPlate`](super::ThinPlate)). How far it may is chosen by how probable each point is, given all others: as a
//! Gaussian process a thin plate gives not only the expected place of a point, but also the variance of that. Exact
//! points that lie close together are predicted well; noise shows in them first.

use super::forecast::{Forecast, covariances, forecasts};
use super::plate::{MAX_CENTRES, System, directions};
use crate::geometry::median;
use nalgebra::Matrix4;
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// The numbers of points for which [`denoise`] looks for noise: fewer allow no estimate, for more it is too slow.
pub const DENOISED_POINTS: RangeInclusive<usize> = 50..=MAX_CENTRES;
/// Smoothing parameters tried, from one that follows the points to one that leaves detail out; on top of the 1e-6 that
/// every thin plate has, so that points close together leave it solvable.
const SMOOTHINGS: [f64; 7] = [1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3];
/// Which of them (1e-3, 1e-4, 1e-5) give the normals that all are compared with at first, tried in turn until noise is
/// found. Normals from a plate that follows noisy points already hold the noise, so that it seems well predicted;
/// normals from one that is too smooth are wrong on thin parts. Hence from smooth to close.
const REFERENCES: [usize; 3] = [6, 4, 2];
/// Standard errors by which the best smoothing must predict better than none. Not a level of significance, as the best
/// of several is taken; how often exact points pass it is in `benches/method.md`.
const MIN_STANDARD_ERRORS: f64 = 3.0;
/// Noise, as estimated (standard deviation, working frame), that is worth taking off; less may be detail. Estimates are
/// rather low, for the normals take some of it.
const MIN_NOISE: f64 = 3e-3;
/// The least slope that is believed, so that no place has the density 0. Not tuned.
const MIN_SLOPE: f64 = 0.05;
/// How often normals are found anew for the plate that was chosen with the last ones.
const MAX_ROUNDS: usize = 4;
/// The median of the square of a standard normal number.
const MEDIAN_SQUARE: f64 = 0.4549;

/// The denoised points.
#[derive(Clone, Debug, PartialEq)]
pub struct Denoised {
    /// The points, n x 3, working frame, in the order of the working points.
    pub points: Vec<[f32; 3]>,
    /// The root mean square of the distances from the working points to them, working frame.
    pub moved: f64,
}

/// The working points (n x 3, working frame) without their noise, given rough outward normals (n x 3).
///
/// Each point is predicted from all others by a thin plate through them and by smoothing ones with parameters from 1e-6
/// to 1e-3, all with the normals of the one with 1e-3; where that finds no noise, of 1e-4, then of 1e-5. They are
/// compared by the mean logarithm of the points' predictive densities (leave-one-out cross-validation of a Gaussian
/// process: Rasmussen and Williams 2006, "Gaussian Processes for Machine Learning", section 5.4.2), with the amplitude
/// that makes the points most probable. These are densities of the place where the surface crosses the normal, to first
/// order the density of f there times |grad f| as predicted, not densities of f: the plate through noisy points has
/// folds between which f is flat, so a small |f| does not mean a short distance.
///
/// If the best mean is above that without smoothing by three standard errors of the difference, the least smooth plate
/// whose mean is within one standard error of the best is chosen, provided that the noise it stands for is at least
/// 0.003: the root of its parameter times the most probable amplitude. With its own normals it is chosen
/// again, until it stays the same, up to four times, or no noise is found with them; then the last choice stands. The
/// points move onto that plate; if that would be by more than the noise (root of the mean square), onto the smoothest
/// one to which they move by less. In all other cases, and for numbers of points not in [`DENOISED_POINTS`], the
/// result is `None`: the denoised points are then the working points.
///
/// # Panics
/// If there is not one normal a point.
#[track_caller]
pub fn denoise(points: &[[f32; 3]], normals: &[[f32; 3]]) -> Option<Denoised> {
    let (n, m) = (points.len(), normals.len());
    assert!(n == m, "denoise: {n} points, {m} normals");
    if DENOISED_POINTS.contains(&n) { smoothed(points, normals) } else { None }
}

/// The points moved onto the chosen surface; `None` if no smoothing is chosen, the estimated noise is below
/// [`MIN_NOISE`], or a system cannot be solved.
fn smoothed(points: &[[f32; 3]], normals: &[[f32; 3]]) -> Option<Denoised> {
    let centres: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
    let through = System::new(&centres)?;
    let systems: Vec<Option<System>> = SMOOTHINGS.par_iter().map(|&s| through.smoothed(s)).collect();
    let systems: Vec<System> = systems.into_iter().collect::<Option<_>>()?;
    let all: Vec<(&System, Vec<Matrix4<f64>>)> =
        std::iter::once(&through).chain(&systems).map(|system| (system, covariances(system))).collect();
    let rough = through.least_bending(directions(normals));
    let choice = |gradients: Vec<f64>| {
        let rows: Vec<Vec<Forecast>> =
            all.iter().map(|(system, covariances)| forecasts(system, covariances, &gradients)).collect();
        let row = choose(&rows)?;
        let noise = noise(SMOOTHINGS[row - 1], &rows[row]);
        (noise >= MIN_NOISE).then_some(Choice { smoothing: row - 1, noise, gradients })
    };
    let first = REFERENCES.iter().find_map(|&r| choice(systems[r].least_bending(rough.clone())))?;
    let again = |last: &Choice| choice(systems[last.smoothing].least_bending(last.gradients.clone()));
    let Choice { smoothing, noise, gradients } = settled(first, again);
    let moved = |system| on_surface(system, points, &centres, gradients.clone());
    within(systems[..=smoothing].iter().rev().map(moved), noise)
}

/// A smoothing that noise was found with.
struct Choice {
    /// Its place in [`SMOOTHINGS`].
    smoothing: usize,
    /// The noise that it stands for (standard deviation, working frame).
    noise: f64,
    /// The gradients at the points (3 n, unit) that it was chosen with.
    gradients: Vec<f64>,
}

/// Repeats the choice with the gradients of the last one until the smoothing stays the same, at most [`MAX_ROUNDS`]
/// times; ends before a choice that finds no noise.
fn settled(mut last: Choice, again: impl Fn(&Choice) -> Option<Choice>) -> Choice {
    for _ in 0..MAX_ROUNDS {
        let Some(next) = again(&last) else { break };
        let same = next.smoothing == last.smoothing;
        last = next;
        if same {
            break;
        }
    }
    last
}

/// The first of several, from the smoothest on, that moves the points (root of the mean square) by no more than their
/// noise (standard deviation): by more only where a surface leaves detail out (Morozov's discrepancy principle).
fn within(mut candidates: impl Iterator<Item = Denoised>, noise: f64) -> Option<Denoised> {
    candidates.find(|denoised| denoised.moved <= noise)
}

/// The points moved onto the surface of a plate, whose gradients are found near the given ones (3 n, unit).
fn on_surface(system: &System, points: &[[f32; 3]], centres: &[[f64; 3]], gradients: Vec<f64>) -> Denoised {
    let gradients = system.least_bending(gradients);
    let values = system.interpolant(centres, &gradients).value(points);
    // Unit gradients: f is how far a point is from the surface, to first order.
    let moved = points.iter().zip(&values).zip(gradients.as_chunks::<3>().0);
    let moved = moved.map(|((p, &f), g)| std::array::from_fn(|k| p[k] - f * g[k] as f32)).collect();
    let square = values.iter().map(|&f| f64::from(f).powi(2)).sum::<f64>();
    Denoised { points: moved, moved: (square / values.len() as f64).sqrt() }
}

/// The standard deviation of the noise that a smoothing parameter stands for: a value of variance `smoothing` for a
/// plate of unit amplitude, times the amplitude estimated from its forecasts: from the median of their squared errors,
/// because points at edges are predicted badly even without noise.
fn noise(smoothing: f64, forecasts: &[Forecast]) -> f64 {
    let squares: Vec<f64> = forecasts.iter().map(|f| f.error.powi(2) / f.variance).collect();
    let amplitude = median(squares) / MEDIAN_SQUARE;
    (smoothing * amplitude).sqrt()
}

/// The logarithm of each point's predictive density along the surface's normal (without a constant), with the amplitude
/// that makes all most probable: the density of f, times the slope of f.
fn log_densities(forecasts: &[Forecast]) -> Vec<f64> {
    let square = |f: &Forecast| f.error.powi(2) / f.variance;
    let amplitude = forecasts.iter().map(square).sum::<f64>() / forecasts.len() as f64;
    let value = |f: &Forecast| -0.5 * ((amplitude * f.variance).ln() + square(f) / amplitude);
    forecasts.iter().map(|f| value(f) + f.slope.max(MIN_SLOPE).ln()).collect()
}

/// Which row of forecasts (rows by smoothing, the first without, columns by point) to take, if not the first: the least
/// smooth one that is about as good as the best. Rows that are not finite are left out.
fn choose(forecasts: &[Vec<Forecast>]) -> Option<usize> {
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let rows: Vec<Vec<f64>> = forecasts.iter().map(|row| log_densities(row)).collect();
    // The mean over the points by which one row is above another, and its standard error.
    let difference = |a: &[f64], b: &[f64]| {
        let each: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
        let gain = mean(&each);
        let variance = each.iter().map(|g| (g - gain).powi(2)).sum::<f64>() / each.len() as f64;
        (gain, (variance / each.len() as f64).sqrt())
    };
    let finite = (1..rows.len()).filter(|&k| mean(&rows[k]).is_finite());
    let best = finite.max_by(|&a, &b| mean(&rows[a]).total_cmp(&mean(&rows[b])))?;
    let (gain, error) = difference(&rows[best], &rows[0]);
    // Written so that figures that are not finite choose none.
    if gain > MIN_STANDARD_ERRORS * error {
        (1..=best).find(|&k| {
            let (gain, error) = difference(&rows[best], &rows[k]);
            gain <= error
        })
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::gauss_shapes;
    use super::*;
    use crate::geometry::{AnalyticShape, TriangleBvh};
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn noisy(points: &[[f32; 3]], sigma: f32, seed: u64) -> Vec<[f32; 3]> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut shift = || {
            let z: f32 = StandardNormal.sample(&mut rng);
            sigma * z
        };
        points.iter().map(|p| p.map(|x| x + shift())).collect()
    }

    fn off(shape: AnalyticShape, points: &[[f32; 3]]) -> f64 {
        let square = points.iter().map(|&p| f64::from(shape.sdf(p)).powi(2));
        (square.sum::<f64>() / points.len() as f64).sqrt()
    }

    const TORUS: AnalyticShape = AnalyticShape::Torus { major: 0.34, minor: 0.14 };

    #[test]
    fn exact_points_are_left_alone() {
        // Smooth shapes, and one with sharp edges.
        for shape in [
            TORUS,
            AnalyticShape::Sphere { radius: 0.5 },
            AnalyticShape::RoundedBox { half: [0.5, 0.3, 0.2], round: 0.01 },
        ] {
            let (points, normals) = shape.sample(200, 3);
            assert!(denoise(&points, &normals).is_none());
        }
    }

    #[test]
    fn noisy_points_come_closer_to_the_surface_and_say_by_how_much() {
        for (shape, sigma) in [(TORUS, 0.01), (AnalyticShape::Sphere { radius: 0.5 }, 0.02)] {
            let (exact, normals) = shape.sample(160, 3);
            let points = noisy(&exact, sigma, 7);
            let clean = denoise(&points, &normals).unwrap();
            let (before, after) = (off(shape, &points), off(shape, &clean.points));
            assert!(after < 0.75 * before, "{before} to {after}");
            let square =
                |(p, q): (&[f32; 3], &[f32; 3])| (0..3).map(|k| f64::from(p[k] - q[k]).powi(2)).sum::<f64>();
            let moved = points.iter().zip(&clean.points).map(square).sum::<f64>() / points.len() as f64;
            assert!((moved.sqrt() - clean.moved).abs() < 1e-4, "{} is not {}", clean.moved, moved.sqrt());
        }
    }

    /// The plate through points with much noise is in folds, and f flat between them: points are near in f, but not in
    /// space.
    #[test]
    fn much_noise_is_found_with_normals_of_a_rough_surface() {
        let (slab, bar) = (
            AnalyticShape::RoundedBox { half: [0.5, 0.4, 0.1], round: 0.05 },
            AnalyticShape::RoundedBox { half: [0.5, 0.12, 0.1], round: 0.05 },
        );
        // The bar needs smooth normals to begin with.
        for (shape, sigma, seed) in [(TORUS, 0.02, 7), (slab, 0.02, 7), (bar, 0.015, 8)] {
            let points = noisy(&shape.sample(300, 3).0, sigma, seed);
            let rough = gauss_shapes(&points, None, &[0.25], 0.05, 0).unwrap();
            let normals = TriangleBvh::new(&rough[0]).unwrap().normals_near(&points);
            let (before, after) =
                (off(shape, &points), off(shape, &denoise(&points, &normals).unwrap().points));
            assert!(after < 0.75 * before, "{before} to {after}");
        }
    }

    #[test]
    fn few_and_many_points_are_left_alone() {
        for n in [1, DENOISED_POINTS.start() - 1, DENOISED_POINTS.end() + 1] {
            let (points, normals) = TORUS.sample(n, 1);
            let points = noisy(&points, 0.03, 2);
            assert!(denoise(&points, &normals).is_none());
        }
        // Nor is there an error where the points determine no surface.
        let flat = vec![[0.25, 0.25, 0.25]; 60];
        assert!(denoise(&flat, &vec![[0.0, 0.0, 1.0]; 60]).is_none());
    }

    /// Forecasts of 39 points, no two alike; slopes from `least` on.
    fn uneven(least: f64) -> Vec<Forecast> {
        let one = |i: u32| Forecast {
            error: 0.1 * f64::from(i % 7),
            variance: 0.2 + f64::from(i % 5),
            slope: least + 0.3 * f64::from(i % 4),
        };
        (1..40).map(one).collect()
    }

    #[test]
    fn probabilities_are_normal_and_the_best_amplitude_is_taken() {
        let row = uneven(0.0);
        let log_density = |f: &Forecast, amplitude: f64| {
            let variance = amplitude * f.variance;
            -0.5 * (variance.ln() + f.error.powi(2) / variance) + f.slope.max(MIN_SLOPE).ln()
        };
        let best = row.iter().map(|f| f.error.powi(2) / f.variance).sum::<f64>() / 39.0;
        for (f, got) in row.iter().zip(log_densities(&row)) {
            assert!((got - log_density(f, best)).abs() < 1e-12);
        }
        let sum = |amplitude: f64| row.iter().map(|f| log_density(f, amplitude)).sum::<f64>();
        assert!(sum(best) > sum(0.98 * best) && sum(best) > sum(1.02 * best));
    }

    /// Twice f is the same surface.
    #[test]
    fn densities_of_places_do_not_depend_on_the_scale_of_f() {
        let row = uneven(0.1);
        let scaled: Vec<Forecast> =
            row.iter().map(|f| Forecast { error: 2.0 * f.error, slope: 2.0 * f.slope, ..*f }).collect();
        for (a, b) in log_densities(&row).iter().zip(log_densities(&scaled)) {
            assert!((a - b).abs() < 1e-12, "{a} is not {b}");
        }
    }

    #[test]
    fn choices_follow_each_other_until_one_stays() {
        // Where a choice leads, by smoothing; `None` finds no noise.
        for (next, first, want) in [
            ([Some(1), Some(2), Some(2), None], 0, (2, 2.5)),
            ([Some(0), None, None, None], 0, (0, 0.5)),
            ([Some(1), None, None, None], 0, (1, 0.5)),
            ([None; 4], 3, (3, 9.0)),
            // A cycle ends where the fourth round is.
            ([Some(1), Some(2), Some(0), None], 0, (1, 0.5)),
        ] {
            let choice = |smoothing, noise| Choice { smoothing, noise, gradients: Vec::new() };
            let again = |last: &Choice| next[last.smoothing].map(|s| choice(s, last.smoothing as f64 + 0.5));
            let end = settled(choice(first, 9.0), again);
            assert_eq!((end.smoothing, end.noise), want, "{next:?}");
        }
    }

    #[test]
    fn the_noise_is_that_of_most_points() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        // A plate of amplitude 0.04, and a tenth of it for the smoothing.
        let mut row: Vec<Forecast> = (0..4000)
            .map(|i| {
                let (z, variance): (f64, f64) = (StandardNormal.sample(&mut rng), 1.0 + f64::from(i % 3));
                Forecast { error: (z * (0.04 * variance).sqrt()).abs(), variance, slope: 1.0 }
            })
            .collect();
        let want = (0.1f64 * 0.04).sqrt();
        assert!((noise(0.1, &row) / want - 1.0).abs() < 0.05, "{}", noise(0.1, &row));
        // Some beyond an edge are far off.
        row[..200].iter_mut().for_each(|f| f.error = 10.0);
        assert!((noise(0.1, &row) / want - 1.0).abs() < 0.1, "{}", noise(0.1, &row));
    }

    #[test]
    fn less_noise_than_detail_may_be_is_left() {
        let (exact, normals) = TORUS.sample(160, 3);
        for (sigma, taken) in [(0.0008, false), (0.0025, false), (0.006, true)] {
            let points = noisy(&exact, sigma, 7);
            assert_eq!(denoise(&points, &normals).is_some(), taken, "{sigma}");
        }
    }

    #[test]
    fn the_choice_is_the_least_smoothing_about_as_good_as_the_best() {
        let row = |forecasts: [(f64, f64); 4]| {
            forecasts.map(|(error, variance)| Forecast { error, variance, slope: 1.0 }).repeat(20)
        };
        let plain = |errors: [f64; 4]| row(errors.map(|e| (e, 1.0)));
        let without = plain([1.0, 2.0, 1.5, 0.5]);
        let worse = plain([1.1, 2.1, 1.6, 0.6]);
        let better = plain([0.8, 1.9, 1.2, 0.4]);
        let best = plain([0.5, 1.0, 0.75, 0.25]);
        // Below the best by a fifth of a standard error, and by two.
        let hardly = plain([0.52, 0.983, 0.76, 0.25]);
        let clearly = plain([0.52, 0.99, 0.76, 0.25]);
        // As far off, but known beforehand.
        let aware = row([(1.0, 1.0), (2.0, 4.0), (1.5, 2.2), (0.5, 0.3)]);
        // Two points far better, two far worse: above the first by 1.2 standard errors, and by 2.5.
        let unsure = plain([1.5, 0.1, 0.1, 1.9]);
        let nearly = plain([1.5, 0.1, 0.1, 1.55]);
        let nan = plain([f64::NAN; 4]);
        let none = plain([0.0; 4]);
        // As near in f, but where f is flat that is not near.
        let flat: Vec<Forecast> = best.iter().map(|f| Forecast { slope: 0.4, ..*f }).collect();
        let negative = row([(0.1, -1.0), (0.1, 1.0), (0.1, 1.0), (0.1, 1.0)]);
        for (rows, want) in [
            (vec![&without, &worse, &worse], None),
            (vec![&without, &worse, &unsure], None),
            (vec![&without, &worse, &nearly], None),
            (vec![&without, &worse, &better, &worse], Some(2)),
            (vec![&without, &better, &best], Some(2)),
            (vec![&without, &best, &better], Some(1)),
            (vec![&without, &hardly, &best], Some(1)),
            (vec![&without, &clearly, &best], Some(2)),
            (vec![&without, &worse, &hardly, &best], Some(2)),
            (vec![&without, &worse, &aware], Some(2)),
            (vec![&without, &worse, &flat], None),
            (vec![&flat, &better, &worse], Some(1)),
            (vec![&without, &nan, &best, &none, &negative], Some(2)),
            (vec![&nan, &nan, &nan], None),
            (vec![&none, &none, &none], None),
            (vec![&without, &negative], None),
        ] {
            let rows: Vec<Vec<Forecast>> = rows.into_iter().cloned().collect();
            assert_eq!(choose(&rows), want, "{rows:?}");
        }
    }

    #[test]
    fn points_do_not_move_by_more_than_their_noise() {
        let candidate = |moved: f64| Denoised { points: Vec::new(), moved };
        let taken = |moves: &[f64]| within(moves.iter().map(|&m| candidate(m)), 2.0).map(|d| d.moved);
        assert_eq!(taken(&[1.9, 1.0]), Some(1.9));
        assert_eq!(taken(&[9.0, 2.1, 1.5, 0.5]), Some(1.5));
        assert_eq!(taken(&[f64::NAN, 1.0]), Some(1.0));
        assert_eq!(taken(&[f64::NAN, 3.1]), None);
        // Less smooth plates are the way to smaller moves.
        let (exact, normals) = TORUS.sample(80, 3);
        let points = noisy(&exact, 0.02, 7);
        let centres: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
        let through = System::new(&centres).unwrap();
        let moves: Vec<f64> = [1e-2, 1e-3, 1e-4, 1e-5]
            .map(|smoothing| {
                let system = through.smoothed(smoothing).unwrap();
                on_surface(&system, &points, &centres, directions(&normals)).moved
            })
            .to_vec();
        assert!(moves.is_sorted_by(|a, b| a > b) && moves[3] > 0.0, "{moves:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 6, ..Default::default() })]
        #[test]
        fn threads_change_nothing_and_all_stays_finite(seed in 0u64..1000, sigma in 0.0f32..0.05) {
            let (points, normals) = TORUS.sample(60, seed);
            let points = noisy(&points, sigma, seed);
            let on = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| denoise(&points, &normals))
            };
            let (one, three) = (on(1), on(3));
            prop_assert_eq!(&one, &three);
            let finite = |d: &Denoised| d.moved.is_finite() && d.points.iter().flatten().all(|x| x.is_finite());
            prop_assert!(one.as_ref().is_none_or(finite));
        }
    }
}
