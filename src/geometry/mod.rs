//! Points, grids and meshes: everything that has no gradient.

mod mesh;

pub use mesh::TriangleMesh;
