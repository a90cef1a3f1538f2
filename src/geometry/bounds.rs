//! Axis-aligned boxes and the map between the input's frame and the working frame.

use super::Position;
use crate::error::{Error, ErrorKind};

/// The smallest axis-aligned box around some points, in double precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// The least coordinate on each axis.
    pub min: [f64; 3],
    /// The greatest coordinate on each axis.
    pub max: [f64; 3],
}

impl Bounds {
    /// The box around `points` (n x 3).
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if there is no point or if one has a coordinate that is not finite (the point is named).
    pub fn of<P: Position>(points: &[P]) -> Result<Self, Error> {
        let mut b = Bounds { min: [f64::INFINITY; 3], max: [f64::NEG_INFINITY; 3] };
        for (i, p) in points.iter().enumerate() {
            let wide = p.wide();
            if !wide.iter().all(|x| x.is_finite()) {
                return Err(Error::new(ErrorKind::Data, format!("coordinates {p:?} are not finite"))
                    .at_element(format!("point {i}"))
                    .advise("remove the point"));
            }
            b.min = std::array::from_fn(|a| b.min[a].min(wide[a]));
            b.max = std::array::from_fn(|a| b.max[a].max(wide[a]));
        }
        if points.is_empty() {
            return Err(Error::new(ErrorKind::Data, "no points, so no bounding box")
                .advise("give at least two different points"));
        }
        Ok(b)
    }

    /// The middle of the box.
    fn center(&self) -> [f64; 3] {
        std::array::from_fn(|a| 0.5 * (self.min[a] + self.max[a]))
    }

    /// The length of each side.
    pub fn size(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.max[a] - self.min[a])
    }

    /// The length of the longest side.
    pub fn longest(&self) -> f64 {
        self.size().into_iter().fold(0.0, f64::max)
    }

    /// What to subtract from coordinates in this box so that 32 bits hold their detail: 0 as long as they do anyway (no
    /// coordinate is beyond four times the longest side), else the middle, rounded to a multiple of a power of ten
    /// about as long as the longest side.
    pub fn offset(&self) -> [f64; 3] {
        let longest = self.longest();
        let far = self.min.iter().chain(&self.max).any(|x| x.abs() > MAX_SIDES_AWAY * longest);
        if !(far && longest > 0.0 && longest.is_finite()) {
            return [0.0; 3];
        }
        let step = 10f64.powi(longest.log10().floor() as i32);
        // Adding 0 turns -0 into 0.
        self.center().map(|c| (c / step).round() * step + 0.0)
    }
}

/// Coordinates up to this many longest sides away from the origin keep their detail in 32 bits: they are rounded by
/// less than 3e-7 of the longest side.
const MAX_SIDES_AWAY: f64 = 4.0;

/// [`Normalizer::place`] rounds to the longest side, or the next power of two above it, divided by this.
const PLACES: f64 = (1u64 << 30) as f64;

/// The map from the input's frame to the working frame and back.
///
/// In the working frame the bounding box of the points it was made from is centred at the origin and its longest side
/// is 1. With centre `c` and longest side `l`, `forward(x) = (x - c) / l` and `inverse(y) = y * l + c`, both evaluated
/// in double precision and rounded once to f32.
///
/// Round trip, for `x` inside the box: the one rounding that matters is that of `y` to f32, at most `2^-26` as `|y| <=
/// 1/2`, which is `l * 2^-26` in the input's frame.
/// - Wherever `|x| > l / 2` that is less than half a unit in the last place of `x`, so `inverse(forward(x)) == x` bit
///   for bit. A box far from the origin (map coordinates, a scan in metres) is therefore reproduced exactly.
/// - Elsewhere the result is within one unit in the last place of the box's largest absolute coordinate, which is at
///   least `l / 2`. Exactness is not possible there: the working frame has fewer f32 numbers than the input's frame has
///   near its origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normalizer {
    center: [f64; 3],
    side: f64,
}

impl Normalizer {
    /// The map that centres `points` (n x 3) and makes the longest side of their box 1.
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if there is no point, if one is not finite, or if all points are the same.
    pub fn of<P: Position>(points: &[P]) -> Result<Self, Error> {
        Self::of_bounds(&Bounds::of(points)?)
    }

    /// The map that centres `bounds` and makes its longest side 1.
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if the box has no extent on any axis or is not finite.
    fn of_bounds(bounds: &Bounds) -> Result<Self, Error> {
        let [x, y, z] = bounds.center();
        Self::from_array([x, y, z, bounds.longest()]).map_err(|e| {
            Error::new(ErrorKind::Data, "the points have no extent")
                .caused_by(e)
                .advise("all points are the same; give points that lie on a surface, in finite coordinates")
        })
    }

