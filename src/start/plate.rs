//! A first shape from unoriented points and rough normals: the surface of least bending.
//!
//! The function is a sum of cubes of distances and their gradients at the n points, plus a plane, f(x) = sum_j a_j |x -
//! p_j|^3 - b_j . grad |x - p_j|^3 + c . (1, x), the one of least bending energy among all that vanish at the points
//! and have given gradients there. That energy is a quadratic form of the gradients alone, and unit gradients that make
//! it small are good normals: points on one sheet agree, and points on two sheets close together face away from each
//! other (Huang, Carr, Ju 2019, "Variational implicit point set surfaces"). Where that work looks for the minimum from
//! an eigenvector, here the search starts from normals that are mostly right already, those of the parametric Gauss
//! formula, and ends nearby.

use crate::error::{Error, ErrorKind};
use crate::geometry::vec3::length;
use crate::linalg::{LbfgsOptions, Symmetric, lbfgs};
use crate::simd::kernel;
use nalgebra::{DMatrix, DMatrixView, DVector, Matrix4};
use rayon::prelude::*;

/// Centres at most: the system of 4 n unknowns costs O(n^3).
pub(crate) const MAX_CENTRES: usize = 500;
/// Added to the cubes of distances on the diagonal, so that points very close together leave the system solvable; the
/// points may be missed a little for it (1e-5 of the longest side where 300 points are spread evenly).
const SLACK: f64 = 1e-6;
/// Factors for P P^T, which is added to K to make it positive definite (see [`System::new`]); tried in turn.
const LIFTS: [f64; 4] = [1e1, 1e2, 1e3, 1e4];
/// Points evaluated at a time by one thread.
const CHUNK: usize = 512;

/// A function that vanishes at points, has unit gradient there, and bends as little as it can.
#[derive(Clone, Debug)]
pub struct ThinPlate {
    /// x, y, z, a, b_x, b_y, b_z of every centre, column by column.
    centres: [Vec<f64>; 7],
    plane: [f64; 4],
}

impl ThinPlate {
    /// The functions for `points` (n x 3, working frame) with gradients of unit length whose bending is least near the
    /// directions of each of several guesses of the normals (each n x 3, outward, need not be exact; zero is no
    /// direction), in their order: the minimum of the bending that a search ends in depends on where it starts. What
    /// the guesses share is computed once.
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if the system cannot be solved, as for points that all coincide.
    ///
    /// # Panics
    /// If there are more than 500 points, for the system of 4 n unknowns costs O(n^3), or if a guess does not have one
    /// normal a point.
    #[track_caller]
    pub fn fit_each<N: AsRef<[[f32; 3]]> + Sync>(
        points: &[[f32; 3]],
        guesses: &[N],
    ) -> Result<Vec<Self>, Error> {
        assert!(points.len() <= MAX_CENTRES, "ThinPlate: {} points, {MAX_CENTRES} at most", points.len());
        for normals in guesses {
            let (n, m) = (points.len(), normals.as_ref().len());
            assert!(n == m, "ThinPlate: {n} points, {m} normals");
        }
        let points: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
        let system = System::determined(&points)?;
        let function =
            |normals: &N| system.interpolant(&points, &system.least_bending(directions(normals.as_ref())));
        Ok(guesses.par_iter().map(function).collect())
    }

    /// f at every point (m x 3): negative inside, zero at the centres, and near them about the signed distance.
    pub fn value(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let mut out = vec![0.0; points.len()];
        out.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK)).for_each(|(out, points)| {
            for (out, x) in out.iter_mut().zip(points) {
                *out = self.value_at(x.map(f64::from)) as f32;
            }
        });
        out
    }

    /// f at one point.
    pub fn value_at(&self, x: [f64; 3]) -> f64 {
        let [c, cx, cy, cz] = self.plane;
        sum_of_centres(&self.centres, x) + c + cx * x[0] + cy * x[1] + cz * x[2]
    }
}

