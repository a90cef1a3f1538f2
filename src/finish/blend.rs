//! The surface of least bending through the points, blended into a field where both agree and where the surface through
//! the other points predicts each point well.
//!
//! On a smooth shape that surface is nearer to the truth than a network is; at edges it overshoots, and it joins sheets
//! that lie closer together than the points. Where that happens, points are not where a plate through the others has
//! them: leaving each point out in turn measures how far the plate is to be trusted there, and plate and field are
//! weighted by that, as two measurements of one distance would be.

use crate::error::{Error, ErrorKind};
use crate::geometry::vec3::dist_sq;
use crate::geometry::{KdTree, neighbour_spacing};
use crate::start::{LeastBending, Ramp};
use rayon::prelude::*;

/// Distances to the nearest point, in neighbour spacings, between which the plate's weight falls to 0.
const NEAR: Ramp = Ramp { from: 0.7, to: 1.2 };
/// Differences between plate and field, in neighbour spacings, between which the plate's weight falls to 0: where they
/// are two surfaces and not two measurements of one, the field rules.
const AGREE: Ramp = Ramp { from: 0.15, to: 0.35 };
/// The error of the field (standard deviation, in neighbour spacings) that the plate's is weighed against.
const FIELD_ERROR: f32 = 0.025;
/// The least slope that a value is divided by to estimate a distance.
const MIN_SLOPE: f64 = 0.05;
/// The number of nearest points over which the plate's error at a point is averaged.
const AVERAGED: usize = 8;
/// The number of nearest points from which neighbour spacing and error at a place are interpolated; the farthest has no
/// weight, so that both are continuous.
const INTERPOLATED: usize = 5;

/// A thin plate through the points, to be blended into a field. All in the working frame.
#[derive(Clone, Debug)]
pub(super) struct PlateBlend {
    /// n x 3.
    points: Vec<[f32; 3]>,
    plate: LeastBending,
    /// The neighbour spacing of each, n.
    spacing: Vec<f32>,
    /// The plate's mean squared error around each point, in squared neighbour spacings, n.
    doubt: Vec<f32>,
}

impl PlateBlend {
    /// The plate through `points` (n x 3, distinct) that bends least with unit gradients near the `normals` (n x 3,
    /// outward, of any length: those of the field).
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if no plate is determined by the points.
    pub fn fit(points: &[[f32; 3]], normals: &[[f32; 3]]) -> Result<Self, Error> {
        let undetermined = || Error::new(ErrorKind::Data, "the points determine no surface of least bending");
        let (plate, found) = LeastBending::fit_with_forecasts(points, normals)?;
        let spacing: Vec<f32> = neighbour_spacing(points).into_iter().map(|s| s as f32).collect();
        // f over its slope is the distance to the surface, to first order.
        let missed: Vec<f64> = found.iter().map(|f| f.error / f.slope.max(MIN_SLOPE)).collect();
        if missed.iter().any(|x| !x.is_finite()) || spacing.iter().any(|&s| s <= 0.0) {
            return Err(undetermined());
        }
        let k = AVERAGED.min(points.len());
        let square = |&i: &u32| (missed[i as usize] / f64::from(spacing[i as usize])).powi(2);
        let near = KdTree::new(points).k_nearest(points, k);
        let doubt =
            near.chunks_exact(k).map(|row| (row.iter().map(square).sum::<f64>() / k as f64) as f32).collect();
        Ok(PlateBlend { plate, points: points.to_vec(), spacing, doubt })
    }

    /// Blends the plate into the `values` (m) of the field, signed distances at `x` (m x 3).
    ///
    /// The weight of the plate is the product of three: 1 near the points, 0 from 1.2 neighbour spacings on; 1 where
    /// both agree, 0 where they differ by 0.35 of them; and 0.025^2 / (0.025^2 + e^2), e the root mean square in
    /// neighbour spacings by which the plate through the other points misses each of the points around. The result is
    /// continuous where the field is.
    ///
    /// # Panics
    /// If there is not one value a point.
    #[track_caller]
    pub fn blend(&self, x: &[[f32; 3]], values: &mut [f32]) {
        assert!(x.len() == values.len(), "blend: {} values at {} points", values.len(), x.len());
        let k = INTERPOLATED.min(self.points.len());
        let nearest = KdTree::new(&self.points).k_nearest(x, k);
        let at = |(x, near): (&[f32; 3], &[u32])| self.around(x, near);
        let around: Vec<LocalTrust> = x.par_iter().zip(nearest.par_chunks_exact(k)).map(at).collect();
        let rows: Vec<usize> = (0..x.len()).filter(|&i| around[i].weight > 0.0).collect();
        let near: Vec<[f32; 3]> = rows.iter().map(|&i| x[i]).collect();
        let nearest: Vec<u32> = rows.iter().map(|&i| nearest[k * i]).collect();
        for (&i, plate) in rows.iter().zip(self.plate.value(&near, &nearest)) {
            let LocalTrust { spacing, weight } = around[i];
            // Near a lone point there may be no plate: the field keeps its value.
            if plate.is_nan() {
                continue;
            }
            let weight = weight * AGREE.falling((plate - values[i]).abs() / spacing);
            values[i] += weight * (plate - values[i]);
        }
    }

