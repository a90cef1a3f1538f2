//! Matrix products in all transposed forms.
//!
//! The right side is copied into panels of a few columns, the left side is read as it lies, and the sums of a small
//! tile of the result stay in registers while k runs. Thin products (a side of a few rows or columns) have loops of
//! their own. Every value of the result is summed in the same order however the work is split, so large products are
//! split into row blocks over rayon freely.

use super::simd::{Target, kernel, multiply_panel, panel_width};
use super::{Tensor, dot};
use rayon::prelude::*;
use std::cell::Cell;

/// A left or inner side of at most this many takes a thin path.
const THIN: usize = 5;
/// So does a right side of at most this many columns: a panel would be mostly zeros.
const THIN_RIGHT: usize = 2;
/// Rows of the left side that a panel covers: a panel of so many rows stays in the first-level cache.
const DEPTH: usize = 256;
/// Rows of the result that a thread works on at a time; whole tiles for every instruction set.
const BLOCK: usize = 96;
/// The same for results of few rows, such as gradients of weights.
const SMALL_BLOCK: usize = 24;
/// Multiply-adds below which a product stays on the calling thread.
const PARALLEL_MIN: usize = 1 << 20;
/// Values of a right side below which its panels are filled on the calling thread.
const COPY_MIN: usize = 1 << 17;

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

    /// `rows` x `cols` from a row and a column on.
    fn part(self, first_row: usize, rows: usize, first_col: usize, cols: usize) -> Self {
        let start = first_row * self.row_stride + first_col * self.col_stride;
        MatRef { data: &self.data[start..], rows, cols, ..self }
    }
}

/// The right side of products, k x n, in panels: for each block of [`DEPTH`] rows, panel after panel of the columns,
/// each row by row and filled up with zeros.
#[derive(Clone, Debug, Default)]
pub(crate) struct Panels {
    data: Vec<f32>,
    rows: usize,
    cols: usize,
}

impl Panels {
    /// Makes these the panels of a matrix, in the memory that is there.
    pub(crate) fn fill(&mut self, b: MatRef<'_>) {
        let width = panel_width();
        (self.rows, self.cols) = (b.rows, b.cols);
        let len = b.rows * b.cols.next_multiple_of(width);
        if self.data.len() < len {
            self.data.resize(len, 0.0);
        }
        let data = &mut self.data[..len];
        let deep = DEPTH * b.cols.next_multiple_of(width);
        let fill = |(i, part): (usize, &mut [f32])| {
            let first = i * DEPTH;
            let rows = DEPTH.min(b.rows - first);
            let columns = (0..b.cols).step_by(width);
            for (column, panel) in columns.zip(part.chunks_exact_mut(rows * width)) {
                let cols = width.min(b.cols - column);
                let from = &b.data[first * b.row_stride + column * b.col_stride..];
                if b.col_stride != 1 {
                    fill_turned(panel, width, from, b, cols);
                } else if cols < width {
                    fill_part(panel, width, from, b.row_stride, cols);
                } else if width == 32 {
                    fill_whole::<32>(panel, from, b.row_stride);
                } else {
                    fill_whole::<16>(panel, from, b.row_stride);
                }
            }
        };
        if len < COPY_MIN {
            data.chunks_mut(deep.max(1)).enumerate().for_each(fill);
        } else {
            data.par_chunks_mut(deep).enumerate().for_each(fill);
        }
    }
}

thread_local! {
    /// Panels of the products on this thread, so that their memory is not asked for again and again.
    static PANELS: Cell<Panels> = const { Cell::new(Panels { data: Vec::new(), rows: 0, cols: 0 }) };
}

/// A panel of W columns out of contiguous rows.
fn fill_whole<const W: usize>(panel: &mut [f32], from: &[f32], stride: usize) {
    for (l, to) in panel.as_chunks_mut::<W>().0.iter_mut().enumerate() {
        to.copy_from_slice(&from[l * stride..][..W]);
    }
}

/// The first `cols` columns of a panel out of contiguous rows, zeros in the others.
fn fill_part(panel: &mut [f32], width: usize, from: &[f32], stride: usize, cols: usize) {
    for (l, to) in panel.chunks_exact_mut(width).enumerate() {
        to[..cols].copy_from_slice(&from[l * stride..][..cols]);
        to[cols..].fill(0.0);
    }
}

/// The first `cols` columns of a panel out of a matrix with strides, zeros in the others.
fn fill_turned(panel: &mut [f32], width: usize, from: &[f32], b: MatRef<'_>, cols: usize) {
    if cols < width {
        panel.fill(0.0);
    }
    for j in 0..cols {
        let from = &from[j * b.col_stride..];
        for (l, to) in panel[j..].iter_mut().step_by(width).enumerate() {
            *to = from[l * b.row_stride];
        }
    }
}

