//! A first guess of inside and outside from unoriented points: the parametric Gauss formula.
//!
//! The indicator of a closed surface is a sum of dipoles on it, chi(x) = sum_j K(x, y_j) . mu_j with
//! K(x, y) = -(x - y) / (4 pi |x - y|^3), and it is 1/2 on the surface itself. Asking for 1/2 at all n points and for
//! the smallest mu (3 n unknowns) gives one symmetric n x n system: (A A^T + (alpha - 1) diag(A A^T)) xi = 1/2,
//! mu = A^T xi (Lin, Xiao, Shi, Wang 2022, "Surface Reconstruction from Point Clouds without Normals by Parametrizing
//! the Gauss Formula"). No normals, no iteration. The field starts from this guess; from a sphere the training would
//! have to find every limb and hole by itself.
//!
//! The true mu_j is a normal times the area a_j that point j stands for. So "smallest" is measured here by
//! sum_j |mu_j|^2 / a_j, the integral of |n|^2 over the surface, where the paper takes sum_j |mu_j|^2 and thereby
//! expects the same area of every point. With W = diag(a_j) the system is that of A W A^T, and mu = W A^T xi.

use crate::error::{Error, ErrorKind};
use crate::geometry::{KdTree, farthest_point_sample, median, neighbour_spacing};
use crate::linalg::Symmetric;
use crate::simd::kernel;
use rayon::prelude::*;

/// Sources at most; more points are thinned to evenly spread ones, for the system costs O(n^3). More do not help.
const MAX_SOURCES: usize = 1500;
/// Radius of a dipole at least (working frame): points closer than f32 can tell apart have a neighbour
/// spacing of 0.
const MIN_RADIUS: f64 = 1e-6;
/// The area of a point at least, over that of a point with the mean neighbour spacing: points that coincide still have
/// a dipole, without which the diagonal of the system could vanish.
const MIN_AREA: f64 = 1e-6;
/// The number of nearest points, itself among them, that the neighbour spacing of a point is averaged over for the area
/// that says how strong a dipole is expected to be: that of a single one of evenly spread points scatters. Given
/// normals are weighted by the areas of single points, as one that lies alone does stand for more
/// (`benches/accuracy.md`, constants).
const AVERAGED: usize = 16;
/// Points evaluated at a time by one thread.
const CHUNK: usize = 512;
/// Sources whose kernels are in memory at the same time while the system is built.
const SLAB: usize = 128;

/// The area that a point stands for, in squares of its neighbour spacing: of points spread at random, the seven nearest
/// are on average 1.05 roots of that area away.
const AREA: f64 = 0.91;
/// The lowest level that is taken for given normals, see [`GaussField::of_normals`].
const MIN_LEVEL: f32 = 0.25;

/// The indicator of a shape as a sum of dipoles at its points.
#[derive(Clone, Debug)]
pub struct GaussField {
    /// x, y, z, radius, mu_x, mu_y, mu_z of every source, column by column.
    sources: [Vec<f32>; 7],
    /// chi on the guessed surface.
    level: f32,
}

impl GaussField {
    /// Solves for the dipoles of `points` (n x 3, working frame).
    ///
    /// `radius` is that within which a dipole is smoothed, in neighbour spacings; `regularity` is alpha - 1
    /// above, larger is smoother and forgives noise. Points beyond 1,500 are thinned first; `seed` chooses where
    /// thinning starts.
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if the system cannot be solved, as for points that all coincide.
    pub fn fit(points: &[[f32; 3]], radius: f32, regularity: f64, seed: u64) -> Result<Self, Error> {
        Self::fit_thinned(points, radius, regularity, seed, MAX_SOURCES)
    }

