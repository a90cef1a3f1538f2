//! Triangle meshes: what they consist of, a report of what they are like, their parts and changes, and random points
//! on them.

mod edit;
mod measure;
mod parts;
mod report;
mod sample;
#[cfg(test)]
mod testing;
mod triangle_mesh;

pub use parts::MeshComponent;
pub(crate) use parts::connected;
pub use report::Topology;
pub(crate) use sample::cumulative_areas;
pub use sample::{SurfaceSamples, sample_surface};
pub use triangle_mesh::TriangleMesh;
