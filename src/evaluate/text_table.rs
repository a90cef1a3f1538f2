//! Tables of texts and numbers as plain text, Markdown, LaTeX and comma-separated values.

/// A part of a table: what people read, and what programs do.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    shown: String,
    exact: String,
}

impl Cell {
    /// A text, or a number that is a text already.
    pub fn text(text: impl Into<String>) -> Cell {
        let shown = text.into();
        Cell { exact: shown.clone(), shown }
    }

    /// One text for people and another for programs.
    pub fn texts(shown: impl Into<String>, exact: impl Into<String>) -> Cell {
        Cell { shown: shown.into(), exact: exact.into() }
    }

    /// For people a whole number below 1e9 as it is, one of at least 1e4 or below 1e-3 in size with an exponent and
    /// three decimals, and any other with four decimals; for programs all digits. A missing number is `-`, and empty
    /// for programs.
    pub fn number(value: Option<f64>) -> Cell {
        let shown = match value {
            Some(v) if v == v.trunc() && v.abs() < 1e9 => format!("{v}"),
            Some(v) if v.abs() >= 1e4 || v.abs() < 1e-3 => format!("{v:.3e}"),
            _ => return Cell::figure(value, 4),
        };
        Cell { shown, ..Cell::figure(value, 0) }
    }

    /// A number with so many decimals, in full for programs. A missing number is `-`, and empty for programs.
    pub fn figure(value: Option<f64>, decimals: usize) -> Cell {
        let shown = value.map_or("-".to_string(), |v| format!("{v:.decimals$}"));
        Cell { shown, exact: value.map(|v| v.to_string()).unwrap_or_default() }
    }
}

/// A table of texts and numbers. The first column is written to the left, the others to the right.
#[derive(Clone, Debug, PartialEq)]
pub struct TextTable {
    head: Vec<Cell>,
    rows: Vec<Vec<Cell>>,
    /// Rows that follow below a rule, and that programs do not get.
    summary: Vec<Vec<Cell>>,
}

impl TextTable {
    /// An empty table with these columns.
    ///
    /// # Panics
    /// If there is no column.
    #[track_caller]
    pub fn new(head: impl IntoIterator<Item = Cell>) -> TextTable {
        let head: Vec<Cell> = head.into_iter().collect();
        assert!(!head.is_empty(), "TextTable::new: no column");
        TextTable { head, rows: Vec::new(), summary: Vec::new() }
    }

    /// Appends a row.
    ///
    /// # Panics
    /// If there is not one cell a column.
    #[track_caller]
    pub fn push(&mut self, row: impl IntoIterator<Item = Cell>) {
        self.rows.push(self.fitting(row));
    }

    /// Appends a row of the summary, which is not part of the comma-separated values.
    ///
    /// # Panics
    /// If there is not one cell a column.
    #[track_caller]
    pub fn push_summary(&mut self, row: impl IntoIterator<Item = Cell>) {
        self.summary.push(self.fitting(row));
    }

    #[track_caller]
    fn fitting(&self, row: impl IntoIterator<Item = Cell>) -> Vec<Cell> {
        let row: Vec<Cell> = row.into_iter().collect();
        let (got, want) = (row.len(), self.head.len());
        assert!(got == want, "TextTable: {got} cells for {want} columns");
        row
    }

    /// The same with these columns only, in this order; names that are not there are left out.
    ///
    /// # Panics
    /// If none is there.
    #[track_caller]
    pub fn select(&self, names: &[&str]) -> TextTable {
        let kept: Vec<usize> =
            names.iter().filter_map(|n| self.head.iter().position(|h| h.shown == *n)).collect();
        let of = |row: &Vec<Cell>| kept.iter().map(|&c| row[c].clone()).collect::<Vec<_>>();
        let mut table = TextTable::new(of(&self.head));
        table.rows = self.rows.iter().map(of).collect();
        table.summary = self.summary.iter().map(of).collect();
        table
    }

    /// Aligned plain text, with rules below the header and above the summary.
    pub fn to_text(&self) -> String {
        let layout = self.layout(str::to_string, ["", "  ", "\n"]);
        let rule = "-".repeat(layout.head.trim_end_matches('\n').chars().count()) + "\n";
        let summary = if layout.summary.is_empty() { String::new() } else { rule.clone() + &layout.summary };
        layout.head + &rule + &layout.rows + &summary
    }

    /// A Markdown table, aligned for reading as text, too, with the summary as its last rows.
    pub fn to_markdown(&self) -> String {
        let escape = |cell: &str| cell.replace('|', "\\|").replace(['\n', '\r'], " ");
        let layout = self.layout(escape, ["| ", " | ", " |\n"]);
        let rule = |(c, &w): (usize, &usize)| {
            if c == 0 { "-".repeat(w) } else { format!("{}:", "-".repeat(w - 1)) }
        };
        let rule: Vec<String> = layout.widths.iter().enumerate().map(rule).collect();
        format!("{}| {} |\n{}{}", layout.head, rule.join(" | "), layout.rows, layout.summary)
    }

    /// Comma-separated values with a header, full precision, no summary; a missing value is empty.
    pub fn to_csv(&self) -> String {
        let quoted = |cell: &Cell| match cell.exact.contains(['"', ',', '\n', '\r']) {
            true => format!("\"{}\"", cell.exact.replace('"', "\"\"")),
            false => cell.exact.clone(),
        };
        let line = |row: &Vec<Cell>| row.iter().map(quoted).collect::<Vec<_>>().join(",") + "\n";
        std::iter::once(&self.head).chain(&self.rows).map(line).collect()
    }