    /// The map that changes nothing.
    pub fn identity() -> Self {
        Normalizer { center: [0.0; 3], side: 1.0 }
    }

    /// The map as saved by [`to_array`](Self::to_array): centre x, y, z and longest side, in the input's units.
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if a number is not finite or the side is not positive.
    pub fn from_array(a: [f64; 4]) -> Result<Self, Error> {
        let [x, y, z, side] = a;
        if !a.iter().all(|v| v.is_finite()) || side <= 0.0 {
            return Err(Error::new(
                ErrorKind::Data,
                format!("centre {:?} and side {side} make no frame", [x, y, z]),
            )
            .advise("the centre must be finite and the side positive"));
        }
        Ok(Normalizer { center: [x, y, z], side })
    }

    /// Centre x, y, z and longest side, in the input's units; [`from_array`](Self::from_array) of it is the same map.
    pub fn to_array(&self) -> [f64; 4] {
        let [x, y, z] = self.center;
        [x, y, z, self.side]
    }

    /// Input units per working unit: a distance in the working frame times this is a distance in the input's frame.
    pub fn scale(&self) -> f64 {
        self.side
    }

    /// One point of the input's frame, in the working frame.
    pub fn forward_point<P: Position>(&self, x: P) -> [f32; 3] {
        self.forward_wide(x).map(|x| x as f32)
    }

    /// One point of the input's frame, in the working frame, in 64 bits.
    pub fn forward_wide<P: Position>(&self, x: P) -> [f64; 3] {
        let x = x.wide();
        std::array::from_fn(|a| (x[a] - self.center[a]) / self.side)
    }

