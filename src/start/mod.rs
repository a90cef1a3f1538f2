//! What comes before the training: the first shape that is found among the points, the points without their noise,
//! and the regression that the field learns the shape by.

mod candidates;
mod denoise;
mod fit;
mod forecast;
mod gauss;
mod plate;
mod resolution;

pub use candidates::{best_fitting, gauss_shape, gauss_shapes, plate_shapes};
pub use denoise::{DENOISED_POINTS, Denoised, denoise};
pub use fit::{ShapeFit, ShapeFitStep};
pub(crate) use forecast::{covariances, forecasts};
pub use gauss::GaussField;
pub use plate::ThinPlate;
pub(crate) use plate::{MAX_CENTRES, System, directions};
pub use resolution::{USUAL_AREA, resolution_for_area};
