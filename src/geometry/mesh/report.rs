//! What a triangle mesh is like: counts, closedness, orientation, genus, volume.

use super::TriangleMesh;
use super::measure::Measure;
use super::parts::connected;
use crate::geometry::{Position, format_shortest, format_significant};
use std::fmt;

/// The report of [`TriangleMesh::topology`].
///
/// An edge is a pair of different vertices that follow each other in a face. Components are sets of faces connected
/// through shared vertices; vertices that no face uses belong to none.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Topology {
    /// Number of vertices v, used or not.
    pub verts: usize,
    /// Vertices that no face uses.
    pub unused_verts: usize,
    /// Number of edges e.
    pub edges: usize,
    /// Number of faces f.
    pub faces: usize,
    /// Edges in one face only.
    pub boundary_edges: usize,
    /// Closed loops, or open chains, that these edges make up: parts that are joined through their vertices.
    pub boundary_loops: usize,
    /// Edges in more than two faces.
    pub nonmanifold_edges: usize,
    /// Number of components.
    pub components: usize,
    /// Euler number: used vertices - edges + faces.
    pub euler: i64,
    /// Number of handles, summed over the components; known only for a closed and oriented mesh, and not where an odd
    /// Euler number shows that surfaces touch in single vertices.
    pub genus: Option<i64>,
    /// There are faces, and every edge is in exactly two of them.
    pub closed: bool,
    /// No edge is used twice in the same direction; with `closed`, every edge is used once in each direction.
    pub oriented: bool,
    /// Enclosed volume, positive when faces run counter-clockwise seen from outside; meaningful for closed meshes.
    pub volume: f64,
    /// Sum of the areas of the faces.
    pub area: f64,
    /// Least and greatest coordinates over all vertices, NaN on an axis where a coordinate is NaN; none if there are
    /// no vertices.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Faces that name a vertex twice or have no area.
    pub degenerate_faces: usize,
}

impl fmt::Display for Topology {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} vertices, {} edges, {} faces", self.verts, self.edges, self.faces)?;
        let plural = if self.components == 1 { "" } else { "s" };
        write!(f, "; {} component{plural}, Euler number {}", self.components, self.euler)?;
        if let Some(genus) = self.genus {
            write!(f, ", genus {genus}")?;
        }
        write!(f, "; {}", if self.closed { "closed" } else { "not closed" })?;
        write!(f, ", {}", if self.oriented { "oriented" } else { "not oriented" })?;
        if self.boundary_edges > 0 {
            let plural = if self.boundary_loops == 1 { "" } else { "s" };
            write!(f, ", {} boundary edges in {} loop{plural}", self.boundary_edges, self.boundary_loops)?;
        }
        for (count, what) in [
            (self.nonmanifold_edges, "non-manifold edges"),
            (self.degenerate_faces, "degenerate faces"),
            (self.unused_verts, "unused vertices"),
        ] {
            if count > 0 {
                write!(f, ", {count} {what}")?;
            }
        }
        write!(f, "; volume {}, area {}", format_significant(self.volume), format_significant(self.area))?;
        if let Some(corners) = self.bounds {
            let [lo, hi] = corners.map(|c| c.map(format_shortest).join(", "));
            write!(f, "; from [{lo}] to [{hi}]")?;
        }
        Ok(())
    }
}

