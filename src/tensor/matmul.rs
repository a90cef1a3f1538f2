//! Matrix products in all transposed forms.
//!
//! Full shapes go to nalgebra's `gemm`, which reaches the packed kernels of `matrixmultiply`; thin ones (a side of at
//! most [`THIN`]) have loops of their own, because packing costs more than it saves there. Large products are split
//! into row blocks over rayon; the split depends on the shape alone.

use super::simd::kernel;
use super::{Tensor, dot};
use nalgebra::{DMatrixView, DMatrixViewMut, Dyn};
use rayon::prelude::*;

/// A side of at most this many takes a thin path.
const THIN: usize = 5;
/// Rows of the result a thread works on at a time.
const BLOCK: usize = 256;
/// Multiply-adds below which a product stays on the calling thread.
const PARALLEL_MIN: usize = 1 << 22;

/// A matrix with strides, seen in a slice.
#[derive(Clone, Copy)]
pub(crate) struct MatRef<'a> {
    pub(crate) data: &'a [f32],
    pub(crate) rows: usize,
    pub(crate) cols: usize,
    pub(crate) row_stride: usize,
    pub(crate) col_stride: usize,
}

impl<'a> MatRef<'a> {
    /// A row-major tensor as rows x cols.
    pub(crate) fn of(t: &'a Tensor) -> Self {
        Self::window(t.data(), t.rows(), t.cols(), t.cols())
    }

    /// rows x cols with contiguous rows `row_stride` apart.
    pub(crate) fn window(data: &'a [f32], rows: usize, cols: usize, row_stride: usize) -> Self {
        MatRef { data, rows, cols, row_stride, col_stride: 1 }
    }

    /// The transpose.
    pub(crate) fn t(self) -> Self {
        MatRef {
            data: self.data,
            rows: self.cols,
            cols: self.rows,
            row_stride: self.col_stride,
            col_stride: self.row_stride,
        }
    }

    fn skip_rows(self, first: usize, rows: usize) -> Self {
        MatRef { data: &self.data[first * self.row_stride..], rows, ..self }
    }
}

/// out = beta out + a b, where `out` has a.rows rows of b.cols values, `stride` apart.
///
/// # Panics
/// If the inner sides differ or `out` is too short.
#[track_caller]
pub(crate) fn gemm(out: &mut [f32], stride: usize, beta: f32, a: MatRef<'_>, b: MatRef<'_>) {
    let (m, k, n) = (a.rows, a.cols, b.cols);
    assert!(k == b.rows, "matmul: [{m}x{k}] and [{}x{n}]", b.rows);
    if m == 0 || n == 0 {
        return;
    }
    assert!(out.len() >= (m - 1) * stride + n, "matmul: result of {} values for [{m}x{n}]", out.len());
    if m * n * k < PARALLEL_MIN || m < 2 * BLOCK {
        gemm_block(out, stride, beta, a, b);
    } else {
        out.par_chunks_mut(BLOCK * stride).enumerate().for_each(|(i, piece)| {
            let first = i * BLOCK;
            if first < m {
                let rows = BLOCK.min(m - first);
                gemm_block(piece, stride, beta, a.skip_rows(first, rows), b);
            }
        });
    }
}

/// One block on the calling thread.
fn gemm_block(out: &mut [f32], stride: usize, beta: f32, a: MatRef<'_>, b: MatRef<'_>) {
    let (m, k, n) = (a.rows, a.cols, b.cols);
    if k == 0 || m <= THIN || k <= THIN || n <= THIN {
        return thin(out, stride, beta, a, b);
    }
    let a = DMatrixView::from_slice_with_strides_generic(
        a.data,
        Dyn(m),
        Dyn(k),
        Dyn(a.row_stride),
        Dyn(a.col_stride),
    );
    let b = DMatrixView::from_slice_with_strides_generic(
        b.data,
        Dyn(k),
        Dyn(n),
        Dyn(b.row_stride),
        Dyn(b.col_stride),
    );
    let mut c = DMatrixViewMut::from_slice_with_strides_generic(out, Dyn(m), Dyn(n), Dyn(stride), Dyn(1));
    c.gemm(1.0, &a, &b, beta);
}

/// Products with a side of at most [`THIN`], as sums of scaled rows or as dot products.
fn thin(out: &mut [f32], stride: usize, beta: f32, a: MatRef<'_>, b: MatRef<'_>) {
    let (m, k, n) = (a.rows, a.cols, b.cols);
    for row in out.chunks_mut(stride).take(m) {
        for o in &mut row[..n] {
            *o = if beta == 0.0 { 0.0 } else { *o * beta };
        }
    }
    if n <= THIN && a.col_stride == 1 && k > THIN {
        // Few columns: one dot product a value, over a contiguous copy of each column of b.
        let column = |j: usize| (0..k).map(move |l| b.data[l * b.row_stride + j * b.col_stride]);
        let columns: Vec<f32> = (0..n).flat_map(column).collect();
        for (i, row) in out.chunks_mut(stride).take(m).enumerate() {
            let x = &a.data[i * a.row_stride..][..k];
            for (o, c) in row[..n].iter_mut().zip(columns.chunks_exact(k)) {
                *o += dot(x, c);
            }
        }
    } else if b.col_stride == 1 {
        thin_axpy(out, stride, a, b);
    } else {
        for (i, row) in out.chunks_mut(stride).take(m).enumerate() {
            for (j, o) in row[..n].iter_mut().enumerate() {
                for l in 0..k {
                    *o += a.data[i * a.row_stride + l * a.col_stride]
                        * b.data[l * b.row_stride + j * b.col_stride];
                }
            }
        }
    }
}

