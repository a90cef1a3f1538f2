//! The signed distance field g, a network, and the fused pass that training takes its values and gradients from.

#[allow(clippy::module_inception)]
mod field;
mod network;
mod pass;
mod rows;

pub(crate) use field::octave_factor;
pub use field::{Activation, Field, FieldConfig, FieldVars};
pub use pass::{FieldPass, FieldValues};
