//! Elementwise passes.

use super::Tensor;
use crate::simd::kernel;
use rayon::prelude::*;

/// Elements below which a pass stays on the calling thread.
pub(crate) const MIN_PARALLEL: usize = 1 << 16;

/// Elements a thread works on at a time.
const BLOCK: usize = 1 << 14;

kernel! {
    fn add_assign(out: &mut [f32], x: &[f32]) {
        for (o, &x) in out.iter_mut().zip(x) { *o += x; }
    }
}

impl Tensor {
    /// Adds `other` to this tensor in place.
    #[track_caller]
    pub(crate) fn add_assign(&mut self, other: &Tensor) {
        assert!(self.shape() == other.shape(), "add_assign: {:?} and {:?}", self.shape(), other.shape());
        if self.len() < MIN_PARALLEL {
            add_assign(self.data_mut(), other.data());
        } else {
            let pieces = self.data_mut().par_chunks_mut(BLOCK).zip(other.data().par_chunks(BLOCK));
            pieces.for_each(|(out, x)| add_assign(out, x));
        }
    }
}

/// The same values in a new tensor, copied by several threads if it is large.
pub(crate) fn copied(x: &Tensor) -> Tensor {
    map(x, |out, x| out.copy_from_slice(x))
}

/// Calls `f(out, x)` on equal pieces of a new tensor and of `x`, side by side on several threads if it is large.
pub(crate) fn map(x: &Tensor, f: impl Fn(&mut [f32], &[f32]) + Sync) -> Tensor {
    let mut out = x.uninit_like(x.dims());
    if x.len() < MIN_PARALLEL {
        f(out.data_mut(), x.data());
    } else {
        out.data_mut().par_chunks_mut(BLOCK).zip(x.data().par_chunks(BLOCK)).for_each(|(o, x)| f(o, x));
    }
    out
}

/// Calls `f(a, b, x)` on equal pieces of two tensors to be filled and of `x`, which has as many values; side by side on
/// several threads if it is large.
pub(crate) fn map_to_two(
    a: &mut Tensor,
    b: &mut Tensor,
    x: &Tensor,
    f: impl Fn(&mut [f32], &mut [f32], &[f32]) + Sync,
) {
    if x.len() < MIN_PARALLEL {
        f(a.data_mut(), b.data_mut(), x.data());
    } else {
        let out = a.data_mut().par_chunks_mut(BLOCK).zip(b.data_mut().par_chunks_mut(BLOCK));
        out.zip(x.data().par_chunks(BLOCK)).for_each(|((a, b), x)| f(a, b, x));
    }
}

/// Calls `f(out, a, b)` on equal pieces of a new tensor and of two tensors of one shape.
#[track_caller]
pub(crate) fn map2(a: &Tensor, b: &Tensor, f: impl Fn(&mut [f32], &[f32], &[f32]) + Sync) -> Tensor {
    assert!(a.len() == b.len(), "elementwise: {:?} and {:?}", a.shape(), b.shape());
    let mut out = a.uninit_like(a.dims());
    if a.len() < MIN_PARALLEL {
        f(out.data_mut(), a.data(), b.data());
    } else {
        out.data_mut()
            .par_chunks_mut(BLOCK)
            .zip(a.data().par_chunks(BLOCK).zip(b.data().par_chunks(BLOCK)))
            .for_each(|(o, (a, b))| f(o, a, b));
    }
    out
}

/// Rows of `cols` values that a thread works on at a time in passes that compute every row alone; fixed by the shape,
/// so nothing depends on the thread count.
pub(crate) fn row_block(cols: usize) -> usize {
    (BLOCK / cols.max(1)).max(1)
}

/// Fills `out` (rows of `cols` values) by calling `f(first_row, piece)` on pieces of whole rows.
pub(crate) fn map_rows(out: &mut [f32], cols: usize, f: impl Fn(usize, &mut [f32]) + Sync) {
    if out.len() < MIN_PARALLEL || cols == 0 {
        f(0, out);
    } else {
        let rows = row_block(cols);
        out.par_chunks_mut(rows * cols).enumerate().for_each(|(i, piece)| f(i * rows, piece));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::testing::{rows, same_at_all};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set([x, y] in rows(0..70)) {
            let sums = same_at_all(|| { let mut out = y.clone(); add_assign(&mut out, &x); out });
            let same = |(sum, (x, y)): (f32, (&f32, &f32))| sum == x + y || sum.is_nan() && (x + y).is_nan();
            prop_assert!(sums.into_iter().zip(x.iter().zip(&y)).all(same));
        }

        /// Sizes on both sides of [`MIN_PARALLEL`].
        #[test]
        fn large_sums_and_copies_are_those_of_one_loop(n in MIN_PARALLEL - 3..MIN_PARALLEL + BLOCK + 3, seed: u64) {
            let of = |salt: u64| {
                let value = |i: u64| ((i ^ seed).wrapping_mul(salt) >> 40) as f32 - 8e6;
                Tensor::from_vec(&[n, 1], (0..n as u64).map(value).collect())
            };
            let (x, y) = (of(0x9e37_79b9_7f4a_7c15), of(0xd1b5_4a32_d192_ed03));
            let mut sum = copied(&x);
            prop_assert_eq!(sum.data(), x.data());
            sum.add_assign(&y);
            let one = |(sum, (x, y)): (&f32, (&f32, &f32))| *sum == x + y;
            prop_assert!(sum.data().iter().zip(x.data().iter().zip(y.data())).all(one));
        }
    }
}
