//! Points moved onto a smooth surface near them, as far as the points themselves say that they scatter about one.
//!
//! The surface is the one of least bending that may miss the points (see [`ThinPlate`](super::ThinPlate)), at a price: how far it goes for
//! a smoother shape is chosen by cross-validation. Points that are exact are foretold best, from the points around, by
//! a surface through all of them; noisy ones by a surface that passes between them.

use super::thin_plate::{MAX_CENTRES, System, directions};
use rayon::prelude::*;

/// Prices tried, from a surface through the points to one that leaves much of the detail out. In the working frame 1e-4
/// takes off about half of a scatter of 0.005.
const SMOOTHINGS: [f64; 6] = [1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3];
/// Standard errors by which smoothing must foretell better than none. At half of one, some exact clouds of thin parts count
/// as noisy, which costs more there than noise does elsewhere.
const SURE: f64 = 1.0;
/// Fewest points that are cross-validated.
const MIN_POINTS: usize = 50;
/// Parts of the cloud, each of which is foretold from the others.
const FOLDS: usize = 5;

/// A cloud without what the scatter of its points is put down to.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// The points, moved (n x 3).
    pub points: Vec<[f32; 3]>,
    /// The root of the mean square of the moves; 0 where the points are best left alone.
    pub moved: f64,
}

/// The points (n x 3, working frame) with their noise taken off, given rough outward normals (n x 3).
///
/// Every fifth of the cloud is foretold by the surfaces of least bending through the rest, with several prices for
/// missing a point. Unless one of them has a mean error that is lower than without smoothing by more than the
/// standard error of the difference, the points are returned as they are; otherwise they move onto the smoothest
/// surface whose mean error is within one standard error of the least. Clouds of more than 500 points, for which this
/// is too slow, and of fewer than 50, which say too little, are left alone.
///
/// # Panics
/// If there is not one normal a point.
#[track_caller]
pub fn denoise(points: &[[f32; 3]], normals: &[[f32; 3]]) -> Denoised {
    let (n, m) = (points.len(), normals.len());
    assert!(n == m, "denoise: {n} points, {m} normals");
    let asis = Denoised { points: points.to_vec(), moved: 0.0 };
    if !(MIN_POINTS..=MAX_CENTRES).contains(&n) {
        return asis;
    }
    match choose(points, normals) {
        Some(smoothing) => smooth(points, normals, smoothing).unwrap_or(asis),
        None => asis,
    }
}

/// The smoothing that foretells best, up to a standard error; none if that is no smoothing.
fn choose(points: &[[f32; 3]], normals: &[[f32; 3]]) -> Option<f64> {
    let folds: Vec<Vec<Vec<f64>>> =
        (0..FOLDS).into_par_iter().map(|fold| errors(points, normals, fold)).collect::<Option<_>>()?;
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
    let best =
        (1..all.len()).min_by(|&a, &b| mean(&all[a]).total_cmp(&mean(&all[b]))).expect("there are some");
    let (gain, error) = difference(&all[0], &all[best]);
    if gain <= SURE * error {
        return None;
    }
    let as_good = |k: &usize| {
        let (excess, error) = difference(&all[*k], &all[best]);
        excess <= error
    };
    let chosen = (best..all.len()).take_while(as_good).last().unwrap_or(best);
    Some(SMOOTHINGS[chosen - 1])
}

/// How far the points of a fold are from the surfaces through the others, without smoothing and with each; `None` if
/// these determine none.
fn errors(points: &[[f32; 3]], normals: &[[f32; 3]], fold: usize) -> Option<Vec<Vec<f64>>> {
    let part = |of: &[[f32; 3]], own: bool| -> Vec<[f32; 3]> {
        of.iter().enumerate().filter(|(i, _)| (i % FOLDS == fold) == own).map(|(_, p)| *p).collect()
    };
    let rest: Vec<[f64; 3]> = part(points, false).iter().map(|p| p.map(f64::from)).collect();
    let own = part(points, true);
    let through = System::new(&rest)?;
    let mut near = directions(&part(normals, false));
    let mut error = |system: &System| {
        near = system.least_bending(near.clone());
        let plate = system.interpolant(&rest, &near);
        plate.sdf(&own).iter().map(|f| f64::from(f.abs())).collect::<Vec<f64>>()
    };
    let mut out = vec![error(&through)];
    for smoothing in SMOOTHINGS {
        out.push(error(&through.smoothed(smoothing)?));
    }
    Some(out)
}

/// The points moved onto the surface of least bending with this price for missing them.
fn smooth(points: &[[f32; 3]], normals: &[[f32; 3]], smoothing: f64) -> Option<Denoised> {
    let centres: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
    let through = System::new(&centres)?;
    let near = through.least_bending(directions(normals));
    let system = through.smoothed(smoothing)?;
    let gradients = system.least_bending(near);
    let values = system.interpolant(&centres, &gradients).sdf(points);
    let mut square = 0.0;
    let moved = points.iter().zip(&values).zip(gradients.as_chunks::<3>().0).map(|((p, &f), g)| {
        square += f64::from(f).powi(2);
        std::array::from_fn(|k| p[k] - f * g[k] as f32)
    });
    let points = moved.collect();
    Some(Denoised { points, moved: (square / values.len() as f64).sqrt() })
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

    /// On a shape as smooth as these even a smooth surface passes through all of them.
    #[test]
    fn exact_points_stay_where_they_are() {
        for shape in [TORUS, Shape::Sphere { radius: 0.5 }] {
            let (points, normals) = shape.sample(160, 3);
            let same = denoise(&points, &normals);
            assert!(same.moved < 1e-5, "{}", same.moved);
            for (p, q) in points.iter().flatten().zip(same.points.iter().flatten()) {
                assert!((p - q).abs() < 1e-5, "{p} to {q}");
            }
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
        for n in [0, 1, MIN_POINTS - 1, MAX_CENTRES + 1] {
            let (points, normals) = TORUS.sample(n, 1);
            let points = noisy(&points, 0.03, 2);
            assert_eq!(denoise(&points, &normals).points, points);
        }
        // Nor is there an error where the points determine no surface.
        let flat = vec![[0.25, 0.25, 0.25]; 60];
        assert_eq!(denoise(&flat, &vec![[0.0, 0.0, 1.0]; 60]).moved, 0.0);
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
