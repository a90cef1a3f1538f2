//! What training minimises: Chamfer distances, the surface term, and the optional regularisers.

mod beyond;
mod chamfer;
mod laplacian;
mod pull;
mod surface;
mod surface_distance;

pub use chamfer::Direction;
pub use pull::pull;
pub use surface::{eikonal, inside, mean_abs};
pub use surface_distance::surface_distance;
