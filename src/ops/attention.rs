//! Scaled dot-product attention (Vaswani et al. 2017, equation 1), over all of the memory or over k rows per query.
//!
//! Both forms are two operations: weights from queries and keys, and the average of values under given weights. The
//! weights are a [`Var`] of their own, so that one set of them can average several things (features and positions),
//! and the width of the values is free. The residual that the gradient of a softmax needs is its output, which the
//! tape holds anyway.
//!
//! The local form is made of three bilinear loops over the n k pairs of a query and a memory row: [`pair_dots`],
//! [`pair_average`] and [`pair_scatter`]. Each is the gradient of the others, nothing is gathered into memory, and
//! every output row is written by one thread in the order of the pairs.

use crate::autodiff::{At, Op, Tape, Var};
use crate::tensor::{
    MatRef, PARALLEL_MIN, Tensor, exp, gemm, kernel, lane_axpy, lane_dot, lane_max, lane_sum, map_rows,
};
use rayon::prelude::*;
use std::sync::Arc;

/// Rows a thread works on at a time; every row is computed alone, so the result does not depend on it.
const BLOCK: usize = 32;

/// The columns of head `h`, as a matrix without copying.
fn head(t: &Tensor, h: usize, heads: usize) -> MatRef<'_> {
    let width = t.cols() / heads;
    MatRef::window(t.data().get(h * width..).unwrap_or_default(), t.rows(), width, t.cols())
}

#[track_caller]
fn assert_heads(name: &str, x: &Tensor, heads: usize) {
    assert!(heads > 0 && x.cols().is_multiple_of(heads), "{name}: {:?} in {heads} heads", x.shape());
}

/// 1 / sqrt(c / heads).
fn scale_of(c: usize, heads: usize) -> f32 {
    1.0 / ((c / heads).max(1) as f32).sqrt()
}

kernel! {
    /// Softmax of a row times a scale, in place.
    fn scaled_softmax(x: &mut [f32], scale: f32) {
        let max = lane_max(x);
        for x in x.iter_mut() { *x = exp((*x - max) * scale); }
        let inverse = 1.0 / lane_sum(x);
        for x in x.iter_mut() { *x *= inverse; }
    }
}

kernel! {
    /// out = scale w (dw - <w, dw>) of one row.
    fn scaled_softmax_gradient(out: &mut [f32], w: &[f32], dw: &[f32], scale: f32) {
        let inner = lane_dot(w, dw);
        for ((o, &w), &d) in out.iter_mut().zip(w).zip(dw) { *o = scale * w * (d - inner); }
    }
}

/// softmax(q k^T / sqrt(c / heads)) of each head.
struct Weights {
    heads: usize,
}

impl Op<2> for Weights {
    type Saved = ();
    fn forward(&self, [q, k]: [&Tensor; 2]) -> (Tensor, ()) {
        assert_heads("attention_weights", q, self.heads);
        assert!(q.cols() == k.cols(), "attention_weights: queries {:?} and keys {:?}", q.shape(), k.shape());
        let (n, m) = (q.rows(), k.rows());
        let mut w = q.dirty(&[self.heads * n, m]);
        for (h, out) in w.data_mut().chunks_exact_mut((n * m).max(1)).enumerate() {
            gemm(out, m, 0.0, head(q, h, self.heads), head(k, h, self.heads).t());
        }
        let scale = scale_of(q.cols(), self.heads);
        map_rows(w.data_mut(), m, |_, piece| {
            piece.chunks_exact_mut(m.max(1)).for_each(|row| scaled_softmax(row, scale));
        });
        (w, ())
    }
    fn vjp(&self, at: At<'_, 2, ()>, dw: &Tensor) -> [Option<Tensor>; 2] {
        let [q, k] = at.x;
        let (n, m, c) = (q.rows(), k.rows(), q.cols());
        let width = c / self.heads;
        let scale = scale_of(c, self.heads);
        let mut dq = at.needs[0].then(|| dw.zeros_like_pool(q.dims()));
        let mut dk = at.needs[1].then(|| dw.zeros_like_pool(k.dims()));
        let mut ds = dw.dirty(&[n, m]);
        if !ds.is_empty() && width > 0 {
            for h in 0..self.heads {
                map_rows(ds.data_mut(), m, |first, piece| {
                    for (i, o) in piece.chunks_exact_mut(m).enumerate() {
                        let row = h * n + first + i;
                        scaled_softmax_gradient(o, at.y.row(row), dw.row(row), scale);
                    }
                });
                let ds = MatRef::of(&ds);
                if let Some(dq) = &mut dq {
                    gemm(&mut dq.data_mut()[h * width..], c, 0.0, ds, head(k, h, self.heads));
                }
                if let Some(dk) = &mut dk {
                    gemm(&mut dk.data_mut()[h * width..], c, 0.0, ds.t(), head(q, h, self.heads));
                }
            }
        }
        [dq, dk]
    }
}

