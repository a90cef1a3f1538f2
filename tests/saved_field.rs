//! Results that earlier versions saved are read by this one: the files of `tests/saved`, each named by the version of
//! its form, stay as they were written.
#![cfg(feature = "checkpoint")]

use bijective_sdf::reconstruct::Reconstruction;
use std::path::Path;

/// 40 points of an ellipsoid of half axes 3, 2 and 2 around (10, -4, 0); a field of 2 layers of 8, trained for 325
/// steps. Written by `reconstruct --save-field`, and the figures below by `sdf` and `info`.
#[test]
fn a_field_of_version_2_is_read() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/saved/field_2.safetensors");
    let result = Reconstruction::load(file).unwrap();
    assert_eq!(result.notices(), [""; 0]);
    let config = result.config();
    assert_eq!((config.seed, config.field.width, config.stages[0].resolution), (5, 8, 12));
    assert_eq!((result.cloud().len(), result.surface_points().len()), (40, 80));
    assert_eq!(result.cloud()[0].map(|x| x as f32), [10.66661, -4.0, 1.95]);
    let points = [[10.0f32, -4.0, 0.0], [13.0, -4.0, 0.0], [10.0, -1.0, 0.0], [10.5, -4.0, 4.0]];
    // Instruction sets round the network's sums differently.
    for (found, stored) in
        result.sdf(&points).into_iter().zip([-1.4476404, 0.0167881, 1.0984061, 1.938176f32])
    {
        assert!((found - stored).abs() < 1e-5, "{found} for {stored}");
    }
    let topology = result.mesh(24).unwrap().topology();
    assert!(topology.closed && topology.genus == Some(0), "{topology}");
    assert!((topology.volume - 53.289895).abs() < 1e-3, "{topology}");
}
