//! The values of a trained field at the points, interpolated and subtracted: kriging with the field as the trend.
//!
//! At a denoised point q the field should be 0 and is g(q). These residuals are interpolated by a smooth function of
//! place and normal, which is taken off. Between points, and where nothing was off, the field stays as it is.

use crate::error::{Error, ErrorKind};
use crate::geometry::{KdTree, median, neighbour_spacing};
use crate::linalg::Symmetric;
use crate::simd::kernel;
use rayon::prelude::*;

/// Distance in space at which two residuals have nothing in common, in median spacings of the points: medians of the
/// neighbour spacing.
const REACH: f64 = 6.0;
/// The distance between unit normals (from 0 to 2) that counts as much as the whole reach in space: the two sides of a
/// sheet have hardly anything in common.
const TURN: f64 = 3.2;
/// The variance of the residuals' part that is not smooth, as a share of their whole variance.
const NUGGET: f64 = 0.05;
/// The largest residual that is interpolated, in median spacings of the points. A point with a larger one is a stray,
/// or of a part that the field has lost; to bend the field to it would tear it.
const MAX_RESIDUAL: f64 = 0.5;
/// The most points for which the full system is solved and summed; beyond, only pairs within the reach are used.
const MAX_WHOLE_POINTS: usize = 2048;
/// The most rounds of conjugate gradients.
const MAX_ROUNDS: usize = 200;
/// Conjugate gradients end when the norm of the remainder is this share of the norm of the values.
const REMAINDER: f64 = 1e-5;
/// Places evaluated at a time by one thread.
const CHUNK: usize = 512;

/// A smooth function of place and normal with about given values at the points.
#[derive(Clone, Debug)]
pub(super) struct Residual {
    /// Place over the reach, normal over the turn, and weight of every point, column by column.
    points: [Vec<f32>; 7],
    /// 1 / the reach, and 1 / the turn.
    scale: [f32; 2],
    /// The places, over the reach, of more than 2,048 points.
    places: Option<Vec<[f32; 3]>>,
}

impl Residual {
    /// The function for `values` at `points` with unit `normals` (n each, working frame), of those whose value is at
    /// most half the median spacing: the mean of a Gaussian process with the covariance (1 - r)^6 (6 r + 1) for r < 1,
    /// r^2 the sum of the squared distances of places, in 6 median spacings, and of normals, in 3.2, plus a share of
    /// 0.05 that no two points have in common. The function of compact support is Wendland's for up to six
    /// dimensions (1995, "Piecewise polynomial, positive definite and compactly supported radial functions of minimal
    /// degree").
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if the points all lie in one place, all are given up, or the system cannot be solved.
    pub fn fit(points: &[[f32; 3]], normals: &[[f32; 3]], values: &[f32]) -> Result<Self, Error> {
        let unit = median(neighbour_spacing(points));
        let kept: Vec<usize> =
            (0..points.len()).filter(|&i| f64::from(values[i].abs()) <= MAX_RESIDUAL * unit).collect();
        let [reach, turn] = [1.0 / (REACH * unit), 1.0 / TURN].map(|x| x as f32);
        if !reach.is_finite() {
            return Err(Error::new(ErrorKind::Data, "all points lie in one place")
                .advise("finish a field for the distinct points that it was made from"));
        }
        if kept.is_empty() {
            let text = "the field is off by more than half a median spacing at every point";
            return Err(Error::new(ErrorKind::Data, text).advise(
                "train for more steps (stages) or on a finer grid, or leave the field as it is (finish = none)",
            ));
        }
        let n = kept.len();
        let mut columns: [Vec<f32>; 7] = std::array::from_fn(|c| match c {
            0..=2 => kept.iter().map(|&i| reach * points[i][c]).collect(),
            3..=5 => kept.iter().map(|&i| turn * normals[i][c - 3]).collect(),
            _ => vec![0.0; n],
        });
        let values: Vec<f64> = kept.iter().map(|&i| f64::from(values[i])).collect();
        let places = (n > MAX_WHOLE_POINTS).then(|| places(&columns));
        let weights = match &places {
            None => whole(&columns, values).ok_or_else(|| {
                Error::new(ErrorKind::Data, "what the field is off by at the points cannot be interpolated")
                    .advise("leave the field as it is (finish = none)")
            })?,
            Some(places) => sparse(&columns, places, &values),
        };
        columns[6] = weights.into_iter().map(|w| w as f32).collect();
        Ok(Residual { points: columns, scale: [reach, turn], places })
    }