kernel! {
    /// The centres' part of f(x), in eight interleaved partial sums folded in a fixed order.
    fn sum_of_centres(centres: &[Vec<f64>; 7], x: [f64; 3]) -> f64 {
        const LANES: usize = 8;
        let n = centres[0].len();
        let one = |c: [f64; 7]| {
            let d = [x[0] - c[0], x[1] - c[1], x[2] - c[2]];
            let r_sq = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            r_sq.sqrt() * (r_sq * c[3] - 3.0 * (d[0] * c[4] + d[1] * c[5] + d[2] * c[6]))
        };
        let [x0, x1, x2, a, b0, b1, b2] = centres.each_ref().map(|c| &c[..n]);
        let at = |i: usize| [x0[i], x1[i], x2[i], a[i], b0[i], b1[i], b2[i]];
        let whole = n / LANES * LANES;
        let mut sums = [0.0f64; LANES];
        for first in (0..whole).step_by(LANES) {
            let block: [[f64; 7]; LANES] = std::array::from_fn(|l| at(first + l));
            for (sum, c) in sums.iter_mut().zip(block) { *sum += one(c); }
        }
        let mut total = 0.0;
        for i in whole..n { total += one(at(i)); }
        for sum in sums { total += sum; }
        total
    }
}

/// The interpolation problem solved for all data at once: with K the kernels and P the planes at the data (n values,
/// then 3 n components of gradients), the inverse of [[K, P], [P^T, 0]].
pub(crate) struct System {
    /// The data's block of the inverse, 4n x 4n: energy of the data, and weights of the centres from the data.
    energy: DMatrix<f64>,
    /// The planes' block of the inverse, 4 x 4n: coefficients of the plane from the data.
    planes: DMatrix<f64>,
}

impl System {
    /// `None` if the points leave it singular.
    pub fn new(points: &[[f64; 3]]) -> Option<Self> {
        let n = points.len();
        let planes = DMatrix::from_fn(4 * n, 4, |row, k| plane_at(points, row, k));
        // K is positive definite on the complement of the planes; K plus a large enough multiple of P P^T is so
        // everywhere, and has the same solutions w, as these satisfy P^T w = 0.
        let inverse = LIFTS.iter().find_map(|&lift| {
            let system = Symmetric::from_columns(4 * n, |column, out| {
                for (row, out) in out.iter_mut().enumerate().skip(column) {
                    let flat: f64 = (0..4).map(|k| planes[(row, k)] * planes[(column, k)]).sum();
                    *out = kernel_at(points, row, column) + lift * flat;
                }
            });
            system.inverse()
        })?;
        let z = &inverse * &planes;
        let s = Matrix4::from_fn(|i, j| z.column(j).dot(&planes.column(i))).try_inverse()?;
        let s = DMatrix::from_fn(4, 4, |i, j| s[(i, j)]);
        let planes = s * z.transpose();
        let energy = inverse - z * &planes;
        (energy.iter().all(|x| x.is_finite())).then_some(System { energy, planes })
    }

    /// As [`new`](Self::new).
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if the points leave it singular, as points that all coincide do.
    pub fn determined(points: &[[f64; 3]]) -> Result<Self, Error> {
        Self::new(points).ok_or_else(|| {
            Error::new(ErrorKind::Data, "the points determine no surface of least bending")
                .advise("check that the points do not all lie in one place")
        })
    }

    /// The problem whose function need not vanish at the points: what is least then is the bending energy plus the sum
    /// of f^2 at the points over `smoothing`. The same as `smoothing` added to the values' diagonal of K, by the
    /// identity of Sherman, Morrison and Woodbury at a part of the cost; `None` if it is too small to tell from none.
    pub fn smoothed(&self, smoothing: f64) -> Option<Self> {
        let n = self.energy.nrows() / 4;
        let inner = Symmetric::from_columns(n, |column, out| {
            for (row, out) in out.iter_mut().enumerate().skip(column) {
                *out = self.energy[(row, column)] + if row == column { 1.0 / smoothing } else { 0.0 };
            }
        });
        let share = inner.inverse()? * self.energy.rows(0, n);
        let mut energy = self.energy.clone();
        energy.gemm(-1.0, &self.energy.columns(0, n), &share, 1.0);
        let mut planes = self.planes.clone();
        planes.gemm(-1.0, &self.planes.columns(0, n), &share, 1.0);
        Some(System { energy, planes })
    }