    /// The dipoles of given `normals` (n x 3, outward, of unit length or zero for none) at `points` (n x 3, working
    /// frame), each as strong as the area that its point stands for; nothing is solved for.
    ///
    /// Such a chi jumps by 1 over the points, from about 1/2 less to 1/2 more than its value at them: 1/2 on a closed
    /// surface, so that chi is 1 inside, and 0 on a sheet that is open on all sides. The level goes between: at that
    /// value, but not below 1/4, as chi vanishes far away and a surface at level 0 would not end.
    ///
    /// `radius` and `seed` are as in [`fit`](Self::fit).
    pub fn of_normals(points: &[[f32; 3]], normals: &[[f32; 3]], radius: f32, seed: u64) -> Self {
        if points.len() > MAX_SOURCES {
            let chosen = farthest_point_sample(points, MAX_SOURCES, seed);
            let of = |all: &[[f32; 3]]| chosen.iter().map(|&i| all[i as usize]).collect::<Vec<_>>();
            return Self::of_normals(&of(points), &of(normals), radius, seed);
        }
        let spacing = neighbour_spacing(points);
        let Areas { relative, unit } = Areas::of(points, &spacing, 1);
        let column = |f: &dyn Fn(usize) -> f64| (0..points.len()).map(|j| f(j) as f32).collect::<Vec<f32>>();
        let sources = std::array::from_fn(|c| match c {
            0..=2 => column(&|j| f64::from(points[j][c])),
            3 => column(&|j| (f64::from(radius) * spacing[j]).max(MIN_RADIUS)),
            _ => column(&|j| unit * relative[j] * f64::from(normals[j][c - 4])),
        });
        let field = GaussField { sources, level: 0.0 };
        GaussField { level: field.at_points().clamp(MIN_LEVEL, 0.5), ..field }
    }

    /// chi at the points that the dipoles are at, the median: with given normals about 1/2 if they are those of a
    /// closed surface, -1/2 if these point inward, and 0 for an open sheet.
    pub fn at_points(&self) -> f32 {
        let points: Vec<[f32; 3]> =
            (0..self.sources[0].len()).map(|j| [0, 1, 2].map(|c| self.sources[c][j])).collect();
        self.level - median(self.value(&points))
    }

    fn fit_thinned(
        points: &[[f32; 3]],
        radius: f32,
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
        let spacing = neighbour_spacing(points);
        let widths: Vec<f64> = spacing.iter().map(|s| (f64::from(radius) * s).max(MIN_RADIUS)).collect();
        // Their unit cancels: it would multiply the system and divide its solution.
        let areas = Areas::of(points, &spacing, AVERAGED).relative;

        // A is n x 3n; its columns hold the kernel of one source at all points. A W A^T is summed over slabs of
        // sources.
        let places: [Vec<f64>; 3] = std::array::from_fn(|d| points.iter().map(|p| f64::from(p[d])).collect());
        let mut system = Symmetric::zeros(n);
        let mut slab = vec![0.0; 3 * n * SLAB.min(n)];
        for first in (0..n).step_by(SLAB) {
            let slab = &mut slab[..3 * n * SLAB.min(n - first)];
            slab.par_chunks_mut(3 * n).enumerate().for_each(|(i, columns)| {
                kernels(columns, &places, first + i, widths[first + i]);
                let root = areas[first + i].sqrt();
                columns.iter_mut().for_each(|k| *k *= root);
            });
            system.add_product(0, 1.0, slab);
        }
        system.scale_diagonal(1.0 + regularity);
        let Some(xi) = system.solve(vec![0.5; n]) else {
            return Err(Error::new(ErrorKind::Data, "the first guess of inside and outside has no solution")
                .advise(
                    "check that the points do not all coincide, or start from a sphere (start.shape = sphere)",
                ));
        };
        // mu = W A^T xi
        let mut mu = vec![[0.0; 3]; n];
        mu.par_chunks_mut(SLAB).enumerate().for_each(|(chunk, mu)| {
            let mut columns = vec![0.0; 3 * n];
            for (i, mu) in mu.iter_mut().enumerate() {
                let source = chunk * SLAB + i;
                kernels(&mut columns, &places, source, widths[source]);
                for (mu, column) in mu.iter_mut().zip(columns.chunks_exact(n)) {
                    *mu = areas[source] * column.iter().zip(&xi).map(|(k, xi)| k * xi).sum::<f64>();
                }
            }
        });

        let column = |f: &dyn Fn(usize) -> f32| (0..n).map(f).collect::<Vec<f32>>();
        let sources = std::array::from_fn(|c| match c {
            0..=2 => column(&|j| points[j][c]),
            3 => column(&|j| widths[j] as f32),
            _ => column(&|j| mu[j][c - 4] as f32),
        });
        let field = GaussField { sources, level: 0.0 };
        // The level that runs through the middle of the points; regularisation lets it sink below 1/2.
        Ok(GaussField { level: field.at_points(), ..field })
    }

