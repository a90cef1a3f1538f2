//! Tests of the whole training: gradients of a step, shapes, determinism, recovery, checkpoints.

use super::bridges::Bridges;
use super::*;
use crate::bsp::{Parameterization, SurfaceMap};
use crate::error::ErrorKind;
use crate::gdo::{Activation, Deformation};
use crate::geometry::Shape;
use crate::optim::gradient_norm;
use crate::tensor::Tensor;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::ops::ControlFlow;

/// A configuration that runs in well under a second.
pub(super) fn tiny() -> Config {
    let mut config = Config::preset(Preset::Default);
    config.field.width = 16;
    config.field.depth = 2;
    config.field.octaves = 1;
    config.field.activation = Activation::Softplus { beta: 20.0 };
    config.bsp.channels = 8;
    config.bsp.heads = 2;
    config.bsp.patch = 4;
    config.bsp.reach = 5;
    config.bsp_pretrain = 5;
    // One width, so that the states these tests look at do not change with the choice among several.
    (config.start.width, config.start.regularity) = (0.5, 0.05);
    config.start.steps = 30;
    config.stages = vec![Stage { resolution: 8, steps: 6 }, Stage { resolution: 12, steps: 6 }];
    // The grids that the stages say, whatever the area.
    (config.surface_samples, config.reference_area) = (0, 0.0);
    config
}

/// A sphere that is not centred, so that frames matter.
pub(super) fn ball(n: usize) -> Vec<[f32; 3]> {
    let points = Shape::Sphere { radius: 3.0 }.sample(n, 5).0;
    points.into_iter().map(|p| [p[0] + 10.0, p[1] - 4.0, p[2]]).collect()
}

/// A ball whose points scatter, with options for which that and its size change the cloud and the grid.
pub(super) fn noisy(n: usize) -> (Vec<[f32; 3]>, Config) {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut shift = || -> f32 { rng.random_range(-0.2..0.2) };
    let points = ball(n).into_iter().map(|p| p.map(|x| x + shift())).collect();
    let mut config = tiny();
    (config.start.width, config.reference_area) = (0.0, 20.0);
    (points, config)
}

pub(super) fn run(points: &[[f32; 3]], config: &Config) -> Reconstruction {
    reconstruct(points, config, &mut |_| ControlFlow::Continue(())).unwrap()
}

pub(super) fn bits(result: &Reconstruction) -> (Vec<u32>, Vec<[u32; 3]>, Vec<u32>) {
    let mesh = result.mesh(20).unwrap();
    let bits = |points: &[[f32; 3]]| points.as_flattened().iter().map(|x| x.to_bits()).collect();
    (bits(&mesh.verts), mesh.faces, bits(&result.surface_points()))
}

/// A trainer at the first step of the training proper.
pub(super) fn at_training(points: &[[f32; 3]], config: &Config) -> Trainer {
    let mut trainer = Trainer::new(points, config).unwrap();
    while trainer.phase() != Phase::Train {
        trainer.step().unwrap();
    }
    trainer.begin_training().unwrap();
    trainer
}

/// Every term, every part, live and smooth.
fn all_terms() -> Config {
    let mut config = tiny();
    config.weights = Weights {
        para: 2.0,
        deform: 1.0,
        deform_decay: 0.5,
        surf: 0.1,
        eikonal: 0.05,
        laplacian: 0.1,
        points: 0.1,
        pull: 0.3,
        cover: 1.0,
        bridge: 0.2,
    };
    config.start.steps = 100;
    config.band.rings = 1;
    config
}

/// The loss of the trainer's step with the topology of an earlier call of `march`.
fn loss_at(trainer: &mut Trainer) -> f64 {
    let view = trainer.view();
    let sampled = trainer.sample_field(&view).unwrap();
    let recorded = trainer.record(&sampled, &view).unwrap();
    f64::from(trainer.work.tape.value(recorded.loss).item())
}

/// A random direction of unit length.
fn direction(dims: &[usize], seed: u64) -> Tensor {
    let mut d = crate::ops::testing::normal(dims, seed);
    let length = d.data().iter().map(|x| x * x).sum::<f32>().sqrt();
    d.data_mut().iter_mut().for_each(|x| *x /= length);
    d
}

