//! Searches: the points nearest to a place, the triangle nearest to it, and whether it is inside a mesh.

mod bvh;
mod inside;
mod kd_tree;
mod nearest;
mod triangle;

pub use bvh::{SurfaceHit, TriangleBvh};
pub use kd_tree::KdTree;
pub(crate) use kd_tree::usable;
pub use nearest::{PointTree, nearest_points};
