//! Matrix products in all transposed forms.
//!
//! Large products go to the tiles of [`crate::simd::product`], split into row blocks over rayon: every value of the
//! result is summed in the same order however the work is split. Thin products (a side of a few rows or columns) have
//! loops of their own.

use super::{Tensor, dot};
use crate::simd::kernel;
use crate::simd::product::{Base, DEPTH, Destination, MatRef, Panels, multiply};
use rayon::prelude::*;
use std::cell::Cell;

/// A left or inner side of at most this many takes a thin path.
const MAX_THIN: usize = 5;
/// So does a right side of at most this many columns: a panel would be mostly zeros.
const MAX_THIN_RIGHT: usize = 2;
/// Rows of the result that a thread works on at a time; whole tiles for every instruction set.
const BLOCK: usize = 96;
/// The same for results of few rows, such as gradients of weights.
const SMALL_BLOCK: usize = 24;
/// Multiply-adds below which a product stays on the calling thread.
const MIN_PARALLEL: usize = 1 << 20;

/// Values of panels that a thread keeps from one product to the next, 4 MB: right sides of up to about 4,000 columns.
/// What is larger is given back, since the threads of the pool live as long as the program.
const MAX_KEPT: usize = 1 << 20;

thread_local! {
    /// Panels of the products on this thread, so that their memory is not asked for again and again.
    static PANELS: Cell<Panels> = const { Cell::new(Panels::new()) };
}

/// out = base + a b, where `out` has a.rows rows of b.cols values, `stride` apart.
///
/// # Panics
/// If the inner sides differ or `out` is too short.
#[track_caller]
pub(crate) fn gemm(out: &mut [f32], stride: usize, base: Base<'_>, a: MatRef<'_>, b: MatRef<'_>) {
    gemm_with(out, stride, base, a, b, true);
}

/// [`gemm`] on the calling thread alone, for work that is one of many parallel pieces already.
///
/// # Panics
/// As [`gemm`].
#[track_caller]
pub(crate) fn gemm_serial(out: &mut [f32], stride: usize, base: Base<'_>, a: MatRef<'_>, b: MatRef<'_>) {
    gemm_with(out, stride, base, a, b, false);
}

#[track_caller]
fn gemm_with(out: &mut [f32], stride: usize, base: Base<'_>, a: MatRef<'_>, b: MatRef<'_>, parallel: bool) {
    let (m, k, n) = (a.rows(), a.cols(), b.cols());
    if is_empty(out, stride, a, b.rows(), n) {
        return;
    }
    if k == 0 || m <= MAX_THIN || k <= MAX_THIN || n <= thin_right(a) {
        if parallel && m * n * k >= MIN_PARALLEL && m > BLOCK && !a.is_transposed() {
            out.par_chunks_mut(BLOCK * stride).enumerate().for_each(|(i, piece)| {
                let first = i * BLOCK;
                if first < m {
                    thin(piece, stride, base, a.part(first, BLOCK.min(m - first), 0, k), b);
                }
            });
        } else {
            thin(out, stride, base, a, b);
        }
    } else {
        let product = if parallel { gemm_panels } else { gemm_panels_serial };
        // Taken out, not borrowed: while this thread waits for others it may begin another product.
        let mut panels = PANELS.take();
        // One panel's depth at a time: its panels are still in the cache when they are used.
        for first in (0..k).step_by(DEPTH) {
            let depth = DEPTH.min(k - first);
            panels.fill(b.part(first, depth, 0, n));
            let base = if first == 0 { base } else { Base::Out };
            product(out, stride, base, a.part(0, m, first, depth), &panels);
        }
        if panels.capacity() <= MAX_KEPT {
            PANELS.set(panels);
        }
    }
}

/// Whether a product with a k x n right side has no values. Panics as [`gemm`].
#[track_caller]
fn is_empty(out: &[f32], stride: usize, a: MatRef<'_>, k: usize, n: usize) -> bool {
    let m = a.rows();
    assert!(a.cols() == k, "matmul: [{m}x{}] and [{k}x{n}]", a.cols());
    let empty = m == 0 || n == 0;
    let long_enough = empty || out.len() >= (m - 1) * stride + n;
    assert!(long_enough, "matmul: result of {} values for [{m}x{n}]", out.len());
    empty
}

