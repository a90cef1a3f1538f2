//! The tetrahedral grid: marching tetrahedra, and the search for the part of the grid that the surface crosses.

mod active_set;
mod bricks;
mod crossing;
mod graded;
mod level;
mod marching;
mod narrow_band;
mod tet_grid;

pub use active_set::{ActiveSet, FieldFn};
pub(crate) use crossing::{MARGIN, along, crossing_share};
pub use graded::{CellSizes, extract_graded_mesh};
pub use marching::{BandTopology, Isosurface, march};
pub use narrow_band::{NarrowBandOptions, active_set, edge_crossings, extract_mesh};
pub use tet_grid::TetGrid;
pub(crate) use tet_grid::WORKING_CUBE;
