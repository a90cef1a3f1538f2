//! Simple shapes come back from a few points, and results are in the frame and unit of the input.

use super::super::*;
use super::{at_training, ball, noisy, quick, run};
use crate::bsp::{Parameterization, SurfaceMap};
use crate::error::ErrorKind;
use crate::geometry::AnalyticShape;
use crate::random::Random;

/// Reconstructs a shape of known topology from a few points, in a frame of its own.
fn check_shape(shape: AnalyticShape, count: usize, components: usize, genus: i64) {
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
        .map(|v| shape.sdf([(v[0] - 100.0) / 7.0, v[1] / 7.0, v[2] / 7.0].map(|x| x as f32)).abs())
        .sum::<f32>()
        / mesh.verts.len() as f32;
    // The worst of the shapes came to 0.0020 when this was written.
    assert!(off < 0.0035, "mean distance from the shape: {off} of its longest side");
    // The surface of the mesh is the field's zero level, in the input's units.
    let most = result.sdf(&mesh.verts).iter().fold(0.0f64, |most, s| most.max(s.abs())) / 7.0;
    assert!(most < 0.006, "a vertex of the mesh is {most} of the longest side off the zero level");
}

#[test]
fn a_sphere_comes_back() {
    check_shape(AnalyticShape::Sphere { radius: 0.5 }, 200, 1, 0);
}

#[test]
fn a_torus_comes_back() {
    check_shape(AnalyticShape::Torus { major: 0.34, minor: 0.16 }, 300, 1, 1);
}

#[test]
fn two_spheres_come_back() {
    check_shape(AnalyticShape::TwoSpheres { radius: 0.21, distance: 0.58 }, 250, 2, 0);
}

#[test]
fn the_field_is_in_the_units_of_the_input() {
    let result = run(&ball(150), &quick());
    let probes = [[10.0f32, -4.0, 0.0], [13.0, -4.0, 0.0], [10.0, -4.0, 3.2]];
    let sdf = result.sdf(&probes);
    assert!(sdf[0] < -1.5 && sdf[1].abs() < 0.025 && (sdf[2] - 0.2).abs() < 0.015, "{sdf:?}");
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
            assert!((numeric - g[d]).abs() < 5e-4, "{numeric} {g:?}");
        }
    }
    assert_eq!(result.input_points().len(), 150);
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
    assert!(removed > 0.04 && removed < 0.09, "{removed}");
    let off = |points: &[[f32; 3]]| {
        let radius = |p: &[f32; 3]| p.iter().map(|x| x * x).sum::<f32>().sqrt();
        let mean = points.iter().map(radius).sum::<f32>() / points.len() as f32;
        points.iter().map(|p| (radius(p) - mean).abs()).sum::<f32>() / points.len() as f32
    };
    let sorted = crate::geometry::clean_cloud(&points).unwrap().sorted().points;
    let given = trainer.setup.frame.forward(&sorted);
    assert!(
        off(&trainer.setup.denoised) < 0.8 * off(&given),
        "{} {}",
        off(&trainer.setup.denoised),
        off(&given)
    );
    let mut finest = 0;
    while !trainer.is_done() {
        finest = finest.max(trainer.step().unwrap().resolution.unwrap_or(0));
    }
    // The root of 20 over about 3.1 times 12.
    assert!((28..=32).contains(&finest), "{finest}");
    // The result has the points as they were given, but in order.
    assert_eq!(trainer.finish().input_points(), sorted);

    let left = Config { denoise: false, reference_area: None, ..config };
    let mut trainer = Trainer::new(&points, &left).unwrap();
    assert_eq!((trainer.noise_removed(), &trainer.setup.denoised), (0.0, &given));
    while !trainer.is_done() {
        assert!(trainer.step().unwrap().resolution.is_none_or(|cubes| cubes <= 12));
    }
    // S is made of the denoised points, also by a map without parameters; of the working points it would be another.
    let upsample = Config { parameterization: Parameterization::Upsample, ..noisy(120).1 };
    let mut trainer = at_training(&points, &upsample);
    trainer.step().unwrap();
    let mut rng = Random::new(0);
    let denoised = &trainer.setup.denoised;
    let fresh = SurfaceMap::new(upsample.parameterization, upsample.bsp, denoised, &mut rng).unwrap();
    assert_eq!(trainer.state.surface, fresh.surface(denoised, &fresh.blocks(denoised, None, 1000)));
}
