//! What a saved file tells without the input points that a checkpoint needs to be resumed.

use super::kind::{CHECKPOINT, RECONSTRUCTION};
use super::options;
use super::store::{Store, damaged, looks_like_store};
use crate::error::Error;
use crate::reconstruct::final_shape::FinalShape;
use crate::reconstruct::{Config, Reconstruction};

/// A summary of a saved file; to resume a checkpoint, its input points are needed as well.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Saved {
    /// A state to resume from, or a result.
    pub kind: SavedKind,
    /// The version of the file's form.
    pub version: u32,
    /// The options of the run, adapted to the number of points.
    pub config: Config,
    /// Notices about the options, as [`Reconstruction::notices`].
    pub notices: Vec<String>,
    /// The number of input points.
    pub points: usize,
    /// Whether a network was trained; without, a result is the first shape, and the field of the options is not there.
    pub trained: bool,
}

/// The kinds of saved files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SavedKind {
    /// Of [`Trainer::save_checkpoint`](crate::Trainer::save_checkpoint).
    Checkpoint {
        /// Steps done.
        step: usize,
        /// Steps of all phases.
        total_steps: usize,
        /// How often the run went back to a good state.
        recoveries: usize,
    },
    /// Of [`Reconstruction::save`].
    Result,
}

impl Saved {
    /// Whether bytes begin like a file that this crate saved.
    pub fn is_saved(bytes: &[u8]) -> bool {
        looks_like_store(bytes)
    }

    /// Reads what can be said about the bytes of a file.
    ///
    /// # Errors
    /// [`ErrorKind::Checkpoint`](crate::ErrorKind::Checkpoint) if they are damaged, or neither a checkpoint nor a
    /// result.
    pub fn from_bytes(bytes: &[u8]) -> Result<Saved, Error> {
        let store = Store::decode(bytes)?;
        if store.get("kind")?.starts_with(RECONSTRUCTION.name) {
            let version = RECONSTRUCTION.check(&store)?;
            let result = Reconstruction::of_store(&store)?;
            let Reconstruction { config, notices, input, shape, .. } = result;
            let trained = matches!(shape, FinalShape::Learned(_));
            return Ok(Saved {
                kind: SavedKind::Result,
                version,
                config,
                notices,
                points: input.len(),
                trained,
            });
        }
        let version = CHECKPOINT.check(&store)?;
        let (config, notices) = options::of_run(&store, version)?;
        let points = store.get("cloud")?.split(' ').next().and_then(|n| n.parse().ok());
        let kind = SavedKind::Checkpoint {
            step: store.parse("now.step")?,
            total_steps: config.total_steps(),
            recoveries: store.parse("recoveries")?,
        };
        let points = points.ok_or_else(|| damaged("it does not say how many input points there are"))?;
        Ok(Saved { kind, version, config, notices, points, trained: true })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::Trainer;
    use crate::reconstruct::tests::{ball, tiny};

    #[test]
    fn files_say_what_they_are() {
        let file = std::env::temp_dir().join(format!("bijective-sdf-saved-{}", std::process::id()));
        let mut trainer = Trainer::new(&ball(50), &tiny()).unwrap();
        for _ in 0..3 {
            trainer.step().unwrap();
        }
        trainer.save_checkpoint(&file).unwrap();
        let bytes = std::fs::read(&file).unwrap();
        std::fs::remove_file(file).unwrap();
        let run = Saved::from_bytes(&bytes).unwrap();
        assert_eq!(run.kind, SavedKind::Checkpoint { step: 3, total_steps: 47, recoveries: 0 });
        assert_eq!((run.points, &run.config, run.notices.len()), (50, trainer.config(), 0));
        let result = trainer.finish();
        let bytes = [bytes, result.to_bytes().unwrap()];
        let summary = Saved::from_bytes(&bytes[1]).unwrap();
        assert_eq!((summary.kind, summary.points, &summary.config), (SavedKind::Result, 50, result.config()));
        let again = Reconstruction::from_bytes(&bytes[1]).unwrap();
        assert_eq!(again.sdf(&ball(5)), result.sdf(&ball(5)));
        for bytes in &bytes {
            assert!(Saved::is_saved(bytes) && !Saved::is_saved(&bytes[1..]));
            assert!(Saved::from_bytes(&bytes[..bytes.len() - 1]).is_err());
        }
        assert!(!Saved::is_saved(b"") && !Saved::is_saved(b"ply\nformat ascii 1.0\n"));
    }
}