/// Columns up to which the right side of a product with `a` takes a thin path: a transposed left side goes well with
/// whole rows of the transposed result.
fn thin_right(a: MatRef<'_>) -> usize {
    if a.is_transposed() { MAX_THIN } else { MAX_THIN_RIGHT }
}

/// [`gemm`] with a right side that has been put into panels before.
///
/// # Panics
/// As [`gemm`], and if the inner side is 0.
#[track_caller]
pub(crate) fn gemm_panels(out: &mut [f32], stride: usize, base: Base<'_>, a: MatRef<'_>, b: &Panels) {
    let (m, k, n) = (a.rows(), a.cols(), b.cols());
    if is_empty(out, stride, a, b.rows(), n) {
        return;
    }
    assert!(k > 0, "matmul: panels of no rows");
    if m * n * k < MIN_PARALLEL || m <= SMALL_BLOCK {
        multiply(Destination { data: out, stride, base }, a, b);
    } else {
        let block = if m < 8 * BLOCK { SMALL_BLOCK } else { BLOCK };
        out.par_chunks_mut(block * stride).enumerate().for_each(|(i, piece)| {
            let first = i * block;
            if first < m {
                let a = a.part(first, block.min(m - first), 0, k);
                multiply(Destination { data: piece, stride, base }, a, b);
            }
        });
    }
}

/// [`gemm_panels`] on the calling thread alone.
///
/// # Panics
/// As [`gemm_panels`].
#[track_caller]
pub(crate) fn gemm_panels_serial(out: &mut [f32], stride: usize, base: Base<'_>, a: MatRef<'_>, b: &Panels) {
    assert!(a.cols() > 0, "matmul: panels of no rows");
    multiply(Destination { data: out, stride, base }, a, b);
}

/// Products with a thin side, as sums of scaled rows or as dot products.
fn thin(out: &mut [f32], stride: usize, base: Base<'_>, a: MatRef<'_>, b: MatRef<'_>) {
    let (m, k, n) = (a.rows(), a.cols(), b.cols());
    for row in out.chunks_mut(stride).take(m) {
        match base {
            Base::Zero => row[..n].fill(0.0),
            Base::Out => {}
            Base::Row(base) => row[..n].copy_from_slice(base),
        }
    }
    if n <= MAX_THIN && !a.is_transposed() && k > MAX_THIN {
        // Few columns: one dot product a value, over a contiguous copy of each column of b.
        let columns: Vec<f32> = (0..n).flat_map(|j| (0..k).map(move |l| b.at(l, j))).collect();
        for (i, row) in out.chunks_mut(stride).take(m).enumerate() {
            for (o, column) in row[..n].iter_mut().zip(columns.chunks_exact(k)) {
                *o += dot(a.line(i), column);
            }
        }
    } else if n <= MAX_THIN && a.is_transposed() && m > MAX_THIN {
        // The transposed product has long rows: n x m = b^T a^T.
        let mut turned = vec![0.0; n * m];
        thin_axpy(&mut turned, m, b.t(), a.t());
        for (i, row) in out.chunks_mut(stride).take(m).enumerate() {
            row[..n].iter_mut().zip(turned[i..].iter().step_by(m)).for_each(|(o, t)| *o += t);
        }
    } else if !b.is_transposed() {
        thin_axpy(out, stride, a, b);
    } else {
        let rows: Vec<f32> = (0..k).flat_map(|l| (0..n).map(move |j| b.at(l, j))).collect();
        thin_axpy(out, stride, a, MatRef::window(&rows, k, n, n));
    }
}

