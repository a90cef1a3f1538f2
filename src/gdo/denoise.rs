//! Noisy points moved onto a smooth surface near them.
//!
//! The surface is a smoothing thin plate: the one of least bending that may miss the points (see
//! [`ThinPlate`](super::ThinPlate)). How far it may is chosen by cross-validation: an exact point is predicted best by
//! a surface through all the others, a noisy one by a surface that passes between them.

use super::thin_plate::{MAX_CENTRES, System, directions};
use nalgebra::{DVector, Matrix4, Vector4};
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// The sizes of clouds that [`denoise`] looks at: smaller ones say too little, for larger ones it is too slow.
pub const DENOISED_POINTS: RangeInclusive<usize> = 50..=MAX_CENTRES;
/// Smoothing parameters tried, from one that follows the points to one that leaves much of the detail out. In the
/// working frame 1e-4 removes about half of a scatter of 0.005.
const SMOOTHINGS: [f64; 5] = [1e-5, 3e-5, 1e-4, 3e-4, 1e-3];
/// Which of them gives the normals that it and those before it are compared with; where it is chosen itself, the next
/// one does. Normals that follow the points as closely as the surface make it foresee their noise; those of too smooth
/// a surface know nothing of thin parts.
const REFERENCE: usize = 2;
/// Standard errors by which the best smoothing must predict better than none. No level of significance, as the best of
/// several is taken: of 30 exact clouds none passed, of the same with a scatter of 0.005 eighteen.
const SURE: f64 = 2.0;
/// Moves below this root of the mean square are not worth making; a very smooth surface through exact points is one
/// that smoothing finds, too.
const NEGLIGIBLE: f64 = 1e-4;

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
/// Each point is predicted from all others by a thin plate through them and by smoothing ones with parameters up to
/// 1e-4, all with the normals of the smoothest; where that one is chosen, the next one, and after it the last (1e-3),
/// is tried in the same way. Unless the least mean error is below that without smoothing by two standard errors of the
/// difference, the points are returned as they are. Otherwise they move onto the least smooth surface whose mean error
/// is within one standard error of the least. Clouds whose size is not in [`DENOISED_POINTS`], and such as would move
/// by less than 1e-4, are returned as they are, too.
///
/// # Panics
/// If there is not one normal a point.
#[track_caller]
pub fn denoise(points: &[[f32; 3]], normals: &[[f32; 3]]) -> Denoised {
    let (n, m) = (points.len(), normals.len());
    assert!(n == m, "denoise: {n} points, {m} normals");
    match if DENOISED_POINTS.contains(&n) { smoothed(points, normals) } else { None } {
        Some(denoised) if denoised.moved >= NEGLIGIBLE => denoised,
        _ => Denoised { points: points.to_vec(), moved: 0.0 },
    }
}

/// The points on the surface that predicts them best; `None` if that goes through them, or there is none.
fn smoothed(points: &[[f32; 3]], normals: &[[f32; 3]]) -> Option<Denoised> {
    let centres: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
    let through = System::new(&centres)?;
    let systems: Vec<Option<System>> = SMOOTHINGS.par_iter().map(|&s| through.smoothed(s)).collect();
    let systems: Vec<System> = systems.into_iter().collect::<Option<_>>()?;
    let mut gradients = through.least_bending(directions(normals));
    let mut chosen = None;
    for reference in REFERENCE..SMOOTHINGS.len() {
        gradients = systems[reference].least_bending(gradients);
        // Smoother surfaces than the one that the normals are of would be judged too well.
        let tried = std::iter::once(&through).chain(&systems[..=reference]);
        let errors: Vec<Vec<f64>> = tried.map(|system| errors(system, &gradients)).collect();
        let Some(smoothing) = choose(&errors) else { break };
        chosen = Some(smoothing - 1);
        if smoothing - 1 < reference {
            break;
        }
    }
    let system = &systems[chosen?];
    let gradients = system.least_bending(gradients);
    let values = system.interpolant(&centres, &gradients).sdf(points);
    // Unit gradients: f is how far a point is from the surface, to first order.
    let moved = points.iter().zip(&values).zip(gradients.as_chunks::<3>().0);
    let moved = moved.map(|((p, &f), g)| std::array::from_fn(|k| p[k] - f * g[k] as f32)).collect();
    let square = values.iter().map(|&f| f64::from(f).powi(2)).sum::<f64>();
    Some(Denoised { points: moved, moved: (square / values.len() as f64).sqrt() })
}

