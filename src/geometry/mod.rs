//! Points, grids and meshes: everything that has no gradient.

mod bounds;
mod bricks;
mod bvh;
mod cloud;
mod figures;
mod inside;
mod knn;
mod level;
mod marching;
mod mesh;
mod narrow_band;
mod nearest;
mod position;
mod sample;
mod shapes;
mod sphere;
mod tet_grid;
mod thin;
mod topology;

pub use bounds::{Bounds, Normalizer};
pub use bvh::{SurfaceHit, TriangleBvh};
pub use cloud::{CleanCloud, clean_cloud, distinct_places};
pub use figures::{shortest, significant};
pub use knn::KdTree;
pub(crate) use knn::usable;
pub use marching::{BandTopology, Isosurface, march};
pub use mesh::TriangleMesh;
pub use narrow_band::{ActiveSet, FieldFn, NarrowBandOptions, active_set, extract, interpolate};
pub use nearest::{PointTree, nearest_points};
pub use position::{Position, about, are_f32, widened};
pub use sample::{SurfaceSamples, farthest_point_sample, sample_surface};
pub use shapes::Shape;
pub use sphere::fibonacci_sphere;
pub use tet_grid::TetGrid;
pub use thin::thin_cloud;
pub use topology::{MeshComponent, Topology};

/// Squared distance, summed x, y, z in that order; every neighbour search ranks by exactly these bits.
#[inline]
fn point_dist_sq(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}
