//! Coordinates of 32 and of 64 bits at the doors of the crate.

use std::fmt::Debug;

/// A position as a user has it: `[f32; 3]` or `[f64; 3]`, in any frame and unit.
///
/// What takes positions takes both; the work between is done in 32 bits in the [working frame](super::Normalizer).
pub trait Position: Copy + Debug + PartialEq + Send + Sync + sealed::Sealed + 'static {
    /// The type of a coordinate, and of a distance in the same unit.
    type Scalar: Copy + Debug + PartialEq + PartialOrd + Send + Sync + 'static;
    /// The position in 64 bits; exact.
    fn wide(self) -> [f64; 3];
    /// The position rounded to this type.
    fn of_wide(wide: [f64; 3]) -> Self;
    /// A coordinate or distance rounded to this type.
    fn scalar(wide: f64) -> Self::Scalar;
}

impl Position for [f32; 3] {
    type Scalar = f32;

    fn wide(self) -> [f64; 3] {
        self.map(f64::from)
    }

    fn of_wide(wide: [f64; 3]) -> Self {
        wide.map(|x| x as f32)
    }

    fn scalar(wide: f64) -> f32 {
        wide as f32
    }
}

impl Position for [f64; 3] {
    type Scalar = f64;

    fn wide(self) -> [f64; 3] {
        self
    }

    fn of_wide(wide: [f64; 3]) -> Self {
        wide
    }

    fn scalar(wide: f64) -> f64 {
        wide
    }
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for [f32; 3] {}
    impl Sealed for [f64; 3] {}
}

/// Positions (n x 3) in 64 bits; exact.
pub fn widened<P: Position>(points: &[P]) -> Vec<[f64; 3]> {
    points.iter().map(|p| p.wide()).collect()
}

/// Positions (n x 3) less an offset, rounded to 32 bits once.
pub fn relative_to<P: Position>(points: &[P], offset: [f64; 3]) -> Vec<[f32; 3]> {
    let local = |p: &P| {
        let p = p.wide();
        std::array::from_fn(|a| (p[a] - offset[a]) as f32)
    };
    points.iter().map(local).collect()
}

/// Whether 32 bits hold every coordinate exactly.
pub fn are_f32<P: Position>(points: &[P]) -> bool {
    points.iter().all(|p| p.wide().iter().all(|&x| f64::from(x as f32) == x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_of_both_widths_are_one_place() {
        let narrow = [[0.1f32, -2.5, 1e9]];
        let wide = widened(&narrow);
        assert_eq!(wide[0][0], f64::from(0.1f32));
        assert!(are_f32(&narrow) && are_f32(&wide) && !are_f32(&[[0.1, 0.0, 0.0]]));
        assert_eq!(<[f32; 3]>::of_wide(wide[0]), narrow[0]);
        // Digits that 32 bits lose at the place itself are there about an offset.
        assert_eq!(
            relative_to(&[[5_400_000.062_5, 0.0, 0.0]], [5_400_000.0, 0.0, 0.0]),
            [[0.0625, 0.0, 0.0]]
        );
    }
}
