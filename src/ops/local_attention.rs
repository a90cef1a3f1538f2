//! Attention of every query to k memory rows of its own.
//!
//! As in [`attention`](super::attention), weights and average are two operations. Both are made of three bilinear
//! loops over the n k pairs of a query and a memory row: [`pair_dots`], [`pair_average`] and [`pair_scatter`]. Each is
//! the gradient of the others, nothing is gathered into memory, and every output row is written by one thread in the
//! order of the pairs.

use super::attention::{assert_heads, scale_of};
use crate::autodiff::{At, Op, Tape, Var};
use crate::simd::{exp, kernel};
use crate::tensor::{MIN_PARALLEL, Tensor, lane_axpy, lane_dot, map_rows};
use rayon::prelude::*;
use std::sync::Arc;

/// Rows a thread works on at a time; every row is computed alone, so the result does not depend on it.
const BLOCK: usize = 32;

/// Calls `f(first_row, piece)` on pieces of whole rows of `out`, on several threads if `work` multiply-adds pay for it.
fn each_block(out: &mut Tensor, work: usize, f: impl Fn(usize, &mut [f32]) + Sync) {
    let cols = out.len() / out.dims()[0].max(1);
    if work < MIN_PARALLEL || cols == 0 {
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

/// softmax(q k^T / sqrt(c / heads)) of each head, each query over its own k memory rows.
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
        let mut ds = dw.uninit_like(dw.dims());
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

/// The average of the values under the weights of each head, each query over its own k memory rows.
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
        assert!(n * self.k == self.index.len(), "{name}: {} indices, k = {}", self.index.len(), self.k);
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
    use crate::ops::testing::{attention_inputs, check, normal, same, same_both_ways};
    use crate::simd::testing::rows;
    use proptest::prelude::*;

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

    fn some_index(n: usize, k: usize, m: usize, seed: u64) -> Arc<[u32]> {
        let noise = normal(&[n * k, 1], seed ^ 7);
        noise.data().iter().map(|x| (x.abs() * 1e4) as u32 % m as u32).collect()
    }

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set(
            q in rows::<4>(1..24), [memory, dy] in rows(60..70), heads in 1usize..4, (k, seed) in (1usize..5, any::<u64>()),
        ) {
            // Heads of every width, whose columns come from the rows over and over.
            let c = heads * q[0].len();
            let wide = |rows: usize, from: &[f32]| {
                Tensor::from_vec(&[rows, c], from.iter().cycle().take(rows * c).copied().collect())
            };
            let x = [wide(4, &q.concat()), wide(5, &memory), wide(5, &dy)];
            let index = some_index(4, k, 5, seed);
            same_both_ways(|t, x| t.local_attention(x[0], x[1], x[2], index.clone(), heads), &x, &dy);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..5, m in 1usize..6, heads in 1usize..4, width in 1usize..4, k in 1usize..5, seed: u64) {
            let x = attention_inputs(n, m, heads * width, heads * 2, seed);
            let index = some_index(n, k, m, seed);
            check(|t, x| t.local_attention(x[0], x[1], x[2], index.clone(), heads), &x, seed);
            check(|t, x| t.local_attention_weights(x[0], x[1], index.clone(), heads), &x[..2], seed);
        }
    }

    #[test]
    fn agrees_with_plain_operations_at_every_size() {
        let compare = |n, m, k, heads: usize, width: usize| {
            let x = attention_inputs(n, m, heads * width, heads * (width + 1), (n * m) as u64);
            let index = some_index(n, k, m, 3);
            let fused = |t: &mut Tape, [q, k, v]: [Var; 3]| t.local_attention(q, k, v, index.clone(), heads);
            same(x, fused, |t, [q, k, v]| plain_local(t, q, k, v, &index, heads));
        };
        for n in 1..12 {
            for m in [1, 2, 5, 11, 40] {
                for (heads, width) in [(1, 3), (2, 1), (4, 9), (3, 16), (2, 33)] {
                    compare(n, m, 1 + m % 7, heads, width);
                }
            }
        }
        // On several threads.
        compare(700, 90, 16, 4, 16);
    }

    #[test]
    fn the_bytes_do_not_depend_on_the_thread_count() {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut t = Tape::new();
                let [q, k, v] = attention_inputs(600, 70, 64, 64, 5).map(|x| t.input(x));
                let y = t.local_attention(q, k, v, some_index(600, 16, 70, 6), 4);
                let g = t.pull([(y, normal(&[600, 64], 1))]);
                [q, k, v].map(|x| g.get(x).unwrap().clone())
            })
        };
        let one = run(1);
        assert!([2, 3, 7].iter().all(|&threads| one == run(threads)));
    }

    #[test]
    fn weights_sum_to_one_and_all_rows_are_global_attention() {
        let [q, k, v] = attention_inputs(7, 5, 8, 4, 1);
        let mut t = Tape::new();
        let (q, k, v) = (t.constant(q), t.constant(k), t.constant(v));
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
    fn no_queries_give_no_rows() {
        let mut t = Tape::new();
        let [q, k, v] = attention_inputs(0, 3, 4, 4, 0).map(|x| t.input(x));
        let w = t.local_attention_weights(q, k, Vec::new(), 2);
        let y = t.local_attention_average(w, v, Vec::new(), 3);
        assert_eq!(t.value(y).dims(), [0, 4]);
        let whole = t.local_attention(q, k, v, Vec::new(), 2);
        let g = t.pull([(y, Tensor::zeros(&[0, 4])), (whole, Tensor::zeros(&[0, 4]))]);
        assert!([k, v].iter().all(|&x| g.get(x).unwrap().data().iter().all(|&d| d == 0.0)));
    }

    #[test]
    #[should_panic(expected = "local_attention_average: 7 indices, k = 5")]
    fn indices_that_are_not_k_each_are_named() {
        let mut t = Tape::new();
        let (w, v) = (t.input(normal(&[7, 1], 1)), t.input(normal(&[3, 4], 2)));
        t.local_attention_average(w, v, vec![0; 7], 5);
    }

    #[test]
    #[should_panic(expected = "local_attention_weights: index 3 into 3 rows")]
    fn an_index_out_of_range_is_named() {
        let mut t = Tape::new();
        let [q, k, v] = attention_inputs(1, 3, 4, 4, 0).map(|x| t.input(x));
        t.local_attention(q, k, v, vec![3], 2);
    }
}
