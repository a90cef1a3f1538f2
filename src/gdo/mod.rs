//! Grid deformation optimization: the field, the move of the grid's vertices along it, and the differentiable surface.

mod cholesky;
mod crossing;
mod deform;
mod denoise;
mod faces;
mod field;
mod gauss;
mod network;
mod pass;
mod rows;
mod start;
mod thin_plate;

pub use deform::{Deformation, deform};
pub use denoise::{DENOISED_POINTS, Denoised, denoise};
pub use faces::sample_faces;
pub use field::{Activation, Field, FieldConfig, FieldVars};
pub use gauss::GaussField;
pub(crate) use gauss::spacing;
pub use pass::{FieldPass, FieldValues};
pub use start::{ShapeFit, ShapeFitStep, USUAL_AREA, best_fitting, gauss_shape, gauss_shapes, plate_shapes};
pub use thin_plate::ThinPlate;
