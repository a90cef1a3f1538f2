//! Marching tetrahedra: signs at vertices to edges and faces. Integers only; positions come from interpolation.

/// The two ends of each edge of a tetrahedron.
const TET_EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// The triangles for one pattern of signs: how many, and their corners as pairs of tetrahedron corners.
#[derive(Clone, Copy)]
struct Case {
    len: usize,
    /// Indices into [`TET_EDGES`].
    tris: [[u8; 3]; 2],
}

/// One case for each set of inside corners; bit `i` of the case number says that corner `i` is inside.
const CASES: [Case; 16] = cases();

const fn cases() -> [Case; 16] {
    let mut all = [Case { len: 0, tris: [[0; 3]; 2] }; 16];
    let mut mask = 1;
    while mask < 15 {
        all[mask] = case(mask);
        mask += 1;
    }
    all
}

/// Lists the corners as inside ones, then outside ones, made an even permutation by a swap among equals. A rotation
/// of the tetrahedron then carries any case to the one with the first corners inside, whose winding is known: seen
/// from the outside corners, the triangles below run counter-clockwise when the tetrahedron is positively oriented.
const fn case(mask: usize) -> Case {
    let mut p = [0; 4];
    let mut inside = 0;
    let mut side = 0;
    let mut n = 0;
    while side < 2 {
        let mut corner = 0;
        while corner < 4 {
            if (mask >> corner & 1 == 1) == (side == 0) {
                p[n] = corner;
                n += 1;
                inside += 1 - side;
            }
            corner += 1;
        }
        side += 1;
    }
    let mut inversions = 0;
    let mut i = 0;
    while i < 6 {
        let [a, b] = TET_EDGES[i];
        inversions += (p[a] > p[b]) as usize;
        i += 1;
    }
    if inversions % 2 == 1 {
        let at = if inside == 3 { 0 } else { 2 };
        (p[at], p[at + 1]) = (p[at + 1], p[at]);
    }
    let [a, b, c, d] = p;
    let none = [0; 3];
    match inside {
        1 => Case { len: 1, tris: [[edge(a, b), edge(a, c), edge(a, d)], none] },
        2 => Case {
            len: 2,
            tris: [[edge(a, c), edge(a, d), edge(b, d)], [edge(a, c), edge(b, d), edge(b, c)]],
        },
        _ => Case { len: 1, tris: [[edge(a, d), edge(b, d), edge(c, d)], none] },
    }
}

/// The index of the edge between two corners in [`TET_EDGES`].
const fn edge(a: usize, b: usize) -> u8 {
    let mut i = 0;
    while i < 6 {
        let [p, q] = TET_EDGES[i];
        if (p == a && q == b) || (p == b && q == a) {
            return i as u8;
        }
        i += 1;
    }
    panic!("no edge joins a corner to itself")
}

/// The topology of a level set: which grid edges it crosses and how the crossings are joined.
///
/// Mesh vertex `i` lies on `edges[i]`. Faces run counter-clockwise seen from outside, so a mesh around inside
/// vertices has a positive volume.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Isosurface {
    /// The edges whose ends differ in sign, e x 2, each as (lower, higher) vertex index, in ascending order.
    pub edges: Vec<[u32; 2]>,
    /// Triangles, f x 3, as indices into `edges`.
    pub faces: Vec<[u32; 3]>,
}

/// Marching tetrahedra over t tetrahedra (t x 4 vertex indices), which must be positively oriented:
/// `det(v1 - v0, v2 - v0, v3 - v0) > 0`.
///
/// `inside` says for a vertex whether its value is below zero; it must give the same answer each time. Where two
/// tetrahedra share a face, their triangles meet along it, so the surface is open only at the border of the set of
/// tetrahedra. Indices may be sparse. For many sign patterns on one set of tetrahedra use [`BandTopology`], which
/// gives the same result.
pub fn march(tets: &[[u32; 4]], inside: impl Fn(u32) -> bool) -> Isosurface {
    let mut ends = Vec::new();
    for tet in tets {
        let mask = (0..4).fold(0, |m, i| m | usize::from(inside(tet[i])) << i);
        let case = &CASES[mask];
        for tri in &case.tris[..case.len] {
            for &e in tri {
                ends.push(tet_edge(tet, usize::from(e)));
            }
        }
    }
    let (edges, ids) = index_edges(&ends);
    Isosurface { edges, faces: ids.as_chunks().0.to_vec() }
}

