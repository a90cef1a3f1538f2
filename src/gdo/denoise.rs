//! Noisy points moved onto a smooth surface near them.
//!
//! The surface is a smoothing thin plate: the one of least bending that may miss the points (see
//! [`ThinPlate`](super::ThinPlate)). How far it may is chosen by how probable each point is, given all others: as a
//! Gaussian process a thin plate says not only where a point should be, but also how sure of that it is. Exact points
//! that lie close together are foreseen well; noise shows in them first.

use super::thin_plate::{MAX_CENTRES, System, directions};
use nalgebra::{DVector, Matrix4, Vector4};
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// The sizes of clouds that [`denoise`] looks at: smaller ones say too little, for larger ones it is too slow.
pub const DENOISED_POINTS: RangeInclusive<usize> = 50..=MAX_CENTRES;
/// Smoothing parameters tried, from one that follows the points to one that leaves detail out.
const SMOOTHINGS: [f64; 7] = [1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3];
/// Which of them give the normals that all are compared with, tried in turn until noise is found. Normals that follow
/// the points as closely as the surface make it foresee their noise, those of too smooth a surface know nothing of thin
/// parts: with the first, noise of 0.005 was found on 50 of 60 clouds, with the second on 41; but that of 0.02 only with
/// a later one.
const REFERENCES: [usize; 3] = [2, 4, 6];
/// Standard errors by which the best smoothing must foresee better than none. No level of significance, as the best of
/// several is taken: with it and [`NEGLIGIBLE`] none of 90 exact clouds of 30 shapes passed (furniture of thin boards
/// came to 2.9), with a scatter of 0.005 53 of 60 passed.
const SURE: f64 = 3.0;
/// Noise, as estimated (standard deviation), that is worth taking off; less may be detail. Estimates are low, for the
/// normals take some of it: 0.002 to 0.004 for 0.005.
const NEGLIGIBLE: f64 = 1.7e-3;
/// The median of the square of a standard normal number.
const MEDIAN_SQUARE: f64 = 0.4549;

/// A cloud without its noise, as far as some was found.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// The points, moved (n x 3, working frame).
    pub points: Vec<[f32; 3]>,
    /// The root of the mean square of the moves; 0 where the points were left alone.
    pub moved: f64,
}

/// The points (n x 3, working frame) without their noise, given rough outward normals (n x 3).
///
/// Each point is predicted from all others by a thin plate through them and by smoothing ones with parameters from 1e-6
/// to 1e-3, all with the normals of the one with 1e-5; where that finds no noise, of 1e-4, then of 1e-3. Smoothing is chosen by the mean logarithm of the predictive
/// probability, normal with the deviation that the plate gives (Rasmussen and Williams 2006, "Gaussian Processes for
/// Machine Learning", section 5.4.2); the scale of that is the one that makes the points most probable. Unless the best
/// mean is above that without smoothing by three standard errors of the difference, and the noise that it stands for
/// above 0.0017, the points are returned as they are. Otherwise they move onto the least smooth surface whose mean is
/// within one standard error of the best. Clouds whose size is not
/// in [`DENOISED_POINTS`] are returned as they are, too.
///
/// # Panics
/// If there is not one normal a point.
#[track_caller]
pub fn denoise(points: &[[f32; 3]], normals: &[[f32; 3]]) -> Denoised {
    let (n, m) = (points.len(), normals.len());
    assert!(n == m, "denoise: {n} points, {m} normals");
    let smoothed = if DENOISED_POINTS.contains(&n) { smoothed(points, normals) } else { None };
    smoothed.unwrap_or_else(|| Denoised { points: points.to_vec(), moved: 0.0 })
}

