//! How far apart the points of a cloud are.

use super::KdTree;
use super::vec3::distance;

/// Neighbours that measure the spacing around a point.
const NEIGHBOURS: usize = 7;

/// The spacing around each of n points (n), in their unit: the mean distance to the seven nearest others.
pub(crate) fn spacing(points: &[[f32; 3]]) -> Vec<f64> {
    mean_distances(points, NEIGHBOURS)
}

/// The mean distance of each of n points to its k nearest others (n); to all others if there are fewer, and 0 for a
/// single point.
pub(crate) fn mean_distances(points: &[[f32; 3]], k: usize) -> Vec<f64> {
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
