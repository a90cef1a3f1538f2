//! Exact nearest neighbours through a uniform grid, for clouds that are rebuilt at every step.

use super::knn::{KdTree, check_query, nearest_in_chunks, usable};
use super::{Bounds, point_dist_sq};
use std::sync::OnceLock;

/// Rings of cells searched around the query's own cell before the kd-tree takes over.
const MAX_RINGS: i64 = 4;

/// A uniform grid over a fixed set of points, with the same answers as [`KdTree`] bit for bit.
///
/// Building it is one counting sort. A query looks at its own cell and the ones around it, ring by ring, until no
/// unseen cell can hold a nearer point. Queries farther than a few cells from every point go to a [`KdTree`] that is
/// built when the first of them arrives, so that a bad guess costs no more than the tree would have.
#[derive(Debug)]
pub struct NearestGrid {
    /// The points, sorted by cell; within a cell by index.
    sorted: Vec<[f32; 3]>,
    /// Index of each sorted point in the input.
    index: Vec<u32>,
    /// Points of cell `c` are `start[c]..start[c + 1]`.
    start: Vec<u32>,
    dims: [i64; 3],
    min: [f64; 3],
    cell: f64,
    tree: OnceLock<KdTree>,
}

impl NearestGrid {
    /// The grid over `points` (n x 3).
    ///
    /// # Panics
    /// If there is no point, more than `u32::MAX` points, or a coordinate that is not finite or beyond 1e18.
    #[track_caller]
    pub fn new(points: &[[f32; 3]]) -> Self {
        assert!(!points.is_empty(), "NearestGrid::new: no points");
        assert!(u32::try_from(points.len()).is_ok(), "NearestGrid::new: {} points", points.len());
        for (i, p) in points.iter().enumerate() {
            assert!(
                usable(p),
                "NearestGrid::new: point {i} is {p:?}; coordinates must be finite and below 1e18"
            );
        }
        let bounds = Bounds::of(points).expect("finite points have a box");
        // Points on a surface fill about 2 * side^2 cells of a grid of that many cells a side, so this puts two or three
        // in each occupied cell. A volume has fewer in each, which costs little.
        let side = (0.45 * (points.len() as f64).sqrt()).clamp(1.0, 128.0);
        let cell = (bounds.longest() / side).max(1e-30);
        let dims = bounds.size().map(|s| (s / cell) as i64 + 1);
        let mut grid = NearestGrid {
            sorted: vec![[0.0; 3]; points.len()],
            index: vec![0; points.len()],
            start: vec![0; (dims[0] * dims[1] * dims[2]) as usize + 1],
            dims,
            min: bounds.min,
            cell,
            tree: OnceLock::new(),
        };
        let cells: Vec<u32> = points.iter().map(|p| grid.cell_index(grid.cell_of(p)) as u32).collect();
        for &c in &cells {
            grid.start[c as usize] += 1;
        }
        let mut total = 0;
        for s in &mut grid.start {
            total += *s;
            *s = total;
        }
        // Each start is now the end of its cell; placing points from the last to the first moves it back to the start.
        for (i, &c) in cells.iter().enumerate().rev() {
            let at = &mut grid.start[c as usize];
            *at -= 1;
            grid.sorted[*at as usize] = points[i];
            grid.index[*at as usize] = i as u32;
        }
        grid
    }

    /// Index of the point nearest to `q` and the squared distance to it; the smallest index among equally near ones.
    ///
    /// # Panics
    /// If `q` is not finite or beyond 1e18.
    #[track_caller]
    pub fn nearest(&self, q: [f32; 3]) -> (u32, f32) {
        check_query(&q);
        let center = self.cell_of(&q);
        let mut best = (f32::INFINITY, u32::MAX);
        for ring in 1..=MAX_RINGS {
            self.scan_ring(&q, center, ring, &mut best);
            if f64::from(best.0) < self.unseen_sq(&q, center, ring) {
                return (best.1, best.0);
            }
        }
        self.tree.get_or_init(|| KdTree::new(&self.in_input_order())).nearest(q)
    }

    /// For each of `queries` (m x 3), the index of the nearest point (m) and the squared distance to it (m).
    ///
    /// # Panics
    /// If a query is not finite or beyond 1e18.
    pub fn nearest_all(&self, queries: &[[f32; 3]]) -> (Vec<u32>, Vec<f32>) {
        nearest_in_chunks(queries, |q| self.nearest(q))
    }

