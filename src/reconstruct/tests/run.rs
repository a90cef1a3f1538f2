//! The course of a run: its phases and events, which points a step uses, and the same bytes for any threads.

use super::super::*;
use super::{at_training, ball, bits, noisy, run, tiny};
use crate::error::ErrorKind;
use crate::optim::{Decay, Schedule};
use std::ops::ControlFlow;

#[test]
fn the_threads_do_not_change_a_byte() {
    let points = ball(120);
    // Blocks and windows as for many points.
    let mut large = tiny();
    large.batch = Batch { thin: Some(0.25), points: 50, centres: 30 };
    let offset = Config { deformation: crate::gdo::Deformation::Offset, ..tiny() };
    let samples = Config { surface_samples: Some(300), ..tiny() };
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
    reconstruct_with(&ball(50), &config, &mut |event| {
        if let Event::Step(r) = event {
            terms.push(r.terms.para > 0.0 && r.terms.deform > 0.0 && r.terms.surf > 0.0);
            assert!(
                (r.loss - (10.0 * r.terms.para + r.terms.deform + 0.01 * r.terms.surf)).abs() < 1e-4 * r.loss
            );
            let paper =
                Terms { para: r.terms.para, deform: r.terms.deform, surf: r.terms.surf, ..Terms::default() };
            assert_eq!(r.terms, paper);
        }
        ControlFlow::Continue(())
    })
    .unwrap()
    .finish();
    assert_eq!(terms, [true, true]);
}

#[test]
fn the_fine_preset_takes_its_steps() {
    let mut config = Config::preset(Preset::Fine);
    (config.field.width, config.field.depth, config.bsp.channels) = (16, 2, 8);
    (config.start.steps, config.bsp_pretrain) = (40, 3);
    config.stages.iter_mut().for_each(|stage| stage.steps = 2);
    // The grids that the stages say, whatever the area.
    config.reference_area = None;
    let mut steps = Vec::new();
    let result = reconstruct_with(&ball(50), &config, &mut |event| {
        if let Event::Step(r) = event
            && r.phase == Phase::Train
        {
            assert!(
                r.loss.is_finite() && r.terms.deform > 0.0 && r.surface_verts > 0 && r.recoveries == 0,
                "{r:?}"
            );
            steps.extend(r.resolution);
        }
        ControlFlow::Continue(())
    })
    .unwrap()
    .finish();
    assert_eq!(steps, [32, 32, 48, 48]);
    assert!(result.mesh(20).unwrap().topology().closed);
}

#[test]
fn the_callback_hears_of_recoveries() {
    // A rate that no training survives.
    let mut config = tiny();
    config.field_rate = Schedule { base: 1.0, warmup: 0, decay: Decay::Constant };
    let (mut recovered, mut last) = (Vec::new(), None);
    let outcome = reconstruct_with(&ball(50), &config, &mut |event| {
        match *event {
            Event::Recovered { step, reason } => {
                let failed: usize =
                    reason.strip_prefix("step ").unwrap().split(':').next().unwrap().parse().unwrap();
                assert!(step <= failed, "on from {step} after {reason}");
                recovered.push(step);
            }
            Event::Step(report) => {
                // The first step reported after a recovery is the one that the run went on with.
                let resumed: Option<&usize> = recovered.last();
                if last.is_some_and(|before| report.recoveries > before) {
                    assert_eq!(resumed, Some(&report.step));
                }
                last = Some(report.recoveries);
            }
            _ => {}
        }
        ControlFlow::Continue(())
    });
    assert!((1..=3).contains(&recovered.len()), "{:?}", outcome.err());
}

