//! Whether a point cloud can be reconstructed at all.

use std::cmp::Ordering;
use std::collections::HashSet;

use nalgebra::Vector3;

use super::{Position, PrincipalAxes, are_f32, mean_point, spread};
use crate::{Error, ErrorKind};

/// The smallest extent of a solid cloud against its largest.
const MIN_EXTENT_RATIO: f64 = 1e-6;

/// A cloud that passed [`clean_cloud`]: finite, distinct points that span three dimensions.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct CleanCloud {
    /// The distinct points, n x 3, exactly as given and, unless [`sorted`](Self::sorted), in their first order of
    /// appearance.
    pub points: Vec<[f64; 3]>,
    /// The index of each of `points` in the cloud that was given, n; ascending unless sorted.
    pub given: Vec<u32>,
    /// How many points were left out because an earlier one lies at the same place.
    pub duplicates_merged: usize,
    /// The lengths of the cloud along its principal axes, largest first, in the points' unit.
    pub extents: [f64; 3],
}

impl CleanCloud {
    /// The same points ordered by x, then y, then z, so that the same points in another order are the same cloud.
    pub fn sorted(mut self) -> CleanCloud {
        // Adding 0 turns -0 into 0.
        let key = |p: &[f64; 3]| p.map(|x| x + 0.0);
        let mut order: Vec<u32> = (0..self.points.len() as u32).collect();
        order.sort_by(|&i, &j| {
            let (a, b) = (key(&self.points[i as usize]), key(&self.points[j as usize]));
            (0..3).map(|axis| a[axis].total_cmp(&b[axis])).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
        });
        self.points = order.iter().map(|&i| self.points[i as usize]).collect();
        self.given = order.iter().map(|&i| self.given[i as usize]).collect();
        self
    }
}

/// Merges exact duplicates of n x 3 `points` and refuses clouds that enclose nothing.
///
/// The cloud counts as flat if its extent along the smallest principal axis is below 1e-6 of the largest, or below
/// what rounding at the size of the coordinates produces by itself: rounding to 32 bits where these hold all
/// coordinates exactly, else to 64. The test moves and scales with the cloud.
///
/// # Errors
///
/// [`ErrorKind::Data`] for no points, a coordinate that is not finite or beyond the range of 32-bit floats (with the
/// number of the point, from 0), fewer than 4 distinct points, or all points on one line or in one plane.
pub fn clean_cloud<P: Position>(points: &[P]) -> Result<CleanCloud, Error> {
    if points.is_empty() {
        return Err(data("there are no points").advise("give at least 4 points, better a few hundred"));
    }
    if let Some(i) = points.iter().position(|p| p.wide().iter().any(|&x| !(x as f32).is_finite())) {
        let [x, y, z] = points[i].wide();
        return Err(data(format!("({x}, {y}, {z}) is not finite"))
            .at_element(format!("point {i}"))
            .advise("remove or repair it (points are counted from 0)"));
    }

    let mut seen = HashSet::with_capacity(points.len());
    // Adding 0 turns -0 into 0, so that points at the same place compare equal as bits.
    let (given, distinct): (Vec<u32>, Vec<[f64; 3]>) = (0..)
        .zip(points.iter().map(|p| p.wide()))
        .filter(|(_, p)| seen.insert(p.map(|x| (x + 0.0).to_bits())))
        .unzip();
    let n = distinct.len();
    if n < 4 {
        return Err(data(format!("{} points have only {n} distinct positions", points.len()))
            .advise("give at least 4 distinct points, better a few hundred"));
    }

    let extents = principal_extents(&distinct);
    let size = distinct.as_flattened().iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let step = if are_f32(&distinct) { f64::from(f32::EPSILON) } else { f64::EPSILON };
    // Each coordinate is off by at most half a step at `size`; both ends of an extent, in three axes, may add up.
    let least = (MIN_EXTENT_RATIO * extents[0]).max(2.0 * step * size);
    if extents[2] < least {
        let place = if extents[1] < least { "on one line" } else { "in one plane" };
        return Err(data(format!(
            "all {n} distinct points lie {place}: they extend {:.3e} x {:.3e} x {:.3e}",
            extents[0], extents[1], extents[2]
        ))
        .advise(
            "a closed surface needs points on all of its sides; if the coordinates carry a large common offset and were \
             stored as 32-bit floats, store them in 64 bits or subtract it first",
        ));
    }
    Ok(CleanCloud { duplicates_merged: points.len() - n, points: distinct, given, extents })
}

/// How many different places `points` (n x 3) have once each coordinate is rounded to the nearest multiple of `step`,
/// halves to the even one; `step` is in the points' unit.
///
/// # Panics
/// If `step` is not positive.
///
/// ```
/// use bijective_sdf::geometry::distinct_places;
///
/// let points = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.04], [0.0, 0.0, 0.06], [0.0, 0.1, 0.0]];
/// assert_eq!(distinct_places(&points, 0.1), 3);
/// ```
#[track_caller]
pub fn distinct_places(points: &[[f32; 3]], step: f64) -> usize {
    assert!(step > 0.0, "distinct_places: step {step}");
    // Adding 0 turns -0 into 0, so that the same place is the same bits.
    let place = |p: &[f32; 3]| p.map(|x| ((f64::from(x) / step).round_ties_even() + 0.0).to_bits());
    points.iter().map(place).collect::<HashSet<_>>().len()
}

