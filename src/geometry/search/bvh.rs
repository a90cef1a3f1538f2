//! Exact distance from points to a triangle mesh.

use super::triangle::{OnTriangle, closest_on_triangle};
use crate::error::{Error, ErrorKind};
use crate::geometry::TriangleMesh;
use crate::geometry::vec3::{dist_sq, dot, length, triangle_normal};
use rayon::prelude::*;

/// Triangles in a leaf, at most.
const MAX_LEAF: usize = 4;

/// Queries answered by one task.
const CHUNK: usize = 256;

/// Boxes that wait to be opened, at most: one for each level of a tree that halves up to 2^32 triangles, and one more.
const MAX_WAITING: usize = 34;

/// The point of a mesh nearest to a query.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SurfaceHit {
    /// Index of the face it lies on; the smallest among equally near faces.
    pub face: u32,
    /// The point itself.
    pub point: [f32; 3],
    /// Its barycentric coordinates in that face: the weights of the corners, not negative and together 1.
    pub weights: [f32; 3],
    /// Squared distance to it.
    pub dist_sq: f64,
}

/// A tree of boxes over the triangles of a mesh.
///
/// Distances are evaluated in double precision. Faces without area count as the segment or point they are.
#[derive(Clone, Debug)]
pub struct TriangleBvh {
    nodes: Vec<Node>,
    /// Corners, sorted so that a leaf's triangles are together.
    corners: Vec<[[f64; 3]; 3]>,
    /// Face index of each sorted triangle.
    face: Vec<u32>,
    /// Where each face went in the sorted order.
    place: Vec<u32>,
    /// Working space of `rebuild`, kept for the next one.
    order: Vec<Item>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    min: [f64; 3],
    max: [f64; 3],
    /// First triangle of a leaf; otherwise the second child (the first child is the next node).
    at: u32,
    /// Triangles of a leaf; otherwise 0.
    count: u32,
}

impl TriangleBvh {
    /// The tree over the faces of `mesh`.
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if there is no face, or if a face names a missing or non-finite vertex (the face is named).
    pub fn new(mesh: &TriangleMesh) -> Result<Self, Error> {
        let mut tree = Self::over_nothing();
        tree.rebuild(&mesh.verts, &mesh.faces)?;
        tree.order = Vec::new();
        Ok(tree)
    }

    /// An empty tree; [`rebuild`](Self::rebuild) it before any query.
    pub(crate) fn over_nothing() -> Self {
        let (nodes, corners, face) = Default::default();
        TriangleBvh { nodes, corners, face, place: Vec::new(), order: Vec::new() }
    }

    /// Makes it the tree over other faces (f x 3) with vertices v x 3, in the memory it has.
    ///
    /// # Errors
    /// As [`new`](Self::new); the tree is as it was then.
    pub(crate) fn rebuild(&mut self, verts: &[[f32; 3]], faces: &[[u32; 3]]) -> Result<(), Error> {
        if faces.is_empty() {
            return Err(Error::new(ErrorKind::Data, "a mesh without faces has no surface to measure to"));
        }
        let usable = |&v: &u32| verts.get(v as usize).is_some_and(|p| p.iter().all(|x| x.is_finite()));
        if let Some((f, face)) = faces.iter().enumerate().find(|(_, face)| !face.iter().all(usable)) {
            return Err(Error::new(ErrorKind::Data, format!("vertices {face:?} are missing or not finite"))
                .at_element(format!("face {f}"))
                .advise("repair the mesh"));
        }
        let triangle = |face: u32| faces[face as usize].map(|v| verts[v as usize].map(f64::from));
        self.order.clear();
        self.order.extend((0..faces.len() as u32).map(|face| {
            let t = triangle(face);
            Item { sum: std::array::from_fn(|a| (t[0][a] + t[1][a] + t[2][a]) as f32), face }
        }));
        self.nodes.clear();
        build(&mut self.order, &triangle, 0, &mut self.nodes);
        self.place.clear();
        self.place.resize(faces.len(), 0);
        for (i, item) in self.order.iter().enumerate() {
            self.place[item.face as usize] = i as u32;
        }
        self.face.clear();
        self.face.extend(self.order.iter().map(|item| item.face));
        self.corners.clear();
        self.corners.extend(self.face.iter().map(|&f| triangle(f)));
        Ok(())
    }

    /// The point of the mesh nearest to `q`.
    ///
    /// # Panics
    /// If `q` is not finite.
    #[track_caller]
    pub fn nearest(&self, q: [f32; 3]) -> SurfaceHit {
        self.nearest_with_guess(q, 0)
    }

