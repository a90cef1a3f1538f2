//! The results as Markdown, comma-separated values and LaTeX.

use bijective_sdf::evaluate::Table;

use super::results::{Results, Share, Summary};
use super::setting::Setting;

/// All texts about the results.
pub struct Texts {
    /// Both tables, and what fails.
    pub markdown: String,
    /// The settings, in full precision.
    pub csv: String,
    /// The shapes, in full precision.
    pub shapes_csv: String,
    /// Both tables.
    pub latex: String,
}

/// Writes up the results; `title` is one line about what all runs share. With `paper` the figures of the paper's
/// ablation tables stand beside ours.
pub fn write(results: Results<'_>, title: &str, paper: bool) -> Texts {
    let settings = settings(results, paper);
    let shapes = shapes(results);
    let mut markdown = format!("{title}\n\n{}\n{}", settings.markdown(), notes(paper));
    markdown += &format!("\n10 CD_L1 by shape, mean over the seeds:\n\n{}", shapes.to_markdown());
    markdown += &faults(results);
    let mut by_shape = Cells::new(["shape".to_string()].into_iter().chain(shapes.columns().iter().cloned()));
    for (name, values) in shapes.rows().iter().map(|(n, v)| (n.as_str(), v)).chain(
        shapes.summary().iter().filter(|(name, _)| ["mean", "median"].contains(name)).map(|(n, v)| (*n, v)),
    ) {
        let cells = values.iter().map(|v| Cell::Figure(*v, 3));
        by_shape.rows.push([Cell::Text(name.to_string())].into_iter().chain(cells).collect());
    }
    let comment = title.replace('\n', " ");
    let latex = format!("% {comment}\n{}\n{}", settings.latex(), by_shape.latex());
    Texts { markdown, csv: settings.csv(), shapes_csv: shapes.to_csv(), latex }
}

/// The table of the settings alone, for the screen.
pub fn settings(results: Results<'_>, paper: bool) -> Cells {
    let figures = ["10 CD_L1", "5 %", "50 %", "95 %", "100 CD_L2", "NC", "HD", "F", "floor"];
    let counts = ["closed", "one part", "failures", "runs", "s", "s most"];
    let mut head: Vec<&str> = ["setting"].into_iter().chain(figures).chain(counts).collect();
    if paper {
        head.extend(["paper row", "paper 10 CD_L1", "paper 100 CD_L2", "paper NC"]);
    }
    let mut cells = Cells::new(head);
    for setting in results.plan.settings {
        let mut row = line(setting, &results.summary(setting), results.plan.same_as(setting));
        if paper {
            let text = setting.ablation.and_then(|a| a.row).unwrap_or_default();
            row.push(Cell::Text(text.to_string()));
            let figures = setting.ablation.map_or([None; 3], |a| a.figures());
            row.extend(figures.map(|x| Cell::Figure(x, 3)));
        }
        cells.rows.push(row);
    }
    cells
}

fn line(setting: &Setting, s: &Summary, same_as: Option<&Setting>) -> Vec<Cell> {
    let name = match same_as {
        Some(other) => format!("{} (= {})", setting.name, other.name),
        None => setting.name.clone(),
    };
    let mut row = vec![Cell::Text(name)];
    row.extend(s.cd_l1.map(|x| Cell::Figure(x, 4)));
    row.extend([s.cd_l2, s.nc, s.hd, s.f, s.floor].map(|x| Cell::Figure(x, 4)));
    row.extend([s.closed, s.single].map(Cell::Share));
    row.push(Cell::Figure(Some(s.failures as f64), 0));
    row.push(Cell::Share(s.runs));
    row.extend(s.seconds.map(|x| Cell::Figure(x, 1)));
    row
}

/// One row a shape, one column a setting.
fn shapes(results: Results<'_>) -> Table {
    let settings = results.plan.settings;
    let mut table = Table::new(settings.iter().map(|s| s.name.clone()));
    for shape in results.plan.shapes {
        let values = settings.iter().map(|s| results.mean_cd(s, &shape.name));
        table.push(&shape.name, values.collect());
    }
    table
}

fn notes(paper: bool) -> String {
    let mut text = String::from(
        "CD_L1, CD_L2, NC, HD and F (at 0.01) are means over the runs that gave a mesh, in the frame in which the \
         truth's longest side is 1; 5, 50 and 95 % are percentiles of 10 CD_L1; floor is the 10 CD_L1 that the truth \
         itself would get. closed: closed and oriented, of all runs; one part: of those whose truth is in one part; \
         failures: errors, and 10 CD_L1 above 0.3. Seconds are wall time of training and meshing.\n",
    );
    if paper {
        text += "The paper's figures are for the lamp class of ShapeNet and not for these shapes: only the trend from \
                 row to row can be compared.\n";
    }
    text
}

