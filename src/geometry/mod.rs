//! Points, grids and meshes: everything that has no gradient.

mod bricks;
mod level;
mod marching;
mod mesh;
mod narrow_band;
mod tet_grid;
mod topology;

pub use marching::{BandTopology, Isosurface, march};
pub use mesh::TriangleMesh;
pub use narrow_band::{ActiveSet, FieldFn, NarrowBandOptions, active_set, extract, interpolate};
pub use tet_grid::TetGrid;
pub use topology::{MeshComponent, Topology};
