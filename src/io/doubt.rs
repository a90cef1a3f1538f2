//! Whether columns without names can be the coordinates they would be taken for.
//!
//! Point numbers, times, colours and normals in front of the coordinates make a cloud that looks sound and is wrong, so
//! the first rows are looked at before they are believed.

use crate::{Error, ErrorKind};

/// Rows that are looked at: point numbers and the like show in the first ones.
const ROWS: usize = 1000;
/// The largest difference between two times over the least one: times are rounded.
const MAX_UNEVENNESS: f64 = 1.5;
/// Columns that are looked at.
const COLUMNS: usize = 8;

/// What the first rows have in their columns.
#[derive(Default)]
pub(super) struct Evidence {
    rows: usize,
    columns: Vec<Column>,
    /// Rows in which columns 1 to 3, and columns 4 to 6, are a vector of length 1 (within 0.002), as normals are.
    unit_rows: [usize; 2],
}

#[derive(Clone, Copy)]
struct Column {
    first: f64,
    last: f64,
    low: f64,
    high: f64,
    /// Each number is whole.
    whole: bool,
    /// Each number was written without a decimal sign.
    bare: bool,
    /// Rows with a fraction.
    fractions: usize,
    /// Each number is one more than that before.
    counts: bool,
    /// Each number is as much more than that before as the second is than the first.
    steps: bool,
    /// The least and the largest difference to the number before.
    differences: [f64; 2],
    step: f64,
    rises: bool,
}

/// A reason not to believe that the first three columns are coordinates.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Doubt {
    /// What the columns look like.
    pub what: String,
    /// Where the coordinates begin instead, if that can be guessed; columns count from 0.
    pub from: Option<usize>,
}

impl Evidence {
    /// Whether more rows are of use.
    pub fn wants_more(&self) -> bool {
        self.rows < ROWS
    }

    /// Adds a row: each number, NaN where there is none, and whether it is written without a decimal sign.
    pub fn add(&mut self, row: impl Iterator<Item = (f64, bool)>) {
        let mut values = [f64::NAN; COLUMNS];
        let mut count = 0;
        for (i, (value, bare)) in row.take(COLUMNS).enumerate() {
            (values[i], count) = (value, i + 1);
            let whole = value.fract() == 0.0;
            if self.rows == 0 {
                let at = value;
                self.columns.push(Column {
                    first: at,
                    last: at,
                    low: at,
                    high: at,
                    whole,
                    bare,
                    fractions: usize::from(!whole && value.is_finite()),
                    counts: whole,
                    steps: whole,
                    differences: [f64::INFINITY, f64::NEG_INFINITY],
                    step: 0.0,
                    rises: true,
                });
            } else if let Some(c) = self.columns.get_mut(i) {
                c.whole &= whole;
                c.bare &= bare;
                c.fractions += usize::from(!whole && value.is_finite());
                c.counts &= whole && value == c.last + 1.0;
                if self.rows == 1 {
                    c.step = value - c.last;
                }
                c.steps &= whole && value - c.last == c.step;
                let [least, largest] = &mut c.differences;
                (*least, *largest) = (least.min(value - c.last), largest.max(value - c.last));
                c.rises &= value > c.last;
                c.last = value;
                (c.low, c.high) = (c.low.min(value), c.high.max(value));
            }
        }
        self.columns.truncate(count);
        for (unit, at) in self.unit_rows.iter_mut().zip([0, 3]) {
            let n = values[at..at + 3].iter().map(|x| x * x).sum::<f64>();
            *unit += usize::from((n.sqrt() - 1.0).abs() < 2e-3);
        }
        self.rows += 1;
    }

