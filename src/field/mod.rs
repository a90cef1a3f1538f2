//! The signed distance field g, a network; as tape operations, and fused into one operation for training.

mod config;
#[allow(clippy::module_inception)]
mod field;
mod fused;
mod network;
mod pass;
mod rows;
mod values;

pub(crate) use config::octave_factor;
pub use config::{FieldActivation, FieldConfig};
pub use field::{Field, FieldVars};
pub use fused::FieldMemory;
pub(crate) use pass::FieldPass;
