//! The results as Markdown, comma-separated values and LaTeX.

use bijective_sdf::evaluate::{Cell, Table, TextTable};

use super::record::Cover;
use super::results::{Against, Results, Share, Summary};
use super::setting::Setting;

/// All texts about the results.
pub struct Texts {
    /// Both tables, and what fails.
    pub markdown: String,
    /// The settings, in full precision.
    pub csv: String,
    /// The shapes, in full precision.
    pub shapes_csv: String,
    /// What is known of S, in full precision.
    pub surface_csv: String,
    /// Both tables, of the settings the columns that fit on a page.
    pub latex: String,
}

/// The columns of the settings that go into print.
const PRINTED: [&str; 17] = [
    "setting",
    "10 CD_L1",
    "5 %",
    "50 %",
    "95 %",
    "ratio",
    "better",
    "100 CD_L2",
    "NC",
    "HD",
    "closed",
    "one part",
    "failures",
    "s",
    "paper row",
    "paper 10 CD_L1",
    "paper NC",
];

/// Writes up the results; `title` is one line about what all runs share. With `paper` the figures of the paper's
/// ablation tables stand beside ours.
pub fn write(results: Results<'_>, title: &str, paper: bool) -> Texts {
    let shapes = shapes(results);
    let mut markdown = format!("{title}\n\n{}\n{}", screen(results, paper), notes(paper));
    let settings = settings(results, paper);
    markdown += &format!("\n10 CD_L1 by shape, mean over the seeds:\n\n{}", shapes.to_markdown());
    markdown += &faults(results);
    let comment = title.replace('\n', " ");
    let latex =
        format!("% {comment}\n{}\n{}", settings.select(&PRINTED).to_latex(), by_shape(&shapes).to_latex());
    Texts {
        markdown,
        csv: settings.to_csv(),
        shapes_csv: shapes.to_csv(),
        surface_csv: surface(results).to_csv(),
        latex,
    }
}

/// The tables of the settings alone, for the screen: of the results and, if anything is known of it, of S.
pub fn screen(results: Results<'_>, paper: bool) -> String {
    let settings = settings(results, paper).to_markdown();
    let known = results.plan.settings.iter().any(|s| results.summary(s).cover != Cover::default());
    if known { format!("{settings}\n{}", surface(results).to_markdown()) } else { settings }
}

/// What is known of S, setting by setting.
fn surface(results: Results<'_>) -> TextTable {
    let head = [
        "setting",
        "mean code",
        "even",
        "folded",
        "distinct",
        "10 Q to S",
        "10 S to Q",
        "10 S to truth",
        "10 truth to S",
        "10 truth to Q",
        "10 floor",
    ];
    let mut table = TextTable::new(head.map(Cell::text));
    for setting in results.plan.settings {
        let c = results.summary(setting).cover;
        let tenfold = [c.q_to_s, c.s_to_q, c.s_to_truth, c.truth_to_s, c.truth_to_q, c.floor]
            .map(|x| Cell::figure(x.map(|x| 10.0 * x), 4));
        let shares = [c.mean_code, c.evenness, c.folded, c.distinct].map(|x| Cell::figure(x, 3));
        table.push([Cell::text(setting.name.as_str())].into_iter().chain(shares).chain(tenfold));
    }
    table
}

fn settings(results: Results<'_>, paper: bool) -> TextTable {
    let figures = ["10 CD_L1", "5 %", "50 %", "95 %", "100 CD_L2", "NC", "HD", "F", "floor"];
    let counts = ["closed", "one part", "failures", "runs", "s", "s most"];
    // A lone setting has nothing to be held against.
    let several = results.plan.settings.len() > 1;
    let against: &[&str] = if several { &["ratio", "better"] } else { &[] };
    let mut head = vec!["setting"];
    head.extend(figures.into_iter().chain(against.iter().copied()).chain(counts));
    if paper {
        head.extend(["paper row", "paper 10 CD_L1", "paper 100 CD_L2", "paper NC"]);
    }
    let mut table = TextTable::new(head.into_iter().map(Cell::text));
    for setting in results.plan.settings {
        let against = several.then(|| results.against_first(setting));
        let mut row = line(setting, &results.summary(setting), against, results.plan.same_as(setting));
        if paper {
            let text = setting.ablation.and_then(|a| a.row).unwrap_or_default();
            row.push(Cell::text(text));
            let figures = setting.ablation.map_or([None; 3], |a| a.figures());
            row.extend(figures.map(|x| Cell::figure(x, 3)));
        }
        table.push(row);
    }
    table
}

