//! The signed distance field g, a network, and the fused pass that training takes its values and gradients from.

mod config;
#[allow(clippy::module_inception)]
mod field;
mod network;
mod pass;
mod rows;
mod values;

pub(crate) use config::octave_factor;
pub use config::{Activation, FieldConfig};
pub use field::{Field, FieldVars};
pub use pass::{FieldPass, FieldValues};