/// Moves one parameter of the field (or of the map) along a direction.
fn nudge(trainer: &mut Trainer, map: bool, index: usize, along: &Tensor, by: f32) {
    trainer.work.tape.clear();
    trainer.work.pass.release();
    let values = match &mut trainer.map {
        Some(m) if map => m.params_mut().values_mut(),
        _ => trainer.field.params_mut().values_mut(),
    };
    let value = std::sync::Arc::make_mut(&mut values[index]);
    value.data_mut().iter_mut().zip(along.data()).for_each(|(v, d)| *v += by * d);
}

/// Shifts the field so that no active vertex lies close to its zero level: a sign that switches is a kink, and near one
/// the crossing of an edge moves too fast for differences in f32.
fn clear_the_level(trainer: &mut Trainer) {
    let view = trainer.view();
    let sampled = trainer.sample_field(&view).unwrap();
    let mut values: Vec<f32> = sampled.values.sdf.data().iter().copied().filter(|s| s.abs() < 0.03).collect();
    values.sort_by(f32::total_cmp);
    let widest = values.windows(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0]))).unwrap();
    let shift = -0.5 * (widest[0] + widest[1]);
    let last = trainer.field.params().id("field.2.bias").unwrap();
    trainer.work.reset();
    trainer.field.params_mut().value_mut(last).data_mut()[0] += shift;
    trainer.build_band(8).unwrap();
}

/// Compares the gradients of a whole step with differences of its loss, for every parameter of the field and of Psi.
/// (Those of Phi also go straight through the choice of patches, which differences do not see; they are checked with
/// Phi.) Returns how many agreed and how many differences had not settled.
fn check_step(config: &Config, seed: u64) -> (usize, usize) {
    let points = Shape::Torus { major: 0.33, minor: 0.16 }.sample(40, seed).0;
    let config = Config { seed, ..config.clone() };
    let mut trainer = at_training(&points, &config);
    trainer.bridges = Bridges {
        points: vec![[0.31, 0.1, -0.2], [0.0, 0.4, 0.1], [0.0; 3]],
        depths: vec![0.3, 0.2, 0.1],
        looked: 0,
    };
    trainer.build_band(8).unwrap();
    clear_the_level(&mut trainer);
    let view = trainer.view();
    let sampled = trainer.sample_field(&view).unwrap();
    trainer.march(&sampled).unwrap();
    let recorded = trainer.record(&sampled, &view).unwrap();
    let pulled = trainer.pull_back(&recorded, &sampled);
    let base = loss_at(&mut trainer);

    let map = trainer.map.as_ref().unwrap();
    let field = (0..).zip(trainer.field.params().names()).zip(pulled.field).map(|p| (false, p));
    let psi = (0..).zip(map.params().names()).zip(pulled.map.unwrap_or_default()).map(|p| (true, p));
    let gradients: Vec<(bool, usize, String, Tensor)> = field
        .chain(psi.filter(|(_, ((_, name), _))| name.starts_with("psi")))
        .map(|(map, ((i, name), gradient))| (map, i, name.to_string(), gradient.expect("a gradient")))
        .collect();
    let (mut agreed, mut unsettled) = (0, 0);
    for (map, index, name, gradient) in gradients {
        assert!(gradient.is_finite());
        let along = direction(gradient.dims(), seed ^ index as u64);
        let analytic: f64 =
            gradient.data().iter().zip(along.data()).map(|(g, d)| f64::from(*g) * f64::from(*d)).sum();
        let mut at = |by: f32| {
            nudge(&mut trainer, map, index, &along, by);
            let loss = loss_at(&mut trainer);
            nudge(&mut trainer, map, index, &along, -by);
            loss
        };
        let mut difference = |h: f32| (at(h) - at(-h)) / (2.0 * f64::from(h));
        // The loss is rounded to f32, and so is much on the way to it.
        let close = |a: f64, b: f64, h: f64| (a - b).abs() <= 0.02 * a.abs().max(b.abs()) + 1e-6 * base / h;
        let (wide, narrow) = (difference(4e-4), difference(1e-4));
        if close(wide, analytic, 4e-4) || close(narrow, analytic, 1e-4) {
            agreed += 1;
        } else {
            let settled = close(wide, narrow, 1e-4);
            assert!(
                !settled,
                "seed {seed}, {name}: {analytic:e}, but by differences {wide:e} and {narrow:e}"
            );
            unsettled += 1;
        }
    }
    (agreed, unsettled)
}