/// How far each of n points is from the surface that all others determine, with these gradients (3 n, unit).
///
/// With B the data's block of the system's inverse and d the data, leaving out the data I changes them by
/// (B_II)^-1 (B d)_I, so no system is solved anew. I is the value and the gradient of one point.
fn errors(system: &System, gradients: &[f64]) -> Vec<f64> {
    let n = gradients.len() / 3;
    let data = DVector::from_fn(4 * n, |i, _| if i < n { 0.0 } else { gradients[i - n] });
    let weights = system.energy() * data;
    let error = |i: usize| {
        let own = [i, n + 3 * i, n + 3 * i + 1, n + 3 * i + 2];
        let block = Matrix4::from_fn(|a, b| system.energy()[(own[a], own[b])]);
        let change = block.lu().solve(&Vector4::from_fn(|a, _| weights[own[a]]));
        change.map_or(f64::NAN, |change| change[0].abs())
    };
    (0..n).map(error).collect()
}

/// Which row of `errors` (rows by smoothing, the first without, columns by point) to take, if not the first.
fn choose(errors: &[Vec<f64>]) -> Option<usize> {
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    // The mean of a - b over the points, and its standard error.
    let difference = |a: &[f64], b: &[f64]| {
        let each: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
        let mean = mean(&each);
        let variance = each.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / each.len() as f64;
        (mean, (variance / each.len() as f64).sqrt())
    };
    let best = (1..errors.len()).min_by(|&a, &b| mean(&errors[a]).total_cmp(&mean(&errors[b])))?;
    let (gain, error) = difference(&errors[0], &errors[best]);
    // Written so that figures that are not finite choose none.
    if gain > SURE * error {
        (1..=best).find(|&k| {
            let (excess, error) = difference(&errors[k], &errors[best]);
            excess <= error
        })
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;
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

    /// Against surfaces that were really made without the point.
    #[test]
    fn errors_are_those_of_leaving_points_out() {
        let (points, normals) = TORUS.sample(24, 5);
        let centres: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
        let gradients = directions(&normals);
        for smoothing in [1e-4, 1e-2] {
            let of = |centres: &[[f64; 3]]| System::new(centres).unwrap().smoothed(smoothing).unwrap();
            let fast = errors(&of(&centres), &gradients);
            for i in 0..24 {
                let (mut rest, mut along) = (centres.clone(), gradients.clone());
                rest.remove(i);
                along.drain(3 * i..3 * i + 3);
                let without = of(&rest).interpolant(&rest, &along);
                let want = f64::from(without.sdf(&points[i..=i])[0].abs());
                assert!((fast[i] - want).abs() < 1e-5 * want.max(0.1), "{} is not {want}", fast[i]);
            }
        }
    }

    #[test]
    fn the_choice_is_the_least_smoothing_that_is_surely_better() {
        let row = |errors: &[f64]| errors.repeat(20);
        let without = row(&[1.0, 2.0, 1.5, 0.5]);
        let worse = row(&[1.1, 2.1, 1.6, 0.6]);
        let better = row(&[0.8, 1.9, 1.2, 0.4]);
        let hardly = row(&[0.81, 1.89, 1.2, 0.399]);
        let unsure = row(&[0.1, 2.8, 0.7, 1.35]);
        let nan = row(&[f64::NAN]);
        for (rows, want) in [
            (vec![&without, &worse, &worse], None),
            (vec![&without, &worse, &unsure], None),
            (vec![&without, &worse, &better, &worse], Some(2)),
            (vec![&without, &better, &hardly], Some(1)),
            (vec![&without, &worse, &hardly], Some(2)),
            (vec![&nan, &nan, &nan], None),
        ] {
            let rows: Vec<Vec<f64>> = rows.into_iter().cloned().collect();
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