    /// The function at places x with unit normals (m x 3 each).
    pub fn at(&self, x: &[[f32; 3]], normals: &[[f32; 3]]) -> Vec<f32> {
        let mut out = vec![0.0; x.len()];
        let tree = self.places.as_ref().map(|places| KdTree::new(places));
        let chunks = out.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK)).zip(normals.par_chunks(CHUNK));
        chunks.for_each(|((out, x), normals)| {
            for ((out, x), n) in out.iter_mut().zip(x).zip(normals) {
                let [reach, turn] = self.scale;
                let at = [reach * x[0], reach * x[1], reach * x[2], turn * n[0], turn * n[1], turn * n[2]];
                *out = match &tree {
                    None => sum_of_points(&self.points, at),
                    Some(tree) => self.sum_within(tree, at),
                };
            }
        });
        out
    }
}

impl Residual {
    /// The sum over the points within the reach of x, the nearest first.
    fn sum_within(&self, tree: &KdTree, x: [f32; 6]) -> f32 {
        let near = tree.within([x[0], x[1], x[2]], 1.0);
        let one = |(i, apart): (u32, f32)| {
            let i = i as usize;
            let turned: f32 = (3..6).map(|k| (x[k] - self.points[k][i]).powi(2)).sum();
            f64::from(self.points[6][i]) * covariance(f64::from(apart + turned))
        };
        near.into_iter().map(one).sum::<f64>() as f32
    }
}

fn places(columns: &[Vec<f32>; 7]) -> Vec<[f32; 3]> {
    (0..columns[0].len()).map(|i| [0, 1, 2].map(|k| columns[k][i])).collect()
}

/// The weights for the values, by the whole system; `None` if rounding has left it indefinite.
fn whole(columns: &[Vec<f32>; 7], values: Vec<f64>) -> Option<Vec<f64>> {
    let square = |i: usize, j: usize| {
        columns[..6].iter().map(|c| (f64::from(c[i]) - f64::from(c[j])).powi(2)).sum::<f64>()
    };
    let system = Symmetric::from_columns(values.len(), |column, out| {
        for (row, out) in out.iter_mut().enumerate().skip(column) {
            *out = covariance(square(row, column)) + if row == column { NUGGET } else { 0.0 };
        }
    });
    system.solve(values)
}

