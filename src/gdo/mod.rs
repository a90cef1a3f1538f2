//! Grid deformation optimization: the field, the move of the grid's vertices along it, and the differentiable surface.

mod crossing;
mod deform;
mod field;
mod gauss;

pub use deform::{Deformation, deform};
pub use field::{Activation, Field, FieldConfig, FieldPass};
pub use gauss::GaussField;
