//! Tables over many shapes, with a summary.

use super::column::{Column, FURTHER_COLUMNS, USUAL_COLUMNS};
use super::compare::Report;
use super::text_table::{Cell, TextTable};
use crate::geometry::ranked;

/// A table of numbers: one row a shape, one named column a quantity. A missing value prints as `-`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    columns: Vec<String>,
    rows: Vec<(String, Vec<Option<f64>>)>,
}

impl Table {
    /// An empty table with these columns.
    pub fn new<S: Into<String>>(columns: impl IntoIterator<Item = S>) -> Self {
        Table { columns: columns.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// The usual columns in the units of published tables: `10 CD_L1`, `100 CD_L2`, `NC`, `HD`, F-scores at once, half
    /// and twice the threshold, `10 acc`, `10 comp`, and for comparison the sampling floor of `10 CD_L1` and the
    /// floorless `10 CD_L1` to the true triangles. `None` is a shape that failed: its row has no values.
    pub fn of_reports<'a>(reports: impl IntoIterator<Item = (&'a str, Option<&'a Report>)>) -> Self {
        Self::of_columns(&USUAL_COLUMNS, reports)
    }

    /// Everything that was measured: the usual columns, the other normal consistency, precision and recall at the three
    /// thresholds, the rest of what was measured to triangles and to and from a scan, and the columns of the protocols.
    pub fn of_everything<'a>(reports: impl IntoIterator<Item = (&'a str, Option<&'a Report>)>) -> Self {
        Self::of_columns(&[USUAL_COLUMNS.as_slice(), &FURTHER_COLUMNS].concat(), reports)
    }

    /// The given columns, such as those of [`Protocol::columns`](super::Protocol::columns).
    pub fn of_columns<'a>(
        columns: &[Column],
        reports: impl IntoIterator<Item = (&'a str, Option<&'a Report>)>,
    ) -> Self {
        let mut table = Table::new(columns.iter().map(|c| c.name));
        for (name, report) in reports {
            table.push(name, columns.iter().map(|c| report.and_then(|r| c.value(r))).collect());
        }
        table
    }

    /// Appends a row.
    ///
    /// # Panics
    /// If there is not one value a column.
    #[track_caller]
    pub fn push(&mut self, name: impl Into<String>, values: Vec<Option<f64>>) {
        let (got, want) = (values.len(), self.columns.len());
        assert!(got == want, "Table::push: {got} values for {want} columns");
        self.rows.push((name.into(), values));
    }

    /// Appends a column, for quantities that other modules measure.
    ///
    /// # Panics
    /// If there is not one value a row.
    #[track_caller]
    pub fn add_column(&mut self, name: impl Into<String>, values: impl IntoIterator<Item = Option<f64>>) {
        let values: Vec<_> = values.into_iter().collect();
        let (got, want) = (values.len(), self.rows.len());
        assert!(got == want, "Table::add_column: {got} values for {want} rows");
        self.columns.push(name.into());
        for (row, value) in self.rows.iter_mut().zip(values) {
            row.1.push(value);
        }
    }

    /// Names of the columns.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Names and values of the rows.
    pub fn rows(&self) -> &[(String, Vec<Option<f64>>)] {
        &self.rows
    }

    /// Mean, median, 5th, 50th and 95th percentile of every column over the rows that have a value, and how many do.
    /// The median and the 50th percentile are the same number under the two names that published tables use, so it is
    /// listed once.
    pub fn summary(&self) -> Vec<(&'static str, Vec<Option<f64>>)> {
        let column = |c: usize| self.rows.iter().filter_map(|r| r.1[c]).collect::<Vec<f64>>();
        let all =
            |f: &dyn Fn(&[f64]) -> Option<f64>| (0..self.columns.len()).map(|c| f(&column(c))).collect();
        let mean = |x: &[f64]| (!x.is_empty()).then(|| x.iter().sum::<f64>() / x.len() as f64);
        vec![
            ("mean", all(&mean)),
            ("median", all(&|x| percentile(x, 50.0))),
            ("5 %", all(&|x| percentile(x, 5.0))),
            ("95 %", all(&|x| percentile(x, 95.0))),
            ("count", all(&|x| Some(x.len() as f64))),
        ]
    }

    /// The table written out, with the summary below its rows.
    pub fn written(&self) -> TextTable {
        let head = self.columns.iter().map(|c| Cell::text(c.as_str()));
        let mut table = TextTable::new([Cell::texts("shape", "name")].into_iter().chain(head));
        let line = |name: &str, values: &[Option<f64>]| -> Vec<Cell> {
            [Cell::text(name)].into_iter().chain(values.iter().map(|v| Cell::number(*v))).collect()
        };
        self.rows.iter().for_each(|(name, values)| table.push(line(name, values)));
        self.summary().iter().for_each(|(name, values)| table.push_summary(line(name, values)));
        table
    }

    /// Aligned plain text with the summary below a rule.
    pub fn to_text(&self) -> String {
        self.written().to_text()
    }

    /// A Markdown table, aligned for reading as text, too, with the summary as its last rows.
    pub fn to_markdown(&self) -> String {
        self.written().to_markdown()
    }

    /// Comma-separated values with a header, full precision, no summary; a missing value is empty.
    pub fn to_csv(&self) -> String {
        self.written().to_csv()
    }

    /// A LaTeX `tabular` that needs no package, with the summary below a rule; names are escaped.
    pub fn to_latex(&self) -> String {
        self.written().to_latex()
    }
}

