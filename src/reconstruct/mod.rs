//! Training, from a cloud to a field and a mesh.

mod checkpoint;
mod config;
mod model;
mod options;
mod preset;
mod run;
mod step;

pub use config::{Band, Batch, Config, Stage, Start, StartShape, Target, Weights};
pub use model::Reconstruction;
pub use preset::Preset;
pub use run::{Event, reconstruct};
pub use step::{StepReport, Trainer};
