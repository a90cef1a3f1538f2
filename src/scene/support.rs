//! How well points support a place, as evidence that a surface passes there.

use crate::error::Error;
use crate::geometry::vec3::distance;
use crate::geometry::{KdTree, Normalizer, Position, quantile, surface_spacing};
use rayon::prelude::*;

/// Nearest points over whose surface spacings the mean is taken, so that it does not jump from place to place.
const AVERAGED: usize = 8;
/// The share of the points that have a surface spacing of their own. What is 1.5 times sparser than all of these is a
/// scatter and no surface.
const DENSER_SHARE: f64 = 0.9;
/// The surface spacing at a point is at most this many times the largest of those.
const MAX_EXCESS: f64 = 1.5;
/// Places that one thread works on at a time.
const CHUNK: usize = 256;

/// How well points support m places: the larger the gap, the less.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Support {
    /// The distance from each place to the nearest point, over the surface spacing there (m): 0 at a point, without
    /// unit.
    /// Between the points of an evenly sampled surface it is at most about 0.7, between random ones rarely above 1.5.
    pub gap: Vec<f32>,
    /// The surface spacing of the points there (m), in their unit; [`support`] says what that is.
    pub surface_spacing: Vec<f32>,
}

/// The gap and the surface spacing of `points` (n x 3) at each of `places` (m x 3, in the same frame), of 32 or 64 bits
/// each.
///
/// The surface spacing at a point is the side of the square that each of its neighbours would have if they lay evenly
/// on a disc: r sqrt(pi / k) with the distance r to its k-th nearest point, k = 24 (fewer if there are fewer points).
/// Where a scanner left lines that lie far from each other, it is about as large as the lines are apart. It is at most
/// one and a half times that which nine tenths of the points stay below: what is sparser is a scatter. At a place it is
/// the mean over the eight nearest points.
///
/// # Errors
/// [`ErrorKind::Data`](crate::ErrorKind::Data) if there are fewer than two distinct points or a coordinate of the
/// points is not finite.
///
/// # Panics
/// If a place is not finite.
#[track_caller]
pub fn support<P: Position, Q: Position>(places: &[P], points: &[Q]) -> Result<Support, Error> {
    // In the working frame, where squares neither overflow nor vanish.
    let frame = Normalizer::of(points)?;
    let (places, points) = (frame.forward(places), frame.forward(points));
    let spacing = capped(spacings(&points));
    let tree = KdTree::new(&points);
    let averaged = AVERAGED.min(points.len());
    let chunk = |places: &[[f32; 3]]| {
        let near = tree.k_nearest(places, averaged);
        let one = |(place, near): (&[f32; 3], &[u32])| {
            let spacing = near.iter().map(|&i| spacing[i as usize]).sum::<f64>() / averaged as f64;
            let gap = distance(*place, points[near[0] as usize]) / spacing;
            (gap as f32, (spacing * frame.scale()) as f32)
        };
        places.iter().zip(near.chunks_exact(averaged)).map(one).collect::<Vec<_>>()
    };
    let each: Vec<Vec<(f32, f32)>> = places.par_chunks(CHUNK).map(chunk).collect();
    let (gap, surface_spacing) = each.into_iter().flatten().unzip();
    Ok(Support { gap, surface_spacing })
}

/// The number of the point nearest to each of `places` (m x 3, in the frame of `points`, n x 3): m; of several as near,
/// the first.
///
/// # Errors
/// As [`support`].
///
/// # Panics
/// If a place is not finite.
#[track_caller]
pub fn nearest_of<P: Position, Q: Position>(places: &[P], points: &[Q]) -> Result<Vec<u32>, Error> {
    let frame = Normalizer::of(points)?;
    let (places, points) = (frame.forward(places), frame.forward(points));
    let tree = KdTree::new(&points);
    Ok(places.par_iter().with_min_len(CHUNK).map(|&place| tree.nearest(place).0).collect())
}

/// The surface spacing at each point, above 0.
fn spacings(points: &[[f32; 3]]) -> Vec<f64> {
    let spacing = surface_spacing(points);
    // Points that more than k others share their place with have none of their own.
    let least = spacing.iter().copied().filter(|&s| s > 0.0).fold(f64::INFINITY, f64::min);
    spacing.into_iter().map(|s| if s > 0.0 { s } else { least }).collect()
}

