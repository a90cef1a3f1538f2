//! Large, small and distant coordinates: results move and scale with the input points.

use super::super::*;
use super::{ball, quick, tiny};
use crate::geometry::{AnalyticShape, TriangleMesh};

fn run(points: &[[f64; 3]], config: &Config) -> Reconstruction {
    reconstruct(points, config).unwrap()
}

/// A torus whose coordinates are multiples of 2^-16.
fn torus() -> Vec<[f64; 3]> {
    let points = AnalyticShape::Torus { major: 0.34, minor: 0.16 }.sample(150, 3).0;
    points.iter().map(|p| p.map(|x| (f64::from(x) * 65536.0).round() / 65536.0)).collect()
}

#[test]
fn moved_and_scaled_points_give_the_same_bytes_moved_and_scaled() {
    let points = torus();
    let config = Config { denoise: true, ..tiny() };
    let result = run(&points, &config);
    let (mesh, surface) = (result.mesh(24).unwrap(), result.surface_points());
    let probes = [[0.1, 0.2, 0.3], [-4.0, 2.0, 1.0], [0.5, 0.0, 0.0]];
    for (scale, by) in [
        (1.0, [1024.0, -3.5, 0.25]),
        (1.0, [450_123.5, 5_411_234.75, 320.0]),
        (2f64.powi(-30), [0.0; 3]),
        (2f64.powi(40), [0.0; 3]),
        (2f64.powi(-10), [7.0, 0.0, -2.0]),
    ] {
        let to = |p: &[f64; 3]| -> [f64; 3] { std::array::from_fn(|a| scale * p[a] + by[a]) };
        let moved: Vec<[f64; 3]> = points.iter().map(to).collect();
        let other = run(&moved, &config);
        let found = other.mesh(24).unwrap();
        let wanted = TriangleMesh { verts: mesh.verts.iter().map(to).collect(), faces: mesh.faces.clone() };
        assert!(found == wanted, "{scale} {by:?}");
        assert!(other.surface_points() == surface.iter().map(to).collect::<Vec<_>>());
        let values: Vec<f64> = result.sdf(&probes).iter().map(|s| scale * s).collect();
        assert_eq!(other.sdf(&probes.map(|p| to(&p))), values);
        assert_eq!(other.offset() == [0.0; 3], by[0] == 0.0, "{:?}", other.offset());
    }
}

#[test]
fn distances_far_away_are_finite_grow_and_are_about_right() {
    let wide: Vec<[f64; 3]> = crate::geometry::widened(&ball(150));
    for config in [quick(), Config::preset(Preset::Start)] {
        let result = run(&wide, &config);
        for ray in [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [-0.48, 0.6, 0.64]] {
            let mut before = 0.0;
            // From 1.3 to 1e13 radii; the ball of radius 3 is around (10, -4, 0).
            for i in 0..320 {
                let r = 3.9 * 1.1f64.powi(i);
                let x = [10.0 + r * ray[0], -4.0 + r * ray[1], r * ray[2]];
                let s = result.sdf(&[x])[0];
                assert!(s > before, "{s} at {r} after {before}");
                // Up to 1.05 in the working frame, 6.3 here, only the network speaks, and up to 1.5 it has a say. It
                // was trained near the surface, for a few steps, and knows the distance out there roughly; the
                // points know it.
                let off = if r < 9.0 { 0.25 } else { 0.02 };
                assert!((s / (r - 3.0) - 1.0).abs() < off, "{s} at {r}");
                before = s;
                let g = result.gradient(&[x])[0];
                let slope: f64 = (0..3).map(|a| g[a] * ray[a]).sum();
                // On the way from the one to the other the value makes up for what the network was off by.
                let (least, most) = if r < 9.0 { (0.5, 1.6) } else { (0.95, 1.05) };
                assert!(slope > least && slope < most, "{g:?} at {r}");
            }
            // The same in 32 bits, as far as these reach.
            let x = [1e30f32 * ray[0] as f32, 1e30 * ray[1] as f32, 1e30 * ray[2] as f32];
            assert!((result.sdf(&[x])[0] / 1e30 - 1.0).abs() < 1e-3);
        }
        let s = result.sdf(&[[f64::INFINITY, 0.0, 0.0], [1e300, 0.0, -1e300], [f64::NAN, 0.0, 0.0]]);
        assert!(s[0] == f64::INFINITY && (s[1] / 2f64.sqrt() / 1e300 - 1.0).abs() < 1e-6);
        assert!(s[2].is_nan());
        assert!(result.gradient(&[[f64::NAN, 0.0, 0.0]])[0].iter().all(|x| x.is_nan()));
    }
}

#[cfg(feature = "checkpoint")]
#[test]
fn files_hold_large_coordinates_and_runs_go_on_from_them() {
    let file = std::env::temp_dir().join(format!("bijective-sdf-far-{}", std::process::id()));
    let points: Vec<[f64; 3]> = torus()
        .iter()
        .map(|p| [p[0] / 3.0 + 450_123.4, p[1] / 3.0 + 5_411_234.6, p[2] / 3.0 + 320.0])
        .collect();
    let mut trainer = Trainer::new(&points, &tiny()).unwrap();
    trainer.step().unwrap();
    trainer.save_checkpoint(&file).unwrap();
    let mut resumed = Trainer::resume(&file, &points, &tiny()).unwrap();
    let rounded: Vec<[f32; 3]> = points.iter().map(|p| p.map(|x| x as f32)).collect();
    assert!(Trainer::resume(&file, &rounded, &tiny()).is_err());
    while !trainer.is_done() {
        trainer.step().unwrap();
        resumed.step().unwrap();
    }
    let (result, again) = (trainer.finish(), resumed.finish());
    assert!(result.mesh(20).unwrap() == again.mesh(20).unwrap());
    result.save(&file).unwrap();
    let loaded = Reconstruction::load(&file).unwrap();
    let sorted = crate::geometry::clean_cloud(&points).unwrap().sorted().points;
    assert_eq!((loaded.input_points(), loaded.offset()), (&sorted[..], result.offset()));
    assert!(loaded.mesh(20).unwrap() == result.mesh(20).unwrap());
    std::fs::remove_file(file).unwrap();
}
