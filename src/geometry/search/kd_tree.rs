//! Exact nearest neighbours through a kd-tree.

use kiddo::{ImmutableKdTree, QueryResultItem, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZeroUsize;

/// Queries answered by one task; fixed, so that the work is cut in the same way for any thread count.
const CHUNK: usize = 256;

/// The tree bounds a cell's distance by a sum it updates on the way down, so it may overestimate the bound by a few
/// units in the last place and skip a cell that holds the true nearest point, or one exactly as near. Searches are
/// therefore widened by more than that error, and the answer is chosen among what they return.
const SLACK: f32 = 1.0 + 1e-5;

/// Largest absolute coordinate; squared distances between larger ones can overflow f32.
const MAX_COORDINATE: f32 = 1e18;

type Metric = SquaredEuclidean<f32>;

const TWO: NonZeroUsize = NonZeroUsize::new(2).unwrap();

/// A kd-tree over a fixed set of points. For the nearest point of many queries, a [`PointTree`](super::PointTree) is
/// faster.
///
/// Answers are exact in this sense: the squared distance between two points is `dx*dx + dy*dy + dz*dz` in f32, summed
/// in that order, and points are ranked by (squared distance, index), so among equally near points the one with the
/// smallest index comes first. Duplicates, planes, lines and grids are fine. The answer does not depend on the thread
/// count nor on how queries are grouped. A query costs more where very many points are equally near, such as thousands
/// of copies of one point.
pub struct KdTree {
    tree: ImmutableKdTree<f32, 3>,
    len: usize,
}

impl std::fmt::Debug for KdTree {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("KdTree").field("len", &self.len).finish_non_exhaustive()
    }
}

impl KdTree {
    /// The tree over `points` (n x 3).
    ///
    /// # Panics
    /// If there is no point, more than `u32::MAX` points, or a coordinate that is not finite or beyond 1e18.
    #[track_caller]
    pub fn new(points: &[[f32; 3]]) -> Self {
        assert!(!points.is_empty(), "KdTree::new: no points");
        for (i, p) in points.iter().enumerate() {
            assert!(usable(p), "KdTree::new: point {i} is {p:?}; coordinates must be finite and below 1e18");
        }
        let tree = match ImmutableKdTree::new_from_slice(points) {
            Ok(tree) => tree,
            Err(e) => panic!("KdTree::new: {} points: {e:?}", points.len()),
        };
        KdTree { tree, len: points.len() }
    }

    /// The number of points n, at least 1.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Index of the point nearest to `q` and the squared distance to it.
    ///
    /// # Panics
    /// If `q` is not finite or beyond 1e18.
    #[track_caller]
    pub fn nearest(&self, q: [f32; 3]) -> (u32, f32) {
        check_query(&q);
        // The two nearest in one traversal; only if they are too close to call are all candidates collected and ranked.
        let two = self.tree.query(&q).nearest_n::<Metric>(TWO).execute();
        if two.len() == 2 && two[1].distance <= widen(two[0].distance) {
            let first = self.collect(&q, two[0].distance)[0];
            return (first.item, first.distance);
        }
        (two[0].item, two[0].distance)
    }

    /// For each of `queries` (m x 3), the indices of its `k` nearest points, nearest first (m x k, row-major).
    ///
    /// # Panics
    /// If `k` exceeds the number of points (the caller knows whether fewer neighbours make sense, so nothing is
    /// padded), or if a query is not finite or beyond 1e18.
    #[track_caller]
    pub fn k_nearest(&self, queries: &[[f32; 3]], k: usize) -> Vec<u32> {
        assert!(k <= self.len, "KdTree::k_nearest: {k} neighbours asked of {} points", self.len);
        let mut out = vec![0; queries.len() * k];
        if k == 0 {
            return out;
        }
        out.par_chunks_mut(CHUNK * k).zip(queries.par_chunks(CHUNK)).for_each(|(out, queries)| {
            for (row, &q) in out.chunks_exact_mut(k).zip(queries) {
                for (slot, r) in row.iter_mut().zip(self.k_nearest_one(q, k)) {
                    *slot = r.item;
                }
            }
        });
        out
    }

