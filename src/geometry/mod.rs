//! Points, grids and meshes: everything that has no gradient.

mod marching;
mod mesh;
mod tet_grid;

pub use marching::{BandTopology, Isosurface, march};
pub use mesh::TriangleMesh;
pub use tet_grid::TetGrid;