#[test]
fn the_gradient_of_a_whole_step_agrees_with_differences() {
    let (mut agreed, mut unsettled) = (0, 0);
    let mut add = |(a, u): (usize, usize)| {
        agreed += a;
        unsettled += u;
    };
    for (seed, deformation, target) in [
        (1, Deformation::Projection, Target::Surface),
        (2, Deformation::Tanh, Target::SurfaceAndCloud),
        (4, Deformation::Offset, Target::Surface),
    ] {
        add(check_step(&Config { deformation, target, ..all_terms() }, seed));
    }
    // A parameterization that is not trained in this step.
    add(check_step(&Config { bsp_every: 0, ..all_terms() }, 3));
    assert!(unsettled * 5 < agreed, "{unsettled} of {} differences had not settled", agreed + unsettled);
}

#[test]
fn every_parameter_has_a_gradient_that_is_not_zero() {
    let mut silent: Vec<String> = Vec::new();
    for parameterization in
        [Parameterization::Bsp, Parameterization::Single, Parameterization::Multiple { maps: 3 }]
    {
        let config = Config { parameterization, ..all_terms() };
        let mut trainer = at_training(&ball(40), &config);
        trainer.build_band(8).unwrap();
        let view = trainer.view();
        let sampled = trainer.sample_field(&view).unwrap();
        trainer.march(&sampled).unwrap();
        let recorded = trainer.record(&sampled, &view).unwrap();
        let pulled = trainer.pull_back(&recorded, &sampled);
        let map = trainer.map.as_ref().unwrap();
        let names = trainer.field.params().names().chain(map.params().names());
        for (name, gradient) in names.zip(pulled.field.into_iter().chain(pulled.map.unwrap())) {
            let norm = gradient_norm(&[gradient]);
            assert!(norm.is_finite(), "{name}");
            if norm < 1e-9 {
                silent.push(name.to_string());
            }
        }
    }
    silent.retain(|name| {
        // A softmax ignores what shifts all its scores alike.
        !["phi.attention.gamma.layer1.bias", "phi.attention.eta.bias", "psi.block.cross.key.bias"]
            .contains(&name.as_str())
    });
    assert_eq!(silent, [""; 0]);
}

