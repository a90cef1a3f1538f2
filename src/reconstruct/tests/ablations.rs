//! Tests of the paper's ablations as settings.

use super::super::*;
use super::{ball, quick, tiny};
use crate::bsp::{BspConfig, Parameterization};
use std::ops::ControlFlow;

/// The options with codes in a layout, charts and slack.
pub(in crate::reconstruct) fn with_charts(mut config: Config) -> Config {
    config.bsp = BspConfig { layout: true, charts: true, slack: 1.0, average_positions: false, ..config.bsp };
    config
}

#[test]
fn every_ablation_runs() {
    let points = ball(60);
    for settings in [
        &[("parameterization", "none")][..],
        &[("parameterization", "upsample"), ("bsp_every", "1")],
        &[
            ("parameterization", "upsample"),
            ("batch.points", "20"),
            ("batch.centres", "16"),
            ("target", "surface"),
        ],
        &[("parameterization", "single"), ("bsp_every", "1")],
        &[("parameterization", "multiple:4"), ("surface_samples", "100")],
        &[("deformation", "offset")],
        &[("deformation", "tanh"), ("clip", "1")],
        &[("deformation", "none"), ("target", "surface")],
        &[("bsp_every", "never"), ("weights.deform", "1")],
        &[("weights.para", "0"), ("bsp_pretrain", "0")],
        &[("weights.deform", "0"), ("weights.cover", "0"), ("weights.pull", "1")],
        &[
            ("bsp.patch", "3"),
            ("bsp.neighbours", "12"),
            ("bsp.reach", "all"),
            ("bsp.average_positions", "false"),
        ],
        &[
            ("bsp.layout", "true"),
            ("bsp.charts", "true"),
            ("bsp.slack", "1"),
            ("bsp.average_positions", "false"),
            ("batch.points", "20"),
            ("batch.centres", "16"),
        ],
        &[("field.activation", "relu"), ("field.skip", "1"), ("start.shape", "sphere"), ("band.rings", "2")],
        &[("batch.points", "20"), ("batch.centres", "16"), ("bsp.reach", "all")],
    ] {
        let mut config = tiny();
        for (key, value) in settings {
            config.set(key, value).unwrap();
        }
        let mut steps = 0;
        let result = reconstruct_with(&points, &config, &mut |event| {
            if let Event::Step(report) = event {
                assert!(report.loss.is_finite(), "{settings:?}");
                assert_eq!(report.active_verts > 0, report.phase == Phase::Train, "{settings:?}");
                steps += 1;
            }
            assert!(!matches!(event, Event::Recovered { .. }), "{settings:?}: {event:?}");
            ControlFlow::Continue(())
        })
        .unwrap()
        .finish();
        assert_eq!(steps, config.total_steps(), "{settings:?}");
        assert!(result.mesh(12).unwrap().topology().closed, "{settings:?}");
    }
}

#[test]
fn a_sphere_comes_back_from_interpolated_points() {
    let config = Config { parameterization: Parameterization::Upsample, ..quick() };
    let points = ball(150);
    let (mut steps, mut trained) = (0, 0);
    let result = reconstruct_with(&points, &config, &mut |event| {
        if let Event::Step(report) = event {
            assert!(report.phase != Phase::Pretrain && report.terms.para == 0.0);
            steps += 1;
            trained += usize::from(report.phase == Phase::Train && report.terms.deform > 0.0);
        }
        ControlFlow::Continue(())
    })
    .unwrap()
    .finish();
    assert_eq!((steps, trained), (260, 60));
    // S stays the interpolation of the points, so it lies inside the ball and near it.
    let centred = |p: &[f64; 3]| ((p[0] - 10.0).powi(2) + (p[1] + 4.0).powi(2) + p[2].powi(2)).sqrt();
    let surface = result.surface_points();
    assert_eq!(surface.len(), 150 * 6);
    assert!(surface.iter().all(|p| (2.5..3.001).contains(&centred(p))));
    let topology = result.mesh(40).unwrap().topology();
    assert!(topology.closed && topology.oriented && topology.genus == Some(0), "{topology}");
    let ball = 4.0 / 3.0 * std::f64::consts::PI * 27.0;
    assert!((topology.volume / ball - 1.0).abs() < 0.004, "{topology}");
}