/// Surface spacings no larger than 1.5 times that which nine tenths of the points stay below.
fn capped(mut spacing: Vec<f64>) -> Vec<f64> {
    let most = MAX_EXCESS * quantile(spacing.clone(), DENSER_SHARE);
    spacing.iter_mut().for_each(|s| *s = s.min(most));
    spacing
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{AnalyticShape, fibonacci_sphere};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// By sorting all distances.
        #[test]
        fn is_the_distance_over_the_mean_spacing(n in 2usize..60, seed: u64, scale in -20i32..20) {
            let unit = |p: &[f32; 3]| p.map(|x| x * 2f32.powi(scale));
            let points: Vec<_> = AnalyticShape::Sphere { radius: 0.5 }.sample(n, seed).0.iter().map(unit).collect();
            let places: Vec<_> = AnalyticShape::Sphere { radius: 0.7 }.sample(9, !seed).0.iter().map(unit).collect();
            let sorted = |p: &[f32; 3]| {
                let mut all: Vec<(f64, usize)> = points.iter().map(|q| distance(*p, *q)).zip(0..).collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0));
                all
            };
            let k = 24.min(n - 1);
            let spacing: Vec<f64> =
                points.iter().map(|p| sorted(p)[k].0 * (std::f64::consts::PI / k as f64).sqrt()).collect();
            let mut all = spacing.clone();
            all.sort_by(f64::total_cmp);
            let most = 1.5 * all[(0.9 * (n - 1) as f64).ceil() as usize];
            let got = support(&places, &points).unwrap();
            let nearest = nearest_of(&places, &points).unwrap();
            prop_assert!(places.iter().zip(nearest).all(|(p, i)| sorted(p)[0].1 == i as usize));
            for (place, (got, wide)) in places.iter().zip(got.gap.iter().zip(&got.surface_spacing)) {
                let near = sorted(place);
                let m = 8.min(n);
                let mean = near[..m].iter().map(|&(_, i)| spacing[i].min(most)).sum::<f64>() / m as f64;
                let want = near[0].0 / mean;
                prop_assert!((f64::from(*got) - want).abs() < 1e-4 * want, "{got} is not {want}");
                prop_assert!((f64::from(*wide) - mean).abs() < 1e-4 * mean, "{wide} is not {mean}");
            }
        }
    }

    #[test]
    fn an_evenly_sampled_surface_is_supported_and_what_leaves_it_is_not() {
        let sphere = fibonacci_sphere(500);
        let between = support(&fibonacci_sphere(3001), &sphere).unwrap().gap;
        assert!(between.iter().all(|&s| s < 1.0), "{between:?}");
        let off: Vec<_> = sphere.iter().map(|p| p.map(|x| 1.5 * x)).collect();
        // Half a radius off, over the side of a 500th of the sphere, 0.159.
        let far = support(&off, &sphere).unwrap().gap;
        assert!(far.iter().all(|gap| (2.9..3.4).contains(gap)), "{far:?}");
    }

    /// A scatter beside a surface, each point of it far from all others, does not support the places among its points.
    #[test]
    fn a_scatter_is_no_surface() {
        let mut points = fibonacci_sphere(500);
        let scatter: Vec<[f32; 3]> =
            fibonacci_sphere(30).into_iter().map(|p| [p[0] + 3.0, p[1], p[2]]).collect();
        points.extend(&scatter);
        // Half of the distance between points of the scatter off its points.
        let among: Vec<[f32; 3]> = scatter.iter().map(|p| [p[0] + 0.3, p[1], p[2]]).collect();
        let gap = support(&among, &points).unwrap().gap;
        assert!(gap.iter().filter(|&&gap| gap > 1.0).count() > 25, "{gap:?}");
    }

    /// Rings 0.05 apart, the points 0.004 apart along them: what lies between neighbouring rings is spoken for.
    #[test]
    fn between_the_lines_of_a_scanner_is_surface() {
        let ring = |r: f32, step: f32| {
            let n = (r * std::f32::consts::TAU / step) as usize;
            (0..n).map(move |i| {
                let (s, c) = (i as f32 / n as f32 * std::f32::consts::TAU).sin_cos();
                [r * c, r * s, 0.0]
            })
        };
        let points: Vec<[f32; 3]> = (4..14).flat_map(|i| ring(0.05 * i as f32, 0.004)).collect();
        let between: Vec<[f32; 3]> = (5..12).flat_map(|i| ring(0.05 * i as f32 + 0.025, 0.1)).collect();
        let gap = support(&between, &points).unwrap().gap;
        assert!(gap.iter().all(|&gap| gap < 1.0), "{gap:?}");
        let beyond = support(&ring(0.8, 0.1).collect::<Vec<_>>(), &points).unwrap().gap;
        assert!(beyond.iter().all(|&gap| gap > 1.5), "{beyond:?}");
    }

    #[test]
    fn points_in_one_place_have_a_finite_spacing() {
        let mut points = fibonacci_sphere(40);
        points.extend([points[3]; 60]);
        assert!(support(&fibonacci_sphere(50), &points).unwrap().gap.iter().all(|s| s.is_finite()));
        assert!(support(&points, &[[1.0; 3]]).is_err());
        assert_eq!(support::<[f32; 3], _>(&[], &points).unwrap(), Support::default());
    }
}
