//! What comes before the training: the kind of sampling that the input points are and the strays among them, the first
//! shape that is found among the working points, the denoised points, and the regression that the field learns the
//! shape by.

mod candidates;
mod denoise;
mod fit;
mod forecast;
mod gauss;
mod least_bending;
mod local_plates;
mod outliers;
mod plate;
mod plate_shapes;
mod ramp;
mod resolution;
mod sampling;
mod sides;
mod uneven;

#[cfg(test)]
pub(crate) use candidates::gauss_shape;
pub(crate) use candidates::{COARSE, best_fitting, gauss_shapes};
pub(crate) use denoise::{DENOISED_POINTS, Denoised, denoise};
pub(crate) use fit::ShapeFit;
pub(crate) use gauss::GaussField;
pub(crate) use least_bending::{LeastBending, MAX_PLATE_POINTS};
pub use outliers::{Suspicion, find_outliers};
pub(crate) use plate_shapes::plate_shapes;
pub(crate) use ramp::Ramp;
pub(crate) use resolution::{USUAL_AREA, resolution_for_area};
pub use sampling::Sampling;
pub use sides::{behind_others, contradicting, facing};
pub use uneven::AnisotropicSpacing;
