//! The distance far from the input points, where the network's values mean nothing: the distance to the nearest of
//! them.

use crate::geometry::KdTree;

/// Distances from the origin, working frame, between which the field gives way to the distance to the points. The grid
/// that meshes are taken from ends at 1.005.
const BETWEEN: [f64; 2] = [1.05, 1.5];
/// Beyond this the nearest point is looked for from here, in the same direction: from so far all rays are as good as
/// parallel, and squares of distances stay in the range of 32 bits.
const DIRECTION: f64 = 64.0;

/// How far a place is from the origin of the working frame.
pub(super) fn radius(x: &[f64; 3]) -> f64 {
    // The largest coordinate in front of the root, so that squares do not overflow.
    let most = x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    if most == 0.0 || !most.is_finite() {
        return if x.iter().any(|v| v.is_nan()) { f64::NAN } else { most };
    }
    most * x.iter().map(|v| (v / most).powi(2)).sum::<f64>().sqrt()
}

/// The share of the distance to the points in the value at a radius: 0 near the points, 1 far away, NaN for NaN.
pub(super) fn share(radius: f64) -> f64 {
    let t = ((radius - BETWEEN[0]) / (BETWEEN[1] - BETWEEN[0])).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The distance of `x` to the nearest of `points` (n x 3, working frame, within a radius of 1) and its gradient.
/// Outside that radius it grows along every ray from the origin.
pub(super) fn distance(tree: &KdTree, points: &[[f32; 3]], x: [f64; 3]) -> (f64, [f64; 3]) {
    let r = radius(&x);
    if !r.is_finite() {
        return (r, [0.0; 3]);
    }
    let inward = (DIRECTION / r).min(1.0);
    let q = points[tree.nearest(x.map(|v| (v * inward) as f32)).0 as usize];
    let away: [f64; 3] = std::array::from_fn(|a| x[a] - f64::from(q[a]));
    let length = radius(&away);
    (length, away.map(|v| v / length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fibonacci_sphere;

    #[test]
    fn it_is_the_distance_and_grows_along_every_ray() {
        let points: Vec<[f32; 3]> =
            fibonacci_sphere(200).iter().map(|p| [0.5 * p[0], 0.3 * p[1], 0.1 * p[2]]).collect();
        let tree = KdTree::new(&points);
        for ray in fibonacci_sphere(50) {
            let at = |r: f64| -> [f64; 3] { ray.map(|v| f64::from(v) * r) };
            let mut before = 0.0;
            for i in 0..400 {
                let r = 1.1 * 1.1f64.powi(i);
                let (d, gradient) = distance(&tree, &points, at(r));
                let least = points
                    .iter()
                    .map(|p| radius(&std::array::from_fn(|a| at(r)[a] - f64::from(p[a]))))
                    .fold(f64::INFINITY, f64::min);
                assert!(
                    d > before && d >= least && d - least <= 5e-3 + 1e-14 * r,
                    "{d} after {before}, {least}"
                );
                assert!((radius(&gradient) - 1.0).abs() < 1e-12);
                before = d;
            }
        }
        assert_eq!(radius(&[1e200, 0.0, 1e200]), 2f64.sqrt() * 1e200);
        assert!(radius(&[f64::NAN, 1.0, 0.0]).is_nan() && share(f64::NAN).is_nan());
        assert_eq!(radius(&[f64::INFINITY, 1.0, 0.0]), f64::INFINITY);
        assert_eq!((share(1.04), share(f64::INFINITY)), (0.0, 1.0));
    }
}
