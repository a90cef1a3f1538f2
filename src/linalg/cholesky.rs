//! A large symmetric positive definite system, built from products and solved by blocks.
//!
//! Nearly all of the work is products of tall matrices, which nalgebra hands to kernels that use the whole processor;
//! its own factorisation goes column by column and is many times slower (`benches/accuracy.md`, constants). Tasks own
//! fixed blocks of columns and every block is worked on in the same order, so the threads do not change a bit.

use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut, Dyn};
use rayon::prelude::*;

/// Columns of a block.
const BLOCK: usize = 128;

/// The lower triangle of a symmetric n x n matrix, column by column; what is above it has no meaning.
pub(crate) struct Symmetric {
    n: usize,
    data: Vec<f64>,
}

impl Symmetric {
    /// n x n zeros.
    pub fn zeros(n: usize) -> Self {
        Symmetric { n, data: vec![0.0; n * n] }
    }

    /// The matrix whose columns `fill` writes, each a slice of n; what it writes above the diagonal is not read.
    pub fn from_columns(n: usize, fill: impl Fn(usize, &mut [f64]) + Sync) -> Self {
        let mut data = vec![0.0; n * n];
        if n > 0 {
            data.par_chunks_mut(n).enumerate().for_each(|(j, column)| fill(j, column));
        }
        Symmetric { n, data }
    }

    /// Multiplies the diagonal.
    pub fn scale_diagonal(&mut self, by: f64) {
        self.data.iter_mut().step_by(self.n + 1).for_each(|x| *x *= by);
    }

    /// Adds `alpha` P P^T to the rows and columns from `first` on, for the panel P (n - first x k, column by column).
    pub fn add_product(&mut self, first: usize, alpha: f64, panel: &[f64]) {
        let n = self.n;
        let rows = n - first;
        if rows == 0 {
            return;
        }
        let k = panel.len() / rows;
        self.data[first * n..].par_chunks_mut(BLOCK * n).enumerate().for_each(|(block, columns)| {
            let (at, width) = (block * BLOCK, columns.len() / n);
            let strides = (Dyn(1), Dyn(rows));
            let left = DMatrixView::from_slice_with_strides_generic(
                &panel[at..],
                Dyn(rows - at),
                Dyn(k),
                strides.0,
                strides.1,
            );
            // The same panel read across: k x width.
            let right = DMatrixView::from_slice_with_strides_generic(
                &panel[at..],
                Dyn(k),
                Dyn(width),
                Dyn(rows),
                Dyn(1),
            );
            let mut out = DMatrixViewMut::from_slice_with_strides_generic(
                &mut columns[first + at..],
                Dyn(rows - at),
                Dyn(width),
                Dyn(1),
                Dyn(n),
            );
            out.gemm(alpha, &left, &right, 1.0);
        });
    }

    /// Factors A = L L^T in place and returns the inverses of the diagonal blocks of L; `None` if A is not positive
    /// definite.
    fn factor(&mut self) -> Option<Vec<DMatrix<f64>>> {
        let n = self.n;
        let mut inverses = Vec::with_capacity(n.div_ceil(BLOCK));
        for at in (0..n).step_by(BLOCK) {
            let width = BLOCK.min(n - at);
            let inverse = self.factor_diagonal(at, width)?;
            let below = n - at - width;
            if below > 0 {
                // L21 = A21 L11^-T, kept in its place and, in one piece, for the rest of the matrix.
                let under = &mut self.data[at * n + at + width..];
                let old = DMatrixView::from_slice_with_strides_generic(
                    &*under,
                    Dyn(below),
                    Dyn(width),
                    Dyn(1),
                    Dyn(n),
                );
                let panel: DMatrix<f64> = old * inverse.transpose();
                for (j, values) in panel.as_slice().chunks_exact(below).enumerate() {
                    under[j * n..][..below].copy_from_slice(values);
                }
                self.add_product(at + width, -1.0, panel.as_slice());
            }
            inverses.push(inverse);
        }
        Some(inverses)
    }

    /// The solution x of A x = b (n); `None` if A is not positive definite.
    pub fn solve(mut self, mut b: Vec<f64>) -> Option<Vec<f64>> {
        self.factor()?;
        // L y = b, then L^T x = y.
        let n = self.n;
        for j in 0..n {
            let column = &self.data[j * n..(j + 1) * n];
            b[j] /= column[j];
            let y = b[j];
            b[j + 1..].iter_mut().zip(&column[j + 1..]).for_each(|(b, l)| *b -= l * y);
        }
        for j in (0..n).rev() {
            let column = &self.data[j * n..(j + 1) * n];
            let known: f64 = column[j + 1..].iter().zip(&b[j + 1..]).map(|(l, x)| l * x).sum();
            b[j] = (b[j] - known) / column[j];
        }
        b.iter().all(|x| x.is_finite()).then_some(b)
    }

