//! Optimisation of parameters: Adam, gradient clipping, learning-rate schedules.
//!
//! Everything works on slices of tensors in the order of their parameters, so that nothing here needs to know about
//! layers.

mod adam;
mod clip;
mod schedule;

pub use adam::{Adam, AdamOptions};
pub use clip::{clip_norm, gradient_norm};
pub use schedule::{Decay, Schedule};
