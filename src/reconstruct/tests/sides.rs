//! Normals that are given decide which side is outside.

use super::*;
use crate::reconstruct::{Hints, Trainer};

type Rows = Vec<[f32; 3]>;

fn turned(normals: &[[f32; 3]]) -> Rows {
    normals.iter().map(|n| n.map(|x| -x)).collect()
}

fn with(points: &[[f32; 3]], normals: &[[f32; 3]], config: &Config) -> Reconstruction {
    let hints = Hints { normals: Some(normals), ..Hints::default() };
    let mut trainer = Trainer::with_hints(points, config, &hints).unwrap();
    while !trainer.is_done() {
        trainer.step().unwrap();
    }
    trainer.finish()
}

/// The share of places half the distance between points in front of the points and behind them, as the normals see
/// them, where the distance has the right sign.
fn right(result: &Reconstruction, points: &[[f32; 3]], normals: &[[f32; 3]]) -> f64 {
    let beside = |by: f32| -> f64 {
        let places: Rows =
            points.iter().zip(normals).map(|(p, n)| [0, 1, 2].map(|a| p[a] + by * n[a])).collect();
        let values = result.sdf(&places);
        values.iter().filter(|s| **s * by > 0.0).count() as f64 / values.len() as f64
    };
    0.5 * (beside(0.09) + beside(-0.09))
}

/// A sphere, a part of it seen from one side, and an open sheet, from either side.
#[test]
fn inside_is_where_given_normals_point_away_from() {
    let config = Config::preset(Preset::Start);
    let (ball, outward) = AnalyticShape::Sphere { radius: 1.0 }.sample(240, 3);
    let (cap, of_cap): (Rows, Rows) = ball.iter().zip(&outward).filter(|(p, _)| p[2] > 0.0).unzip();
    let sheet = |i: usize| {
        let (x, y) = ((i as f32 * 0.618_034).fract() * 2.0 - 1.0, i as f32 / 120.0 - 1.0);
        let slope = [-0.75 * (2.5 * x).cos() * (2.0 * y).cos(), 0.6 * (2.5 * x).sin() * (2.0 * y).sin()];
        let len = (slope[0] * slope[0] + slope[1] * slope[1] + 1.0).sqrt();
        ([x, y, 0.3 * (2.5 * x).sin() * (2.0 * y).cos()], [slope[0], slope[1], 1.0].map(|x| x / len))
    };
    let (sheet, of_sheet): (Rows, Rows) = (0..240).map(sheet).unzip();
    for (name, points, normals) in
        [("ball", &ball, &outward), ("cap", &cap, &of_cap), ("sheet", &sheet, &of_sheet)]
    {
        for inward in [false, true] {
            let normals = if inward { turned(normals) } else { normals.clone() };
            let result = with(points, &normals, &config);
            let (mesh, share) = (result.mesh(40).unwrap().topology(), right(&result, points, &normals));
            assert!(share > 0.97, "{name}, inward {inward}: {share}");
            assert!(mesh.closed && mesh.oriented && mesh.genus == Some(0), "{name}: {mesh}");
            // The sheet has a body below it from either side; what is seen from within is the body itself.
            assert_eq!(result.is_turned(), inward && name != "sheet", "{name}");
            assert_eq!(mesh.volume < 0.0, result.is_turned(), "{name}");
            let far = result.sdf(&[[0.0f32, 0.0, 500.0]])[0];
            assert!(far.abs() > 490.0 && (far < 0.0) == result.is_turned(), "{name}: {far}");
        }
        // Nobody knows without them.
        let blind = reconstruct(points, &config).unwrap();
        let either = [right(&blind, points, normals), right(&blind, points, &turned(normals))];
        assert!(either[0].min(either[1]) < 0.6, "{name}: {either:?}");
    }
}

#[test]
fn a_trained_field_keeps_the_sides_it_was_told() {
    let points = ball(90);
    let inward: Rows = points.iter().map(|p| [10.0 - p[0], -4.0 - p[1], -p[2]]).collect();
    let (result, plain) = (with(&points, &inward, &tiny()), run(&points, &tiny()));
    // Distance and gradient change their signs together, in the middle, outside and far away.
    let places =
        [[10.0, -4.0, 0.0], [10.5, -3.5, 0.0], [14.0, -4.0, 0.0], [10.0, -10.0, 2.0], [10.0, 90.0, 0.0f32]];
    let (own, other) = (result.sdf(&places), plain.sdf(&places));
    assert!(result.is_turned() && !plain.is_turned() && own[0] > 0.0 && own[3] < 0.0, "{own:?}");
    assert!(own.iter().zip(&other).all(|(a, b)| a * b < 0.0), "{own:?} {other:?}");
    for (x, g) in places.iter().zip(result.gradient(&places)).skip(2) {
        assert!((0..3).map(|a| g[a] * (x[a] - places[0][a])).sum::<f32>() < 0.0, "{g:?} at {x:?}");
    }
    assert!(plain.mesh(20).unwrap().topology().volume > 0.0);
    assert!(result.mesh(20).unwrap().topology().volume < 0.0);
    assert!(result.grid(8).values[0] < 0.0 && plain.grid(8).values[0] > 0.0);
    #[cfg(feature = "checkpoint")]
    {
        let again = Reconstruction::from_bytes(&result.to_bytes().unwrap()).unwrap();
        assert!(again.is_turned() && bits(&again) == bits(&result));
    }
}

/// Points that repeat others are left out with their normals, and what says nothing counts for nothing.
#[test]
fn normals_go_with_their_points() {
    let (points, normals) = AnalyticShape::Sphere { radius: 1.0 }.sample(120, 4);
    let config = Config::preset(Preset::Start);
    let plain = with(&points, &normals, &config);
    let (mut more, mut long): (Rows, Rows) =
        (points.clone(), normals.iter().map(|n| n.map(|x| 7.0 * x)).collect());
    for i in [3, 50, 119] {
        more.insert(i + 1, more[i]);
        long.insert(i + 1, [f32::NAN; 3]);
    }
    let same = with(&more, &long, &config);
    let (a, b) = (plain.mesh(20).unwrap(), same.mesh(20).unwrap());
    assert!(a.faces == b.faces, "rounding aside, lengths and repeated points change nothing");
    let mut sphere = tiny();
    sphere.start.shape = StartShape::Sphere;
    let hints = Hints { normals: Some(&normals), ..Hints::default() };
    let error = Trainer::with_hints(&points, &sphere, &hints).err().unwrap();
    assert_eq!((error.kind(), error.element()), (crate::ErrorKind::Config, Some("option start.shape")));
}

#[test]
#[should_panic(expected = "hints: 3 normals for 40 points")]
fn one_normal_a_point() {
    let _ = Trainer::with_hints(
        &ball(40),
        &tiny(),
        &Hints { normals: Some(&[[0.0, 0.0, 1.0]; 3]), ..Hints::default() },
    );
}
