//! Triangle meshes: what they consist of, a report of what they are like, and random points on them.

mod report;
mod sample;
mod triangle_mesh;

pub(crate) use report::connected;
pub use report::{MeshComponent, Topology};
pub(crate) use sample::cumulative_areas;
pub use sample::{SurfaceSamples, sample_surface};
pub use triangle_mesh::TriangleMesh;
