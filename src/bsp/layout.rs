//! Where the codes of the points begin: spread evenly over the unit sphere, those of neighbours together.
//!
//! Used with the option `bsp.layout`, which of the presets only `paper` has.
//!
//! Phi's head alone starts with all codes in one spot, and nothing in the paper's losses spreads them. The layout is
//! what the head's output is added to ([`Canonical`](super::Canonical)).

use crate::geometry::vec3::{length, sub, unit_vector};
use crate::geometry::{KdTree, PrincipalAxes, fibonacci_sphere, mean_point};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// The number of relaxation rounds.
const ROUNDS: usize = 160;
/// In the last share of the rounds nothing draws neighbours together, so that the sphere is filled evenly.
const EVEN_SHARE: f32 = 0.3;
/// The number of nearest codes that push a code away.
const PUSHING: usize = 24;
/// The distance at which a push has fallen to 0, in hexagonal spacings: the distances between neighbours of a layout in
/// hexagons.
const RANGE: f32 = 1.6;
/// The length of a push from a code at distance 0, in hexagonal spacings.
const PUSH: f32 = 0.35;
/// The share of the way to the mean of its neighbours that a code goes in the first round.
const DRAW: f32 = 0.4;
/// How much of a Fibonacci layout is mixed in, so that points of a plane or a line do not stay on a circle; at most a
/// quarter of a hexagonal spacing.
const MIXED: f64 = 0.05;

/// How far the head of Phi moves codes for an output of 1: half of what lies between even codes, and not farther than
/// the radius `cap` of a patch.
pub(super) fn code_step(n: usize, cap: f32) -> f32 {
    (0.5 * hexagonal_spacing(n)).min(cap)
}

/// The distance between neighbours where n codes lie on the unit sphere in hexagons.
pub(super) fn hexagonal_spacing(n: usize) -> f32 {
    (8.0 * std::f32::consts::PI / (3f32.sqrt() * n.max(1) as f32)).sqrt()
}

/// One code a point, n x 3, unit length; `neighbours` lists k points for each (n k), of which the point itself may be
/// one.
///
/// The points are centred, scaled to the same variance along all axes and projected onto the sphere, with a little of a
/// Fibonacci layout mixed in. Then codes push those around them away and are drawn to the mean of the codes of their
/// points' neighbours, less and less and in the end not at all. The same for any number of threads.
///
/// The rounds are as many as a few hundred points need: codes of tens of thousands that begin in a clump are not even
/// after them.
///
/// # Panics
/// If the number of neighbours is not a multiple of that of the points.
#[track_caller]
pub(super) fn spherical_layout(points: &[[f32; 3]], neighbours: &[u32]) -> Vec<[f32; 3]> {
    let n = points.len();
    assert!(n == 0 || neighbours.len().is_multiple_of(n), "layout: {} neighbours of {n}", neighbours.len());
    let mut codes = projected(points);
    if n < 2 {
        return codes;
    }
    let k = (neighbours.len() / n).max(1);
    let spacing = hexagonal_spacing(n);
    for round in 0..ROUNDS {
        let done = round as f32 / ROUNDS as f32;
        let draw = DRAW * (1.0 - done / (1.0 - EVEN_SHARE)).max(0.0);
        let around = PUSHING.min(n - 1) + 1;
        let near = KdTree::new(&codes).k_nearest(&codes, around);
        codes = (0..n)
            .into_par_iter()
            .map(|i| {
                let u = codes[i];
                let push = near[i * around..(i + 1) * around].iter().fold([0.0f32; 3], |push, &j| {
                    let away = sub(u, codes[j as usize]);
                    let distance = length(away);
                    let strength = (1.0 - distance / (RANGE * spacing)).max(0.0) / distance.max(1e-6);
                    std::array::from_fn(|d| push[d] + strength * away[d])
                });
                let mine = &neighbours[i * k..(i + 1) * k];
                let pull = mine.iter().fold([0.0f32; 3], |pull, &j| {
                    std::array::from_fn(|d| pull[d] + (codes[j as usize][d] - u[d]) / k as f32)
                });
                let step: [f32; 3] = std::array::from_fn(|d| PUSH * spacing * push[d] + draw * pull[d]);
                let most = (spacing / length(step).max(1e-12)).min(1.0);
                unit_vector(std::array::from_fn(|d| u[d] + most * step[d])).unwrap_or(u)
            })
            .collect();
    }
    codes
}

