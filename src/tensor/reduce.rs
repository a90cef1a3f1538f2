//! Sums and dot products in a fixed order.

use crate::simd::kernel;

/// The lanes of one value, folded as a tree.
#[inline(always)]
fn fold(lanes: [f32; 16], f: impl Fn(f32, f32) -> f32) -> f32 {
    // Loops over whole halves turn into vector operations; `from_fn` did not.
    let (mut l8, mut l4) = ([0.0; 8], [0.0; 4]);
    for i in 0..8 {
        l8[i] = f(lanes[i], lanes[i + 8]);
    }
    for i in 0..4 {
        l4[i] = f(l8[i], l8[i + 4]);
    }
    f(f(l4[0], l4[2]), f(l4[1], l4[3]))
}

/// The dot product in sixteen interleaved partial sums; to be called inside a [`kernel!`], which gives it the wide
/// registers. A plain loop would add one value after the other, because the order of float sums is fixed.
#[inline(always)]
pub(crate) fn lane_dot(a: &[f32], b: &[f32]) -> f32 {
    let (a16, a_rest) = a.as_chunks::<16>();
    let (b16, b_rest) = b.as_chunks::<16>();
    let mut sums = [0.0f32; 16];
    for (a, b) in a16.iter().zip(b16) {
        for i in 0..16 {
            sums[i] += a[i] * b[i];
        }
    }
    let mut total = 0.0;
    for (a, b) in a_rest.iter().zip(b_rest) {
        total += a * b;
    }
    if a16.is_empty() { total } else { total + fold(sums, |a, b| a + b) }
}

/// The sum in sixteen interleaved partial sums; as [`lane_dot`].
#[inline(always)]
pub(crate) fn lane_sum(x: &[f32]) -> f32 {
    let (x16, rest) = x.as_chunks::<16>();
    let mut sums = [0.0f32; 16];
    for x in x16 {
        for i in 0..16 {
            sums[i] += x[i];
        }
    }
    let mut total = 0.0;
    for x in rest {
        total += x;
    }
    if x16.is_empty() { total } else { total + fold(sums, |a, b| a + b) }
}

/// The largest value, NaN aside; minus infinity if there is none. As [`lane_dot`].
#[inline(always)]
pub(crate) fn lane_max(x: &[f32]) -> f32 {
    let larger = |a: f32, b: f32| if b > a { b } else { a };
    let (x16, rest) = x.as_chunks::<16>();
    let mut max = [f32::NEG_INFINITY; 16];
    for x in x16 {
        for i in 0..16 {
            max[i] = larger(max[i], x[i]);
        }
    }
    rest.iter().fold(fold(max, larger), |a, &b| larger(a, b))
}

/// out += s x, sixteen values at a time; as [`lane_dot`].
#[inline(always)]
pub(crate) fn lane_axpy(out: &mut [f32], s: f32, x: &[f32]) {
    let (out16, out_rest) = out.as_chunks_mut::<16>();
    let (x16, x_rest) = x.as_chunks::<16>();
    for (o, x) in out16.iter_mut().zip(x16) {
        for i in 0..16 {
            o[i] += s * x[i];
        }
    }
    for (o, x) in out_rest.iter_mut().zip(x_rest) {
        *o += s * x;
    }
}

kernel! {
    /// The dot product, in sixteen interleaved partial sums folded in a fixed order.
    pub(crate) fn dot(a: &[f32], b: &[f32]) -> f32 {
        lane_dot(a, b)
    }
}

kernel! {
    /// The sum in f64, in eight interleaved partial sums folded in a fixed order.
    pub(crate) fn sum_f64(x: &[f32]) -> f64 {
        let (x8, rest) = x.as_chunks::<8>();
        let mut sums = [0.0f64; 8];
        for x in x8 {
            for i in 0..8 { sums[i] += f64::from(x[i]); }
        }
        let mut total = 0.0;
        for &x in rest { total += f64::from(x); }
        for s in sums { total += s; }
        total
    }
}

kernel! {
    /// Adds the sum over the rows of `x` (n x c) to `out` (c).
    pub(crate) fn add_row_sums(out: &mut [f32], x: &[f32]) {
        if out.is_empty() { return; }
        for row in x.chunks_exact(out.len()) {
            for (o, &x) in out.iter_mut().zip(row) { *o += x; }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::testing::{rows, same_at_all};
    use proptest::prelude::*;

    kernel! {
        /// The loops that other kernels call, in one.
        fn lanes(out: &mut [f32], s: f32, x: &[f32]) -> [f32; 2] {
            lane_axpy(out, s, x);
            [lane_sum(out), lane_max(out)]
        }
    }

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set([a, b, c] in rows(0..70)) {
            same_at_all(|| vec![f64::from(dot(&a, &b)), sum_f64(&a), sum_f64(&b)]);
            same_at_all(|| {
                let mut out = c.clone();
                add_row_sums(&mut out, &[&a[..], &b].concat());
                let ends = lanes(&mut out, -0.7, &a);
                out.extend(ends);
                out
            });
        }
    }

    #[test]
    fn sums_agree_with_plain_loops_at_every_size() {
        for n in 0..67 {
            let a: Vec<f32> = (0..n).map(|i| (i as f32).sin()).collect();
            let b: Vec<f32> = (0..n).map(|i| (i as f32 * 0.7).cos()).collect();
            let truth: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
            assert!((f64::from(dot(&a, &b)) - truth).abs() < 1e-5);
            assert_eq!(lane_max(&a), a.iter().copied().fold(f32::NEG_INFINITY, f32::max));
            let mut moved = b.clone();
            lane_axpy(&mut moved, 0.5, &a);
            assert!(moved.iter().zip(&a).zip(&b).all(|((m, a), b)| *m == b + 0.5 * a));
            let truth: f64 = a.iter().map(|&a| f64::from(a)).sum();
            assert!((f64::from(lane_sum(&a)) - truth).abs() < 1e-5);
            assert!((sum_f64(&a) - truth).abs() < 1e-12);
        }
        let mut out = [1.0, 2.0, 3.0];
        add_row_sums(&mut out, &[1.0, 10.0, 100.0, 2.0, 20.0, 200.0]);
        assert_eq!(out, [4.0, 32.0, 303.0]);
    }
}
