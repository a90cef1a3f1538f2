//! Corrections to a trained field so that it goes through the denoised points (the points, in this folder).
//!
//! After the training the field misses the points by some hundredths of their neighbour spacing. Two corrections
//! follow, neither of them in the paper: the field's values at the points are interpolated and subtracted
//! ([`Residual`]), without those of points that are too far from its surface, and the surface of least bending is
//! blended in where it can be trusted ([`PlateBlend`]).

use super::blend::PlateBlend;
use super::residual::Residual;
use crate::error::{Error, ErrorKind};
use crate::geometry::vec3::length;
use crate::start::MAX_PLATE_POINTS;
use std::ops::RangeInclusive;

/// The numbers of points that fields are finished for: fewer predict nothing, more take too much memory (some
/// 130 pairs within the reach of a point of an even surface, 8 bytes each).
pub const FINISHED_POINTS: RangeInclusive<usize> = 20..=1 << 20;

/// The largest coordinate of a place that the neighbour search takes, working frame.
const MAX_COORDINATE: f32 = 1e6;

/// The advice in errors for a field that cannot be finished.
const LEAVE_IT: &str = "leave the field as it is (finish = none)";

/// What a trained field is changed by so that it goes through given points. All in the working frame.
///
/// It depends on the points and on the field's values and gradients there, so only the points are saved; the
/// corrections are computed again from them and the field.
#[derive(Clone, Debug)]
pub struct Finish {
    /// The points, n x 3, which are saved.
    #[cfg(feature = "checkpoint")]
    points: Vec<[f32; 3]>,
    residual: Residual,
    /// The surface of least bending; `None` for more than 262,144 points, and for points that determine none.
    plate: Option<PlateBlend>,
}

impl Finish {
    /// The change for `points` (n x 3, distinct) and a field's `values` (n) and `gradients` (n x 3) there.
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if n is not in [`FINISHED_POINTS`], the points all lie in one place, a value is not finite,
    /// or none is within half a median spacing of 0.
    ///
    /// # Panics
    /// If there is not one value and one gradient a point.
    #[track_caller]
    pub fn fit(points: &[[f32; 3]], values: &[f32], gradients: &[[f32; 3]]) -> Result<Self, Error> {
        let n = points.len();
        assert!(values.len() == n && gradients.len() == n, "Finish::fit: not one value and gradient a point");
        if !FINISHED_POINTS.contains(&n) {
            let (least, most) = (FINISHED_POINTS.start(), FINISHED_POINTS.end());
            let text = format!("{n} points, {least} to {most} expected");
            return Err(Error::new(ErrorKind::Data, text).advise(LEAVE_IT));
        }
        if !values.iter().chain(gradients.as_flattened()).all(|x| x.is_finite()) {
            let text = "the field is not finite at the points";
            return Err(Error::new(ErrorKind::Data, text).advise(LEAVE_IT));
        }
        let normals = directions(gradients);
        Ok(Finish {
            residual: Residual::fit(points, &normals, values)?,
            plate: (n <= MAX_PLATE_POINTS).then(|| PlateBlend::fit(points, &normals).ok()).flatten(),
            #[cfg(feature = "checkpoint")]
            points: points.to_vec(),
        })
    }

    /// The points that it was made for, n x 3.
    #[cfg(feature = "checkpoint")]
    pub fn points(&self) -> &[[f32; 3]] {
        &self.points
    }

    /// Changes the `values` (m) of the field at `x` (m x 3), whose gradients there are `gradients` (m x 3). The result
    /// is continuous where the field and the direction of its gradient are. Places that are not finite or beyond 1e6
    /// keep their values.
    ///
    /// # Panics
    /// If there is not one value and one gradient a place.
    #[track_caller]
    pub fn apply(&self, x: &[[f32; 3]], values: &mut [f32], gradients: &[[f32; 3]]) {
        let m = x.len();
        assert!(
            values.len() == m && gradients.len() == m,
            "Finish::apply: not one value and gradient a place"
        );
        // Written so that NaN is left out.
        let near: Vec<usize> = (0..m).filter(|&i| x[i].iter().all(|v| v.abs() < MAX_COORDINATE)).collect();
        if near.len() < m {
            let of = |all: &[[f32; 3]]| near.iter().map(|&i| all[i]).collect::<Vec<_>>();
            let mut part: Vec<f32> = near.iter().map(|&i| values[i]).collect();
            self.apply(&of(x), &mut part, &of(gradients));
            near.iter().zip(part).for_each(|(&i, value)| values[i] = value);
            return;
        }
        for (value, off) in values.iter_mut().zip(self.residual.at(x, &directions(gradients))) {
            *value -= off;
        }
        if let Some(plate) = &self.plate {
            plate.blend(x, values);
        }
    }
}