    /// The data's block of the inverse, 4n x 4n: n values, then 3 n components of gradients.
    pub fn energy(&self) -> &DMatrix<f64> {
        &self.energy
    }

    /// Unit gradients (3 n) of least bending near the given directions (3 n).
    pub fn least_bending(&self, mut near: Vec<f64>) -> Vec<f64> {
        let n = near.len() / 3;
        let form = self.energy.view((n, n), (3 * n, 3 * n));
        lbfgs(&mut near, |u, gradient| bending(&form, u, gradient), &LbfgsOptions::default());
        unit(&near).0
    }

    /// The function of these gradients (3 n) at the points.
    pub fn interpolant(&self, points: &[[f64; 3]], gradients: &[f64]) -> ThinPlate {
        let n = points.len();
        let data = DVector::from_fn(4 * n, |i, _| if i < n { 0.0 } else { gradients[i - n] });
        let (w, plane) = (&self.energy * &data, &self.planes * &data);
        let centres = std::array::from_fn(|k| match k {
            0..=2 => points.iter().map(|p| p[k]).collect(),
            3 => w.as_slice()[..n].to_vec(),
            _ => (0..n).map(|j| w[n + 3 * j + k - 4]).collect(),
        });
        ThinPlate { centres, plane: std::array::from_fn(|k| plane[k]) }
    }
}

/// Unit vectors along the normals, one after the other; any direction for a normal of zero.
pub(crate) fn directions(normals: &[[f32; 3]]) -> Vec<f64> {
    let direction = |normal: &[f32; 3]| {
        let normal = normal.map(f64::from);
        let len = length(normal);
        if len > 0.0 { normal.map(|x| x / len) } else { [1.0, 0.0, 0.0] }
    };
    normals.iter().flat_map(direction).collect()
}

/// Directions (3 n) and lengths (n) of vectors (3 n).
fn unit(u: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let mut directions = u.to_vec();
    let lengths = directions
        .as_chunks_mut::<3>()
        .0
        .iter_mut()
        .map(|d| {
            let len = length(*d).max(1e-300);
            *d = d.map(|x| x / len);
            len
        })
        .collect();
    (directions, lengths)
}

/// The bending energy of the directions of u (3 n), and its gradient at u.
fn bending(form: &DMatrixView<'_, f64>, u: &[f64], gradient: &mut [f64]) -> f64 {
    let (directions, lengths) = unit(u);
    let directions = DVector::from_vec(directions);
    let pull = form * &directions;
    let triples = |x: &[f64]| x.as_chunks::<3>().0.to_vec();
    let each = triples(directions.as_slice()).into_iter().zip(triples(pull.as_slice())).zip(&lengths);
    for (out, ((d, h), len)) in gradient.as_chunks_mut::<3>().0.iter_mut().zip(each) {
        let along: f64 = (0..3).map(|k| d[k] * h[k]).sum();
        *out = std::array::from_fn(|k| 2.0 * (h[k] - along * d[k]) / len);
    }
    directions.dot(&pull)
}

/// Which point a row of the data belongs to, and which component of the gradient it is, if it is one.
fn datum(n: usize, row: usize) -> (usize, Option<usize>) {
    if row < n { (row, None) } else { ((row - n) / 3, Some((row - n) % 3)) }
}

/// The datum `row` of the kernel function of the datum `column`: derivatives of |x - y|^3.
fn kernel_at(points: &[[f64; 3]], row: usize, column: usize) -> f64 {
    let (i, at) = datum(points.len(), row);
    let (j, of) = datum(points.len(), column);
    let d: [f64; 3] = std::array::from_fn(|k| points[i][k] - points[j][k]);
    let r = d.iter().map(|d| d * d).sum::<f64>().sqrt();
    match (at, of) {
        (None, None) => r * r * r + if i == j { SLACK } else { 0.0 },
        (None, Some(l)) => -3.0 * r * d[l],
        (Some(k), None) => 3.0 * r * d[k],
        (Some(k), Some(l)) => {
            let outer = if r > 0.0 { d[k] * d[l] / r } else { 0.0 };
            -3.0 * (outer + if k == l { r } else { 0.0 })
        }
    }
}

