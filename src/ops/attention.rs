//! Scaled dot-product attention (Vaswani et al. 2017, equation 1) over all of the memory.
//!
//! It is one operation, or two: weights from queries and keys, and the average of values under given weights. As two,
//! the weights are a [`Var`] of their own, so that one set of them can average several things (features and positions);
//! as one, the scores are worked on block by block, are kept once and have no gradient in memory. Both give the same
//! bits. The width of the values is free.

use crate::autodiff::{At, Op, Tape, Var};
use crate::simd::{exp, kernel};
use crate::tensor::{
    Base, DEPTH, MIN_PARALLEL, MatRef, Panels, Tensor, gemm, gemm_panels_serial, gemm_serial, lane_dot,
    lane_max, lane_sum, map_rows,
};
use rayon::prelude::*;

/// The columns of head `h`, as a matrix without copying.
fn head(t: &Tensor, h: usize, heads: usize) -> MatRef<'_> {
    let width = t.cols() / heads;
    MatRef::window(t.data().get(h * width..).unwrap_or_default(), t.rows(), width, t.cols())
}

#[track_caller]
pub(super) fn assert_heads(name: &str, x: &Tensor, heads: usize) {
    assert!(heads > 0 && x.cols().is_multiple_of(heads), "{name}: {:?} in {heads} heads", x.shape());
}

