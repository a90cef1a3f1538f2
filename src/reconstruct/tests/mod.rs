//! Tests of the whole training, and the small point sets and options that they share.

pub(super) mod ablations;
mod anisotropy;
mod coordinates;
mod gradients;
mod recovery;
mod run;
mod shapes;
mod sides;
mod trace;

use super::*;
use crate::field::FieldActivation;
use crate::geometry::AnalyticShape;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

/// A configuration that runs in well under a second.
pub(in crate::reconstruct) fn tiny() -> Config {
    let mut config = Config::preset(Preset::Default);
    config.field.width = 16;
    config.field.depth = 2;
    config.field.octaves = 1;
    config.field.activation = FieldActivation::Softplus { beta: 20.0 };
    config.bsp.channels = 8;
    config.bsp.heads = 2;
    config.bsp.patch = 4;
    config.bsp.reach = Some(5);
    config.bsp_pretrain = 5;
    // S changes in every second of the few steps, and the weight of L_deform falls.
    (config.bsp_every, config.weights.deform_decay) = (Some(2), 0.04);
    // One width, so that the states these tests look at do not change with the choice among several.
    (config.start.dipole_radius, config.start.regularity) = (Some(0.5), 0.05);
    config.start.steps = 30;
    config.stages = vec![Stage { resolution: 8, steps: 6 }, Stage { resolution: 12, steps: 6 }];
    // The states and losses that tests look at are those of a grid that stays; its shift has a test of its own.
    config.band.shift = 0.0;
    // The grids that the stages say, whatever the area.
    (config.surface_samples, config.reference_area) = (None, None);
    config
}

/// A sphere that is not centred, so that frames matter.
pub(in crate::reconstruct) fn ball(n: usize) -> Vec<[f32; 3]> {
    let points = AnalyticShape::Sphere { radius: 3.0 }.sample(n, 5).0;
    points.into_iter().map(|p| [p[0] + 10.0, p[1] - 4.0, p[2]]).collect()
}

/// A ball whose points scatter, with options for which its noise is taken off and its area changes the grid.
pub(in crate::reconstruct) fn noisy(n: usize) -> (Vec<[f32; 3]>, Config) {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut shift = || -> f32 { rng.random_range(-0.2..0.2) };
    let points = ball(n).into_iter().map(|p| p.map(|x| x + shift())).collect();
    let mut config = tiny();
    (config.start.dipole_radius, config.reference_area) = (None, Some(20.0));
    (points, config)
}

pub(in crate::reconstruct) fn run(points: &[[f32; 3]], config: &Config) -> Reconstruction {
    reconstruct(points, config).unwrap()
}

pub(in crate::reconstruct) fn bits(result: &Reconstruction) -> (Vec<u64>, Vec<[u32; 3]>, Vec<u64>) {
    let mesh = result.mesh(20).unwrap();
    let bits = |points: &[[f64; 3]]| points.as_flattened().iter().map(|x| x.to_bits()).collect();
    (bits(&mesh.verts), mesh.faces, bits(&result.surface_points()))
}

/// A trainer at the first step of the training proper.
pub(in crate::reconstruct) fn at_training(points: &[[f32; 3]], config: &Config) -> Trainer {
    let mut trainer = Trainer::new(points, config).unwrap();
    while trainer.phase() != Phase::Train {
        trainer.step().unwrap();
    }
    phases::train::begin(&trainer.setup, &mut trainer.state).unwrap();
    trainer
}

/// Small but enough for simple shapes.
pub(in crate::reconstruct) fn quick() -> Config {
    let mut config = Config::preset(Preset::Default);
    config.field.width = 32;
    config.field.depth = 3;
    config.field.octaves = 2;
    config.bsp.channels = 16;
    config.bsp.heads = 2;
    config.bsp.patch = 6;
    config.bsp_pretrain = 30;
    config.start.steps = 200;
    config.stages = vec![Stage { resolution: 20, steps: 60 }];
    config
}

/// Makes the field or the parameterization useless.
pub(in crate::reconstruct) fn poison(trainer: &mut Trainer, map: bool, value: f32) {
    let params = match &mut trainer.state.map {
        Some(m) if map => m.params_mut(),
        _ => trainer.state.field.params_mut(),
    };
    let last = params.values_mut().last_mut().unwrap();
    std::sync::Arc::make_mut(last).data_mut()[0] = value;
}