/// The average of the values under the weights of each head.
struct Average {
    heads: usize,
}

impl Average {
    fn weights_of<'a>(&self, w: &'a Tensor, h: usize) -> MatRef<'a> {
        let n = w.rows() / self.heads;
        MatRef::window(&w.data()[h * n * w.cols()..], n, w.cols(), w.cols())
    }
}

impl Op<2> for Average {
    type Saved = ();
    fn forward(&self, [w, v]: [&Tensor; 2]) -> (Tensor, ()) {
        assert_heads("attention_average", v, self.heads);
        assert!(
            w.cols() == v.rows() && w.rows().is_multiple_of(self.heads),
            "attention_average: weights {:?} of {} heads and values {:?}",
            w.shape(),
            self.heads,
            v.shape()
        );
        let d = v.cols();
        let mut y = w.zeros_like_pool(&[w.rows() / self.heads, d]);
        if !y.is_empty() {
            for h in 0..self.heads {
                let out = &mut y.data_mut()[h * (d / self.heads)..];
                gemm(out, d, 0.0, self.weights_of(w, h), head(v, h, self.heads));
            }
        }
        (y, ())
    }
    fn vjp(&self, at: At<'_, 2, ()>, dy: &Tensor) -> [Option<Tensor>; 2] {
        let [w, v] = at.x;
        let (n, m, d) = (dy.rows(), v.rows(), v.cols());
        let dw = at.needs[0].then(|| {
            let mut dw = dy.dirty(w.dims());
            for (h, out) in dw.data_mut().chunks_exact_mut((n * m).max(1)).enumerate() {
                gemm(out, m, 0.0, head(dy, h, self.heads), head(v, h, self.heads).t());
            }
            dw
        });
        let dv = at.needs[1].then(|| {
            let mut dv = dy.zeros_like_pool(v.dims());
            if !dv.is_empty() && n > 0 {
                for h in 0..self.heads {
                    let out = &mut dv.data_mut()[h * (d / self.heads)..];
                    gemm(out, d, 0.0, self.weights_of(w, h).t(), head(dy, h, self.heads));
                }
            }
            dv
        });
        [dw, dv]
    }
}

/// Calls `f(first_row, piece)` on pieces of whole rows of `out`, on several threads if `work` multiply-adds pay for it.
fn each_block(out: &mut Tensor, work: usize, f: impl Fn(usize, &mut [f32]) + Sync) {
    let cols = out.len() / out.dims()[0].max(1);
    if work < PARALLEL_MIN || cols == 0 {
        f(0, out.data_mut());
    } else {
        out.data_mut().par_chunks_mut(BLOCK * cols).enumerate().for_each(|(i, piece)| f(i * BLOCK, piece));
    }
}

/// Which memory rows each query is paired with.
#[derive(Clone)]
struct Pairs {
    /// n k memory rows, query by query.
    index: Arc<[u32]>,
    k: usize,
}

impl Pairs {
    #[track_caller]
    fn new(name: &str, n: usize, m: usize, index: Arc<[u32]>) -> Self {
        let k = index.len() / n.max(1);
        assert!(k * n == index.len() && (k > 0 || n == 0), "{name}: {} indices for {n} queries", index.len());
        let largest = index.iter().copied().max().map_or(0, |i| i as usize + 1);
        assert!(largest <= m, "{name}: index {} into {m} rows", largest.saturating_sub(1));
        Pairs { index, k }
    }

