//! The tetrahedral grid: marching tetrahedra, and the search for the part of the grid that the surface crosses.

mod bricks;
mod lattice;
mod marching;
mod narrow_band;
mod tet_grid;

pub use marching::{BandTopology, Isosurface, march};
pub use narrow_band::{ActiveSet, FieldFn, NarrowBandOptions, active_set, extract, interpolate};
pub use tet_grid::TetGrid;
