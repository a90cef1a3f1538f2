//! Why a command ended without success, and the exit code that says so.

use std::io;
use std::path::Path;

use bijective_sdf::{Error, ErrorKind};

/// Why a command ended without success.
#[derive(Debug)]
pub enum Failure {
    /// The library failed; the kind decides on the exit code.
    Library(Error),
    /// An input could not be read, for whatever reason.
    Input(Error),
    /// A result could not be written, for whatever reason.
    Output(Error),
    /// The arguments contradict each other.
    Usage(String),
    /// The work is done, but the mesh is not closed and oriented.
    Gate(String),
    /// Runs of a suite failed: how many, and the exit code of the last one.
    Runs(String, u8),
    /// The user asked to stop.
    Interrupted(String),
    /// The reader of the standard output closed the pipe.
    Closed,
}

impl Failure {
    /// The exit code, as the program's help lists them.
    pub fn code(&self) -> u8 {
        match self {
            Failure::Library(e) => match e.kind() {
                ErrorKind::Config => 2,
                ErrorKind::Format | ErrorKind::Data | ErrorKind::Checkpoint => 3,
                _ => 1,
            },
            Failure::Input(_) => 3,
            Failure::Output(_) => 1,
            Failure::Usage(_) => 2,
            Failure::Gate(_) => 4,
            Failure::Runs(_, code) => *code,
            Failure::Interrupted(_) => 130,
            Failure::Closed => 0,
        }
    }

    /// The line to print, if there is anything to say.
    pub fn line(&self) -> Option<String> {
        let text = match self {
            Failure::Library(e) | Failure::Input(e) | Failure::Output(e) => format!("error: {}", chain(e)),
            Failure::Usage(text) | Failure::Runs(text, _) => format!("error: {text}"),
            Failure::Gate(text) => format!("warning: {text}"),
            Failure::Interrupted(text) => format!("interrupted: {text}"),
            Failure::Closed => return None,
        };
        // Causes from other crates may span lines.
        Some(text.lines().map(str::trim).filter(|l| !l.is_empty()).collect::<Vec<_>>().join(" "))
    }

    /// The line without the leading word, such as `error`.
    pub fn text(&self) -> String {
        let line = self.line().unwrap_or_default();
        line.split_once(": ").map_or(line.clone(), |(_, text)| text.to_string())
    }

    /// A file that the operating system refuses to read.
    pub fn cannot_read(path: &Path, e: io::Error) -> Failure {
        Failure::Input(Error::cannot_read(path, e))
    }

    /// A file that the operating system refuses to write.
    pub fn cannot_write(path: &Path, e: io::Error) -> Failure {
        Failure::Output(Error::cannot_write(path, e))
    }

    /// What a failed write to standard output means.
    pub fn of_stdout(e: io::Error) -> Failure {
        if e.kind() == io::ErrorKind::BrokenPipe {
            Failure::Closed
        } else {
            Failure::Output(Error::new(ErrorKind::Io, "cannot write to standard output").caused_by(e))
        }
    }
}

/// An error with all its causes, as `message (cause (its cause)); advice`.
pub fn chain(e: &(dyn std::error::Error + 'static)) -> String {
    let mut text = e.to_string();
    let advice = e.downcast_ref::<Error>().and_then(Error::advice).map(|advice| format!("; {advice}"));
    let advice = advice.filter(|advice| text.ends_with(advice)).unwrap_or_default();
    text.truncate(text.len() - advice.len());
    if let Some(cause) = e.source() {
        text += &format!(" ({})", chain(cause));
    }
    text + &advice
}

impl From<Error> for Failure {
    fn from(e: Error) -> Self {
        Failure::Library(e)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_failure_has_one_line_and_a_code() {
        let lib = |kind| Failure::Library(Error::new(kind, "text").caused_by("a\n  b\n"));
        assert_eq!(lib(ErrorKind::Data).line().unwrap(), "error: text (a b )");
        let inner = Error::new(ErrorKind::Config, "7 cannot be used").advise("use 1").caused_by("odd");
        let outer = Error::new(ErrorKind::Checkpoint, "it is damaged").in_file("a").caused_by(inner);
        let line = Failure::Library(outer.advise("start anew")).line().unwrap();
        assert_eq!(line, "error: a: it is damaged (7 cannot be used (odd); use 1); start anew");
        let codes = [
            (lib(ErrorKind::Config), 2),
            (lib(ErrorKind::Format), 3),
            (lib(ErrorKind::Data), 3),
            (lib(ErrorKind::Checkpoint), 3),
            (lib(ErrorKind::Io), 1),
            (lib(ErrorKind::NoSurface), 1),
            (lib(ErrorKind::Diverged), 1),
            (Failure::Input(Error::new(ErrorKind::Io, "x")), 3),
            (Failure::Output(Error::new(ErrorKind::Data, "x")), 1),
            (Failure::Gate("x".into()), 4),
            (Failure::Runs("x".into(), 3), 3),
            (Failure::Interrupted("x".into()), 130),
            (Failure::cannot_read(Path::new("x"), io::Error::other("gone")), 3),
            (Failure::cannot_write(Path::new("x"), io::Error::other("full")), 1),
            (Failure::of_stdout(io::ErrorKind::BrokenPipe.into()), 0),
            (Failure::of_stdout(io::Error::other("full")), 1),
        ];
        for (failure, code) in codes {
            assert_eq!(failure.code(), code, "{failure:?}");
            assert_eq!(failure.line().is_none(), code == 0);
        }
    }
}
