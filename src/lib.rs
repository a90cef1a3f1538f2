//! Signed distance fields and closed triangle meshes from sparse, unoriented point clouds.
#![allow(missing_docs)]
#![deny(unsafe_code)]

mod atomic;
pub mod autodiff;
pub mod bsp;
mod error;
pub mod evaluate;
pub mod gdo;
pub mod geometry;
pub mod io;
pub mod loss;
pub mod nn;
pub mod ops;
pub mod optim;
pub mod reconstruct;
pub mod tensor;

pub use error::{Error, ErrorKind};
pub use reconstruct::{Config, Preset, Reconstruction, Trainer, reconstruct};
