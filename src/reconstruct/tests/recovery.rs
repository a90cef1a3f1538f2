//! Runs that go wrong come back from a good state, or say that they cannot.

use super::super::*;
use super::{at_training, ball, poison, tiny};
use crate::error::ErrorKind;

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
fn a_run_that_cannot_come_back_says_so() {
    let stuck = |mut trainer: Trainer, value: f32, kind: ErrorKind, advice: &str, recoveries: usize| {
        poison(&mut trainer, false, value);
        trainer.good = trainer.state.clone();
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