    /// level - chi(x) for every point (n x 3): negative inside, zero on the guessed surface. Not a distance.
    pub fn value(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let mut out = vec![0.0; points.len()];
        out.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK)).for_each(|(out, points)| {
            for (out, x) in out.iter_mut().zip(points) {
                *out = self.level - indicator(&self.sources, *x);
            }
        });
        out
    }
}

/// The areas that points stand for.
struct Areas {
    /// Over that of a point with the mean neighbour spacing, n.
    relative: Vec<f64>,
    /// The area of such a point, in the squared unit of the points.
    unit: f64,
}

impl Areas {
    /// Of `points` (n x 3): squares of their neighbour `spacing` (n), which is first averaged over the `averaged`
    /// nearest points, itself among them. All alike if the points all coincide.
    fn of(points: &[[f32; 3]], spacing: &[f64], averaged: usize) -> Self {
        let mean = spacing.iter().sum::<f64>() / spacing.len() as f64;
        if mean <= 0.0 {
            return Areas { relative: vec![1.0; spacing.len()], unit: 0.0 };
        }
        let k = averaged.min(points.len());
        let area = |near: &[u32]| {
            let local = near.iter().map(|&j| spacing[j as usize]).sum::<f64>() / k as f64;
            (local / mean).powi(2).max(MIN_AREA)
        };
        let relative = KdTree::new(points).k_nearest(points, k).chunks_exact(k).map(area).collect();
        Areas { relative, unit: AREA * mean * mean }
    }
}

kernel! {
    /// K(x, y) of one source y at all n points x: the x components, then y, then z (3n).
    fn kernels(out: &mut [f64], points: &[Vec<f64>; 3], source: usize, width: f64) {
        let n = points[0].len();
        let y = [points[0][source], points[1][source], points[2][source]];
        let (kx, rest) = out.split_at_mut(n);
        let (ky, kz) = rest.split_at_mut(n);
        let (px, py, pz) = (&points[0][..n], &points[1][..n], &points[2][..n]);
        let (ky, kz) = (&mut ky[..n], &mut kz[..n]);
        for i in 0..n {
            let d = [px[i] - y[0], py[i] - y[1], pz[i] - y[2]];
            let r_sq = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let r_sq = if r_sq < width * width { width * width } else { r_sq };
            let scale = -0.25 * std::f64::consts::FRAC_1_PI / (r_sq * r_sq.sqrt());
            kx[i] = d[0] * scale;
            ky[i] = d[1] * scale;
            kz[i] = d[2] * scale;
        }
    }
}

/// One dipole's share of chi, but for the factor -1 / (4 pi).
///
/// Root and quotient would take most of the time. 1 / r comes from the bits of r^2 (3% off) and two steps of Newton's
/// method (5e-6 off).
#[inline(always)]
fn dipole(d: [f32; 3], width: f32, mu: [f32; 3]) -> f32 {
    let r_sq = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    let r_sq = if r_sq < width * width { width * width } else { r_sq };
    let y = f32::from_bits(0x5f37_59df - (r_sq.to_bits() >> 1));
    let half = 0.5 * r_sq;
    let y = y * (1.5 - half * y * y);
    let y = y * (1.5 - half * y * y);
    (d[0] * mu[0] + d[1] * mu[1] + d[2] * mu[2]) * (y * y * y)
}

