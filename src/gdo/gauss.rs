//! A first guess of inside and outside from unoriented points: the parametric Gauss formula.
//!
//! The indicator of a closed surface is a sum of dipoles on it, chi(x) = sum_j K(x, y_j) . mu_j with
//! K(x, y) = -(x - y) / (4 pi |x - y|^3), and it is 1/2 on the surface itself. Asking for 1/2 at all n points and for
//! the smallest mu (3 n unknowns) gives one symmetric n x n system: (A A^T + (alpha - 1) diag(A A^T)) xi = 1/2,
//! mu = A^T xi (Lin, Xiao, Shi, Wang 2022, "Surface Reconstruction from Point Clouds without Normals by Parametrizing
//! the Gauss Formula"). No normals, no iteration. The field starts from it where a sphere would have to find every
//! limb and hole on its way.

use crate::error::{Error, ErrorKind};
use crate::geometry::{KdTree, farthest_point_sample};
use crate::tensor::kernel;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Sources at most; larger clouds are thinned to evenly spread points, for the system costs O(n^3).
const MAX_SOURCES: usize = 1500;
/// Neighbours that measure the local spacing.
const SPACING_NEIGHBOURS: usize = 7;
/// Points evaluated at a time by one thread.
const CHUNK: usize = 512;

/// The indicator of a shape as a sum of dipoles at its points.
#[derive(Clone, Debug)]
pub struct GaussField {
    /// x, y, z, width, mu_x, mu_y, mu_z of every source, column by column.
    sources: [Vec<f32>; 7],
    level: f32,
}

impl GaussField {
    /// Solves for the dipoles of `points` (n x 3, working frame).
    ///
    /// `width` is the radius, in local point spacings, within which a dipole is smoothed; `regularity` is alpha - 1 above, larger is
    /// smoother and forgives noise. Points beyond 1,500 are thinned first; `seed` chooses where thinning starts.
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if the system cannot be solved, as for points that all coincide.
    pub fn fit(points: &[[f32; 3]], width: f32, regularity: f64, seed: u64) -> Result<Self, Error> {
        Self::fit_thinned(points, width, regularity, seed, MAX_SOURCES)
    }

    fn fit_thinned(
        points: &[[f32; 3]],
        width: f32,
        regularity: f64,
        seed: u64,
        most: usize,
    ) -> Result<Self, Error> {
        let thinned: Vec<[f32; 3]>;
        let points = if points.len() > most {
            let chosen = farthest_point_sample(points, most, seed);
            thinned = chosen.iter().map(|&i| points[i as usize]).collect();
            &thinned
        } else {
            points
        };
        let n = points.len();
        let widths: Vec<f64> = spacing(points).iter().map(|s| f64::from(width) * s).collect();

        // A is n x 3n; row i holds the kernels of all sources at point i.
        let mut a = DMatrix::<f64>::zeros(3 * n, n);
        a.as_mut_slice().par_chunks_mut(3 * n).zip(points).for_each(|(row, x)| {
            for ((k, y), w) in row.as_chunks_mut::<3>().0.iter_mut().zip(points).zip(&widths) {
                let d: [f64; 3] = std::array::from_fn(|i| f64::from(x[i]) - f64::from(y[i]));
                let r = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt().max(*w);
                let scale = -1.0 / (4.0 * std::f64::consts::PI * r * r * r);
                *k = d.map(|d| d * scale);
            }
        });
        let mut system = a.tr_mul(&a);
        for i in 0..n {
            system[(i, i)] *= 1.0 + regularity;
        }
        let Some(factor) = system.cholesky() else {
            return Err(Error::new(ErrorKind::Data, "the first guess of inside and outside has no solution")
                .advise(
                    "check that the points do not all coincide, or start from a sphere (start.shape = sphere)",
                ));
        };
        let xi = factor.solve(&DVector::from_element(n, 0.5));
        let mu = &a * xi;

        let column = |f: &dyn Fn(usize) -> f32| (0..n).map(f).collect::<Vec<f32>>();
        let sources = std::array::from_fn(|c| match c {
            0..=2 => column(&|j| points[j][c]),
            3 => column(&|j| widths[j] as f32),
            _ => column(&|j| mu[3 * j + c - 4] as f32),
        });
        let mut field = GaussField { sources, level: 0.0 };
        // The level that runs through the middle of the points; regularisation lets it sink below 1/2.
        let mut values = field.sdf(points);
        values.sort_by(f32::total_cmp);
        field.level = -values[n / 2];
        Ok(field)
    }