/// The weights by conjugate gradients over the pairs whose covariance is not 0. [`NUGGET`] keeps the condition of the
/// system small. The same for any number of threads.
fn sparse(columns: &[Vec<f32>; 7], places: &[[f32; 3]], values: &[f64]) -> Vec<f64> {
    let tree = KdTree::new(places);
    let row = |i: usize| -> Vec<(u32, f32)> {
        let pair = |(j, apart): (u32, f32)| {
            let turned: f32 = (3..6).map(|k| (columns[k][i] - columns[k][j as usize]).powi(2)).sum();
            (j, covariance(f64::from(apart + turned)) as f32)
        };
        tree.within(places[i], 1.0).into_iter().map(pair).filter(|&(_, c)| c > 0.0).collect()
    };
    let rows: Vec<Vec<(u32, f32)>> = (0..places.len()).into_par_iter().map(row).collect();
    let times = |x: &[f64]| -> Vec<f64> {
        let one = |(row, &own): (&Vec<(u32, f32)>, &f64)| {
            row.iter().map(|&(j, c)| f64::from(c) * x[j as usize]).sum::<f64>() + NUGGET * own
        };
        rows.par_iter().zip(x).map(one).collect()
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut weights = vec![0.0; values.len()];
    let mut rest = values.to_vec();
    let mut along = rest.clone();
    let mut square = dot(&rest, &rest);
    let enough = REMAINDER * REMAINDER * square;
    for _ in 0..MAX_ROUNDS {
        if square <= enough {
            break;
        }
        let image = times(&along);
        let step = square / dot(&along, &image);
        weights.iter_mut().zip(&along).for_each(|(w, a)| *w += step * a);
        rest.iter_mut().zip(&image).for_each(|(r, i)| *r -= step * i);
        let before = std::mem::replace(&mut square, dot(&rest, &rest));
        along.iter_mut().zip(&rest).for_each(|(a, r)| *a = r + square / before * *a);
    }
    weights
}

/// The covariance of two points (place and normal, scaled) whose squared distance is `square`.
fn covariance(square: f64) -> f64 {
    let r = square.sqrt().min(1.0);
    (1.0 - r).powi(6) * (6.0 * r + 1.0)
}

kernel! {
    /// The sum over the points of weight times covariance, in eight interleaved partial sums folded in a fixed order.
    fn sum_of_points(points: &[Vec<f32>; 7], x: [f32; 6]) -> f32 {
        const LANES: usize = 8;
        let n = points[0].len();
        let one = |p: [f32; 7]| {
            let mut square = 0.0;
            for k in 0..6 {
                let d = x[k] - p[k];
                square += d * d;
            }
            let r = square.sqrt().min(1.0);
            let rest = (1.0 - r) * (1.0 - r);
            p[6] * (rest * rest * rest * (6.0 * r + 1.0))
        };
        let [p0, p1, p2, p3, p4, p5, p6] = points.each_ref().map(|c| &c[..n]);
        let at = |i: usize| [p0[i], p1[i], p2[i], p3[i], p4[i], p5[i], p6[i]];
        let whole = n / LANES * LANES;
        let mut sums = [0.0f32; LANES];
        for first in (0..whole).step_by(LANES) {
            let block: [[f32; 7]; LANES] = std::array::from_fn(|l| at(first + l));
            for (sum, p) in sums.iter_mut().zip(block) { *sum += one(p); }
        }
        let mut total = 0.0;
        for i in whole..n { total += one(at(i)); }
        for sum in sums { total += sum; }
        total
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::AnalyticShape;
    use crate::simd::testing::{rows, same_at_all};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set(points in rows::<7>(0..70), x in prop::array::uniform6(-1.0f32..1.0)) {
            same_at_all(|| vec![sum_of_points(&points, x)]);
        }
    }

    /// By the definition, with the whole system in nalgebra.
    #[test]
    fn is_the_mean_of_the_gaussian_process() {
        let (points, normals) = AnalyticShape::Torus { major: 0.34, minor: 0.14 }.sample(90, 3);
        let values: Vec<f32> = points.iter().map(|p| 0.01 * (9.0 * p[0]).sin()).collect();
        let residual = Residual::fit(&points, &normals, &values).unwrap();
        let mut spacing = neighbour_spacing(&points);
        spacing.sort_by(f64::total_cmp);
        let unit = spacing[45];
        let apart = |(a, n): (&[f32; 3], &[f32; 3]), (b, m): (&[f32; 3], &[f32; 3])| {
            let part = |x: f32, y: f32, unit: f64| ((f64::from(x) - f64::from(y)) / unit).powi(2);
            (0..3).map(|k| part(a[k], b[k], 6.0 * unit) + part(n[k], m[k], 3.2)).sum::<f64>().sqrt()
        };
        let phi = |r: f64| if r < 1.0 { (1.0 - r).powi(6) * (6.0 * r + 1.0) } else { 0.0 };
        let each: Vec<_> = points.iter().zip(&normals).collect();
        let system = nalgebra::DMatrix::from_fn(90, 90, |i, j| {
            phi(apart(each[i], each[j])) + if i == j { 0.05 } else { 0.0 }
        });
        let right = nalgebra::DVector::from_fn(90, |i, _| f64::from(values[i]));
        let weights = system.lu().solve(&right).unwrap();
        let (probes, turned) = AnalyticShape::Torus { major: 0.3, minor: 0.1 }.sample(40, 4);
        for ((x, n), got) in probes.iter().zip(&turned).zip(residual.at(&probes, &turned)) {
            let want: f64 = (0..90).map(|i| weights[i] * phi(apart((x, n), each[i]))).sum();
            assert!((f64::from(got) - want).abs() < 1e-6, "{got} is not {want}");
        }
    }

    #[test]
    fn by_pairs_within_the_reach_it_is_what_it_is_as_a_whole() {
        let shape = AnalyticShape::RoundedBox { half: [0.5, 0.4, 0.03], round: 0.02 };
        let (points, normals) = shape.sample(MAX_WHOLE_POINTS + 200, 3);
        let values: Vec<f32> = points.iter().map(|p| 0.004 * (9.0 * p[0] - 20.0 * p[1]).sin()).collect();
        let by_pairs = Residual::fit(&points, &normals, &values).unwrap();
        let places = by_pairs.places.clone().unwrap();
        let values: Vec<f64> = values.iter().map(|&v| f64::from(v)).collect();
        let weights = whole(&by_pairs.points, values.clone()).unwrap();
        for (got, want) in sparse(&by_pairs.points, &places, &values).iter().zip(&weights) {
            assert!((got - want).abs() < 1e-4 * 0.004 / NUGGET, "{got} is not {want}");
        }
        let as_whole = Residual { places: None, ..by_pairs.clone() };
        let (x, turned) = shape.sample(300, 5);
        for (got, want) in by_pairs.at(&x, &turned).iter().zip(as_whole.at(&x, &turned)) {
            assert!((got - want).abs() < 1e-6, "{got} is not {want}");
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        let points = &by_pairs.points;
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(
            pool.install(|| sparse(points, &places, &values)),
            one.install(|| sparse(points, &places, &values))
        );
    }

    #[test]
    fn sides_of_a_sheet_and_far_places_do_not_share_what_is_off() {
        // Two sheets 0.02 apart; all is off by 0.01 on the upper one only.
        let points: Vec<[f32; 3]> = (0..200)
            .map(|i| [0.1 * (i % 10) as f32, 0.1 * (i / 10 % 10) as f32, if i < 100 { 0.0 } else { 0.02 }])
            .collect();
        let normals: Vec<[f32; 3]> = (0..200).map(|i| [0.0, 0.0, if i < 100 { -1.0 } else { 1.0 }]).collect();
        let values: Vec<f32> = (0..200).map(|i| if i < 100 { 0.0 } else { 0.01 }).collect();
        let residual = Residual::fit(&points, &normals, &values).unwrap();
        let at = residual.at(
            &[[0.45, 0.45, 0.02], [0.45, 0.45, 0.0], [0.45, 0.45, 3.0]],
            &[[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 1.0]],
        );
        assert!((at[0] - 0.01).abs() < 1e-3 && at[1].abs() < 1e-3 && at[2] == 0.0, "{at:?}");
        // A stray on the upper side, 0.3 away from where the field is 0, changes nothing.
        let with = |mut points: Vec<[f32; 3]>, mut normals: Vec<[f32; 3]>, mut values: Vec<f32>| {
            points.push([0.45, 0.45, 0.35]);
            normals.push([0.0, 0.0, 1.0]);
            values.push(0.3);
            Residual::fit(&points, &normals, &values).unwrap()
        };
        let stray = with(points.clone(), normals.clone(), values.clone());
        let near = stray.at(&[[0.45, 0.45, 0.02]], &[[0.0, 0.0, 1.0]])[0];
        assert!((near - at[0]).abs() < 1e-5, "{near} {}", at[0]);
        let one_place = Residual::fit(&points[..1].repeat(5), &normals[..5], &values[..5]).unwrap_err();
        let far_off = Residual::fit(&points, &normals, &[0.3; 200]).unwrap_err();
        for (error, text) in [(one_place, "one place"), (far_off, "every point")] {
            assert!(error.message().contains(text) && error.advice().is_some(), "{error}");
        }
    }
}