    /// As [`nearest`](Self::nearest), and as quick as face `guess` (any face of the mesh) is near to `q`: no box
    /// farther than that is opened. The result does not depend on the guess.
    ///
    /// # Panics
    /// If `q` is not finite or the mesh has no such face.
    #[track_caller]
    pub(crate) fn nearest_with_guess(&self, q: [f32; 3], guess: u32) -> SurfaceHit {
        assert!(q.iter().all(|x| x.is_finite()), "TriangleBvh::nearest: query {q:?} is not finite");
        let q = q.map(f64::from);
        let mut best = (f64::INFINITY, u32::MAX, OnTriangle::default());
        let consider = |place: u32, best: &mut (f64, u32, OnTriangle)| {
            let nearest = closest_on_triangle(q, self.corners[place as usize]);
            let found = (dist_sq(q, nearest.point), self.face[place as usize], nearest);
            if (found.0, found.1) < (best.0, best.1) {
                *best = found;
            }
        };
        consider(self.place[guess as usize], &mut best);
        let mut stack = [(0.0, 0u32); MAX_WAITING];
        stack[0] = (self.nodes[0].dist_sq(q), 0);
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let (bound, at) = stack[waiting];
            // Equal bounds are opened too: they may hold an equally near face of smaller index.
            if bound > best.0 {
                continue;
            }
            let node = &self.nodes[at as usize];
            if node.count > 0 {
                (node.at..node.at + node.count).for_each(|place| consider(place, &mut best));
                continue;
            }
            let child = |c: u32| (self.nodes[c as usize].dist_sq(q), c);
            let (a, b) = (child(at + 1), child(node.at));
            // The nearer child is put on top and opened first.
            let (near, far) = if a.0 <= b.0 { (a, b) } else { (b, a) };
            for child in [far, near] {
                if child.0 <= best.0 {
                    stack[waiting] = child;
                    waiting += 1;
                }
            }
        }
        let (dist_sq, face, OnTriangle { point, weights }) = best;
        let narrow = |x: [f64; 3]| x.map(|x| x as f32);
        SurfaceHit { face, point: narrow(point), weights: narrow(weights), dist_sq }
    }

    /// For each of `queries` (m x 3), the nearest point of the mesh (m).
    ///
    /// # Panics
    /// If a query is not finite.
    pub fn nearest_all(&self, queries: &[[f32; 3]]) -> Vec<SurfaceHit> {
        let mut out =
            vec![SurfaceHit { face: 0, point: [0.0; 3], weights: [0.0; 3], dist_sq: 0.0 }; queries.len()];
        out.par_chunks_mut(CHUNK).zip(queries.par_chunks(CHUNK)).for_each(|(out, queries)| {
            // Neighbours in the list are often neighbours in space.
            let mut guess = 0;
            for (hit, &q) in out.iter_mut().zip(queries) {
                *hit = self.nearest_with_guess(q, guess);
                guess = hit.face;
            }
        });
        out
    }

    /// Shows `triangle` the corners of every face in the boxes (lower and upper corner) that `open` says to look into.
    pub(super) fn visit(
        &self,
        open: impl Fn([f64; 3], [f64; 3]) -> bool,
        mut triangle: impl FnMut([[f64; 3]; 3]),
    ) {
        let mut stack = vec![0u32];
        while let Some(at) = stack.pop() {
            let node = self.nodes[at as usize];
            if !open(node.min, node.max) {
                continue;
            }
            if node.count > 0 {
                self.corners[node.at as usize..][..node.count as usize].iter().for_each(|&t| triangle(t));
            } else {
                stack.extend([at + 1, node.at]);
            }
        }
    }

    /// For each of `queries` (m x 3), the unit normal of the face nearest to it (m x 3); zero if that has no area.
    ///
    /// # Panics
    /// If a query is not finite.
    pub fn normals_near(&self, queries: &[[f32; 3]]) -> Vec<[f32; 3]> {
        self.nearest_all(queries).iter().map(|hit| self.face_normal(hit.face)).collect()
    }

    /// Unit normal of a face by its winding; zero for a face without area.
    ///
    /// # Panics
    /// If the mesh has no such face.
    #[track_caller]
    pub fn face_normal(&self, face: u32) -> [f32; 3] {
        let n = triangle_normal(self.corners[self.place[face as usize] as usize]);
        let len = length(n);
        if len > 0.0 { n.map(|x| (x / len) as f32) } else { [0.0; 3] }
    }
}