    /// Why the first three columns may be something else.
    pub fn doubt(&self) -> Option<Doubt> {
        let (rows, c) = (self.rows, &self.columns);
        let doubt = |what: String, from: Option<usize>| Some(Doubt { what, from });
        if rows < 3 || c.len() < 3 {
            return None;
        }
        if rows >= 8 && c.len() > 3 && c[0].steps && c[0].rises && !c[0].counts {
            let what = format!("column 1 rises by {} from row to row, as point numbers do", c[0].step);
            return doubt(what, Some(1));
        }
        let [least, largest] = c[0].differences;
        let even = c[0].rises && largest <= MAX_UNEVENNESS * least;
        if rows >= 8 && c.len() > 3 && even && !c[0].whole && c[0].low >= 0.0 {
            let mean = (c[0].last - c[0].first) / (rows - 1) as f64;
            let what = format!("column 1 rises evenly, by about {mean:.3} from row to row, as times do");
            return doubt(what, Some(1));
        }
        let fraction = |i: usize| c.get(i).is_some_and(|c| 2 * c.fractions > rows);
        if c.len() > 3 && c[0].counts {
            return doubt(
                format!("column 1 counts up by one from {}, as point numbers do", c[0].first),
                Some(1),
            );
        }
        let leading = c.iter().take_while(|c| c.whole).count();
        let then = |at: usize| (at..at + 3).all(fraction);
        if rows >= 4 && (1..=3).contains(&leading) && then(leading) {
            let within = |most: f64| c[..leading].iter().all(|c| c.low >= 0.0 && c.high <= most);
            if leading == 1 {
                let what = "column 1 holds whole numbers and the next three have fractions, as point numbers or \
                            classes in front of coordinates do";
                return doubt(what.into(), Some(1));
            } else if leading == 2 && within(1e5) {
                let what = "columns 1 and 2 hold whole numbers and the next three have fractions, as rows and \
                            columns of an image in front of coordinates do";
                return doubt(what.into(), Some(2));
            } else if leading == 3 && within(255.0) {
                return doubt("columns 1 to 3 hold whole numbers up to 255, as colours do".into(), Some(3));
            }
        }
        if rows < 8 {
            return None;
        }
        if c.len() >= 6 && self.unit_rows[0] == rows && 2 * self.unit_rows[1] < rows {
            return doubt("columns 1 to 3 have length 1 in every row, as normals do".into(), Some(3));
        }
        let small = |c: &Column| c.low > -1e7 && c.high < 1e7;
        if c.len() > 3 && c[0].rises && c[0].low > 1e8 && c[1..4].iter().all(small) {
            return doubt("column 1 rises from row to row and is large, as times do".into(), Some(1));
        }
        let span = |i: usize| c[i].high - c[i].low;
        let within = |i: usize, most: f64| {
            let middle = 0.5 * (c[i].low + c[i].high);
            c[i].low.abs().max(c[i].high.abs()) <= most && span(i) > 0.0 && span(i) < 0.1 * middle.abs()
        };
        let degrees = (within(0, 180.0) && within(1, 90.0)) || (within(0, 90.0) && within(1, 180.0));
        if degrees && span(0).max(span(1)) < 1.0 && span(2) > 50.0 * span(0).max(span(1)) {
            return doubt(
                "columns 1 and 2 look like longitude and latitude in degrees, column 3 like a height in another unit"
                    .into(),
                None,
            );
        }
        None
    }

    /// Whether the first three columns hold whole numbers only, written as such.
    pub fn all_bare(&self) -> bool {
        self.rows > 0 && self.columns.iter().take(3).all(|c| c.bare)
    }

    /// Whether column 1 counts up by one in a file of three columns: x cannot be told from a point number then.
    pub fn counts_in_three(&self) -> bool {
        self.rows >= 4 && self.columns.len() == 3 && self.columns[0].counts
    }
}

impl Doubt {
    /// About a matrix of so many columns without names.
    pub fn of_width(columns: usize) -> Doubt {
        let what =
            format!("the matrix has {columns} columns without names, as images and grids of heights do");
        Doubt { what, from: Some(0) }
    }