/// Which shapes fail, and how.
fn faults(results: Results<'_>) -> String {
    let mut text =
        String::from("\nWhat is wrong, shape by shape (bold: counts as a fault; a genus alone does not):\n");
    for setting in results.plan.settings {
        if results.plan.same_as(setting).is_some() {
            continue;
        }
        let made = results.made(setting);
        let mut lines: Vec<String> = made
            .iter()
            .filter(|(_, record)| !record.faults().is_empty())
            .map(|(job, record)| {
                let mark = if record.is_bad() { "**" } else { "" };
                let faults = record.faults().join("; ");
                format!("- {mark}{}{mark}, seed {}: {faults}\n", job.shape.name, job.seed)
            })
            .collect();
        lines.sort();
        if made.is_empty() {
            continue;
        }
        text += &format!("\n{}:\n\n", setting.name);
        text += if lines.is_empty() { "- nothing\n" } else { "" };
        text += &lines.concat();
    }
    text
}

/// A part of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    Text(String),
    /// A number, if there is one, and decimals to print.
    Figure(Option<f64>, usize),
    Share(Share),
}

impl Cell {
    fn shown(&self) -> String {
        match self {
            Cell::Text(text) => text.clone(),
            Cell::Figure(Some(x), decimals) => format!("{x:.decimals$}"),
            Cell::Figure(None, _) => "-".to_string(),
            Cell::Share(s) => format!("{} of {}", s.yes, s.all),
        }
    }

    fn exact(&self) -> String {
        match self {
            Cell::Figure(Some(x), _) => x.to_string(),
            Cell::Figure(None, _) => String::new(),
            Cell::Share(s) => format!("{}/{}", s.yes, s.all),
            Cell::Text(text) if text.contains(['"', ',', '\n', '\r']) => {
                format!("\"{}\"", text.replace('"', "\"\""))
            }
            Cell::Text(text) => text.clone(),
        }
    }
}

/// A table of texts, numbers and shares.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    head: Vec<String>,
    rows: Vec<Vec<Cell>>,
}

impl Cells {
    fn new<S: Into<String>>(head: impl IntoIterator<Item = S>) -> Cells {
        Cells { head: head.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// Aligned, so that it can be read as text, too.
    pub fn markdown(&self) -> String {
        let mut lines = vec![self.head.clone()];
        lines.extend(self.rows.iter().map(|row| row.iter().map(Cell::shown).collect()));
        lines.iter_mut().flatten().for_each(|cell| *cell = cell.replace('|', "\\|"));
        let widths: Vec<usize> = (0..self.head.len())
            .map(|c| lines.iter().map(|l| l[c].chars().count()).max().unwrap_or(0).max(2))
            .collect();
        let rule = |(c, w): (usize, &usize)| {
            if c == 0 { "-".repeat(*w) } else { format!("{}:", "-".repeat(w - 1)) }
        };
        lines.insert(1, widths.iter().enumerate().map(rule).collect());
        let mut out = String::new();
        for line in lines {
            let cells =
                line.iter().zip(&widths).enumerate().map(|(c, (cell, &w))| {
                    if c == 0 { format!("{cell:<w$}") } else { format!("{cell:>w$}") }
                });
            out += &format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "));
        }
        out
    }

    /// With a header; numbers in full precision, gaps empty.
    pub fn csv(&self) -> String {
        let head = self.head.iter().map(|h| Cell::Text(h.clone()).exact()).collect::<Vec<_>>().join(",");
        let rows = self.rows.iter().map(|row| row.iter().map(Cell::exact).collect::<Vec<_>>().join(","));
        [head].into_iter().chain(rows).map(|line| line + "\n").collect()
    }

    /// A `tabular` with plain rules.
    pub fn latex(&self) -> String {
        let line = |cells: &mut dyn Iterator<Item = String>| {
            format!("{} \\\\\n", cells.map(|c| escaped(&c)).collect::<Vec<_>>().join(" & "))
        };
        let mut out = format!("\\begin{{tabular}}{{l{}}}\n\\hline\n", "r".repeat(self.head.len() - 1));
        out += &line(&mut self.head.iter().cloned());
        out += "\\hline\n";
        for row in &self.rows {
            out += &line(&mut row.iter().map(Cell::shown));
        }
        out + "\\hline\n\\end{tabular}\n"
    }
}

/// A text as LaTeX prints it.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => {
                out.push('\\');
                out.push(c);
            }
            '\\' => out += "\\textbackslash{}",
            '~' => out += "\\textasciitilde{}",
            '^' => out += "\\textasciicircum{}",
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::plan::Plan;
    use super::super::plan::tests::{MEASURE, setting, shapes};
    use super::super::record::Form;
    use super::super::results::tests::{WHOLE, record};
    use super::*;
    use std::collections::HashMap;