    /// level - chi(x) for every point (n x 3): negative inside, zero on the guessed surface. Not a distance.
    pub fn sdf(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let mut out = vec![0.0; points.len()];
        out.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK)).for_each(|(out, points)| {
            for (out, x) in out.iter_mut().zip(points) {
                *out = self.level - indicator(&self.sources, *x);
            }
        });
        out
    }
}

kernel! {
    /// chi(x), in sixteen interleaved partial sums folded in a fixed order.
    fn indicator(sources: &[Vec<f32>; 7], x: [f32; 3]) -> f32 {
        const LANES: usize = 16;
        let n = sources[0].len();
        let one = |j: usize| {
            let d = [x[0] - sources[0][j], x[1] - sources[1][j], x[2] - sources[2][j]];
            let r_sq = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let w = sources[3][j];
            let r_sq = if r_sq < w * w { w * w } else { r_sq };
            let along = d[0] * sources[4][j] + d[1] * sources[5][j] + d[2] * sources[6][j];
            along / (r_sq * r_sq.sqrt())
        };
        let mut sums = [0.0f32; LANES];
        for block in 0..n / LANES {
            let columns: [&[f32; LANES]; 7] =
                std::array::from_fn(|c| sources[c][block * LANES..][..LANES].try_into().expect("a whole block"));
            for (i, sum) in sums.iter_mut().enumerate() {
                let d = [x[0] - columns[0][i], x[1] - columns[1][i], x[2] - columns[2][i]];
                let r_sq = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                let w = columns[3][i];
                let r_sq = if r_sq < w * w { w * w } else { r_sq };
                let along = d[0] * columns[4][i] + d[1] * columns[5][i] + d[2] * columns[6][i];
                *sum += along / (r_sq * r_sq.sqrt());
            }
        }
        let mut total = 0.0;
        for j in n / LANES * LANES..n { total += one(j); }
        for sum in sums { total += sum; }
        -total * (0.25 * std::f32::consts::FRAC_1_PI)
    }
}

/// The mean distance of every point to its nearest neighbours.
pub(crate) fn spacing(points: &[[f32; 3]]) -> Vec<f64> {
    let k = (SPACING_NEIGHBOURS + 1).min(points.len());
    let index = KdTree::new(points).k_nearest(points, k);
    let distance =
        |a: [f32; 3], b: [f32; 3]| (0..3).map(|i| f64::from(a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    let mean = |(i, row): (usize, &[u32])| {
        row.iter().map(|&j| distance(points[i], points[j as usize])).sum::<f64>() / (k - 1).max(1) as f64
    };
    index.chunks_exact(k).enumerate().map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fibonacci_sphere;

    #[test]
    fn tells_inside_from_outside_of_a_sphere_and_a_shell() {
        let sphere: Vec<[f32; 3]> = fibonacci_sphere(301).into_iter().map(|p| p.map(|x| 0.5 * x)).collect();
        let field = GaussField::fit(&sphere, 0.5, 0.05, 0).unwrap();
        for (radius, sign) in [(0.0, -1.0), (0.2, -1.0), (0.4, -1.0), (0.6, 1.0), (0.9, 1.0)] {
            let probes: Vec<[f32; 3]> =
                fibonacci_sphere(20).into_iter().map(|p| p.map(|x| radius * x)).collect();
            assert!(field.sdf(&probes).iter().all(|v| v * sign > 0.0), "radius {radius}");
        }
    }

    #[test]
    fn many_points_are_thinned() {
        let sphere = fibonacci_sphere(900);
        let field = GaussField::fit_thinned(&sphere, 0.5, 0.05, 0, 300).unwrap();
        assert_eq!(field.sources[0].len(), 300);
        assert!(field.sdf(&[[0.0; 3]])[0] < 0.0);
    }

    #[test]
    fn points_that_coincide_are_an_error() {
        let error = GaussField::fit(&[[0.25; 3]; 5], 0.5, 0.05, 0).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Data);
    }
}
