//! The nearest point for many queries at once.
//!
//! A [`KdTree`](super::KdTree) answers queries one by one. Here the queries are sorted into a tree, too, and those of
//! one leaf go down the other tree together: the loops run over queries side by side, neighbouring queries touch the
//! same memory, and each group starts from what the one before it found, so most of the tree is never entered.
// A loop over lanes indexes several arrays at once; written with iterators and closures it was not vectorised.
#![allow(clippy::needless_range_loop)]

use super::kd_tree::usable;
use rayon::prelude::*;

/// Points in a leaf, and queries that go down the tree together.
const LANES: usize = 8;
/// Leaves of queries answered by one task; fixed, so that the work is cut in the same way for any thread count.
const CHUNK: usize = 32;
/// Trees of fewer leaves are built by one task.
const FORK: usize = 128;

type Lanes = [f32; LANES];

/// A point on its way into the tree.
#[derive(Clone, Copy)]
struct Item {
    at: [f32; 3],
    id: u32,
}

/// The box around a subtree, and the smallest index in it.
#[derive(Clone, Copy)]
struct Node {
    low: [f32; 3],
    high: [f32; 3],
    first_id: u32,
}

/// A leaf: `LANES` points, coordinate by coordinate. In the last one, unused places are at infinity.
#[derive(Clone, Copy)]
struct Leaf {
    at: [Lanes; 3],
    id: [u32; LANES],
}

/// A subtree: its node, its first leaf, and how many leaves it has. Nodes are stored parent, left, right; the left half
/// has `leaves / 2` leaves and so twice that less one nodes.
#[derive(Clone, Copy)]
struct Subtree {
    node: u32,
    leaf: u32,
    leaves: u32,
}

impl Subtree {
    fn halves(self) -> [Subtree; 2] {
        let Subtree { node, leaf, leaves } = self;
        let left = leaves / 2;
        [
            Subtree { node: node + 1, leaf, leaves: left },
            Subtree { node: node + 2 * left, leaf: leaf + left, leaves: leaves - left },
        ]
    }
}

/// Points sorted in space, to find for each point of one set the nearest of another.
///
/// Answers are exact: the squared distance between two points is `dx*dx + dy*dy + dz*dz` in f32, summed in that order,
/// and among equally near points the one with the smallest index is found. Duplicates, planes, lines and grids are
/// fine, and so are sets that are far from each other. The answer does not depend on the thread count.
pub struct PointTree {
    nodes: Vec<Node>,
    leaves: Vec<Leaf>,
    len: usize,
}

impl std::fmt::Debug for PointTree {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PointTree").field("len", &self.len).finish_non_exhaustive()
    }
}

/// For each of `from` (n x 3), the index of the nearest of `to` (m x 3) and the squared distance to it (n each).
///
/// # Panics
/// If `to` is empty, or a coordinate is not finite or beyond 1e18.
///
/// ```
/// use bijective_sdf::geometry::nearest_points;
///
/// let (index, dist_sq) = nearest_points(&[[0.0; 3], [4.0, 0.0, 0.0]], &[[1.0, 0.0, 0.0], [6.0, 0.0, 0.0]]);
/// assert_eq!((index, dist_sq), (vec![0, 1], vec![1.0, 4.0]));
/// ```
#[track_caller]
pub fn nearest_points(from: &[[f32; 3]], to: &[[f32; 3]]) -> (Vec<u32>, Vec<f32>) {
    let tree = PointTree::new(to);
    if from.is_empty() { (Vec::new(), Vec::new()) } else { tree.nearest(&PointTree::new(from)) }
}

impl PointTree {
    /// The tree of `points` (n x 3).
    ///
    /// # Panics
    /// If there is no point, `u32::MAX` points or more, or a coordinate that is not finite or beyond 1e18.
    #[track_caller]
    pub fn new(points: &[[f32; 3]]) -> Self {
        assert!(!points.is_empty(), "PointTree::new: no points");
        assert!(points.len() < u32::MAX as usize, "PointTree::new: {} points do not fit u32", points.len());
        let check = |(id, &at): (u32, &[f32; 3])| {
            assert!(usable(&at), "PointTree::new: point {id} is {at:?}; use finite coordinates below 1e18");
            Item { at, id }
        };
        let mut items: Vec<Item> = (0..).zip(points).map(check).collect();
        let count = items.len().div_ceil(LANES);
        let mut nodes = vec![Node { low: [0.0; 3], high: [0.0; 3], first_id: 0 }; 2 * count - 1];
        let mut leaves = vec![Leaf { at: [[f32::INFINITY; LANES]; 3], id: [u32::MAX; LANES] }; count];
        build(&mut items, &mut nodes, &mut leaves);
        PointTree { nodes, leaves, len: points.len() }
    }