impl Node {
    fn dist_sq(&self, q: [f64; 3]) -> f64 {
        let d: [f64; 3] = std::array::from_fn(|a| (self.min[a] - q[a]).max(q[a] - self.max[a]).max(0.0));
        // A little less, so that rounding never closes a box that holds the answer.
        dot(d, d) * (1.0 - 1e-12)
    }
}

/// What the tree is sorted by: a face and three times its centre. Small, for it is moved at every level.
#[derive(Clone, Copy, Debug)]
struct Item {
    sum: [f32; 3],
    face: u32,
}

/// Appends the tree over `items`, the first of which is number `first` of all, halving at the median of the axis along
/// which their centres spread most. Which tree it is changes the time of a query, never the answer.
fn build(items: &mut [Item], triangle: &impl Fn(u32) -> [[f64; 3]; 3], first: u32, nodes: &mut Vec<Node>) {
    let here = nodes.len();
    let mut node =
        Node { min: [f64::INFINITY; 3], max: [f64::NEG_INFINITY; 3], at: first, count: items.len() as u32 };
    if items.len() <= MAX_LEAF {
        for p in items.iter().flat_map(|item| triangle(item.face)) {
            node.min = std::array::from_fn(|a| node.min[a].min(p[a]));
            node.max = std::array::from_fn(|a| node.max[a].max(p[a]));
        }
        nodes.push(node);
        return;
    }
    let (mut min, mut max) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for item in &*items {
        min = std::array::from_fn(|a| min[a].min(item.sum[a]));
        max = std::array::from_fn(|a| max[a].max(item.sum[a]));
    }
    let axis = (0..3).rev().max_by(|&a, &b| (max[a] - min[a]).total_cmp(&(max[b] - min[b]))).unwrap_or(0);
    let half = items.len() / 2;
    // Halving by count bounds the depth even if all centres coincide.
    items.select_nth_unstable_by(half, |a, b| a.sum[axis].total_cmp(&b.sum[axis]).then(a.face.cmp(&b.face)));
    let (low, high) = items.split_at_mut(half);
    nodes.push(node);
    build(low, triangle, first, nodes);
    let second = nodes.len();
    build(high, triangle, first + half as u32, nodes);
    let [a, b] = [nodes[here + 1], nodes[second]];
    nodes[here] = Node {
        min: std::array::from_fn(|i| a.min[i].min(b.min[i])),
        max: std::array::from_fn(|i| a.max[i].max(b.max[i])),
        at: second as u32,
        count: 0,
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::sample_surface;
    use proptest::prelude::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn a_tree_can_be_built_again_over_another_mesh() {
        let (first, second) = (soup(40, 0.2, 1), soup(90, 0.1, 2));
        let mut tree = TriangleBvh::new(&first).unwrap();
        tree.rebuild(&second.verts, &second.faces).unwrap();
        let fresh = TriangleBvh::new(&second).unwrap();
        let queries = soup(30, 0.5, 3).verts;
        assert_eq!(tree.nearest_all(&queries), fresh.nearest_all(&queries));
        assert_eq!(tree.face_normal(7), fresh.face_normal(7));
        // A bad mesh leaves it alone.
        assert!(tree.rebuild(&second.verts[..5], &second.faces).is_err());
        assert!(tree.rebuild(&second.verts, &[]).is_err());
        assert_eq!(tree.nearest_all(&queries), fresh.nearest_all(&queries));
    }

    fn soup(n: usize, size: f32, seed: u64) -> TriangleMesh {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut mesh = TriangleMesh::default();
        for i in 0..n as u32 {
            let c: [f32; 3] = std::array::from_fn(|_| rng.random_range(-0.5f32..0.5));
            for _ in 0..3 {
                mesh.verts.push(std::array::from_fn(|a| c[a] + size * rng.random_range(-0.5f32..0.5)));
            }
            mesh.faces.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        mesh
    }

    /// Squared distance of the nearest face, and that face: every one is looked at, and the first of the nearest taken.
    fn naive(mesh: &TriangleMesh, q: [f32; 3]) -> (f64, u32) {
        let found = mesh.faces.iter().zip(0..).map(|(face, f)| {
            let q = q.map(f64::from);
            let corners = face.map(|v| mesh.verts[v as usize].map(f64::from));
            (dist_sq(q, closest_on_triangle(q, corners).point), f)
        });
        found.min_by(|a, b| a.partial_cmp(b).unwrap()).unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// The guess is the nearest face itself, the farthest, or any; some faces are there twice, so that equally near
        /// ones must be told apart by their index.
        #[test]
        fn any_guess_gives_the_answer_of_the_naive_twin(
            faces in 1usize..80,
            size in 0.01f32..2.0,
            seed in 0u64..1000,
            q in prop::array::uniform3(-1.0f32..1.0),
            on_vertex in any::<bool>(),
            guess in 0usize..1000,
        ) {
            let mut mesh = soup(faces, size, seed);
            mesh.faces.extend_from_within(..faces / 2);
            let q = if on_vertex { mesh.verts[guess % mesh.verts.len()] } else { q };
            let bvh = TriangleBvh::new(&mesh).unwrap();
            let (want, hit) = (naive(&mesh, q), bvh.nearest(q));
            let distance = |f: &u32| naive(&TriangleMesh { faces: vec![mesh.faces[*f as usize]], ..mesh.clone() }, q).0;
            let all = 0..mesh.faces.len() as u32;
            let worst = all.max_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
            for guess in [want.1, worst, (guess % mesh.faces.len()) as u32] {
                let guessed = bvh.nearest_with_guess(q, guess);
                prop_assert_eq!((guessed.dist_sq, guessed.face), want);
                prop_assert_eq!(guessed, hit);
            }
        }
    }

    #[test]
    fn nearest_is_brute_force() {
        let mut meshes: Vec<_> = (1..=12).map(|n| soup(n, 0.5, n as u64)).collect();
        meshes.push(soup(500, 0.1, 20));
        meshes.push(soup(500, 2.0, 21));
        // Every face thrice, and faces that are segments and points.
        let mut odd = soup(100, 0.2, 22);
        let copies = odd.faces.clone();
        odd.faces.extend(copies.iter().chain(&copies));
        odd.faces.extend((0..50).map(|i| [i, i, i + 1]));
        odd.faces.extend((50..80).map(|i| [i, i, i]));
        meshes.push(odd);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for mesh in meshes {
            let bvh = TriangleBvh::new(&mesh).unwrap();
            let mut queries: Vec<[f32; 3]> =
                (0..200).map(|_| std::array::from_fn(|_| rng.random_range(-1.0f32..1.0))).collect();
            queries.extend(mesh.verts.iter().step_by(7));
            queries.push([1e3, -1e3, 0.0]);
            for (q, hit) in queries.iter().zip(bvh.nearest_all(&queries)) {
                assert_eq!((hit.dist_sq, hit.face), naive(&mesh, *q));
            }
        }
    }

    #[test]
    fn triangle_distance_is_that_of_the_densest_sampling() {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        for seed in 0..20 {
            let mesh = soup(1, 1.0, seed);
            let bvh = TriangleBvh::new(&mesh).unwrap();
            let samples = sample_surface(&mesh, 4000, 1).unwrap();
            for _ in 0..20 {
                let q: [f32; 3] = std::array::from_fn(|_| rng.random_range(-1.0f32..1.0));
                let hit = bvh.nearest(q);
                let near = samples.points.iter().map(|p| dist_sq(*p, q)).fold(f32::INFINITY, f32::min);
                let d = hit.dist_sq.sqrt() as f32;
                assert!(d <= near.sqrt() + 1e-6 && near.sqrt() < d + 0.08);
            }
        }
    }

    #[test]
    fn hand_checked_hit() {
        let mesh = TriangleMesh {
            verts: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [9.0, 0.0, 0.0]],
            faces: vec![[3, 3, 3], [0, 1, 2]],
        };
        let bvh = TriangleBvh::new(&mesh).unwrap();
        let hit = bvh.nearest([0.25, 0.25, 2.0]);
        let weights = [0.5, 0.25, 0.25];
        assert_eq!(hit, SurfaceHit { face: 1, point: [0.25, 0.25, 0.0], weights, dist_sq: 4.0 });
        assert_eq!(bvh.nearest([1.0, 1.0, 0.0]).point, [0.5, 0.5, 0.0]);
        assert_eq!(bvh.face_normal(1), [0.0, 0.0, 1.0]);
        assert_eq!(bvh.face_normal(0), [0.0; 3]);
    }

    #[test]
    fn unusable_meshes_are_data_errors() {
        assert_eq!(TriangleBvh::new(&TriangleMesh::default()).unwrap_err().kind(), ErrorKind::Data);
        let mut mesh = soup(3, 1.0, 0);
        mesh.verts[4] = [f32::NAN; 3];
        assert_eq!(TriangleBvh::new(&mesh).unwrap_err().element(), Some("face 1"));
        mesh.faces[0] = [0, 1, 77];
        assert_eq!(TriangleBvh::new(&mesh).unwrap_err().element(), Some("face 0"));
    }
}