    /// For every memory row the pairs that it is in, in order: pair numbers, and where each row's begin (m + 1).
    fn by_memory_row(&self, m: usize) -> (Vec<u32>, Vec<u32>) {
        let mut starts = vec![0u32; m + 1];
        for &j in self.index.iter() {
            starts[j as usize + 1] += 1;
        }
        for j in 0..m {
            starts[j + 1] += starts[j];
        }
        let mut next = starts.clone();
        let mut pairs = vec![0u32; self.index.len()];
        for (p, &j) in self.index.iter().enumerate() {
            pairs[next[j as usize] as usize] = p as u32;
            next[j as usize] += 1;
        }
        (pairs, starts)
    }

    /// The pairs of `rows` queries from `first` on.
    fn of_queries(&self, first: usize, rows: usize) -> &[u32] {
        &self.index[first * self.k..(first + rows) * self.k]
    }
}

kernel! {
    /// out (rows k x heads) = dot products, head by head, of every row of a (rows x c) with its k rows of b.
    fn dots_kernel(out: &mut [f32], a: &[f32], b: &[f32], index: &[u32], k: usize, c: usize, heads: usize) {
        let width = c / heads;
        for ((out, a), index) in out.chunks_exact_mut(k * heads).zip(a.chunks_exact(c)).zip(index.chunks_exact(k)) {
            for (out, &j) in out.chunks_exact_mut(heads).zip(index) {
                let b = &b[j as usize * c..][..c];
                for (h, o) in out.iter_mut().enumerate() {
                    *o = lane_dot(&a[h * width..][..width], &b[h * width..][..width]);
                }
            }
        }
    }
}

kernel! {
    /// out (rows x c) = sums, head by head, of k rows of b each, times w (rows k x heads).
    fn average_kernel(out: &mut [f32], w: &[f32], b: &[f32], index: &[u32], k: usize, c: usize, heads: usize) {
        let width = c / heads;
        out.fill(0.0);
        for ((out, w), index) in out.chunks_exact_mut(c).zip(w.chunks_exact(k * heads)).zip(index.chunks_exact(k)) {
            for (w, &j) in w.chunks_exact(heads).zip(index) {
                let b = &b[j as usize * c..][..c];
                for (h, &w) in w.iter().enumerate() {
                    lane_axpy(&mut out[h * width..][..width], w, &b[h * width..][..width]);
                }
            }
        }
    }
}

kernel! {
    /// out (one row of c) = sum, head by head, of the rows of a that are in `pairs`, times their w.
    fn scatter_kernel(out: &mut [f32], w: &[f32], a: &[f32], pairs: &[u32], k: usize, heads: usize) {
        let c = out.len();
        let width = c / heads;
        out.fill(0.0);
        for &p in pairs {
            let w = &w[p as usize * heads..][..heads];
            let a = &a[p as usize / k * c..][..c];
            for (h, &w) in w.iter().enumerate() {
                lane_axpy(&mut out[h * width..][..width], w, &a[h * width..][..width]);
            }
        }
    }
}

/// Dot products of a (n x c) and b (m x c) over the pairs, head by head: (n k) x heads.
fn pair_dots(a: &Tensor, b: &Tensor, pairs: &Pairs, heads: usize) -> Tensor {
    let (n, k, c) = (a.rows(), pairs.k, a.cols());
    let mut out = a.zeros_like_pool(&[n.max(1), k * heads * usize::from(n > 0)]);
    if c > 0 {
        each_block(&mut out, n * k * c, |first, piece| {
            let rows = piece.len() / (k * heads).max(1);
            let a = &a.data()[first * c..][..rows * c];
            dots_kernel(piece, a, b.data(), pairs.of_queries(first, rows), k.max(1), c, heads);
        });
    }
    out.reshaped(&[n * k, heads])
}