    /// The number of points n, at least 1.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.len
    }

    /// For each point of `queries` (m), in the order in which they were given, the index of the nearest point of this
    /// tree (m) and the squared distance to it (m).
    pub fn nearest(&self, queries: &PointTree) -> (Vec<u32>, Vec<f32>) {
        let mut found = vec![([0; LANES], [0.0; LANES]); queries.leaves.len()];
        found.par_chunks_mut(CHUNK).zip(queries.leaves.par_chunks(CHUNK)).for_each(|(found, leaves)| {
            let mut start = self.leaf_near(leaves[0].at.map(|a| a[0]));
            let mut pending = Vec::with_capacity(32);
            for (found, leaf) in found.iter_mut().zip(leaves) {
                *found = self.search(&leaf.filled(), &mut start, &mut pending);
            }
        });
        let mut index = vec![0; queries.len];
        let mut dist_sq = vec![0.0; queries.len];
        let ids = queries.leaves.iter().flat_map(|leaf| leaf.id);
        let answers = found.iter().flat_map(|(id, d)| id.iter().zip(d));
        for (query, (&id, &d)) in ids.zip(answers).take(queries.len) {
            (index[query as usize], dist_sq[query as usize]) = (id, d);
        }
        (index, dist_sq)
    }

    fn root(&self) -> Subtree {
        Subtree { node: 0, leaf: 0, leaves: self.leaves.len() as u32 }
    }

    /// A leaf that is near `q`.
    fn leaf_near(&self, q: [f32; 3]) -> u32 {
        let mut at = self.root();
        while at.leaves > 1 {
            let [left, right] = at.halves();
            at = if self.gap_sq(left, q) <= self.gap_sq(right, q) { left } else { right };
        }
        at.leaf
    }

    /// Squared distance from `q` to the box of a subtree.
    fn gap_sq(&self, at: Subtree, q: [f32; 3]) -> f32 {
        gap_sq(&self.nodes[at.node as usize], q)
    }

    /// The nearest point of each of `LANES` queries. The search begins in the leaf `start` and leaves there the last
    /// leaf it looked into.
    #[inline(never)] // Alone, its loops are vectorised; inside the caller's closure they were not.
    fn search(&self, q: &[Lanes; 3], start: &mut u32, pending: &mut Vec<Subtree>) -> ([u32; LANES], Lanes) {
        let began = *start;
        let mut best = Best { dist_sq: [f32::INFINITY; LANES], leaf: [began; LANES] };
        self.scan(began, q, &mut best);
        let lead = q.map(|q| q[0]);
        pending.clear();
        pending.push(self.root());
        while let Some(next) = pending.pop() {
            let mut at = Some(next).filter(|&next| self.matters(next, q, &best));
            while let Some(here) = at {
                if here.leaves == 1 {
                    if here.leaf != began {
                        self.scan(here.leaf, q, &mut best);
                        *start = here.leaf;
                    }
                    break;
                }
                let [left, right] = here.halves();
                at = match (self.matters(left, q, &best), self.matters(right, q, &best)) {
                    (false, false) => None,
                    (true, false) => Some(left),
                    (false, true) => Some(right),
                    (true, true) => {
                        let in_order = self.gap_sq(left, lead) <= self.gap_sq(right, lead);
                        let (near, far) = if in_order { (left, right) } else { (right, left) };
                        pending.push(far);
                        Some(near)
                    }
                };
            }
        }
        let id = std::array::from_fn(|l| {
            self.first_at(best.leaf[l], [q[0][l], q[1][l], q[2][l]], best.dist_sq[l])
        });
        (id, best.dist_sq)
    }

    /// Whether a subtree may hold something nearer to any of the queries, or as near with a smaller index.
    ///
    /// Rounding is monotonic, so the computed distance to a box is never more than that to a point in it.
    #[inline(always)]
    fn matters(&self, at: Subtree, q: &[Lanes; 3], best: &Best) -> bool {
        let node = &self.nodes[at.node as usize];
        let (mut nearer, mut level) = (false, false);
        for l in 0..LANES {
            let gap = gap_sq(node, [q[0][l], q[1][l], q[2][l]]);
            nearer |= gap < best.dist_sq[l];
            level |= gap == best.dist_sq[l];
        }
        nearer || (level && self.may_break_tie(node, q, best))
    }

    #[cold]
    fn may_break_tie(&self, node: &Node, q: &[Lanes; 3], best: &Best) -> bool {
        (0..LANES).any(|l| {
            let (q, d) = (q.map(|q| q[l]), best.dist_sq[l]);
            gap_sq(node, q) == d && node.first_id < self.first_at(best.leaf[l], q, d)
        })
    }

    /// Compares the queries with the points of a leaf that they were not compared with before.
    #[inline(always)]
    fn scan(&self, leaf: u32, q: &[Lanes; 3], best: &mut Best) {
        let least = self.leaves[leaf as usize].least_sq(q);
        let (mut nearer, mut level) = (false, false);
        for l in 0..LANES {
            nearer |= least[l] < best.dist_sq[l];
            level |= least[l] == best.dist_sq[l];
        }
        if level {
            self.break_ties(leaf, q, &least, best);
        }
        if nearer {
            for l in 0..LANES {
                let nearer = least[l] < best.dist_sq[l];
                best.leaf[l] = if nearer { leaf } else { best.leaf[l] };
                best.dist_sq[l] = if nearer { least[l] } else { best.dist_sq[l] };
            }
        }
    }

    #[cold]
    fn break_ties(&self, leaf: u32, q: &[Lanes; 3], least: &Lanes, best: &mut Best) {
        for l in 0..LANES {
            let (q, d) = (q.map(|q| q[l]), least[l]);
            if d == best.dist_sq[l] && self.first_at(leaf, q, d) < self.first_at(best.leaf[l], q, d) {
                best.leaf[l] = leaf;
            }
        }
    }

    /// The smallest index in a leaf at a squared distance from `q`.
    fn first_at(&self, leaf: u32, q: [f32; 3], dist_sq: f32) -> u32 {
        let leaf = &self.leaves[leaf as usize];
        let mut first = u32::MAX;
        for (p, &id) in leaf.id.iter().enumerate() {
            let at = [leaf.at[0][p], leaf.at[1][p], leaf.at[2][p]];
            if crate::geometry::vec3::dist_sq(at, q) == dist_sq {
                first = first.min(id);
            }
        }
        first
    }
}