/// Small but enough for simple shapes.
pub(super) fn quick() -> Config {
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

/// Reconstructs a shape of known topology from a few points, in a frame of its own.
fn check_shape(shape: Shape, count: usize, components: usize, genus: i64) {
    let points: Vec<[f32; 3]> =
        shape.sample(count, 3).0.into_iter().map(|p| [7.0 * p[0] + 100.0, 7.0 * p[1], 7.0 * p[2]]).collect();
    let result = run(&points, &quick());
    let mesh = result.mesh(40).unwrap();
    let topology = mesh.topology();
    assert!(topology.closed && topology.oriented && topology.volume > 0.0, "{topology}");
    assert_eq!((topology.components, topology.genus), (components, Some(genus)), "{topology}");
    let off: f32 = mesh
        .verts
        .iter()
        .map(|v| shape.sdf([(v[0] - 100.0) / 7.0, v[1] / 7.0, v[2] / 7.0]).abs())
        .sum::<f32>()
        / mesh.verts.len() as f32;
    assert!(off < 0.015, "mean distance from the shape: {off} of its longest side");
    // The surface of the mesh is the field's zero level, in the input's units.
    assert!(result.sdf(&mesh.verts).iter().all(|s| s.abs() < 0.05 * 7.0));
}

#[test]
fn a_sphere_comes_back() {
    check_shape(Shape::Sphere { radius: 0.5 }, 200, 1, 0);
}

#[test]
fn a_torus_comes_back() {
    check_shape(Shape::Torus { major: 0.34, minor: 0.16 }, 300, 1, 1);
}

#[test]
fn two_spheres_come_back() {
    check_shape(Shape::TwoSpheres { radius: 0.21, distance: 0.58 }, 250, 2, 0);
}

#[test]
fn the_field_is_in_the_units_of_the_input() {
    let result = run(&ball(150), &quick());
    let probes = [[10.0, -4.0, 0.0], [13.0, -4.0, 0.0], [10.0, -4.0, 3.2]];
    let sdf = result.sdf(&probes);
    assert!(sdf[0] < -1.0 && sdf[1].abs() < 0.2 && (sdf[2] - 0.2).abs() < 0.2, "{sdf:?}");
    // Central differences of the distances, in the same units.
    let h = 0.02;
    let gradient = result.gradient(&probes[1..]);
    for (p, g) in probes[1..].iter().zip(&gradient) {
        for d in 0..3 {
            let at = |by: f32| {
                let mut q = *p;
                q[d] += by;
                result.sdf(&[q])[0]
            };
            let numeric = (at(h) - at(-h)) / (2.0 * h);
            assert!((numeric - g[d]).abs() < 0.05, "{numeric} {g:?}");
        }
    }
    assert_eq!(result.cloud().len(), 150);
    assert_eq!(result.surface_points().len(), 150 * 6);
    let kind = result.mesh(1).unwrap_err().kind();
    assert_eq!(kind, ErrorKind::Config);
}

#[test]
fn noise_is_removed_and_small_shapes_have_finer_grids() {
    let (points, config) = noisy(120);
    let mut trainer = Trainer::new(&points, &config).unwrap();
    // In the input's unit: the ball has a diameter of 6.
    let removed = trainer.noise_removed();
    assert!(removed > 0.03 && removed < 0.3, "{removed}");
    let off = |cloud: &[[f32; 3]]| {
        let radius = |p: &[f32; 3]| p.iter().map(|x| x * x).sum::<f32>().sqrt();
        let mean = cloud.iter().map(radius).sum::<f32>() / cloud.len() as f32;
        cloud.iter().map(|p| (radius(p) - mean).abs()).sum::<f32>() / cloud.len() as f32
    };
    let given = trainer.normalizer.forward(&points);
    assert!(off(&trainer.cloud) < 0.8 * off(&given), "{} {}", off(&trainer.cloud), off(&given));
    let mut finest = 0;
    while !trainer.is_done() {
        finest = finest.max(trainer.step().unwrap().resolution);
    }
    // The root of 20 over about 3.1 times 12.
    assert!((28..=32).contains(&finest), "{finest}");
    // The result has the points as they were given.
    assert_eq!(trainer.finish().cloud(), points);

    let left = Config { denoise: false, reference_area: 0.0, ..config };
    let mut trainer = Trainer::new(&points, &left).unwrap();
    assert_eq!((trainer.noise_removed(), &trainer.cloud), (0.0, &given));
    while !trainer.is_done() {
        assert!(trainer.step().unwrap().resolution <= 12);
    }
    // What S is made from follows the cloud: without parameters it would be the noisy points' otherwise.
    let upsample = Config { parameterization: Parameterization::Upsample, ..noisy(120).1 };
    let mut trainer = at_training(&points, &upsample);
    trainer.step().unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let cloud = &trainer.cloud;
    let fresh = SurfaceMap::new(upsample.parameterization, upsample.bsp, cloud, &mut rng).unwrap();
    assert_eq!(trainer.surface, fresh.surface(cloud, &fresh.blocks(cloud, None, 1000)));
}

#[test]
fn the_threads_do_not_change_a_byte() {
    let points = ball(120);
    // Blocks and windows as for a large cloud.
    let mut large = tiny();
    large.batch = Batch { thin: 0.25, points: 50, centres: 30 };
    let offset = Config { deformation: crate::gdo::Deformation::Offset, ..tiny() };
    let samples = Config { surface_samples: 300, ..tiny() };
    let (scattered, finer) = noisy(120);
    let charts = super::ablations::with_charts(large.clone());
    let exact = [tiny(), large, offset, samples, charts].map(|config| (points.clone(), config));
    for (points, config) in exact.into_iter().chain([(scattered, finer)]) {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| bits(&run(&points, &config)))
        };
        let one = on(1);
        assert_eq!(one, on(2));
        assert_eq!(one, on(3));
    }
}

#[test]
fn the_paper_preset_takes_its_steps() {
    let mut config = Config::preset(Preset::Paper);
    config.stages = vec![Stage { resolution: 10, steps: 2 }];
    config.field.width = 32;
    let mut terms = Vec::new();
    reconstruct(&ball(50), &config, &mut |event| {
        if let Event::Step(r) = event {
            terms.push(r.para > 0.0 && r.deform > 0.0 && r.surf > 0.0);
            assert!((r.loss - (10.0 * r.para + r.deform + 0.01 * r.surf)).abs() < 1e-4 * r.loss);
            assert_eq!(
                (r.eikonal, r.laplacian, r.points, r.pull, r.cover, r.bridge),
                (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            );
        }
        ControlFlow::Continue(())
    })
    .unwrap();
    assert_eq!(terms, [true, true]);
}

#[test]
fn the_callback_sees_everything_and_stops_the_run() {
    let mut points = ball(50);
    points.push(points[7]);
    let config = tiny();
    let mut seen = Vec::new();
    let error = reconstruct(&points, &config, &mut |event| {
        match event {
            Event::Started { points, merged, total_steps } => {
                assert_eq!((*points, *merged, *total_steps), (50, 1, 47));
            }
            Event::Step(report) => {
                assert_eq!(report.total, 47);
                seen.push((report.step, report.phase, report.resolution));
            }
            _ => panic!("{event:?}"),
        }
        if seen.len() == 43 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })
    .unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Cancelled);
    let start = (0..30).map(|i| (i, Phase::Start, 0));
    let pretrain = (30..35).map(|i| (i, Phase::Pretrain, 0));
    let train = (35..43).map(|i| (i, Phase::Train, if i < 41 { 8 } else { 12 }));
    assert_eq!(seen, start.chain(pretrain).chain(train).collect::<Vec<_>>());

    let stopped = reconstruct(&points, &config, &mut |_| ControlFlow::Break(())).unwrap_err();
    assert_eq!(stopped.kind(), ErrorKind::Cancelled);
    let unusable = reconstruct(&[[0.0; 3]; 9], &config, &mut |_| ControlFlow::Continue(())).unwrap_err();
    assert_eq!(unusable.kind(), ErrorKind::Data);
}

