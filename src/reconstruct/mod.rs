//! Training, from a cloud to a field and a mesh.
//!
//! [`Config`] holds every option, [`reconstruct`] runs it all, [`Trainer`] does the same step by step and can be saved
//! and resumed, and [`Reconstruction`] is the result. One step, in the words of the paper: the field g moves the active
//! vertices V of a tetrahedral grid to V' (equation 4), marching tetrahedra take the surface from them, and L_deform
//! (equation 5) draws it to the parameterized surface S, which L_para (equation 3) keeps at the points Q.
//!
//! Two [phases](Phase) of quicker steps come first: the field learns a first shape, and S is trained alone.

mod band;
mod bridges;
#[cfg(feature = "checkpoint")]
mod checkpoint;
mod coded;
mod config;
mod far;
mod first_shape;
mod model;
mod objective;
mod options;
mod phases;
mod preset;
mod run;
#[cfg(feature = "checkpoint")]
mod saved;
#[cfg(feature = "checkpoint")]
mod saved_cloud;
#[cfg(feature = "checkpoint")]
mod saved_options;
mod scale;
mod step;
#[cfg(feature = "checkpoint")]
mod store;
mod trainer;

pub use coded::Coded;
pub use config::{Band, Batch, Config, Finishing, Stage, Start, StartShape, Target, Weights};
pub use model::Reconstruction;
pub use phases::Phase;
pub use preset::Preset;
pub use run::{Event, reconstruct};
#[cfg(feature = "checkpoint")]
pub use saved::{Saved, SavedKind};
pub use step::StepReport;
pub use trainer::Trainer;

#[cfg(test)]
mod ablations;
#[cfg(test)]
mod tests;
