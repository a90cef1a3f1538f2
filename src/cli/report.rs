//! Facts and figures as text and JSON, and the quality gate.

use bijective_sdf::evaluate::{Column, Metrics, Report, Table};
use bijective_sdf::geometry::{Topology, format_shortest, format_significant};

use super::failure::Failure;
use super::json::{Object, list, number};

/// Whether a mesh is closed and oriented, which every result that was not trimmed must be (exit code 4 otherwise).
pub fn passes_gate(t: &Topology) -> bool {
    t.closed && t.oriented
}

/// The failure to return after a mesh that was trimmed is written, if its faces do not go together; it may be open.
pub fn gate_open(t: &Topology) -> Result<(), Failure> {
    if t.oriented && t.nonmanifold_edges == 0 {
        return Ok(());
    }
    let oriented = if t.oriented { "" } else { "not " };
    Err(Failure::Gate(format!(
        "the trimmed mesh is {oriented}oriented and has {} non-manifold edges",
        t.nonmanifold_edges
    )))
}

/// The failure to return after everything is written, if the gate is not passed.
pub fn gate(t: &Topology) -> Result<(), Failure> {
    if passes_gate(t) {
        return Ok(());
    }
    Err(Failure::Gate(format!(
        "the mesh is {}closed and {}oriented ({} boundary edges, {} non-manifold edges)",
        if t.closed { "" } else { "not " },
        if t.oriented { "" } else { "not " },
        t.boundary_edges,
        t.nonmanifold_edges
    )))
}

/// The topology as a JSON object.
pub fn topology_json(t: &Topology) -> String {
    let corner = |c: [f64; 3]| list(c.map(|x| number(Some(x))));
    let json = Object::new()
        .count("verts", t.verts)
        .count("unused_verts", t.unused_verts)
        .count("edges", t.edges)
        .count("faces", t.faces)
        .count("boundary_edges", t.boundary_edges)
        .count("boundary_loops", t.boundary_loops)
        .count("nonmanifold_edges", t.nonmanifold_edges)
        .count("degenerate_faces", t.degenerate_faces)
        .count("components", t.components)
        .raw("euler", t.euler)
        .raw("genus", t.genus.map_or("null".to_string(), |g| g.to_string()))
        .flag("closed", t.closed)
        .flag("oriented", t.oriented)
        .number("volume", t.volume)
        .number("area", t.area);
    match t.bounds {
        Some(b) => json.raw("bounds", list(b.map(corner))),
        None => json.raw("bounds", "null"),
    }
    .finish()
}

/// The topology in a few lines of text.
pub fn topology_text(t: &Topology) -> String {
    let yes = |b: bool| if b { "yes" } else { "no" };
    let genus = t.genus.map_or("unknown".to_string(), |g| g.to_string());
    let mut text = format!(
        "vertices    {}\nfaces       {}\nedges       {}\ncomponents  {}\nEuler       {}\ngenus       {genus}\n\
         closed      {}\noriented    {}\nvolume      {}\narea        {}\n",
        t.verts,
        t.faces,
        t.edges,
        t.components,
        t.euler,
        yes(t.closed),
        yes(t.oriented),
        format_significant(t.volume),
        format_significant(t.area)
    );
    if t.boundary_edges > 0 {
        let plural = if t.boundary_loops == 1 { "" } else { "s" };
        text += &format!(
            "            {} boundary edges in {} loop{plural}\n",
            t.boundary_edges, t.boundary_loops
        );
    }
    for (count, what) in [
        (t.nonmanifold_edges, "non-manifold edges"),
        (t.degenerate_faces, "degenerate faces"),
        (t.unused_verts, "unused vertices"),
    ] {
        if count > 0 {
            text += &format!("            {count} {what}\n");
        }
    }
    if let Some([low, high]) = t.bounds {
        text += &bounds_text(low, high);
    }
    text
}

/// An offset in words.
pub fn offset_text(offset: [f64; 3]) -> String {
    format!("({})", offset.map(format_shortest).join(", "))
}

/// Two corners of a box in text.
pub fn bounds_text(low: [f64; 3], high: [f64; 3]) -> String {
    format!(
        "from        {}\nto          {}\n",
        low.map(format_shortest).join(" "),
        high.map(format_shortest).join(" ")
    )
}

