//! Whether S fills in between the points: the figures of a run, held against the true surface.

use bijective_sdf::bsp::{Coverage, Parameterization};
use bijective_sdf::evaluate::{CompareOptions, GroundTruth, PointsReport, evaluate_points};
use bijective_sdf::geometry::{
    AnalyticShape, NarrowBandOptions, TetGrid, TriangleMesh, extract_mesh, relative_to,
};
use bijective_sdf::{Config, Preset, reconstruct};

/// What S came to in a run, and how it and the points lie to the truth.
#[derive(Clone, Copy, Debug)]
struct Seen {
    coverage: Coverage,
    q: PointsReport,
    s: PointsReport,
}

/// Reconstructs `n` points of a shape and measures the S that the run ends with.
fn seen_after_training(shape: AnalyticShape, n: usize, config: &Config) -> Seen {
    let (points, _) = shape.sample(n, 1);
    let result = reconstruct(&points, config).unwrap();
    let truth = true_mesh(&shape);
    let sets =
        [relative_to(result.input_points(), [0.0; 3]), relative_to(&result.surface_points(), [0.0; 3])];
    let sets: [&[[f32; 3]]; 2] = [&sets[0], &sets[1]];
    let reports = evaluate_points(GroundTruth::Mesh(&truth), &sets, &CompareOptions::shape()).unwrap();
    Seen { coverage: *result.coverage().expect("an S"), q: reports[0], s: reports[1] }
}

fn true_mesh(shape: &AnalyticShape) -> TriangleMesh {
    let (around, _) = shape.sample(2000, 2);
    let grid = TetGrid::covering([-1.0; 3], [1.0; 3], 64, 1).unwrap();
    let mut sdf = |p: &[[f32; 3]]| Ok(p.iter().map(|&p| shape.sdf(p)).collect());
    extract_mesh(&grid, &mut sdf, &NarrowBandOptions::with_seeds(&around)).unwrap()
}

/// `fast`, but with hardly a step of the field: S is what is looked at.
fn short(parameterization: Parameterization) -> Config {
    let mut config = Config::preset(Preset::Fast);
    config.parameterization = parameterization;
    for (key, value) in [("start.steps", "50"), ("stages", "16:12"), ("bsp_every", "1")] {
        config.set(key, value).unwrap();
    }
    config
}

#[test]
fn an_interpolated_surface_is_seen_to_fill_the_gaps() {
    let seen =
        seen_after_training(AnalyticShape::Sphere { radius: 0.7 }, 150, &short(Parameterization::Upsample));
    assert!(seen.coverage.codes.is_none() && seen.coverage.distinct_share() > 0.9, "{seen:?}");
    assert!(seen.s.from_gt < 0.9 * seen.q.from_gt && seen.s.from_gt > seen.s.floor.unwrap(), "{seen:?}");
    // The same places, in two frames.
    assert!(seen.s.distinct.abs_diff(seen.coverage.distinct) < 15, "{seen:?}");
    assert_eq!((seen.coverage.points, seen.coverage.surface, seen.s.points), (150, 1500, 1500));
}

#[test]
fn a_trained_surface_has_figures_of_its_codes() {
    let seen = seen_after_training(AnalyticShape::Sphere { radius: 0.7 }, 150, &short(Parameterization::Bsp));
    let codes = seen.coverage.codes.unwrap();
    assert!((0.0..=1.0).contains(&codes.mean_code) && codes.sphere == 1500, "{seen:?}");
    assert!((10..=1500).contains(&codes.used) && codes.folded().is_none_or(|f| f <= 1.0), "{seen:?}");
    assert!(seen.coverage.q_to_s < 0.1 && seen.s.to_gt < 0.1 && seen.s.from_gt < 0.2, "{seen:?}");
}

/// `short` with codes that begin in a layout and a Psi that begins with charts.
fn with_charts() -> Config {
    let mut config = short(Parameterization::Bsp);
    for (key, value) in [
        ("bsp.layout", "true"),
        ("bsp.charts", "true"),
        ("bsp.average_positions", "false"),
        ("bsp.slack", "1"),
        ("bsp_pretrain", "40"),
        ("bsp_pretrain_on_shape", "false"),
    ] {
        config.set(key, value).unwrap();
    }
    config
}

#[test]
fn codes_cover_the_sphere_and_s_the_shape_after_training() {
    for shape in [AnalyticShape::Sphere { radius: 0.7 }, AnalyticShape::Torus { major: 0.6, minor: 0.25 }] {
        let seen = seen_after_training(shape, 200, &with_charts());
        let codes = seen.coverage.codes.unwrap();
        assert!(codes.mean_code < 0.1 && codes.evenness() > 0.75, "{seen:?}");
        assert!(codes.folded().is_none_or(|folded| folded < 0.05), "{seen:?}");
        assert!(seen.coverage.distinct_share() > 0.95, "{seen:?}");
        // Nearer to what as many samples of the truth cover than to what the points do.
        let (floor, q) = (seen.s.floor.unwrap(), seen.q.from_gt);
        assert!(seen.s.from_gt < 0.5 * (floor + q), "{seen:?}");
    }
}