fn line(
    setting: &Setting,
    s: &Summary,
    against: Option<Option<Against>>,
    same_as: Option<&Setting>,
) -> Vec<Cell> {
    let name = match same_as {
        Some(other) => format!("{} (= {})", setting.name, other.name),
        None => setting.name.clone(),
    };
    let mut row = vec![Cell::text(name)];
    row.extend(s.cd_l1.map(|x| Cell::figure(x, 4)));
    row.extend([s.cd_l2, s.nc, s.hd, s.f, s.floor].map(|x| Cell::figure(x, 4)));
    if let Some(against) = against {
        row.push(Cell::figure(against.map(|a| a.ratio), 3));
        row.push(against.map_or(Cell::text(""), |a| share(a.better)));
    }
    row.extend([s.closed, s.single].map(share));
    row.push(Cell::figure(Some(s.failures as f64), 0));
    row.push(share(s.runs));
    row.extend(s.seconds.map(|x| Cell::figure(x, 1)));
    row
}

fn share(s: Share) -> Cell {
    Cell::texts(format!("{} of {}", s.yes, s.all), format!("{}/{}", s.yes, s.all))
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

/// The same for print: fewer decimals, and of the summary the mean and the median.
fn by_shape(shapes: &Table) -> TextTable {
    let head = shapes.columns().iter().map(|c| Cell::text(c.as_str()));
    let mut table = TextTable::new([Cell::text("shape")].into_iter().chain(head));
    let line = |name: &str, values: &[Option<f64>]| -> Vec<Cell> {
        [Cell::text(name)].into_iter().chain(values.iter().map(|v| Cell::figure(*v, 3))).collect()
    };
    shapes.rows().iter().for_each(|(name, values)| table.push(line(name, values)));
    let summary = shapes.summary();
    let kept = summary.iter().filter(|(name, _)| ["mean", "median"].contains(name));
    kept.for_each(|(name, values)| table.push_summary(line(name, values)));
    table
}

fn notes(paper: bool) -> String {
    let mut text = String::from(
        "CD_L1, CD_L2, NC, HD and F (at 0.01) are means over the runs that gave a mesh, in the frame in which the \
         truth's longest side is 1; 5, 50 and 95 % are percentiles of 10 CD_L1; floor is the 10 CD_L1 that the truth \
         itself would get; ratio is the geometric mean, over shapes and seeds, of CD_L1 over that of the first \
         setting, better counts where it is less. closed: closed and oriented, of all runs; one part: of those whose \
         truth is in one part; \
         failures: errors, and 10 CD_L1 above 0.3. Seconds are wall time of training and meshing.\n\n\
         Of S, means over the runs: mean code, the length of the points' mean code on the sphere (1: all in one spot); \
         even, the share of the sphere's codes that are in some patch; folded, the share of the pairs of points in one \
         place whose codes are far apart; distinct, the share of its points; distances between S and the points Q with \
         the longest side of Q 1, to and from the truth with that of the truth 1; floor is what as many points of the \
         truth as S has would get in truth to S.\n",
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
        assert_eq!(
            (cell(1, "ratio"), cell(1, "better"), cell(4, "ratio"), cell(4, "better")),
            ("", "", "", "")
        );
        near(cell(2, "ratio"), 2.5);
        assert_eq!(cell(2, "better"), "0/1");
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

        let latex = texts.latex.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(latex.contains("\\begin{tabular}{lrrrrrrrrrrrrrrrr}"), "{latex}");
        assert!(
            latex.contains("k\\_8 (= default) & 0.1550 & ")
                && latex.contains("95 \\% & ratio & better & 100 CD\\_L2 &")
        );
        assert!(latex.contains("a\\_1 & 0.110 & - & 0.110 & - \\\\"), "{latex}");
        assert!(!texts.markdown.contains("| mean code |"));

        // What is known of S stands in a table of its own.
        let job = &plan.jobs[0];
        let known = Cover { distinct: Some(0.5), truth_to_s: Some(0.033), ..Cover::default() };
        records.get_mut(&job.fingerprint).unwrap().cover = known;
        let covered = write(Results { plan: &plan, records: &records }, "x", false);
        assert!(covered.markdown.contains("| mean code |"), "{}", covered.markdown);
        assert!(covered.markdown.contains(&screen(Results { plan: &plan, records: &records }, false)));
        let rows: Vec<Vec<&str>> = covered.surface_csv.lines().map(|l| l.split(',').collect()).collect();
        let column = |name: &str| rows[0].iter().position(|h| *h == name).unwrap();
        assert_eq!((rows.len(), rows[1][0], rows[1][column("distinct")]), (5, "default", "0.5"));
        near(rows[1][column("10 truth to S")], 0.33);
        assert_eq!((rows[1][column("even")], rows[2][column("distinct")]), ("", ""));
        let without = write(Results { plan: &plan, records: &records }, "x", false);
        assert!(!without.csv.contains("paper") && !without.markdown.contains("paper"));
        std::fs::remove_dir_all(dir).unwrap();
    }
}
