//! Checkpoints and results in files: the checked file format, the options in files of earlier versions, and what is
//! written and read.

mod checkpoint;
mod input;
mod kind;
mod options;
mod params;
mod result;
mod saved;
mod store;

pub use saved::{Saved, SavedKind};