    /// The neighbour spacing at a place and the weight of the plate there, from the points `near` it (nearest first).
    fn around(&self, x: &[f32; 3], near: &[u32]) -> LocalTrust {
        let distance = |i: u32| dist_sq(*x, self.points[i as usize]).sqrt();
        let farthest = near.iter().map(|&i| distance(i)).fold(f32::MIN_POSITIVE, f32::max);
        let [mut sum, mut spacing, mut doubt] = [0.0f32; 3];
        for &i in near {
            // The smallest number keeps a place as far from all of them in order.
            let share = (1.0 - distance(i) / farthest).powi(2) + 1e-12;
            sum += share;
            spacing += share * self.spacing[i as usize];
            doubt += share * self.doubt[i as usize];
        }
        let (spacing, doubt) = (spacing / sum, doubt / sum);
        let trust = FIELD_ERROR * FIELD_ERROR / (FIELD_ERROR * FIELD_ERROR + doubt);
        let nearest = near.iter().map(|&i| distance(i)).fold(f32::INFINITY, f32::min);
        LocalTrust { spacing, weight: trust * NEAR.falling(nearest / spacing) }
    }
}

/// The neighbour spacing at a place, and the plate's weight there before its value is known.
struct LocalTrust {
    spacing: f32,
    weight: f32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{AnalyticShape, fibonacci_sphere};

    const RADIUS: f32 = 0.45;

    fn sphere(n: usize, radius: f32) -> Vec<[f32; 3]> {
        fibonacci_sphere(n).into_iter().map(|p| p.map(|x| radius * x)).collect()
    }

    fn fitted(n: usize) -> PlateBlend {
        PlateBlend::fit(&sphere(n, RADIUS), &sphere(n, 1.0)).unwrap()
    }

    /// The blend into a field that is a constant.
    fn into(blend: &PlateBlend, x: &[[f32; 3]], value: f32) -> Vec<f32> {
        let mut values = vec![value; x.len()];
        blend.blend(x, &mut values);
        values
    }

    #[test]
    fn a_field_a_little_off_a_smooth_shape_is_corrected() {
        // One plate, and several.
        for n in [200, 600] {
            // By about a tenth of a neighbour spacing.
            for f in into(&fitted(n), &sphere(70, RADIUS), 0.01) {
                assert!(f.abs() < 1e-3, "{f} of {n} points");
            }
        }
    }

    /// A point far from the others is in no ball but its own, or at the rim of theirs.
    #[test]
    fn around_a_lone_point_every_value_is_a_number() {
        let (mut points, mut normals) = (sphere(600, 0.2), sphere(600, 1.0));
        points.push([0.45, 0.0, 0.0]);
        normals.push([1.0, 0.0, 0.0]);
        let blend = PlateBlend::fit(&points, &normals).unwrap();
        let x: Vec<[f32; 3]> = (1..100).flat_map(|i| sphere(40, 0.004 * i as f32)).collect();
        let x: Vec<[f32; 3]> = x.into_iter().map(|[a, b, c]| [a + 0.45, b, c]).collect();
        assert!(into(&blend, &x, 0.01).iter().all(|f| f.is_finite()));
    }

    #[test]
    fn another_surface_and_what_is_far_are_left_alone() {
        let blend = fitted(200);
        let spacing = blend.spacing.iter().copied().fold(0.0, f32::max);
        // Half a neighbour spacing away, the plate is another surface than that of the field.
        let off = 0.5 * spacing;
        assert!(into(&blend, &sphere(70, RADIUS), off).iter().all(|&f| f == off));
        let far = sphere(70, RADIUS + 1.3 * spacing);
        let field = vec![1.3 * spacing; far.len()];
        let mut values = field.clone();
        blend.blend(&far, &mut values);
        assert_eq!(values, field);
    }

    /// Along lines through the points' surroundings, where the points that are nearest change.
    #[test]
    fn the_blend_is_continuous() {
        let (points, normals) =
            AnalyticShape::RoundedBox { half: [0.5, 0.3, 0.2], round: 0.02 }.sample(150, 3);
        let blend = PlateBlend::fit(&points, &normals).unwrap();
        for line in 0..20 {
            let from = points[7 * line];
            let to = points[7 * line + 3];
            let at = |i: usize| -> [f32; 3] {
                let t = i as f32 / 20_000.0;
                std::array::from_fn(|k| from[k] + t * (to[k] - from[k]) + 0.02 * normals[7 * line][k])
            };
            let x: Vec<[f32; 3]> = (0..20_000).map(at).collect();
            let mut values: Vec<f32> = x.iter().map(|x| 0.02 + 0.01 * (20.0 * x[0]).sin()).collect();
            blend.blend(&x, &mut values);
            let jump = values.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f32::max);
            assert!(jump < 1e-3, "{jump} on line {line}");
        }
    }

    #[test]
    fn the_plate_is_doubted_at_edges() {
        let (points, normals) =
            AnalyticShape::RoundedBox { half: [0.5, 0.4, 0.3], round: 0.005 }.sample(250, 3);
        let blend = PlateBlend::fit(&points, &normals).unwrap();
        let doubt = |near: bool| {
            // Within 0.08 of an edge two coordinates are near their ends.
            let at_edge =
                |p: &[f32; 3]| (0..3).filter(|&k| [0.5, 0.4, 0.3][k] - p[k].abs() < 0.08).count() > 1;
            let each = points.iter().zip(&blend.doubt).filter(|(p, _)| at_edge(p) == near);
            let each: Vec<f32> = each.map(|(_, &d)| d.sqrt()).collect();
            each.iter().sum::<f32>() / each.len() as f32
        };
        let smooth = fitted(250).doubt.iter().map(|d| d.sqrt()).fold(0.0, f32::max);
        assert!(doubt(true) > 1.2 * doubt(false), "{} {}", doubt(true), doubt(false));
        assert!(doubt(true) > 3.0 * smooth, "{} {smooth}", doubt(true));
    }

    #[test]
    fn points_in_one_place_determine_no_plate() {
        assert_eq!(
            PlateBlend::fit(&[[0.1; 3]; 30], &[[0.0, 0.0, 1.0]; 30]).unwrap_err().kind(),
            ErrorKind::Data
        );
    }
}
