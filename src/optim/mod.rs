//! Optimisation: Adam, gradient clipping, learning-rate schedules; L-BFGS for smooth functions of few unknowns.
//!
//! Everything works on slices of tensors in the order of their parameters, so that nothing here needs to know about
//! layers.

mod adam;
mod clip;
mod lbfgs;
mod schedule;

pub use adam::{Adam, AdamOptions};
pub use clip::{clip_norm, gradient_norm};
pub use lbfgs::{LbfgsOptions, LbfgsReport, lbfgs};
pub use schedule::{Decay, Schedule};
