//! Points in slices across an axis or on lines along one, as sections and the tracks of ships leave them.

use crate::geometry::median;
use crate::geometry::vec3::{length, sub};

/// How unevenly points lie; see [`Sampling::uneven`](super::Sampling::uneven).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnisotropicSpacing {
    /// The gap between slices or lines, over the distance between neighbours on them.
    pub ratio: f64,
    /// Factors for the axes that make the points more even, as
    /// [`Hints::anisotropy`](crate::reconstruct::Hints::anisotropy) takes them.
    pub anisotropy: [f64; 3],
}

/// Slices or lines farther apart than this many times the distance between neighbours on them are uneven. Also the
/// factor (lines) or divisor (slices) that is proposed for their axis then, whatever the measured ratio.
const UNEVEN: f64 = 5.0;
/// Points lie in slices across an axis if the median cosine between it and the ways to near neighbours is below this.
const MAX_ACROSS: f64 = 0.15;
/// Points lie on lines along an axis if that cosine is above this.
const MIN_ALONG: f64 = 0.95;

/// How unevenly points (n x 3), each with its `k` nearest in a row of `near` (itself first), lie in slices across an
/// axis or on lines along one; `None` if they do not, or if these are not more than five times as far apart as the
/// points on them.
pub(super) fn uneven(unit: &[[f32; 3]], near: &[u32], k: usize) -> Option<AnisotropicSpacing> {
    let ways: Vec<([f64; 3], f64)> = near
        .chunks_exact(k)
        .map(|row| {
            let way = sub(unit[row[1] as usize], unit[row[0] as usize]).map(f64::from);
            let len = length(way);
            (way.map(|x| x.abs() / len.max(f64::MIN_POSITIVE)), len)
        })
        .collect();
    let along = median(ways.iter().map(|(_, len)| *len).collect());
    let cosines = [0, 1, 2].map(|a| median(ways.iter().map(|(way, _)| way[a]).collect()));
    // The median gap between levels of an axis, if gaps more than twice as wide as neighbours are apart make up most of
    // its length.
    let gap = |axis: usize| {
        let mut levels: Vec<f64> = unit.iter().map(|p| f64::from(p[axis])).collect();
        levels.sort_by(f64::total_cmp);
        let steps: Vec<f64> = levels.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 2.0 * along).collect();
        let length = levels[levels.len() - 1] - levels[0];
        (steps.len() > 1 && steps.iter().sum::<f64>() > 0.6 * length).then(|| median(steps) / along)
    };
    let far = |ratio: &f64| *ratio > UNEVEN;
    let slices = (0..3).filter(|&a| cosines[a] < MAX_ACROSS).find_map(|a| Some((a, gap(a).filter(far)?)));
    let mut anisotropy = [1.0; 3];
    if let Some(line) = (0..3).find(|&a| cosines[a] > MIN_ALONG) {
        let ratio = (0..3).filter(|&a| a != line).find_map(|a| gap(a).filter(far))?;
        anisotropy[line] = UNEVEN;
        return Some(AnisotropicSpacing { ratio, anisotropy });
    }
    let (axis, ratio) = slices?;
    anisotropy[axis] = 1.0 / UNEVEN;
    Some(AnisotropicSpacing { ratio, anisotropy })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{AnalyticShape, KdTree};
    use std::f32::consts::TAU;

    fn of(points: &[[f32; 3]]) -> Option<AnisotropicSpacing> {
        uneven(points, &KdTree::new(points).k_nearest(points, 2), 2)
    }

    /// Five rings of a tube, the points on them 0.0628 apart.
    fn rings(apart: f32) -> Vec<[f32; 3]> {
        let ring = |i: usize| {
            let a = TAU * (i % 100) as f32 / 100.0;
            [a.cos(), a.sin(), apart * (i / 100) as f32]
        };
        (0..500).map(ring).collect()
    }

    #[test]
    fn slices_are_drawn_together_if_they_are_far_apart() {
        let uneven = of(&rings(0.7)).unwrap();
        assert!((uneven.ratio - 0.7 / 0.0628).abs() < 0.2, "{uneven:?}");
        assert_eq!(uneven.anisotropy, [1.0, 1.0, 0.2]);
        assert_eq!(of(&rings(0.3)), None);
    }

    /// Lines along y over hilly ground, measured as a ship does.
    #[test]
    fn lines_are_drawn_out() {
        let line = |i: usize| {
            let (x, y) = ((i / 100) as f32 + 0.02 * (7.0 * i as f32).sin(), 0.1 * (i % 100) as f32);
            [x, y, 0.4 * (0.6 * x).sin() * (0.5 * y).cos()]
        };
        let uneven = of(&(0..1000).map(line).collect::<Vec<_>>()).unwrap();
        assert!(uneven.ratio > 7.0 && uneven.anisotropy == [1.0, 5.0, 1.0], "{uneven:?}");
    }

    #[test]
    fn shapes_that_are_sampled_at_random_are_even() {
        for (name, shape) in AnalyticShape::gallery() {
            for n in [20, 150, 1000] {
                assert_eq!(of(&shape.sample(n, 1).0), None, "{name} {n}");
            }
        }
    }
}
