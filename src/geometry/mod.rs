//! Points, grids and meshes: everything that has no gradient.

mod attribute;
mod axes;
mod bounds;
mod cloud;
mod even;
mod farthest;
mod figures;
mod grid;
mod mesh;
mod position;
mod ranks;
mod scenes;
mod search;
mod shapes;
mod spacing;
mod sphere;
mod thin;
pub(crate) mod vec3;

pub use attribute::{Attribute, Number};
pub(crate) use attribute::{COLOUR, colours};
pub(crate) use axes::{PrincipalAxes, mean_point, spread};
pub use bounds::{Bounds, Normalizer};
pub use cloud::{CleanCloud, clean_cloud, distinct_places};
pub(crate) use even::{evened, surface_spacing};
pub use farthest::farthest_point_sample;
pub use figures::{format_shortest, format_significant};
pub use grid::{
    ActiveSet, BandTopology, FieldFn, Isosurface, NarrowBandOptions, TetGrid, active_set, edge_crossings,
    extract_mesh, march,
};
pub(crate) use grid::{CellSizes, MARGIN, WORKING_CUBE, along, crossing_share, extract_graded_mesh};
pub use mesh::{MeshComponent, SurfaceSamples, Topology, TriangleMesh, sample_surface};
pub(crate) use mesh::{connected, cumulative_areas};
pub use position::{Position, are_f32, relative_to, widened};
pub(crate) use ranks::{median, quantile, ranked};
pub use scenes::{SpinningScanner, SyntheticScene};
pub(crate) use search::usable;
pub use search::{KdTree, PointTree, SurfaceHit, TriangleBvh, nearest_points};
pub use shapes::AnalyticShape;
pub(crate) use spacing::{nearest_distances, neighbour_spacing};
pub use sphere::fibonacci_sphere;
pub use thin::thin_points;
