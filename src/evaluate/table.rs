//! Tables over many shapes, with a summary.

use super::protocol::Report;
use std::fmt::Write;

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

    /// The usual columns in the units of published tables: `10 CD_L1`, `100 CD_L2`, `NC`, `HD`, F-scores at half, once
    /// and twice the threshold, `10 acc`, `10 comp`, and for comparison the sampling floor of `10 CD_L1` and the
    /// floorless `10 CD_L1` to the true triangles. `None` is a shape that failed: its row has no values.
    pub fn of_reports<'a>(reports: impl IntoIterator<Item = (&'a str, Option<&'a Report>)>) -> Self {
        let mut table = Table::new([
            "10 CD_L1",
            "100 CD_L2",
            "NC",
            "HD",
            "F",
            "F half",
            "F twice",
            "10 acc",
            "10 comp",
            "floor",
            "10 CD_L1 surf",
        ]);
        for (name, report) in reports {
            let values = match report {
                None => vec![None; table.columns.len()],
                Some(r) => {
                    let m = &r.metrics;
                    let [half, once, twice] = m.fscores().map(|f| Some(f.f));
                    vec![
                        Some(10.0 * m.cd_l1()),
                        Some(100.0 * m.cd_l2()),
                        m.nc(),
                        Some(m.hd()),
                        once,
                        half,
                        twice,
                        Some(10.0 * m.acc()),
                        Some(10.0 * m.comp()),
                        r.floor.map(|f| 10.0 * f.cd_l1()),
                        r.surface.map(|s| 10.0 * s.cd_l1()),
                    ]
                }
            };
            table.push(name, values);
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

    /// Aligned plain text with the summary below a rule.
    pub fn to_text(&self) -> String {
        let cells = self.cells();
        let widths = widths(&cells);
        let mut out = String::new();
        for (i, row) in cells.iter().enumerate() {
            if i == 1 || i == self.rows.len() + 1 {
                let total = widths.iter().sum::<usize>() + 2 * (widths.len() - 1);
                out.push_str(&"-".repeat(total));
                out.push('\n');
            }
            push_line(&mut out, row, &widths, "", "  ", "");
        }
        out
    }

    /// A Markdown table, aligned for reading as text too, with the summary as its last rows.
    pub fn to_markdown(&self) -> String {
        let mut cells = self.cells();
        for row in &mut cells {
            row[0] = row[0].replace('|', "\\|");
        }
        let widths = widths(&cells);
        let mut out = String::new();
        for (i, row) in cells.iter().enumerate() {
            push_line(&mut out, row, &widths, "| ", " | ", " |");
            if i == 0 {
                let rule: Vec<String> = widths
                    .iter()
                    .enumerate()
                    .map(|(c, &w)| if c == 0 { "-".repeat(w) } else { format!("{}:", "-".repeat(w - 1)) })
                    .collect();
                push_line(&mut out, &rule, &widths, "| ", " | ", " |");
            }
        }
        out
    }

    /// Comma-separated values with a header, full precision, no summary; a missing value is empty.
    pub fn to_csv(&self) -> String {
        let quote = |s: &str| {
            if s.contains(['"', ',', '\n', '\r']) {
                format!("\"{}\"", s.replace('"', "\"\""))
            } else {
                s.to_string()
            }
        };
        let mut out = String::from("name");
        for c in &self.columns {
            let _ = write!(out, ",{}", quote(c));
        }
        out.push('\n');
        for (name, values) in &self.rows {
            out.push_str(&quote(name));
            for v in values {
                let _ = match v {
                    Some(v) => write!(out, ",{v}"),
                    None => write!(out, ","),
                };
            }
            out.push('\n');
        }
        out
    }

    /// One JSON object a row and line, full precision, no summary; missing and non-finite values are `null`.
    pub fn to_json_lines(&self) -> String {
        let mut out = String::new();
        for (name, values) in &self.rows {
            let _ = write!(out, "{{\"name\":{}", json_string(name));
            for (c, v) in self.columns.iter().zip(values) {
                let _ = match v {
                    Some(v) if v.is_finite() => write!(out, ",{}:{v}", json_string(c)),
                    _ => write!(out, ",{}:null", json_string(c)),
                };
            }
            out.push_str("}\n");
        }
        out
    }

    /// Header, rows and summary as printed.
    fn cells(&self) -> Vec<Vec<String>> {
        let line = |name: &str, values: &[Option<f64>]| {
            std::iter::once(name.to_string()).chain(values.iter().map(|v| number(*v))).collect()
        };
        let mut cells =
            vec![std::iter::once("shape".to_string()).chain(self.columns.iter().cloned()).collect()];
        cells.extend(self.rows.iter().map(|(name, values)| line(name, values)));
        cells.extend(self.summary().iter().map(|(name, values)| line(name, values)));
        cells
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
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    let at = p / 100.0 * last as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    // Equal neighbours, infinite ones among them, need no interpolation.
    Some(if low == high { low } else { low + (at - at.floor()) * (high - low) })
}

fn number(v: Option<f64>) -> String {
    match v {
        None => "-".to_string(),
        Some(v) if v == v.trunc() && v.abs() < 1e9 => format!("{v}"),
        Some(v) if v.abs() >= 1e4 || v.abs() < 1e-3 => format!("{v:.3e}"),
        Some(v) => format!("{v:.4}"),
    }
}

fn widths(cells: &[Vec<String>]) -> Vec<usize> {
    (0..cells[0].len())
        .map(|c| cells.iter().map(|row| row[c].chars().count()).max().unwrap_or(0).max(3))
        .collect()
}

/// Names to the left, numbers to the right.
fn push_line(out: &mut String, row: &[String], widths: &[usize], open: &str, between: &str, close: &str) {
    out.push_str(open);
    for (i, (cell, &w)) in row.iter().zip(widths).enumerate() {
        let _ = match i {
            0 => write!(out, "{cell:<w$}"),
            _ => write!(out, "{between}{cell:>w$}"),
        };
    }
    out.push_str(close);
    out.push('\n');
}

fn json_string(s: &str) -> String {
    let mut out = String::from("\"");
    for c in s.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            c if (c as u32) < 0x20 => {
                let _ = write!(out, "\\u{:04x}", c as u32);
            }
            c => out.push(c),
        }
    }
    out.push('"');
    out
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
    fn text_and_markdown_are_aligned() {
        let t = small();
        for text in [t.to_text(), t.to_markdown()] {
            let widths: Vec<_> = text.lines().map(str::len).collect();
            assert!(widths.windows(2).all(|w| w[0] == w[1]), "{text}");
        }
        assert!(t.to_markdown().starts_with("| shape"));
        assert!(t.to_text().contains("0.2500") && t.to_text().contains('-'));
    }

    #[test]
    fn csv_and_json_quote_and_keep_precision() {
        let mut t = small();
        assert_eq!(t.to_csv(), "name,a,\"b,c\"\none,1,0.25\n\"two \"\"x\"\"\",3,\n");
        t.add_column("d", [Some(0.1 + 0.2), Some(f64::NAN)]);
        assert_eq!(
            t.to_json_lines(),
            "{\"name\":\"one\",\"a\":1,\"b,c\":0.25,\"d\":0.30000000000000004}\n\
             {\"name\":\"two \\\"x\\\"\",\"a\":3,\"b,c\":null,\"d\":null}\n"
        );
    }

    #[test]
    fn reports_are_in_published_units() {
        let (a, b) = ([[0.0f32; 3]], [[0.25f32, 0.0, 0.0]]);
        let metrics = compare_samples(Samples::new(&a, None), Samples::new(&b, None), 0.2);
        let report =
            Report { metrics, surface: None, floor: None, scale: 1.0, gt_samples: 1, pred_samples: 1 };
        let t = Table::of_reports([("x", Some(&report)), ("failed", None)]);
        assert_eq!(t.rows()[0].1[..4], [Some(2.5), Some(6.25), None, Some(0.25)]);
        assert_eq!(t.rows()[0].1[4..7], [Some(0.0), Some(0.0), Some(1.0)]);
        assert!(t.rows()[1].1.iter().all(Option::is_none));
        assert_eq!(t.columns().len(), t.rows()[0].1.len());
    }

    #[test]
    #[should_panic(expected = "1 values for 2 columns")]
    fn rows_must_fit() {
        small().push("x", vec![None]);
    }
}
