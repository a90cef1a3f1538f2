//! `evaluate --points`: how near points are to ground truths, and how well they cover them.

use std::path::PathBuf;

use bijective_sdf::evaluate::{Cell, CompareOptions, PointsReport, TextTable, evaluate_points};
use bijective_sdf::geometry::relative_to;

use super::Common;
use super::console::{print, say_all_but_last};
use super::failure::Failure;
use super::input::Input;
use super::json::Object;
use super::paths::name;

/// How to print.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    Text,
    Json,
    Csv,
    Markdown,
    Latex,
}

/// Compares pairs of a ground truth and points.
pub fn run(pairs: &[PathBuf], options: &CompareOptions, style: Style, common: Common) -> Result<(), Failure> {
    let compared: Vec<(String, Result<PointsReport, Failure>)> =
        pairs.chunks_exact(2).map(|files| (name(&files[1]), compare(files, options, common))).collect();
    if style == Style::Json {
        let line = |(name, outcome): &(String, Result<PointsReport, Failure>)| {
            let json = Object::new().text("name", name);
            let json = match outcome {
                Ok(r) => json
                    .count("points", r.points)
                    .count("distinct", r.distinct)
                    .number("to_truth", r.to_gt)
                    .number("truth_to_it", r.from_gt)
                    .number("floor", r.floor)
                    .number("scale", r.scale)
                    .count("gt_samples", r.gt_samples),
                Err(failure) => json.text("error", &failure.line().unwrap_or_default()),
            };
            json.finish() + "\n"
        };
        print(compared.iter().map(line).collect::<String>())?;
    } else {
        let head = ["name", "points", "distinct", "10 to truth", "10 truth to it", "10 floor"];
        // No mean and median: the rows may be clouds and denser points of the same shapes.
        let mut table = TextTable::new(head.map(Cell::text));
        for (name, outcome) in &compared {
            let report = outcome.as_ref().ok();
            let counts = [report.map(|r| r.points), report.map(|r| r.distinct)];
            let counts = counts.map(|n| Cell::figure(n.map(|n| n as f64), 0));
            let lengths = [report.map(|r| r.to_gt), report.map(|r| r.from_gt), report.and_then(|r| r.floor)];
            let lengths = lengths.map(|x| Cell::figure(x.map(|x| 10.0 * x), 4));
            table.push([Cell::text(name.as_str())].into_iter().chain(counts).chain(lengths));
        }
        print(match style {
            Style::Csv => table.to_csv(),
            Style::Markdown => table.to_markdown(),
            Style::Latex => table.to_latex(),
            Style::Text | Style::Json => table.to_text(),
        })?;
    }
    let failed = compared.into_iter().filter_map(|(_, outcome)| outcome.err()).collect();
    say_all_but_last(failed).map_or(Ok(()), Err)
}

fn compare(files: &[PathBuf], options: &CompareOptions, common: Common) -> Result<PointsReport, Failure> {
    let truth = Input::read(&files[0], None)?.content()?;
    let cloud = Input::read(&files[1], None)?.cloud()?;
    common.tell(&cloud.warnings, &[]);
    let offset = truth.offset();
    let points = relative_to(&cloud.points, offset);
    Ok(evaluate_points(truth.relative_to(offset).ground_truth(), &[&points], options)?[0])
}
