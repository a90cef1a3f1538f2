//! Training, from a cloud to a field and a mesh.

mod config;
mod step;

pub use config::{Config, Preset, Stage, Start, Target, Weights};
pub use step::{StepReport, Trainer};