    /// The error for this doubt, with the options that settle it.
    pub fn error(&self) -> Error {
        let advice = match self.from {
            Some(from) => format!(
                "name the columns of x, y and z, such as --columns {},{},{} (in a survey list northing may come \
                 before easting), or give --assume if they are the first three",
                from + 1,
                from + 2,
                from + 3
            ),
            None => {
                "project the points to metres first, or give --assume if all three columns are lengths".into()
            }
        };
        Error::new(ErrorKind::Format, format!("it is not certain where the coordinates are: {}", self.what))
            .advise(advice)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said of rows of text.
    fn of(rows: impl IntoIterator<Item = String>) -> Option<Doubt> {
        let mut evidence = Evidence::default();
        for row in rows {
            evidence.add(row.split(' ').map(|w| (w.parse().unwrap(), !w.contains('.'))));
        }
        evidence.doubt()
    }

    /// A number with a fraction, of no pattern.
    fn odd(i: u32, seed: u32) -> f64 {
        let hash = i.wrapping_add(seed * 977).wrapping_mul(2_654_435_761) >> 8;
        f64::from(hash % 20_000) / 10_000.0 - 1.0 + 1.3e-5
    }

    #[test]
    fn other_things_than_coordinates_are_doubted() {
        let three = |i: u32| format!("{:.5} {:.5} {:.5}", odd(i, 1), odd(i, 2), odd(i, 3));
        let from = |row: &dyn Fn(u32) -> String| of((0..40).map(row)).map(|d| d.from);
        assert_eq!(from(&|i| format!("{} {}", i + 1, three(i))), Some(Some(1)));
        assert_eq!(from(&|i| format!("{} {} 5", 7 + i * i, three(i))), Some(Some(1)));
        assert_eq!(from(&|i| format!("{} {} 7 8", 10 * i, i * i % 7)), Some(Some(1)));
        assert_eq!(from(&|i| format!("{}.000 {}", i + 1, three(i))), Some(Some(1)));
        assert_eq!(from(&|i| format!("{} {} {}", i / 8, i % 8, three(i))), Some(Some(2)));
        assert_eq!(from(&|i| format!("{} 7 {} {}", i * 77 % 256, 255 - i, three(i))), Some(Some(3)));
        assert_eq!(from(&|i| format!("{}.25 {}", 1_600_000_000 + 5 * i, three(i))), Some(Some(1)));
        let unit = |i: u32| format!("{:.5} {:.5} 0.0", odd(i, 1).cos(), odd(i, 1).sin());
        assert_eq!(from(&|i| format!("{} {}", unit(i), three(i))), Some(Some(3)));
        let place = |i: u32| format!("{:.7} {:.7}", 13.4 + 1e-4 * odd(i, 1), 52.5 + 1e-4 * odd(i, 2));
        assert_eq!(from(&|i| format!("{} {:.2}", place(i), 40.0 + 9.0 * odd(i, 3))), Some(None));
        // Counting is enough, whatever the others are; and three rows are.
        assert!(of(["1 5 5 5", "2 6 5 7", "3 5 9 5"].map(String::from)).is_some());
    }

    #[test]
    fn coordinates_are_believed() {
        let three = |i: u32| format!("{:.5} {:.5} {:.5}", odd(i, 1), odd(i, 2), odd(i, 3));
        let rows: [&dyn Fn(u32) -> String; 7] = [
            &three,
            &|i| format!("{} {}", three(i), i),
            &|i| format!("{} 200 100 50", three(i)),
            &|i| format!("{} {}", three(i), three(i + 99)),
            &|i| format!("{} {} {} 1.5 2.5 3.5", i % 7, i % 5, i % 3 + 300),
            &|i| format!("{} {} {:.2} 0.51 0.3 0.2", 450_000 + i % 9, 5_411_000 + i % 8, odd(i, 2)),
            &|i| format!("{:.3} {:.3} {:.3}", 10.0 + odd(i, 1), 50.0 + odd(i, 2), 3.0 * odd(i, 3)),
        ];
        for row in rows {
            assert_eq!(of((0..40).map(row)), None, "{}", row(1));
        }
        assert_eq!(of(["1 5 5 5", "2 6 5 7"].map(String::from)), None);
        let mut evidence = Evidence::default();
        (0..9)
            .for_each(|i| evidence.add([f64::from(i), 0.5, 0.25].map(|x| (x, x.fract() == 0.0)).into_iter()));
        assert!(evidence.counts_in_three() && evidence.doubt().is_none());
    }

    #[test]
    fn the_error_says_what_to_give() {
        let doubt = of((0..9).map(|i| format!("{i} 0.5 0.25 0.125"))).unwrap();
        let text = doubt.error().to_string();
        assert!(text.contains("counts up by one from 0") && text.contains("--columns 2,3,4"), "{text}");
        assert!(text.contains("--assume"), "{text}");
    }
}