/// A set of t tetrahedra prepared for marching under many sign patterns.
///
/// Building it finds the unique edges once, in time linear in t + v;
/// [`march_into`](Self::march_into) is then two linear scans.
#[derive(Clone, Debug, Default)]
pub struct BandTopology {
    vert_count: usize,
    tets: Vec<[u32; 4]>,
    edges: Vec<[u32; 2]>,
    tet_edges: Vec<[u32; 6]>,
}

impl BandTopology {
    /// Prepares t positively oriented tetrahedra (t x 4) over vertices `0..vert_count`.
    ///
    /// # Panics
    ///
    /// If a tetrahedron names a vertex outside `0..vert_count`.
    #[track_caller]
    pub fn new(vert_count: usize, tets: Vec<[u32; 4]>) -> Self {
        for (i, tet) in tets.iter().enumerate() {
            assert!(
                tet.iter().all(|&v| (v as usize) < vert_count),
                "BandTopology::new: tetrahedron {i} is {tet:?} over {vert_count} vertices"
            );
        }
        let ends: Vec<_> = tets.iter().flat_map(|tet| (0..6).map(|e| tet_edge(tet, e))).collect();
        let (edges, ids) = index_edges(&ends);
        BandTopology { vert_count, tets, edges, tet_edges: ids.as_chunks().0.to_vec() }
    }

    /// Marches with one sign per vertex (v), reusing the buffers of `out`; the same result as [`march`].
    ///
    /// # Panics
    ///
    /// If the number of signs is not the number of vertices.
    #[track_caller]
    pub fn march_into(&self, inside: &[bool], out: &mut Isosurface) {
        assert!(
            inside.len() == self.vert_count,
            "march_into: {} signs for {} vertices",
            inside.len(),
            self.vert_count
        );
        out.edges.clear();
        out.faces.clear();
        // The mesh vertex of a crossing edge is the number of crossing edges before it.
        let mut mesh_vert = Vec::with_capacity(self.edges.len());
        for &[a, b] in &self.edges {
            mesh_vert.push(out.edges.len() as u32);
            if inside[a as usize] != inside[b as usize] {
                out.edges.push([a, b]);
            }
        }
        for (tet, edges) in self.tets.iter().zip(&self.tet_edges) {
            let mask = (0..4).fold(0, |m, i| m | usize::from(inside[tet[i] as usize]) << i);
            let case = &CASES[mask];
            for tri in &case.tris[..case.len] {
                out.faces.push(tri.map(|e| mesh_vert[edges[usize::from(e)] as usize]));
            }
        }
    }
}

/// Edge `e` of a tetrahedron as (lower, higher).
fn tet_edge(tet: &[u32; 4], e: usize) -> [u32; 2] {
    let [a, b] = TET_EDGES[e].map(|corner| tet[corner]);
    [a.min(b), a.max(b)]
}