/// Makes the field or the parameterization useless.
pub(super) fn poison(trainer: &mut Trainer, map: bool, value: f32) {
    let params = match &mut trainer.map {
        Some(m) if map => m.params_mut(),
        _ => trainer.field.params_mut(),
    };
    let last = params.values_mut().last_mut().unwrap();
    std::sync::Arc::make_mut(last).data_mut()[0] = value;
}

#[test]
fn a_run_comes_back_from_bad_values_with_half_the_rate() {
    // NaN and far away, in both networks, and a field that is positive everywhere.
    for (map, value) in [(false, f32::NAN), (true, f32::NAN), (true, 1e30), (false, 100.0), (false, 1e38)] {
        let mut trainer = at_training(&ball(60), &tiny());
        let rates: Vec<f32> = (0..6).map(|_| trainer.step().unwrap().field_rate).collect();
        poison(&mut trainer, map, value);
        // The last search for the band was at step 4, but stage two begins at 6: its search fails first. 35 steps came
        // before.
        let report = trainer.step().unwrap();
        assert_eq!((report.step, report.recoveries), (39, 1), "{map} {value}");
        assert_eq!(report.field_rate, 0.5 * rates[4]);
        assert!(trainer.last_recovery().unwrap().starts_with("step 41: "), "{:?}", trainer.last_recovery());
        while !trainer.is_done() {
            assert!(trainer.step().unwrap().loss.is_finite());
        }
        assert!(trainer.finish().mesh(12).unwrap().topology().closed);
    }
}

#[test]
fn every_phase_comes_back_from_bad_values() {
    let points = ball(60);
    // Where it goes wrong, in which network, where it goes on, and in which phase.
    for (at, map, back, phase) in [
        (0, false, 0, Phase::Start),
        (25, false, 20, Phase::Start),
        (33, true, 30, Phase::Pretrain),
        // The first step of the training has no state of its own to fall back to yet.
        (35, false, 30, Phase::Pretrain),
    ] {
        let mut trainer = Trainer::new(&points, &tiny()).unwrap();
        let mut rates = Vec::new();
        for _ in 0..at {
            let report = trainer.step().unwrap();
            rates.push(report.field_rate + report.bsp_rate);
        }
        poison(&mut trainer, map, f32::NAN);
        let report = trainer.step().unwrap();
        assert_eq!((report.step, report.phase, report.recoveries), (back, phase, 1), "wrong at {at}");
        if at > 0 {
            assert_eq!(report.field_rate + report.bsp_rate, 0.5 * rates[back]);
        }
        let reason = trainer.last_recovery().unwrap();
        assert!(reason.starts_with(&format!("step {at}: ")), "{reason}");
        while !trainer.is_done() {
            trainer.step().unwrap();
        }
        assert_eq!(trainer.steps_done(), 47);
        assert!(trainer.finish().mesh(12).unwrap().topology().closed);
    }
}

