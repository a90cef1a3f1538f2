//! Points, grids and meshes: everything that has no gradient.

mod cloud;
mod mesh;

pub use cloud::{CleanCloud, clean_cloud};
pub use mesh::TriangleMesh;
