//! What training minimises: Chamfer distances, the surface term, and the optional regularisers.

mod chamfer;
mod laplacian;
mod surface;

pub use chamfer::Direction;
pub use surface::{eikonal, surface_term};
