//! XYZ, PTS and CSV: one point a line.
//!
//! All names read the same way. Columns are separated by commas, semicolons, bars, tabs or white space ([`dialect`]);
//! `#`, `%` and `//` start comments; a line with one whole number is the number of points that follow (as in `.pts`,
//! where each scan begins with one). A line of names, also in a comment, says where x, y and z are ([`names`]); without
//! names the first three columns are taken unless their numbers speak against it ([`super::doubt`]).

use std::io::{self, Write};

use super::doubt::Evidence;
use super::encoding::Width;
use super::options::ReadOptions;
use super::precision::check_point;
use super::text::{Lines, not_a_number, show, without_byte_order_mark, write_position};
use super::{Loaded, Want};
use crate::{Error, ErrorKind};

mod attributes;
mod columns;
mod dialect;
mod heading;
mod names;

use columns::{Chooser, RowLayout};
use dialect::{Delimiter, Dialect, is_error_of_a_spreadsheet};
use heading::Heading;

/// Reads n x 3 points.
pub(super) fn read(bytes: &[u8], options: &ReadOptions, want: Want) -> Result<Loaded, Error> {
    let mut table = Table {
        options,
        want,
        loaded: Loaded::default(),
        heading: Heading::default(),
        layout: None,
        scans: Vec::new(),
        evidence: Evidence::default(),
        skipped_headers: 0,
        short_rows: 0,
    };
    let mut fields = Vec::new();
    for (number, line) in Lines::new(without_byte_order_mark(bytes)?).skip(options.skip) {
        let (data, comment) = match table.whole_row(line) {
            Some(row) => (row, None),
            None => split_comment(line.trim_ascii()),
        };
        if table.layout.is_none()
            && let Some(comment) = comment
        {
            table.heading.comment(comment);
        }
        if !data.is_empty() {
            table.line(data, &mut fields).map_err(|e| e.at_line(number))?;
        }
    }
    table.finish()
}

/// Writes n points a line each; with a comma as `separator` a line of column names comes first.
pub(super) fn write(
    out: &mut dyn Write,
    points: &[[f64; 3]],
    width: Width,
    separator: &str,
) -> io::Result<()> {
    if separator == "," {
        out.write_all(b"x,y,z\n")?;
    }
    for &p in points {
        write_position(out, p, width, separator)?;
        out.write_all(b"\n")?;
    }
    Ok(())
}

/// Cuts a line into data and comment, both trimmed.
fn split_comment(line: &[u8]) -> (&[u8], Option<&[u8]>) {
    if let Some(comment) = line.strip_prefix(b"//").or_else(|| line.strip_prefix(b"%")) {
        return (b"", Some(comment.trim_ascii()));
    }
    // `1.#QNAN` is how some programs print a number that is none, and `Pt#` is a name.
    let word = |b: u8| b == b'.' || b.is_ascii_alphabetic();
    let starts = |at: usize| line[at] == b'#' && (at == 0 || !word(line[at - 1]));
    match (0..line.len()).find(|&at| starts(at)) {
        Some(at) => (line[..at].trim_ascii(), Some(line[at + 1..].trim_ascii())),
        None => (line, None),
    }
}

/// The number of points that a line promises, and how many came before.
struct Scan {
    promised: u64,
    start: usize,
}

struct Table<'a> {
    options: &'a ReadOptions,
    want: Want,
    loaded: Loaded,
    heading: Heading,
    /// None above the first row.
    layout: Option<RowLayout>,
    scans: Vec<Scan>,
    evidence: Evidence,
    skipped_headers: usize,
    /// Rows that have fewer columns than the first one, all the same.
    short_rows: usize,
}

