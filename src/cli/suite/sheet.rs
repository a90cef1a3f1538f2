//! All results of a setting in one picture: input, S, result and truth of each shape side by side, the worst first.

use std::path::Path;

use bijective_sdf::geometry::TriangleMesh;
use bijective_sdf::io::{read_cloud, read_mesh};
use rayon::prelude::*;

use super::super::failure::Failure;
use super::super::input::Content;
use super::super::preview::{Image, Scene, View};
use super::plan::Job;
use super::record::Record;
use super::work::{Truth, points_of};

/// Width of the picture, about.
const WIDTH: usize = 2640;
/// Width over height that the picture comes near to.
const ASPECT: f64 = 1.2;
/// Columns beyond which labels would not fit.
const MAX_COLUMNS: usize = 4;
/// The number of pictures of a shape: input, S, result and truth.
const PANELS: usize = 4;
/// The most pixels a side of one picture of a shape.
const MAX_PANEL: usize = 360;
/// Pixels between shapes.
const GAP: usize = 8;
/// Pixels of a dot of a letter.
const DOT: usize = 2;
/// Pixels for the two lines below each shape.
const LABEL: usize = 2 * LINE + 4;
/// Pixels for the two lines above all shapes.
const TITLE: usize = 2 * LINE + 2 * GAP;
/// Pixels from a line of text to the next.
const LINE: usize = 9 * DOT + 2;

const WHITE: [u8; 3] = [255; 3];
const INK: [u8; 3] = [30, 36, 46];
const GREY: [u8; 3] = [112, 120, 132];
const RED: [u8; 3] = [208, 32, 32];
const PALE_RED: [u8; 3] = [253, 228, 226];
const LINE_GREY: [u8; 3] = [206, 212, 220];

/// A shape and what became of it.
pub struct Entry<'a> {
    /// Its run.
    pub job: &'a Job<'a>,
    /// The run's record.
    pub record: &'a Record,
}

/// How the shapes are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    columns: usize,
    rows: usize,
    /// Pixels a side of one of the pictures of a shape.
    panel: usize,
}

impl Layout {
    /// As many columns as make the picture most like a screen.
    fn of(shapes: usize) -> Layout {
        let shapes = shapes.max(1);
        let layout = |columns: usize| {
            let panel = (((WIDTH - GAP) / columns - GAP) / PANELS).min(MAX_PANEL);
            Layout { columns, rows: shapes.div_ceil(columns), panel }
        };
        let off = |l: &Layout| {
            let [width, height] = l.size();
            ((width as f64 / height as f64) / ASPECT).ln().abs()
        };
        let all = (1..=shapes.min(MAX_COLUMNS)).map(layout);
        all.min_by(|a, b| off(a).total_cmp(&off(b))).expect("one column at least")
    }

    /// Width and height of a shape with its label.
    fn cell(&self) -> [usize; 2] {
        [PANELS * self.panel, self.panel + LABEL]
    }

    /// Width and height of the whole.
    fn size(&self) -> [usize; 2] {
        let [width, height] = self.cell();
        [GAP + self.columns * (width + GAP), TITLE + self.rows * (height + GAP)]
    }

    /// Where a shape begins: row by row.
    fn at(&self, i: usize) -> [usize; 2] {
        let [width, height] = self.cell();
        [GAP + i % self.columns * (width + GAP), TITLE + i / self.columns * (height + GAP)]
    }
}

