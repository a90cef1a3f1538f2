//! Noisy points moved onto a smooth surface near them.
//!
//! The surface is a smoothing thin plate: the one of least bending that may miss the points (see
//! [`ThinPlate`](super::ThinPlate)). How far it may is chosen by five-fold cross-validation: exact points are predicted
//! best by a surface through all the others, noisy ones by a surface that passes between them.

use super::thin_plate::{MAX_CENTRES, System, directions};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand::seq::SliceRandom;
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// The sizes of clouds that [`denoise`] looks at: smaller ones say too little, for larger ones it is too slow.
pub const DENOISED_POINTS: RangeInclusive<usize> = 50..=MAX_CENTRES;
/// Smoothing parameters tried, from one that follows the points to one that leaves much of the detail out. In the
/// working frame 1e-4 removes about half of a scatter of 0.005.
const SMOOTHINGS: [f64; 6] = [1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3];
/// Standard errors by which smoothing must predict better than none. At half of one, some exact clouds of thin parts
/// count as noisy, which costs more there than noise does elsewhere.
const SURE: f64 = 1.0;
/// Parts of the cloud, each of which is predicted from the others.
const FOLDS: usize = 5;
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
/// Each fifth of the cloud, drawn with `seed`, is predicted by thin plates through the rest, with several smoothing
/// parameters. Unless one of these has a mean error below that without smoothing by more than the standard error of the
/// difference, the points are returned as they are. Otherwise they move onto the smoothest surface whose mean error is
/// within one standard error of the least. Clouds whose size is not in [`DENOISED_POINTS`], and such as would move by
/// less than 1e-4, are returned as they are, too.
///
/// # Panics
/// If there is not one normal a point.
#[track_caller]
pub fn denoise(points: &[[f32; 3]], normals: &[[f32; 3]], seed: u64) -> Denoised {
    let (n, m) = (points.len(), normals.len());
    assert!(n == m, "denoise: {n} points, {m} normals");
    let smoothed = || smooth(points, normals, choose(points, normals, seed)?);
    let found = if DENOISED_POINTS.contains(&n) { smoothed() } else { None };
    match found {
        Some(denoised) if denoised.moved >= NEGLIGIBLE => denoised,
        _ => Denoised { points: points.to_vec(), moved: 0.0 },
    }
}

/// How many of [`SMOOTHINGS`] to go through, by the one-standard-error rule; `None` if none predicts better.
fn choose(points: &[[f32; 3]], normals: &[[f32; 3]], seed: u64) -> Option<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let errors = |fold: usize| {
        let own = |i: usize| i % FOLDS == fold;
        let rest: Vec<usize> = (0..order.len()).filter(|&i| !own(i)).map(|i| order[i]).collect();
        let own: Vec<usize> = (0..order.len()).filter(|&i| own(i)).map(|i| order[i]).collect();
        errors(points, normals, &rest, &own)
    };
    let folds: Vec<Option<Vec<Vec<f64>>>> = (0..FOLDS).into_par_iter().map(errors).collect();
    let folds: Vec<Vec<Vec<f64>>> = folds.into_iter().collect::<Option<_>>()?;
    // By smoothing: the error at every point.
    let of = |k: usize| folds.iter().flat_map(move |fold| &fold[k]).copied().collect::<Vec<f64>>();
    let all: Vec<Vec<f64>> = (0..=SMOOTHINGS.len()).map(of).collect();
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    // The mean of a - b over the points, and its standard error.
    let difference = |a: &[f64], b: &[f64]| {
        let each: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
        let mean = mean(&each);
        let variance = each.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / each.len() as f64;
        (mean, (variance / each.len() as f64).sqrt())
    };
    let best = (1..all.len()).min_by(|&a, &b| mean(&all[a]).total_cmp(&mean(&all[b])))?;
    let (gain, error) = difference(&all[0], &all[best]);
    let as_good = |k: &usize| {
        let (excess, error) = difference(&all[*k], &all[best]);
        excess <= error
    };
    // Written so that figures that are not finite choose none.
    if gain > SURE * error { (best..all.len()).take_while(as_good).last() } else { None }
}

