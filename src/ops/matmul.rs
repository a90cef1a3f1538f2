//! Matrix products in all transposed forms, and the affine map of a linear layer.

use crate::autodiff::{At, Op, Tape, Var};
use crate::tensor::{Base, Tensor, add_row_sums, gemm, matmul, matmul_nt, matmul_tn, matmul_tt};

/// op(a) op(b), each as it is or transposed.
struct MatMul {
    transpose_a: bool,
    transpose_b: bool,
}

impl Op<2> for MatMul {
    type Saved = ();
    fn forward(&self, [a, b]: [&Tensor; 2]) -> (Tensor, ()) {
        let y = match (self.transpose_a, self.transpose_b) {
            (false, false) => matmul(a, b),
            (false, true) => matmul_nt(a, b),
            (true, false) => matmul_tn(a, b),
            (true, true) => matmul_tt(a, b),
        };
        (y, ())
    }
    fn vjp(&self, at: At<'_, 2, ()>, dy: &Tensor) -> [Option<Tensor>; 2] {
        let [a, b] = at.x;
        let da = || match (self.transpose_a, self.transpose_b) {
            (false, false) => matmul_nt(dy, b),
            (false, true) => matmul(dy, b),
            (true, false) => matmul_nt(b, dy),
            (true, true) => matmul_tt(b, dy),
        };
        let db = || match (self.transpose_a, self.transpose_b) {
            (false, false) => matmul_tn(a, dy),
            (false, true) => matmul_tn(dy, a),
            (true, false) => matmul(a, dy),
            (true, true) => matmul_tt(dy, a),
        };
        [at.needs[0].then(da), at.needs[1].then(db)]
    }
}

/// x w + b, with the bias a row.
struct Linear;

impl Op<3> for Linear {
    type Saved = ();
    fn forward(&self, [x, w, b]: [&Tensor; 3]) -> (Tensor, ()) {
        let c = w.cols();
        assert!(b.len() == c, "linear: bias {:?} for weight {:?}", b.shape(), w.shape());
        let mut y = x.uninit_like(&[x.rows(), c]);
        gemm(y.data_mut(), c, Base::Row(b.data()), x.as_mat(), w.as_mat());
        (y, ())
    }
    fn vjp(&self, at: At<'_, 3, ()>, dy: &Tensor) -> [Option<Tensor>; 3] {
        let [x, w, b] = at.x;
        // Side by side: each of them alone has less to share out.
        let dx = || at.needs[0].then(|| matmul_nt(dy, w));
        let dw = || at.needs[1].then(|| matmul_tn(x, dy));
        let db = || {
            at.needs[2].then(|| {
                let mut db = dy.zeros_like_pool(b.dims());
                add_row_sums(db.data_mut(), dy.data());
                db
            })
        };
        let (dx, (dw, db)) = rayon::join(dx, || (dw(), db()));
        [dx, dw, db]
    }
}

impl Tape {
    /// a b; n x c times c x d.
    ///
    /// # Panics
    /// If the inner sides differ.
    #[track_caller]
    pub fn matmul(&mut self, a: Var, b: Var) -> Var {
        self.apply(MatMul { transpose_a: false, transpose_b: false }, [a, b])
    }

    /// a b^T; n x c times (d x c)^T.
    ///
    /// # Panics
    /// If the inner sides differ.
    #[track_caller]
    pub fn matmul_nt(&mut self, a: Var, b: Var) -> Var {
        self.apply(MatMul { transpose_a: false, transpose_b: true }, [a, b])
    }

    /// a^T b; (n x c)^T times n x d.
    ///
    /// # Panics
    /// If the inner sides differ.
    #[track_caller]
    pub fn matmul_tn(&mut self, a: Var, b: Var) -> Var {
        self.apply(MatMul { transpose_a: true, transpose_b: false }, [a, b])
    }

    /// a^T b^T.
    ///
    /// # Panics
    /// If the inner sides differ.
    #[track_caller]
    pub fn matmul_tt(&mut self, a: Var, b: Var) -> Var {
        self.apply(MatMul { transpose_a: true, transpose_b: true }, [a, b])
    }

    /// x w + b; x n x c, w c x d, b 1 x d.
    ///
    /// # Panics
    /// If the shapes do not fit.
    #[track_caller]
    pub fn linear(&mut self, x: Var, w: Var, b: Var) -> Var {
        self.apply(Linear, [x, w, b])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::{check, normal};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn gradients(n in 1usize..9, c in 1usize..9, d in 1usize..9, seed: u64) {
            for (transpose_a, transpose_b) in [(false, false), (false, true), (true, false), (true, true)] {
                let a = if transpose_a { [c, n] } else { [n, c] };
                let b = if transpose_b { [d, c] } else { [c, d] };
                let op = |t: &mut Tape, x: &[Var]| t.apply(MatMul { transpose_a, transpose_b }, [x[0], x[1]]);
                check(op, &[normal(&a, seed), normal(&b, seed ^ 1)], seed);
            }
            let inputs = [normal(&[n, c], seed), normal(&[c, d], seed ^ 1), normal(&[1, d], seed ^ 2)];
            check(|t, x| t.linear(x[0], x[1], x[2]), &inputs, seed);
        }
    }
}
