//! Near-uniform points on the unit sphere.

use std::f64::consts::PI;

/// `m` near-uniform points on the unit sphere (m x 3), the golden-angle spiral with half-step offset.
///
/// Point `i` has height `z = 1 - (2i + 1) / m` and longitude `i` times the golden angle `pi * (3 - sqrt 5)`. Equal
/// height steps cut the sphere into bands of equal area, so each point stands for the same area `4 pi / m`; the half
/// step keeps points off the poles. See Gonzalez (2010), "Measurement of areas on a sphere using Fibonacci and
/// latitude-longitude lattices".
pub fn fibonacci_sphere(m: usize) -> Vec<[f32; 3]> {
    let golden = PI * (3.0 - 5f64.sqrt());
    (0..m)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / m as f64;
            let r = (1.0 - z * z).sqrt();
            let (s, c) = (golden * i as f64).sin_cos();
            [(r * c) as f32, (r * s) as f32, z as f32]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::KdTree;

    #[test]
    fn points_have_unit_length_at_every_size() {
        for m in 0..=12 {
            let p = fibonacci_sphere(m);
            assert_eq!(p.len(), m);
            for p in p {
                let len = p.iter().map(|x| x * x).sum::<f32>();
                assert!((len - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn spacing_is_near_uniform() {
        for m in [100, 1000, 3000] {
            let p = fibonacci_sphere(m);
            let two = KdTree::new(&p).k_nearest(&p, 2);
            let spacing = (4.0 * PI / m as f64).sqrt();
            for i in 0..m {
                let d = crate::geometry::vec3::dist_sq(p[i], p[two[2 * i + 1] as usize]).sqrt();
                let d = f64::from(d) / spacing;
                assert!((0.7..1.1).contains(&d), "m {m}, point {i}: {d} of the mean spacing");
            }
            for a in 0..3 {
                let mean = p.iter().map(|p| f64::from(p[a])).sum::<f64>() / m as f64;
                let square = p.iter().map(|p| f64::from(p[a]).powi(2)).sum::<f64>() / m as f64;
                assert!(mean.abs() < 0.01 && (square - 1.0 / 3.0).abs() < 0.01, "{mean} {square}");
            }
        }
    }
}
