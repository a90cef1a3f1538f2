//! Signed distance fields and closed triangle meshes from sparse, unoriented point clouds.
#![allow(missing_docs)]
#![deny(unsafe_code)]

pub mod autodiff;
mod error;
pub mod evaluate;
pub mod gdo;
pub mod geometry;
pub mod loss;
pub mod nn;
pub mod ops;
pub mod optim;
pub mod tensor;

pub use error::{Error, ErrorKind};