kernel! {
    /// chi(x), in sixteen interleaved partial sums folded in a fixed order.
    fn indicator(sources: &[Vec<f32>; 7], x: [f32; 3]) -> f32 {
        const LANES: usize = 16;
        let n = sources[0].len();
        let one = |j: usize| {
            let s: [f32; 7] = std::array::from_fn(|c| sources[c][j]);
            dipole([x[0] - s[0], x[1] - s[1], x[2] - s[2]], s[3], [s[4], s[5], s[6]])
        };
        let m = n / LANES;
        let blocks: [&[[f32; LANES]]; 7] = std::array::from_fn(|c| &sources[c].as_chunks().0[..m]);
        let mut sums = [0.0f32; LANES];
        for b in 0..m {
            let s: [&[f32; LANES]; 7] = blocks.map(|column| &column[b]);
            for (i, sum) in sums.iter_mut().enumerate() {
                let d = [x[0] - s[0][i], x[1] - s[1][i], x[2] - s[2][i]];
                *sum += dipole(d, s[3][i], [s[4][i], s[5][i], s[6][i]]);
            }
        }
        let mut total = 0.0;
        for j in m * LANES..n { total += one(j); }
        for sum in sums { total += sum; }
        -total * (0.25 * std::f32::consts::FRAC_1_PI)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::vec3::dist_sq;
    use crate::geometry::{AnalyticShape, fibonacci_sphere};
    use crate::simd::testing::{rows, same_at_all};
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set(sources in rows::<7>(1..70), x: [f32; 3], source: prop::sample::Index) {
            // Points are finite.
            let sources = sources.map(|row| row.into_iter().map(|x| if x.is_finite() { x } else { 0.5 }).collect());
            same_at_all(|| vec![indicator(&sources, [sources[1][0], 0.3, 0.1]), indicator(&sources, x)]);
            let points = [0, 1, 2].map(|c| sources[c].iter().map(|&x| f64::from(x)).collect::<Vec<f64>>());
            let n = points[0].len();
            same_at_all(|| {
                let mut out = vec![0.0; 3 * n];
                kernels(&mut out, &points, source.index(n), f64::from(sources[3][0]));
                out
            });
        }
    }

    #[test]
    fn tells_inside_from_outside_of_a_sphere_and_a_shell() {
        let sphere: Vec<[f32; 3]> = fibonacci_sphere(301).into_iter().map(|p| p.map(|x| 0.5 * x)).collect();
        let field = GaussField::fit(&sphere, 0.5, 0.05, 0).unwrap();
        for (radius, sign) in [(0.0, -1.0), (0.2, -1.0), (0.4, -1.0), (0.6, 1.0), (0.9, 1.0)] {
            let probes: Vec<[f32; 3]> =
                fibonacci_sphere(20).into_iter().map(|p| p.map(|x| radius * x)).collect();
            assert!(field.value(&probes).iter().all(|v| v * sign > 0.0), "radius {radius}");
        }
    }

    /// The formula as it is written, with every matrix in full.
    fn naive(points: &[[f32; 3]], width: f64, regularity: f64, at: &[[f32; 3]]) -> Vec<f64> {
        let widths: Vec<f64> = neighbour_spacing(points).iter().map(|s| width * s).collect();
        let kernel = |x: &[f32; 3], y: &[f32; 3], w: f64| {
            let d: [f64; 3] = std::array::from_fn(|i| f64::from(x[i]) - f64::from(y[i]));
            let r = d.iter().map(|d| d * d).sum::<f64>().sqrt().max(w);
            d.map(|d| -d / (4.0 * std::f64::consts::PI * r.powi(3)))
        };
        let n = points.len();
        let own = neighbour_spacing(points);
        let mean = own.iter().sum::<f64>() / n as f64;
        let local = |p: &[f32; 3]| {
            let mut near: Vec<usize> = (0..n).collect();
            near.sort_by(|&i, &j| dist_sq(*p, points[i]).total_cmp(&dist_sq(*p, points[j])));
            near[..n.min(16)].iter().map(|&i| own[i]).sum::<f64>() / n.min(16) as f64
        };
        let areas =
            DMatrix::from_diagonal(&DVector::from_fn(3 * n, |j, _| (local(&points[j / 3]) / mean).powi(2)));
        let a = |x: &[[f32; 3]]| {
            DMatrix::from_fn(x.len(), 3 * n, |i, j| kernel(&x[i], &points[j / 3], widths[j / 3])[j % 3])
        };
        let own = a(points);
        let mut system = &own * &areas * own.transpose();
        for i in 0..n {
            system[(i, i)] *= 1.0 + regularity;
        }
        let xi = system.lu().solve(&DVector::from_element(n, 0.5)).unwrap();
        let mu = areas * own.tr_mul(&xi);
        (a(at) * mu).iter().copied().collect()
    }

    #[test]
    fn is_the_formula_as_it_is_written() {
        for n in [1, 2, 5, 12, 100, 150] {
            // Drawn out on one side, so that the points' areas differ.
            let points: Vec<[f32; 3]> = fibonacci_sphere(n)
                .into_iter()
                .map(|p| if p[0] > 0.0 { [p[0], 0.5 * p[1], 0.5 * p[2]] } else { p.map(|x| 0.5 * x) })
                .collect();
            let probes: Vec<[f32; 3]> = fibonacci_sphere(30)
                .into_iter()
                .enumerate()
                .map(|(i, p)| p.map(|x| 0.03 * i as f32 * x))
                .collect();
            let Ok(field) = GaussField::fit(&points, 0.5, 0.05, 0) else {
                assert_eq!(n, 1, "one point has no spacing");
                continue;
            };
            for (got, want) in field.value(&probes).iter().zip(naive(&points, 0.5, 0.05, &probes)) {
                let chi = f64::from(field.level - got);
                assert!((chi - want).abs() < 1e-3 * want.abs().max(0.1), "{n} points: {chi} is not {want}");
            }
        }
    }

    /// Of points at random, also where one half is four times as dense as the other. Averages are of dense parts rather
    /// than of sparse ones, and so a little low.
    #[test]
    fn areas_of_points_add_up_to_about_that_of_the_surface() {
        for (shape, area) in [
            (AnalyticShape::Sphere { radius: 0.5 }, std::f64::consts::PI),
            (
                AnalyticShape::Torus { major: 0.34, minor: 0.14 },
                4.0 * std::f64::consts::PI.powi(2) * 0.34 * 0.14,
            ),
        ] {
            let all = shape.sample(1400, 2).0;
            let uneven = (0..all.len()).filter(|&i| all[i][0] > 0.0 || i % 4 == 0).map(|i| all[i]).collect();
            for points in [all, uneven] {
                for (averaged, range) in [(1, 0.93..1.07), (AVERAGED, 0.85..1.05)] {
                    let Areas { relative, unit } = Areas::of(&points, &neighbour_spacing(&points), averaged);
                    let share = unit * relative.iter().sum::<f64>() / area;
                    assert!(
                        range.contains(&share),
                        "{shape:?}, averaged over {averaged}: {share} of the area"
                    );
                }
            }
        }
    }

    #[test]
    fn given_normals_make_the_indicator_of_their_body() {
        let (points, sphere) = AnalyticShape::Sphere { radius: 0.5 }.sample(1200, 1);
        let chi = |field: &GaussField, x: [f32; 3]| field.level - field.value(&[x])[0];
        let field = GaussField::of_normals(&points, &sphere, 0.5, 0);
        assert!((field.level - 0.5).abs() < 0.1 && (field.at_points() - 0.5).abs() < 0.1, "{}", field.level);
        for (x, want) in [([0.0; 3], 1.0), ([0.2, 0.1, -0.3], 1.0), ([0.4, 0.4, 0.4], 0.0), ([5.0; 3], 0.0)] {
            let chi = chi(&field, x);
            assert!((chi - want).abs() < 0.1, "{chi} at {x:?}");
        }
        let inward: Vec<[f32; 3]> = sphere.iter().map(|n| n.map(|x| -x)).collect();
        assert!((GaussField::of_normals(&points, &inward, 0.5, 0).at_points() + 0.5).abs() < 0.1);
        // Above the middle of half of it all the normals are seen under half of the whole solid angle.
        let upper: Vec<usize> = (0..points.len()).filter(|&i| points[i][2] > 0.0).collect();
        let of = |all: &[[f32; 3]]| upper.iter().map(|&i| all[i]).collect::<Vec<_>>();
        let half = GaussField::of_normals(&of(&points), &of(&sphere), 0.5, 0);
        assert!((chi(&half, [0.0; 3]) - 0.5).abs() < 0.1);
        // Without a normal there is no dipole.
        let none = GaussField::of_normals(&points, &vec![[0.0; 3]; points.len()], 0.5, 0);
        assert_eq!((none.at_points(), none.level), (0.0, MIN_LEVEL));
    }

    #[test]
    fn many_points_are_thinned() {
        let sphere = fibonacci_sphere(900);
        let field = GaussField::fit_thinned(&sphere, 0.5, 0.05, 0, 300).unwrap();
        assert_eq!(field.sources[0].len(), 300);
        assert!(field.value(&[[0.0; 3]])[0] < 0.0);
    }

    #[test]
    fn points_that_coincide_are_an_error() {
        let error = GaussField::fit(&[[0.25; 3]; 5], 0.5, 0.05, 0).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Data);
    }
}