    /// Indices and squared distances of all points within `radius` of `q` (at most `radius` away), nearest first.
    ///
    /// # Panics
    /// If `radius` is negative or not a number, or if `q` is not finite or beyond 1e18.
    #[track_caller]
    pub fn within(&self, q: [f32; 3], radius: f32) -> Vec<(u32, f32)> {
        assert!(radius >= 0.0, "KdTree::within: radius {radius}");
        check_query(&q);
        let radius_sq = (radius * radius).min(f32::MAX);
        let mut found = self.collect(&q, radius_sq);
        found.retain(|r| r.distance <= radius_sq);
        found.into_iter().map(|r| (r.item, r.distance)).collect()
    }

    /// The `k` nearest to `q`, ranked, `1 <= k <= n`; may return more than `k`.
    fn k_nearest_one(&self, q: [f32; 3], k: usize) -> Vec<QueryResultItem<(), u32, f32>> {
        check_query(&q);
        // One more than asked: if it is clearly farther than the k-th, no tie and no rounding can change the set.
        let ask = NonZeroUsize::MIN.saturating_add(k);
        let mut found = self.tree.query(&q).nearest_n::<Metric>(ask).execute();
        if found.len() > k && found[k].distance <= widen(found[k - 1].distance) {
            found = self.collect(&q, found[k - 1].distance);
        }
        rank(&mut found);
        found
    }

    /// All points within a squared distance of a little more than `radius_sq`, ranked.
    fn collect(&self, q: &[f32; 3], radius_sq: f32) -> Vec<QueryResultItem<(), u32, f32>> {
        let mut found = Vec::new();
        self.tree.query(q).within::<Metric>(widen(radius_sq)).unsorted().visit(|r| found.push(r));
        rank(&mut found);
        found
    }
}

fn rank(found: &mut [QueryResultItem<(), u32, f32>]) {
    found.sort_unstable_by(|a, b| a.distance.total_cmp(&b.distance).then(a.item.cmp(&b.item)));
}

fn widen(dist_sq: f32) -> f32 {
    (dist_sq * SLACK + f32::MIN_POSITIVE).min(f32::MAX)
}

/// Whether distances to the point can be compared: every coordinate is finite and at most 1e18 in size.
pub fn usable(p: &[f32; 3]) -> bool {
    p.iter().all(|x| x.abs() <= MAX_COORDINATE)
}

