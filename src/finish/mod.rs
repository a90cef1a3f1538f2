//! Corrections to the trained field, by its values at the denoised points.

mod blend;
#[allow(clippy::module_inception)]
mod finish;
mod residual;

pub(crate) use finish::{FINISHED_POINTS, Finish};
