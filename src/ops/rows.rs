//! Rows by index: gather, its transpose scatter-add, repetition, and a least value for some.

use crate::autodiff::{At, Op, Tape, Var};
use crate::tensor::{Tensor, add_row_sums, gather_rows, map_rows, scatter_add_rows};
use std::sync::Arc;

/// Row i of the result is row `index[i]` of x.
struct GatherRows {
    index: Arc<[u32]>,
}

impl Op<1> for GatherRows {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        (gather_rows(x, &self.index), ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let x = at.x[0];
        [Some(scatter_add_rows(dy, &self.index, x.rows()).reshaped(x.dims()))]
    }
}

/// Row i of x is added to row `index[i]` of the result.
struct ScatterAddRows {
    index: Arc<[u32]>,
    n: usize,
}

impl Op<1> for ScatterAddRows {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        (scatter_add_rows(x, &self.index, self.n), ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        [Some(gather_rows(dy, &self.index).reshaped(at.x[0].dims()))]
    }
}

/// Every row k times in succession.
struct RepeatRows {
    k: usize,
}

impl Op<1> for RepeatRows {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        let mut y = x.uninit_like(&[x.rows() * self.k, x.cols()]);
        map_rows(y.data_mut(), x.cols(), |first, piece| {
            for (i, row) in piece.chunks_exact_mut(x.cols().max(1)).enumerate() {
                row.copy_from_slice(x.row((first + i) / self.k));
            }
        });
        (y, ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let mut dx = dy.zeros_like_pool(at.x[0].dims());
        let c = dy.cols().max(1);
        for (o, group) in dx.data_mut().chunks_exact_mut(c).zip(dy.data().chunks_exact(c * self.k.max(1))) {
            add_row_sums(o, group);
        }
        [Some(dx)]
    }
}

/// max(x, least) in some rows, x in the others.
struct RaiseRows {
    index: Vec<u32>,
    least: f32,
}

impl Op<1> for RaiseRows {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        let mut y = x.clone();
        let c = x.cols();
        for &i in &self.index {
            let row = &mut y.data_mut()[i as usize * c..][..c];
            // Written so that NaN stays NaN.
            row.iter_mut().filter(|x| **x < self.least).for_each(|x| *x = self.least);
        }
        (y, ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let mut dx = dy.clone();
        let c = dy.cols();
        for &i in &self.index {
            let row = dx.data_mut()[i as usize * c..][..c].iter_mut();
            row.zip(at.x[0].row(i as usize)).filter(|(_, x)| **x < self.least).for_each(|(d, _)| *d = 0.0);
        }
        [Some(dx)]
    }
}

impl Tape {
    /// max(x, `least`) in the rows that `index` names, x in the others: n x c to the same.
    ///
    /// Gradient: 0 where a value was raised.
    ///
    /// # Panics
    /// If an index is n or more.
    #[track_caller]
    pub fn raise_rows(&mut self, x: Var, index: Vec<u32>, least: f32) -> Var {
        self.apply(RaiseRows { index, least }, [x])
    }

    /// Row i of the result is row `index[i]` of `x`: n x c to m x c.
    ///
    /// # Panics
    /// If an index is n or more.
    #[track_caller]
    pub fn gather_rows(&mut self, x: Var, index: impl Into<Arc<[u32]>>) -> Var {
        self.apply(GatherRows { index: index.into() }, [x])
    }

    /// Adds row i of `x` to row `index[i]` of n x c zeros: m x c to n x c.
    ///
    /// # Panics
    /// If there are not m indices or one is n or more.
    #[track_caller]
    pub fn scatter_add_rows(&mut self, x: Var, index: impl Into<Arc<[u32]>>, n: usize) -> Var {
        self.apply(ScatterAddRows { index: index.into(), n }, [x])
    }

    /// Weighted sums of three rows: row i of the result is the sum over the corners of their i-th weight times the row
    /// of `x` that their i-th index names; n x c to m x c. With barycentric weights, points on triangles of vertices
    /// `x`.
    ///
    /// # Panics
    /// If the corners do not have m indices and m weights each, or an index is n or more.
    #[track_caller]
    pub fn blend_rows(&mut self, x: Var, corners: [(Vec<u32>, Vec<f32>); 3]) -> Var {
        let [a, b, c] = corners.map(|(index, weight)| {
            let corner = self.gather_rows(x, index);
            let weight = self.constant(Tensor::from_vec(&[weight.len(), 1], weight));
            self.mul(corner, weight)
        });
        let ab = self.add(a, b);
        self.add(ab, c)
    }

    /// Every row k times in succession: n x c to (n k) x c.
    pub fn repeat_rows(&mut self, x: Var, k: usize) -> Var {
        self.apply(RepeatRows { k }, [x])
    }
}

#[cfg(test)]
mod tests {
    use crate::autodiff::Tape;
    use crate::ops::testing::{check, normal};
    use crate::tensor::Tensor;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..6, c in 1usize..5, index in prop::collection::vec(0u32..6, 1..12), k in 1usize..4, seed: u64) {
            let index: Vec<u32> = index.into_iter().map(|i| i % n as u32).collect();
            let x = normal(&[n, c], seed);
            let rows = normal(&[index.len(), c], seed ^ 1);
            check(|t, x| t.gather_rows(x[0], index.clone()), std::slice::from_ref(&x), seed);
            let corners = [2, 3, 5].map(|s| (index.clone(), normal(&[index.len(), 1], seed ^ s).data().to_vec()));
            check(|t, x| t.blend_rows(x[0], corners.clone()), std::slice::from_ref(&x), seed);
            check(|t, x| t.scatter_add_rows(x[0], index.clone(), n), &[rows], seed);
            check(|t, x| t.repeat_rows(x[0], k), std::slice::from_ref(&x), seed);
            check(|t, x| t.raise_rows(x[0], index.clone(), 0.3), &[x], seed);
        }

        /// Few rows, and as many as are written in several pieces.
        #[test]
        fn repeated_rows_are_the_row(n in prop_oneof![0usize..12, Just(7_000)], c in 1usize..4, k in 1usize..7) {
            let x = normal(&[n, c], 1);
            let mut tape = Tape::new();
            let v = tape.input(x.clone());
            let y = tape.repeat_rows(v, k);
            prop_assert!((0..n * k).all(|i| tape.value(y).row(i) == x.row(i / k)));
        }

        #[test]
        fn only_named_rows_are_raised(n in 0usize..12, c in 0usize..4, which: u16, seed: u64) {
            let x = normal(&[n, c], seed);
            let index: Vec<u32> = (0..n as u32).filter(|i| which >> i & 1 == 1).collect();
            let mut t = Tape::new();
            let var = t.input(x.clone());
            let y = t.raise_rows(var, index.clone(), 0.3);
            let gradients = t.pull([(y, Tensor::full(&[n, c], 1.0))]);
            for i in 0..n {
                for (j, &x) in x.row(i).iter().enumerate() {
                    let raised = index.contains(&(i as u32)) && x < 0.3;
                    let found = (t.value(y).row(i)[j], gradients.get(var).unwrap().row(i)[j]);
                    prop_assert_eq!(found, if raised { (0.3, 0.0) } else { (x, 1.0) });
                }
            }
        }
    }
}
