//! The signed distance field g, a network, with its spatial gradient: one operation of the tape for training.

mod config;
#[allow(clippy::module_inception)]
mod field;
mod fused;
mod network;
mod pass;
mod rows;
#[cfg(test)]
mod testing;
mod values;

pub(crate) use config::octave_factor;
pub use config::{FieldActivation, FieldConfig};
pub use field::{Field, FieldVars};
pub use fused::FieldMemory;
pub(crate) use pass::FieldPass;
