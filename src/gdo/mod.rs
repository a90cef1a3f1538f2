//! Grid deformation optimization: the field, the move of the grid's vertices along it, and the differentiable surface.

mod cholesky;
mod crossing;
mod deform;
mod denoise;
mod faces;
mod field;
mod finish;
mod first_shapes;
mod forecast;
mod gauss;
mod network;
mod outliers;
mod pass;
mod plate_blend;
mod residual;
mod resolution;
mod rows;
mod sampling;
mod shape_fit;
mod thin_plate;

pub use deform::{Deformation, deform};
pub use denoise::{DENOISED_POINTS, Denoised, denoise};
pub(crate) use faces::FaceSamples;
pub use faces::sample_faces;
pub(crate) use field::octave_factor;
pub use field::{Activation, Field, FieldConfig, FieldVars};
pub use finish::{FINISHED_POINTS, Finish};
pub use first_shapes::{best_fitting, gauss_shape, gauss_shapes, plate_shapes};
pub use gauss::GaussField;
pub(crate) use gauss::spacing;
pub use outliers::{Suspicion, find_outliers};
pub use pass::{FieldPass, FieldValues};
pub use resolution::{USUAL_AREA, resolution_for_area};
pub use sampling::Sampling;
pub use shape_fit::{ShapeFit, ShapeFitStep};
pub use thin_plate::ThinPlate;
