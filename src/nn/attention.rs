//! Multi-head attention with projections.

use super::{Bound, Linear, Scope};
use crate::autodiff::{Tape, Var};
use crate::random::Random;
use std::sync::Arc;

/// Which memory rows a query attends to.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Reach {
    /// All m of them: the cost is n m c.
    All,
    /// Query i attends to the k rows `index[i k .. (i + 1) k]`: the cost is n k c.
    Nearest {
        /// n k memory rows, query by query.
        index: Arc<[u32]>,
        /// Rows per query.
        k: usize,
    },
}

/// Multi-head attention: concat_h softmax(q_h k_h^T / sqrt(c / h)) v_h, projected; q = x W_q + b_q, k and v likewise
/// from the memory. Self-attention is attention with the memory x.
///
/// # Shapes
/// x n x c and memory m x c_memory to n x c.
///
/// # Parameters
/// `query`, `key`, `value`, `out` with `weight` and `bias` each, initialised as [`Linear`].
///
/// # Gradient
/// Smooth; the weights, n m h or n k h of them, are kept. The gradient of `key.bias` is 0: it shifts all scores of a
/// query alike.
///
/// # References
/// Vaswani et al. 2017, Attention is all you need, section 3.2.2.
///
/// ```
/// use bijective_sdf::autodiff::Tape;
/// use bijective_sdf::nn::{MultiHeadAttention, Params, Reach};
/// use bijective_sdf::tensor::Tensor;
/// use bijective_sdf::Random;
///
/// let mut params = Params::new();
/// let mut rng = Random::new(0);
/// let layer = MultiHeadAttention::new(&mut params.scope("a"), 2, 2, 1, &mut rng);
/// let identity = Tensor::from_vec(&[2, 2], vec![1.0, 0.0, 0.0, 1.0]);
/// for name in ["query", "key", "value", "out"] {
///     let (w, b) = (params.id(&format!("a.{name}.weight")), params.id(&format!("a.{name}.bias")));
///     *params.value_mut(w.unwrap()) = identity.clone();
///     *params.value_mut(b.unwrap()) = Tensor::zeros(&[1, 2]);
/// }
/// let mut tape = Tape::new();
/// let bound = params.bind(&mut tape, true);
/// // A query at right angles to both memory rows weighs them alike.
/// let x = tape.constant(Tensor::from_vec(&[1, 2], vec![0.0, 5.0]));
/// let memory = tape.constant(Tensor::from_vec(&[2, 2], vec![1.0, 0.0, 3.0, 0.0]));
/// let near = Reach::Nearest { index: vec![1].into(), k: 1 };
/// // Attending to one row only gives that row.
/// let y = layer.forward(&mut tape, &bound, x, memory, &near);
/// assert_eq!(tape.value(y).data(), [3.0, 0.0]);
/// let y = layer.forward(&mut tape, &bound, x, memory, &Reach::All);
/// assert_eq!(tape.value(y).data(), [2.0, 0.0]);
/// ```
#[derive(Clone, Debug)]
pub struct MultiHeadAttention {
    query: Linear,
    key: Linear,
    value: Linear,
    out: Linear,
    heads: usize,
}

impl MultiHeadAttention {
    /// A layer of c channels in `heads` heads, over a memory of c_memory channels.
    ///
    /// # Panics
    /// If c is not a multiple of `heads`.
    #[track_caller]
    pub fn new(scope: &mut Scope<'_>, c: usize, c_memory: usize, heads: usize, rng: &mut Random) -> Self {
        assert!(heads > 0 && c.is_multiple_of(heads), "attention: {c} channels in {heads} heads");
        MultiHeadAttention {
            query: Linear::new(&mut scope.scope("query"), c, c, rng),
            key: Linear::new(&mut scope.scope("key"), c_memory, c, rng),
            value: Linear::new(&mut scope.scope("value"), c_memory, c, rng),
            out: Linear::new(&mut scope.scope("out"), c, c, rng),
            heads,
        }
    }

    /// x n x c and memory m x c_memory to n x c.
    ///
    /// # Panics
    /// If the widths do not fit, or the reach has an index of m or more or not n k of them.
    #[track_caller]
    pub fn forward(&self, tape: &mut Tape, p: &Bound, x: Var, memory: Var, reach: &Reach) -> Var {
        let Reach::All = reach else { return self.forward_weighted(tape, p, x, memory, reach).0 };
        let q = self.query.forward(tape, p, x);
        let k = self.key.forward(tape, p, memory);
        let v = self.value.forward(tape, p, memory);
        let y = tape.attention(q, k, v, self.heads);
        self.out.forward(tape, p, y)
    }

