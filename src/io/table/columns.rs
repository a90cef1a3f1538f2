//! Which columns of a table hold the coordinates, the normal and the attributes: settled at the first row, by what the
//! user says, else by the names of the columns, else the first three.

use super::super::doubt::Doubt;
use super::super::options::{Columns, ReadOptions};
use super::super::text::show;
use super::super::{Loaded, Want};
use super::dialect::{Delimiter, Dialect};
use super::heading::{Heading, Source};
use super::names::{self, Axes};
use crate::geometry::{Attribute, Number};
use crate::{Error, ErrorKind};

/// How rows are read, settled at the first one.
pub(super) struct RowLayout {
    pub dialect: Dialect,
    pub point: [usize; 3],
    pub normal: Option<[usize; 3]>,
    /// The columns of the attributes.
    pub more: Vec<usize>,
    /// Columns of the first row.
    pub total: usize,
    /// The choice is a guess that the numbers may speak against.
    pub guessed: bool,
    /// A line of names above names every column.
    pub named: bool,
}

/// The error for a row that has fewer columns than it should: those of `other`.
pub(super) fn missing(columns: usize, other: &str) -> Error {
    let what = format!("the row has {columns} columns, but {other}, so it is not certain which are missing");
    Error::new(ErrorKind::Format, what).advise(
        "complete the line, write nan for what is missing, or give --assume if only the last columns are missing",
    )
}

/// What the choice goes by, and where it says what it did: the notices, the warnings and the attributes of `loaded`.
pub(super) struct Chooser<'a> {
    pub options: &'a ReadOptions,
    pub want: Want,
    pub heading: &'a mut Heading,
    pub loaded: &'a mut Loaded,
}

impl Chooser<'_> {
    /// Settles the columns by the first row, behind whose last delimiter one more column may be empty (`open`).
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Format`] where it is not certain which columns hold the coordinates, with what to give.
    pub fn choose(mut self, dialect: Dialect, fields: &[&[u8]], open: bool) -> Result<RowLayout, Error> {
        // The last column of the first row may be empty.
        let named = self.heading.header.as_ref().map_or(0, |h| h.names.len());
        let total = fields.len() + usize::from(open && named == fields.len() + 1);
        let mut layout = RowLayout {
            dialect,
            point: [0, 1, 2],
            normal: None,
            more: Vec::new(),
            total,
            guessed: true,
            named: false,
        };
        if dialect.decimal_comma {
            self.loaded.notices.push("numbers have decimal commas".into());
        }
        match &self.options.columns {
            Some(Columns::Numbers(numbers)) => layout.point = numbers.map(|n| n - 1),
            Some(Columns::Names(wanted)) => layout.point = self.named(wanted, total)?,
            None => self.apply_header(&mut layout, fields)?,
        }
        if self.heading.numbered && named + 1 == total {
            // One number less than the row has columns: the column of row numbers has no name, so the line is a header.
            self.heading.numbered = false;
            self.loaded.warnings.push(
                "the first line, which counts 0, 1, 2, was taken for the names of columns, not for a point"
                    .into(),
            );
        }
        layout.guessed |= self.heading.numbered;
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
        let Some(header) = self.heading.header.as_ref().filter(|_| !self.heading.numbered) else { return };
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
        let names = self.heading.header.as_ref().map_or(&[][..], |h| &h.names);
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
        let Some(header) = &self.heading.header else { return label() };
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
            layout.named = fits && header.source == Source::Line;
            let delimited = layout.dialect.delimiter != Delimiter::White;
            if header.source == Source::Line && names > total && delimited && !self.options.assume {
                return Err(missing(total, &format!("{names} are named")));
            }
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
            self.heading.title = Some(header.names.join(" "));
            self.heading.header = None;
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

/// Names for a message.
pub(super) fn listed(names: &[String]) -> String {
    let shown: Vec<String> = names.iter().take(8).map(|n| show(n.as_bytes())).collect();
    shown.join(", ") + if names.len() > 8 { ", ..." } else { "" }
}
