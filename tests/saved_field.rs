//! Results that earlier versions saved are read by this one: the files of `tests/saved`, each named by the version of
//! its form, stay as they were written.
#![cfg(feature = "checkpoint")]

use bijective_sdf::geometry::Position;
use bijective_sdf::reconstruct::{Reconstruction, Saved, SavedKind, Trainer};
use std::path::{Path, PathBuf};

fn kept(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/saved").join(name)
}

/// Checks distances at points, and the mesh of 24 cubes: closed, of genus 0, of that volume.
#[track_caller]
fn agrees<P: Position>(
    result: &Reconstruction,
    points: &[P],
    stored: &[f64],
    volume: f64,
    [off, volume_off]: [f64; 2],
) where
    P::Scalar: Into<f64>,
{
    // Instruction sets round the network's sums differently.
    for (found, stored) in result.sdf(points).into_iter().map(Into::<f64>::into).zip(stored) {
        assert!((found - stored).abs() < off, "{found} for {stored}");
    }
    let topology = result.mesh(24).unwrap().topology();
    assert!(topology.closed && topology.genus == Some(0), "{topology}");
    assert!((topology.volume - volume).abs() < volume_off, "{topology}");
}

/// 40 points of an ellipsoid of half axes 3, 2 and 2 around (10, -4, 0); a field of 2 layers of 8, trained for 325
/// steps. Written by `reconstruct --save-field`, and the figures below by `sdf` and `info`.
#[test]
fn a_field_of_version_2_is_read() {
    let result = Reconstruction::load(kept("field_2.safetensors")).unwrap();
    assert_eq!(result.notices(), [""; 0]);
    let config = result.config();
    assert_eq!((config.seed, config.field.width, config.stages[0].resolution), (5, 8, 12));
    assert_eq!((result.input_points().len(), result.surface_points().len()), (40, 80));
    assert_eq!(result.input_points()[0].map(|x| x as f32), [10.66661, -4.0, 1.95]);
    let points = [[10.0f32, -4.0, 0.0], [13.0, -4.0, 0.0], [10.0, -1.0, 0.0], [10.5, -4.0, 4.0]];
    agrees(&result, &points, &[-1.4476404, 0.0167881, 1.0984061, 1.938176], 53.289895, [1e-5, 1e-3]);
}

/// 40 points in 64 bits of an ellipsoid of half axes 3, 2 and 2 around (500010, 5399996, 300); a field of 2 layers of 8,
/// trained for 355 steps and finished. Written by `reconstruct --save-field`, and the figures below by `sdf` and `info`.
#[test]
fn a_finished_field_of_version_5_is_read() {
    let result = Reconstruction::load(kept("field_5.safetensors")).unwrap();
    assert_eq!(result.notices(), [""; 0]);
    assert_eq!((result.input_points().len(), result.surface_points().len()), (40, 80));
    assert_eq!(result.input_points()[0], [500007.0261, 5399996.082, 300.25]);
    let at = |x: f64, y: f64, z: f64| [500010.0 + x, 5399996.0 + y, 300.0 + z];
    let points = [at(0.0, 0.0, 0.0), at(3.0, 0.0, 0.0), at(0.0, 3.0, 0.0), at(0.5, 0.0, 4.0)];
    agrees(&result, &points, &[-1.467876716, 0.003366380, 1.104347435, 2.088042975], 49.65001, [1e-4, 1e-2]);
}

/// 40 points of an ellipsoid of half axes 3, 2 and 2 around (10, -4, 0); a field of 2 layers of 8, trained for 365 steps
/// and finished. Written by `reconstruct --save-field`, and the figures below by `sdf` and `info`.
#[test]
fn a_finished_field_of_version_6_is_read() {
    let file = kept("field_6.safetensors");
    let saved = Saved::from_bytes(&std::fs::read(&file).unwrap()).unwrap();
    assert!(saved.version == 6 && saved.kind == SavedKind::Result, "{} {:?}", saved.version, saved.kind);
    let result = Reconstruction::load(file).unwrap();
    assert_eq!(result.notices(), [""; 0]);
    let config = result.config();
    assert_eq!((config.seed, config.field.width, config.band.shift), (5, 8, 1.0));
    assert_eq!((result.input_points().len(), result.surface_points().len()), (40, 80));
    let points = [[10.0f32, -4.0, 0.0], [13.0, -4.0, 0.0], [10.0, -1.0, 0.0], [10.5, -4.0, 4.0]];
    agrees(&result, &points, &[-1.2611353, 0.0005618, 1.1035931, 1.778616], 49.64350, [1e-4, 1e-2]);
}

/// The run of the field above, saved after 334 of its 355 steps.
#[test]
fn a_checkpoint_of_version_6_goes_on() {
    let points = Reconstruction::load(kept("field_5.safetensors")).unwrap().input_points().to_vec();
    let file = kept("checkpoint_6.safetensors");
    let saved = Saved::from_bytes(&std::fs::read(&file).unwrap()).unwrap();
    assert!(saved.version == 6 && matches!(saved.kind, SavedKind::Checkpoint { step: 334, .. }));
    let mut trainer = Trainer::resume(&file, &points, &saved.config).unwrap();
    assert_eq!((trainer.steps_done(), trainer.total_steps()), (334, 355));
    while !trainer.is_done() {
        trainer.step().unwrap();
    }
    // Far from the points, where the finish changes nothing, the trained field itself is the same.
    let result = trainer.finish();
    let at = [[500010.0f64, 5399996.0, 300.0], [500010.5, 5399996.0, 304.0]];
    for (found, stored) in result.sdf(&at).into_iter().zip([-1.467876716f64, 2.088042975]) {
        assert!((found - stored).abs() < 1e-3, "{found} for {stored}");
    }
    let topology = result.mesh(24).unwrap().topology();
    assert!(topology.closed && topology.genus == Some(0), "{topology}");
}