kernel! {
    /// out += a b by rows of b, in whichever loop order keeps the moving row in cache.
    fn thin_axpy(out: &mut [f32], stride: usize, a: MatRef<'_>, b: MatRef<'_>) {
        let (m, k, n) = (a.rows(), a.cols(), b.cols());
        if m <= k {
            for l in 0..k {
                let row = &b.line(l)[..n];
                for i in 0..m {
                    let s = a.at(i, l);
                    for (o, &v) in out[i * stride..][..n].iter_mut().zip(row) { *o += s * v; }
                }
            }
        } else {
            for i in 0..m {
                let target = &mut out[i * stride..][..n];
                for l in 0..k {
                    let s = a.at(i, l);
                    let row = &b.line(l)[..n];
                    for (o, &v) in target.iter_mut().zip(row) { *o += s * v; }
                }
            }
        }
    }
}

#[track_caller]
fn product(like: &Tensor, a: MatRef<'_>, b: MatRef<'_>) -> Tensor {
    let mut out = like.uninit_like(&[a.rows(), b.cols()]);
    gemm(out.data_mut(), b.cols(), Base::Zero, a, b);
    out
}

/// a b; n x c times c x d.
///
/// # Panics
/// If the inner sides differ.
#[track_caller]
pub fn matmul(a: &Tensor, b: &Tensor) -> Tensor {
    product(a, a.as_mat(), b.as_mat())
}

/// a b^T; n x c times (d x c)^T.
///
/// # Panics
/// If the inner sides differ.
#[track_caller]
pub fn matmul_nt(a: &Tensor, b: &Tensor) -> Tensor {
    product(a, a.as_mat(), b.as_mat().t())
}

/// a^T b; (n x c)^T times n x d.
///
/// # Panics
/// If the inner sides differ.
#[track_caller]
pub fn matmul_tn(a: &Tensor, b: &Tensor) -> Tensor {
    product(a, a.as_mat().t(), b.as_mat())
}