/// The points on the surface that foresees them best; `None` if that goes through them, or there is none.
fn smoothed(points: &[[f32; 3]], normals: &[[f32; 3]]) -> Option<Denoised> {
    let centres: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
    let through = System::new(&centres)?;
    let systems: Vec<Option<System>> = SMOOTHINGS.par_iter().map(|&s| through.smoothed(s)).collect();
    let systems: Vec<System> = systems.into_iter().collect::<Option<_>>()?;
    let rough = through.least_bending(directions(normals));
    let (chosen, gradients) = REFERENCES.iter().find_map(|&reference| {
        let gradients = systems[reference].least_bending(rough.clone());
        let forecasts: Vec<Vec<Forecast>> =
            std::iter::once(&through).chain(&systems).map(|system| forecasts(system, &gradients)).collect();
        let best = choose(&forecasts)?;
        let noise = (SMOOTHINGS[best - 1] * amplitude(&forecasts[best])).sqrt();
        (noise >= NEGLIGIBLE).then_some((best - 1, gradients))
    })?;
    let system = &systems[chosen];
    let gradients = system.least_bending(gradients);
    let values = system.interpolant(&centres, &gradients).sdf(points);
    // Unit gradients: f is how far a point is from the surface, to first order.
    let moved = points.iter().zip(&values).zip(gradients.as_chunks::<3>().0);
    let moved = moved.map(|((p, &f), g)| std::array::from_fn(|k| p[k] - f * g[k] as f32)).collect();
    let square = values.iter().map(|&f| f64::from(f).powi(2)).sum::<f64>();
    Some(Denoised { points: moved, moved: (square / values.len() as f64).sqrt() })
}

/// What all other points say of one.
#[derive(Clone, Copy, Debug)]
struct Forecast {
    /// How far it is from the surface that they determine.
    error: f64,
    /// The variance of that for a plate of unit amplitude.
    variance: f64,
}

/// What the others say of each of n points, with these gradients (3 n, unit).
///
/// With B the data's block of the system's inverse and d the data, leaving out the data I changes them by
/// (B_II)^-1 (B d)_I, and they have the covariance (B_II)^-1 given the rest, so no system is solved anew. I is the
/// value and the gradient of one point.
fn forecasts(system: &System, gradients: &[f64]) -> Vec<Forecast> {
    let n = gradients.len() / 3;
    let data = DVector::from_fn(4 * n, |i, _| if i < n { 0.0 } else { gradients[i - n] });
    let weights = system.energy() * data;
    let forecast = |i: usize| {
        let own = [i, n + 3 * i, n + 3 * i + 1, n + 3 * i + 2];
        let block = Matrix4::from_fn(|a, b| system.energy()[(own[a], own[b])]);
        let covariance = block.try_inverse().unwrap_or(Matrix4::from_element(f64::NAN));
        let change = covariance * Vector4::from_fn(|a, _| weights[own[a]]);
        Forecast { error: change[0].abs(), variance: covariance[(0, 0)] }
    };
    (0..n).map(forecast).collect()
}

/// The amplitude of the plate that forecasts speak for, from the median, as edges are no noise.
fn amplitude(forecasts: &[Forecast]) -> f64 {
    let mut squares: Vec<f64> = forecasts.iter().map(|f| f.error.powi(2) / f.variance).collect();
    let middle = squares.len() / 2;
    *squares.select_nth_unstable_by(middle, f64::total_cmp).1 / MEDIAN_SQUARE
}

/// The logarithm of each point's probability (without a constant), with the amplitude that makes all most probable.
fn log_probabilities(forecasts: &[Forecast]) -> Vec<f64> {
    let square = |f: &Forecast| f.error.powi(2) / f.variance;
    let amplitude = forecasts.iter().map(square).sum::<f64>() / forecasts.len() as f64;
    forecasts.iter().map(|f| -0.5 * ((amplitude * f.variance).ln() + square(f) / amplitude)).collect()
}