/// The key of a figure and the figure.
type Figure = (&'static str, fn(&Metrics) -> Option<f64>);

/// What JSON says of two surfaces, in units of the frame.
const FIGURES: [Figure; 9] = [
    ("cd_l1", |m| Some(m.cd_l1())),
    ("cd_l2", |m| Some(m.cd_l2())),
    ("acc", |m| Some(m.acc())),
    ("comp", |m| Some(m.comp())),
    ("nc", Metrics::nc),
    ("nc_ntps", Metrics::nc_ntps),
    ("hd", |m| Some(m.hd())),
    ("hd_acc", |m| Some(m.to_gt.max)),
    ("hd_comp", |m| Some(m.to_pred.max)),
];

/// The F-scores in a summary: half, once and twice the threshold.
const SCORES: [&str; 3] = ["fscore_half", "fscore", "fscore_twice"];

/// A report as a JSON object.
pub fn report_json(name: &str, r: &Report) -> String {
    let part = |m: &Option<Metrics>| m.as_ref().map_or("null".to_string(), metrics_json);
    Object::new()
        .text("name", name)
        .raw("metrics", metrics_json(&r.metrics))
        .raw("floor", part(&r.floor))
        .raw("surface", part(&r.surface))
        .raw("scan", part(&r.scan))
        .number("scale", r.scale)
        .count("gt_samples", r.gt_samples)
        .count("pred_samples", r.pred_samples)
        .finish()
}

fn metrics_json(m: &Metrics) -> String {
    let scores = m.fscores().map(|f| {
        Object::new()
            .number("tau", f.tau)
            .number("f", f.f)
            .number("precision", f.precision)
            .number("recall", f.recall)
            .finish()
    });
    FIGURES
        .iter()
        .fold(Object::new(), |json, (key, value)| json.number(key, value(m)))
        .raw("fscores", list(scores))
        .finish()
}

/// Mean, median and percentiles over many reports of what [`report_json`] says of one, as a JSON object.
pub fn summary_json(reports: &[&Report]) -> String {
    let part = |metrics: &dyn Fn(&Report) -> Option<Metrics>| {
        let mut table = Table::new(FIGURES.iter().map(|f| f.0).chain(SCORES));
        for m in reports.iter().filter_map(|r| metrics(r)) {
            let scores = m.fscores().map(|f| Some(f.f));
            table.push("", FIGURES.iter().map(|f| f.1(&m)).chain(scores).collect());
        }
        if table.rows().is_empty() { "null".to_string() } else { table_json(&table) }
    };
    Object::new()
        .raw("metrics", part(&|r| Some(r.metrics)))
        .raw("floor", part(&|r| r.floor))
        .raw("surface", part(&|r| r.surface))
        .raw("scan", part(&|r| r.scan))
        .finish()
}

/// The summary of a table as a JSON object with a member for each column.
pub fn table_json(table: &Table) -> String {
    let rows = table.summary();
    (0..table.columns().len())
        .fold(Object::new(), |json, c| {
            let of = |name: &str| rows.iter().find(|r| r.0 == name).and_then(|r| r.1[c]);
            // Both names of one number, as readers of the JSON may look for either.
            let column =
                [("mean", "mean"), ("median", "median"), ("p5", "5 %"), ("p50", "median"), ("p95", "95 %")]
                    .into_iter()
                    .fold(Object::new(), |json, (key, name)| json.number(key, of(name)))
                    .count("count", of("count").unwrap_or(0.0) as usize);
            json.raw(&table.columns()[c], column.finish())
        })
        .finish()
}

/// What the tables of a protocol print, as a JSON object.
pub fn published_json(columns: &[Column], r: &Report) -> String {
    columns.iter().fold(Object::new(), |json, c| json.number(c.name, c.value(r))).finish()
}

/// What the tables of a protocol print, in words.
pub fn published_text(columns: &[Column], r: &Report) -> String {
    let line = |c: &Column| {
        let value = c.value(r).map_or("-".to_string(), |v| format!("{v:.5}"));
        format!("{:26}{value:>14}  {}\n", c.name, c.unit)
    };
    columns.iter().map(line).collect()
}

/// A report as a table: prediction, sampling floor, distances to the true triangles and to the scan side by side.
pub fn report_text(r: &Report, ntps: bool) -> String {
    let columns: Vec<(&str, Metrics)> = [
        ("measured", Some(r.metrics)),
        ("floor", r.floor),
        ("to triangles", r.surface),
        ("to the scan", r.scan),
    ]
    .into_iter()
    .filter_map(|(name, m)| m.map(|m| (name, m)))
    .collect();
    type Row = (String, fn(&Metrics) -> Option<f64>);
    let tau = r.metrics.tau;
    let mut rows: Vec<Row> = vec![
        ("CD L1 x 10".into(), |m| Some(10.0 * m.cd_l1())),
        ("CD L2 x 100".into(), |m| Some(100.0 * m.cd_l2())),
        ("accuracy x 10".into(), |m| Some(10.0 * m.acc())),
        ("completeness x 10".into(), |m| Some(10.0 * m.comp())),
        ("normal consistency".into(), Metrics::nc),
        ("Hausdorff".into(), |m| Some(m.hd())),
        (format!("F-score at {tau}"), |m| Some(m.fscore().f)),
        (format!("F-score at {}", 0.5 * tau), |m| Some(m.fscores()[0].f)),
        (format!("F-score at {}", 2.0 * tau), |m| Some(m.fscores()[2].f)),
        (format!("precision at {tau}"), |m| Some(m.fscore().precision)),
        (format!("recall at {tau}"), |m| Some(m.fscore().recall)),
    ];
    if ntps {
        rows.push(("normal consistency (ntps)".into(), Metrics::nc_ntps));
    }
    let mut text = format!("{:26}", "");
    for (name, _) in &columns {
        text += &format!("{name:>14}");
    }
    text.push('\n');
    for (name, value) in rows {
        text += &format!("{name:26}");
        for (_, m) in &columns {
            text += &match value(m) {
                Some(v) => format!("{v:>14.5}"),
                None => format!("{:>14}", "-"),
            };
        }
        text.push('\n');
    }
    text
}
