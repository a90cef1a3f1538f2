//! Axes that are stretched for the work.

use super::*;
use crate::ErrorKind;
use crate::reconstruct::{Hints, Trainer};

/// Rings around z, further apart than they are wide.
fn rings() -> Vec<[f32; 3]> {
    let point = |i: usize| {
        let (ring, angle) = (i / 36, std::f32::consts::TAU * (i % 36) as f32 / 36.0);
        [0.5 * angle.cos() + 3.0, 0.5 * angle.sin(), 1.4 * ring as f32 + 0.01 * angle.sin()]
    };
    (0..8 * 36).map(point).collect()
}

fn squeezed(points: &[[f32; 3]], by: [f64; 3]) -> Result<Reconstruction, crate::Error> {
    let hints = Hints { anisotropy: Some(by), ..Hints::default() };
    Trainer::with_hints(points, &Config::preset(Preset::Start), &hints).map(Trainer::finish)
}

#[test]
fn rings_far_apart_are_one_tube_in_the_frame_of_the_input() {
    let points = rings();
    let blind = run(&points, &Config::preset(Preset::Start)).mesh(64).unwrap().topology();
    assert!(blind.components != 1 || blind.genus != Some(0), "{blind}");
    let result = squeezed(&points, [1.0, 1.0, 0.2]).unwrap();
    let mesh = result.mesh(64).unwrap();
    let topology = mesh.topology();
    assert!(topology.closed && topology.components == 1 && topology.genus == Some(0), "{topology}");
    let bounds = crate::geometry::Bounds::of(&mesh.verts).unwrap();
    let size = bounds.size();
    assert!((size[0] - 1.0).abs() < 0.1 && size[2] > 9.7 && size[2] < 12.5, "{size:?}");
    // Across the tube distances are exact; they are in the unit of the input.
    for (x, want) in [([3.0, 0.0, 5.1], -0.5), ([3.3, 0.0, 4.4], -0.2), ([3.8, 0.0, 3.2f32], 0.3)] {
        let (s, g) = (result.sdf(&[x])[0], result.gradient(&[x])[0]);
        assert!((s - want).abs() < 0.12, "{s} is not {want} at {x:?}");
        if x[0] > 3.0 {
            assert!(g[0] > 0.95 && g.iter().map(|g| g * g).sum::<f32>() < 1.01, "{g:?}");
        }
    }
    // Far away, too, they grow with the distance.
    let far = result.sdf(&[[3.0, 0.0, 1e3], [3.0, 0.0, 1e6], [1e6f32, 0.0, 5.0]]);
    assert!((far[0] / 990.0 - 1.0).abs() < 0.05 && (far[1] / 1e6 - 1.0).abs() < 0.01, "{far:?}");
    assert!((far[2] / 1e6 - 1.0).abs() < 0.01);
    let grid = result.grid(20);
    assert!(grid.size[2] == 21 && grid.size[0] < 8, "{:?}", grid.size);
    let value = |i: [usize; 3]| grid.values[(i[2] * grid.size[1] + i[1]) * grid.size[0] + i[0]];
    let at = |i: [usize; 3]| [0, 1, 2].map(|a| grid.origin[a] + grid.spacing * i[a] as f64);
    for i in [[3, 3, 10], [0, 0, 0], [1, 3, 7]] {
        assert!((result.sdf(&[at(i)])[0] - f64::from(value(i))).abs() < 1e-4, "{i:?}");
    }
    #[cfg(feature = "checkpoint")]
    {
        let again = Reconstruction::from_bytes(&result.to_bytes().unwrap()).unwrap();
        assert!(again.mesh(20).unwrap() == result.mesh(20).unwrap());
        assert_eq!(again.sdf(&[at([3, 3, 10])]), result.sdf(&[at([3, 3, 10])]));
    }
}

#[test]
fn factors_that_change_nothing_change_nothing() {
    let points = ball(60);
    let plain = run(&points, &Config::preset(Preset::Start));
    assert!(bits(&squeezed(&points, [1.0; 3]).unwrap()) == bits(&plain));
    // All axes alike, by a power of two.
    let twice = squeezed(&points, [2.0; 3]).unwrap();
    assert!(bits(&twice) == bits(&plain));
    let x = [[10.5f64, -3.0, 1.0], [30.0, 2.0, 2.0]];
    for (a, b) in twice.sdf(&x).iter().zip(plain.sdf(&x)) {
        assert!((a - b).abs() < 0.02, "{a} is not {b}");
    }
    for bad in [[0.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 2000.0, 1.0], [1.0, 1.0, f64::NAN]] {
        let error = squeezed(&points, bad).err().unwrap();
        assert_eq!((error.kind(), error.element()), (ErrorKind::Config, Some("anisotropy")), "{bad:?}");
    }
}

/// Normals are those of the input, however its axes are stretched.
#[test]
fn normals_are_stretched_with_the_points() {
    let (points, normals) = AnalyticShape::RoundedBox { half: [1.0, 0.5, 0.1], round: 0.05 }.sample(240, 2);
    let inward: Vec<[f32; 3]> = normals.iter().map(|n| n.map(|x| -x)).collect();
    let hints = Hints { normals: Some(&inward), anisotropy: Some([1.0, 1.0, 4.0]) };
    let result = Trainer::with_hints(&points, &Config::preset(Preset::Start), &hints).unwrap().finish();
    assert!(result.is_turned() && result.sdf(&[[0.0f32; 3]])[0] > 0.05);
}
