//! Training, from a cloud to a field and a mesh.

#[cfg(feature = "checkpoint")]
mod checkpoint;
mod config;
mod model;
mod objective;
mod options;
mod preset;
mod run;
mod step;
#[cfg(feature = "checkpoint")]
mod store;
mod trainer;

pub use config::{Band, Batch, Config, Stage, Start, StartShape, Target, Weights};
pub use model::Reconstruction;
pub use preset::Preset;
pub use run::{Event, reconstruct};
pub use step::StepReport;
pub use trainer::Trainer;

#[cfg(test)]
mod tests;
