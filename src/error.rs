//! The one error type of the crate: what went wrong, where, and what to do about it.

use std::fmt;
use std::path::{Path, PathBuf};

/// What sort of failure an [`Error`] is; a program maps it to an exit code, a library user to a decision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The operating system refused to read or write a file.
    Io,
    /// The bytes of a file do not follow its format, or the format is unknown.
    Format,
    /// The points are unusable: too few, not finite, all in one plane.
    Data,
    /// An option is out of range or contradicts another.
    Config,
    /// The field has no zero level set inside the grid, so there is no surface to extract.
    NoSurface,
    /// The optimisation produced non-finite values and could not be brought back.
    Diverged,
    /// The observer asked to stop.
    Cancelled,
    /// A checkpoint or a saved result is damaged, of another kind, or belongs to another configuration.
    Checkpoint,
}

/// An error with its kind, its position (file, line, element) and what to do about it.
///
/// The fields are private so that more positions can be added without breaking users. `Display` prints one line,
/// `file:line: element: message; advice`, without the cause, which [`source`](std::error::Error::source) returns.
#[derive(Debug)]
pub struct Error(Box<Parts>);

/// Boxed, so that a `Result` stays small where nothing goes wrong.
#[derive(Debug)]
struct Parts {
    kind: ErrorKind,
    message: String,
    file: Option<PathBuf>,
    line: Option<u64>,
    element: Option<String>,
    advice: Option<String>,
    source: Option<Box<dyn std::error::Error + Send + Sync + 'static>>,
}

impl Error {
    /// An error of `kind` that says what is wrong.
    pub fn new(kind: ErrorKind, message: impl Into<String>) -> Self {
        Error(Box::new(Parts {
            kind,
            message: message.into(),
            file: None,
            line: None,
            element: None,
            advice: None,
            source: None,
        }))
    }

    /// The error for a file that the operating system refuses to read.
    pub fn cannot_read(file: impl AsRef<Path>, cause: std::io::Error) -> Self {
        Error::new(ErrorKind::Io, "cannot read the file").in_file(file).caused_by(cause)
    }

    /// The error for a file that the operating system refuses to write.
    pub fn cannot_write(file: impl AsRef<Path>, cause: std::io::Error) -> Self {
        Error::new(ErrorKind::Io, "cannot write the file").in_file(file).caused_by(cause)
    }

    /// Adds the file it happened in.
    #[must_use]
    pub fn in_file(mut self, file: impl AsRef<Path>) -> Self {
        self.0.file = Some(file.as_ref().to_path_buf());
        self
    }

    /// Adds the line it happened at, counted from 1.
    #[must_use]
    pub fn at_line(mut self, line: u64) -> Self {
        self.0.line = Some(line);
        self
    }

    /// Adds the element it happened at, such as `vertex 17` or `option field.width`.
    #[must_use]
    pub fn at_element(mut self, element: impl Into<String>) -> Self {
        self.0.element = Some(element.into());
        self
    }

    /// Adds what the user can do about it.
    #[must_use]
    pub fn advise(mut self, advice: impl Into<String>) -> Self {
        self.0.advice = Some(advice.into());
        self
    }

    /// Adds the error that caused this one.
    #[must_use]
    pub fn caused_by(
        mut self,
        source: impl Into<Box<dyn std::error::Error + Send + Sync + 'static>>,
    ) -> Self {
        self.0.source = Some(source.into());
        self
    }

    /// What sort of failure this is.
    pub fn kind(&self) -> ErrorKind {
        self.0.kind
    }

    /// What went wrong, without position and advice.
    pub fn message(&self) -> &str {
        &self.0.message
    }

    /// The file it happened in, if one is known.
    pub fn file(&self) -> Option<&Path> {
        self.0.file.as_deref()
    }

    /// The line it happened at, counted from 1, if one is known.
    pub fn line(&self) -> Option<u64> {
        self.0.line
    }

    /// The element it happened at, such as `vertex 17`, if one is known.
    pub fn element(&self) -> Option<&str> {
        self.0.element.as_deref()
    }

    /// What the user can do about it, if anything is known to help.
    pub fn advice(&self) -> Option<&str> {
        self.0.advice.as_deref()
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.0.file {
            write!(f, "{}", file.display())?;
            if let Some(line) = self.0.line {
                write!(f, ":{line}")?;
            }
            write!(f, ": ")?;
        } else if let Some(line) = self.0.line {
            write!(f, "line {line}: ")?;
        }
        if let Some(element) = &self.0.element {
            write!(f, "{element}: ")?;
        }
        write!(f, "{}", self.0.message)?;
        if let Some(advice) = &self.0.advice {
            write!(f, "; {advice}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.0.source.as_ref().map(|e| &**e as &(dyn std::error::Error + 'static))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prints_place_message_and_advice_on_one_line_and_leaves_the_cause_to_source() {
        let e = Error::new(ErrorKind::Format, "3 numbers expected, 2 found")
            .in_file("cloud.xyz")
            .at_line(12)
            .at_element("point 11")
            .advise("delete the line or complete it");
        assert_eq!(
            e.to_string(),
            "cloud.xyz:12: point 11: 3 numbers expected, 2 found; delete the line or complete it"
        );
        let denied = || std::io::Error::other("denied");
        for (e, text) in [
            (Error::cannot_read("a/b", denied()), "a/b: cannot read the file"),
            (Error::cannot_write("a/b", denied()), "a/b: cannot write the file"),
        ] {
            assert_eq!((e.kind(), e.to_string().as_str()), (ErrorKind::Io, text));
            assert_eq!(std::error::Error::source(&e).unwrap().to_string(), "denied");
        }
    }

    #[test]
    fn crosses_threads() {
        fn check<T: Send + Sync + 'static>() {}
        check::<Error>();
    }
}
