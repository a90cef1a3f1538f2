//! How time and memory grow: a run of a few steps with the cloud, and the extraction of a surface with the grid.
//!
//! `cargo bench --bench growth`. One run each, not a statistic. The options stay those of 300 points, so what grows is
//! the cloud alone; the rule that adapts them is `Config::for_points`. The exponents are the slopes of straight lines
//! through the logarithms of the last four rows; where the rows before are flat, other costs outweigh what grows. A
//! peak counts memory that rows before it gave back and the allocator still holds.

use bijective_sdf::geometry::{AnalyticShape, NarrowBandOptions, TetGrid, extract_mesh};
use bijective_sdf::reconstruct::{Config, Phase, Stage, Trainer};
use std::fs;
use std::time::Instant;

const TORUS: AnalyticShape = AnalyticShape::Torus { major: 0.36, minor: 0.14 };
/// Steps of each phase.
const STEPS: usize = 16;

/// The highest memory use since the last call, in MiB; 0 where the system does not say.
fn peak() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok());
    // Makes the present use the highest one.
    let _ = fs::write("/proc/self/clear_refs", "5");
    kib.unwrap_or_default() / 1024.0
}

/// The slope of a straight line through (ln x, ln y).
fn exponent(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let logs: Vec<(f64, f64)> = points.iter().map(|&(x, y)| (x.ln(), y.ln())).collect();
    let mean = |f: fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let along: f64 = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    along / logs.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
}

/// Prints the exponents of the columns of a table, by its first one.
fn fit(rows: &[Vec<f64>]) {
    let last = &rows[rows.len() - 4..];
    let column = |j: usize| last.iter().map(|row| (row[0], row[j])).collect::<Vec<_>>();
    let exponents: Vec<String> =
        (1..rows[0].len()).map(|j| format!("{:>12.2}", exponent(&column(j)))).collect();
    println!("{:>8}{}", "exponent", exponents.concat());
}

fn print(row: &[f64], digits: usize) {
    let cells: Vec<String> = row[1..].iter().map(|x| format!("{x:>12.digits$}")).collect();
    println!("{:>8}{}", row[0], cells.concat());
}

fn clouds() {
    println!("milliseconds: shape = finding the first shape, the others a step of each phase; peak in MiB");
    println!("  points       shape       start    pretrain       train        peak");
    let mut rows = Vec::new();
    for n in [300, 1_000, 3_000, 10_000, 30_000, 100_000] {
        let (points, _) = TORUS.sample(n, 1);
        let mut config = Config::default();
        config.scale_with_points = false;
        (config.start.steps, config.bsp_pretrain) = (STEPS, STEPS);
        // All points count, as if the grid were fine enough for them.
        config.batch.thin = None;
        config.stages = vec![Stage { resolution: 32, steps: STEPS }];
        peak();
        let began = Instant::now();
        let mut trainer = Trainer::new(&points, &config).expect("a torus");
        let mut row = vec![n as f64, began.elapsed().as_secs_f64() * 1e3];
        for phase in Phase::ALL {
            let began = Instant::now();
            while !trainer.is_done() && trainer.phase() == phase {
                trainer.step().expect("a torus stays");
            }
            row.push(began.elapsed().as_secs_f64() * 1e3 / STEPS as f64);
        }
        trainer.finish();
        row.push(peak());
        print(&row, 1);
        rows.push(row);
    }
    fit(&rows);
}

fn grids() {
    println!("\nmilliseconds, thousands of values asked for, thousands of faces; peak in MiB");
    println!("   cubes        time      values       faces        peak");
    let mut rows = Vec::new();
    for resolution in [64, 128, 256, 512] {
        let grid = TetGrid::covering([-0.58; 3], [0.58; 3], resolution, 1).expect("a box");
        let mut asked = 0;
        let mut eval = |x: &[[f32; 3]]| {
            asked += x.len();
            Ok(x.iter().map(|&x| TORUS.sdf(x)).collect())
        };
        peak();
        let began = Instant::now();
        let mesh = extract_mesh(&grid, &mut eval, &NarrowBandOptions::default()).expect("a torus");
        let time = began.elapsed().as_secs_f64() * 1e3;
        let row = vec![resolution as f64, time, asked as f64 / 1e3, mesh.faces.len() as f64 / 1e3, peak()];
        print(&row, 1);
        rows.push(row);
    }
    fit(&rows);
}

fn main() {
    // Options are for criterion, and what is left of them names other benchmarks.
    if std::env::args().skip(1).any(|arg| !arg.starts_with('-') && !"growth".contains(&arg)) {
        return;
    }
    rayon::scope(|_| {
        clouds();
        grids();
    });
}