/// a^T b^T.
///
/// # Panics
/// If the inner sides differ.
#[track_caller]
pub fn matmul_tt(a: &Tensor, b: &Tensor) -> Tensor {
    product(a, a.as_mat().t(), b.as_mat().t())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::testing::{rows, same_at_all, same_where_products_fuse};
    use proptest::prelude::*;

    #[test]
    fn memory_of_large_products_is_given_back() {
        // What this thread keeps after a product with a right side of 256 rows and so many columns.
        let kept = |columns: usize| {
            let (left, right) = (vec![1.0; 8 * DEPTH], vec![0.5; DEPTH * columns]);
            let mut out = vec![0.0; 8 * columns];
            let (a, b) =
                (MatRef::window(&left, 8, DEPTH, DEPTH), MatRef::window(&right, DEPTH, columns, columns));
            gemm_serial(&mut out, columns, Base::Zero, a, b);
            assert!(out.iter().all(|&x| x == 0.5 * DEPTH as f32));
            let panels = PANELS.take();
            let capacity = panels.capacity();
            PANELS.set(panels);
            capacity
        };
        assert_eq!(kept(5000), 0);
        let usual = kept(1024);
        assert!((DEPTH * 1024..=MAX_KEPT).contains(&usual), "{usual}");
        assert_eq!(kept(512), usual);
        assert_eq!(kept(5000), 0);
    }

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set([a, b, c, d] in rows(1..70), k in 1usize..5) {
            let n = b.len();
            let right = [&b[..], &c, &d, &b].concat();
            let left: Vec<f32> = a.iter().cycle().take(k * n.max(7)).copied().collect();
            // Both orders of the loops, the rows of the result with a gap between them.
            for m in [1, 7] {
                let (a, b) = (MatRef::window(&left, m, k, k), MatRef::window(&right, k, n, n));
                let thin = || {
                    let mut out = vec![0.5; m * (n + 3)];
                    gemm(&mut out, n + 3, Base::Out, a, b);
                    thin_axpy(&mut out, n + 3, a, b);
                    out
                };
                same_at_all(thin);
            }
            // Few columns, by dot products and by rows of the transposed result.
            let (tall, few) = (MatRef::window(&right, 4, n, n), MatRef::window(&left, n, 1, 1));
            same_at_all(|| {
                let mut out = vec![0.0; 8];
                gemm(&mut out, 2, Base::Zero, tall, few);
                gemm(&mut out[1..], 2, Base::Zero, MatRef::window(&right, n, 4, 4).t(), few);
                out
            });
        }

        /// Few inner values or few rows, with a right side as it is and transposed, of one piece or of several.
        #[test]
        fn thin_products_are_the_plain_chain(
            m in prop_oneof![1usize..12, Just(96), 97usize..500], k in 1usize..6, n in 6usize..900,
            transposed: bool, seed: u8,
        ) {
            let (m, k) = if m <= MAX_THIN && seed % 2 == 0 { (m, 40) } else { (m, k) };
            let (a, b) = (filled(m, k, f32::from(seed)), filled(k, n, 1.3));
            let stored = if transposed { transposed_of(&b) } else { b.clone() };
            let right = if transposed { stored.as_mat().t() } else { stored.as_mat() };
            let mut out = vec![0.25; m * (n + 2)];
            gemm(&mut out, n + 2, Base::Out, a.as_mat(), right);
            for i in 0..m {
                for j in 0..n {
                    let chain = (0..k).fold(0.25, |sum, l| sum + a.row(i)[l] * b.row(l)[j]);
                    prop_assert_eq!(out[i * (n + 2) + j], chain, "row {}, column {}", i, j);
                }
                prop_assert!(i + 1 == m || out[i * (n + 2) + n..][..2] == [0.25; 2]);
            }
        }

        #[test]
        fn the_same_where_products_fuse(
            m in 6usize..40, k in 6usize..300, n in 6usize..70, transposed: [bool; 2], seed: u8,
        ) {
            let (a, b) = (filled(m, k, f32::from(seed)), filled(k, n, 1.3));
            let [x, y] = [(&a, transposed[0]), (&b, transposed[1])]
                .map(|(x, t)| if t { transposed_of(x) } else { x.clone() });
            let product = match transposed {
                [false, false] => matmul,
                [false, true] => matmul_nt,
                [true, false] => matmul_tn,
                [true, true] => matmul_tt,
            };
            same_where_products_fuse(|| product(&x, &y).data().to_vec());
        }
    }

    fn filled(rows: usize, cols: usize, phase: f32) -> Tensor {
        let values = (0..rows * cols).map(|i| (i as f32 * 0.7 + phase).sin()).collect();
        Tensor::from_vec(&[rows, cols], values)
    }

    fn transposed_of(x: &Tensor) -> Tensor {
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
            close(&matmul_nt(&a, &transposed_of(&b)), &truth);
            close(&matmul_tn(&transposed_of(&a), &b), &truth);
            close(&matmul_tt(&transposed_of(&a), &transposed_of(&b)), &truth);
        }
    }

    #[test]
    fn a_product_has_the_same_bits_however_it_is_split() {
        // More than one block of the inner side; on one thread, and in small and large blocks of rows on several.
        for (m, k, n) in [(7, 600, 20), (100, 513, 40), (800, 300, 33)] {
            let (a, b, bias) = (filled(m, k, 0.2), filled(k, n, 1.1), filled(1, n, 2.0));
            let mut panels = Panels::new();
            panels.fill(b.as_mat());
            for base in [Base::Zero, Base::Out, Base::Row(bias.data())] {
                let run = |product: &dyn Fn(&mut [f32])| {
                    let mut out = filled(m, n, 3.0);
                    product(out.data_mut());
                    out
                };
                let whole = run(&|data| multiply(Destination { data, stride: n, base }, a.as_mat(), &panels));
                assert_eq!(run(&|out| gemm(out, n, base, a.as_mat(), b.as_mat())), whole);
                assert_eq!(run(&|out| gemm_serial(out, n, base, a.as_mat(), b.as_mat())), whole);
                assert_eq!(run(&|out| gemm_panels(out, n, base, a.as_mat(), &panels)), whole);
            }
        }
    }

    #[test]
    fn strided_result_adds_to_what_is_there() {
        let (a, b) = (filled(9, 7, 0.0), filled(7, 8, 0.5));
        let truth = naive(&a, &b);
        let mut out = vec![1.0; 9 * 20];
        gemm(&mut out, 20, Base::Out, a.as_mat(), b.as_mat());
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