/// Unit vectors along the gradients; 0 for one of 0.
fn directions(gradients: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let unit = |g: &[f32; 3]| {
        let length = length(*g);
        if length > 0.0 { g.map(|x| x / length) } else { [0.0; 3] }
    };
    gradients.iter().map(unit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::AnalyticShape;

    /// A field that is the distance to a shape, less a slow wave of a sixth of the distance between 300 points.
    fn wavy(shape: AnalyticShape, x: &[[f32; 3]]) -> (Vec<f32>, Vec<[f32; 3]>) {
        let value = |x: [f32; 3]| shape.sdf(x) + 0.012 * (6.0 * x[0] + 4.0 * x[2]).sin();
        let slope = |x: &[f32; 3]| {
            std::array::from_fn(|k| {
                let at = |step: f32| {
                    let mut x = *x;
                    x[k] += step;
                    value(x)
                };
                (at(1e-3) - at(-1e-3)) / 2e-3
            })
        };
        (x.iter().map(|&x| value(x)).collect(), x.iter().map(slope).collect())
    }

    fn mean(values: &[f32]) -> f32 {
        values.iter().map(|f| f.abs()).sum::<f32>() / values.len() as f32
    }

    #[test]
    fn a_finished_field_is_near_the_surface_at_the_points_and_between_them() {
        for (shape, share) in [
            (AnalyticShape::Torus { major: 0.34, minor: 0.14 }, 0.15),
            (AnalyticShape::RoundedBox { half: [0.5, 0.3, 0.2], round: 0.02 }, 0.35),
        ] {
            // 300 points have one plate, 600 have several.
            for n in [300, 600] {
                let points = shape.sample(n, 3).0;
                let (values, gradients) = wavy(shape, &points);
                let finish = Finish::fit(&points, &values, &gradients).unwrap();
                assert!(finish.plate.is_some());
                for places in [&points, &shape.sample(500, 9).0] {
                    let (mut values, gradients) = wavy(shape, places);
                    let before = mean(&values);
                    finish.apply(places, &mut values, &gradients);
                    let after = mean(&values);
                    assert!(after < share * before, "{after} for {before}");
                }
            }
        }
    }

    #[test]
    fn what_is_right_stays_so() {
        let shape = AnalyticShape::Sphere { radius: 0.45 };
        let points = shape.sample(200, 3).0;
        let exact = |x: &[[f32; 3]]| -> (Vec<f32>, Vec<[f32; 3]>) {
            let unit = |p: &[f32; 3]| {
                let length = p.iter().map(|v| v * v).sum::<f32>().sqrt();
                p.map(|v| v / length)
            };
            (x.iter().map(|&p| shape.sdf(p)).collect(), x.iter().map(unit).collect())
        };
        let (values, gradients) = exact(&points);
        let finish = Finish::fit(&points, &values, &gradients).unwrap();
        let x: Vec<[f32; 3]> = shape.sample(200, 8).0.iter().map(|p| p.map(|v| 1.05 * v)).collect();
        let (before, gradients) = exact(&x);
        let mut after = before.clone();
        finish.apply(&x, &mut after, &gradients);
        assert!(before.iter().zip(&after).all(|(a, b)| (a - b).abs() < 1e-3));
    }

    #[test]
    fn places_that_no_search_takes_keep_their_values() {
        let shape = AnalyticShape::Sphere { radius: 0.45 };
        let points = shape.sample(100, 3).0;
        let (values, gradients) = wavy(shape, &points);
        let finish = Finish::fit(&points, &values, &gradients).unwrap();
        let x = [points[3], [f32::NAN, 0.0, 0.0], [1e12, 0.0, 0.0], points[7], [0.0, f32::INFINITY, 0.0]];
        let mut mixed = [values[3], 5.0, 6.0, values[7], 7.0];
        let slopes = [gradients[3], [0.0; 3], [1.0, 0.0, 0.0], gradients[7], [0.0; 3]];
        finish.apply(&x, &mut mixed, &slopes);
        let mut alone = [values[3], values[7]];
        finish.apply(&[points[3], points[7]], &mut alone, &[gradients[3], gradients[7]]);
        assert_eq!(mixed, [alone[0], 5.0, 6.0, alone[1], 7.0]);
        assert!(mixed[0].abs() < values[3].abs());
    }

    #[test]
    fn what_cannot_be_finished_is_an_error() {
        let normals = [[0.0, 0.0, 1.0]; 30];
        let apart: Vec<[f32; 3]> =
            (0..30).map(|i| [0.1 * i as f32, 0.01 * (i * i % 7) as f32, 0.0]).collect();
        let fit = |points: &[[f32; 3]], value: f32| {
            Finish::fit(points, &vec![value; points.len()], &normals[..points.len()]).unwrap_err().kind()
        };
        assert_eq!(fit(&apart[..19], 0.0), ErrorKind::Data);
        assert_eq!(fit(&[[0.2; 3]; 30], 0.0), ErrorKind::Data);
        assert_eq!(fit(&apart, f32::NAN), ErrorKind::Data);
        // Points of a plane determine no plate, but what the field is off by.
        assert!(Finish::fit(&apart, &[0.01; 30], &normals).is_ok());
    }
}