#[test]
fn each_phase_learns_what_it_is_for() {
    let mut config = tiny();
    config.start.steps = 60;
    config.bsp_pretrain = 20;
    let mut trainer = Trainer::new(&ball(80), &config).unwrap();
    let mut reports = Vec::new();
    while trainer.phase() != Phase::Train {
        let (field, map) = (trainer.field.params().clone(), trainer.map.as_ref().map(|m| m.params().clone()));
        let report = trainer.step().unwrap();
        let same = |a: &crate::nn::Params, b: &crate::nn::Params| {
            a.iter().zip(b.iter()).all(|((_, _, a), (_, _, b))| a.data() == b.data())
        };
        let start = report.phase == Phase::Start;
        assert_eq!(same(&field, trainer.field.params()), !start);
        assert_eq!(same(&map.unwrap(), trainer.map.as_ref().unwrap().params()), start);
        assert_eq!((report.field_rate > 0.0, report.bsp_rate > 0.0), (start, !start));
        assert!((report.para > 0.0) != start && report.gradient_norm > 0.0);
        reports.push(report);
    }
    assert_eq!(reports.len(), 80);
    assert!(reports[59].loss < 0.5 * reports[0].loss, "{} {}", reports[0].loss, reports[59].loss);
    assert!(reports[79].loss < reports[60].loss, "{} {}", reports[60].loss, reports[79].loss);
    // Warm-ups count from the first step of their phase.
    let first = trainer.step().unwrap();
    assert_eq!(first.field_rate, config.field_rate.rate_at(0, 12));
    assert_eq!(reports[0].field_rate, config.start.rate / 3.0);
    assert_eq!(reports[60].bsp_rate, config.bsp_rate.rate_at(0, 20));
}

#[test]
fn a_run_stopped_in_the_start_gives_what_it_has() {
    for steps in [0, 1, 31] {
        let mut trainer = Trainer::new(&ball(60), &tiny()).unwrap();
        for _ in 0..steps {
            trainer.step().unwrap();
        }
        let result = trainer.finish();
        assert!(result.mesh(16).unwrap().topology().closed, "after {steps} steps");
        assert_eq!(result.surface_points().len(), 240);
    }
}

#[test]
fn a_run_that_cannot_come_back_says_so() {
    let stuck = |mut trainer: Trainer, value: f32, kind: ErrorKind, advice: &str, recoveries: usize| {
        poison(&mut trainer, false, value);
        trainer.good = trainer.snapshot();
        let error = trainer.step().unwrap_err();
        assert_eq!(error.kind(), kind);
        assert!(error.advice().unwrap().contains(advice), "{error}");
        assert_eq!(trainer.recoveries, recoveries);
    };
    let first = || at_training(&ball(60), &tiny());
    let second = || {
        let mut trainer = first();
        trainer.step().unwrap();
        trainer
    };
    stuck(first(), f32::NAN, ErrorKind::Diverged, "field_rate.base", 3);
    stuck(second(), f32::NAN, ErrorKind::Diverged, "field_rate.base", 3);
    stuck(second(), 100.0, ErrorKind::NoSurface, "field_rate.base", 3);
    // Nothing that training could go back to has a surface, nor is there a shape whose points the field could be
    // lowered to.
    let mut sphere = tiny();
    sphere.start.shape = StartShape::Sphere;
    stuck(at_training(&ball(60), &sphere), 100.0, ErrorKind::NoSurface, "start.steps", 0);
    stuck(Trainer::new(&ball(60), &tiny()).unwrap(), f32::NAN, ErrorKind::Diverged, "start.rate", 3);
}

#[test]
fn scaled_clouds_use_windows_and_blocks() {
    let mut config = tiny();
    config.batch = Batch { thin: 0.0, points: 32, centres: 20 };
    let mut trainer = at_training(&ball(100), &config);
    assert!(trainer.blocks.len() == 8);
    let mut seen = vec![0; 100];
    for _ in 0..12 {
        for row in trainer.view().rows {
            seen[row as usize] += 1;
        }
        trainer.step().unwrap();
    }
    // 12 windows of 32 go round 100 points nearly four times.
    assert!(seen.iter().all(|&s| s == 3 || s == 4), "{seen:?}");
    assert_eq!(trainer.finish().surface_points().len(), 400);
}

#[test]
fn only_clouds_beyond_a_batch_are_thinned() {
    let mut config = tiny();
    // Cubes that hold several of the points.
    config.batch = Batch { thin: 2.0, points: 400, centres: 100 };
    assert_eq!(Trainer::new(&ball(400), &config).unwrap().cloud.len(), 400);
    let points = ball(401);
    let trainer = Trainer::new(&points, &config).unwrap();
    let kept = trainer.cloud.len();
    assert!((20..300).contains(&kept), "{kept}");
    // Not to almost nothing.
    config.batch.thin = 100.0;
    assert_eq!(Trainer::new(&points, &config).unwrap().cloud.len(), 401);
    let result = trainer.finish();
    assert_eq!((result.cloud().len(), result.surface_points().len()), (401, 4 * kept));
}
