//! Signed distance fields and closed triangle meshes from sparse, unoriented point clouds.
#![deny(missing_docs)]
#![deny(unsafe_code)]

mod error;
pub mod geometry;
pub mod io;

pub use error::{Error, ErrorKind};
