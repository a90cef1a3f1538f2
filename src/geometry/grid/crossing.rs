//! Where the zero level of a field crosses an edge of the grid.

/// The crossing is kept this share of the edge away from both of its ends, so that crossings of different edges at one
/// vertex stay apart.
pub(crate) const MARGIN: f32 = 1e-4;

/// The share of the way along an edge, from its first end, at which a linear function with the values `a` and `b` at
/// the ends is 0; in [`MARGIN`, 1 - `MARGIN`]. The values differ in sign, where 0 counts as positive.
pub(crate) fn crossing_share(a: f32, b: f32) -> f32 {
    // In f64 the difference of two f32 neither overflows nor vanishes.
    let (a, b) = (f64::from(a), f64::from(b));
    let margin = f64::from(MARGIN);
    (a / (a - b)).clamp(margin, 1.0 - margin) as f32
}

/// The point at a share of the way from p to q.
pub(crate) fn along(p: [f32; 3], q: [f32; 3], share: f32) -> [f32; 3] {
    std::array::from_fn(|i| p[i] + share * (q[i] - p[i]))
}
