//! Cutting and joining: reshape, slices and concatenations of rows and columns.

use crate::autodiff::{At, Op, Tape, Var};
use crate::tensor::{Tensor, map_rows};
use std::ops::Range;

/// The same values under other dimensions.
struct Reshape {
    dims: Vec<usize>,
}

impl Op<1> for Reshape {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        (x.clone().reshaped(&self.dims), ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        [Some(dy.clone().reshaped(at.x[0].dims()))]
    }
}

/// Copies the columns `columns` of x (n x c) into the columns from `to` on of out (n x d).
fn copy_cols(out: &mut Tensor, to: usize, x: &Tensor, columns: Range<usize>) {
    let (c, d, width) = (x.cols(), out.cols(), columns.len());
    map_rows(out.data_mut(), d, |first, out| {
        let rows = x.data()[first * c..].chunks_exact(c.max(1));
        for (out, x) in out.chunks_exact_mut(d.max(1)).zip(rows) {
            out[to..to + width].copy_from_slice(&x[columns.clone()]);
        }
    });
}

/// Some neighbouring columns.
struct SliceCols {
    range: Range<usize>,
}

impl Op<1> for SliceCols {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        assert!(self.range.end <= x.cols(), "slice_cols: columns {:?} of {:?}", self.range, x.shape());
        let mut y = x.uninit_like(&[x.rows(), self.range.len()]);
        copy_cols(&mut y, 0, x, self.range.clone());
        (y, ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let mut dx = dy.zeros_like_pool(at.x[0].dims());
        copy_cols(&mut dx, self.range.start, dy, 0..self.range.len());
        [Some(dx)]
    }
}

/// Some neighbouring rows.
struct SliceRows {
    range: Range<usize>,
}

impl Op<1> for SliceRows {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        assert!(self.range.end <= x.rows(), "slice_rows: rows {:?} of {:?}", self.range, x.shape());
        let c = x.cols();
        let mut y = x.uninit_like(&[self.range.len(), c]);
        y.data_mut().copy_from_slice(&x.data()[self.range.start * c..self.range.end * c]);
        (y, ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let c = dy.cols();
        let mut dx = dy.zeros_like_pool(at.x[0].dims());
        dx.data_mut()[self.range.start * c..self.range.end * c].copy_from_slice(dy.data());
        [Some(dx)]
    }
}

/// Side by side.
struct ConcatCols;

impl<const N: usize> Op<N> for ConcatCols {
    type Saved = ();
    fn forward(&self, x: [&Tensor; N]) -> (Tensor, ()) {
        let n = x[0].rows();
        let shapes = || x.map(Tensor::shape);
        assert!(x.iter().all(|x| x.rows() == n), "concat_cols: {:?}", shapes());
        let mut y = x[0].uninit_like(&[n, x.iter().map(|x| x.cols()).sum()]);
        let mut at = 0;
        for x in x {
            copy_cols(&mut y, at, x, 0..x.cols());
            at += x.cols();
        }
        (y, ())
    }
    fn vjp(&self, at: At<'_, N, ()>, dy: &Tensor) -> [Option<Tensor>; N] {
        let mut from = 0;
        std::array::from_fn(|i| {
            let c = at.x[i].cols();
            from += c;
            at.needs[i].then(|| {
                let mut dx = dy.uninit_like(at.x[i].dims());
                copy_cols(&mut dx, 0, dy, from - c..from);
                dx
            })
        })
    }
}

/// Tensors of equal width stacked, the rows of the first above those of the next.
struct ConcatRows;

impl<const N: usize> Op<N> for ConcatRows {
    type Saved = ();
    fn forward(&self, x: [&Tensor; N]) -> (Tensor, ()) {
        let c = x[0].cols();
        let shapes = || x.map(Tensor::shape);
        assert!(x.iter().all(|x| x.cols() == c), "concat_rows: {:?}", shapes());
        let mut y = x[0].uninit_like(&[x.iter().map(|x| x.rows()).sum(), c]);
        let mut rest = y.data_mut();
        for x in x {
            let (head, tail) = rest.split_at_mut(x.len());
            head.copy_from_slice(x.data());
            rest = tail;
        }
        (y, ())
    }
    fn vjp(&self, at: At<'_, N, ()>, dy: &Tensor) -> [Option<Tensor>; N] {
        let mut from = 0;
        std::array::from_fn(|i| {
            let len = at.x[i].len();
            from += len;
            at.needs[i].then(|| {
                let mut dx = dy.uninit_like(at.x[i].dims());
                dx.data_mut().copy_from_slice(&dy.data()[from - len..from]);
                dx
            })
        })
    }
}

impl Tape {
    /// The same values, row-major, under other dimensions.
    ///
    /// # Panics
    /// If the number of elements differs.
    #[track_caller]
    pub fn reshape(&mut self, x: Var, dims: &[usize]) -> Var {
        self.apply(Reshape { dims: dims.to_vec() }, [x])
    }

    /// The columns in `range`: n x c to n x d.
    ///
    /// # Panics
    /// If the range ends past c.
    #[track_caller]
    pub fn slice_cols(&mut self, x: Var, range: Range<usize>) -> Var {
        self.apply(SliceCols { range }, [x])
    }

    /// The rows in `range`: n x c to m x c.
    ///
    /// # Panics
    /// If the range ends past n.
    #[track_caller]
    pub fn slice_rows(&mut self, x: Var, range: Range<usize>) -> Var {
        self.apply(SliceRows { range }, [x])
    }

    /// Tensors of equally many rows side by side.
    ///
    /// # Panics
    /// If the numbers of rows differ.
    #[track_caller]
    pub fn concat_cols<const N: usize>(&mut self, x: [Var; N]) -> Var {
        self.apply(ConcatCols, x)
    }

    /// Tensors of equally many columns one above the other.
    ///
    /// # Panics
    /// If the numbers of columns differ.
    #[track_caller]
    pub fn concat_rows<const N: usize>(&mut self, x: [Var; N]) -> Var {
        self.apply(ConcatRows, x)
    }
}

#[cfg(test)]
mod tests {
    use crate::autodiff::Tape;
    use crate::ops::testing::{check, normal};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..6, c in 1usize..6, d in 1usize..6, cut in 0usize..6, seed: u64) {
            let (a, b) = (normal(&[n, c], seed), normal(&[n, d], seed ^ 1));
            let cut = cut % c;
            check(|t, x| t.concat_cols([x[0], x[1], x[0]]), &[a.clone(), b], seed);
            check(|t, x| t.concat_rows([x[0], x[1]]), &[a.clone(), normal(&[d, c], seed)], seed);
            check(|t, x| t.slice_cols(x[0], cut..c), std::slice::from_ref(&a), seed);
            check(|t, x| t.slice_rows(x[0], n / 2..n), std::slice::from_ref(&a), seed);
            check(|t, x| t.reshape(x[0], &[c, n]), &[a], seed);
        }
    }

    #[test]
    fn slices_of_a_concatenation_are_its_parts() {
        // The larger one is copied in several pieces.
        for n in [3, 20_000] {
            let (a, b) = (normal(&[n, 2], 1), normal(&[n, 4], 2));
            let mut t = Tape::new();
            let (va, vb) = (t.input(a.clone()), t.input(b.clone()));
            let joined = t.concat_cols([va, vb]);
            let (left, right) = (t.slice_cols(joined, 0..2), t.slice_cols(joined, 2..6));
            assert_eq!((t.value(left), t.value(right)), (&a, &b));
        }
    }
}
