//! Training, from input points to a field and a mesh.
//!
//! [`Config`] holds every option, [`reconstruct`] runs it all, [`Trainer`] does the same step by step and can be saved
//! and resumed, and [`Reconstruction`] is the result. One step, in the words of the paper: the field g moves the active
//! vertices V of a tetrahedral grid to V' (equation 4), marching tetrahedra take the surface from them, and L_deform
//! (equation 5) draws it to the parameterized surface S, which L_para (equation 3) keeps at the denoised points Q.
//!
//! Two [phases](Phase) of quicker steps come first: the field learns a first shape, and S is trained alone.

mod band;
mod bridges;
mod coded;
mod config;
mod far;
mod final_shape;
mod first_shape;
mod frame;
mod hints;
mod objective;
mod phase;
mod phases;
mod result;
mod run;
#[cfg(feature = "checkpoint")]
mod save;
mod setup;
mod shape_samples;
mod state;
mod trainer;

pub use coded::Coded;
pub use config::{Band, Batch, Config, Finishing, Preset, Stage, Start, StartShape, Target};
pub use hints::Hints;
pub use objective::{Terms, Weights};
pub use phase::Phase;
pub use phases::StepReport;
pub use result::Reconstruction;
pub use run::{Event, Outcome, reconstruct, reconstruct_with};
#[cfg(feature = "checkpoint")]
pub use save::{Saved, SavedKind};
pub use trainer::Trainer;

#[cfg(test)]
mod tests;