    /// The inverse, n x n with both triangles; `None` if A is not positive definite.
    pub fn inverse(mut self) -> Option<DMatrix<f64>> {
        let n = self.n;
        let diagonal = self.factor()?;
        // X = L^-1, one block of columns at a time, from the top: X_r = L_rr^-1 (I_r - sum_(k < r) L_rk X_k). Kept
        // transposed, for A^-1 = X^T X is then a product as the rest of this file has it.
        let data = &self.data;
        let columns: Vec<DMatrix<f64>> = (0..diagonal.len())
            .into_par_iter()
            .map(|c| {
                let (first, width) = (c * BLOCK, diagonal[c].nrows());
                let mut x = DMatrix::<f64>::zeros(n, width);
                x.view_mut((first, 0), (width, width)).copy_from(&diagonal[c]);
                for (r, inverse) in diagonal.iter().enumerate().skip(c + 1) {
                    let (at, height) = (r * BLOCK, inverse.nrows());
                    let left = DMatrixView::from_slice_with_strides_generic(
                        &data[first * n + at..],
                        Dyn(height),
                        Dyn(at - first),
                        Dyn(1),
                        Dyn(n),
                    );
                    let known = left * x.rows(first, at - first);
                    x.rows_mut(at, height).copy_from(&(inverse * -known));
                }
                x
            })
            .collect();
        let mut transposed = DMatrix::<f64>::zeros(n, n);
        for (c, x) in columns.iter().enumerate() {
            transposed.rows_mut(c * BLOCK, x.ncols()).copy_from(&x.transpose());
        }
        let mut product = Symmetric::zeros(n);
        product.add_product(0, 1.0, transposed.as_slice());
        let mut full = DMatrix::from_vec(n, n, product.data);
        full.fill_upper_triangle_with_lower_triangle();
        full.iter().all(|x| x.is_finite()).then_some(full)
    }

    /// Factors a diagonal block in place, L11 L11^T = A11, and returns the inverse of L11.
    fn factor_diagonal(&mut self, at: usize, width: usize) -> Option<DMatrix<f64>> {
        let n = self.n;
        let block = DMatrix::from_fn(width, width, |i, j| self.data[(at + j.min(i)) * n + at + i.max(j)]);
        let factor = block.cholesky()?.unpack();
        for (j, column) in factor.column_iter().enumerate() {
            let place = &mut self.data[(at + j) * n + at + j..][..width - j];
            place.iter_mut().zip(column.iter().skip(j)).for_each(|(out, x)| *out = *x);
        }
        factor.solve_lower_triangular(&DMatrix::identity(width, width))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DVector;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    fn panel(rows: usize, k: usize, seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..rows * k).map(|_| rng.random_range(-1.0..1.0)).collect()
    }

    #[test]
    fn solves_what_the_plain_factorisation_solves() {
        for n in (0..=12).chain([127, 128, 129, 300]) {
            let mut system = Symmetric::zeros(n);
            let mut plain = DMatrix::<f64>::zeros(n, n);
            for (seed, k) in [(1, n / 2 + 1), (2, 7)] {
                let p = panel(n, k, seed);
                system.add_product(0, 1.0, &p);
                let p = DMatrix::from_vec(n, k, p);
                plain += &p * p.transpose();
            }
            system.scale_diagonal(1.5);
            for i in 0..n {
                plain[(i, i)] *= 1.5;
            }
            let (again, whole) = (Symmetric { n, data: system.data.clone() }, plain.clone());
            let b = panel(n, 1, 3);
            let x = DVector::from_vec(system.solve(b.clone()).unwrap());
            let residual = (&plain * &x - DVector::from_vec(b.clone())).amax();
            assert!(n == 0 || residual < 1e-9 * plain.amax(), "n {n}: residual {residual:e}");
            let want = plain.cholesky().unwrap().solve(&DVector::from_vec(b));
            assert!((&x - &want).norm() <= 1e-8 * want.norm(), "n {n}");
            let inverse = again.inverse().unwrap();
            let off = (&inverse * &whole - DMatrix::identity(n, n)).amax();
            assert!(n == 0 || off < 1e-9, "n {n}: the inverse is {off:e} off");
            assert_eq!(inverse, inverse.transpose());
        }
    }

    #[test]
    fn what_is_not_positive_definite_has_no_solution() {
        for (n, bad) in [(1, 0.0), (5, -1.0), (200, f64::NAN), (200, 0.0)] {
            let mut system = Symmetric::zeros(n);
            system.data.iter_mut().step_by(n + 1).for_each(|x| *x = 1.0);
            system.data[(n - 1) * (n + 1)] = bad;
            let again = Symmetric { n, data: system.data.clone() };
            assert!(system.solve(vec![1.0; n]).is_none(), "{n} {bad}");
            assert!(again.inverse().is_none(), "{n} {bad}");
        }
    }

    #[test]
    fn the_threads_do_not_change_a_bit() {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut system = Symmetric::zeros(400);
                system.add_product(0, 1.0, &panel(400, 90, 1));
                system.scale_diagonal(1.1);
                system.solve(panel(400, 1, 2)).unwrap()
            })
        };
        let one = on(1);
        assert!(one == on(2) && one == on(3));
    }
}
