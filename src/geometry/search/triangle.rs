//! The point of a triangle nearest to another point.

use crate::geometry::vec3::{dist_sq, dot, sub};

/// A point of a triangle, and the weights of the triangle's corners that give it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OnTriangle {
    pub point: [f64; 3],
    pub weights: [f64; 3],
}

/// The point of a triangle nearest to `p`: its foot on the plane if that is inside, otherwise the best of the edges.
pub(super) fn closest_on_triangle(p: [f64; 3], corners: [[f64; 3]; 3]) -> OnTriangle {
    let [a, b, c] = corners;
    let (e, f, d) = (sub(b, a), sub(c, a), sub(p, a));
    let (ee, ef, ff, de, df) = (dot(e, e), dot(e, f), dot(f, f), dot(d, e), dot(d, f));
    let det = ee * ff - ef * ef;
    // Slivers have no reliable foot; their edges are near enough to every point of them.
    if det > 1e-14 * ee * ff {
        let (s, t) = ((ff * de - ef * df) / det, (ee * df - ef * de) / det);
        if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
            let point = std::array::from_fn(|k| a[k] + s * e[k] + t * f[k]);
            return OnTriangle { point, weights: [(1.0 - s - t).max(0.0), s, t] };
        }
    }
    let mut best = (f64::INFINITY, OnTriangle { point: a, weights: [1.0, 0.0, 0.0] });
    for (i, j) in [(0, 1), (1, 2), (2, 0)] {
        let (from, edge) = (corners[i], sub(corners[j], corners[i]));
        let len_sq = dot(edge, edge);
        let t = if len_sq > 0.0 { (dot(sub(p, from), edge) / len_sq).clamp(0.0, 1.0) } else { 0.0 };
        let point = std::array::from_fn(|k| from[k] + t * edge[k]);
        let apart = dist_sq(p, point);
        if apart < best.0 {
            let mut weights = [0.0; 3];
            (weights[i], weights[j]) = (1.0 - t, t);
            best = (apart, OnTriangle { point, weights });
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::vec3::wide;
    use proptest::prelude::*;

    fn place(corners: [[f64; 3]; 3], w: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|d| (0..3).map(|c| w[c] * corners[c][d]).sum())
    }

    proptest! {
        #[test]
        fn weights_give_back_the_point(
            corners in prop::array::uniform3(prop::array::uniform3(-2.0f64..2.0)),
            p in prop::array::uniform3(-3.0f64..3.0),
        ) {
            let OnTriangle { point, weights } = closest_on_triangle(p, corners);
            prop_assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)), "{weights:?}");
            prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            prop_assert!(dist_sq(place(corners, weights), point) < 1e-20);
        }

        #[test]
        fn a_point_of_the_triangle_is_its_own_nearest(
            corners in prop::array::uniform3(prop::array::uniform3(-2.0f64..2.0)),
            s in 0.0f64..1.0,
            t in 0.0f64..1.0,
        ) {
            let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
            let p = place(corners, [1.0 - s - t, s, t]);
            prop_assert!(dist_sq(closest_on_triangle(p, corners).point, p) < 1e-8);
        }
    }

    #[test]
    fn a_triangle_without_area_is_the_segment_or_point_it_is() {
        let along = [[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0]];
        assert_eq!(closest_on_triangle(wide([0.25, 0.0, 3.0]), along).weights, [0.75, 0.25, 0.0]);
        assert_eq!(closest_on_triangle([7.0; 3], [[2.0; 3]; 3]).weights, [1.0, 0.0, 0.0]);
    }
}
