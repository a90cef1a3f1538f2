//! Points, grids and meshes: everything that has no gradient.

mod bounds;
mod bvh;
mod knn;
mod mesh;
mod sample;
mod shapes;
mod sphere;

pub use bounds::{Bounds, Normalizer};
pub use bvh::{SurfaceHit, TriangleBvh};
pub use knn::KdTree;
pub use mesh::TriangleMesh;
pub use sample::{SurfaceSamples, farthest_point_sample, sample_surface};
pub use shapes::Shape;
pub use sphere::fibonacci_sphere;

/// Squared distance, summed x, y, z in that order; every neighbour search ranks by exactly these bits.
#[inline]
fn point_dist_sq(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}
