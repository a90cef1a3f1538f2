//! Points, grids and meshes: everything that has no gradient.

mod bounds;
mod cloud;
mod grid;
mod mesh;
mod search;
mod shapes;
mod sphere;
mod thin;

pub use bounds::{Bounds, Normalizer};
pub use cloud::{CleanCloud, clean_cloud, distinct_places};
pub use grid::{
    ActiveSet, BandTopology, FieldFn, Isosurface, NarrowBandOptions, TetGrid, active_set, extract,
    interpolate, march,
};
pub use mesh::{
    MeshComponent, SurfaceSamples, Topology, TriangleMesh, farthest_point_sample, sample_surface,
};
pub(crate) use search::usable;
pub use search::{KdTree, PointTree, SurfaceHit, TriangleBvh, nearest_points};
pub use shapes::Shape;
pub use sphere::fibonacci_sphere;
pub use thin::thin_cloud;

/// Squared distance, summed x, y, z in that order; every neighbour search ranks by exactly these bits.
#[inline]
fn point_dist_sq(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}