/// Numbers the distinct pairs of `ends` in ascending order: the pairs, and the number of each entry's pair.
fn index_edges(ends: &[[u32; 2]]) -> (Vec<[u32; 2]>, Vec<u32>) {
    assert!(u32::try_from(ends.len()).is_ok(), "marching: {} edge uses do not fit u32", ends.len());
    let vert_count = ends.iter().map(|e| e[1] as usize + 1).max().unwrap_or(0);
    let mut order: Vec<u32> = (0..ends.len() as u32).collect();
    if vert_count > 8 * ends.len() + 1024 {
        // Sparse indices: an array over all of them would cost more than comparing.
        order.sort_unstable_by_key(|&i| ends[i as usize]);
    } else {
        // Sorting by the second end, then stably by the first, sorts by both.
        for side in [1, 0] {
            order = counting_sort(&order, vert_count, |i| ends[i as usize][side]);
        }
    }
    let mut ids = vec![0; ends.len()];
    let mut edges: Vec<[u32; 2]> = Vec::new();
    for i in order {
        let pair = ends[i as usize];
        if edges.last() != Some(&pair) {
            edges.push(pair);
        }
        ids[i as usize] = edges.len() as u32 - 1;
    }
    (edges, ids)
}

/// The entries of `order` sorted stably by a key below `key_count`, in linear time.
fn counting_sort(order: &[u32], key_count: usize, key: impl Fn(u32) -> u32) -> Vec<u32> {
    let mut next = vec![0u32; key_count + 1];
    for &i in order {
        next[key(i) as usize + 1] += 1;
    }
    for k in 0..key_count {
        next[k + 1] += next[k];
    }
    let mut sorted = vec![0; order.len()];
    for &i in order {
        let at = &mut next[key(i) as usize];
        sorted[*at as usize] = i;
        *at += 1;
    }
    sorted
}

#[cfg(test)]
mod tests {
    use super::super::TetGrid;
    use super::*;
    use proptest::prelude::*;
    use std::collections::{BTreeMap, BTreeSet};

    type Vec3 = [f64; 3];

    fn sub(a: Vec3, b: Vec3) -> Vec3 {
        std::array::from_fn(|i| a[i] - b[i])
    }

    fn dot(a: Vec3, b: Vec3) -> f64 {
        (0..3).map(|i| a[i] * b[i]).sum()
    }

    fn cross(a: Vec3, b: Vec3) -> Vec3 {
        std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
    }

    fn mean(p: &[Vec3]) -> Vec3 {
        std::array::from_fn(|a| p.iter().map(|q| q[a]).sum::<f64>() / p.len() as f64)
    }

    /// The crossing polygon from geometry alone: the crossings sorted by their angle around the axis that points from
    /// the inside corners to the outside corners.
    fn polygon(tet: [u32; 4], at: [Vec3; 4], inside: impl Fn(u32) -> bool) -> Vec<[u32; 2]> {
        let (ins, outs): (Vec<usize>, Vec<usize>) = (0..4).partition(|&i| inside(tet[i]));
        if ins.is_empty() || outs.is_empty() {
            return Vec::new();
        }
        let side = |s: &[usize]| mean(&s.iter().map(|&i| at[i]).collect::<Vec<_>>());
        let mut crossings = Vec::new();
        for &i in &ins {
            for &o in &outs {
                crossings.push(([tet[i].min(tet[o]), tet[i].max(tet[o])], mean(&[at[i], at[o]])));
            }
        }
        let centre = mean(&crossings.iter().map(|c| c.1).collect::<Vec<_>>());
        let axis = sub(side(&outs), side(&ins));
        let u = cross(axis, sub(crossings[0].1, centre));
        let v = cross(u, axis);
        let angle = |p: Vec3| dot(sub(p, centre), u).atan2(dot(sub(p, centre), v));
        crossings.sort_by(|a, b| angle(a.1).total_cmp(&angle(b.1)));
        crossings.into_iter().map(|c| c.0).collect()
    }

    /// The directed edges that a set of triangles leaves open.
    fn open_edges(faces: &[[[u32; 2]; 3]]) -> BTreeSet<([u32; 2], [u32; 2])> {
        let mut open = BTreeSet::new();
        for f in faces {
            for i in 0..3 {
                let (a, b) = (f[i], f[(i + 1) % 3]);
                if !open.remove(&(b, a)) {
                    assert!(open.insert((a, b)), "an edge is used twice in one direction");
                }
            }
        }
        open
    }

