//! The lines above the first row of a table: titles, names of columns, comments.

use super::super::text::{integer, show};
use super::dialect::{Delimiter, Dialect};
use super::names::{self, Axes};

/// What the lines above the first row say.
#[derive(Default)]
pub(super) struct Heading {
    /// The names of the columns.
    pub header: Option<Header>,
    /// A line of words in front of the names.
    pub title: Option<String>,
    /// The first line reads 0, 1, 2, ...: either a point, or the header that pandas writes for columns without names.
    /// The choice of the columns or the end of the table settles which.
    pub numbered: bool,
}

/// The names of the columns.
pub(super) struct Header {
    pub names: Vec<String>,
    pub source: Source,
    /// What stood between the names, if they had a line of their own.
    pub delimiter: Option<Delimiter>,
}

/// Where the names of the columns stand.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    /// On a line of their own.
    Line,
    /// In a comment that surely names columns.
    Comment,
    /// In a comment that may be a sentence which only mentions x, y and z.
    CommentInDoubt,
}

impl Heading {
    /// Looks for names of columns in a comment above the first row.
    pub fn comment(&mut self, comment: &[u8]) {
        let text = String::from_utf8_lossy(comment);
        if let Some((names, sure)) = names::of_comment(&text)
            && self.header.as_ref().is_none_or(|h| h.source != Source::Line)
        {
            let source = if sure { Source::Comment } else { Source::CommentInDoubt };
            self.header = Some(Header { names, source, delimiter: None });
        }
    }

    /// Takes a line in front of the first row that has no numbers, or only those of a numbered header. False if the
    /// line is the first row.
    pub fn takes(&mut self, dialect: &Dialect, fields: &[&[u8]], warnings: &mut Vec<String>) -> bool {
        let numbers: Vec<Option<f64>> = fields.iter().map(|f| dialect.number(f)).collect();
        let said = |f: &&[u8]| !f.is_empty();
        let text = |f: &[u8]| String::from_utf8_lossy(f).into_owned();
        let all_words =
            fields.iter().zip(&numbers).all(|(f, n)| n.is_none_or(|n| n.is_nan()) || f.is_empty());
        if all_words && fields.iter().any(said) {
            // Words such as `nan` alone are a row without a point.
            if numbers.iter().all(Option::is_some) {
                return false;
            }
            let names: Vec<String> = fields.iter().map(|f| text(f)).collect();
            let units = names.iter().all(|n| names::is_unit(n));
            let known = |n: &[String]| matches!(names::axes(n), Axes::Found { .. } | Axes::Degrees);
            match &self.header {
                Some(_) if units => {}
                // A row of words below the names of the coordinates is damage.
                Some(h) if h.source == Source::Line && known(&h.names) && !known(&names) => return false,
                _ => {
                    if let Some(old) = self.header.take().filter(|h| h.source == Source::Line) {
                        self.title = Some(old.names.join(" "));
                    }
                    let delimiter = Some(dialect.delimiter);
                    self.header = Some(Header { names, source: Source::Line, delimiter });
                }
            }
            return true;
        }
        // Two columns are no point: a line of a preamble, such as `Version 2`.
        if fields.len() < 3 && numbers.iter().any(Option::is_none) {
            let line = fields.iter().map(|f| text(f)).collect::<Vec<_>>().join(" ");
            warnings.push(format!("the line {} was not read", show(line.as_bytes())));
            return true;
        }
        // `,0,1,2` or `0,1,2`, the header that pandas writes for columns without names.
        let counted = |fields: &[&[u8]]| {
            fields.len() >= 3 && fields.iter().enumerate().all(|(i, f)| integer(f) == Some(i as i64))
        };
        let white = dialect.delimiter == Delimiter::White;
        if self.header.is_none() && !white && !fields.is_empty() {
            let indexed = numbers[0].is_none_or(f64::is_nan) && counted(&fields[1..]);
            if indexed || counted(fields) {
                let mut names: Vec<String> = fields.iter().map(|f| text(f)).collect();
                for (axis, name) in ["x", "y", "z"].into_iter().zip(&mut names[usize::from(indexed)..]) {
                    *name = axis.to_string();
                }
                if indexed {
                    names[0] = "index".into();
                } else {
                    self.numbered = true;
                }
                let delimiter = Some(dialect.delimiter);
                self.header = Some(Header { names, source: Source::Line, delimiter });
                return true;
            }
        }
        false
    }

    /// Whether a line repeats the names of the columns, as where files were joined one behind the other.
    pub fn is_repeated_by(&self, fields: &[&[u8]]) -> bool {
        self.header.as_ref().is_some_and(|h| {
            h.source == Source::Line
                && h.names.len() == fields.len()
                && h.names.iter().zip(fields).all(|(n, f)| n.as_bytes() == *f)
        })
    }
}