/// Which row of forecasts (rows by smoothing, the first without, columns by point) to take, if not the first.
fn choose(forecasts: &[Vec<Forecast>]) -> Option<usize> {
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let rows: Vec<Vec<f64>> = forecasts.iter().map(|row| log_probabilities(row)).collect();
    // The mean over the points by which one row is above another, and its standard error.
    let difference = |a: &[f64], b: &[f64]| {
        let each: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
        let gain = mean(&each);
        let variance = each.iter().map(|g| (g - gain).powi(2)).sum::<f64>() / each.len() as f64;
        (gain, (variance / each.len() as f64).sqrt())
    };
    let best = (1..rows.len()).max_by(|&a, &b| mean(&rows[a]).total_cmp(&mean(&rows[b])))?;
    let (gain, error) = difference(&rows[best], &rows[0]);
    // Written so that figures that are not finite choose none.
    if gain > SURE * error {
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
    use super::super::thin_plate::saddle;
    use super::*;
    use crate::geometry::Shape;
    use nalgebra::DMatrix;
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

    fn off(shape: Shape, points: &[[f32; 3]]) -> f64 {
        let square = points.iter().map(|&p| f64::from(shape.sdf(p)).powi(2));
        (square.sum::<f64>() / points.len() as f64).sqrt()
    }

    const TORUS: Shape = Shape::Torus { major: 0.34, minor: 0.14 };

    #[test]
    fn exact_points_are_left_alone() {
        // Smooth shapes, and one with sharp edges.
        for shape in
            [TORUS, Shape::Sphere { radius: 0.5 }, Shape::RoundedBox { half: [0.5, 0.3, 0.2], round: 0.01 }]
        {
            let (points, normals) = shape.sample(200, 3);
            let same = denoise(&points, &normals);
            assert_eq!((same.points, same.moved), (points, 0.0));
        }
    }

    #[test]
    fn noisy_points_come_closer_to_the_surface_and_say_by_how_much() {
        for (shape, sigma) in [(TORUS, 0.01), (Shape::Sphere { radius: 0.5 }, 0.02)] {
            let (exact, normals) = shape.sample(160, 3);
            let points = noisy(&exact, sigma, 7);
            let clean = denoise(&points, &normals);
            let (before, after) = (off(shape, &points), off(shape, &clean.points));
            assert!(after < 0.75 * before, "{before} to {after}");
            let square =
                |(p, q): (&[f32; 3], &[f32; 3])| (0..3).map(|k| f64::from(p[k] - q[k]).powi(2)).sum::<f64>();
            let moved = points.iter().zip(&clean.points).map(square).sum::<f64>() / points.len() as f64;
            assert!((moved.sqrt() - clean.moved).abs() < 1e-4, "{} is not {}", clean.moved, moved.sqrt());
        }
    }

    #[test]
    fn few_and_many_points_are_left_alone() {
        for n in [1, DENOISED_POINTS.start() - 1, DENOISED_POINTS.end() + 1] {
            let (points, normals) = TORUS.sample(n, 1);
            let points = noisy(&points, 0.03, 2);
            assert_eq!(denoise(&points, &normals).points, points);
        }
        // Nor is there an error where the points determine no surface.
        let flat = vec![[0.25, 0.25, 0.25]; 60];
        assert_eq!(denoise(&flat, &vec![[0.0, 0.0, 1.0]; 60]).moved, 0.0);
    }

    /// Against surfaces that were really made without the point, and the covariance of a Gaussian process given the
    /// rest by its definition.
    #[test]
    fn forecasts_are_those_of_leaving_points_out() {
        let (points, normals) = TORUS.sample(24, 5);
        let centres: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
        let gradients = directions(&normals);
        for smoothing in [1e-4, 1e-2] {
            let of = |centres: &[[f64; 3]]| System::new(centres).unwrap().smoothed(smoothing).unwrap();
            let fast = forecasts(&of(&centres), &gradients);
            let whole = saddle(&centres, smoothing);
            for i in 0..24 {
                let (mut rest, mut along) = (centres.clone(), gradients.clone());
                rest.remove(i);
                along.drain(3 * i..3 * i + 3);
                let without = of(&rest).interpolant(&rest, &along);
                let want = f64::from(without.sdf(&points[i..=i])[0].abs());
                assert!(
                    (fast[i].error - want).abs() < 1e-5 * want.max(0.1),
                    "{} is not {want}",
                    fast[i].error
                );
                let own = [i, 24 + 3 * i, 25 + 3 * i, 26 + 3 * i];
                let others: Vec<usize> = (0..100).filter(|row| !own.contains(row)).collect();
                let between = DVector::from_fn(96, |a, _| whole[(others[a], i)]);
                let among = DMatrix::from_fn(96, 96, |a, b| whole[(others[a], others[b])]);
                let want = whole[(i, i)] - between.dot(&among.lu().solve(&between).unwrap());
                let got = fast[i].variance;
                assert!((got - want).abs() < 1e-6 * want, "{got} is not {want}");
            }
        }
    }

    #[test]
    fn probabilities_are_normal_and_the_best_amplitude_is_taken() {
        let row: Vec<Forecast> = (1..40)
            .map(|i| Forecast { error: 0.1 * f64::from(i % 7), variance: 0.2 + f64::from(i % 5) })
            .collect();
        let log_density = |f: &Forecast, amplitude: f64| {
            let variance = amplitude * f.variance;
            -0.5 * (variance.ln() + f.error.powi(2) / variance)
        };
        let best = row.iter().map(|f| f.error.powi(2) / f.variance).sum::<f64>() / 39.0;
        for (f, got) in row.iter().zip(log_probabilities(&row)) {
            assert!((got - log_density(f, best)).abs() < 1e-12);
        }
        let sum = |amplitude: f64| row.iter().map(|f| log_density(f, amplitude)).sum::<f64>();
        assert!(sum(best) > sum(0.98 * best) && sum(best) > sum(1.02 * best));
    }

    #[test]
    fn the_amplitude_is_that_of_most_points() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut row: Vec<Forecast> = (0..4000)
            .map(|i| {
                let (z, variance): (f64, f64) = (StandardNormal.sample(&mut rng), 1.0 + f64::from(i % 3));
                Forecast { error: (z * (0.04 * variance).sqrt()).abs(), variance }
            })
            .collect();
        assert!((amplitude(&row) / 0.04 - 1.0).abs() < 0.1, "{}", amplitude(&row));
        // Some beyond an edge are far off.
        row[..200].iter_mut().for_each(|f| f.error = 10.0);
        assert!((amplitude(&row) / 0.04 - 1.0).abs() < 0.2, "{}", amplitude(&row));
    }

    #[test]
    fn the_choice_is_the_least_smoothing_that_is_surely_better() {
        let row = |forecasts: [(f64, f64); 4]| {
            forecasts.map(|(error, variance)| Forecast { error, variance }).repeat(20)
        };
        let plain = |errors: [f64; 4]| row(errors.map(|e| (e, 1.0)));
        let without = plain([1.0, 2.0, 1.5, 0.5]);
        let worse = plain([1.1, 2.1, 1.6, 0.6]);
        let better = plain([0.8, 1.9, 1.2, 0.4]);
        let best = plain([0.5, 1.0, 0.75, 0.25]);
        // Of two points each one is a little worse than the best.
        let hardly = plain([0.52, 0.97, 0.76, 0.25]);
        // As far off, but known beforehand.
        let aware = row([(1.0, 1.0), (2.0, 4.0), (1.5, 2.2), (0.5, 0.3)]);
        // Two points far better, two far worse.
        let unsure = plain([1.5, 0.1, 0.1, 1.9]);
        let nan = plain([f64::NAN; 4]);
        for (rows, want) in [
            (vec![&without, &worse, &worse], None),
            (vec![&without, &worse, &unsure], None),
            (vec![&without, &worse, &better, &worse], Some(2)),
            (vec![&without, &better, &best], Some(2)),
            (vec![&without, &best, &better], Some(1)),
            (vec![&without, &hardly, &best], Some(1)),
            (vec![&without, &worse, &hardly, &best], Some(2)),
            (vec![&without, &worse, &aware], Some(2)),
            (vec![&nan, &nan, &nan], None),
        ] {
            let rows: Vec<Vec<Forecast>> = rows.into_iter().cloned().collect();
            assert_eq!(choose(&rows), want, "{rows:?}");
        }
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
            prop_assert_eq!(&one.points, &three.points);
            prop_assert!(one.moved.is_finite() && one.points.iter().flatten().all(|x| x.is_finite()));
        }
    }
}