    /// As [`forward`](Self::forward), and the weights, with which [`average`](Self::average) can average something
    /// else: (h n) x m, head by head, for [`Reach::All`]; (n k) x h for [`Reach::Nearest`].
    ///
    /// # Panics
    /// As [`forward`](Self::forward).
    #[track_caller]
    pub fn forward_weighted(
        &self,
        tape: &mut Tape,
        p: &Bound,
        x: Var,
        memory: Var,
        reach: &Reach,
    ) -> (Var, Var) {
        let q = self.query.forward(tape, p, x);
        let k = self.key.forward(tape, p, memory);
        let v = self.value.forward(tape, p, memory);
        let (weights, y) = match reach {
            Reach::All => {
                let weights = tape.attention_weights(q, k, self.heads);
                (weights, tape.attention_average(weights, v, self.heads))
            }
            Reach::Nearest { index, k: near } => {
                let weights = tape.local_attention_weights(q, k, index.clone(), self.heads);
                (weights, tape.local_attention_average(weights, v, index.clone(), *near))
            }
        };
        (self.out.forward(tape, p, y), weights)
    }

    /// The average of `values` (m x d, any d) under the mean over heads of the weights of
    /// [`forward_weighted`](Self::forward_weighted): n x d. With the positions of the memory it stays inside their
    /// convex hull.
    ///
    /// # Panics
    /// If the weights are not of this reach and memory.
    #[track_caller]
    pub fn average(&self, tape: &mut Tape, weights: Var, values: Var, reach: &Reach) -> Var {
        let share = 1.0 / self.heads as f32;
        match reach {
            Reach::All => {
                let (n, m) = (tape.value(weights).rows() / self.heads, tape.value(weights).cols());
                let by_head = tape.reshape(weights, &[self.heads, n * m]);
                let total = tape.sum_rows(by_head);
                let mean = tape.scale(total, share);
                let mean = tape.reshape(mean, &[n, m]);
                tape.matmul(mean, values)
            }
            Reach::Nearest { index, k } => {
                let total = tape.sum_cols(weights);
                let mean = tape.scale(total, share);
                tape.local_attention_average(mean, values, index.clone(), *k)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::testing::Layer;
    use crate::ops::testing::normal;

    fn reaches() -> [Reach; 2] {
        [Reach::All, Reach::Nearest { index: vec![0, 1, 2, 3, 3, 1, 2, 0, 1, 4].into(), k: 2 }]
    }

    #[test]
    fn gradients() {
        for reach in reaches() {
            let layer = Layer::new(
                &[[5, 6], [5, 3]],
                |s, rng| MultiHeadAttention::new(s, 6, 3, 2, rng),
                |l, t, p, x| l.forward(t, p, x[0], x[1], &reach),
            );
            layer.check(3);
            layer.assert_alive(&["layer.key.bias"]);
            let layer = Layer::new(
                &[[5, 6], [5, 3], [5, 3]],
                |s, rng| MultiHeadAttention::new(s, 6, 3, 2, rng),
                |l, t, p, x| {
                    let (_, weights) = l.forward_weighted(t, p, x[0], x[1], &reach);
                    l.average(t, weights, x[2], &reach)
                },
            );
            layer.check(4);
            let unused = ["layer.value.weight", "layer.value.bias", "layer.out.weight", "layer.out.bias"];
            layer.assert_alive(&[&unused[..], &["layer.key.bias"]].concat());
        }
    }

    #[test]
    fn averages_stay_within_the_values_and_both_reaches_agree() {
        let mut params = crate::nn::Params::new();
        let mut rng = crate::random::Random::new(5);
        let layer = MultiHeadAttention::new(&mut params.scope("a"), 8, 8, 4, &mut rng);
        let all = Reach::Nearest { index: (0..7).flat_map(|_| 0..6).collect(), k: 6 };
        let mut t = Tape::new();
        let p = params.bind(&mut t, false);
        let x = t.constant(normal(&[7, 8], 1));
        let memory = t.constant(normal(&[6, 8], 2));
        let ones = t.constant(crate::tensor::Tensor::full(&[6, 3], 1.0));
        let mut results = Vec::new();
        for reach in [&Reach::All, &all] {
            let (y, w) = layer.forward_weighted(&mut t, &p, x, memory, reach);
            let one = layer.average(&mut t, w, ones, reach);
            assert!(t.value(one).data().iter().all(|v| (v - 1.0).abs() < 1e-6));
            let mean = layer.average(&mut t, w, memory, reach);
            results.push((t.value(y).clone(), t.value(mean).clone()));
        }
        let [(y, mean), (y_local, mean_local)] = &results[..] else { unreachable!() };
        for (a, b) in y.data().iter().zip(y_local.data()).chain(mean.data().iter().zip(mean_local.data())) {
            assert!((a - b).abs() < 1e-6);
        }
    }
}