    fn cell_of(&self, p: &[f32; 3]) -> [i64; 3] {
        std::array::from_fn(|a| {
            (((f64::from(p[a]) - self.min[a]) / self.cell) as i64).clamp(0, self.dims[a] - 1)
        })
    }

    fn cell_index(&self, c: [i64; 3]) -> usize {
        ((c[2] * self.dims[1] + c[1]) * self.dims[0] + c[0]) as usize
    }

    /// Looks at the cells `ring` away from `center` (for ring 1: the cell itself too).
    fn scan_ring(&self, q: &[f32; 3], center: [i64; 3], ring: i64, best: &mut (f32, u32)) {
        let low = center.map(|c| (c - ring).max(0));
        let high: [i64; 3] = std::array::from_fn(|a| (center[a] + ring).min(self.dims[a] - 1));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                let inner = ring > 1 && (z - center[2]).abs() < ring && (y - center[1]).abs() < ring;
                if !inner {
                    // Cells of a row are neighbours in memory, so a whole row is one range.
                    self.scan_row(q, [low[0], y, z], high[0], best);
                } else {
                    for x in [center[0] - ring, center[0] + ring] {
                        if (0..self.dims[0]).contains(&x) {
                            self.scan_row(q, [x, y, z], x, best);
                        }
                    }
                }
            }
        }
    }

    fn scan_row(&self, q: &[f32; 3], first: [i64; 3], last_x: i64, best: &mut (f32, u32)) {
        let c = self.cell_index(first);
        let range = self.start[c] as usize..self.start[c + (last_x - first[0]) as usize + 1] as usize;
        for (p, &i) in self.sorted[range.clone()].iter().zip(&self.index[range]) {
            let d = point_dist_sq(p, q);
            if d < best.0 || (d == best.0 && i < best.1) {
                *best = (d, i);
            }
        }
    }

    /// A lower bound of the squared distance, as f32 would compute it, to every point not in the rings up to `ring`.
    fn unseen_sq(&self, q: &[f32; 3], center: [i64; 3], ring: i64) -> f64 {
        let mut bound = f64::INFINITY;
        for a in 0..3 {
            let x = f64::from(q[a]) - self.min[a];
            if center[a] - ring > 0 {
                bound = bound.min(x - (center[a] - ring) as f64 * self.cell);
            }
            if center[a] + ring + 1 < self.dims[a] {
                bound = bound.min((center[a] + ring + 1) as f64 * self.cell - x);
            }
        }
        // Less the rounding of the cell's border and of the squared distance.
        let bound = (bound - 1e-9 * self.cell * self.dims.iter().sum::<i64>() as f64).max(0.0);
        bound * bound * (1.0 - 1e-5)
    }

    fn in_input_order(&self) -> Vec<[f32; 3]> {
        let mut points = vec![[0.0; 3]; self.sorted.len()];
        for (p, &i) in self.sorted.iter().zip(&self.index) {
            points[i as usize] = *p;
        }
        points
    }
}

#[cfg(test)]
mod tests {
    use super::super::knn::tests::{brute_ranked, clouds, queries_for};
    use super::*;

    #[test]
    fn nearest_is_brute_force_bit_for_bit() {
        for points in clouds() {
            let grid = NearestGrid::new(&points);
            let queries = queries_for(&points);
            let (index, dist_sq) = grid.nearest_all(&queries);
            for (j, &q) in queries.iter().enumerate() {
                let want = brute_ranked(&points, q)[0];
                assert_eq!((dist_sq[j], index[j]), want, "query {q:?} among {}", points.len());
            }
        }
    }

    #[test]
    fn far_queries_reach_the_tree_and_near_ones_do_not() {
        let points = crate::geometry::fibonacci_sphere(3000);
        let grid = NearestGrid::new(&points);
        grid.nearest_all(&points);
        assert!(grid.tree.get().is_none());
        let q = [0.01, 0.02, 0.03];
        assert_eq!(grid.nearest(q), KdTree::new(&points).nearest(q));
        assert!(grid.tree.get().is_some());
    }

    #[test]
    #[should_panic(expected = "no points")]
    fn empty_cloud_is_refused() {
        NearestGrid::new(&[]);
    }

    #[test]
    #[should_panic(expected = "query")]
    fn nan_query_is_refused() {
        NearestGrid::new(&[[0.0; 3]]).nearest([0.0, f32::NAN, 0.0]);
    }
}
