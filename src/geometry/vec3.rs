//! Arithmetic of points and vectors in space, as arrays of three numbers.
//!
//! Everything is summed in the order x, y, z, in the precision of its arguments: neighbour searches rank by exactly
//! these bits.

use std::ops::{Add, Div, Mul, Sub};

/// a - b.
#[inline]
pub(crate) fn sub<T: Copy + Sub<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// a + b.
#[inline]
pub(crate) fn add<T: Copy + Add<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// a . b.
#[inline]
pub(crate) fn dot<T: Copy + Add<Output = T> + Mul<Output = T>>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a x b.
#[inline]
pub(crate) fn cross<T: Copy + Sub<Output = T> + Mul<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// |v|.
#[inline]
pub(crate) fn length<T: Root + Add<Output = T> + Mul<Output = T>>(v: [T; 3]) -> T {
    dot(v, v).root()
}

/// v / |v| in the precision of its arguments; `None` for a vector that is zero or not finite.
pub(crate) fn unit_vector<T>(v: [T; 3]) -> Option<[T; 3]>
where
    T: Root + Add<Output = T> + Mul<Output = T> + Div<Output = T>,
{
    let length = length(v);
    length.is_positive().then(|| v.map(|x| x / length))
}

/// Numbers that have square roots.
pub(crate) trait Root: Copy {
    /// The square root.
    fn root(self) -> Self;
    /// Above 0 and finite.
    fn is_positive(self) -> bool;
}

impl Root for f32 {
    #[inline]
    fn root(self) -> f32 {
        self.sqrt()
    }

    #[inline]
    fn is_positive(self) -> bool {
        self > 0.0 && self.is_finite()
    }
}

impl Root for f64 {
    #[inline]
    fn root(self) -> f64 {
        self.sqrt()
    }

    #[inline]
    fn is_positive(self) -> bool {
        self > 0.0 && self.is_finite()
    }
}

/// |a - b|^2.
#[inline]
pub(crate) fn dist_sq<T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T>>(
    a: [T; 3],
    b: [T; 3],
) -> T {
    let d = sub(a, b);
    dot(d, d)
}

/// |a - b| in f64, from differences in f32.
#[inline]
pub(crate) fn distance(a: [f32; 3], b: [f32; 3]) -> f64 {
    distance_sq(a, b).sqrt()
}

/// |a - b|^2 in f64, from differences in f32.
#[inline]
pub(crate) fn distance_sq(a: [f32; 3], b: [f32; 3]) -> f64 {
    let d = wide(sub(a, b));
    dot(d, d)
}

/// The same point in f64.
#[inline]
pub(crate) fn wide(p: [f32; 3]) -> [f64; 3] {
    p.map(f64::from)
}

/// The area of a triangle.
#[inline]
pub(crate) fn triangle_area(corners: [[f64; 3]; 3]) -> f64 {
    0.5 * length(triangle_normal(corners))
}

/// The normal of a triangle, as long as twice its area; outward where the corners run counter-clockwise.
#[inline]
pub(crate) fn triangle_normal([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    cross(sub(b, a), sub(c, a))
}
