//! Grid deformation optimization: the move of the grid's vertices along the field, and the differentiable surface.

mod crossing;
mod deform;
mod samples;

pub use deform::{Deformation, deform};
pub(crate) use samples::FaceSamples;
