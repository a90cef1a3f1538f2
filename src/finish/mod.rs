//! What comes after the training: corrections to the field from what it is off by at the points.

mod blend;
#[allow(clippy::module_inception)]
mod finish;
mod residual;

pub(crate) use finish::{FINISHED_POINTS, Finish};