/// Draws a setting's shapes, the worst first, below two lines of text; `out` is the directory of the results.
pub fn draw(titles: &[String; 2], entries: &[Entry<'_>], view: &View, out: &Path) -> Image {
    let mut sorted: Vec<&Entry<'_>> = entries.iter().collect();
    // Failed runs have no figure and are worst of all.
    let worth = |e: &Entry<'_>| (e.record.failure.is_some(), e.record.cd().unwrap_or(0.0));
    sorted.sort_by(|a, b| {
        let (a, b) = (worth(a), worth(b));
        b.0.cmp(&a.0).then(b.1.total_cmp(&a.1))
    });
    let layout = Layout::of(sorted.len());
    let [width, height] = layout.size();
    let mut image = Image::plain(width, height, WHITE);
    for (i, title) in titles.iter().enumerate() {
        image.text(&shortened(title, width - 2 * GAP), [GAP, GAP + i * LINE], DOT, INK);
    }
    let cells: Vec<Image> = sorted.par_iter().map(|entry| cell(entry, layout, view, out)).collect();
    for (i, cell) in cells.iter().enumerate() {
        let [x, y] = layout.at(i);
        image.paste(cell, x, y);
    }
    image
}

/// Four pictures and two lines of text.
fn cell(entry: &Entry<'_>, layout: Layout, view: &View, out: &Path) -> Image {
    let [width, height] = layout.cell();
    let bad = entry.record.is_bad();
    let mut image = Image::plain(width, height, if bad { PALE_RED } else { WHITE });
    match panels(entry, layout.panel, view, out) {
        Ok(panels) => {
            for (i, panel) in panels.iter().enumerate() {
                match panel {
                    Some(panel) => image.paste(panel, i * layout.panel, 0),
                    None => {
                        let x = i * layout.panel + layout.panel / 2 - 2 * 6 * DOT;
                        image.text("none", [x, layout.panel / 2], DOT, GREY);
                    }
                }
            }
        }
        // A file that went away after its run costs one place of the picture only.
        Err(failure) => {
            let text = failure.line().unwrap_or_default();
            image.text(&shortened(&text, width), [GAP, layout.panel / 2], DOT, RED);
        }
    }
    for i in 1..PANELS {
        image.fill([i * layout.panel, 0], [1, layout.panel], LINE_GREY);
    }
    let [first, second] = label(entry);
    let y = layout.panel + 4;
    image.text(&shortened(&first, width - GAP), [GAP / 2 + 2, y], DOT, if bad { RED } else { INK });
    image.text(&shortened(&second, width - GAP), [GAP / 2 + 2, y + LINE], DOT, GREY);
    let (line, colour) = if bad { (4, RED) } else { (1, LINE_GREY) };
    image.frame([0, 0], [width, height], line, colour);
    image
}

fn shortened(text: &str, width: usize) -> String {
    let most = width / (6 * DOT);
    if text.chars().count() <= most {
        return text.to_string();
    }
    text.chars().take(most.saturating_sub(2)).chain("..".chars()).collect()
}

/// Name and figures; what is wrong comes before what is not.
fn label(entry: &Entry<'_>) -> [String; 2] {
    let record = entry.record;
    let first = match record.cd() {
        Some(cd) => {
            let c = &record.cover;
            let covered = c.truth_to_s.zip(c.truth_to_q);
            let s = covered.map_or(String::new(), |(s, q)| format!("  S {:.3}/{:.3}", 10.0 * s, 10.0 * q));
            format!("{}  {cd:.4}{s}", entry.job.shape.name)
        }
        None => entry.job.shape.name.clone(),
    };
    if let Some(failure) = &record.failure {
        return [first, failure.text.clone()];
    }
    let mut parts = Vec::new();
    if let Some(figures) = record.figures {
        parts.extend(figures.nc.map(|nc| format!("NC {nc:.3}")));
        parts.push(format!("HD {:.3}", figures.hd));
    }
    if let Some(result) = record.result {
        let genus = |g: Option<i64>| g.map_or("?".to_string(), |g| g.to_string());
        let of = |text: Option<String>| text.map_or(String::new(), |t| format!("/{t}"));
        let parts_of = of(record.truth.map(|t| t.components.to_string()));
        parts.push(format!("parts {}{parts_of}", result.components));
        parts.push(format!("genus {}{}", genus(result.genus), of(record.truth.map(|t| genus(t.genus)))));
        if !record.is_closed() {
            parts.push("OPEN".to_string());
        }
    }
    [first, parts.join(" ")]
}

/// Input, S, result and truth, each if there is one, from the same place.
fn panels(
    entry: &Entry<'_>,
    panel: usize,
    view: &View,
    out: &Path,
) -> Result<[Option<Image>; PANELS], Failure> {
    let truth = entry.job.shape.truth.as_ref().map(|t| Truth::read(&t.1)).transpose()?;
    let points = points_of(entry.job, truth.as_ref())?;
    let result: Option<TriangleMesh<[f64; 3]>> = match &entry.record.mesh {
        Some(file) => Some(read_mesh(out.join(file)).map_err(Failure::Input)?),
        None => None,
    };
    let surface = match &entry.record.surface {
        Some(file) => Some(read_cloud(out.join(file)).map_err(Failure::Input)?.points),
        None => None,
    };
    let mut extent = points.clone();
    match truth.as_ref().map(|t| &t.content) {
        Some(Content::Mesh(mesh)) => extent.extend_from_slice(&mesh.verts),
        Some(Content::Cloud(cloud)) => extent.extend_from_slice(&cloud.points),
        // Without a truth the result has to fit; with one, what sticks out is cut off.
        None => extent.extend(result.iter().flat_map(|mesh| &mesh.verts)),
    }
    let scene = Scene::around(&extent, view, panel)?;
    Ok([
        Some(scene.points(&points)),
        surface.map(|surface| scene.points(&surface)),
        result.map(|mesh| scene.mesh(&mesh)),
        truth.map(|t| match &t.content {
            Content::Mesh(mesh) => scene.mesh(mesh),
            Content::Cloud(cloud) => scene.points(&cloud.points),
        }),
    ])
}

#[cfg(test)]
mod tests {
    use super::super::inputs::ShapeFiles;
    use super::super::plan::tests::setting;
    use super::super::record::{Form, RunFailure};
    use super::super::results::tests::{WHOLE, record};
    use super::*;

    #[test]
    fn shapes_fill_a_screen_and_do_not_overlap() {
        for shapes in 1..200 {
            let l = Layout::of(shapes);
            let [width, height] = l.size();
            assert!(l.columns * l.rows >= shapes && width <= WIDTH, "{shapes}: {l:?}");
            let [w, h] = l.cell();
            for i in 0..shapes {
                let [x, y] = l.at(i);
                assert!(x + w + GAP <= width && y + h + GAP <= height);
            }
        }
        let l = Layout::of(30);
        let [width, height] = l.size();
        assert!(width > 2500 && (1650..1900).contains(&height), "{l:?} {width} {height}");
    }

    #[test]
    fn labels_tell_what_is_wrong() {
        let shape = ShapeFiles { name: "a_300".into(), cloud: "a".into(), truth: None };
        let setting = setting("default");
        let job = Job { shape: &shape, setting: &setting, seed: 0, fingerprint: String::new() };
        let of = |record: &Record| label(&Entry { job: &job, record });
        let open = Form { components: 2, genus: None, closed: false, ..WHOLE };
        let text = of(&record(0.01234, open, WHOLE));
        assert_eq!(text, ["a_300  0.1234", "NC 0.900 HD 0.050 parts 2/1 genus ?/0 OPEN"]);
        let mut covered = record(0.01234, open, WHOLE);
        (covered.cover.truth_to_s, covered.cover.truth_to_q) = (Some(0.0331), Some(0.0370));
        assert_eq!(of(&covered)[0], "a_300  0.1234  S 0.331/0.370");
        let mut lone = record(0.0, WHOLE, WHOLE);
        (lone.figures, lone.truth) = (None, None);
        assert_eq!(of(&lone), ["a_300", "parts 1 genus 0"]);
        lone.failure = Some(RunFailure { text: "no surface".into(), exit_code: 1 });
        assert_eq!(of(&lone), ["a_300", "no surface"]);
        assert_eq!(shortened("abcdefgh", 6 * DOT * 5), "abc..");
        assert_eq!(shortened("abcde", 6 * DOT * 5), "abcde");
    }
}