    /// One point of the working frame, in the input's frame.
    pub fn inverse_point(&self, y: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|a| (f64::from(y[a]) * self.side + self.center[a]) as f32)
    }

    /// One place of the working frame, in the input's frame, in 64 bits.
    pub fn inverse_wide(&self, y: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| y[a] * self.side + self.center[a])
    }

    /// Points of the input's frame (n x 3), in the working frame.
    pub fn forward<P: Position>(&self, points: &[P]) -> Vec<[f32; 3]> {
        points.iter().map(|&p| self.forward_point(p)).collect()
    }

    /// Points of the working frame (n x 3), in the input's frame and in 64 bits.
    ///
    /// How they lie to the centre of the box is rounded to multiples of 2^-30 of the longest side, or of the next power
    /// of two above it. So points that are moved or scaled by a power of two without rounding have the same places,
    /// moved or scaled, to the bit.
    pub fn place(&self, points: &[[f32; 3]]) -> Vec<[f64; 3]> {
        let step = 2f64.powi(self.side.log2().ceil() as i32) / PLACES;
        let placed = |p: &[f32; 3]| -> [f64; 3] {
            std::array::from_fn(|a| {
                let r = f64::from(p[a]) * self.side;
                self.center[a] + (r / step).round_ties_even() * step
            })
        };
        points.iter().map(placed).collect()
    }

    /// Points of the working frame (n x 3), in the input's frame.
    pub fn inverse(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        points.iter().map(|&p| self.inverse_point(p)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ulp(x: f32) -> f64 {
        let x = x.abs();
        f64::from(f32::from_bits(x.to_bits() + 1)) - f64::from(x)
    }

    fn check_round_trip(points: &[[f32; 3]]) {
        let n = Normalizer::of(points).unwrap();
        let y = n.forward(points);
        let back = n.inverse(&y);
        let largest = points.iter().flatten().fold(0.0f32, |m, x| m.max(x.abs()));
        let b = Bounds::of(&y).unwrap();
        assert!((b.longest() - 1.0).abs() < 1e-6, "longest side {}", b.longest());
        assert!(b.center().iter().all(|c| c.abs() < 1e-6));
        for (p, q) in points.iter().flatten().zip(back.iter().flatten()) {
            if f64::from(p.abs()) > 0.5 * n.scale() {
                assert_eq!(p.to_bits(), q.to_bits(), "{p} came back as {q}");
            }
            let d = (f64::from(*p) - f64::from(*q)).abs();
            assert!(d <= ulp(largest), "{p} came back as {q}, largest {largest}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
        #[test]
        fn round_trip_at_any_offset_and_scale(
            unit in prop::collection::vec(prop::array::uniform3(-1.0f32..1.0), 2..40),
            offset in prop::array::uniform3(prop_oneof![Just(0.0f32), -1.0f32..1.0, -5e6f32..5e6]),
            exponent in -30i32..30,
        ) {
            let s = 10f32.powi(exponent);
            let points: Vec<[f32; 3]> =
                unit.iter().map(|p| std::array::from_fn(|a| p[a] * s + offset[a])).collect();
            // A shape far smaller than the spacing of the numbers around it collapses to one point.
            prop_assume!(Bounds::of(&points).unwrap().longest() > 0.0);
            check_round_trip(&points);
        }

        #[test]
        fn array_is_exact(c in prop::array::uniform3(-1e9f64..1e9), side in 1e-30f64..1e30) {
            let n = Normalizer::from_array([c[0], c[1], c[2], side]).unwrap();
            prop_assert_eq!(Normalizer::from_array(n.to_array()).unwrap(), n);
        }
    }

    #[test]
    fn map_coordinates_and_scans_are_reproduced_exactly() {
        let utm: Vec<[f32; 3]> =
            (0..500).map(|i| [5e5 + i as f32 * 0.25, 4.649e6 + (i % 7) as f32, 300.0 + i as f32]).collect();
        check_round_trip(&utm);
        let far = [[1e4f32, 0.0, 0.0], [1e4 + 1.0, 0.5, 0.25]];
        check_round_trip(&far);
    }

    #[test]
    fn offsets_are_round_numbers_and_only_where_they_are_needed() {
        let of = |min: [f64; 3], max: [f64; 3]| Bounds { min, max }.offset();
        assert_eq!(of([7.0, -4.0, -3.0], [13.0, 2.0, 3.0]), [0.0; 3]);
        let utm = of([450_113.4, 5_411_224.6, 310.0], [450_133.4, 5_411_240.0, 330.0]);
        assert_eq!(utm, [450_120.0, 5_411_230.0, 320.0]);
        assert_eq!(of([1e-9, 0.0, 0.0], [1.1e-9, 1e-11, 1e-11])[1], 0.0);
        assert_eq!(of([5.0; 3], [5.0; 3]), [0.0; 3]);
    }

    #[test]
    fn places_move_and_scale_with_the_points_to_the_bit() {
        let points: Vec<[f32; 3]> =
            (0..40).map(|i| [0.37 * i as f32, (i * i % 17) as f32 / 3.0, (i % 5) as f32 - 1.1]).collect();
        let inside: Vec<[f32; 3]> =
            (0..40).map(|i| [0.5 - i as f32 / 40.0, 1e-7 * i as f32, 0.3 * (i as f32).sin()]).collect();
        let own = Normalizer::of(&points).unwrap();
        let places = own.place(&inside);
        for (p, y) in places.iter().zip(&inside) {
            assert!((0..3).all(|a| (own.forward_wide(*p)[a] - f64::from(y[a])).abs() < 1e-9), "{p:?}");
        }
        for (scale, by) in [
            (1.0, [1024.0, -3.5, 0.25]),
            (1.0, [450_123.5, 5_411_234.75, 320.0]),
            (2f64.powi(-30), [0.0; 3]),
            (2f64.powi(40), [0.0; 3]),
        ] {
            let to = |p: [f64; 3]| -> [f64; 3] { std::array::from_fn(|a| scale * p[a] + by[a]) };
            let moved: Vec<[f64; 3]> = points.iter().map(|p| to(p.wide())).collect();
            let frame = Normalizer::of(&moved).unwrap();
            assert_eq!(frame.forward(&moved), own.forward(&points));
            assert_eq!(frame.place(&inside), places.iter().map(|&p| to(p)).collect::<Vec<_>>());
        }
    }

    #[test]
    fn unit_box_is_hand_checkable() {
        let n = Normalizer::of(&[[1.0, 2.0, 3.0], [3.0, 3.0, 3.5]]).unwrap();
        assert_eq!(n.to_array(), [2.0, 2.5, 3.25, 2.0]);
        assert_eq!(n.scale(), 2.0);
        assert_eq!(n.forward(&[[3.0, 3.0, 3.5]]), [[0.5, 0.25, 0.125]]);
        assert_eq!(n.inverse(&[[0.5, 0.25, 0.125]]), [[3.0, 3.0, 3.5]]);
        let id = Normalizer::identity();
        assert_eq!(id.forward(&[[0.1, 2.0, -3.0]]), [[0.1, 2.0, -3.0]]);
    }

    #[test]
    fn unusable_points_are_data_errors() {
        let nan = [[0.0; 3], [1.0, f32::NAN, 0.0]];
        for points in [&[][..], &[[1.0; 3]], &[[2.0; 3], [2.0; 3]], &nan] {
            assert_eq!(Normalizer::of(points).unwrap_err().kind(), ErrorKind::Data);
        }
        assert_eq!(Bounds::of(&nan).unwrap_err().element(), Some("point 1"));
        assert!(Normalizer::from_array([0.0, f64::INFINITY, 0.0, 1.0]).is_err());
        assert!(Normalizer::from_array([0.0, 0.0, 0.0, -1.0]).is_err());
    }
}
