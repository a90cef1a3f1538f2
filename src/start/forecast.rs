//! Leave-one-out forecasts: what a thin plate through all other points predicts at each point.

use super::plate::System;
use nalgebra::{DVector, Matrix4, Vector3, Vector4};

/// The prediction at a point from all others.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Forecast {
    /// |f| at the point, f being the function that the others determine: how far it is from their surface, to first
    /// order (working frame).
    pub error: f64,
    /// The variance of that for a plate of unit amplitude, the smoothing included.
    pub variance: f64,
    /// |grad f| there. Where the normals of the other points disagree it is less than 1, and |f| is less than the
    /// distance.
    pub slope: f64,
}

/// The covariance of the value and the gradient at each of n points given all others, for unit amplitude: with B the
/// data's block of the system's inverse and I the four data of a point (B_II)^-1; NaN where rounding has left none.
pub(crate) fn covariances(system: &System) -> Vec<Matrix4<f64>> {
    let n = system.energy().nrows() / 4;
    let covariance = |i: usize| {
        let own = data_of(n, i);
        let block = Matrix4::from_fn(|a, b| system.energy()[(own[a], own[b])]);
        block.cholesky().map_or(Matrix4::from_element(f64::NAN), |factor| factor.inverse())
    };
    (0..n).map(covariance).collect()
}

/// The forecasts at n points, with these gradients (3 n, unit): leaving out the data I of a point changes
/// the data d there by (B_II)^-1 (B d)_I, so no system is solved anew.
pub(crate) fn forecasts(system: &System, covariances: &[Matrix4<f64>], gradients: &[f64]) -> Vec<Forecast> {
    let n = gradients.len() / 3;
    let data = DVector::from_fn(4 * n, |i, _| if i < n { 0.0 } else { gradients[i - n] });
    let weights = system.energy() * &data;
    let forecast = |(i, covariance): (usize, &Matrix4<f64>)| {
        let own = data_of(n, i);
        let change = covariance * Vector4::from_fn(|a, _| weights[own[a]]);
        let gradient = Vector3::from_fn(|k, _| data[own[k + 1]] - change[k + 1]);
        Forecast { error: change[0].abs(), variance: covariance[(0, 0)], slope: gradient.norm() }
    };
    covariances.iter().enumerate().map(forecast).collect()
}

/// The rows of a point's value and gradient among those of n points.
fn data_of(n: usize, i: usize) -> [usize; 4] {
    [i, n + 3 * i, n + 3 * i + 1, n + 3 * i + 2]
}

#[cfg(test)]
mod tests {
    use super::super::plate::{directions, saddle};
    use super::*;
    use crate::geometry::AnalyticShape;
    use nalgebra::DMatrix;

    const TORUS: AnalyticShape = AnalyticShape::Torus { major: 0.34, minor: 0.14 };

    /// Against surfaces that were really made without the point, and the covariance of a Gaussian process given the
    /// rest by its definition.
    #[test]
    fn forecasts_are_those_of_leaving_points_out() {
        let (points, normals) = TORUS.sample(24, 5);
        let centres: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
        let gradients = directions(&normals);
        for smoothing in [1e-4, 1e-2] {
            let of = |centres: &[[f64; 3]]| System::new(centres).unwrap().smoothed(smoothing).unwrap();
            let system = of(&centres);
            let fast = forecasts(&system, &covariances(&system), &gradients);
            let whole = saddle(&centres, smoothing);
            for i in 0..24 {
                let (mut rest, mut along) = (centres.clone(), gradients.clone());
                rest.remove(i);
                along.drain(3 * i..3 * i + 3);
                let without = of(&rest).interpolant(&rest, &along);
                let want = f64::from(without.value(&points[i..=i])[0].abs());
                let shifted = |k: usize, step: f32| {
                    let mut p = points[i];
                    p[k] += step;
                    without.value(&[p])[0]
                };
                let slope =
                    (0..3).map(|k| ((shifted(k, 1e-3) - shifted(k, -1e-3)) / 2e-3).powi(2)).sum::<f32>();
                let slope = f64::from(slope.sqrt());
                assert!((fast[i].slope - slope).abs() < 1e-4, "{} is not {slope}", fast[i].slope);
                assert!(
                    (fast[i].error - want).abs() < 1e-5 * want.max(0.1),
                    "{} is not {want}",
                    fast[i].error
                );
                let own = [i, 24 + 3 * i, 25 + 3 * i, 26 + 3 * i];
                let others: Vec<usize> = (0..100).filter(|row| !own.contains(row)).collect();
                let between = DVector::from_fn(96, |a, _| whole[(others[a], i)]);
                let among = DMatrix::from_fn(96, 96, |a, b| whole[(others[a], others[b])]);
                let want = whole[(i, i)] - between.dot(&among.lu().solve(&between).unwrap());
                let got = fast[i].variance;
                assert!((got - want).abs() < 1e-6 * want, "{got} is not {want}");
            }
        }
    }
}