/// The lengths of the cloud along the axes of its covariance, largest first.
///
/// Lengths, not standard deviations: a single point off the plane of a million others still counts in full. Points are
/// taken from their mean, so a large offset cancels exactly enough.
fn principal_extents(points: &[[f64; 3]]) -> [f64; 3] {
    let wide = |p: &[f64; 3]| Vector3::from(*p);
    let count = points.len() as f64;
    let mean = mean_point(points.iter().map(wide));
    // Scaling by the largest coordinate keeps squares of tiny and huge clouds inside the range of `f64`.
    let scale = points.iter().map(|p| (wide(p) - mean).amax()).fold(0.0, f64::max);
    if scale == 0.0 {
        return [0.0; 3];
    }
    let covariance = spread(points.iter().map(|p| ((wide(p) - mean) / scale, 1.0))) / count;
    let axes = PrincipalAxes::of_spread(covariance).directions;
    let mut extents = [0, 1, 2].map(|a| {
        let axis = axes.column(a);
        let (low, high) = points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
            let at = axis.dot(&(wide(p) - mean));
            (low.min(at), high.max(at))
        });
        high - low
    });
    extents.sort_by(|a, b| b.total_cmp(a));
    extents
}

fn data(message: impl Into<String>) -> Error {
    Error::new(ErrorKind::Data, message)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CORNERS: [[f32; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    fn message(points: &[[f32; 3]]) -> String {
        let e = clean_cloud(points).unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Data);
        assert!(e.advice().is_some());
        e.to_string()
    }

    #[test]
    fn duplicates_merge_and_the_first_order_stays() {
        let [a, b, c, d] = CORNERS;
        let clean = clean_cloud(&[d, a, d, b, [-0.0, 0.0, -0.0], c, b, d]).unwrap();
        assert_eq!(clean.points, [d, a, b, c].map(Position::wide));
        assert_eq!((clean.given, clean.duplicates_merged), (vec![0, 1, 3, 5], 4));
        assert!(clean.extents[0] >= clean.extents[2] && clean.extents[2] > 0.1);
    }

    #[test]
    fn sorted_clouds_have_forgotten_their_order() {
        let [a, b, c, d] = CORNERS;
        let clean = clean_cloud(&[d, c, d, b, a, b]).unwrap().sorted();
        assert_eq!(clean.points, [a, d, c, b].map(Position::wide));
        assert_eq!((clean.given, clean.duplicates_merged), (vec![4, 0, 1, 3], 2));
    }

    #[test]
    fn small_clouds_of_every_size_are_judged() {
        assert!(message(&[]).contains("no points"));
        for n in 1..12 {
            assert!(message(&vec![[1e6, -1.0, 3.0]; n]).contains("only 1 distinct"));
            let line: Vec<[f32; 3]> = (0..n).map(|i| [i as f32, 2.0 * i as f32, 5.0]).collect();
            let text = message(&line);
            assert!(text.contains(if n < 4 { "distinct" } else { "on one line" }), "{text}");
        }
        for n in 1..12_usize {
            let cloud: Vec<[f32; 3]> = CORNERS.iter().copied().cycle().take(n).collect();
            assert_eq!(clean_cloud(&cloud).is_ok(), n >= 4);
        }
        let mut bad = CORNERS;
        bad[2][1] = f32::NEG_INFINITY;
        assert!(message(&bad).contains("point 2: (0, -inf, 0) is not finite"));
    }

    #[test]
    fn extremes_of_f32_neither_overflow_nor_vanish() {
        for scale in [f32::MAX, 1e30, 1e-30, 1e-40] {
            assert!(clean_cloud(&CORNERS.map(|p| p.map(|x| x * scale))).is_ok(), "{scale:e}");
        }
    }

    #[test]
    fn one_point_off_the_plane_of_many_is_enough() {
        let mut cloud: Vec<[f32; 3]> =
            (0..10_000).map(|i| [(i % 100) as f32, (i / 100) as f32, 0.0]).collect();
        assert!(message(&cloud).contains("in one plane"));
        cloud.push([50.0, 50.0, 0.01]);
        assert!(clean_cloud(&cloud).is_ok());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// A tilted plane rounded to f32 is found at any offset and scale; the same cloud with depth is accepted.
        #[test]
        fn planes_are_found_wherever_they_lie(
            flat in prop::collection::vec((-1.0..1.0_f64, -1.0..1.0_f64), 12..40),
            (p, q) in (0.0..3.0_f64, 0.0..3.0_f64),
            offset in prop::array::uniform3(-1000.0..1000.0_f64),
            scale in 1e-3..1e3_f64,
        ) {
            let u = [p.cos(), p.sin() * q.cos(), p.sin() * q.sin()];
            let v = [-p.sin(), p.cos() * q.cos(), p.cos() * q.sin()];
            let w = [0.0, -q.sin(), q.cos()];
            let place = |depth: f64| -> Vec<[f32; 3]> {
                flat.iter().enumerate().map(|(i, &(s, t))| {
                    let d = depth * [0.0, 1.0, -1.0][i % 3];
                    [0, 1, 2].map(|a| ((s * u[a] + t * v[a] + d * w[a] + offset[a]) * scale) as f32)
                }).collect()
            };
            prop_assert!(clean_cloud(&place(0.0)).is_err());
            prop_assert!(clean_cloud(&place(0.2)).is_ok());
        }
    }
}
