//! Which numbers of an array are the coordinates of a point, by its shape and its fields.

use super::super::options::{Columns, ReadOptions};
use super::super::text::show;
use super::super::{Loaded, MAX_ATTRIBUTES};
use super::header::Header;
use crate::{Error, ErrorKind};

/// Where the numbers of a point are.
pub(super) struct ArrayLayout {
    pub points: usize,
    pub columns: usize,
    /// Items from a point to the next in a row of an image (in the whole array, if it is none).
    point_step: usize,
    /// Items from a column to the next.
    column_step: usize,
    /// Points in a row of an image; 0 if the array is no image.
    width: usize,
    /// Items from a row of an image to the next.
    row_step: usize,
    /// The columns of x, y and z.
    pub column: [usize; 3],
    /// The fields of x, y and z.
    pub field: [usize; 3],
    /// The columns have no names and were not given.
    pub guessed: bool,
}

/// Columns without names that are taken for points and what belongs to them; a matrix of more may be anything.
pub(super) const MAX_COLUMNS: usize = 16;

impl ArrayLayout {
    /// Columns and fields beside those of x, y and z.
    pub fn others(&self, header: &Header) -> Vec<(usize, usize)> {
        let pairs = (0..self.columns).flat_map(|column| (0..header.fields.len()).map(move |f| (column, f)));
        let own: Vec<(usize, usize)> = self.column.into_iter().zip(self.field).collect();
        pairs.filter(|pair| !own.contains(pair)).take(MAX_ATTRIBUTES).collect()
    }

    /// The item of a point in a column, counted from the beginning of the array.
    pub fn at(&self, point: usize, column: usize) -> usize {
        let place = match self.width {
            0 => point * self.point_step,
            width => point / width * self.row_step + point % width * self.point_step,
        };
        place + column * self.column_step
    }

    /// Finds out which axes of the array are points and which their columns, and says so in the notices of `loaded`
    /// where it is not the usual order.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Format`] if the shape is not that of points or the columns that are asked for are not there.
    pub fn of(header: &Header, options: &ReadOptions, loaded: &mut Loaded) -> Result<ArrayLayout, Error> {
        let wrong = || {
            let sizes: Vec<String> = header.shape.iter().map(u64::to_string).collect();
            Error::new(
                ErrorKind::Format,
                format!("the shape is ({}), not n rows of 3 or more columns", sizes.join(", ")),
            )
            .at_element("NPY header")
            .advise("save an array of shape (n, 3), for example points.reshape(-1, 3)")
        };
        let size = |n: u64| usize::try_from(n).map_err(|_| wrong());
        let mut sizes = Vec::new();
        for n in &header.shape {
            sizes.push(size(*n)?);
        }
        let total = sizes.iter().try_fold(1_usize, |all, n| all.checked_mul(*n)).unwrap_or(usize::MAX);
        let mut layout = ArrayLayout {
            points: total,
            columns: 1,
            point_step: 1,
            column_step: 1,
            width: 0,
            row_step: 0,
            column: [0; 3],
            field: [0, 1, 2],
            guessed: false,
        };
        if header.fields.len() > 1 || header.fields[0].name.is_some() {
            // Rows with named fields; their order in memory does not matter.
            layout.field = named(header, options)?;
            return Ok(layout);
        }
        layout.field = [0; 3];
        layout.guessed = true;
        // Items from one index to the next, along each axis.
        let mut steps = vec![1_usize; sizes.len()];
        let order: Vec<usize> =
            if header.fortran { (0..sizes.len()).collect() } else { (0..sizes.len()).rev().collect() };
        let mut step = 1_usize;
        for axis in order {
            steps[axis] = step;
            step = step.saturating_mul(sizes[axis]);
        }
        match sizes[..] {
            // n x c, a row a point. Not if there are exactly 3 rows and more columns, or 3 to 16 rows and more than 16
            // columns: such arrays are stored the other way round (next arm).
            [rows, columns]
                if columns >= 3
                    && !(rows < columns && (3..=MAX_COLUMNS).contains(&rows) && columns > MAX_COLUMNS)
                    && !(rows == 3 && columns > 3) =>
            {
                (layout.points, layout.columns) = (rows, columns);
                (layout.point_step, layout.column_step) = (steps[0], steps[1]);
            }
            [rows, columns] if rows >= 3 && columns >= 3 => {
                loaded.notices.push(format!("the array was read as {columns} points in columns of {rows}"));
                (layout.points, layout.columns) = (columns, rows);
                (layout.point_step, layout.column_step) = (steps[1], steps[0]);
            }
            [height, width, columns]
                if columns == 3 || (columns <= MAX_COLUMNS && columns > 3 && height != 3) =>
            {
                loaded.notices.push(format!("the array was read as an image of {height} x {width} points"));
                (layout.points, layout.columns) = (height.saturating_mul(width), columns);
                (layout.width, layout.row_step) = (width, steps[0]);
                (layout.point_step, layout.column_step) = (steps[1], steps[2]);
            }
            [columns @ 3..=MAX_COLUMNS, height, width] => {
                loaded.notices.push(format!("the array was read as an image of {height} x {width} points"));
                (layout.points, layout.columns) = (height.saturating_mul(width), columns);
                (layout.width, layout.row_step) = (width, steps[1]);
                (layout.point_step, layout.column_step) = (steps[2], steps[0]);
            }
            _ => return Err(wrong()),
        }
        layout.column = match &options.columns {
            None => [0, 1, 2],
            Some(Columns::Numbers(numbers)) if numbers.iter().all(|n| *n <= layout.columns) => {
                numbers.map(|n| n - 1)
            }
            Some(_) => {
                return Err(Error::new(
                    ErrorKind::Format,
                    format!("the array has {} columns without names", layout.columns),
                )
                .advise("give numbers of columns, as in --columns 1,2,3"));
            }
        };
        Ok(layout)
    }
}

/// The fields x, y and z, or those that the user named.
fn named(header: &Header, options: &ReadOptions) -> Result<[usize; 3], Error> {
    let names: Vec<&str> = header.fields.iter().map(|f| f.name.as_deref().unwrap_or_default()).collect();
    let wanted = match &options.columns {
        None => ["x", "y", "z"].map(String::from),
        Some(Columns::Names(names)) => names.clone(),
        Some(Columns::Numbers(numbers)) if numbers.iter().all(|n| *n <= names.len()) => {
            return Ok(numbers.map(|n| n - 1));
        }
        Some(Columns::Numbers(_)) => [String::new(), String::new(), String::new()],
    };
    let mut places = [0; 3];
    for (place, name) in places.iter_mut().zip(&wanted) {
        *place = names.iter().position(|n| n.eq_ignore_ascii_case(name)).ok_or_else(|| {
            let list: Vec<String> = names.iter().take(8).map(|n| show(n.as_bytes())).collect();
            Error::new(ErrorKind::Format, format!("there is no field {name:?}, only {}", list.join(", ")))
                .at_element("NPY header")
                .advise("name those of x, y and z, as in --columns px,py,pz")
        })?;
    }
    Ok(places)
}
