//! How fine a grid the surface of a shape needs.

/// The area of a usual shape, in squares of the longest side of its box (working frame): a sphere has 3.1, a cow 1.9, a
/// man 0.6.
pub const USUAL_AREA: f64 = 2.2;

/// The least that a resolution is multiplied by.
const MIN_FACTOR: f64 = 0.5;
/// The most that a resolution is multiplied by.
const MAX_FACTOR: f64 = 4.0;
/// The most cubes a side that a grid is refined to: with more, a step would cost many times as much.
const MAX_CUBES: f64 = 192.0;
/// The fewest cubes a side that a [`TetGrid`](crate::geometry::TetGrid) of the working frame can have.
const MIN_CUBES: usize = 3;

/// Cubes along each side of a grid at which a surface of the given area crosses about as many as one of the `usual`
/// area does at `resolution`. They differ from `resolution` by a multiple of 4 and are half to 4 times as many a side,
/// and not more than 192, unless `resolution` is.
///
/// `resolution` itself if the usual area is not positive or the area not finite.
///
/// The same number of points lie closer to each other on a smaller surface, and its parts are thinner.
pub fn resolution_for_area(resolution: usize, area: f64, usual: f64) -> usize {
    if !(usual > 0.0 && area.is_finite()) {
        return resolution;
    }
    let limit = (MAX_CUBES / resolution as f64).max(1.0);
    let factor = (usual / area).sqrt().clamp(MIN_FACTOR, MAX_FACTOR).min(limit);
    let change = (resolution as f64 * (factor - 1.0) / 4.0).round() as isize * 4;
    resolution.saturating_add_signed(change).max(MIN_CUBES)
}

#[cfg(test)]
mod tests {
    use super::resolution_for_area;

    #[test]
    fn a_surface_crosses_as_many_cubes_whatever_its_area() {
        for (resolution, area, usual, want) in [
            (48, 0.5, 2.0, 96),
            (48, 1.0, 1.5, 60),
            (48, 2.0, 2.0, 48),
            (48, 4.0, 2.0, 32),
            (48, 3.0, 2.0, 40),
            (48, 200.0, 2.0, 24),
            (300, 3.0, 2.0, 244),
            (10, 2.1, 2.0, 10),
            (4, 200.0, 2.0, 3),
            (3, 4.0, 2.0, 3),
            (48, 2.0, 0.0, 48),
            (48, 0.0, 0.0, 48),
            (48, f64::INFINITY, 2.0, 48),
            (48, 0.0, 2.0, 192),
            (48, 0.02, 2.0, 192),
            (64, 0.125, 2.0, 192),
            (160, 0.125, 2.0, 192),
            (300, 0.125, 2.0, 300),
            (10, 1.0, 1.01, 10),
            (10, 1.0, 1.6, 14),
        ] {
            let got = resolution_for_area(resolution, area, usual);
            assert_eq!(got, want, "{resolution} cubes, area {area} instead of {usual}");
        }
    }
}
