//! Thinning points to an even density.

use std::collections::BTreeMap;

/// The indices, in ascending order, of one point in each cube of side `side` that has any: the one nearest to the
/// cube's centre, of equals the first. Cubes are aligned to the origin.
///
/// Without it a random choice from the points of a moving scanner would be almost all from nearby, where points are
/// thousands of times denser than far away.
///
/// # Panics
/// If `side` is not positive and finite.
#[track_caller]
pub fn thin_points(points: &[[f32; 3]], side: f32) -> Vec<u32> {
    assert!(side > 0.0 && side.is_finite(), "thin: cubes of side {side}");
    let side = f64::from(side);
    let mut kept: BTreeMap<[i64; 3], (f64, u32)> = BTreeMap::new();
    for (i, point) in (0..).zip(points) {
        let at = point.map(|x| f64::from(x) / side);
        let cube = at.map(|x| x.floor() as i64);
        let off = (0..3).map(|d| (at[d] - at[d].floor() - 0.5).powi(2)).sum::<f64>();
        let best = kept.entry(cube).or_insert((off, i));
        if off < best.0 {
            *best = (off, i);
        }
    }
    let mut indices: Vec<u32> = kept.into_values().map(|(_, i)| i).collect();
    indices.sort_unstable();
    indices
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Against the definition, cube by cube.
        #[test]
        fn each_cube_keeps_its_most_central_point(
            points in prop::collection::vec(prop::array::uniform3(-3.0f32..3.0), 0..80),
            side in 0.2f32..2.0,
        ) {
            let cube = |p: &[f32; 3]| p.map(|x| (f64::from(x) / f64::from(side)).floor());
            let off = |p: &[f32; 3]| {
                let c = cube(p);
                (0..3).map(|d| (f64::from(p[d]) / f64::from(side) - c[d] - 0.5).powi(2)).sum::<f64>()
            };
            let kept = thin_points(&points, side);
            let naive: Vec<u32> = (0..points.len())
                .filter(|&i| {
                    let rivals = (0..points.len()).filter(|&j| cube(&points[j]) == cube(&points[i]));
                    let best = rivals.min_by(|&a, &b| off(&points[a]).total_cmp(&off(&points[b])));
                    best == Some(i)
                })
                .map(|i| i as u32)
                .collect();
            prop_assert_eq!(kept, naive);
        }
    }

    #[test]
    fn cubes_finer_than_the_points_keep_them_all() {
        let points: Vec<[f32; 3]> = crate::geometry::fibonacci_sphere(100);
        assert_eq!(thin_points(&points, 1e-3), (0..100).collect::<Vec<u32>>());
        assert!(thin_points(&points, 10.0).len() <= 8);
    }

    #[test]
    #[should_panic(expected = "cubes of side 0")]
    fn a_side_of_zero_is_refused() {
        thin_points(&[[0.0; 3]], 0.0);
    }
}
