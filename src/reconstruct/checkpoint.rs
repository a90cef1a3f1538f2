//! Saving and loading.
#![cfg(feature = "checkpoint")]

use super::{Config, Reconstruction, Trainer};
use crate::error::{Error, ErrorKind};
use std::path::Path;

impl Trainer {
    /// Saves the state.
    pub fn save_checkpoint(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        Err(Error::new(ErrorKind::Checkpoint, "not yet").in_file(path))
    }

    /// Takes up a run.
    pub fn resume(path: impl AsRef<Path>, _points: &[[f32; 3]], _config: &Config) -> Result<Trainer, Error> {
        Err(Error::new(ErrorKind::Checkpoint, "not yet").in_file(path))
    }
}

impl Reconstruction {
    /// Saves the result.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        Err(Error::new(ErrorKind::Checkpoint, "not yet").in_file(path))
    }

    /// Loads a result.
    pub fn load(path: impl AsRef<Path>) -> Result<Reconstruction, Error> {
        Err(Error::new(ErrorKind::Checkpoint, "not yet").in_file(path))
    }
}
