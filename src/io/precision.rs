//! What 32 bits can hold of coordinates: which range, which digits, and when they lose the detail of a cloud.
//!
//! Files are read in 64 bits, and all later work is done in 32 bits about an offset. So a coordinate beyond the range
//! of 32-bit floats is refused, digits that mean a 32-bit float are read as that float, and a file whose 32-bit numbers
//! are too coarse for its cloud gives a warning.

use super::Want;
use crate::geometry::{Bounds, are_f32};
use crate::{Error, ErrorKind};

/// Refuses a point with a coordinate that no point can have. Readers call it for each row, as only they know the line
/// and the number of the row; `noun` and `index` name it, as in `vertex 17`.
///
/// Where every row must hold a point ([`Want::EveryRow`], [`Want::Mesh`]) each coordinate must be finite and within the
/// range of 32-bit floats. In clouds two other kinds pass as well, and [`fillers`](super::fillers) leaves their rows
/// out later: coordinates that are not finite, and those of 1e300 and more, which some programs write where they have
/// no value.
pub(super) fn check_point(point: [f64; 3], want: Want, noun: &str, index: usize) -> Result<(), Error> {
    let wrong = |x: &f64| match want {
        Want::Cloud | Want::Attributes => x.is_finite() && x.abs() > f64::from(f32::MAX) && x.abs() < 1e300,
        Want::EveryRow | Want::Mesh => !(*x as f32).is_finite(),
    };
    match point.iter().position(wrong) {
        None => Ok(()),
        Some(axis) => Err(not_finite(point[axis], axis).at_element(format!("{noun} {index}"))),
    }
}

/// Refuses positions that are not finite or beyond the range of 32-bit floats.
pub(super) fn check_range(verts: &[[f64; 3]], noun: &str) -> Result<(), Error> {
    for (i, p) in verts.iter().enumerate() {
        if let Some(axis) = p.iter().position(|&x| !(x as f32).is_finite()) {
            return Err(not_finite(p[axis], axis).at_element(format!("{noun} {i}")));
        }
    }
    Ok(())
}

fn not_finite(x: f64, axis: usize) -> Error {
    let name = ["x", "y", "z"][axis];
    Error::new(ErrorKind::Data, format!("{name} is {x:?}, not a finite 32-bit number"))
        .advise("remove or repair it (elements are counted from 0)")
}

/// Rounds positions to 32 bits if a file declares them as such (`declared`), or if all of them are the shortest
/// decimals of 32-bit numbers, as programs write them: `0.1` then means the 32-bit number nearest to 0.1, and the text
/// and the binary file of one cloud give equal points. Not where 32 bits would lose the detail ([`Bounds::offset`]).
pub(super) fn round_to_floats(verts: &mut [[f64; 3]], declared: bool) {
    let mut digits = String::new();
    let floats = declared || verts.as_flattened().iter().all(|&x| is_short_float(x, &mut digits));
    if floats && Bounds::of(verts).is_ok_and(|bounds| bounds.offset() == [0.0; 3]) {
        verts.as_flattened_mut().iter_mut().for_each(|x| *x = f64::from(*x as f32));
    }
}

/// Whether a number is one of 32 bits or the shortest decimal of one; `digits` is working space.
pub(super) fn is_short_float(x: f64, digits: &mut String) -> bool {
    let narrow = x as f32;
    if f64::from(narrow) == x {
        return true;
    }
    digits.clear();
    let _ = std::fmt::Write::write_fmt(digits, format_args!("{narrow:e}"));
    digits.parse() == Ok(x)
}

/// A warning where the coordinates have been stored in 32 bits and are so large against the cloud's size that its
/// detail is lost in the file, as with map coordinates.
pub(super) fn coarse_floats(points: &[[f64; 3]]) -> Option<String> {
    let bounds = Bounds::of(points).ok()?;
    let largest = bounds.min.iter().chain(&bounds.max).fold(0.0, |m: f64, x| m.max(x.abs()));
    let (widest, step) = (bounds.longest(), largest * f64::from(f32::EPSILON));
    // Whole numbers are exact where steps are smaller than 1.
    let whole = step < 1.0 && points.as_flattened().iter().all(|x| x.fract() == 0.0);
    (widest > 0.0 && step > 1e-4 * widest && are_f32(points) && !whole).then(|| {
        format!(
            "coordinates near {largest:.3e} are stored in 32 bits, to steps of {step:.1e}, and the cloud measures \
             {widest:.3e}; export them in 64 bits, or less a common offset, to keep its detail"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_without_a_point_pass_in_clouds_only() {
        for (x, in_cloud) in
            [(1e38, true), (1e39, false), (1e300, true), (f64::NAN, true), (f64::INFINITY, true)]
        {
            let check = |want| check_point([0.0, x, 0.0], want, "vertex", 7);
            assert_eq!(check(Want::Cloud).is_ok(), in_cloud, "{x}");
            assert_eq!(check(Want::Attributes).is_ok(), in_cloud, "{x}");
            for want in [Want::EveryRow, Want::Mesh] {
                assert_eq!(check(want).is_ok(), x == 1e38, "{x}");
            }
            assert_eq!(check_range(&[[0.0; 3], [0.0, x, 0.0]], "point").is_ok(), x == 1e38, "{x}");
        }
        let e = check_point([0.0, 1e39, 0.0], Want::Mesh, "vertex", 7).unwrap_err().to_string();
        assert!(e.starts_with("vertex 7: y is 1e39, not a finite 32-bit number"), "{e}");
    }

    #[test]
    fn short_decimals_are_floats_unless_that_loses_detail() {
        let mut digits = String::new();
        for (x, short) in [(0.1, true), (0.1 + 1e-12, false), (0.5, true), (1e30, true), (-2.7, true)] {
            assert_eq!(is_short_float(x, &mut digits), short, "{x}");
        }
        let rounded = |mut verts: Vec<[f64; 3]>, declared| {
            round_to_floats(&mut verts, declared);
            verts[0][0]
        };
        let near = |x: f64| vec![[x, 0.0, 0.0], [1.0, 1.0, 1.0]];
        assert_eq!(rounded(near(0.1), false), f64::from(0.1_f32));
        assert_eq!(rounded(near(0.123456789012), false), 0.123456789012);
        assert_eq!(rounded(near(0.123456789012), true), f64::from(0.123_456_79_f32));
        // About 4 million away, steps of 32-bit floats are 0.25 and more.
        assert_eq!(rounded(vec![[4e6 + 0.1, 0.0, 0.0], [4e6 + 1.0, 1.0, 1.0]], true), 4e6 + 0.1);
    }
}
