//! Training, from a cloud to a field and a mesh.

mod config;
mod step;

pub use config::{Config, Preset, Start, Stage, Target, Weights};
pub use step::{StepReport, Trainer};