/// The `p`-th percentile (0 to 100) of `values` in any order, linear between the two nearest ranks; `None` of nothing.
///
/// If a value is not a number, so is the result.
///
/// # Panics
/// If `p` is not between 0 and 100.
#[track_caller]
pub fn percentile(values: &[f64], p: f64) -> Option<f64> {
    assert!((0.0..=100.0).contains(&p), "percentile {p} is not between 0 and 100");
    if values.iter().any(|v| v.is_nan()) {
        return Some(f64::NAN);
    }
    let mut values = values.to_vec();
    let at = p / 100.0 * values.len().checked_sub(1)? as f64;
    let [low, high] = [at.floor(), at.ceil()].map(|rank| ranked(&mut values, rank as usize));
    // Equal neighbours, infinite ones among them, need no interpolation.
    Some(if low == high { low } else { low + (at - at.floor()) * (high - low) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::{Samples, compare_samples};

    fn small() -> Table {
        let mut t = Table::new(["a", "b,c"]);
        t.push("one", vec![Some(1.0), Some(0.25)]);
        t.push("two \"x\"", vec![Some(3.0), None]);
        t
    }

    #[test]
    fn summary_is_hand_checkable_and_skips_missing() {
        let s = small().summary();
        assert_eq!(s[0], ("mean", vec![Some(2.0), Some(0.25)]));
        assert_eq!(s[1], ("median", vec![Some(2.0), Some(0.25)]));
        assert_eq!(s[2], ("5 %", vec![Some(1.1), Some(0.25)]));
        assert_eq!(s[4], ("count", vec![Some(2.0), Some(1.0)]));
        assert_eq!(Table::new(["a"]).summary()[0].1, [None]);
    }

    #[test]
    fn it_is_written_with_its_summary() {
        let mut t = small();
        assert_eq!(t.to_csv(), "name,a,\"b,c\"\none,1,0.25\n\"two \"\"x\"\"\",3,\n");
        t.add_column("d", [Some(0.1 + 0.2), None]);
        assert_eq!(t.to_csv().lines().nth(1), Some("one,1,0.25,0.30000000000000004"));
        for text in [t.to_text(), t.to_markdown(), t.to_latex()] {
            let words = |line: &str| {
                let cells = line.split([' ', '|', '&', '\\']).filter(|w| !w.is_empty());
                cells.map(String::from).collect::<Vec<_>>()
            };
            let lines: Vec<_> = text.lines().map(words).collect();
            for want in [
                &["shape", "a", "b,c", "d"],
                &["one", "1", "0.2500", "0.3000"],
                &["mean", "2", "0.2500", "0.3000"],
            ] {
                assert!(lines.iter().any(|l| l == want), "{text}");
            }
        }
    }

    #[test]
    fn percentiles() {
        let x: Vec<f64> = (0..=100).rev().map(f64::from).collect();
        for p in [0.0, 5.0, 37.0, 50.0, 95.0, 100.0] {
            assert!((percentile(&x, p).unwrap() - p).abs() < 1e-9);
        }
        assert_eq!(percentile(&[4.0, 1.0], 50.0), Some(2.5));
        assert_eq!(percentile(&[7.0], 95.0), Some(7.0));
        assert_eq!(percentile(&[], 5.0), None);
        assert!(percentile(&[1.0, f64::NAN], 50.0).unwrap().is_nan());
        assert_eq!(percentile(&[f64::INFINITY; 2], 50.0), Some(f64::INFINITY));
    }

    #[test]
    fn reports_are_in_published_units() {
        let (a, b) = ([[0.0f32; 3]], [[0.25f32, 0.0, 0.0]]);
        let metrics = compare_samples(Samples::new(&a, None), Samples::new(&b, None), 0.2);
        let report = Report {
            metrics,
            surface: None,
            floor: None,
            scan: None,
            scale: 1.0,
            gt_samples: 1,
            pred_samples: 1,
        };
        let t = Table::of_reports([("x", Some(&report)), ("failed", None)]);
        assert_eq!(t.rows()[0].1[..4], [Some(2.5), Some(6.25), None, Some(0.25)]);
        assert_eq!(t.rows()[0].1[4..7], [Some(0.0), Some(0.0), Some(1.0)]);
        assert!(t.rows()[1].1.iter().all(Option::is_none));
        let all = Table::of_everything([("x", Some(&report))]);
        assert_eq!(all.columns()[..t.columns().len()], *t.columns());
        assert!(all.columns().iter().enumerate().all(|(i, c)| !all.columns()[..i].contains(c)), "{all:?}");
        let named = |name: &str| all.rows()[0].1[all.columns().iter().position(|c| c == name).unwrap()];
        let parts = ["precision half", "recall half", "precision", "recall twice"].map(named);
        assert_eq!(parts, [Some(0.0), Some(0.0), Some(0.0), Some(1.0)]);
    }

    #[test]
    #[should_panic(expected = "1 values for 2 columns")]
    fn rows_must_fit() {
        small().push("x", vec![None]);
    }
}