/// Sums of the rows of b (m x c) over the pairs of each query, times w ((n k) x heads): n x c.
fn pair_average(w: &Tensor, b: &Tensor, pairs: &Pairs, n: usize) -> Tensor {
    let (k, c, heads) = (pairs.k, b.cols(), w.cols());
    let mut out = w.zeros_like_pool(&[n, c]);
    if !out.is_empty() {
        each_block(&mut out, n * k * c, |first, piece| {
            let rows = piece.len() / c;
            let w = &w.data()[first * k * heads..][..rows * k * heads];
            average_kernel(piece, w, b.data(), pairs.of_queries(first, rows), k, c, heads);
        });
    }
    out
}

/// Sums of the rows of a (n x c) over the pairs of each memory row, times w ((n k) x heads): m x c.
fn pair_scatter(w: &Tensor, a: &Tensor, pairs: &Pairs, m: usize) -> Tensor {
    let (k, c, heads) = (pairs.k, a.cols(), w.cols());
    let mut out = w.zeros_like_pool(&[m, c]);
    if !out.is_empty() && k > 0 {
        let (order, starts) = pairs.by_memory_row(m);
        each_block(&mut out, pairs.index.len() * c, |first, piece| {
            for (j, row) in piece.chunks_exact_mut(c).enumerate() {
                let pairs = &order[starts[first + j] as usize..starts[first + j + 1] as usize];
                scatter_kernel(row, w.data(), a.data(), pairs, k, heads);
            }
        });
    }
    out
}

kernel! {
    /// Softmax over the k rows of every group, head by head, of a scale times x; in place.
    fn group_softmax(x: &mut [f32], k: usize, heads: usize, scale: f32, scratch: &mut [f32]) {
        for group in x.chunks_exact_mut(k * heads) {
            scratch.fill(f32::NEG_INFINITY);
            for row in group.chunks_exact(heads) {
                for (m, &x) in scratch.iter_mut().zip(row) { *m = if x > *m { x } else { *m }; }
            }
            for row in group.chunks_exact_mut(heads) {
                for (x, &m) in row.iter_mut().zip(scratch.iter()) { *x = (*x - m) * scale; }
            }
            for x in group.iter_mut() { *x = exp(*x); }
            scratch.fill(0.0);
            for row in group.chunks_exact(heads) {
                for (s, &x) in scratch.iter_mut().zip(row) { *s += x; }
            }
            for row in group.chunks_exact_mut(heads) {
                for (x, &s) in row.iter_mut().zip(scratch.iter()) { *x /= s; }
            }
        }
    }
}

kernel! {
    /// out = scale w (dw - sum over the group of w dw), head by head.
    fn group_softmax_gradient(
        out: &mut [f32], w: &[f32], dw: &[f32], k: usize, heads: usize, scale: f32, scratch: &mut [f32],
    ) {
        let size = k * heads;
        for ((out, w), dw) in out.chunks_exact_mut(size).zip(w.chunks_exact(size)).zip(dw.chunks_exact(size)) {
            scratch.fill(0.0);
            for (w, d) in w.chunks_exact(heads).zip(dw.chunks_exact(heads)) {
                for ((s, &w), &d) in scratch.iter_mut().zip(w).zip(d) { *s += w * d; }
            }
            for ((o, w), d) in out.chunks_exact_mut(heads).zip(w.chunks_exact(heads)).zip(dw.chunks_exact(heads)) {
                for (((o, &w), &d), &s) in o.iter_mut().zip(w).zip(d).zip(scratch.iter()) {
                    *o = scale * w * (d - s);
                }
            }
        }
    }
}

/// As [`Weights`], each query over its own k memory rows.
struct LocalWeights {
    index: Arc<[u32]>,
    heads: usize,
}

