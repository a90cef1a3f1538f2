//! The indexed triangle mesh.

/// An indexed triangle mesh; counter-clockwise winding seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions, v x 3.
    pub verts: Vec<[f32; 3]>,
    /// Vertex indices of each triangle, f x 3.
    pub faces: Vec<[u32; 3]>,
}