    #[test]
    fn tables_say_what_the_records_say() {
        let dir = std::env::temp_dir().join(format!("bijective-sdf-suite-tables-{}", std::process::id()));
        let shapes = shapes(&dir, &["a_1", "b"]);
        let mut settings = vec![setting("default"), setting("sparse"), setting("k_8"), setting("k_4")];
        settings[1].config.bsp.patch = 3;
        settings[3].config.bsp.neighbours = 4;
        let plan = Plan::new(&shapes, &settings, &[0, 1], MEASURE).unwrap();
        let mut records = HashMap::new();
        for job in &plan.jobs {
            let cd = match (job.setting.name.as_str(), job.shape.name.as_str(), job.seed) {
                ("default", "a_1", seed) => 0.01 + 0.002 * seed as f64,
                ("default", "b", _) => 0.02,
                ("sparse", "b", 0) => 0.05,
                _ => continue,
            };
            let parts = if job.setting.name == "sparse" { 2 } else { 1 };
            let result = Form { components: parts, genus: Some(parts as i64 - 1), ..WHOLE };
            records.insert(job.fingerprint.clone(), record(cd, result, WHOLE));
        }
        let texts = write(Results { plan: &plan, records: &records }, "two shapes", true);
        let rows: Vec<Vec<&str>> = texts.csv.lines().map(|l| l.split(',').collect()).collect();
        let cell = |row: usize, name: &str| rows[row][rows[0].iter().position(|h| *h == name).unwrap()];
        let near =
            |text: &str, x: f64| assert!((text.parse::<f64>().unwrap() - x).abs() < 1e-9, "{text} {x}");
        assert_eq!(rows.len(), 5);
        near(cell(1, "10 CD_L1"), 0.155);
        near(cell(1, "50 %"), 0.16);
        assert_eq!((cell(1, "closed"), cell(1, "one part"), cell(1, "runs")), ("4/4", "4/4", "4/4"));
        assert_eq!((cell(2, "failures"), cell(2, "one part"), cell(2, "runs")), ("1", "0/1", "1/4"));
        assert_eq!(
            (cell(2, "paper row"), cell(2, "paper 10 CD_L1"), cell(2, "paper NC")),
            ("Sparse", "0.873", "0.814")
        );
        assert_eq!((cell(3, "setting"), cell(3, "10 CD_L1")), ("k_8 (= default)", cell(1, "10 CD_L1")));
        assert_eq!((cell(4, "10 CD_L1"), cell(4, "runs"), cell(4, "paper NC")), ("", "0/4", ""));

        let shapes: Vec<Vec<&str>> = texts.shapes_csv.lines().map(|l| l.split(',').collect()).collect();
        assert_eq!(shapes[0], ["name", "default", "sparse", "k_8", "k_4"]);
        near(shapes[1][1], 0.11);
        assert_eq!(shapes[1][2], "");
        assert_eq!(shapes[2][2], "0.5");

        let table: Vec<usize> =
            texts.markdown.lines().filter(|l| l.starts_with('|')).map(|l| l.chars().count()).collect();
        // Both tables are aligned: the settings' of 6 lines, then the shapes' of 9.
        assert!(table[..6].windows(2).all(|w| w[0] == w[1]) && table[6..].windows(2).all(|w| w[0] == w[1]));
        assert_eq!(table.len(), 15);
        let fault = "- **b**, seed 0: 10 CD_L1 0.500; 2 components instead of 1; genus 1 instead of 0\n";
        assert!(texts.markdown.contains(fault), "{}", texts.markdown);
        assert!(texts.markdown.contains("default:\n\n- nothing\n"));

        assert!(texts.latex.contains("\\begin{tabular}{lrrrrrrrrrrrrrrrrrrr}"), "{}", texts.latex);
        assert!(texts.latex.contains("k\\_8 (= default) & 0.1550 & ") && texts.latex.contains("5 \\% & "));
        assert!(texts.latex.contains("a\\_1 & 0.110 & - & 0.110 & - \\\\"));
        let without = write(Results { plan: &plan, records: &records }, "x", false);
        assert!(!without.csv.contains("paper") && !without.markdown.contains("paper"));
        std::fs::remove_dir_all(dir).unwrap();
    }

    #[test]
    fn texts_are_escaped() {
        let mut cells = Cells::new(["a_b", "c|d"]);
        cells.rows.push(vec![Cell::Text("x,\"y\"".into()), Cell::Text("50 % & \\".into())]);
        assert_eq!(cells.csv(), "a_b,c|d\n\"x,\"\"y\"\"\",50 % & \\\n");
        assert!(
            cells.latex().contains("a\\_b & c|d \\\\\n")
                && cells.latex().contains("50 \\% \\& \\textbackslash{}")
        );
        assert!(cells.markdown().contains("c\\|d"));
    }
}