#[test]
fn the_callback_sees_everything_and_stops_the_run() {
    let mut points = ball(50);
    points.push(points[7]);
    let config = tiny();
    let mut seen = Vec::new();
    let outcome = reconstruct_with(&points, &config, &mut |event| {
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
    .unwrap();
    // What there is can go on, be saved, or be finished.
    let Outcome::Stopped(trainer) = outcome else { panic!("the run was not stopped") };
    assert_eq!(trainer.steps_done(), 43);
    assert!(trainer.finish().mesh(12).unwrap().topology().closed);
    let start = (0..30).map(|i| (i, Phase::Start, None));
    let pretrain = (30..35).map(|i| (i, Phase::Pretrain, None));
    let train = (35..43).map(|i| (i, Phase::Train, Some(if i < 41 { 8 } else { 12 })));
    assert_eq!(seen, start.chain(pretrain).chain(train).collect::<Vec<_>>());

    let stopped = reconstruct_with(&points, &config, &mut |_| ControlFlow::Break(())).err().unwrap();
    assert_eq!(stopped.kind(), ErrorKind::Cancelled);
    let unusable = reconstruct(&[[0.0; 3]; 9], &config).unwrap_err();
    assert_eq!(unusable.kind(), ErrorKind::Data);
}

#[test]
fn each_phase_learns_what_it_is_for() {
    let mut config = tiny();
    config.start.steps = 60;
    config.bsp_pretrain = 20;
    let mut trainer = Trainer::new(&ball(80), &config).unwrap();
    let mut reports = Vec::new();
    while trainer.phase() != Phase::Train {
        let (field, map) =
            (trainer.state.field.params().clone(), trainer.state.map.as_ref().map(|m| m.params().clone()));
        let report = trainer.step().unwrap();
        let same = |a: &crate::nn::Params, b: &crate::nn::Params| {
            a.iter().zip(b.iter()).all(|((_, _, a), (_, _, b))| a.data() == b.data())
        };
        let start = report.phase == Phase::Start;
        assert_eq!(same(&field, trainer.state.field.params()), !start);
        assert_eq!(same(&map.unwrap(), trainer.state.map.as_ref().unwrap().params()), start);
        assert_eq!((report.field_rate > 0.0, report.bsp_rate > 0.0), (start, !start));
        assert!((report.terms.para > 0.0) != start && report.gradient_norm > 0.0);
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
fn many_points_use_windows_and_blocks() {
    let mut config = tiny();
    config.batch = Batch { thin: None, points: 32, centres: 20 };
    let mut trainer = at_training(&ball(100), &config);
    assert!(trainer.setup.blocks.len() == 8);
    let mut seen = vec![0; 100];
    for _ in 0..12 {
        let Trainer { setup, state, .. } = &trainer;
        let (_, step) = setup.config.phase_at(state.step);
        let resolution = setup.resolution_at(step);
        let band = trainer::find_band(setup, state, resolution, &|| false).unwrap();
        for row in phases::train::TrainStep::new(setup, state, &band, step).seen().rows {
            seen[row as usize] += 1;
        }
        trainer.step().unwrap();
    }
    // 12 windows of 32 go round 100 points nearly four times.
    assert!(seen.iter().all(|&s| s == 3 || s == 4), "{seen:?}");
    assert_eq!(trainer.finish().surface_points().len(), 400);
}

#[test]
fn only_points_beyond_a_batch_are_thinned() {
    let mut config = tiny();
    // Cubes that hold several of the points.
    config.batch = Batch { thin: Some(2.0), points: 400, centres: 100 };
    assert_eq!(Trainer::new(&ball(400), &config).unwrap().setup.denoised.len(), 400);
    let points = ball(401);
    let trainer = Trainer::new(&points, &config).unwrap();
    let kept = trainer.setup.denoised.len();
    assert!((20..300).contains(&kept), "{kept}");
    // Not to almost nothing.
    config.batch.thin = Some(100.0);
    assert_eq!(Trainer::new(&points, &config).unwrap().setup.denoised.len(), 401);
    let result = trainer.finish();
    assert_eq!((result.input_points().len(), result.surface_points().len()), (401, 4 * kept));
}

/// Given up at each of its questions, a step leaves everything as it was.
#[test]
fn a_step_that_is_given_up_has_not_begun() {
    use std::sync::atomic::{AtomicUsize, Ordering};
    let points = ball(70);
    let mut config = tiny();
    config.weights.bridge = 1.0;
    let straight = bits(&run(&points, &config));
    let mut trainer = trainer::Trainer::new(&points, &config).unwrap();
    let (mut asked_most, mut given_up) = (0, 0);
    while !trainer.is_done() {
        let steps = trainer.steps_done();
        // At the first question, then at the second, until there are no more.
        for last in 0.. {
            let asked = AtomicUsize::new(0);
            let stop = || asked.fetch_add(1, Ordering::Relaxed) == last;
            if trainer.step_unless(&stop).unwrap().is_some() {
                asked_most = asked_most.max(asked.into_inner());
                break;
            }
            given_up += 1;
            assert_eq!(trainer.steps_done(), steps);
        }
    }
    // The searches for the surface ask before each part of the grid, a step between three parts.
    assert!(asked_most > 3 && given_up > 30, "{asked_most} {given_up}");
    assert!(bits(&trainer.finish()) == straight);
}

#[test]
fn what_is_stopped_before_the_training_is_the_first_shape() {
    let points = ball(70);
    let first = run(&points, &Config::preset(Preset::Start)).mesh(24).unwrap();
    let mut trainer = Trainer::new(&points, &Config::preset(Preset::Fast)).unwrap();
    for _ in 0..3 {
        trainer.step().unwrap();
    }
    assert!(trainer.finish().mesh(24).unwrap() == first);
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(6))]

    /// The same points, some of them twice, in another order give the same bytes, and so do their normals.
    #[test]
    fn the_order_of_the_points_makes_no_difference(seed: u64, start: bool, hinted: bool) {
        use crate::geometry::AnalyticShape;
        use crate::reconstruct::Hints;
        use rand::SeedableRng;
        use rand::rngs::ChaCha8Rng;
        use rand::seq::SliceRandom;
        let (points, normals) = AnalyticShape::Torus { major: 1.0, minor: 0.4 }.sample(70, 3);
        let config = if start { Config::preset(Preset::Start) } else { tiny() };
        let of = |rows: &[usize]| {
            let (points, normals): (Vec<[f32; 3]>, Vec<[f32; 3]>) =
                rows.iter().map(|&i| (points[i], normals[i])).unzip();
            let hints = Hints { normals: hinted.then_some(&normals[..]), ..Hints::default() };
            let mut trainer = Trainer::with_hints(&points, &config, &hints).unwrap();
            while !trainer.is_done() {
                trainer.step().unwrap();
            }
            bits(&trainer.finish())
        };
        let mut rows: Vec<usize> = (0..70).chain([3, 30, 3]).collect();
        rows.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
        proptest::prop_assert!(of(&rows) == of(&(0..70).collect::<Vec<_>>()));
    }
}
