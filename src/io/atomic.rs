//! Files that appear whole or not at all.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::{Error, ErrorKind};

/// Writes a file so that a failure at any moment leaves the old file, or none, in its place.
///
/// The bytes go to a temporary file in the same directory, which is flushed to the disk and then renamed; then the
/// directory is flushed, too, so that the new name survives a loss of power. Temporary files for the same path whose
/// writers were killed are removed. A path that names something other than a regular file, such as a pipe or a device,
/// is written to directly.
///
/// # Errors
///
/// What `content` returns, or [`ErrorKind::Io`] with the file; the temporary file is removed in both cases.
pub fn write_atomic(
    path: impl AsRef<Path>,
    content: impl FnOnce(&mut dyn Write) -> Result<(), Error>,
) -> Result<(), Error> {
    let path = path.as_ref();
    let failed = |e: io::Error| Error::cannot_write(path, e);
    // A symbolic link keeps pointing to the file it names, and renaming over a device would replace it.
    let target = match fs::metadata(path) {
        Ok(meta) if meta.is_dir() => {
            return Err(Error::new(ErrorKind::Io, "cannot write the file: it is a directory").in_file(path));
        }
        Ok(meta) if !meta.is_file() => {
            let mut out = BufWriter::new(OpenOptions::new().write(true).open(path).map_err(failed)?);
            content(&mut out).map_err(|e| e.in_file(path))?;
            return out.flush().map_err(failed);
        }
        Ok(_) => fs::canonicalize(path).map_err(failed)?,
        Err(_) => path.to_path_buf(),
    };

    let (temporary, file) = Temporary::beside(&target).map_err(failed)?;
    let mut out = BufWriter::with_capacity(1 << 16, file);
    content(&mut out).map_err(|e| e.in_file(path))?;
    let file = out.into_inner().map_err(|e| failed(e.into_error()))?;
    file.sync_all().map_err(failed)?;
    drop(file);
    temporary.rename_to(&target).map_err(failed)?;
    sync_directory(&target).map_err(failed)
}

/// Flushes the directory of a file; only Unix lets a directory be opened for that.
fn sync_directory(target: &Path) -> io::Result<()> {
    let directory = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    if cfg!(unix) { File::open(directory)?.sync_all() } else { Ok(()) }
}

/// A temporary file that removes itself unless it is renamed. As long as it is written it is locked, so that others can
/// tell it from one whose writer is gone.
struct Temporary {
    path: Option<PathBuf>,
}

impl Temporary {
    fn beside(target: &Path) -> io::Result<(Temporary, File)> {
        let name = target
            .file_name()
            .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "the path has no file name"))?
            .to_string_lossy();
        remove_abandoned(target, &name);
        let mut attempt = 0;
        loop {
            let path = target.with_file_name(format!(".{name}.{}-{attempt}.tmp", std::process::id()));
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                // Between its creation and our lock another process may have locked or removed the file as abandoned
                // (see `remove_abandoned`): then try the next name. On file systems without locks nobody can take it
                // for abandoned.
                Ok(file) => match file.try_lock() {
                    Err(TryLockError::WouldBlock) => attempt += 1,
                    _ if !path.exists() => attempt += 1,
                    _ => return Ok((Temporary { path: Some(path) }, file)),
                },
                // Another process may have the same number, in a container of its own.
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists && attempt < 100 => attempt += 1,
                Err(e) => return Err(e),
            }
        }
    }

    fn rename_to(mut self, target: &Path) -> io::Result<()> {
        if let Some(path) = &self.path {
            fs::rename(path, target)?;
        }
        self.path = None;
        Ok(())
    }
}