/// out (+)= a b, where `out` has a.rows rows of b.cols values, `stride` apart.
///
/// # Panics
/// If the inner sides differ or `out` is too short.
#[track_caller]
pub(crate) fn gemm(out: &mut [f32], stride: usize, add: bool, a: MatRef<'_>, b: MatRef<'_>) {
    let (m, k, n) = (a.rows, a.cols, b.cols);
    if is_empty(out, stride, a, b.rows, n) {
        return;
    }
    if k == 0 || m <= THIN || k <= THIN || n <= thin_right(a) {
        thin(out, stride, add, a, b);
    } else {
        // Taken out, not borrowed: while this thread waits for others it may begin another product.
        let mut panels = PANELS.take();
        panels.fill(b);
        gemm_panels(out, stride, add, a, &panels);
        PANELS.set(panels);
    }
}

/// Whether a product with a k x n right side has no values. Panics as [`gemm`].
#[track_caller]
fn is_empty(out: &[f32], stride: usize, a: MatRef<'_>, k: usize, n: usize) -> bool {
    let m = a.rows;
    assert!(a.cols == k, "matmul: [{m}x{}] and [{k}x{n}]", a.cols);
    let empty = m == 0 || n == 0;
    let long_enough = empty || out.len() >= (m - 1) * stride + n;
    assert!(long_enough, "matmul: result of {} values for [{m}x{n}]", out.len());
    empty
}

/// Columns up to which the right side of a product with `a` takes a thin path: a transposed left side goes well with
/// whole rows of the transposed result.
fn thin_right(a: MatRef<'_>) -> usize {
    if a.row_stride == 1 { THIN } else { THIN_RIGHT }
}

/// [`gemm`] with a right side that has been put into panels before.
///
/// # Panics
/// As [`gemm`], and if the inner side is 0.
#[track_caller]
pub(crate) fn gemm_panels(out: &mut [f32], stride: usize, add: bool, a: MatRef<'_>, b: &Panels) {
    let (m, k, n) = (a.rows, a.cols, b.cols);
    if is_empty(out, stride, a, b.rows, n) {
        return;
    }
    assert!(k > 0, "matmul: panels of no rows");
    if m * n * k < PARALLEL_MIN || m <= SMALL_BLOCK {
        gemm_rows(out, stride, add, a, 0, m, b);
    } else {
        let block = if m < 8 * BLOCK { SMALL_BLOCK } else { BLOCK };
        out.par_chunks_mut(block * stride).enumerate().for_each(|(i, piece)| {
            let first = i * block;
            if first < m {
                gemm_rows(piece, stride, add, a, first, block.min(m - first), b);
            }
        });
    }
}

/// Some rows of the product on the calling thread.
fn gemm_rows(
    out: &mut [f32],
    stride: usize,
    add: bool,
    a: MatRef<'_>,
    first: usize,
    rows: usize,
    b: &Panels,
) {
    let panel_cols = panel_width();
    let mut rest = &b.data[..];
    for depth in (0..b.rows).step_by(DEPTH) {
        let cols = DEPTH.min(b.rows - depth);
        for column in (0..b.cols).step_by(panel_cols) {
            let (panel, after) = rest.split_at(cols * panel_cols);
            rest = after;
            let width = panel_cols.min(b.cols - column);
            let target = Target { data: &mut out[column..], width, stride, add: add || depth > 0 };
            multiply_panel(target, a.part(first, rows, depth, cols), panel);
        }
    }
}

/// Products with a thin side, as sums of scaled rows or as dot products.
fn thin(out: &mut [f32], stride: usize, add: bool, a: MatRef<'_>, b: MatRef<'_>) {
    let (m, k, n) = (a.rows, a.cols, b.cols);
    if !add {
        out.chunks_mut(stride).take(m).for_each(|row| row[..n].fill(0.0));
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
    } else if n <= THIN && a.row_stride == 1 && m > THIN {
        // The transposed product has long rows: n x m = b^T a^T.
        let mut turned = vec![0.0; n * m];
        thin_axpy(&mut turned, m, b.t(), a.t());
        for (i, row) in out.chunks_mut(stride).take(m).enumerate() {
            row[..n].iter_mut().zip(turned[i..].iter().step_by(m)).for_each(|(o, t)| *o += t);
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
    gemm(out.data_mut(), b.cols, false, a, b);
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
        // Small and large blocks of rows, and with 300 x 500 a right side whose panels several threads fill.
        let mut sizes: Vec<(usize, usize, usize)> =
            vec![(700, 128, 64), (1100, 70, 130), (30, 300, 500), (64, 3000, 3), (3, 900, 64)];
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
        gemm(&mut out, 20, true, MatRef::of(&a), MatRef::of(&b));
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