impl Op<2> for LocalWeights {
    type Saved = Pairs;
    fn forward(&self, [q, k]: [&Tensor; 2]) -> (Tensor, Pairs) {
        let name = "local_attention_weights";
        assert_heads(name, q, self.heads);
        assert!(q.cols() == k.cols(), "{name}: queries {:?} and keys {:?}", q.shape(), k.shape());
        let pairs = Pairs::new(name, q.rows(), k.rows(), self.index.clone());
        let mut w = pair_dots(q, k, &pairs, self.heads);
        let scale = scale_of(q.cols(), self.heads);
        if !w.is_empty() {
            map_rows(w.data_mut(), pairs.k * self.heads, |_, piece| {
                group_softmax(piece, pairs.k, self.heads, scale, &mut vec![0.0; self.heads]);
            });
        }
        (w, pairs)
    }
    fn vjp(&self, at: At<'_, 2, Pairs>, dw: &Tensor) -> [Option<Tensor>; 2] {
        let ([q, k], pairs) = (at.x, at.saved);
        let scale = scale_of(q.cols(), self.heads);
        let size = pairs.k * self.heads;
        let mut ds = dw.dirty(dw.dims());
        if !ds.is_empty() {
            map_rows(ds.data_mut(), size, |first, piece| {
                let range = first * size..first * size + piece.len();
                let (w, dw) = (&at.y.data()[range.clone()], &dw.data()[range]);
                group_softmax_gradient(piece, w, dw, pairs.k, self.heads, scale, &mut vec![0.0; self.heads]);
            });
        }
        [
            at.needs[0].then(|| pair_average(&ds, k, pairs, q.rows())),
            at.needs[1].then(|| pair_scatter(&ds, q, pairs, k.rows())),
        ]
    }
}

/// As [`Average`], each query over its own k memory rows.
struct LocalAverage {
    index: Arc<[u32]>,
    k: usize,
}

impl Op<2> for LocalAverage {
    type Saved = Pairs;
    fn forward(&self, [w, v]: [&Tensor; 2]) -> (Tensor, Pairs) {
        let name = "local_attention_average";
        assert_heads(name, v, w.cols());
        assert!(
            w.rows() == self.index.len(),
            "{name}: weights {:?} for {} indices",
            w.shape(),
            self.index.len()
        );
        let n = self.index.len() / self.k.max(1);
        let pairs = Pairs::new(name, n, v.rows(), self.index.clone());
        (pair_average(w, v, &pairs, n), pairs)
    }
    fn vjp(&self, at: At<'_, 2, Pairs>, dy: &Tensor) -> [Option<Tensor>; 2] {
        let ([w, v], pairs) = (at.x, at.saved);
        [
            at.needs[0].then(|| pair_dots(dy, v, pairs, w.cols())),
            at.needs[1].then(|| pair_scatter(w, dy, pairs, v.rows())),
        ]
    }
}

impl Tape {
    /// softmax(q k^T / sqrt(c / heads)) of each head, over all m keys: q n x c and k m x c to (heads n) x m, head by
    /// head. Every row sums to 1.
    ///
    /// # Panics
    /// If the widths differ or are not a multiple of `heads`.
    #[track_caller]
    pub fn attention_weights(&mut self, q: Var, k: Var, heads: usize) -> Var {
        self.apply(Weights { heads }, [q, k])
    }

    /// The average of the values under the weights of each head: weights (heads n) x m and v m x d to n x d. Head h
    /// averages the h-th of the equal blocks of columns of `v`.
    ///
    /// # Panics
    /// If d or the rows of the weights are not a multiple of `heads`, or the weights do not have m columns.
    #[track_caller]
    pub fn attention_average(&mut self, weights: Var, v: Var, heads: usize) -> Var {
        self.apply(Average { heads }, [weights, v])
    }

