//! The way from the input's frame to the working frame and back.

use crate::error::{Error, ErrorKind};
use crate::geometry::vec3::length;
use crate::geometry::{Normalizer, Position};

/// Axes that are stretched, and then the map that centres the points and makes their longest side 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WorkingFrame {
    normalizer: Normalizer,
    /// What the coordinates of the input are multiplied by; ones as a rule.
    stretch: [f64; 3],
}

/// The most that one axis is stretched more than another.
const MAX_STRETCH: f64 = 1000.0;

/// Gradient lengths between which its direction goes from ignored to fully trusted; an exact distance has length 1.
const SHORT: [f64; 2] = [0.25, 0.75];

impl WorkingFrame {
    /// The frame of `points` (n x 3), their axes stretched.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] unless all factors are positive and within a thousand of each other, and as
    /// [`Normalizer::of`].
    pub fn of(points: &[[f64; 3]], stretch: [f64; 3]) -> Result<Self, Error> {
        let (least, most) = stretch.iter().fold((f64::INFINITY, 0.0f64), |(a, b), &x| (a.min(x), b.max(x)));
        if !stretch.iter().all(|x| (1e-6..=1e6).contains(x)) || most > MAX_STRETCH * least {
            let [x, y, z] = stretch;
            return Err(Error::new(ErrorKind::Config, format!("axes cannot be stretched by {x}, {y}, {z}"))
                .at_element("anisotropy")
                .advise(
                    "use positive factors of which none is more than 1000 times another, such as 1, 1, 0.2",
                ));
        }
        let stretched: Vec<[f64; 3]> = points.iter().map(|p| times(*p, stretch)).collect();
        Ok(WorkingFrame { normalizer: Normalizer::of(&stretched)?, stretch })
    }

    /// The same from the parts that were saved.
    #[cfg(feature = "checkpoint")]
    pub fn of_parts(normalizer: Normalizer, stretch: [f64; 3]) -> Self {
        WorkingFrame { normalizer, stretch }
    }

    #[cfg(feature = "checkpoint")]
    pub fn normalizer(&self) -> Normalizer {
        self.normalizer
    }

    #[cfg(feature = "checkpoint")]
    pub fn stretch(&self) -> [f64; 3] {
        self.stretch
    }

    /// Whether all axes are as they were.
    pub fn is_plain(&self) -> bool {
        self.stretch == [1.0; 3]
    }

    /// Input units per working unit: for stretched axes those of a stretched input, on the mean over the axes.
    pub fn scale(&self) -> f64 {
        self.normalizer.scale() / self.stretch.iter().product::<f64>().cbrt()
    }

    /// Points of the input's frame (n x 3), in the working frame.
    pub fn forward<P: Position>(&self, points: &[P]) -> Vec<[f32; 3]> {
        points.iter().map(|p| self.forward_wide(*p).map(|x| x as f32)).collect()
    }

    /// One point of the input's frame, in the working frame, in 64 bits.
    pub fn forward_wide<P: Position>(&self, x: P) -> [f64; 3] {
        self.normalizer.forward_wide(times(x.wide(), self.stretch))
    }

    /// Points of the working frame (n x 3), in the input's frame, rounded as by [`Normalizer::place`].
    pub fn place(&self, points: &[[f32; 3]]) -> Vec<[f64; 3]> {
        let mut placed = self.normalizer.place(points);
        if !self.is_plain() {
            placed.iter_mut().for_each(|p| *p = [0, 1, 2].map(|a| p[a] / self.stretch[a]));
        }
        placed
    }

    /// A normal of the input's frame in the working frame, of any length.
    pub fn normal(&self, n: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|a| n[a] / self.stretch[a])
    }

    /// A gradient in the working frame as one over the coordinates of the input before they are stretched: its
    /// components times the stretch.
    pub fn slope(&self, gradient: [f64; 3]) -> [f64; 3] {
        times(gradient, self.stretch)
    }

    /// Converts a distance of the working frame to the input's unit, to first order along its gradient. Where the
    /// gradient is too short to have a direction (midway between parts of the surface), uses the largest stretch, which
    /// gives a lower bound.
    pub fn distance(&self, value: f64, gradient: [f64; 3]) -> f64 {
        let most = self.stretch.iter().fold(0.0, |most: f64, &x| most.max(x));
        let known = ((length(gradient) - SHORT[0]) / (SHORT[1] - SHORT[0])).clamp(0.0, 1.0);
        let along = length(self.slope(gradient)) / length(gradient).max(f64::MIN_POSITIVE);
        value * self.normalizer.scale() / (known * along + (1.0 - known) * most)
    }
}

fn times(x: [f64; 3], by: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|a| x[a] * by[a])
}