    /// A LaTeX `tabular` that needs no package, with the summary below a rule; texts are escaped.
    pub fn to_latex(&self) -> String {
        let layout = self.layout(latex, ["", " & ", " \\\\\n"]);
        let columns = "r".repeat(self.head.len() - 1);
        let summary = if layout.summary.is_empty() { "" } else { "\\hline\n" };
        format!(
            "\\begin{{tabular}}{{l{columns}}}\n\\hline\n{}\\hline\n{}{summary}{}\\hline\n\\end{{tabular}}\n",
            layout.head, layout.rows, layout.summary
        )
    }

    /// All lines, aligned; `marks` stand before, between and behind the cells.
    fn layout(&self, escape: impl Fn(&str) -> String, marks: [&str; 3]) -> Layout {
        let escaped = |rows: &[Vec<Cell>]| -> Vec<Vec<String>> {
            rows.iter().map(|row| row.iter().map(|cell| escape(&cell.shown)).collect()).collect()
        };
        let parts = [std::slice::from_ref(&self.head), &self.rows, &self.summary].map(escaped);
        let width =
            |c: usize| parts.iter().flatten().map(|row| row[c].chars().count()).max().unwrap_or(0).max(3);
        let widths: Vec<usize> = (0..self.head.len()).map(width).collect();
        let line = |row: &Vec<String>| {
            let cell = |(c, (cell, &w)): (usize, (&String, &usize))| {
                if c == 0 { format!("{cell:<w$}") } else { format!("{cell:>w$}") }
            };
            let cells: Vec<String> = row.iter().zip(&widths).enumerate().map(cell).collect();
            format!("{}{}{}", marks[0], cells.join(marks[1]), marks[2])
        };
        let [head, rows, summary] = parts.each_ref().map(|part| part.iter().map(line).collect::<String>());
        Layout { widths, head, rows, summary }
    }
}

/// The lines of a table, and the widths of its columns.
struct Layout {
    widths: Vec<usize>,
    head: String,
    rows: String,
    summary: String,
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

    fn small() -> TextTable {
        let mut t = TextTable::new([Cell::texts("shape", "name"), Cell::text("a"), Cell::text("b,c")]);
        t.push([Cell::text("one"), Cell::number(Some(1.0)), Cell::number(Some(0.25))]);
        t.push([Cell::text("two \"x\" | y"), Cell::figure(Some(0.1 + 0.2), 1), Cell::number(None)]);
        t
    }

    fn summed() -> TextTable {
        let mut t = small();
        t.push_summary([Cell::text("mean"), Cell::number(Some(0.65)), Cell::number(Some(0.25))]);
        t
    }

    #[test]
    fn numbers_show_what_they_are() {
        let shown = |v: f64| Cell::number(Some(v)).shown;
        assert_eq!(
            [3.0, -2.0, 0.25, 123.456, 0.000123, 12345.6].map(shown),
            ["3", "-2", "0.2500", "123.4560", "1.230e-4", "1.235e4"]
        );
        assert_eq!(Cell::number(None), Cell::texts("-", ""));
        assert_eq!(Cell::figure(Some(2.0 / 3.0), 2), Cell::texts("0.67", "0.6666666666666666"));
        assert_eq!(Cell::figure(None, 2), Cell::texts("-", ""));
    }

    #[test]
    fn text_and_markdown_are_aligned() {
        for t in [small(), summed()] {
            for text in [t.to_text(), t.to_markdown()] {
                let widths: Vec<_> = text.lines().map(str::len).collect();
                assert!(widths.windows(2).all(|w| w[0] == w[1]), "{text}");
            }
        }
        let lines: Vec<String> = summed().to_text().lines().map(String::from).collect();
        assert_eq!((lines.len(), &lines[1]), (6, &lines[4]));
        assert!(lines[1].bytes().all(|c| c == b'-') && lines[5].starts_with("mean"), "{lines:?}");
        assert_eq!(small().to_text().lines().count(), 4);
        let markdown = summed().to_markdown();
        assert!(
            markdown.starts_with("| shape ") && markdown.contains("two \"x\" \\| y |    0.3 |"),
            "{markdown}"
        );
        let rule = markdown.lines().nth(1).unwrap();
        assert!(rule.starts_with("| --") && rule.ends_with("-: | -----: |"), "{rule}");
    }

    #[test]
    fn csv_quotes_and_keeps_precision_and_leaves_the_summary_out() {
        let want = "name,a,\"b,c\"\none,1,0.25\n\"two \"\"x\"\" | y\",0.30000000000000004,\n";
        assert_eq!(summed().to_csv(), want);
    }

    #[test]
    fn columns_are_selected_by_name() {
        let t = summed().select(&["b,c", "not there", "shape"]);
        assert_eq!(t.to_csv(), "\"b,c\",name\n0.25,one\n,\"two \"\"x\"\" | y\"\n");
        assert_eq!(t.summary[0], [Cell::number(Some(0.25)), Cell::text("mean")]);
    }

    #[test]
    fn latex_is_escaped_and_has_its_columns() {
        let mut t = TextTable::new(["shape", "10 CD_L1", "1000 CD^2"].map(Cell::text));
        t.push([Cell::text("a_b & 5 %"), Cell::number(Some(0.5)), Cell::number(None)]);
        t.push([Cell::text("c\\{d}~\n"), Cell::number(Some(1.5)), Cell::number(Some(2.0))]);
        assert_eq!(t.to_latex().matches("\\hline").count(), 3);
        t.push_summary([Cell::text("mean"), Cell::number(Some(1.0)), Cell::number(Some(2.0))]);
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
        let rest = latex("a^b_c$d#").replace("\\_", "").replace("\\$", "").replace("\\#", "");
        assert!(!rest.contains(['^', '_', '$', '#']), "{rest}");
    }

    #[test]
    #[should_panic(expected = "1 cells for 3 columns")]
    fn rows_must_fit() {
        small().push([Cell::text("x")]);
    }
}
