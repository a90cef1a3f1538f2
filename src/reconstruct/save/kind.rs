//! The kinds of saved files, and the versions of their forms.

use super::store::Store;
use crate::error::{Error, ErrorKind};

/// What a file holds, and in which versions of its form this program reads it.
pub(super) struct Kind {
    pub name: &'static str,
    /// The version that is written, and the latest that is read.
    version: u32,
    /// The oldest version that is read.
    oldest: u32,
}

/// A state of a run, to go on from. Runs of earlier versions had their points in another order.
pub(super) const CHECKPOINT: Kind = Kind { name: "checkpoint", version: 7, oldest: 6 };
/// A result. Files of version 2 are read by all later programs. Options may come, go and change their names within a
/// version, as far as [`options`](super::options) says what stands for those that are missing; the version grows with a
/// change of meaning.
pub(super) const RECONSTRUCTION: Kind = Kind { name: "reconstruction", version: 6, oldest: 2 };

impl Kind {
    /// Puts the kind and its version into a file.
    pub fn put(&self, store: &mut Store) {
        store.put("kind", format!("{} {}", self.name, self.version));
    }

    /// The version of a file, which has to be of this kind.
    pub fn check(&self, store: &Store) -> Result<u32, Error> {
        let Kind { name, version, oldest } = self;
        let found = store.get("kind")?;
        let advice = match found.split_once(' ').map(|(kind, v)| (kind == *name, v.parse::<u32>())) {
            Some((true, Ok(v))) if (*oldest..=*version).contains(&v) => return Ok(v),
            Some((true, Ok(v))) if v > *version => {
                "a later version of this program wrote it: read it with that"
            }
            Some((true, _)) => "an early version of this program wrote it: start anew",
            _ => "a checkpoint is for --resume, a field for `mesh` and `sdf`",
        };
        let message =
            format!("it is a {}, not a {}", in_words(found), in_words(&format!("{name} {version}")));
        Err(Error::new(ErrorKind::Checkpoint, message).advise(advice))
    }
}

/// A kind and its version, such as `reconstruction 6`, as messages name it.
fn in_words(kind: &str) -> String {
    match kind.split_once(' ') {
        Some((name, version)) => {
            let name = if name == RECONSTRUCTION.name { "field" } else { name };
            format!("{name} of version {version}")
        }
        None => format!("file of the kind {kind:?}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_kinds_and_versions_are_refused() {
        let advice = |kind: &str| {
            let mut store = Store::default();
            store.put("kind", kind);
            RECONSTRUCTION.check(&store).map_err(|e| e.advice().unwrap().to_string())
        };
        (2..7).for_each(|v| assert_eq!(advice(&format!("reconstruction {v}")), Ok(v)));
        assert!(advice("reconstruction 7").unwrap_err().contains("later version"));
        assert!(advice("reconstruction 1").unwrap_err().contains("early version"));
        for other in ["checkpoint 2", "reconstruction", ""] {
            assert!(advice(other).unwrap_err().contains("a checkpoint is for --resume"), "{other}");
        }
    }
}
