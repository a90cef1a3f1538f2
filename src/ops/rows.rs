//! Moving rows by index: gather, its transpose scatter-add, and repetition.

use crate::autodiff::{At, Op, Tape, Var};
use crate::tensor::{Tensor, gather_rows, scatter_add_rows};
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
        for (i, row) in y.data_mut().chunks_exact_mut(x.cols().max(1)).enumerate() {
            row.copy_from_slice(x.row(i / self.k));
        }
        (y, ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let mut dx = dy.zeros_like_pool(at.x[0].dims());
        let c = dy.cols().max(1);
        for (o, group) in dx.data_mut().chunks_exact_mut(c).zip(dy.data().chunks_exact(c * self.k.max(1))) {
            crate::tensor::add_row_sums(o, group);
        }
        [Some(dx)]
    }
}

impl Tape {
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
    use crate::ops::testing::{check, normal};
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
            check(|t, x| t.repeat_rows(x[0], k), &[x], seed);
        }
    }
}