#[track_caller]
fn check_query(q: &[f32; 3]) {
    assert!(usable(q), "nearest neighbour: query {q:?}; coordinates must be finite and below 1e18");
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::vec3::dist_sq;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    pub fn brute_ranked(points: &[[f32; 3]], q: [f32; 3]) -> Vec<(f32, u32)> {
        let mut all: Vec<_> = points.iter().enumerate().map(|(i, p)| (dist_sq(*p, q), i as u32)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all
    }

    /// Small and awkward point sets: random, duplicated, planar, collinear, on a grid, far from the origin, tiny.
    pub fn point_sets() -> Vec<Vec<[f32; 3]>> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut all = Vec::new();
        let mut random = |n: usize, scale: f32, offset: f32| -> Vec<[f32; 3]> {
            (0..n).map(|_| std::array::from_fn(|_| rng.random_range(-0.5f32..0.5) * scale + offset)).collect()
        };
        for n in 1..=12 {
            all.push(random(n, 1.0, 0.0));
        }
        all.push(random(700, 1.0, 0.0));
        all.push(random(700, 1e-6, 0.0));
        all.push(random(700, 1e6, 0.0));
        all.push(random(700, 10.0, 5e5));
        let points = random(600, 1.0, 0.0);
        all.push(points.iter().map(|p| [p[0], 0.25, p[2]]).collect());
        all.push(points.iter().map(|p| [0.0, p[1], 1.0]).collect());
        all.push(points.iter().chain(&points).chain(&points).copied().collect());
        all.push(vec![[0.5, -0.25, 0.125]; 10_000]);
        all.push((0..1000).map(|i| [(i / 100) as f32, (i / 10 % 10) as f32, (i % 10) as f32]).collect());
        // A grid in scrambled order, so that the smallest index is anywhere.
        all.push(
            (0..1000u32)
                .map(|i| i * 387 % 1000)
                .map(|i| [(i / 100) as f32, (i / 10 % 10) as f32, (i % 10) as f32])
                .collect(),
        );
        all
    }

    pub fn queries_for(points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut rng = ChaCha8Rng::seed_from_u64(points.len() as u64);
        let mut q: Vec<[f32; 3]> = points.iter().step_by(points.len() / 20 + 1).copied().collect();
        for i in 0..60 {
            let a = points[rng.random_range(0..points.len())];
            let b = points[rng.random_range(0..points.len())];
            // Midpoints of a grid tie exactly; the rest are near, in the box, and far outside.
            q.push(std::array::from_fn(|c| 0.5 * (a[c] + b[c])));
            let t = rng.random_range(-2.0f32..3.0);
            q.push(std::array::from_fn(|c| a[c] + t * (b[(c + i) % 3] - a[c])));
            q.push(std::array::from_fn(|c| a[c] + rng.random_range(-0.1f32..0.1)));
        }
        q.push([1e6, -1e6, 1e6]);
        q
    }

    #[test]
    fn nearest_is_brute_force_bit_for_bit() {
        for points in point_sets() {
            let tree = KdTree::new(&points);
            assert_eq!(tree.len(), points.len());
            let queries = queries_for(&points);
            for &q in &queries {
                let (index, dist_sq) = tree.nearest(q);
                let want = brute_ranked(&points, q)[0];
                assert_eq!((dist_sq, index), want, "query {q:?} among {}", points.len());
            }
        }
    }

    #[test]
    fn k_nearest_and_within_are_brute_force() {
        for points in point_sets() {
            let tree = KdTree::new(&points);
            let queries: Vec<_> = queries_for(&points).into_iter().step_by(3).collect();
            for k in [0, 1, 2, 3, 8, 12] {
                if k > points.len() {
                    continue;
                }
                let got = tree.k_nearest(&queries, k);
                assert_eq!(got.len(), queries.len() * k);
                for (j, &q) in queries.iter().enumerate() {
                    let want: Vec<u32> = brute_ranked(&points, q)[..k].iter().map(|x| x.1).collect();
                    assert_eq!(got[j * k..(j + 1) * k], want, "k {k}, query {q:?}, n {}", points.len());
                }
            }
            for &q in queries.iter().step_by(4) {
                let all = brute_ranked(&points, q);
                for radius in [0.0, all[all.len() / 10].0.sqrt(), 1.0] {
                    let want: Vec<_> =
                        all.iter().filter(|x| x.0 <= radius * radius).map(|x| (x.1, x.0)).collect();
                    assert_eq!(tree.within(q, radius), want);
                }
            }
        }
    }

    #[test]
    fn thread_count_changes_nothing() {
        let points = &point_sets()[12];
        let queries: Vec<_> = (0..9).flat_map(|_| queries_for(points)).collect();
        let tree = KdTree::new(points);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| tree.k_nearest(&queries, 5))
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn empty_queries_give_empty_answers() {
        let tree = KdTree::new(&[[0.0; 3]]);
        assert!(tree.k_nearest(&[], 1).is_empty());
        assert_eq!(tree.within([0.0; 3], f32::INFINITY), [(0, 0.0)]);
    }

    #[test]
    #[should_panic(expected = "no points")]
    fn no_points_are_refused() {
        KdTree::new(&[]);
    }

    #[test]
    #[should_panic(expected = "point 1")]
    fn nan_point_is_refused() {
        KdTree::new(&[[0.0; 3], [0.0, f32::NAN, 0.0]]);
    }

    #[test]
    #[should_panic(expected = "query")]
    fn nan_query_is_refused() {
        KdTree::new(&[[0.0; 3]]).nearest([f32::NAN; 3]);
    }

    #[test]
    #[should_panic(expected = "3 neighbours asked of 2 points")]
    fn too_many_neighbours_are_refused() {
        KdTree::new(&[[0.0; 3], [1.0; 3]]).k_nearest(&[[0.0; 3]], 3);
    }
}
