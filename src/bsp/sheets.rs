//! Nearest points on the same sheet of a surface.

use crate::geometry::KdTree;
use crate::geometry::vec3::dist_sq;

/// The neighbour whose distance is the unit that a turn of the normal is counted in.
const UNIT_NEIGHBOUR: usize = 6;
/// Points in space that the nearest ones on the sheet are chosen from, as a multiple of those asked for.
const CANDIDATES: usize = 4;

/// Finds the nearest of some points, counting a turn of the normal as a distance.
///
/// The distance from p to q is sqrt(|p - q|^2 + (t s)^2 |n_p - n_q|^2), with s the distance from p to its sixth
/// neighbour and t the weight of the turn: with t = 1.5, the other side of a thin plate is three such distances away.
/// Without normals, or with t = 0, it is the distance in space.
pub(super) struct SheetFinder<'a> {
    points: &'a [[f32; 3]],
    normals: Option<&'a [[f32; 3]]>,
    turn: f32,
    tree: KdTree,
}

impl<'a> SheetFinder<'a> {
    /// Among `points` (n x 3) with unit `normals` (n x 3).
    ///
    /// # Panics
    /// If there is no point, or not one normal a point.
    #[track_caller]
    pub fn new(points: &'a [[f32; 3]], normals: Option<&'a [[f32; 3]]>, turn: f32) -> Self {
        assert!(normals.is_none_or(|m| m.len() == points.len()), "SheetFinder: not one normal a point");
        let normals = normals.filter(|_| turn > 0.0);
        SheetFinder { points, normals, turn, tree: KdTree::new(points) }
    }

    /// For each of `queries` (indices of points), the `k` nearest points, itself among them, nearest first (m x k).
    /// They are chosen from the 4 k nearest in space.
    ///
    /// # Panics
    /// If there are fewer than `k` points.
    #[track_caller]
    pub fn k_nearest(&self, queries: &[u32], k: usize) -> Vec<u32> {
        let places: Vec<[f32; 3]> = queries.iter().map(|&i| self.points[i as usize]).collect();
        let Some(normals) = self.normals.filter(|_| k > 0) else {
            return self.tree.k_nearest(&places, k);
        };
        let n = self.points.len();
        let around = (CANDIDATES * k).max(UNIT_NEIGHBOUR + 1).min(n);
        let near = self.tree.k_nearest(&places, around);
        let mut out = Vec::with_capacity(queries.len() * k);
        let mut ranked: Vec<(f32, u32)> = Vec::with_capacity(around);
        for (&query, near) in queries.iter().zip(near.chunks_exact(around)) {
            let (p, m) = (self.points[query as usize], normals[query as usize]);
            let unit_sq = dist_sq(p, self.points[near[UNIT_NEIGHBOUR.min(around - 1)] as usize]);
            let weight = self.turn * self.turn * unit_sq;
            ranked.clear();
            ranked.extend(near.iter().map(|&i| {
                let (q, l) = (self.points[i as usize], normals[i as usize]);
                (dist_sq(p, q) + weight * dist_sq(m, l), i)
            }));
            ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            out.extend(ranked[..k].iter().map(|r| r.1));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::normal;
    use proptest::prelude::*;

    #[test]
    fn stays_on_its_side_of_a_thin_plate() {
        // Two grids of points 0.1 apart, 0.03 from each other, facing away from each other.
        let side = |z: f32| (0..64).map(move |i| [0.1 * (i % 8) as f32, 0.1 * (i / 8) as f32, z]);
        let points: Vec<[f32; 3]> = side(0.0).chain(side(0.03)).collect();
        let normals: Vec<[f32; 3]> = (0..128).map(|i| [0.0, 0.0, if i < 64 { -1.0 } else { 1.0 }]).collect();
        let queries: Vec<u32> = (0..128).collect();
        let sheets = SheetFinder::new(&points, Some(&normals), 1.5).k_nearest(&queries, 6);
        for (i, near) in sheets.chunks_exact(6).enumerate() {
            assert_eq!(near[0], i as u32);
            assert!(near.iter().all(|&j| (j < 64) == (i < 64)), "{i}: {near:?}");
        }
        let mixed = SheetFinder::new(&points, Some(&normals), 0.0).k_nearest(&queries, 6);
        assert_eq!(mixed, KdTree::new(&points).k_nearest(&points, 6));
        assert!(
            mixed.chunks_exact(6).all(|near| near.iter().any(|&j| j < 64) && near.iter().any(|&j| j >= 64))
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn is_the_plain_ranking_of_the_candidates(n in 1usize..40, k in 1usize..10, turn in 0.0f32..3.0, seed: u64) {
            let k = k.min(n);
            let (points, normals) = (normal(&[n, 3], seed).to_points(), normal(&[n, 3], seed ^ 1).to_points());
            let queries: Vec<u32> = (0..n as u32).rev().collect();
            let found = SheetFinder::new(&points, Some(&normals), turn).k_nearest(&queries, k);
            for (&i, found) in queries.iter().zip(found.chunks_exact(k)) {
                let p = points[i as usize];
                let mut space: Vec<(f32, u32)> = (0..n as u32).map(|j| (dist_sq(p, points[j as usize]), j)).collect();
                space.sort_by(|a, b| a.partial_cmp(b).unwrap());
                let unit_sq = space[6.min(n - 1)].0;
                let mut all: Vec<(f32, u32)> = space[..(4 * k).max(7).min(n)]
                    .iter()
                    .map(|&(d, j)| (d + turn * turn * unit_sq * dist_sq(normals[i as usize], normals[j as usize]), j))
                    .collect();
                all.sort_by(|a, b| a.partial_cmp(b).unwrap());
                let want: Vec<u32> = all[..k].iter().map(|a| a.1).collect();
                prop_assert_eq!(found, &want[..]);
            }
        }
    }
}
