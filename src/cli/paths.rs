//! Paths of files, and `-` for a pipe: what they name, and what may not be written there.

use std::fs;
use std::path::Path;

use bijective_sdf::{Error, ErrorKind};

use super::failure::Failure;

/// The name of a file in a table: without directory and extension.
pub fn name(path: &Path) -> String {
    path.file_stem().map_or_else(|| path.display().to_string(), |s| s.to_string_lossy().into_owned())
}

/// Whether a path stands for standard input or output.
pub fn is_pipe(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Whether two paths name one file, however they are written and over whatever links, also if it is not there yet.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    if is_pipe(a) || is_pipe(b) {
        return false;
    }
    // A file that is yet to be written has the place of its directory.
    let place = |path: &Path| {
        fs::canonicalize(path).ok().or_else(|| {
            let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            Some(fs::canonicalize(parent).ok()?.join(path.file_name()?))
        })
    };
    let same_place = place(a).is_some_and(|a| place(b).is_some_and(|b| a == b));
    a == b || same_place || is_hard_link(a, b)
}

#[cfg(unix)]
fn is_hard_link(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let of = |path: &Path| fs::metadata(path).ok().filter(fs::Metadata::is_file).map(|m| (m.dev(), m.ino()));
    of(a).is_some_and(|a| of(b) == Some(a))
}

#[cfg(not(unix))]
fn is_hard_link(_: &Path, _: &Path) -> bool {
    false
}

/// Whether a path names the file that a shell redirects to standard input.
#[cfg(unix)]
fn is_standard_input(path: &Path) -> bool {
    use std::os::fd::AsFd;
    use std::os::unix::fs::MetadataExt;
    let input = || fs::File::from(std::io::stdin().as_fd().try_clone_to_owned().ok()?).metadata().ok();
    // What is no regular file, such as a pipe or a terminal, is not replaced.
    let input = input().filter(fs::Metadata::is_file);
    input.is_some_and(|a| fs::metadata(path).is_ok_and(|b| (a.dev(), a.ino()) == (b.dev(), b.ino())))
}

#[cfg(not(unix))]
fn is_standard_input(_: &Path) -> bool {
    false
}

/// Refuses to write over what is read, also if that is standard input.
pub fn check_apart(option: &str, output: &Path, input: &Path) -> Result<(), Failure> {
    let piped = is_pipe(input) && !is_pipe(output) && is_standard_input(output);
    if piped || is_same_file(output, input) {
        let text = format!("{option} would overwrite the input, {}", output.display());
        return Err(Failure::Usage(text));
    }
    Ok(())
}

/// Fails early where a later write would: hours of work should not end at a misspelt directory.
pub fn check_writable(path: &Path) -> Result<(), Failure> {
    if is_pipe(path) {
        return Ok(());
    }
    let refuse = |text: &str, advice: &str| {
        Err(Failure::Output(Error::new(ErrorKind::Io, text).in_file(path).advise(advice)))
    };
    if path.is_dir() {
        return refuse("cannot write the file: it is a directory", "give a file name");
    }
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() && !parent.is_dir() => {
            refuse("cannot write the file: its directory does not exist", "create the directory first")
        }
        _ => Ok(()),
    }
}
