//! Triangle meshes: what they consist of, a report of what they are like, and random points on them.

mod report;
mod sample;
mod triangle_mesh;

pub use report::{MeshComponent, Topology};
pub use sample::{SurfaceSamples, farthest_point_sample, sample_surface};
pub(super) use sample::{cross, dot, sub};
pub use triangle_mesh::TriangleMesh;
