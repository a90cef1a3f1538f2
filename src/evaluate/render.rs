//! Tables as text, Markdown, LaTeX and comma-separated values.

use super::table::Table;
use std::fmt::Write;

impl Table {
    /// Aligned plain text with the summary below a rule.
    pub fn to_text(&self) -> String {
        let cells = self.cells();
        let widths = widths(&cells);
        let mut out = String::new();
        for (i, row) in cells.iter().enumerate() {
            if i == 1 || i == self.rows().len() + 1 {
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
        for c in self.columns() {
            let _ = write!(out, ",{}", quote(c));
        }
        out.push('\n');
        for (name, values) in self.rows() {
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

    /// A LaTeX `tabular` that needs no package, with the summary below a rule; names are escaped.
    pub fn to_latex(&self) -> String {
        let mut cells = self.cells();
        for row in &mut cells {
            row.iter_mut().for_each(|cell| *cell = latex(cell));
        }
        let widths = widths(&cells);
        let mut out = format!("\\begin{{tabular}}{{l{}}}\n\\hline\n", "r".repeat(self.columns().len()));
        for (i, row) in cells.iter().enumerate() {
            if i == 1 || i == self.rows().len() + 1 {
                out.push_str("\\hline\n");
            }
            push_line(&mut out, row, &widths, "", " & ", " \\\\");
        }
        out.push_str("\\hline\n\\end{tabular}\n");
        out
    }

    /// Header, rows and summary as printed.
    fn cells(&self) -> Vec<Vec<String>> {
        let line = |name: &str, values: &[Option<f64>]| {
            std::iter::once(name.to_string()).chain(values.iter().map(|v| number(*v))).collect()
        };
        let mut cells =
            vec![std::iter::once("shape".to_string()).chain(self.columns().iter().cloned()).collect()];
        cells.extend(self.rows().iter().map(|(name, values)| line(name, values)));
        cells.extend(self.summary().iter().map(|(name, values)| line(name, values)));
        cells
    }
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

/// A text with what LaTeX would act upon written out.
fn latex(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => out.extend(['\\', c]),
            '\\' => out.push_str("\\textbackslash{}"),
            '^' => out.push_str("\\textasciicircum{}"),
            '~' => out.push_str("\\textasciitilde{}"),
            '<' => out.push_str("\\textless{}"),
            '>' => out.push_str("\\textgreater{}"),
            '|' => out.push_str("\\textbar{}"),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small() -> Table {
        let mut t = Table::new(["a", "b,c"]);
        t.push("one", vec![Some(1.0), Some(0.25)]);
        t.push("two \"x\"", vec![Some(3.0), None]);
        t
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
    fn csv_quotes_and_keeps_precision() {
        let mut t = small();
        assert_eq!(t.to_csv(), "name,a,\"b,c\"\none,1,0.25\n\"two \"\"x\"\"\",3,\n");
        t.add_column("d", [Some(0.1 + 0.2), None]);
        assert!(t.to_csv().lines().nth(1) == Some("one,1,0.25,0.30000000000000004"), "{}", t.to_csv());
    }

    #[test]
    fn latex_is_escaped_and_has_its_columns() {
        let mut t = Table::new(["10 CD_L1", "1000 CD^2"]);
        t.push("a_b & 5 %", vec![Some(0.5), None]);
        t.push("c\\{d}~\n", vec![Some(1.5), Some(2.0)]);
        let text = t.to_latex();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[..2], ["\\begin{tabular}{lrr}", "\\hline"]);
        let cells = |line: &str| {
            let row = line.strip_suffix(" \\\\").unwrap();
            row.split(" & ").map(|c| c.trim().to_string()).collect::<Vec<_>>()
        };
        assert_eq!(cells(lines[2]), ["shape", "10 CD\\_L1", "1000 CD\\textasciicircum{}2"]);
        assert!(lines[4].starts_with("a\\_b \\& 5 \\% "), "{text}");
        assert_eq!(cells(lines[5]), ["c\\textbackslash{}\\{d\\}\\textasciitilde{}", "1.5000", "2"]);
        assert_eq!(cells(lines[7]), ["mean", "1", "2"]);
        assert_eq!(lines[lines.len() - 2..], ["\\hline", "\\end{tabular}"]);
        assert_eq!(text.matches("\\hline").count(), 4);
        assert!(
            !latex("a^b_c$d#")
                .replace("\\_", "")
                .replace("\\$", "")
                .replace("\\#", "")
                .contains(['^', '_', '$', '#'])
        );
    }
}
