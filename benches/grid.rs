//! The grid: active vertices, their topology, and the extraction of an analytic torus.

mod common;

use bijective_sdf::geometry::{
    AnalyticShape, Isosurface, NarrowBandOptions, TetGrid, active_set, extract_mesh,
};
use criterion::{Criterion, criterion_group};

const TORUS: AnalyticShape = AnalyticShape::Torus { major: 0.36, minor: 0.14 };

fn grid(resolution: usize) -> TetGrid {
    TetGrid::covering([-0.58; 3], [0.58; 3], resolution, 1).expect("a box")
}

fn eval(x: &[[f32; 3]]) -> Result<Vec<f32>, bijective_sdf::Error> {
    Ok(x.iter().map(|&x| TORUS.sdf(x)).collect())
}

fn active(c: &mut Criterion) {
    for resolution in [32, 64] {
        let grid = grid(resolution);
        c.bench_function(&format!("active set {resolution}"), |bench| {
            bench.iter(|| active_set(&grid, &mut eval, &NarrowBandOptions::default(), 1).expect("a torus"));
        });
        let set = active_set(&grid, &mut eval, &NarrowBandOptions::default(), 1).expect("a torus");
        c.bench_function(&format!("band topology {resolution}"), |bench| bench.iter(|| set.topology()));
        let (topology, mut iso) = (set.topology(), Isosurface::default());
        let inside: Vec<bool> = set.values.iter().map(|&v| v < 0.0).collect();
        c.bench_function(&format!("march {resolution}"), |bench| {
            bench.iter(|| topology.march_into(&inside, &mut iso));
        });
    }
}

fn extraction(c: &mut Criterion) {
    for resolution in [64, 128, 256] {
        let grid = grid(resolution);
        c.bench_function(&format!("extract {resolution}"), |bench| {
            bench.iter(|| extract_mesh(&grid, &mut eval, &NarrowBandOptions::default()).expect("a torus"));
        });
    }
    let mesh = extract_mesh(&grid(128), &mut eval, &NarrowBandOptions::default()).expect("a torus");
    c.bench_function("mesh topology 128", |bench| bench.iter(|| mesh.topology()));
}

criterion_group! { name = benches; config = common::criterion(); targets = active, extraction }

fn main() {
    common::in_pool(benches);
}