    /// Multi-head scaled dot-product attention over all of the memory: q n x c, k m x c and v m x d to n x d.
    ///
    /// The cost is n m (c + d).
    ///
    /// # Panics
    /// If the shapes do not fit, or c or d is not a multiple of `heads`.
    ///
    /// # References
    /// Vaswani et al. 2017, Attention is all you need, equation 1.
    ///
    /// ```
    /// use bijective_sdf::autodiff::Tape;
    /// use bijective_sdf::tensor::Tensor;
    ///
    /// let mut tape = Tape::new();
    /// // Both keys score alike, so the result is the mean of the values.
    /// let q = tape.constant(Tensor::from_vec(&[1, 2], vec![0.0, 3.0]));
    /// let k = tape.constant(Tensor::from_vec(&[2, 2], vec![1.0, 0.0, -1.0, 0.0]));
    /// let v = tape.constant(Tensor::from_vec(&[2, 1], vec![4.0, 8.0]));
    /// let y = tape.attention(q, k, v, 1);
    /// assert_eq!(tape.value(y).data(), [6.0]);
    /// ```
    #[track_caller]
    pub fn attention(&mut self, q: Var, k: Var, v: Var, heads: usize) -> Var {
        let weights = self.attention_weights(q, k, heads);
        self.attention_average(weights, v, heads)
    }

    /// As [`attention_weights`](Self::attention_weights), query i over the k keys `index[i k .. (i + 1) k]` only:
    /// q n x c and keys m x c to (n k) x heads. The k values of a query and head sum to 1.
    ///
    /// A key that a query names twice counts twice.
    ///
    /// # Panics
    /// If the widths differ or are not a multiple of `heads`, the number of indices is not a multiple of n, or an
    /// index is m or more.
    #[track_caller]
    pub fn local_attention_weights(
        &mut self,
        q: Var,
        keys: Var,
        index: impl Into<Arc<[u32]>>,
        heads: usize,
    ) -> Var {
        self.apply(LocalWeights { index: index.into(), heads }, [q, keys])
    }

    /// As [`attention_average`](Self::attention_average), over the k rows `index[i k .. (i + 1) k]` of `v` for query
    /// i: weights (n k) x heads and v m x d to n x d.
    ///
    /// # Panics
    /// If the shapes do not fit, d is not a multiple of the number of heads, the number of indices is not one of k,
    /// or an index is m or more.
    #[track_caller]
    pub fn local_attention_average(
        &mut self,
        weights: Var,
        v: Var,
        index: impl Into<Arc<[u32]>>,
        k: usize,
    ) -> Var {
        self.apply(LocalAverage { index: index.into(), k }, [weights, v])
    }