impl<P: Position> TriangleMesh<P> {
    /// Counts and measures the mesh. Takes time linear in the faces, but for sorting the few edges of each vertex.
    /// Volumes and areas are those of the vertices in 32 bits, about the [`offset`](Self::offset) of the mesh where 32
    /// bits do not hold them as they are; so are the bounds where there is no offset.
    ///
    /// # Panics
    ///
    /// If a face names a vertex that is not there.
    #[track_caller]
    pub fn topology(&self) -> Topology {
        self.check_faces("topology");
        let usage = EdgeUsage::of(self.verts.len(), &self.faces);
        let roots = self.roots();
        let mut used = vec![false; self.verts.len()];
        for &v in self.faces.iter().flatten() {
            used[v as usize] = true;
        }
        let used_verts = used.iter().filter(|&&u| u).count();
        let components = (0..used.len()).filter(|&v| used[v] && roots[v] as usize == v).count();
        let euler = used_verts as i64 - usage.edges as i64 + self.faces.len() as i64;
        let closed = !self.faces.is_empty() && usage.boundary.is_empty() && usage.nonmanifold == 0;
        let handles_twice = 2 * components as i64 - euler;
        let measure = Measure::of(self);
        let (mut volume, mut area, mut degenerate_faces) = (0.0, 0.0, 0);
        for &face in &self.faces {
            let part = measure.volume_and_area(face);
            volume += part.0;
            area += part.1;
            let [a, b, c] = face;
            degenerate_faces += usize::from(a == b || b == c || c == a || part.1 == 0.0);
        }
        Topology {
            verts: self.verts.len(),
            unused_verts: self.verts.len() - used_verts,
            edges: usage.edges,
            faces: self.faces.len(),
            boundary_edges: usage.boundary.len(),
            boundary_loops: loops(self.verts.len(), &usage.boundary),
            nonmanifold_edges: usage.nonmanifold,
            components,
            euler,
            genus: (closed && usage.oriented && handles_twice % 2 == 0).then_some(handles_twice / 2),
            closed,
            oriented: usage.oriented,
            volume,
            area,
            bounds: measure.bounds(self),
            degenerate_faces,
        }
    }
}

/// Parts that the edges of a boundary make up.
fn loops(verts: usize, boundary: &[[u32; 2]]) -> usize {
    if boundary.is_empty() {
        return 0;
    }
    let roots = connected(verts, boundary.iter().copied());
    let mut of_edges: Vec<u32> = boundary.iter().map(|&[v, _]| roots[v as usize]).collect();
    of_edges.sort_unstable();
    of_edges.dedup();
    of_edges.len()
}

/// How the edges of a mesh are used.
struct EdgeUsage {
    edges: usize,
    /// The ends of the edges that are in one face only.
    boundary: Vec<[u32; 2]>,
    nonmanifold: usize,
    oriented: bool,
}