    #[test]
    fn every_case_is_the_geometric_polygon() {
        let at = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.2, 1.0, 0.0], [0.1, 0.3, 1.0]];
        for labels in [[0, 1, 2, 3], [9, 4, 7, 1], [3, 2, 1, 0]] {
            for mask in 0..16u32 {
                let inside = |v: u32| mask >> labels.iter().position(|&l| l == v).unwrap() & 1 == 1;
                let surface = march(&[labels], inside);
                let polygon = polygon(labels, at, inside);
                assert_eq!(surface.faces.len(), polygon.len().saturating_sub(2), "mask {mask}");
                let faces: Vec<_> =
                    surface.faces.iter().map(|f| f.map(|i| surface.edges[i as usize])).collect();
                let want =
                    (0..polygon.len()).map(|i| (polygon[i], polygon[(i + 1) % polygon.len()])).collect();
                assert_eq!(open_edges(&faces), want, "mask {mask}");
            }
        }
    }

    /// Each tetrahedron marched alone, the results joined through an ordered map.
    fn naive(tets: &[[u32; 4]], inside: impl Fn(u32) -> bool + Copy) -> Isosurface {
        let mut faces = Vec::new();
        for tet in tets {
            let one = march(&[*tet], inside);
            faces.extend(one.faces.iter().map(|f| f.map(|i| one.edges[i as usize])));
        }
        let edges: BTreeSet<_> = faces.iter().flatten().copied().collect();
        let ids: BTreeMap<_, _> = edges.iter().copied().zip(0u32..).collect();
        Isosurface {
            edges: edges.into_iter().collect(),
            faces: faces.into_iter().map(|f| f.map(|e| ids[&e])).collect(),
        }
    }

    #[test]
    fn sparse_indices_give_the_same_faces() {
        let grid = TetGrid::new([3, 3, 3], [0.0; 3], 1.0);
        let tets = grid.tets();
        let inside = |v: u32| (v * 7919) % 5 < 2;
        let dense = march(&tets, inside);
        let far = |v: u32| v * 60_000_000;
        let moved: Vec<_> = tets.iter().map(|t| t.map(far)).collect();
        let sparse = march(&moved, |v| inside(v / 60_000_000));
        assert_eq!(sparse.faces, dense.faces);
        assert_eq!(sparse.edges, dense.edges.iter().map(|e| e.map(far)).collect::<Vec<_>>());
    }

    #[test]
    #[should_panic(expected = "3 signs for 4 vertices")]
    fn a_missing_sign_is_refused() {
        BandTopology::new(4, vec![[0, 1, 2, 3]]).march_into(&[true; 3], &mut Isosurface::default());
    }

    #[test]
    fn no_tets_no_surface() {
        let mut out = march(&[[0, 1, 2, 3]], |v| v == 0);
        assert_eq!(out.faces.len(), 1);
        BandTopology::new(0, Vec::new()).march_into(&[], &mut out);
        assert_eq!(out, march(&[], |_| true));
        assert_eq!(out, Isosurface::default());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn march_band_and_naive_agree(
            r in prop::array::uniform3(1usize..5),
            signs in prop::collection::vec(any::<bool>(), 125),
            keep in prop::collection::vec(any::<bool>(), 384),
        ) {
            let grid = TetGrid::new(r, [0.0; 3], 1.0);
            let tets: Vec<_> = grid.tets().into_iter().zip(&keep).filter(|t| *t.1).map(|t| t.0).collect();
            let want = naive(&tets, |v| signs[v as usize]);
            prop_assert_eq!(&march(&tets, |v| signs[v as usize]), &want);
            let n = grid.vertex_count();
            let mut out = Isosurface { edges: vec![[7, 7]], faces: vec![[7; 3]] };
            BandTopology::new(n, tets).march_into(&signs[..n], &mut out);
            prop_assert_eq!(&out, &want);
        }
    }
}