kernel! {
    /// out += a b by rows of b, in whichever loop order keeps the moving row in cache.
    fn thin_axpy(out: &mut [f32], stride: usize, a: MatRef<'_>, b: MatRef<'_>) {
        let (m, k, n) = (a.rows, a.cols, b.cols);
        if m <= k {
            for l in 0..k {
                let row = &b.data[l * b.row_stride..][..n];
                for i in 0..m {
                    let s = a.data[i * a.row_stride + l * a.col_stride];
                    for (o, &v) in out[i * stride..][..n].iter_mut().zip(row) { *o += s * v; }
                }
            }
        } else {
            for i in 0..m {
                let target = &mut out[i * stride..][..n];
                for l in 0..k {
                    let s = a.data[i * a.row_stride + l * a.col_stride];
                    let row = &b.data[l * b.row_stride..][..n];
                    for (o, &v) in target.iter_mut().zip(row) { *o += s * v; }
                }
            }
        }
    }
}

#[track_caller]
fn product(like: &Tensor, a: MatRef<'_>, b: MatRef<'_>) -> Tensor {
    let mut out = like.dirty(&[a.rows, b.cols]);
    gemm(out.data_mut(), b.cols, 0.0, a, b);
    out
}

/// a b; n x c times c x d.
///
/// # Panics
/// If the inner sides differ.
#[track_caller]
pub fn matmul(a: &Tensor, b: &Tensor) -> Tensor {
    product(a, MatRef::of(a), MatRef::of(b))
}

/// a b^T; n x c times (d x c)^T.
///
/// # Panics
/// If the inner sides differ.
#[track_caller]
pub fn matmul_nt(a: &Tensor, b: &Tensor) -> Tensor {
    product(a, MatRef::of(a), MatRef::of(b).t())
}

/// a^T b; (n x c)^T times n x d.
///
/// # Panics
/// If the inner sides differ.
#[track_caller]
pub fn matmul_tn(a: &Tensor, b: &Tensor) -> Tensor {
    product(a, MatRef::of(a).t(), MatRef::of(b))
}

/// a^T b^T.
///
/// # Panics
/// If the inner sides differ.
#[track_caller]
pub fn matmul_tt(a: &Tensor, b: &Tensor) -> Tensor {
    product(a, MatRef::of(a).t(), MatRef::of(b).t())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(rows: usize, cols: usize, phase: f32) -> Tensor {
        let values = (0..rows * cols).map(|i| (i as f32 * 0.7 + phase).sin()).collect();
        Tensor::from_vec(&[rows, cols], values)
    }

    fn transposed(x: &Tensor) -> Tensor {
        let (n, c) = (x.rows(), x.cols());
        let values = (0..c * n).map(|i| x.data()[(i % n.max(1)) * c + i / n.max(1)]).collect();
        Tensor::from_vec(&[c, n], values)
    }

    fn naive(a: &Tensor, b: &Tensor) -> Vec<f64> {
        let (m, k, n) = (a.rows(), a.cols(), b.cols());
        let at = |i: usize, j: usize| {
            (0..k).map(|l| f64::from(a.data()[i * k + l]) * f64::from(b.data()[l * n + j])).sum()
        };
        (0..m * n).map(|e| at(e / n, e % n)).collect()
    }

    fn close(a: &Tensor, truth: &[f64]) {
        assert_eq!(a.len(), truth.len());
        for (x, t) in a.data().iter().zip(truth) {
            assert!((f64::from(*x) - t).abs() < 1e-5 * (1.0 + t.abs()), "{x} {t}");
        }
    }

    #[test]
    fn all_forms_agree_with_the_naive_product() {
        let mut sizes: Vec<(usize, usize, usize)> =
            vec![(700, 128, 64), (1100, 70, 130), (64, 3000, 3), (3, 900, 64)];
        for m in 0..12 {
            for k in 0..12 {
                sizes.extend((0..12).map(|n| (m, k, n)));
            }
        }
        for (m, k, n) in sizes {
            let (a, b) = (filled(m, k, 0.1), filled(k, n, 1.3));
            let truth = naive(&a, &b);
            close(&matmul(&a, &b), &truth);
            close(&matmul_nt(&a, &transposed(&b)), &truth);
            close(&matmul_tn(&transposed(&a), &b), &truth);
            close(&matmul_tt(&transposed(&a), &transposed(&b)), &truth);
        }
    }

    #[test]
    fn strided_result_adds_to_what_is_there() {
        let (a, b) = (filled(9, 7, 0.0), filled(7, 8, 0.5));
        let truth = naive(&a, &b);
        let mut out = vec![1.0; 9 * 20];
        gemm(&mut out, 20, 1.0, MatRef::of(&a), MatRef::of(&b));
        for i in 0..9 {
            for j in 0..20 {
                let t = if j < 8 { truth[i * 8 + j] + 1.0 } else { 1.0 };
                assert!((f64::from(out[i * 20 + j]) - t).abs() < 1e-5);
            }
        }
    }

    #[test]
    #[should_panic(expected = "matmul: [2x3] and [4x5]")]
    fn wrong_inner_side_names_both_shapes() {
        let _ = matmul(&Tensor::zeros(&[2, 3]), &Tensor::zeros(&[4, 5]));
    }
}