/// How far the points `own` are from the surfaces through the points `rest`, without smoothing and with each; `None` if
/// these determine none.
fn errors(points: &[[f32; 3]], normals: &[[f32; 3]], rest: &[usize], own: &[usize]) -> Option<Vec<Vec<f64>>> {
    let centres: Vec<[f64; 3]> = rest.iter().map(|&i| points[i].map(f64::from)).collect();
    let near: Vec<[f32; 3]> = rest.iter().map(|&i| normals[i]).collect();
    let own: Vec<[f32; 3]> = own.iter().map(|&i| points[i]).collect();
    let mut out = Vec::with_capacity(1 + SMOOTHINGS.len());
    walk(&centres, &near, SMOOTHINGS.len(), |system, gradients| {
        let plate = system.interpolant(&centres, gradients);
        out.push(plate.sdf(&own).iter().map(|f| f64::from(f.abs())).collect());
    })?;
    Some(out)
}

/// The points moved onto the surface that the first `count` smoothing parameters lead to.
fn smooth(points: &[[f32; 3]], normals: &[[f32; 3]], count: usize) -> Option<Denoised> {
    let centres: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
    let (mut values, mut along) = (Vec::new(), Vec::new());
    walk(&centres, normals, count, |system, gradients| {
        values = system.interpolant(&centres, gradients).sdf(points);
        along = gradients.to_vec();
    })?;
    // Unit gradients: f is how far a point is from the surface, to first order.
    let moved = points.iter().zip(&values).zip(along.as_chunks::<3>().0);
    let moved = moved.map(|((p, &f), g)| std::array::from_fn(|k| p[k] - f * g[k] as f32)).collect();
    let square = values.iter().map(|&f| f64::from(f).powi(2)).sum::<f64>();
    Some(Denoised { points: moved, moved: (square / values.len() as f64).sqrt() })
}

/// Shows `see` the system without smoothing and with the first `count` parameters, each with its gradients of least
/// bending, which are looked for near those before. `None` if a system has no solution.
fn walk(
    centres: &[[f64; 3]],
    normals: &[[f32; 3]],
    count: usize,
    mut see: impl FnMut(&System, &[f64]),
) -> Option<()> {
    let through = System::new(centres)?;
    let mut gradients = through.least_bending(directions(normals));
    see(&through, &gradients);
    for &smoothing in &SMOOTHINGS[..count] {
        let system = through.smoothed(smoothing)?;
        gradients = system.least_bending(gradients);
        see(&system, &gradients);
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;
    use proptest::prelude::*;
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
            let same = denoise(&points, &normals, 0);
            assert_eq!((same.points, same.moved), (points, 0.0));
        }
    }

    #[test]
    fn noisy_points_come_closer_to_the_surface_and_say_by_how_much() {
        for (shape, sigma) in [(TORUS, 0.01), (Shape::Sphere { radius: 0.5 }, 0.02)] {
            let (exact, normals) = shape.sample(160, 3);
            let points = noisy(&exact, sigma, 7);
            let clean = denoise(&points, &normals, 0);
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
            assert_eq!(denoise(&points, &normals, 0).points, points);
        }
        // Nor is there an error where the points determine no surface.
        let flat = vec![[0.25, 0.25, 0.25]; 60];
        assert_eq!(denoise(&flat, &vec![[0.0, 0.0, 1.0]; 60], 0).moved, 0.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 6, ..Default::default() })]
        #[test]
        fn threads_change_nothing_and_all_stays_finite(seed in 0u64..1000, sigma in 0.0f32..0.05) {
            let (points, normals) = TORUS.sample(60, seed);
            let points = noisy(&points, sigma, seed);
            let on = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| denoise(&points, &normals, 0))
            };
            let (one, three) = (on(1), on(3));
            prop_assert_eq!(&one.points, &three.points);
            prop_assert!(one.moved.is_finite() && one.points.iter().flatten().all(|x| x.is_finite()));
        }
    }
}