/// 1 / sqrt(c / heads).
pub(super) fn scale_of(c: usize, heads: usize) -> f32 {
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

kernel! {
    /// [`scaled_softmax_gradient`] over dw.
    fn scaled_softmax_gradient_in_place(w: &[f32], dw: &mut [f32], scale: f32) {
        let inner = lane_dot(w, dw);
        for (d, &w) in dw.iter_mut().zip(w) { *d = scale * w * (*d - inner); }
    }
}

/// softmax(q k^T / sqrt(c / heads)) of each head.
struct AttentionWeights {
    heads: usize,
}

impl Op<2> for AttentionWeights {
    type Saved = ();
    fn forward(&self, [q, k]: [&Tensor; 2]) -> (Tensor, ()) {
        assert_heads("attention_weights", q, self.heads);
        assert!(q.cols() == k.cols(), "attention_weights: queries {:?} and keys {:?}", q.shape(), k.shape());
        let (n, m) = (q.rows(), k.rows());
        let mut w = q.uninit_like(&[self.heads * n, m]);
        for (h, out) in w.data_mut().chunks_exact_mut((n * m).max(1)).enumerate() {
            gemm(out, m, Base::Zero, head(q, h, self.heads), head(k, h, self.heads).t());
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
        let mut ds = dw.uninit_like(&[n, m]);
        if !ds.is_empty() && width > 0 {
            for h in 0..self.heads {
                map_rows(ds.data_mut(), m, |first, piece| {
                    for (i, o) in piece.chunks_exact_mut(m).enumerate() {
                        let row = h * n + first + i;
                        scaled_softmax_gradient(o, at.y.row(row), dw.row(row), scale);
                    }
                });
                let ds = ds.as_mat();
                if let Some(dq) = &mut dq {
                    gemm(&mut dq.data_mut()[h * width..], c, Base::Zero, ds, head(k, h, self.heads));
                }
                if let Some(dk) = &mut dk {
                    gemm(&mut dk.data_mut()[h * width..], c, Base::Zero, ds.t(), head(q, h, self.heads));
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
                gemm(out, d, Base::Zero, self.weights_of(w, h), head(v, h, self.heads));
            }
        }
        (y, ())
    }
    fn vjp(&self, at: At<'_, 2, ()>, dy: &Tensor) -> [Option<Tensor>; 2] {
        let [w, v] = at.x;
        let (n, m, d) = (dy.rows(), v.rows(), v.cols());
        let dw = at.needs[0].then(|| {
            let mut dw = dy.uninit_like(w.dims());
            for (h, out) in dw.data_mut().chunks_exact_mut((n * m).max(1)).enumerate() {
                gemm(out, m, Base::Zero, head(dy, h, self.heads), head(v, h, self.heads).t());
            }
            dw
        });
        let dv = at.needs[1].then(|| {
            let mut dv = dy.zeros_like_pool(v.dims());
            if !dv.is_empty() && n > 0 {
                for h in 0..self.heads {
                    let out = &mut dv.data_mut()[h * (d / self.heads)..];
                    gemm(out, d, Base::Zero, self.weights_of(w, h).t(), head(dy, h, self.heads));
                }
            }
            dv
        });
        [dw, dv]
    }
}

/// Weights and average in one pass over the queries, whose scores are used while they are in the cache.
struct Attention {
    heads: usize,
}

/// Queries whose scores are worked on at a time on the way there.
const QUERIES: usize = 48;

/// The panels of every head's part of a matrix, transposed if asked for.
fn head_panels(x: &Tensor, heads: usize, transposed: bool) -> Vec<Panels> {
    let panels = |h| {
        let part = head(x, h, heads);
        let mut panels = Panels::new();
        panels.fill(if transposed { part.t() } else { part });
        panels
    };
    (0..heads).map(panels).collect()
}

/// Columns of head `h` out of c, for some rows of a matrix, n x c.
fn head_rows(t: &Tensor, h: usize, heads: usize, first: usize, rows: usize) -> MatRef<'_> {
    let width = t.cols() / heads;
    head(t, h, heads).part(first, rows, 0, width)
}

impl Op<3> for Attention {
    /// The weights, n x (heads m).
    type Saved = Tensor;
    fn forward(&self, [q, k, v]: [&Tensor; 3]) -> (Tensor, Tensor) {
        let heads = self.heads;
        assert_heads("attention", q, heads);
        assert_heads("attention", v, heads);
        assert!(
            q.cols() == k.cols() && k.rows() == v.rows(),
            "attention: queries {:?}, keys {:?} and values {:?}",
            q.shape(),
            k.shape(),
            v.shape()
        );
        let (n, m, c, d) = (q.rows(), k.rows(), q.cols(), v.cols());
        let mut w = q.uninit_like(&[n, heads * m]);
        let mut y = q.zeros_like_pool(&[n, d]);
        if y.is_empty() || w.is_empty() || c == 0 {
            return (y, w);
        }
        let (keys, values) = (head_panels(k, heads, true), head_panels(v, heads, false));
        let scale = scale_of(c, heads);
        let block = |(i, (w, y)): (usize, (&mut [f32], &mut [f32]))| {
            let rows = y.len() / d;
            for h in 0..heads {
                let q = head_rows(q, h, heads, i * QUERIES, rows);
                gemm_panels_serial(&mut w[h * m..], heads * m, Base::Zero, q, &keys[h]);
                for row in w[h * m..].chunks_mut(heads * m) {
                    scaled_softmax(&mut row[..m], scale);
                }
                let w = MatRef::window(&w[h * m..], rows, m, heads * m);
                gemm_panels_serial(&mut y[h * (d / heads)..], d, Base::Zero, w, &values[h]);
            }
        };
        let (w_blocks, y_blocks) = (w.data_mut(), y.data_mut());
        if n * m * (c + d) < MIN_PARALLEL {
            w_blocks
                .chunks_mut(QUERIES * heads * m)
                .zip(y_blocks.chunks_mut(QUERIES * d))
                .enumerate()
                .for_each(block);
        } else {
            w_blocks
                .par_chunks_mut(QUERIES * heads * m)
                .zip(y_blocks.par_chunks_mut(QUERIES * d))
                .enumerate()
                .for_each(block);
        }
        (y, w)
    }
    fn vjp(&self, at: At<'_, 3, Tensor>, dy: &Tensor) -> [Option<Tensor>; 3] {
        let ([q, k, v], w, heads) = (at.x, at.saved, self.heads);
        let (n, m, c, d) = (q.rows(), k.rows(), q.cols(), v.cols());
        let empty = n == 0 || m == 0 || c == 0 || d == 0;
        // Each head's gradients by themselves; their columns are put together at the end.
        let one = |h: usize| {
            let mut parts =
                [(n, c), (m, c), (m, d)].map(|(rows, cols)| dy.uninit_like(&[rows, cols / heads]));
            let mut values = Panels::new();
            values.fill(head(v, h, heads).t());
            let mut keys = Panels::new();
            keys.fill(head(k, h, heads));
            let mut scores = dy.uninit_like(&[DEPTH.min(n), m]);
            let scale = scale_of(c, heads);
            let [dq, dk, dv] = &mut parts;
            for first in (0..n).step_by(DEPTH) {
                let rows = DEPTH.min(n - first);
                let base = if first == 0 { Base::Zero } else { Base::Out };
                let scores = &mut scores.data_mut()[..rows * m];
                let dy = head_rows(dy, h, heads, first, rows);
                gemm_panels_serial(scores, m, Base::Zero, dy, &values);
                let weights = MatRef::window(&w.data()[first * heads * m + h * m..], rows, m, heads * m);
                gemm_serial(dv.data_mut(), d / heads, base, weights.t(), dy);
                for (i, dw) in scores.chunks_exact_mut(m).enumerate() {
                    scaled_softmax_gradient_in_place(weights.line(i), dw, scale);
                }
                let ds = MatRef::window(scores, rows, m, m);
                let width = c / heads;
                gemm_panels_serial(&mut dq.data_mut()[first * width..], width, Base::Zero, ds, &keys);
                gemm_serial(dk.data_mut(), width, base, ds.t(), head_rows(q, h, heads, first, rows));
            }
            parts
        };
        let parts: Vec<[Tensor; 3]> = match (empty, n * m * (c + d) < MIN_PARALLEL) {
            (true, _) => Vec::new(),
            (_, true) => (0..heads).map(one).collect(),
            (_, false) => (0..heads).into_par_iter().map(one).collect(),
        };
        std::array::from_fn(|i| {
            at.needs[i].then(|| join_heads(at.x[i], dy, parts.iter().map(|part| &part[i])))
        })
    }
}

/// The heads' columns side by side, as wide as `like`; zeros where there are none. Memory of the pool of `from`.
fn join_heads<'a>(like: &Tensor, from: &Tensor, parts: impl Iterator<Item = &'a Tensor>) -> Tensor {
    let mut all = from.zeros_like_pool(like.dims());
    let c = like.cols();
    for (h, part) in parts.enumerate() {
        let width = part.cols();
        for (to, row) in all.data_mut().chunks_exact_mut(c).zip(part.data().chunks_exact(width)) {
            to[h * width..(h + 1) * width].copy_from_slice(row);
        }
    }
    all
}

impl Tape {
    /// softmax(q k^T / sqrt(c / heads)) of each head, over all m keys: q n x c and k m x c to (heads n) x m, head by
    /// head. Every row sums to 1.
    ///
    /// # Panics
    /// If the widths differ or are not a multiple of `heads`.
    #[track_caller]
    pub fn attention_weights(&mut self, q: Var, k: Var, heads: usize) -> Var {
        self.apply(AttentionWeights { heads }, [q, k])
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
        self.apply(Attention { heads }, [q, k, v])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::{attention_inputs, both_ways, check, normal, same};
    use crate::simd::testing::{rows, same_at_all, same_where_products_fuse};
    use proptest::prelude::*;

    /// A twin of attention: every head cut out and multiplied by plain operations.
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

    proptest! {
        #[test]
        fn softmax_is_the_same_at_every_instruction_set([x, dw] in rows(0..70), scale in 0.1f32..2.0) {
            same_at_all(|| {
                let mut w = x.clone();
                scaled_softmax(&mut w, scale);
                let (mut out, mut in_place) = (vec![0.0; w.len()], dw.clone());
                scaled_softmax_gradient(&mut out, &w, &dw, scale);
                scaled_softmax_gradient_in_place(&w, &mut in_place, scale);
                [w, out, in_place].concat()
            });
        }

        #[test]
        fn the_same_where_products_fuse(
            (n, m) in (0usize..70, 1usize..70), heads in 1usize..4, width in 1usize..34, seed: u64,
        ) {
            let x = attention_inputs(n, m, heads * width, heads * (width + 1), seed);
            let dy = normal(&[1, 97], seed ^ 9);
            same_where_products_fuse(|| both_ways(&|t, x| t.attention(x[0], x[1], x[2], heads), &x, dy.data()));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..5, m in 1usize..6, heads in 1usize..4, width in 1usize..4, seed: u64) {
            let x = attention_inputs(n, m, heads * width, heads * 2, seed);
            check(|t, x| t.attention(x[0], x[1], x[2], heads), &x, seed);
            check(|t, x| t.attention_weights(x[0], x[1], heads), &x[..2], seed);
        }
    }

    #[test]
    fn agrees_with_plain_operations_at_every_size() {
        for (n, m, heads, width) in (1..12).flat_map(|n| {
            [1, 2, 5, 11, 40].into_iter().flat_map(move |m| {
                [(1, 3), (2, 1), (4, 9), (3, 16), (2, 33)].map(|(heads, width)| (n, m, heads, width))
            })
        }) {
            let x = attention_inputs(n, m, heads * width, heads * (width + 1), (n * m) as u64);
            let fused = |t: &mut Tape, [q, k, v]: [Var; 3]| t.attention(q, k, v, heads);
            same(x, fused, |t, [q, k, v]| plain(t, q, k, v, heads));
        }
        // On several threads.
        let x = attention_inputs(700, 90, 64, 32, 5);
        same(x, |t, [q, k, v]| t.attention(q, k, v, 4), |t, [q, k, v]| plain(t, q, k, v, 4));
    }

    #[test]
    fn one_operation_gives_the_bits_of_two() {
        // Beyond the thin products, which round differently; less and more than a block of queries and of its gradient.
        for (n, m, heads, width) in [(7, 8, 2, 6), (50, 30, 4, 8), (600, 300, 4, 32)] {
            let run = |fused: bool| {
                let mut t = Tape::new();
                let [q, k, v] =
                    attention_inputs(n, m, heads * width, heads * (width + 1), 5).map(|x| t.input(x));
                let y = if fused {
                    t.attention(q, k, v, heads)
                } else {
                    let weights = t.attention_weights(q, k, heads);
                    t.attention_average(weights, v, heads)
                };
                let g = t.pull([(y, normal(&[n, heads * (width + 1)], 1))]);
                let mut all = [q, k, v].map(|x| g.get(x).unwrap().clone()).to_vec();
                all.push(t.value(y).clone());
                all
            };
            assert!(run(true) == run(false), "{n} {m} {heads} {width}");
        }
    }

    #[test]
    fn the_bytes_do_not_depend_on_the_thread_count() {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut t = Tape::new();
                let [q, k, v] = attention_inputs(1200, 70, 64, 64, 5).map(|x| t.input(x));
                let y = t.attention(q, k, v, 4);
                let g = t.pull([(y, normal(&[1200, 64], 1))]);
                [q, k, v].map(|x| g.get(x).unwrap().clone())
            })
        };
        let one = run(1);
        assert!([2, 3, 7].iter().all(|&threads| one == run(threads)));
    }

    #[test]
    fn weights_sum_to_one() {
        let [q, k, _] = attention_inputs(7, 5, 8, 4, 1);
        let mut t = Tape::new();
        let (q, k) = (t.constant(q), t.constant(k));
        let w = t.attention_weights(q, k, 2);
        for row in t.value(w).data().chunks_exact(5) {
            assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn permuting_queries_permutes_and_permuting_memory_changes_nothing() {
        let [q, k, v] = attention_inputs(6, 5, 8, 8, 2);
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
        let [q, k, v] = attention_inputs(0, 3, 4, 4, 0).map(|x| t.input(x));
        let y = t.attention(q, k, v, 2);
        assert_eq!(t.value(y).dims(), [0, 4]);
        let g = t.pull([(y, Tensor::zeros(&[0, 4]))]);
        assert!([k, v].iter().all(|&x| g.get(x).unwrap().data().iter().all(|&d| d == 0.0)));
    }
}
