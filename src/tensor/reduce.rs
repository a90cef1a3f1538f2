//! Sums.

use super::simd::kernel;

kernel! {
    /// The dot product, in sixteen interleaved partial sums folded in a fixed order.
    pub(crate) fn dot(a: &[f32], b: &[f32]) -> f32 {
        let (a16, a_rest) = a.as_chunks::<16>();
        let (b16, b_rest) = b.as_chunks::<16>();
        let mut sums = [0.0f32; 16];
        for (a, b) in a16.iter().zip(b16) {
            for i in 0..16 { sums[i] += a[i] * b[i]; }
        }
        let mut total = 0.0;
        for (a, b) in a_rest.iter().zip(b_rest) { total += a * b; }
        for s in sums { total += s; }
        total
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

    #[test]
    fn sums_agree_with_plain_loops_at_every_size() {
        for n in 0..67 {
            let a: Vec<f32> = (0..n).map(|i| (i as f32).sin()).collect();
            let b: Vec<f32> = (0..n).map(|i| (i as f32 * 0.7).cos()).collect();
            let truth: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
            assert!((f64::from(dot(&a, &b)) - truth).abs() < 1e-5);
            let truth: f64 = a.iter().map(|&a| f64::from(a)).sum();
            assert!((sum_f64(&a) - truth).abs() < 1e-12);
        }
        let mut out = [1.0, 2.0, 3.0];
        add_row_sums(&mut out, &[1.0, 10.0, 100.0, 2.0, 20.0, 200.0]);
        assert_eq!(out, [4.0, 32.0, 303.0]);
    }
}
