//! The transformer decoder block.

use super::{Activation, Bound, LayerNorm, Mlp, MultiHeadAttention, Reach, Scope};
use crate::autodiff::{Tape, Var};
use crate::random::Random;

/// x += self(norm(x)), if it is there; x += cross(norm(x), memory); x += feed(norm(x)): residual branches with the
/// norm in front.
///
/// # Shapes
/// x n x c and memory m x c_memory to n x c.
///
/// # Parameters
/// `norm_self` and `self` (only with self-attention), `norm_cross`, `cross`, `norm_feed`, `feed` (two linear layers
/// with a ReLU between), initialised as [`LayerNorm`], [`MultiHeadAttention`] and [`Mlp`].
///
/// # Gradient
/// Smooth but for the ReLU. Key biases have none.
///
/// # References
/// Vaswani et al. 2017, Attention is all you need, section 3.1; norms in front as Xiong et al. 2020, On layer
/// normalization in the transformer architecture. The memory is used as it is.
#[derive(Clone, Debug)]
pub struct DecoderBlock {
    own: Option<(LayerNorm, MultiHeadAttention)>,
    norm_cross: LayerNorm,
    cross: MultiHeadAttention,
    norm_feed: LayerNorm,
    feed: Mlp,
}

/// The sizes of a [`DecoderBlock`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DecoderSizes {
    /// Channels of the queries, c.
    pub channels: usize,
    /// Channels of the memory.
    pub memory: usize,
    /// Heads of both attentions; c is a multiple of it.
    pub heads: usize,
    /// Width of the feed-forward layer.
    pub hidden: usize,
    /// Whether queries attend to each other first.
    pub self_attention: bool,
}

impl DecoderBlock {
    /// A block of these sizes.
    ///
    /// # Panics
    /// If the channels are not a multiple of the heads.
    #[track_caller]
    pub fn new(scope: &mut Scope<'_>, sizes: DecoderSizes, rng: &mut Random) -> Self {
        let DecoderSizes { channels: c, memory, heads, hidden, self_attention } = sizes;
        let own = self_attention.then(|| {
            (
                LayerNorm::new(&mut scope.scope("norm_self"), c),
                MultiHeadAttention::new(&mut scope.scope("self"), c, c, heads, rng),
            )
        });
        DecoderBlock {
            own,
            norm_cross: LayerNorm::new(&mut scope.scope("norm_cross"), c),
            cross: MultiHeadAttention::new(&mut scope.scope("cross"), c, memory, heads, rng),
            norm_feed: LayerNorm::new(&mut scope.scope("norm_feed"), c),
            feed: Mlp::new(&mut scope.scope("feed"), &[c, hidden, c], Activation::Relu, rng),
        }
    }

    /// The cross-attention, whose [`average`](MultiHeadAttention::average) takes the weights of
    /// [`forward_weighted`](Self::forward_weighted).
    pub fn cross(&self) -> &MultiHeadAttention {
        &self.cross
    }

    /// x n x c and memory m x c_memory to n x c; `own` is the reach of the self-attention, which is not looked at if
    /// there is none, and `cross` that of the cross-attention.
    ///
    /// # Panics
    /// If the shapes or indices do not fit.
    #[track_caller]
    pub fn forward(
        &self,
        tape: &mut Tape,
        p: &Bound,
        x: Var,
        own: &Reach,
        memory: Var,
        cross: &Reach,
    ) -> Var {
        let x = self.attend_to_own(tape, p, x, own);
        let normed = self.norm_cross.forward(tape, p, x);
        let y = self.cross.forward(tape, p, normed, memory, cross);
        self.feed_forward(tape, p, x, y)
    }

    /// As [`forward`](Self::forward), and the weights of the cross-attention.
    ///
    /// # Panics
    /// As [`forward`](Self::forward).
    #[track_caller]
    pub fn forward_weighted(
        &self,
        tape: &mut Tape,
        p: &Bound,
        x: Var,
        own: &Reach,
        memory: Var,
        cross: &Reach,
    ) -> (Var, Var) {
        let x = self.attend_to_own(tape, p, x, own);
        let normed = self.norm_cross.forward(tape, p, x);
        let (y, weights) = self.cross.forward_weighted(tape, p, normed, memory, cross);
        (self.feed_forward(tape, p, x, y), weights)
    }

    /// x + self(norm(x)), or x if there is no self-attention.
    fn attend_to_own(&self, tape: &mut Tape, p: &Bound, x: Var, own: &Reach) -> Var {
        let Some((norm, attention)) = &self.own else { return x };
        let normed = norm.forward(tape, p, x);
        let y = attention.forward(tape, p, normed, normed, own);
        tape.add(x, y)
    }

    /// With z = x + y: z + feed(norm(z)).
    fn feed_forward(&self, tape: &mut Tape, p: &Bound, x: Var, y: Var) -> Var {
        let x = tape.add(x, y);
        let normed = self.norm_feed.forward(tape, p, x);
        let y = self.feed.forward(tape, p, normed);
        tape.add(x, y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::testing::Layer;

    #[test]
    fn gradients() {
        let near = Reach::Nearest { index: vec![0, 1, 2, 2, 1, 0, 2, 1].into(), k: 2 };
        for (self_attention, cross) in [(false, &Reach::All), (true, &Reach::All), (true, &near)] {
            let sizes = DecoderSizes { channels: 6, memory: 5, heads: 2, hidden: 7, self_attention };
            let layer = Layer::new(
                &[[4, 6], [3, 5]],
                |s, rng| DecoderBlock::new(s, sizes, rng),
                |l, t, p, x| l.forward(t, p, x[0], &Reach::All, x[1], cross),
            );
            layer.check(5);
            if self_attention {
                layer.assert_alive(&["layer.self.key.bias", "layer.cross.key.bias"]);
            } else {
                layer.assert_alive(&["layer.cross.key.bias"]);
            }
        }
    }
}
