//! The indexed triangle mesh.

use crate::geometry::vec3::{length, triangle_normal};
use crate::geometry::{Bounds, Position, relative_to, widened};

/// An indexed triangle mesh; counter-clockwise winding seen from outside.
///
/// Meshes in the frame of a user have 64-bit vertices: `TriangleMesh<[f64; 3]>`. What is computed with is a mesh of 32
/// bits, less an offset where the coordinates are large ([`offset`](Self::offset),
/// [`relative_to`](Self::relative_to)).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh<P = [f32; 3]> {
    /// Vertex positions, v x 3.
    pub verts: Vec<P>,
    /// Vertex indices of each triangle, f x 3.
    pub faces: Vec<[u32; 3]>,
}

impl<P: Position> TriangleMesh<P> {
    /// The mesh with its vertices in 64 bits; exact.
    pub fn wide(&self) -> TriangleMesh<[f64; 3]> {
        TriangleMesh { verts: widened(&self.verts), faces: self.faces.clone() }
    }

    /// What to subtract so that 32 bits hold the detail of the mesh, see [`Bounds::offset`]; 0 for one without vertices
    /// or with a coordinate that is not finite.
    pub fn offset(&self) -> [f64; 3] {
        Bounds::of(&self.verts).map_or([0.0; 3], |bounds| bounds.offset())
    }

    /// The mesh in 32 bits, less an offset.
    pub fn relative_to(&self, offset: [f64; 3]) -> TriangleMesh {
        TriangleMesh { verts: relative_to(&self.verts, offset), faces: self.faces.clone() }
    }

    /// Unit normals at the vertices, v x 3: the mean of the face normals around each, weighted by area.
    ///
    /// They point outwards where faces run counter-clockwise seen from outside. A vertex without faces, or whose
    /// faces cancel, has the zero vector.
    ///
    /// # Panics
    ///
    /// If a face names a vertex that is not there.
    #[track_caller]
    pub fn vertex_normals(&self) -> Vec<[f32; 3]> {
        self.check_faces("vertex_normals");
        let mut sums = vec![[0.0f64; 3]; self.verts.len()];
        for &face in &self.faces {
            let normal = triangle_normal(face.map(|v| self.verts[v as usize].wide()));
            for v in face {
                (0..3).for_each(|i| sums[v as usize][i] += normal[i]);
            }
        }
        let unit = |n: [f64; 3]| {
            let len = length(n);
            if len == 0.0 { [0.0; 3] } else { n.map(|x| (x / len) as f32) }
        };
        sums.into_iter().map(unit).collect()
    }

    /// Panics if a face names a vertex that is not there, in the name of the method that `what` says.
    #[track_caller]
    pub(super) fn check_faces(&self, what: &str) {
        let n = self.verts.len();
        for (i, face) in self.faces.iter().enumerate() {
            assert!(
                face.iter().all(|&v| (v as usize) < n),
                "{what}: face {i} is {face:?}, but there are {n} vertices"
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::level_set;
    use super::*;
    use crate::geometry::AnalyticShape;
    use crate::geometry::vec3::dot;

    #[test]
    fn a_mesh_far_away_is_measured_as_one_at_the_origin() {
        let near = AnalyticShape::Sphere { radius: 0.5 };
        let points = near.sample(12, 1).0;
        let faces = vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        let near = TriangleMesh { verts: points, faces }.wide();
        assert_eq!(near.offset(), [0.0; 3]);
        let at = [500_000.0, 5_400_000.0, 300.0];
        let verts = near.verts.iter().map(|v| std::array::from_fn(|a| v[a] + at[a])).collect();
        let far = TriangleMesh { verts, faces: near.faces.clone() };
        let (a, b) = (near.topology(), far.topology());
        assert!((a.volume - b.volume).abs() < 1e-6 * a.area && (a.area - b.area).abs() < 1e-6 * a.area);
        assert_eq!((b.genus, b.degenerate_faces), (Some(0), 0));
        let [low, high] = b.bounds.unwrap();
        assert!((0..3).all(|k| low[k] >= at[k] - 0.5 && high[k] <= at[k] + 0.5 && high[k] - low[k] > 0.1));
    }

    #[test]
    fn sphere_normals_point_outwards() {
        let mesh = level_set(18, |p| length(p) - 0.8);
        for (n, p) in mesh.vertex_normals().iter().zip(&mesh.verts) {
            let (n, p) = (n.map(f64::from), p.map(f64::from));
            assert!((dot(n, n) - 1.0).abs() < 1e-6);
            assert!(dot(n, p) / length(p) > 0.97);
        }
    }
}
