//! Sums and means: of everything, over rows, over columns, over groups of k rows.

use crate::autodiff::{At, Op, Tape, Var};
use crate::tensor::{Tensor, add_row_sums, map_rows, sum_f64};

/// A scale times the sum of all elements.
struct Sum {
    mean: bool,
}

impl Sum {
    fn factor(&self, n: usize) -> f32 {
        if self.mean { 1.0 / n.max(1) as f32 } else { 1.0 }
    }
}

impl Op<1> for Sum {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        let mut y = x.uninit_like(&[1, 1]);
        y.data_mut()[0] = (sum_f64(x.data()) * f64::from(self.factor(x.len()))) as f32;
        (y, ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let x = at.x[0];
        let mut dx = dy.uninit_like(x.dims());
        dx.data_mut().fill(dy.item() * self.factor(x.len()));
        [Some(dx)]
    }
}

/// The sum over the rows of every group of k: (n k) x c to n x c.
struct SumGroups {
    k: usize,
}

impl Op<1> for SumGroups {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        let c = x.cols();
        assert!(
            self.k > 0 && x.rows() % self.k == 0,
            "sum_groups: {:?} in groups of {} rows",
            x.shape(),
            self.k
        );
        let mut y = x.zeros_like_pool(&[x.rows() / self.k, c]);
        let groups = x.data().chunks_exact((self.k * c).max(1));
        for (o, group) in y.data_mut().chunks_exact_mut(c.max(1)).zip(groups) {
            add_row_sums(o, group);
        }
        (y, ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let c = dy.cols().max(1);
        let mut dx = dy.uninit_like(at.x[0].dims());
        map_rows(dx.data_mut(), c, |first, piece| {
            for (i, o) in piece.chunks_exact_mut(c).enumerate() {
                o.copy_from_slice(dy.row((first + i) / self.k));
            }
        });
        [Some(dx)]
    }
}

/// The sum over the columns of every row: n x c to n x 1.
struct SumCols;

impl Op<1> for SumCols {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        let mut y = x.uninit_like(&[x.rows(), 1]);
        for (o, row) in y.data_mut().iter_mut().zip(x.data().chunks_exact(x.cols().max(1))) {
            *o = row.iter().sum();
        }
        (y, ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let x = at.x[0];
        let mut dx = dy.uninit_like(x.dims());
        map_rows(dx.data_mut(), x.cols(), |first, piece| {
            for (row, &d) in piece.chunks_exact_mut(x.cols().max(1)).zip(&dy.data()[first..]) {
                row.fill(d);
            }
        });
        [Some(dx)]
    }
}

impl Tape {
    /// The sum of all elements, 1 x 1; added up in f64.
    pub fn sum(&mut self, x: Var) -> Var {
        self.apply(Sum { mean: false }, [x])
    }

    /// The mean of all elements, 1 x 1; added up in f64. The mean of nothing is 0.
    pub fn mean(&mut self, x: Var) -> Var {
        self.apply(Sum { mean: true }, [x])
    }

    /// The sum over rows: n x c to 1 x c.
    pub fn sum_rows(&mut self, x: Var) -> Var {
        let k = self.value(x).rows();
        self.sum_groups(x, k)
    }

    /// The sum over the columns of each row: n x c to n x 1.
    pub fn sum_cols(&mut self, x: Var) -> Var {
        self.apply(SumCols, [x])
    }

    /// The sum over the rows of every group of k: (n k) x c to n x c.
    ///
    /// # Panics
    /// If the number of rows is not a multiple of k.
    #[track_caller]
    pub fn sum_groups(&mut self, x: Var, k: usize) -> Var {
        self.apply(SumGroups { k }, [x])
    }
}

#[cfg(test)]
mod tests {
    use crate::autodiff::{Tape, Var};
    use crate::ops::testing::{check, normal};
    use crate::tensor::Tensor;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..5, k in 1usize..5, c in 1usize..6, seed: u64) {
            let x = normal(&[n * k, c], seed);
            let ops: [fn(&mut Tape, Var) -> Var; 4] = [Tape::sum, Tape::mean, Tape::sum_rows, Tape::sum_cols];
            for op in ops {
                check(|t, x| op(t, x[0]), std::slice::from_ref(&x), seed);
            }
            check(|t, x| t.sum_groups(x[0], k), &[x], seed);
        }
    }

    /// With as many rows as are filled in several pieces.
    #[test]
    fn gradients_of_sums_are_spread_over_all_rows() {
        let (n, k, c) = (6_000, 3, 4);
        let mut t = Tape::new();
        let x = t.input(normal(&[n * k, c], 1));
        let (weights_of_groups, weights_of_rows) = (normal(&[n, c], 2), normal(&[n * k, 1], 3));
        let (groups, rows) = (t.sum_groups(x, k), t.sum_cols(x));
        let (u, v) = (t.constant(weights_of_groups.clone()), t.constant(weights_of_rows.clone()));
        let (groups, rows) = (t.mul(groups, u), t.mul(rows, v));
        let (groups, rows) = (t.sum(groups), t.sum(rows));
        let both = t.add(groups, rows);
        let gradient = t.backward(both);
        let dx = gradient.get(x).unwrap();
        for i in 0..n * k {
            for j in 0..c {
                let want = weights_of_groups.row(i / k)[j] + weights_of_rows.row(i)[0];
                assert_eq!(dx.row(i)[j], want, "row {i}, column {j}");
            }
        }
    }

    #[test]
    fn sums_by_hand() {
        let mut t = Tape::new();
        let x = t.constant(Tensor::from_vec(&[4, 2], vec![1., 2., 3., 4., 5., 6., 7., 8.]));
        let (all, rows, cols, groups) = (t.mean(x), t.sum_rows(x), t.sum_cols(x), t.sum_groups(x, 2));
        assert_eq!(t.value(all).item(), 4.5);
        assert_eq!(t.value(rows).data(), [16., 20.]);
        assert_eq!(t.value(cols).data(), [3., 7., 11., 15.]);
        assert_eq!(t.value(groups).data(), [4., 6., 12., 14.]);
    }
}