/// The datum `row` of the plane function `k`: 1, x, y or z.
fn plane_at(points: &[[f64; 3]], row: usize, k: usize) -> f64 {
    match (datum(points.len(), row), k) {
        ((_, None), 0) => 1.0,
        ((i, None), k) => points[i][k - 1],
        ((_, Some(axis)), k) => f64::from(u8::from(k == axis + 1)),
    }
}

/// [[K, P], [P^T, 0]] with `smoothing` added to the values' diagonal.
#[cfg(test)]
pub(crate) fn saddle(points: &[[f64; 3]], smoothing: f64) -> DMatrix<f64> {
    let (n, all) = (points.len(), 4 * points.len());
    DMatrix::from_fn(all + 4, all + 4, |i, j| match (i < all, j < all) {
        (true, true) => kernel_at(points, i, j) + if i == j && i < n { smoothing } else { 0.0 },
        (true, false) => plane_at(points, i, j - all),
        (false, true) => plane_at(points, j, i - all),
        (false, false) => 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{AnalyticShape, fibonacci_sphere};
    use crate::simd::testing::{rows, same_at_all};
    use proptest::prelude::*;

    fn fit(points: &[[f32; 3]], normals: &[[f32; 3]]) -> Result<ThinPlate, Error> {
        Ok(ThinPlate::fit_each(points, &[normals])?.remove(0))
    }

    fn sphere(n: usize, radius: f32) -> Vec<[f32; 3]> {
        fibonacci_sphere(n).into_iter().map(|p| p.map(|x| radius * x)).collect()
    }

    /// f and its gradient at any point, by the formula as it is written.
    fn naive(plate: &ThinPlate, x: [f64; 3]) -> (f64, [f64; 3]) {
        let [c, slopes @ ..] = plate.plane;
        let mut f = c + (0..3).map(|k| slopes[k] * x[k]).sum::<f64>();
        let mut gradient = slopes;
        for j in 0..plate.centres[0].len() {
            let p: [f64; 7] = std::array::from_fn(|k| plate.centres[k][j]);
            let d = [x[0] - p[0], x[1] - p[1], x[2] - p[2]];
            let r = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
            let db = d[0] * p[4] + d[1] * p[5] + d[2] * p[6];
            f += p[3] * r.powi(3) - 3.0 * r * db;
            for k in 0..3 {
                let turn = if r > 0.0 { db * d[k] / r } else { 0.0 };
                gradient[k] += 3.0 * p[3] * r * d[k] - 3.0 * (turn + r * p[4 + k]);
            }
        }
        (f, gradient)
    }

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set(centres in rows::<7>(0..70), x in prop::array::uniform3(-2.0f64..2.0)) {
            let centres = centres.map(|row| row.into_iter().map(f64::from).collect());
            same_at_all(|| vec![sum_of_centres(&centres, x)]);
        }
    }

    #[test]
    fn interpolates_points_and_unit_gradients() {
        let (points, normals) = AnalyticShape::Torus { major: 0.34, minor: 0.14 }.sample(150, 3);
        let plate = fit(&points, &normals).unwrap();
        for (p, n) in points.iter().zip(&normals) {
            let (f, gradient) = naive(&plate, p.map(f64::from));
            let len = gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
            let cos: f64 = (0..3).map(|k| gradient[k] * f64::from(n[k])).sum::<f64>() / len;
            assert!(f.abs() < 1e-3, "f is {f} at a point");
            assert!((len - 1.0).abs() < 1e-6, "the gradient is {len} long");
            assert!(cos > 0.9, "the normal is off: {cos}");
        }
        let probes = sphere(40, 0.4);
        for (got, x) in plate.value(&probes).iter().zip(&probes) {
            let want = naive(&plate, x.map(f64::from)).0;
            assert!((f64::from(*got) - want).abs() < 1e-6 * want.abs().max(1.0), "{got} is not {want}");
        }
    }

    #[test]
    fn even_points_are_missed_by_little() {
        let points = sphere(300, 0.5);
        let plate = fit(&points, &sphere(300, 1.0)).unwrap();
        let worst = plate.value(&points).into_iter().fold(0.0f32, |m, f| m.max(f.abs()));
        assert!(worst < 2e-5, "{worst}");
    }

    #[test]
    fn several_guesses_give_what_each_gives_alone() {
        let points = sphere(60, 0.4);
        let right = sphere(60, 1.0);
        let turned: Vec<[f32; 3]> = right.iter().map(|n| n.map(|x| -x)).collect();
        let both = ThinPlate::fit_each(&points, &[&right, &turned]).unwrap();
        let probes = sphere(30, 0.3);
        for (plate, normals) in both.iter().zip([&right, &turned]) {
            assert_eq!(plate.value(&probes), fit(&points, normals).unwrap().value(&probes));
        }
        assert!(both[0].value(&probes)[0] < 0.0 && both[1].value(&probes)[0] > 0.0);
    }

    #[test]
    fn is_close_to_the_distance_of_a_sphere_and_mends_wrong_normals() {
        let points = sphere(200, 0.45);
        let mut normals = sphere(200, 1.0);
        // Every tenth is tilted far, one points inward.
        for n in normals.iter_mut().step_by(10) {
            *n = [n[1], n[2], n[0]];
        }
        normals[7] = normals[7].map(|x| -x);
        let plate = fit(&points, &normals).unwrap();
        for radius in [0.3f32, 0.4, 0.5, 0.6] {
            for f in plate.value(&sphere(50, radius)) {
                assert!((f - (radius - 0.45)).abs() < 0.02, "{f} at radius {radius}");
            }
        }
    }

    #[test]
    fn the_energy_has_the_gradient_that_is_said() {
        let points = sphere(12, 0.4);
        let points: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
        let system = System::new(&points).unwrap();
        let form = system.energy.view((12, 12), (36, 36));
        let u: Vec<f64> = (0..36).map(|i| ((i * 37 % 19) as f64 - 9.0) / 5.0 + 0.05).collect();
        let mut gradient = vec![0.0; 36];
        let value = bending(&form, &u, &mut gradient);
        assert!(value > 0.0, "the energy is {value}");
        for i in 0..36 {
            let at = |h: f64| {
                let mut u = u.clone();
                u[i] += h;
                bending(&form, &u, &mut [0.0; 36])
            };
            let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!((difference - gradient[i]).abs() < 1e-5 * gradient[i].abs().max(1.0), "{i}");
        }
    }

    #[test]
    fn smoothing_is_what_it_adds_to_the_diagonal() {
        let points: Vec<[f64; 3]> = sphere(9, 0.4).iter().map(|p| p.map(f64::from)).collect();
        let n = 4 * points.len();
        let whole = saddle(&points, 1e-3);
        let inverse = whole.try_inverse().unwrap();
        let system = System::new(&points).unwrap().smoothed(1e-3).unwrap();
        let most = inverse.amax();
        assert!((&system.energy - inverse.view((0, 0), (n, n))).amax() < 1e-6 * most);
        assert!((&system.planes - inverse.view((n, 0), (4, n))).amax() < 1e-6 * most);
    }

    /// The data's energy as a plain solution of the whole system has it.
    #[test]
    fn the_inverse_is_that_of_the_whole_system() {
        let points: Vec<[f64; 3]> = sphere(9, 0.4).iter().map(|p| p.map(f64::from)).collect();
        let n = 4 * points.len();
        let whole = saddle(&points, 0.0);
        assert_eq!(whole, whole.transpose());
        let inverse = whole.try_inverse().unwrap();
        let system = System::new(&points).unwrap();
        let most = inverse.amax();
        assert!((&system.energy - inverse.view((0, 0), (n, n))).amax() < 1e-6 * most);
        assert!((&system.planes - inverse.view((n, 0), (4, n))).amax() < 1e-6 * most);
    }

    #[test]
    fn points_in_one_place_are_an_error() {
        let error = fit(&[[0.25; 3]; 6], &[[0.0, 0.0, 1.0]; 6]).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Data);
    }
}