/// Removes temporary files for `target` that a writer has left behind by being killed: those that nobody has locked.
/// What goes wrong here is no failure of the file that is to be written.
fn remove_abandoned(target: &Path, name: &str) {
    let directory = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let prefix = format!(".{name}.");
    let ours = |file: &str| {
        let number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
        let middle = file.strip_prefix(&prefix).and_then(|rest| rest.strip_suffix(".tmp"));
        middle.and_then(|m| m.split_once('-')).is_some_and(|(id, attempt)| number(id) && number(attempt))
    };
    for entry in fs::read_dir(directory).into_iter().flatten().flatten() {
        if !entry.file_name().to_str().is_some_and(ours) {
            continue;
        }
        // Opened for writing, as some systems lock no others.
        let abandoned = OpenOptions::new().write(true).open(entry.path());
        if abandoned.is_ok_and(|file| file.try_lock().is_ok()) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if let Some(path) = &self.path {
            // Nothing better can be done about a temporary file that refuses to go.
            let _ = fs::remove_file(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn directory(name: &str) -> PathBuf {
        let dir = std::env::temp_dir().join(format!("bijective-sdf-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&dir);
        fs::create_dir_all(&dir).unwrap();
        dir
    }

    fn put(text: &'static str) -> impl FnOnce(&mut dyn Write) -> Result<(), Error> {
        move |out| out.write_all(text.as_bytes()).map_err(|e| Error::new(ErrorKind::Io, "put").caused_by(e))
    }

    #[test]
    fn a_failure_leaves_the_old_file_and_nothing_else() {
        let dir = directory("atomic");
        let path = dir.join("a.txt");
        write_atomic(&path, put("one")).unwrap();
        let e = write_atomic(&path, |out| {
            put("half")(out)?;
            Err(Error::new(ErrorKind::Data, "stop"))
        })
        .unwrap_err();
        assert_eq!((e.kind(), e.file()), (ErrorKind::Data, Some(path.as_path())));
        assert_eq!(fs::read_to_string(&path).unwrap(), "one");
        write_atomic(&path, put("two")).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "two");
        assert_eq!(fs::read_dir(&dir).unwrap().count(), 1);

        let e = write_atomic(dir.join("none/a.txt"), put("x")).unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Io);
        assert_eq!(write_atomic(&dir, put("x")).unwrap_err().kind(), ErrorKind::Io);
        fs::remove_dir_all(&dir).unwrap();
    }

    #[test]
    fn what_killed_writers_left_is_removed_and_what_living_ones_write_is_not() {
        let dir = directory("abandoned");
        let path = dir.join("a.txt");
        let id = std::process::id();
        let [dead, same, living] =
            [".a.txt.7-0.tmp".to_string(), format!(".a.txt.{id}-0.tmp"), ".a.txt.8-3.tmp".into()];
        for name in [&dead, &same, &living] {
            fs::write(dir.join(name), "half").unwrap();
        }
        let held = OpenOptions::new().write(true).open(dir.join(&living)).unwrap();
        held.lock().unwrap();
        // Not of our making, or for another file.
        let others = [".a.txt.tmp", ".a.txt.x-0.tmp", ".b.txt.7-0.tmp", "a.txt.7-0.tmp", ".a.txt.7-0.tmp~"];
        others.iter().for_each(|name| fs::write(dir.join(name), "").unwrap());
        // Even the file that is being written in the meantime stays.
        write_atomic(&path, |out| {
            put("outer")(out)?;
            write_atomic(&path, put("inner"))
        })
        .unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "outer");
        let left: Vec<String> =
            fs::read_dir(&dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        assert!(left.contains(&living) && !left.contains(&dead) && !left.contains(&same), "{left:?}");
        assert_eq!(left.len(), 2 + others.len(), "{left:?}");
        drop(held);
        write_atomic(&path, put("again")).unwrap();
        assert!(!dir.join(&living).exists());
        fs::remove_dir_all(&dir).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn links_and_devices_stay_what_they_are() {
        let dir = directory("links");
        fs::write(dir.join("real"), "old").unwrap();
        std::os::unix::fs::symlink(dir.join("real"), dir.join("link")).unwrap();
        write_atomic(dir.join("link"), put("new")).unwrap();
        assert_eq!(fs::read_to_string(dir.join("real")).unwrap(), "new");
        assert!(fs::symlink_metadata(dir.join("link")).unwrap().is_symlink());
        write_atomic("/dev/null", put("gone")).unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
        fs::remove_dir_all(&dir).unwrap();
    }
}
