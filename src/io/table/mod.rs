//! XYZ, PTS and CSV: one point a line.
//!
//! All names read the same way. Columns are separated by commas, semicolons, bars, tabs or white space ([`dialect`]);
//! `#`, `%` and `//` start comments; a line with one whole number is the number of points that follow (as in `.pts`,
//! where each scan begins with one). A line of names, also in a comment, says where x, y and z are ([`names`]); without
//! names the first three columns are taken unless their numbers speak against it ([`super::doubt`]).

use std::io::{self, Write};

use super::doubt::{Doubt, Evidence};
use super::options::{Columns, ReadOptions};
use super::precision::{check_point, is_short_float};
use super::text::{Lines, integer, not_a_number, show, without_byte_order_mark, write_position};
use super::width::Width;
use super::{Loaded, Want};
use crate::geometry::{Attribute, COLOUR, Number};
use crate::{Error, ErrorKind};

mod dialect;
mod names;

use dialect::Dialect;
use names::Axes;

/// Reads n x 3 points.
pub(super) fn read(bytes: &[u8], options: &ReadOptions, want: Want) -> Result<Loaded, Error> {
    let mut table = Table {
        options,
        want,
        loaded: Loaded::default(),
        header: None,
        title: None,
        layout: None,
        scans: Vec::new(),
        evidence: Evidence::default(),
        skipped_headers: 0,
        numbered: None,
    };
    let mut fields = Vec::new();
    for (number, line) in Lines::new(without_byte_order_mark(bytes)?).skip(options.skip) {
        let (data, comment) = split_comment(line.trim_ascii());
        if table.layout.is_none()
            && let Some(comment) = comment
        {
            table.comment(comment);
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

/// The names of the columns.
struct Header {
    names: Vec<String>,
    source: Source,
}

/// Where the names of the columns stand.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Source {
    /// On a line of their own.
    Line,
    /// In a comment that surely names columns.
    Comment,
    /// In a comment that may be a sentence which only mentions x, y and z.
    CommentInDoubt,
}

/// How rows are read, settled at the first one.
struct RowLayout {
    dialect: Dialect,
    point: [usize; 3],
    normal: Option<[usize; 3]>,
    /// The columns of the attributes.
    more: Vec<usize>,
    /// Columns of the first row.
    total: usize,
    /// The choice is a guess that the numbers may speak against.
    guessed: bool,
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
    header: Option<Header>,
    /// A line of words in front of the names.
    title: Option<String>,
    layout: Option<RowLayout>,
    scans: Vec<Scan>,
    evidence: Evidence,
    skipped_headers: usize,
    /// Set if the first line reads 0, 1, 2, ...: either a point, or the header that pandas writes for columns without
    /// names. Settled in `choose` or `finish`.
    numbered: Option<[f64; 3]>,
}

impl Table<'_> {
    /// Looks for names of columns in a comment above the first row.
    fn comment(&mut self, comment: &[u8]) {
        let text = String::from_utf8_lossy(comment);
        if let Some((names, sure)) = names::of_comment(&text)
            && self.header.as_ref().is_none_or(|h| h.source != Source::Line)
        {
            let source = if sure { Source::Comment } else { Source::CommentInDoubt };
            self.header = Some(Header { names, source });
        }
    }

    fn line<'a>(&mut self, data: &'a [u8], fields: &mut Vec<&'a [u8]>) -> Result<(), Error> {
        let dialect = match &self.layout {
            Some(layout) => layout.dialect,
            None => Dialect::of(data, self.options.delimiter),
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
            if self.is_header(&dialect, fields) {
                return Ok(());
            }
            self.layout = Some(self.choose(dialect, fields, dialect.ends_open(data))?);
        }
        let index = self.loaded.verts.len();
        if index == 1 {
            self.second_row(fields);
        }
        self.row(fields, dialect.ends_open(data)).map_err(|e| e.at_element(format!("point {index}")))
    }

    /// Takes a line in front of the first row that has no numbers, or only those of a numbered header.
    fn is_header(&mut self, dialect: &Dialect, fields: &[&[u8]]) -> bool {
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
                    self.header = Some(Header { names, source: Source::Line });
                }
            }
            return true;
        }
        // Two columns are no point: a line of a preamble, such as `Version 2`.
        if fields.len() < 3 && numbers.iter().any(Option::is_none) {
            let line = fields.iter().map(|f| text(f)).collect::<Vec<_>>().join(" ");
            self.loaded.warnings.push(format!("the line {} was not read", show(line.as_bytes())));
            return true;
        }
        // `,0,1,2` or `0,1,2`, the header that pandas writes for columns without names.
        let counted = |fields: &[&[u8]]| {
            fields.len() >= 3 && fields.iter().enumerate().all(|(i, f)| integer(f) == Some(i as i64))
        };
        let white = dialect.delimiter == dialect::Delimiter::White;
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
                    self.numbered = Some([0.0, 1.0, 2.0]);
                }
                self.header = Some(Header { names, source: Source::Line });
                return true;
            }
        }
        false
    }

    /// Settles the columns at the first row.
    fn choose(&mut self, dialect: Dialect, fields: &[&[u8]], open: bool) -> Result<RowLayout, Error> {
        // The last column of the first row may be empty.
        let named = self.header.as_ref().map_or(0, |h| h.names.len());
        let total = fields.len() + usize::from(open && named == fields.len() + 1);
        let mut layout =
            RowLayout { dialect, point: [0, 1, 2], normal: None, more: Vec::new(), total, guessed: true };
        if dialect.decimal_comma {
            self.loaded.notices.push("numbers have decimal commas".into());
        }
        match &self.options.columns {
            Some(Columns::Numbers(numbers)) => layout.point = numbers.map(|n| n - 1),
            Some(Columns::Names(wanted)) => layout.point = self.named(wanted, total)?,
            None => self.apply_header(&mut layout, fields)?,
        }
        if self.numbered.is_some() && named + 1 == total {
            // One number less than the row has columns: the column of row numbers has no name, so the line is a header.
            self.numbered = None;
            self.loaded.warnings.push(
                "the first line, which counts 0, 1, 2, was taken for the names of columns, not for a point"
                    .into(),
            );
        }
        layout.guessed |= self.numbered.is_some();
        layout.guessed &= self.options.columns.is_none();
        if self.options.columns.is_some() {
            layout.normal = None;
        }
        let needed = layout.point.iter().max().map_or(3, |c| c + 1);
        if needed > total && self.options.columns.is_some() {
            return Err(Error::new(
                ErrorKind::Format,
                format!("column {needed} is asked for, but the first row has {total}"),
            )
            .advise("give other --columns, or another --delimiter"));
        }
        if self.want == Want::Attributes {
            self.add_attributes(&mut layout);
        }
        let read = layout.more.len() + if layout.normal.is_some() { 6 } else { 3 };
        match total.saturating_sub(read) {
            0 => {}
            1 => self.loaded.notices.push("ignored 1 extra column".to_string()),
            extra => self.loaded.notices.push(format!("ignored {extra} extra columns")),
        }
        Ok(layout)
    }

    /// Takes the columns that have a name and hold no coordinate for attributes.
    fn add_attributes(&mut self, layout: &mut RowLayout) {
        let Some(header) = self.header.as_ref().filter(|_| self.numbered.is_none()) else { return };
        let names = header.names.len();
        // The numbers of the rows of a table may have no name.
        let shift = usize::from(header.source == Source::Line && names + 1 == layout.total);
        if names + shift != layout.total || header.source == Source::CommentInDoubt {
            return;
        }
        for (column, name) in (shift..).zip(&header.names) {
            let taken = layout.point.contains(&column) || layout.normal.is_some_and(|n| n.contains(&column));
            let name = name.trim();
            if !taken && !name.is_empty() && !name.starts_with(|c: char| c.is_ascii_digit()) {
                layout.more.push(column);
                let name = name.to_string();
                self.loaded.attributes.push(Attribute { name, number: Number::F64, values: Vec::new() });
            }
        }
    }

    /// The columns that the user named.
    fn named(&self, wanted: &[String; 3], total: usize) -> Result<[usize; 3], Error> {
        let names = self.header.as_ref().map_or(&[][..], |h| &h.names);
        let shift = usize::from(names.len() + 1 == total);
        let mut point = [0; 3];
        for (place, name) in point.iter_mut().zip(wanted) {
            let same = |n: &&String| n.trim() == name.trim();
            let alike = |n: &&String| n.trim().eq_ignore_ascii_case(name.trim());
            let at = names.iter().position(|n| same(&n)).or_else(|| names.iter().position(|n| alike(&n)));
            *place = shift
                + at.ok_or_else(|| {
                    let what = if names.is_empty() {
                        format!("there is no column {name:?}: the file has no names of columns")
                    } else {
                        format!("there is no column {name:?}, only {}", listed(names))
                    };
                    Error::new(ErrorKind::Format, what).advise("give their numbers, as in --columns 2,3,4")
                })?;
        }
        Ok(point)
    }

    /// Takes the columns from the names above the first row, if there are any.
    fn apply_header(&mut self, layout: &mut RowLayout, fields: &[&[u8]]) -> Result<(), Error> {
        let total = layout.total;
        let label = || refuse_row_labels(layout, fields, self.options.assume);
        let Some(header) = &self.header else { return label() };
        let names = header.names.len();
        // A table of R has no name for the labels of its rows.
        let shift = usize::from(header.source == Source::Line && names + 1 == total);
        let fits = names + shift == total;
        let axes = names::axes(&header.names);
        if let Axes::Found { point, normal, twice, depth } = axes {
            if header.source == Source::CommentInDoubt && !fits {
                return label();
            }
            if header.source == Source::Line && total == 2 * names && layout.dialect.is_comma() {
                return Err(Error::new(
                    ErrorKind::Format,
                    format!("{names} columns are named, but the first row has {total}"),
                )
                .advise(
                    "if its numbers have decimal commas, write decimal points, or separate columns by semicolons",
                ));
            }
            layout.point = point.map(|p| p + shift);
            layout.normal = normal.filter(|_| fits).map(|n| n.map(|p| p + shift));
            layout.guessed = false;
            if twice {
                self.loaded.warnings.push(format!(
                    "several columns are named as coordinates; columns {} are read as x, y, z",
                    layout.point.map(|p| (p + 1).to_string()).join(", ")
                ));
            }
            if depth {
                self.loaded.warnings.push(
                    "depths are read as z as they stand: if they count downwards, the shape is mirrored"
                        .into(),
                );
            }
            if header.source == Source::Line && !fits {
                self.loaded.warnings.push(format!(
                    "{names} columns are named, but the first row has {total}; names were counted from the left"
                ));
            }
            return Ok(());
        }
        if header.source != Source::Line && !(axes == Axes::Degrees && fits) {
            return label();
        }
        if axes == Axes::Degrees {
            if self.options.assume {
                return Ok(());
            }
            return Err(Error::new(
                ErrorKind::Format,
                format!("the columns {} hold angles on the globe, not lengths", listed(&header.names)),
            )
            .advise(
                "project the points to metres first (for example to UTM), or give --columns and --assume if they are \
                 lengths",
            ));
        }
        if names != total && names <= 2 {
            // A title and no names.
            self.title = Some(header.names.join(" "));
            self.header = None;
            return refuse_row_labels(layout, fields, self.options.assume);
        }
        let listed = listed(&header.names);
        if total == 3 && axes == Axes::Unknown || self.options.assume {
            self.loaded
                .warnings
                .push(format!("the column names {listed} give no x, y, z; the first 3 columns were used"));
            return refuse_row_labels(layout, fields, self.options.assume);
        }
        Err(Error::new(
            ErrorKind::Format,
            format!("it is not certain where the coordinates are: the columns are named {listed}"),
        )
        .advise("name those of x, y and z, as in --columns 2,3,4, or give --assume to read the first three"))
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
                None if self.is_repeated_header(fields) => {
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

    fn is_repeated_header(&self, fields: &[&[u8]]) -> bool {
        self.header.as_ref().is_some_and(|h| {
            h.source == Source::Line
                && h.names.len() == fields.len()
                && h.names.iter().zip(fields).all(|(n, f)| n.as_bytes() == *f)
        })
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
        if let Some(point) = self.numbered {
            // If all coordinates are whole numbers, 0, 1, 2 is a point like the others.
            let point = (self.evidence.all_bare() || self.loaded.verts.is_empty()).then_some(point);
            let what = if point.is_some() { "a point" } else { "the names of columns, not for a point" };
            self.loaded.warnings.push(format!("the first line, which counts 0, 1, 2, was taken for {what}"));
            if let Some(point) = point {
                self.loaded.verts.insert(0, point);
                self.scans.iter_mut().skip(1).for_each(|s| s.start += 1);
            }
        }
        if let Some(title) = &self.title {
            let title = show(title.as_bytes());
            self.loaded.notices.push(format!("the line {title} was taken for a title"));
        }
        if self.skipped_headers > 0 {
            let n = self.skipped_headers;
            self.loaded.notices.push(format!("left out {n} lines that repeat the names of the columns"));
        }
        self.count_scans();
        self.type_attributes();
        Ok(self.loaded)
    }

    /// Leaves out the attributes that are words, and finds the narrowest type for those that are numbers.
    fn type_attributes(&mut self) {
        let (numbers, words): (Vec<_>, Vec<_>) = std::mem::take(&mut self.loaded.attributes)
            .into_iter()
            .partition(|a| a.values.iter().any(|x| x.is_finite()));
        if !words.is_empty() {
            let names: Vec<String> = words.into_iter().map(|a| a.name).collect();
            self.loaded.notices.push(format!("the columns {} hold no numbers", listed(&names)));
        }
        self.loaded.attributes = numbers;
        for attribute in &mut self.loaded.attributes {
            attribute.number = narrowest(&attribute.values);
        }
        let colour = ["r", "g", "b"];
        let parts = [COLOUR, colour].map(|names| {
            names.map(|name| {
                let bytes = |a: &Attribute| a.number == Number::U8 && a.name.eq_ignore_ascii_case(name);
                self.loaded.attributes.iter().position(bytes)
            })
        });
        if let Some([Some(r), Some(g), Some(b)]) = parts.into_iter().find(|p| p.iter().all(Option::is_some)) {
            for (i, name) in [r, g, b].into_iter().zip(COLOUR) {
                self.loaded.attributes[i].name = name.into();
            }
        }
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

/// Refuses rows that begin with a word (a label) and go on with three numbers, unless told to `assume`.
fn refuse_row_labels(layout: &RowLayout, fields: &[&[u8]], assume: bool) -> Result<(), Error> {
    let number = |i: usize| fields.get(i).is_some_and(|f| layout.dialect.number(f).is_some());
    if assume || number(0) || !(1..4).all(number) {
        return Ok(());
    }
    let what = format!("column 1 holds words such as {}", show(fields[0]));
    Err(Doubt { what, from: Some(1) }.error())
}

/// A type that holds numbers exactly, or as their digits have them: the narrowest of bytes, integers of 32 bits, and
/// floats.
fn narrowest(values: &[f64]) -> Number {
    let whole = |low: f64, high: f64| values.iter().all(|x| x.fract() == 0.0 && (low..=high).contains(x));
    let mut digits = String::new();
    if whole(0.0, 255.0) {
        Number::U8
    } else if whole(f64::from(i32::MIN), f64::from(i32::MAX)) {
        Number::I32
    } else if values.iter().all(|&x| !x.is_finite() || is_short_float(x, &mut digits)) {
        Number::F32
    } else {
        Number::F64
    }
}

/// Names for a message.
fn listed(names: &[String]) -> String {
    let shown: Vec<String> = names.iter().take(8).map(|n| show(n.as_bytes())).collect();
    shown.join(", ") + if names.len() > 8 { ", ..." } else { "" }
}

#[cfg(test)]
mod tests;
