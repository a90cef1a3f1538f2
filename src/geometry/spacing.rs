//! How far apart points are. There are several such lengths, each with a name of its own:
//!
//! - the *nearest distance* of a point is that to the nearest other point ([`nearest_distances`]);
//! - the *neighbour spacing* of a point is the mean distance to its seven nearest others ([`neighbour_spacing`]); the
//!   *median spacing* of n points is the median of it;
//! - the *area spacing* of a point is the side of the square of surface that it stands for ([`area_spacing`]);
//! - the *line distance* is how far the lines of a scanner lie from each other, points along which are much closer
//!   ([`evened`](super::evened));
//! - the *surface spacing* is the area spacing, or the line distance where there are such lines
//!   ([`surface_spacing`](super::surface_spacing)); `--trim` cuts by it.
//!
//! The `spacing` of a grid is something else: the side of its cubes.

use super::KdTree;
use super::vec3::distance;

/// The number of nearest points that the neighbour spacing is the mean distance to.
const NEIGHBOURS: usize = 7;
/// The number of nearest points whose farthest tells the area spacing.
pub(super) const AREA_NEIGHBOURS: usize = 24;

/// The mean distance of each of n points to its seven nearest others (n), in their unit.
pub(crate) fn neighbour_spacing(points: &[[f32; 3]]) -> Vec<f64> {
    mean_distances(points, NEIGHBOURS)
}

/// The distance of each of n points to its nearest other (n), in their unit; 0 for a single point.
pub(crate) fn nearest_distances(points: &[[f32; 3]]) -> Vec<f64> {
    mean_distances(points, 1)
}

/// The mean distance of each of n points to its k nearest others (n); to all others if there are fewer, and 0 for a
/// single point.
fn mean_distances(points: &[[f32; 3]], k: usize) -> Vec<f64> {
    if points.is_empty() {
        return Vec::new();
    }
    // Each point is among its own nearest.
    let k = (k + 1).min(points.len());
    let index = KdTree::new(points).k_nearest(points, k);
    let mean = |(i, row): (usize, &[u32])| {
        row.iter().map(|&j| distance(points[i], points[j as usize])).sum::<f64>() / (k - 1).max(1) as f64
    };
    index.chunks_exact(k).enumerate().map(mean).collect()
}

/// The root of the area that each of n points stands for (n), in their unit: r sqrt(pi / k) with the distance r to the
/// k-th nearest point, k = 24 (fewer if there are fewer points), as if these lay evenly on a disc around it.
pub(super) fn area_spacing(points: &[[f32; 3]]) -> Vec<f64> {
    // Each point is the nearest to itself.
    let k = AREA_NEIGHBOURS.min(points.len() - 1);
    let near = KdTree::new(points).k_nearest(points, k + 1);
    let share = (std::f64::consts::PI / k as f64).sqrt();
    let one = |(p, near): (&[f32; 3], &[u32])| share * distance(*p, points[near[k] as usize]);
    points.iter().zip(near.chunks_exact(k + 1)).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fibonacci_sphere;

    /// Points 1 apart on a line: to the seven nearest it is 1 1 2 2 3 3 4 from the middle, 1 to 7 from an end.
    #[test]
    fn distances_on_a_line_are_hand_checkable() {
        let line: Vec<[f32; 3]> = (0..20).map(|i| [i as f32, 0.0, 0.0]).collect();
        assert_eq!(nearest_distances(&line), [1.0; 20]);
        let spacing = neighbour_spacing(&line);
        assert_eq!([spacing[0], spacing[10]], [4.0, 16.0 / 7.0]);
        assert_eq!(neighbour_spacing(&line[..3]), [1.5, 1.0, 1.5]);
        assert_eq!((neighbour_spacing(&line[..1]), nearest_distances(&[])), (vec![0.0], vec![]));
    }

    /// Even points on a sphere have equal shares of its area. The nearest others are nearly as far as in hexagons.
    #[test]
    fn the_area_spacing_is_the_root_of_the_area_of_a_point() {
        for n in [300, 2000] {
            let points = fibonacci_sphere(n);
            let root = (4.0 * std::f64::consts::PI / n as f64).sqrt();
            for (area, nearest) in area_spacing(&points).iter().zip(nearest_distances(&points)) {
                assert!((area / root - 1.0).abs() < 0.15, "{area} is not {root}");
                assert!((0.7..1.1).contains(&(nearest / root)), "{nearest} of {root}");
            }
        }
    }
}