impl EdgeUsage {
    /// Puts each use of an edge with its lower vertex, then sorts the few uses there by the other vertex.
    fn of(verts: usize, faces: &[[u32; 3]]) -> Self {
        let sides = || {
            faces
                .iter()
                .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
                .filter(|[a, b]| a != b)
                .map(|[a, b]| (a.min(b) as usize, u64::from(a.max(b)) << 1 | u64::from(a > b)))
        };
        let mut end = vec![0usize; verts + 1];
        for (lower, _) in sides() {
            end[lower + 1] += 1;
        }
        for i in 0..verts {
            end[i + 1] += end[i];
        }
        // Filling moves each start to its end, which is the next one's start.
        let mut uses = vec![0u64; end[verts]];
        for (lower, side) in sides() {
            uses[end[lower]] = side;
            end[lower] += 1;
        }
        let mut usage = EdgeUsage { edges: 0, boundary: Vec::new(), nonmanifold: 0, oriented: true };
        let mut start = 0;
        for (lower, &end) in (0..).zip(&end[..verts]) {
            let bucket = &mut uses[start..end];
            bucket.sort_unstable();
            for edge in bucket.chunk_by(|a, b| a >> 1 == b >> 1) {
                let backward = edge.iter().filter(|&&side| side & 1 == 1).count();
                usage.edges += 1;
                if edge.len() == 1 {
                    usage.boundary.push([lower, (edge[0] >> 1) as u32]);
                }
                usage.nonmanifold += usize::from(edge.len() > 2);
                usage.oriented &= backward <= 1 && edge.len() - backward <= 1;
            }
            start = end;
        }
        usage
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{level_set, tetrahedron};
    use super::*;
    use crate::geometry::vec3::{dot, sub};
    use crate::geometry::{TetGrid, edge_crossings, march};
    use proptest::prelude::*;
    use std::collections::{BTreeMap, BTreeSet};

    #[test]
    fn a_tetrahedron_by_hand() {
        let t = tetrahedron(1000.0).topology();
        assert_eq!((t.verts, t.edges, t.faces, t.components), (4, 6, 4, 1));
        assert_eq!((t.euler, t.genus, t.closed, t.oriented), (2, Some(0), true, true));
        assert!((t.volume - 1.0 / 6.0).abs() < 1e-12);
        assert!((t.area - (1.5 + 0.75f64.sqrt())).abs() < 1e-12);
        assert_eq!(t.bounds, Some([[1000.0; 3], [1001.0; 3]]));
        let text = t.to_string();
        assert!(text.starts_with(
            "4 vertices, 6 edges, 4 faces; 1 component, Euler number 2, genus 0; closed, oriented; volume 0.1666667, area 2.366025; from [1000, 1000, 1000] to [1001, 1001, 1001]"
        ));
    }

    #[test]
    fn faults_are_counted() {
        let mut open = tetrahedron(0.0);
        open.faces.pop();
        let t = open.topology();
        assert_eq!((t.boundary_edges, t.closed, t.oriented, t.genus), (3, false, true, None));
        let mut flipped = tetrahedron(0.0);
        flipped.faces[3] = [1, 3, 2];
        let t = flipped.topology();
        assert_eq!((t.closed, t.oriented, t.genus), (true, false, None));
        let mut fin = tetrahedron(0.0);
        fin.verts.push([2.0; 3]);
        fin.verts.push([3.0; 3]);
        fin.faces.extend([[0, 1, 4], [2, 2, 3]]);
        let t = fin.topology();
        assert_eq!((t.nonmanifold_edges, t.boundary_edges, t.degenerate_faces, t.unused_verts), (2, 2, 1, 1));
        assert!(fin.topology().to_string().contains("not closed, not oriented, 2 boundary edges"));
        let mut torn = tetrahedron(0.0);
        torn.verts[1][2] = f32::NAN;
        let t = torn.topology();
        assert!(t.volume.is_nan() && t.area.is_nan() && t.bounds.unwrap()[0][2].is_nan());
    }

    #[test]
    fn the_empty_mesh() {
        let mut empty: TriangleMesh = TriangleMesh::default();
        let t = empty.topology();
        assert_eq!((t.components, t.euler, t.closed, t.genus, t.bounds), (0, 0, false, None, None));
        assert!(empty.vertex_normals().is_empty() && empty.split_components().is_empty());
        assert_eq!(empty.remove_unused_verts(), 0);
    }

    #[test]
    #[should_panic(expected = "face 4 is [0, 1, 4], but there are 4 vertices")]
    fn a_missing_vertex_is_refused() {
        let mut mesh = tetrahedron(0.0);
        mesh.faces.push([0, 1, 4]);
        mesh.topology();
    }

    /// Sphere, torus and two spheres: the right topology at once, volume and area with an error that falls with the
    /// square of the spacing of the grid.
    #[test]
    fn known_shapes_converge() {
        use std::f64::consts::PI;
        let ball = |p: [f64; 3], c: f64, r: f64| dot(sub(p, [c, 0.0, 0.0]), sub(p, [c, 0.0, 0.0])).sqrt() - r;
        let sphere = |p| ball(p, 0.0, 0.8);
        let torus = |[x, y, z]: [f64; 3]| (x.hypot(y) - 0.6).hypot(z) - 0.25;
        let two = |p| ball(p, -0.5, 0.4).min(ball(p, 0.5, 0.3));
        type Field<'a> = &'a dyn Fn([f64; 3]) -> f64;
        let shapes: [(Field<'_>, i64, i64, f64, f64); 3] = [
            (&sphere, 2, 0, 4.0 / 3.0 * PI * 0.512, 4.0 * PI * 0.64),
            (&torus, 0, 1, 2.0 * PI * PI * 0.6 * 0.0625, 4.0 * PI * PI * 0.6 * 0.25),
            (&two, 4, 0, 4.0 / 3.0 * PI * (0.064 + 0.027), 4.0 * PI * (0.16 + 0.09)),
        ];
        for (field, euler, genus, volume, area) in shapes {
            let errors = [18, 34].map(|resolution| {
                let t = level_set(resolution, field).topology();
                assert!(t.closed && t.oriented && t.degenerate_faces == 0, "{t}");
                assert_eq!((t.euler, t.genus), (euler, Some(genus)));
                assert_eq!(t.components as i64, euler / 2 + genus);
                [t.volume / volume - 1.0, t.area / area - 1.0]
            });
            for (coarse, fine) in errors[0].into_iter().zip(errors[1]) {
                assert!(coarse.abs() < 0.08 && fine.abs() < 0.4 * coarse.abs(), "{coarse} {fine}");
            }
        }
    }

    /// Counts through ordered maps, one entry at a time.
    fn naive(mesh: &TriangleMesh) -> (usize, usize, usize, bool, usize) {
        let mut uses: BTreeMap<[u32; 2], [usize; 2]> = BTreeMap::new();
        for f in &mesh.faces {
            for i in 0..3 {
                let (a, b) = (f[i], f[(i + 1) % 3]);
                if a != b {
                    uses.entry([a.min(b), a.max(b)]).or_default()[usize::from(a > b)] += 1;
                }
            }
        }
        let count = |n: &dyn Fn(usize) -> bool| uses.values().filter(|u| n(u[0] + u[1])).count();
        let mut left: BTreeSet<usize> = (0..mesh.faces.len()).collect();
        let mut components = 0;
        while let Some(first) = left.pop_first() {
            components += 1;
            let mut queue = vec![first];
            while let Some(i) = queue.pop() {
                let touching = |j: &usize| mesh.faces[*j].iter().any(|v| mesh.faces[i].contains(v));
                let next: Vec<usize> = left.iter().copied().filter(touching).collect();
                next.iter().for_each(|j| assert!(left.remove(j)));
                queue.extend(next);
            }
        }
        let oriented = uses.values().all(|u| u[0] <= 1 && u[1] <= 1);
        (uses.len(), count(&|n| n == 1), count(&|n| n > 2), oriented, components)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]
        #[test]
        fn any_faces_agree_with_the_naive_twin(
            n in 1u32..13,
            picks in prop::collection::vec(prop::array::uniform3(0u32..1000), 0..13),
        ) {
            let verts = (0..n).map(|i| [i as f32, (i * i) as f32, 0.5 * (i % 3) as f32]).collect();
            let mesh = TriangleMesh { verts, faces: picks.iter().map(|f| f.map(|v| v % n)).collect() };
            let t = mesh.topology();
            prop_assert_eq!(
                (t.edges, t.boundary_edges, t.nonmanifold_edges, t.oriented, t.components),
                naive(&mesh)
            );
            prop_assert_eq!(mesh.split_components().len(), t.components);
            let mut used = mesh.clone();
            prop_assert_eq!(used.remove_unused_verts(), t.unused_verts);
            let again = used.topology();
            prop_assert_eq!((again.edges, again.euler, again.faces), (t.edges, t.euler, t.faces));
        }

        #[test]
        fn random_signs_give_closed_oriented_surfaces(
            r in prop::array::uniform3(1usize..7),
            draws in prop::collection::vec(-1.0f32..1.0, 343),
        ) {
            let grid = TetGrid::new(r, [-0.5; 3], 0.25);
            let ids = 0..grid.vertex_count() as u32;
            let positions: Vec<_> = ids.clone().map(|v| grid.position(v)).collect();
            let border = |v: u32| grid.is_border(grid.vertex_coords(v));
            let values: Vec<f32> =
                ids.map(|v| if border(v) { 1.0 } else { draws[v as usize % draws.len()] }).collect();
            let surface = march(&grid.tets(), |v| values[v as usize] < 0.0);
            let empty = surface.faces.is_empty();
            prop_assert_eq!(empty, values.iter().all(|&v| v >= 0.0));
            let verts = edge_crossings(&positions, &values, &surface.edges);
            let t = TriangleMesh { verts, faces: surface.faces }.topology();
            prop_assert!(t.oriented && t.euler % 2 == 0 && t.unused_verts == 0);
            prop_assert!(empty || (t.closed && t.volume > 0.0 && t.genus.is_some_and(|g| g >= 0)));
            prop_assert_eq!(t.degenerate_faces, 0);
        }
    }
}