    /// Multi-head attention of every query to k memory rows of its own, `index[i k .. (i + 1) k]`: q n x c, keys
    /// m x c and v m x d to n x d.
    ///
    /// The cost is n k (c + d).
    ///
    /// # Panics
    /// As [`local_attention_weights`](Self::local_attention_weights) and
    /// [`local_attention_average`](Self::local_attention_average).
    #[track_caller]
    pub fn local_attention(
        &mut self,
        q: Var,
        keys: Var,
        v: Var,
        index: impl Into<Arc<[u32]>>,
        heads: usize,
    ) -> Var {
        let index = index.into();
        let k = index.len() / self.value(q).rows().max(1);
        let weights = self.local_attention_weights(q, keys, index.clone(), heads);
        self.local_attention_average(weights, v, index, k)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::{check, normal};
    use proptest::prelude::*;

    /// The twin of attention: every head cut out and multiplied by plain operations.
    fn plain(t: &mut Tape, q: Var, k: Var, v: Var, heads: usize) -> Var {
        let (c, d) = (t.value(q).cols() / heads, t.value(v).cols() / heads);
        let mut joined: Option<Var> = None;
        for h in 0..heads {
            let (q, k) = (t.slice_cols(q, h * c..(h + 1) * c), t.slice_cols(k, h * c..(h + 1) * c));
            let v = t.slice_cols(v, h * d..(h + 1) * d);
            let scores = t.matmul_nt(q, k);
            let scores = t.scale(scores, 1.0 / (c as f32).sqrt());
            let weights = t.softmax_cols(scores);
            let y = t.matmul(weights, v);
            joined = Some(joined.map_or(y, |j| t.concat_cols([j, y])));
        }
        joined.unwrap()
    }

    /// The twin of local attention: gathered rows, plain operations.
    fn plain_local(t: &mut Tape, q: Var, k: Var, v: Var, index: &[u32], heads: usize) -> Var {
        let (c, d) = (t.value(q).cols() / heads, t.value(v).cols() / heads);
        let per_query = index.len() / t.value(q).rows();
        let (k, v) = (t.gather_rows(k, index), t.gather_rows(v, index));
        let q = t.repeat_rows(q, per_query);
        let product = t.mul(q, k);
        let mut joined: Option<Var> = None;
        for h in 0..heads {
            let part = t.slice_cols(product, h * c..(h + 1) * c);
            let scores = t.sum_cols(part);
            let scores = t.scale(scores, 1.0 / (c as f32).sqrt());
            let weights = t.softmax_groups(scores, per_query);
            let v = t.slice_cols(v, h * d..(h + 1) * d);
            let weighted = t.mul(v, weights);
            let y = t.sum_groups(weighted, per_query);
            joined = Some(joined.map_or(y, |j| t.concat_cols([j, y])));
        }
        joined.unwrap()
    }

    /// Values and gradients of two functions of (q, k, v) agree.
    fn same(
        inputs: [Tensor; 3],
        a: impl Fn(&mut Tape, [Var; 3]) -> Var,
        b: impl Fn(&mut Tape, [Var; 3]) -> Var,
    ) {
        let run = |f: &dyn Fn(&mut Tape, [Var; 3]) -> Var| {
            let mut t = Tape::new();
            let x = inputs.clone().map(|x| t.input(x));
            let y = f(&mut t, x);
            let seed = normal(t.value(y).dims(), 99);
            let mut gradients = t.pull([(y, seed)]);
            let mut out = vec![t.value(y).clone()];
            out.extend(x.map(|x| gradients.take(x).unwrap()));
            out
        };
        for (i, (a, b)) in run(&a).iter().zip(run(&b)).enumerate() {
            assert_eq!(a.shape(), b.shape());
            for (a, b) in a.data().iter().zip(b.data()) {
                assert!((a - b).abs() < 1e-5 * (1.0 + b.abs()), "result {i}: {a} {b}");
            }
        }
    }

    fn inputs(n: usize, m: usize, c: usize, d: usize, seed: u64) -> [Tensor; 3] {
        [normal(&[n, c], seed), normal(&[m, c], seed ^ 1), normal(&[m, d], seed ^ 2)]
    }

    fn some_index(n: usize, k: usize, m: usize, seed: u64) -> Arc<[u32]> {
        let noise = normal(&[n * k, 1], seed ^ 7);
        noise.data().iter().map(|x| (x.abs() * 1e4) as u32 % m as u32).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..5, m in 1usize..6, heads in 1usize..4, width in 1usize..4, k in 1usize..5, seed: u64) {
            let x = inputs(n, m, heads * width, heads * 2, seed);
            check(|t, x| t.attention(x[0], x[1], x[2], heads), &x, seed);
            let index = some_index(n, k, m, seed);
            check(|t, x| t.local_attention(x[0], x[1], x[2], index.clone(), heads), &x, seed);
            check(|t, x| t.attention_weights(x[0], x[1], heads), &x[..2], seed);
            check(|t, x| t.local_attention_weights(x[0], x[1], index.clone(), heads), &x[..2], seed);
        }
    }

    #[test]
    fn agrees_with_plain_operations_at_every_size() {
        for n in 1..12 {
            for m in [1, 2, 5, 11, 40] {
                for (heads, width) in [(1, 3), (2, 1), (4, 9), (3, 16), (2, 33)] {
                    let x = inputs(n, m, heads * width, heads * (width + 1), (n * m) as u64);
                    same(
                        x.clone(),
                        |t, [q, k, v]| t.attention(q, k, v, heads),
                        |t, [q, k, v]| plain(t, q, k, v, heads),
                    );
                    let index = some_index(n, 1 + m % 7, m, 3);
                    same(
                        x,
                        |t, [q, k, v]| t.local_attention(q, k, v, index.clone(), heads),
                        |t, [q, k, v]| plain_local(t, q, k, v, &index, heads),
                    );
                }
            }
        }
    }

