//! A file that one run at a time may write.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use bijective_sdf::{Error, ErrorKind};

use super::failure::Failure;

/// What a run writes to the file that it locks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// Checkpoints of a reconstruction.
    Checkpoints,
    /// The runs of a suite.
    Runs,
}

impl Use {
    /// Why another run has to wait, and what to do instead.
    fn reason_and_advice(self) -> [&'static str; 2] {
        match self {
            Use::Checkpoints => [
                "writes its checkpoints to this file",
                "wait for it to end, or give another file to --checkpoint",
            ],
            Use::Runs => [
                "of `suite` writes its results to this file",
                "wait for it to end, or give another directory to --out",
            ],
        }
    }
}

/// A lock on a file, through another one beside it, as the file itself is replaced at every writing. It ends with the
/// process, however that ends; the file beside it may stay then, and is taken over by the next run.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    _file: File,
}

impl Lock {
    /// Locks a file that is to be written. Where the system locks no files, nothing is locked.
    pub fn on(path: &Path, what: Use) -> Result<Option<Lock>, Failure> {
        // What is no file, such as a device, is not replaced.
        if fs::metadata(path).is_ok_and(|meta| !meta.is_file()) {
            return Ok(None);
        }
        let beside = beside(path);
        let failed =
            |e| Failure::Output(Error::new(ErrorKind::Io, "cannot lock the file").in_file(path).caused_by(e));
        // A run that ends removes its file, maybe between our opening and our locking: then there is none to lock.
        for _ in 0..100 {
            let mut file = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .open(&beside)
                .map_err(failed)?;
            match file.try_lock() {
                Ok(()) if !is_at(&file, &beside) => {}
                Ok(()) => {
                    let id = std::process::id();
                    file.set_len(0).and_then(|()| writeln!(file, "{id}")).map_err(failed)?;
                    return Ok(Some(Lock { path: beside, _file: file }));
                }
                Err(TryLockError::WouldBlock) => {
                    let mut owner = String::new();
                    let _ = file.read_to_string(&mut owner);
                    return Err(held(path, owner.trim(), what));
                }
                Err(TryLockError::Error(_)) => return Ok(None),
            }
        }
        Err(held(path, "", what))
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // While it is still locked, so that nobody else's is removed.
        let _ = fs::remove_file(&self.path);
    }
}

fn held(path: &Path, owner: &str, what: Use) -> Failure {
    let [reason, advice] = what.reason_and_advice();
    let owner = if owner.is_empty() { String::new() } else { format!(" (process {owner})") };
    let error = Error::new(ErrorKind::Io, format!("another run{owner} {reason}"));
    Failure::Output(error.in_file(path).advise(advice))
}

fn beside(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.lock"))
}

/// Whether an open file is the one that is at a path now.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let of = |m: fs::Metadata| (m.dev(), m.ino());
    file.metadata().ok().map(of).is_some_and(|own| fs::metadata(path).ok().map(of) == Some(own))
}

#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_at_a_time_and_again_afterwards() {
        let path = std::env::temp_dir().join(format!("bijective-sdf-lock-{}", std::process::id()));
        let lock = Lock::on(&path, Use::Checkpoints).unwrap().expect("a system that locks files");
        for (what, option) in [(Use::Checkpoints, "--checkpoint"), (Use::Runs, "--out")] {
            let refused = Lock::on(&path, what).unwrap_err().line().unwrap();
            assert!(refused.contains("another run") && refused.contains(option), "{refused}");
        }
        drop(lock);
        assert!(!beside(&path).exists());
        // What a killed run left is no lock.
        fs::write(beside(&path), "1\n").unwrap();
        drop(Lock::on(&path, Use::Runs).unwrap());
        assert!(!beside(&path).exists());
    }
}
