//! Moving rows: gather and its transpose, scatter-add.

use super::{Tensor, map_rows};

/// Row i of the result is row `index[i]` of `x`; m x c from n x c.
///
/// # Panics
/// If an index is out of range.
#[track_caller]
pub(crate) fn gather_rows(x: &Tensor, index: &[u32]) -> Tensor {
    let c = x.cols();
    let mut out = x.uninit_like(&[index.len(), c]);
    let source = x.data();
    map_rows(out.data_mut(), c, |first, piece| {
        for (row, &i) in piece.chunks_exact_mut(c.max(1)).zip(&index[first..]) {
            row.copy_from_slice(&source[i as usize * c..][..c]);
        }
    });
    out
}

/// Adds row i of `x` to row `index[i]` of an n x c result of zeros; rows are added in order of i.
///
/// # Panics
/// If an index is out of range or the number of indices is not that of rows.
#[track_caller]
pub(crate) fn scatter_add_rows(x: &Tensor, index: &[u32], n: usize) -> Tensor {
    let c = x.cols();
    assert!(x.rows() == index.len(), "scatter_add: {:?} and {} indices", x.shape(), index.len());
    let mut out = x.zeros_like_pool(&[n, c]);
    let target = out.data_mut();
    for (row, &i) in x.data().chunks_exact(c.max(1)).zip(index) {
        for (o, &v) in target[i as usize * c..][..c].iter_mut().zip(row) {
            *o += v;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gather_then_scatter_counts_uses() {
        let x = Tensor::from_vec(&[3, 2], vec![1., 2., 3., 4., 5., 6.]);
        let g = gather_rows(&x, &[2, 0, 2]);
        assert_eq!(g.data(), [5., 6., 1., 2., 5., 6.]);
        let s = scatter_add_rows(&g, &[2, 0, 2], 3);
        assert_eq!(s.data(), [1., 2., 0., 0., 10., 12.]);
        assert_eq!(gather_rows(&x, &[]).dims(), [0, 2]);
    }
}
