//! The start of a run, whole training steps of the presets at 300 points, and the mesh of a trained field.

mod common;

use bijective_sdf::geometry::AnalyticShape;
use bijective_sdf::reconstruct::{Config, Phase, Preset, Stage, Trainer};
use criterion::{Criterion, criterion_group};

const TORUS: AnalyticShape = AnalyticShape::Torus { major: 0.36, minor: 0.14 };

/// Shortens the phases before the training proper; they are not what is measured.
fn hurry(config: &mut Config) {
    config.start.steps = config.start.steps.min(100);
    config.bsp_pretrain = config.bsp_pretrain.min(10);
}

/// A step in the last stage of a preset that trains; every few steps it searches for the active cubes, as in a run.
fn steps(c: &mut Criterion) {
    let (points, _) = TORUS.sample(300, 1);
    for preset in Preset::ALL {
        let mut config = Config::preset(preset);
        let Some(&Stage { resolution, .. }) = config.stages.last() else { continue };
        // More steps than the benchmark can make.
        config.stages = vec![Stage { resolution, steps: 1_000_000 }];
        hurry(&mut config);
        let mut trainer = Trainer::new(&points, &config).expect("a torus");
        while trainer.phase() != Phase::Train {
            trainer.step().expect("a torus stays");
        }
        c.bench_function(&format!("step {preset}"), |bench| {
            bench.iter(|| trainer.step().expect("a torus stays"));
        });
    }
}

/// What comes before the first step.
fn start(c: &mut Criterion) {
    for n in [300, 2000] {
        let (points, _) = TORUS.sample(n, 1);
        let mut config = Config::preset(Preset::Default);
        config.train_up_to = None;
        c.bench_function(&format!("start {n}"), |bench| {
            bench.iter(|| Trainer::new(&points, &config).expect("a torus"));
        });
    }
}

fn mesh(c: &mut Criterion) {
    let (points, _) = TORUS.sample(300, 1);
    let mut config = Config::preset(Preset::Fast);
    config.stages.iter_mut().for_each(|s| s.steps = 20);
    hurry(&mut config);
    let mut trainer = Trainer::new(&points, &config).expect("a torus");
    while !trainer.is_done() {
        trainer.step().expect("a torus stays");
    }
    let result = trainer.finish();
    for resolution in [64, 128] {
        c.bench_function(&format!("mesh {resolution}"), |bench| {
            bench.iter(|| result.mesh(resolution).expect("a torus"));
        });
    }
}

criterion_group! { name = benches; config = common::criterion(); targets = start, steps, mesh }

fn main() {
    common::in_pool(benches);
}
