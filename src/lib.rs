//! Signed distance fields and closed triangle meshes from sparse, unoriented point clouds.
#![deny(missing_docs)]
#![deny(unsafe_code)]

pub mod autodiff;
mod error;
pub mod geometry;
pub mod nn;
pub mod ops;
pub mod optim;
pub mod tensor;

pub use error::{Error, ErrorKind};
