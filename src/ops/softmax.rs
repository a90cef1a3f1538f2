//! Softmax over the columns of a row, over all rows, and over groups of k rows.

use crate::autodiff::{At, Op, Tape, Var};
use crate::simd::kernel;
use crate::tensor::{Tensor, lane_dot, lane_max, lane_sum, map_rows};

kernel! {
    /// Softmax of one contiguous row.
    fn softmax_row(out: &mut [f32], x: &[f32]) {
        let max = lane_max(x);
        for (o, &x) in out.iter_mut().zip(x) { *o = crate::simd::exp(x - max); }
        let scale = 1.0 / lane_sum(out);
        for o in out.iter_mut() { *o *= scale; }
    }
}

kernel! {
    /// dx = y (dy - <dy, y>) of one contiguous row.
    fn softmax_row_gradient(out: &mut [f32], y: &[f32], dy: &[f32]) {
        let inner = lane_dot(y, dy);
        for ((o, &y), &d) in out.iter_mut().zip(y).zip(dy) { *o = y * (d - inner); }
    }
}

/// Softmax over the innermost dimension.
struct SoftmaxCols;

impl Op<1> for SoftmaxCols {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        let c = x.cols();
        let mut y = x.uninit_like(x.dims());
        map_rows(y.data_mut(), c, |first, piece| {
            for (i, o) in piece.chunks_exact_mut(c.max(1)).enumerate() {
                softmax_row(o, x.row(first + i));
            }
        });
        (y, ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let c = dy.cols();
        let mut dx = dy.uninit_like(dy.dims());
        map_rows(dx.data_mut(), c, |first, piece| {
            for (i, o) in piece.chunks_exact_mut(c.max(1)).enumerate() {
                softmax_row_gradient(o, at.y.row(first + i), dy.row(first + i));
            }
        });
        [Some(dx)]
    }
}

/// Softmax over the k rows of every group, channel by channel.
struct SoftmaxGroups {
    k: usize,
}

kernel! {
    /// One group: k rows of c values.
    fn group_forward(out: &mut [f32], x: &[f32], c: usize, scratch: &mut [f32]) {
        scratch.fill(f32::NEG_INFINITY);
        for row in x.chunks_exact(c) {
            for (m, &x) in scratch.iter_mut().zip(row) { *m = if x > *m { x } else { *m }; }
        }
        for (o, row) in out.chunks_exact_mut(c).zip(x.chunks_exact(c)) {
            for ((o, &x), &m) in o.iter_mut().zip(row).zip(scratch.iter()) { *o = x - m; }
        }
        for o in out.iter_mut() { *o = crate::simd::exp(*o); }
        scratch.fill(0.0);
        for o in out.chunks_exact(c) {
            for (s, &o) in scratch.iter_mut().zip(o) { *s += o; }
        }
        for o in out.chunks_exact_mut(c) {
            for (o, &s) in o.iter_mut().zip(scratch.iter()) { *o /= s; }
        }
    }
}

kernel! {
    fn group_backward(out: &mut [f32], y: &[f32], dy: &[f32], c: usize, scratch: &mut [f32]) {
        scratch.fill(0.0);
        for (y, d) in y.chunks_exact(c).zip(dy.chunks_exact(c)) {
            for ((s, &y), &d) in scratch.iter_mut().zip(y).zip(d) { *s += y * d; }
        }
        for (o, (y, d)) in out.chunks_exact_mut(c).zip(y.chunks_exact(c).zip(dy.chunks_exact(c))) {
            for (((o, &y), &d), &s) in o.iter_mut().zip(y).zip(d).zip(scratch.iter()) { *o = y * (d - s); }
        }
    }
}

impl SoftmaxGroups {
    fn each_group(&self, out: &mut Tensor, f: impl Fn(usize, &mut [f32], &mut [f32]) + Sync) {
        let c = out.cols();
        let size = (self.k * c).max(1);
        map_rows(out.data_mut(), size, |first, piece| {
            let mut scratch = vec![0.0; c];
            for (i, o) in piece.chunks_exact_mut(size).enumerate() {
                f((first + i) * size, o, &mut scratch);
            }
        });
    }
}

impl Op<1> for SoftmaxGroups {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        let (c, size) = (x.cols(), self.k * x.cols());
        assert!(
            self.k > 0 && x.rows() % self.k == 0,
            "softmax: {:?} in groups of {} rows",
            x.shape(),
            self.k
        );
        let mut y = x.uninit_like(x.dims());
        self.each_group(&mut y, |at, o, scratch| group_forward(o, &x.data()[at..at + size], c, scratch));
        (y, ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let (c, size) = (dy.cols(), self.k * dy.cols());
        let mut dx = dy.uninit_like(dy.dims());
        self.each_group(&mut dx, |i, o, scratch| {
            group_backward(o, &at.y.data()[i..i + size], &dy.data()[i..i + size], c, scratch);
        });
        [Some(dx)]
    }
}

impl Tape {
    /// Softmax over each row: n x c to n x c, every row sums to 1.
    pub fn softmax_cols(&mut self, x: Var) -> Var {
        self.apply(SoftmaxCols, [x])
    }

    /// Softmax over the k rows of every group, channel by channel: (n k) x c to the same shape.
    ///
    /// # Panics
    /// If the number of rows is not a multiple of k.
    #[track_caller]
    pub fn softmax_groups(&mut self, x: Var, k: usize) -> Var {
        self.apply(SoftmaxGroups { k }, [x])
    }
}

#[cfg(test)]
mod tests {
    use crate::autodiff::Tape;
    use crate::ops::testing::{check, matrix, normal, same_both_ways};
    use crate::simd::testing::rows;
    use crate::tensor::Tensor;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set(x in rows::<6>(0..70), [dy] in rows(70..200), k in 1usize..4) {
            let x = [matrix(&x)];
            same_both_ways(|t, x| t.softmax_cols(x[0]), &x, &dy);
            same_both_ways(|t, x| t.softmax_groups(x[0], k), &x, &dy);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..5, k in 1usize..5, c in 1usize..6, seed: u64) {
            let x = normal(&[n * k, c], seed);
            check(|t, x| t.softmax_cols(x[0]), std::slice::from_ref(&x), seed);
            check(|t, x| t.softmax_groups(x[0], k), &[x], seed);
        }

        #[test]
        fn sums_to_one_and_ignores_shifts(n in 1usize..5, k in 1usize..5, c in 1usize..20, shift in -90f32..90.0, seed: u64) {
            let x = normal(&[n * k, c], seed);
            let mut t = Tape::new();
            let v = t.constant(x);
            let shifted = t.shift(v, shift);
            for (a, b, size) in [
                (t.softmax_cols(v), t.softmax_cols(shifted), 0),
                (t.softmax_groups(v, k), t.softmax_groups(shifted, k), k),
            ] {
                let (a, b) = (t.value(a), t.value(b));
                prop_assert!(a.data().iter().zip(b.data()).all(|(a, b)| (a - b).abs() < 2e-5));
                for r in 0..a.rows() {
                    let total: f32 = match size {
                        0 => a.row(r).iter().sum(),
                        k => (0..k).map(|j| a.row(r / k * k + j)[0]).sum(),
                    };
                    prop_assert!((total - 1.0).abs() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn large_values_do_not_overflow() {
        let mut t = Tape::new();
        let x = t.constant(Tensor::from_vec(&[1, 3], vec![1e30, 0.0, -1e30]));
        let y = t.softmax_cols(x);
        assert_eq!(t.value(y).data()[0], 1.0);
        assert!(t.value(y).is_finite());
    }
}