impl Table<'_> {
    /// The delimiter and the number of columns that the names or the first row lead to expect, where it is not white
    /// space that separates them.
    fn expected(&self) -> Option<(u8, usize)> {
        let header = self.heading.header.as_ref();
        let (delimiter, columns) = match &self.layout {
            Some(layout) => (layout.dialect.delimiter, layout.total),
            None => header.and_then(|h| Some((h.delimiter?, h.names.len())))?,
        };
        match delimiter {
            Delimiter::Byte(byte) => Some((byte, columns)),
            Delimiter::White => None,
        }
    }

    /// A line as it stands, but for spaces around it, if it has as many columns as are expected with an empty first one
    /// before a tab, or with a `#` that belongs to a column and begins no comment.
    fn whole_row<'a>(&self, line: &'a [u8]) -> Option<&'a [u8]> {
        if !line.contains(&b'#') && !line.contains(&b'\t') {
            return None;
        }
        let (delimiter, columns) = self.expected()?;
        let space = |b: &u8| *b == b' ' || *b == b'\r';
        let start = line.iter().position(|b| !space(b))?;
        let end = line.iter().rposition(|b| !space(b))?;
        let line = &line[start..=end];
        let opens = line[0] == b'\t' && delimiter == b'\t' && !line.trim_ascii().is_empty();
        if !opens && !line.contains(&b'#') {
            return None;
        }
        let dialect = Dialect { delimiter: Delimiter::Byte(delimiter), decimal_comma: false };
        let mut fields = Vec::new();
        dialect.split(line, &mut fields);
        if fields.len() + usize::from(dialect.ends_open(line)) != columns {
            return None;
        }
        // A number sign in front of a row makes it a comment, unless the first column is no coordinate.
        let first_is_name = self.layout.as_ref().is_some_and(|l| !l.guessed && !l.point.contains(&0));
        let mut hashes = fields.iter().enumerate().filter(|(_, f)| f.starts_with(b"#"));
        let all_belong = hashes.all(|(i, f)| i > 0 || first_is_name || is_error_of_a_spreadsheet(f));
        let begins_none =
            |(i, f): (usize, &&[u8])| f.iter().skip(1).all(|b| *b != b'#') || i == 0 && first_is_name;
        (all_belong && fields.iter().enumerate().all(begins_none)).then_some(line)
    }

    /// The dialect of a line above the first row or of the first row: that of the line of names if the line then has as
    /// many columns, of which some may be empty; else what the line itself looks like.
    fn dialect_of(&self, line: &[u8]) -> Dialect {
        let own = Dialect::of(line, self.options.delimiter);
        match self.expected() {
            Some((delimiter, columns)) if self.options.delimiter.is_none() => {
                let named = Dialect::of(line, Some(delimiter));
                if named.columns(line) == columns { named } else { own }
            }
            _ => own,
        }
    }

    fn line<'a>(&mut self, data: &'a [u8], fields: &mut Vec<&'a [u8]>) -> Result<(), Error> {
        let dialect = match &self.layout {
            Some(layout) => layout.dialect,
            None => self.dialect_of(data),
        };
        dialect.split(data, fields);
        // A single whole number is a count of points: in front of all, or between the scans of a PTS file.
        if let [only] = fields[..]
            && (self.layout.is_none() || !self.scans.is_empty())
            && let Some(promised) = std::str::from_utf8(only).ok().and_then(|s| s.parse().ok())
        {
            self.scans.push(Scan { promised, start: self.loaded.verts.len() });
            return Ok(());
        }
        if self.layout.is_none() {
            if self.heading.takes(&dialect, fields, &mut self.loaded.warnings) {
                return Ok(());
            }
            let chooser = Chooser {
                options: self.options,
                want: self.want,
                heading: &mut self.heading,
                loaded: &mut self.loaded,
            };
            self.layout = Some(chooser.choose(dialect, fields, dialect.ends_open(data))?);
        }
        let index = self.loaded.verts.len();
        if index == 1 {
            self.second_row(fields);
        }
        self.row(fields, dialect.ends_open(data)).map_err(|e| e.at_element(format!("point {index}")))
    }

    /// Looks at the second row where the first was 0, 1, 2 and so on: if it has one column more, the first was the
    /// names of a table without names, whose own first column, the numbers of rows, has no name.
    fn second_row(&mut self, fields: &[&[u8]]) {
        let Some(layout) = &mut self.layout else { return };
        let counted =
            self.loaded.verts[..] == [[0.0, 1.0, 2.0]] && layout.point == [0, 1, 2] && layout.guessed;
        if counted && fields.len() == layout.total + 1 {
            (layout.point, layout.total, layout.guessed) = ([1, 2, 3], fields.len(), false);
            self.loaded.verts.clear();
            self.loaded.warnings.push(
                "the first line, which counts 0, 1, 2, was taken for the names of columns, not for a point"
                    .into(),
            );
        } else if layout.guessed && fields.len() != layout.total {
            self.loaded.warnings.push(format!(
                "the first row has {} columns, the second {}; the first 3 of each were read",
                layout.total,
                fields.len()
            ));
        }
    }

    /// Reads a row, behind whose last delimiter one more column may be empty.
    fn row(&mut self, fields: &[&[u8]], open: bool) -> Result<(), Error> {
        let Some(layout) = &self.layout else { return Ok(()) };
        let mut point = [0.0; 3];
        for (value, column) in point.iter_mut().zip(layout.point) {
            let empty = (open && column == fields.len()).then_some(&b""[..]);
            let field: &[u8] = fields.get(column).copied().or(empty).ok_or_else(|| {
                let needed = layout.point.iter().max().map_or(3, |c| c + 1);
                Error::new(ErrorKind::Format, format!("{needed} numbers expected, {} found", fields.len()))
                    .advise(if self.loaded.verts.is_empty() {
                        "complete the line or delete it; --skip N leaves out the first N lines"
                    } else {
                        "complete the line or delete it"
                    })
            })?;
            *value = match layout.dialect.number(field) {
                Some(value) => value,
                // Files joined one behind the other repeat the line of names.
                None if self.heading.is_repeated_by(fields) => {
                    self.skipped_headers += 1;
                    return Ok(());
                }
                None if field.contains(&b',') && !layout.dialect.decimal_comma => {
                    return Err(Error::new(ErrorKind::Format, format!("{} is not a number", show(field)))
                        .advise("write numbers with a decimal point, or name the --delimiter"));
                }
                None => return Err(not_a_number(field)),
            };
        }
        let columns = fields.len() + usize::from(open);
        if columns < layout.total {
            let delimited = layout.dialect.delimiter != Delimiter::White;
            let told = self.options.assume || self.options.columns.is_some();
            if !told && (delimited || layout.named) {
                return Err(columns::missing(columns, &format!("the first row has {}", layout.total)));
            }
            // Rows of names in comments go on with lists of any length.
            self.short_rows += usize::from(layout.guessed);
        }
        check_point(point, self.want, "point", self.loaded.verts.len())?;
        if layout.guessed && self.evidence.wants_more() {
            let number = |f: &&[u8]| {
                let whole = !f.iter().any(|b| b".,eE".contains(b));
                (layout.dialect.number(f).unwrap_or(f64::NAN), whole)
            };
            self.evidence.add(fields.iter().map(number));
        }
        if let Some(columns) = layout.normal {
            // A missing or odd value spoils the normals, not the points.
            let part = |c: usize| fields.get(c).and_then(|f| layout.dialect.number(f)).unwrap_or(f64::NAN);
            self.loaded.normals.push(columns.map(|c| part(c) as f32));
        }
        for (attribute, &column) in self.loaded.attributes.iter_mut().zip(&layout.more) {
            let value = fields.get(column).and_then(|f| layout.dialect.number(f));
            attribute.values.push(value.unwrap_or(f64::NAN));
        }
        self.loaded.verts.push(point);
        Ok(())
    }

    fn finish(mut self) -> Result<Loaded, Error> {
        if self.options.columns.is_none() && !self.options.assume {
            if let Some(doubt) = self.evidence.doubt() {
                return Err(doubt.error());
            }
            if self.evidence.counts_in_three() {
                self.loaded.warnings.push(
                    "column 1 counts up by one; if it holds point numbers, the file has only two coordinates"
                        .into(),
                );
            }
        }
        if self.heading.numbered {
            // If all coordinates are whole numbers, 0, 1, 2 is a point like the others.
            let is_point = self.evidence.all_bare() || self.loaded.verts.is_empty();
            let what = if is_point { "a point" } else { "the names of columns, not for a point" };
            self.loaded.warnings.push(format!("the first line, which counts 0, 1, 2, was taken for {what}"));
            if is_point {
                self.loaded.verts.insert(0, [0.0, 1.0, 2.0]);
                self.scans.iter_mut().skip(1).for_each(|s| s.start += 1);
            }
        }
        if let Some(title) = &self.heading.title {
            let title = show(title.as_bytes());
            self.loaded.notices.push(format!("the line {title} was taken for a title"));
        }
        if self.short_rows > 0 {
            let n = self.short_rows;
            self.loaded.warnings.push(format!(
                "{n} rows have fewer columns than the first; if their first columns are missing, they were read wrongly"
            ));
        }
        if self.skipped_headers > 0 {
            let n = self.skipped_headers;
            self.loaded.notices.push(format!("left out {n} lines that repeat the names of the columns"));
        }
        self.count_scans();
        attributes::settle(&mut self.loaded);
        Ok(self.loaded)
    }

    /// Holds the lines with numbers of points against what followed them.
    fn count_scans(&mut self) {
        let many = self.scans.len() > 1;
        if many {
            let n = self.scans.iter().filter(|s| s.start < self.loaded.verts.len()).count();
            self.loaded.notices.push(format!("joined {n} scans"));
        }
        for (i, scan) in self.scans.iter().enumerate() {
            let end = self.scans.get(i + 1).map_or(self.loaded.verts.len(), |s| s.start);
            let (found, promised) = ((end - scan.start) as u64, scan.promised);
            if found != promised {
                let place = if many { format!("scan {}", i + 1) } else { "the first line".to_string() };
                let what = if found < promised { "the file may be cut short" } else { "all were read" };
                self.loaded
                    .warnings
                    .push(format!("{place} promises {promised} points, {found} are there; {what}"));
            }
        }
    }
}

#[cfg(test)]
mod tests;