    #[test]
    fn agrees_with_plain_operations_on_several_threads() {
        let x = inputs(700, 90, 64, 32, 5);
        let index = some_index(700, 16, 90, 6);
        same(x.clone(), |t, [q, k, v]| t.attention(q, k, v, 4), |t, [q, k, v]| plain(t, q, k, v, 4));
        same(
            x,
            |t, [q, k, v]| t.local_attention(q, k, v, index.clone(), 4),
            |t, [q, k, v]| plain_local(t, q, k, v, &index, 4),
        );
    }

    #[test]
    fn the_bytes_do_not_depend_on_the_thread_count() {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut t = Tape::new();
                let [q, k, v] = inputs(600, 70, 64, 64, 5).map(|x| t.input(x));
                let (a, b) =
                    (t.attention(q, k, v, 4), t.local_attention(q, k, v, some_index(600, 16, 70, 6), 4));
                let g = t.pull([(a, normal(&[600, 64], 1)), (b, normal(&[600, 64], 2))]);
                [q, k, v].map(|x| g.get(x).unwrap().clone())
            })
        };
        let one = run(1);
        for threads in [2, 3, 7] {
            assert_eq!(one, run(threads), "{threads} threads");
        }
    }

    #[test]
    fn weights_sum_to_one_and_all_local_is_global() {
        let [q, k, v] = inputs(7, 5, 8, 4, 1);
        let mut t = Tape::new();
        let (q, k, v) = (t.constant(q), t.constant(k), t.constant(v));
        let w = t.attention_weights(q, k, 2);
        for row in t.value(w).data().chunks_exact(5) {
            assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        }
        let index: Arc<[u32]> = (0..7).flat_map(|_| 0..5).collect();
        let w = t.local_attention_weights(q, k, index.clone(), 2);
        let sums = t.sum_groups(w, 5);
        assert!(t.value(sums).data().iter().all(|s| (s - 1.0).abs() < 1e-6));
        let (a, b) = (t.attention(q, k, v, 2), t.local_attention(q, k, v, index, 2));
        for (a, b) in t.value(a).data().iter().zip(t.value(b).data()) {
            assert!((a - b).abs() < 1e-6);
        }
    }

    #[test]
    fn permuting_queries_permutes_and_permuting_memory_changes_nothing() {
        let [q, k, v] = inputs(6, 5, 8, 8, 2);
        let mut t = Tape::new();
        let (q, k, v) = (t.constant(q), t.constant(k), t.constant(v));
        let queries = [3u32, 1, 5, 0, 2, 4];
        let memory = [4u32, 2, 0, 1, 3];
        let y = t.attention(q, k, v, 2);
        let permuted = t.gather_rows(y, &queries[..]);
        let (q, k, v) =
            (t.gather_rows(q, &queries[..]), t.gather_rows(k, &memory[..]), t.gather_rows(v, &memory[..]));
        let y = t.attention(q, k, v, 2);
        for (a, b) in t.value(y).data().iter().zip(t.value(permuted).data()) {
            assert!((a - b).abs() < 1e-6);
        }
    }

    #[test]
    fn no_queries_give_no_rows() {
        let mut t = Tape::new();
        let [q, k, v] = inputs(0, 3, 4, 4, 0).map(|x| t.input(x));
        let (a, b) = (t.attention(q, k, v, 2), t.local_attention(q, k, v, Vec::new(), 2));
        assert_eq!((t.value(a).dims(), t.value(b).dims()), (&[0, 4][..], &[0, 4][..]));
        let g = t.pull([(a, Tensor::zeros(&[0, 4])), (b, Tensor::zeros(&[0, 4]))]);
        assert!(g.get(v).unwrap().data().iter().all(|&d| d == 0.0));
    }

    #[test]
    #[should_panic(expected = "local_attention_weights: index 3 into 3 rows")]
    fn an_index_out_of_range_is_named() {
        let mut t = Tape::new();
        let [q, k, v] = inputs(1, 3, 4, 4, 0).map(|x| t.input(x));
        t.local_attention(q, k, v, vec![3], 2);
    }
}