/// The least squared distance of each query so far, and the leaf in which it was found.
struct Best {
    dist_sq: Lanes,
    leaf: [u32; LANES],
}

impl Leaf {
    /// The points as queries; the first one stands in unused places.
    fn filled(&self) -> [Lanes; 3] {
        self.at.map(|a| a.map(|x| if x < f32::INFINITY { x } else { a[0] }))
    }

    /// The squared distance from each query to the nearest point of the leaf.
    #[inline(always)]
    fn least_sq(&self, q: &[Lanes; 3]) -> Lanes {
        let mut least = [f32::INFINITY; LANES];
        for p in 0..LANES {
            for l in 0..LANES {
                let d: [f32; 3] = std::array::from_fn(|i| self.at[i][p] - q[i][l]);
                least[l] = smaller(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], least[l]);
            }
        }
        least
    }
}

/// `f32::min` without its care for NaN, which takes several instructions.
#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Squared distance from a point to a box.
#[inline(always)]
fn gap_sq(node: &Node, q: [f32; 3]) -> f32 {
    let d: [f32; 3] = std::array::from_fn(|i| larger(larger(node.low[i] - q[i], q[i] - node.high[i]), 0.0));
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

/// Halves the items along the longest side of their box, down to full leaves.
fn build(items: &mut [Item], nodes: &mut [Node], leaves: &mut [Leaf]) {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for item in &*items {
        for i in 0..3 {
            low[i] = smaller(item.at[i], low[i]);
            high[i] = larger(item.at[i], high[i]);
        }
    }
    let (node, nodes) = nodes.split_first_mut().expect("a tree has a root");
    if let [leaf] = leaves {
        for (l, item) in items.iter().enumerate() {
            for (lanes, x) in leaf.at.iter_mut().zip(item.at) {
                lanes[l] = x;
            }
            leaf.id[l] = item.id;
        }
        *node = Node { low, high, first_id: items.iter().fold(u32::MAX, |m, item| m.min(item.id)) };
        return;
    }
    let side = |i: usize| high[i] - low[i];
    let axis = (1..3).fold(0, |axis, i| if side(i) > side(axis) { i } else { axis });
    let left = leaves.len() / 2;
    items.select_nth_unstable_by(left * LANES, |a, b| a.at[axis].total_cmp(&b.at[axis]));
    let (items_l, items_r) = items.split_at_mut(left * LANES);
    let (nodes_l, nodes_r) = nodes.split_at_mut(2 * left - 1);
    let (leaves_l, leaves_r) = leaves.split_at_mut(left);
    if left >= FORK {
        rayon::join(|| build(items_l, nodes_l, leaves_l), || build(items_r, nodes_r, leaves_r));
    } else {
        build(items_l, nodes_l, leaves_l);
        build(items_r, nodes_r, leaves_r);
    }
    *node = Node { low, high, first_id: nodes_l[0].first_id.min(nodes_r[0].first_id) };
}

#[cfg(test)]
mod tests {
    use super::super::kd_tree::tests::{brute_ranked, point_sets, queries_for};
    use super::*;

    #[test]
    fn nearest_is_brute_force_bit_for_bit() {
        for points in point_sets() {
            let tree = PointTree::new(&points);
            assert_eq!(tree.len(), points.len());
            let queries = queries_for(&points);
            // Groups of every size, alone and together, in any order.
            for queries in [&queries[..], &queries[3..4], &queries[5..14], &queries[10..26]] {
                let (index, dist_sq) = tree.nearest(&PointTree::new(queries));
                for (j, &q) in queries.iter().enumerate() {
                    let want = brute_ranked(&points, q)[0];
                    assert_eq!((dist_sq[j], index[j]), want, "query {q:?} among {}", points.len());
                }
            }
        }
    }

    #[test]
    fn every_set_finds_itself_and_the_others() {
        let small: Vec<_> = point_sets().into_iter().filter(|c| c.len() <= 1000).collect();
        for (i, a) in small.iter().enumerate() {
            let b = &small[(i + 5) % small.len()];
            let (index, dist_sq) = nearest_points(a, b);
            for ((&i, &d), &q) in index.iter().zip(&dist_sq).zip(a) {
                assert_eq!((d, i), brute_ranked(b, q)[0]);
            }
            assert!(nearest_points(a, a).1.iter().all(|&d| d == 0.0));
        }
    }

    /// What the search relies on: boxes hold their points, nothing is lost, and only the last leaf is not full.
    #[test]
    fn the_tree_holds_every_point_in_its_boxes() {
        fn visit(tree: &PointTree, at: Subtree, points: &[[f32; 3]]) -> Vec<u32> {
            let ids: Vec<u32> = if at.leaves == 1 {
                let leaf = &tree.leaves[at.leaf as usize];
                let used = (tree.len - at.leaf as usize * LANES).min(LANES);
                assert!((0..used).all(|l| leaf.at.map(|a| a[l]) == points[leaf.id[l] as usize]));
                leaf.id[..used].to_vec()
            } else {
                at.halves().iter().flat_map(|&half| visit(tree, half, points)).collect()
            };
            let node = &tree.nodes[at.node as usize];
            assert!(ids.iter().all(|&i| gap_sq(node, points[i as usize]) == 0.0));
            assert_eq!(ids.iter().min(), Some(&node.first_id));
            ids
        }
        for points in point_sets() {
            let tree = PointTree::new(&points);
            let mut ids = visit(&tree, tree.root(), &points);
            ids.sort_unstable();
            assert!(ids.iter().copied().eq(0..points.len() as u32));
        }
    }

    #[test]
    fn thread_count_changes_nothing() {
        // More than FORK leaves on each side and several tasks of queries.
        let points: Vec<_> = point_sets().concat().into_iter().filter(|p| p[0].abs() < 10.0).collect();
        let queries: Vec<_> = point_sets().iter().flat_map(|c| queries_for(c)).collect();
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| nearest_points(&queries, &points))
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn no_queries_no_answers() {
        assert_eq!(nearest_points(&[], &[[0.0; 3]]), (vec![], vec![]));
    }

    #[test]
    #[should_panic(expected = "no points")]
    fn no_points_are_refused() {
        nearest_points(&[], &[]);
    }

    #[test]
    #[should_panic(expected = "point 1")]
    fn nan_point_is_refused() {
        PointTree::new(&[[0.0; 3], [0.0, f32::NAN, 0.0]]);
    }

    #[test]
    #[should_panic(expected = "point 0")]
    fn far_query_is_refused() {
        nearest_points(&[[2e18, 0.0, 0.0]], &[[0.0; 3]]);
    }
}
