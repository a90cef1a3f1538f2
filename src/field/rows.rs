//! Elementwise passes of the field network between its matrix products, over the rows (points) of a block.

use crate::simd::{kernel, softplus_sigmoid};
use std::f32::consts::FRAC_1_SQRT_2;

kernel! {
    /// h = z + bias, then its softplus with `beta`; s = the slope there.
    pub(super) fn softplus_rows(h: &mut [f32], s: &mut [f32], bias: &[f32], beta: f32) {
        let inverse = 1.0 / beta;
        for (h, s) in h.chunks_exact_mut(bias.len()).zip(s.chunks_exact_mut(bias.len())) {
            for ((h, s), &b) in h.iter_mut().zip(s).zip(bias) {
                let (value, slope) = softplus_sigmoid(beta * (*h + b));
                *h = value * inverse;
                *s = slope;
            }
        }
    }
}
kernel! {
    /// h = max(z + bias, 0); s = 1 where that is positive, 0 elsewhere.
    pub(super) fn relu_rows(h: &mut [f32], s: &mut [f32], bias: &[f32]) {
        for (h, s) in h.chunks_exact_mut(bias.len()).zip(s.chunks_exact_mut(bias.len())) {
            for ((h, s), &b) in h.iter_mut().zip(s).zip(bias) {
                let z = *h + b;
                // NaN stays: the comparison is false and z is kept.
                *h = if z < 0.0 { 0.0 } else { z };
                *s = if z > 0.0 { 1.0 } else { 0.0 };
            }
        }
    }
}
kernel! {
    /// out = a * b.
    pub(super) fn multiply(out: &mut [f32], a: &[f32], b: &[f32]) {
        for ((o, &a), &b) in out.iter_mut().zip(a).zip(b) { *o = a * b; }
    }
}
kernel! {
    /// Back through t = s * r. In: d = dt and r. Out: d = dr = dt * s, and r = what reaches z through its slope,
    /// dt * r * beta s (1 - s); beta is 0 for slopes that are constant almost everywhere.
    pub(super) fn back_through_slope(d: &mut [f32], r: &mut [f32], s: &[f32], beta: f32) {
        for ((d, r), &s) in d.iter_mut().zip(r).zip(s) {
            *r = *d * *r * (beta * s * (1.0 - s));
            *d *= s;
        }
    }
}
kernel! {
    /// Back through the activation: d = dz = dh * s + q, and its column sums added to `sum`.
    pub(super) fn back_through_activation(d: &mut [f32], s: &[f32], q: &[f32], sum: &mut [f32]) {
        let c = sum.len();
        for ((d, s), q) in d.chunks_exact_mut(c).zip(s.chunks_exact(c)).zip(q.chunks_exact(c)) {
            for (((d, &s), &q), sum) in d.iter_mut().zip(s).zip(q).zip(sum.iter_mut()) {
                *d = *d * s + q;
                *sum += *d;
            }
        }
    }
}
/// scale times columns `from..from + to_cols` of x.
pub(super) fn copy_columns(to: &mut [f32], to_cols: usize, x: &[f32], cols: usize, from: usize, scale: f32) {
    for (to, x) in to.chunks_exact_mut(to_cols).zip(x.chunks_exact(cols)) {
        for (to, x) in to.iter_mut().zip(&x[from..]) {
            *to = x * scale;
        }
    }
}

/// [a, b] / sqrt 2, row by row.
pub(super) fn join(out: &mut [f32], a: &[f32], a_cols: usize, b: &[f32], b_cols: usize) {
    let rows = a.chunks_exact(a_cols).zip(b.chunks_exact(b_cols));
    for (out, (a, b)) in out.chunks_exact_mut(a_cols + b_cols).zip(rows) {
        for (o, x) in out.iter_mut().zip(a.iter().chain(b)) {
            *o = x * FRAC_1_SQRT_2;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::testing::{rows, same_at_all};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set(
            [a, b, r, s] in rows(1..140), columns in 1usize..70, beta in 0.5f32..100.0,
        ) {
            let bias: Vec<f32> = r.iter().cycle().take(columns).copied().collect();
            same_at_all(|| {
                let [mut h, mut slope, mut relu, mut step] = [a.clone(), b.clone(), a.clone(), b.clone()];
                softplus_rows(&mut h, &mut slope, &bias, beta);
                relu_rows(&mut relu, &mut step, &bias);
                [h, slope, relu, step].concat()
            });
            same_at_all(|| {
                let [mut product, mut d, mut through] = [s.clone(), a.clone(), r.clone()];
                multiply(&mut product, &a, &b);
                back_through_slope(&mut d, &mut through, &s, beta);
                let (mut dz, mut sum) = (a.clone(), bias.clone());
                back_through_activation(&mut dz, &s, &b, &mut sum);
                [product, d, through, dz, sum].concat()
            });
        }
    }
}