/// The points on the sphere around their mean, after scaling to the same variance along all axes.
fn projected(points: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let wide = |p: &[f32; 3]| Vector3::from(p.map(f64::from));
    let count = points.len().max(1) as f64;
    let mean = mean_point(points.iter().map(wide));
    // Divided term by term: another order of roundings would lay the codes out in other bits.
    let covariance = points.iter().fold(Matrix3::zeros(), |sum, p| {
        let d = wide(p) - mean;
        sum + d * d.transpose() / count
    });
    let PrincipalAxes { directions, squares } = PrincipalAxes::of_spread(covariance);
    let largest = squares.max().max(f64::MIN_POSITIVE);
    let scales = squares.map(|v| 1.0 / (v / largest).max(1e-4).sqrt());
    let whiten = directions * Matrix3::from_diagonal(&scales) * directions.transpose();
    let even = fibonacci_sphere(points.len());
    let mixed = MIXED.min(0.25 * f64::from(hexagonal_spacing(points.len())));
    let place = |(p, even): (&[f32; 3], &[f32; 3])| {
        let d = whiten * (wide(p) - mean);
        let d = d.try_normalize(1e-12).unwrap_or_else(Vector3::zeros) + mixed * wide(even);
        unit_vector([d.x as f32, d.y as f32, d.z as f32]).unwrap_or(*even)
    };
    points.iter().zip(&even).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::AnalyticShape;
    use crate::ops::testing::normal;

    fn laid_out(points: &[[f32; 3]], k: usize) -> (Vec<[f32; 3]>, Vec<u32>) {
        let neighbours = KdTree::new(points).k_nearest(points, k.min(points.len()));
        (spherical_layout(points, &neighbours), neighbours)
    }

    /// The mean distance from a code to its nearest other one, in hexagonal spacings, and the least.
    fn gaps(codes: &[[f32; 3]]) -> (f32, f32) {
        let near = KdTree::new(codes).k_nearest(codes, 2);
        let gap = |(i, pair): (usize, &[u32])| {
            let j = if pair[0] as usize == i { pair[1] } else { pair[0] } as usize;
            length(std::array::from_fn(|d| codes[i][d] - codes[j][d])) / hexagonal_spacing(codes.len())
        };
        let gaps: Vec<f32> = near.chunks_exact(2).enumerate().map(gap).collect();
        (gaps.iter().sum::<f32>() / gaps.len() as f32, gaps.iter().copied().fold(f32::MAX, f32::min))
    }

    fn samples() -> Vec<(&'static str, Vec<[f32; 3]>)> {
        let rod: Vec<[f32; 3]> =
            normal(&[200, 3], 4).to_points().iter().map(|p| [p[0], 0.02 * p[1], 0.01 * p[2]]).collect();
        vec![
            ("torus", AnalyticShape::Torus { major: 0.34, minor: 0.14 }.sample(300, 1).0),
            ("rod", rod),
            ("plane", normal(&[150, 3], 5).to_points().iter().map(|p| [p[0], p[1], 0.0]).collect()),
            ("line", (0..40).map(|i| [i as f32, 0.0, 0.0]).collect()),
            ("ball", normal(&[300, 3], 6).to_points()),
        ]
    }

    #[test]
    fn codes_fill_the_sphere_evenly_whatever_the_points() {
        for (name, points) in samples() {
            let (codes, _) = laid_out(&points, 8);
            assert!(codes.iter().all(|&u| (length(u) - 1.0).abs() < 1e-5), "{name}");
            let mean: [f32; 3] =
                std::array::from_fn(|d| codes.iter().map(|u| u[d]).sum::<f32>() / codes.len() as f32);
            let (average, least) = gaps(&codes);
            // Codes that lie at random have a mean gap of about a half and a least one near 0.
            assert!(
                length(mean) < 0.1 && average > 0.75 && least > 0.45,
                "{name}: {mean:?} {average} {least}"
            );
        }
    }

    #[test]
    fn neighbours_stay_together() {
        // The ball fills space, which no layout on a sphere can keep.
        for (name, points) in samples().into_iter().filter(|(name, _)| ["torus", "plane"].contains(name)) {
            let (codes, neighbours) = laid_out(&points, 8);
            let apart = |i: usize, j: usize| -> f32 {
                length(std::array::from_fn(|d| codes[i][d] - codes[j][d])) / hexagonal_spacing(codes.len())
            };
            let pairs: Vec<f32> = neighbours
                .chunks_exact(8)
                .enumerate()
                .flat_map(|(i, near)| near[1..].iter().map(move |&j| (i, j as usize)))
                .map(|(i, j)| apart(i, j))
                .collect();
            let close = pairs.iter().filter(|&&d| d < 3.0).count();
            assert!(close * 10 > pairs.len() * 7, "{name}: {close} of {}", pairs.len());
        }
    }

    #[test]
    fn few_points_have_codes() {
        assert!(spherical_layout(&[], &[]).is_empty());
        assert!((length(spherical_layout(&[[3.0, 1.0, 2.0]], &[0])[0]) - 1.0).abs() < 1e-5);
        let (two, _) = laid_out(&[[0.0; 3], [1.0, 0.0, 0.0]], 8);
        assert!((0..3).map(|d| two[0][d] * two[1][d]).sum::<f32>() < 0.0);
    }

    #[test]
    fn the_same_for_any_number_of_threads() {
        let points = normal(&[150, 3], 6).to_points();
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| laid_out(&points, 8).0)
        };
        assert_eq!(run(1), run(3));
    }
}
