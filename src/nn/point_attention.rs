//! Vector attention over the neighbours of a point.

use super::{Activation, Bound, Linear, Mlp, Scope};
use crate::autodiff::{Tape, Var};
use crate::random::Random;
use std::sync::Arc;

/// The point transformer layer: f_i = sum_j softmax_j(gamma(beta(x_i) - eta(x_j) + xi_ij)) * (alpha(x_j) + xi_ij) over
/// the k neighbours j of point i, channel by channel, with xi_ij = delta(p_i - p_j).
///
/// # Shapes
/// Points n x 3, features x n x c_in (the points themselves, if they have no features) and n k neighbours to n x c.
///
/// # Parameters
/// `alpha`, `beta`, `eta` linear c_in to c; `gamma` c to c to c and `delta` 3 to c to c, perceptrons with a ReLU;
/// initialised as [`Linear`] and [`Mlp`].
///
/// # Gradient
/// Smooth but for the ReLUs, in features and positions; the neighbours are fixed. The gradient of the last bias of
/// gamma is 0: the softmax cancels it.
///
/// # References
/// Zhao et al. 2021, Point transformer, equation 3.
#[derive(Clone, Debug)]
pub struct PointTransformer {
    alpha: Linear,
    beta: Linear,
    eta: Linear,
    gamma: Mlp,
    delta: Mlp,
}

impl PointTransformer {
    /// A layer from c_in to c channels.
    #[track_caller]
    pub fn new(scope: &mut Scope<'_>, c_in: usize, c: usize, rng: &mut Random) -> Self {
        PointTransformer {
            alpha: Linear::new(&mut scope.scope("alpha"), c_in, c, rng),
            beta: Linear::new(&mut scope.scope("beta"), c_in, c, rng),
            eta: Linear::new(&mut scope.scope("eta"), c_in, c, rng),
            gamma: Mlp::new(&mut scope.scope("gamma"), &[c, c, c], Activation::Relu, rng),
            delta: Mlp::new(&mut scope.scope("delta"), &[3, c, c], Activation::Relu, rng),
        }
    }

    /// Features x n x c_in at points n x 3, with the neighbours `index[i k .. (i + 1) k]` of point i, to n x c.
    ///
    /// # Panics
    /// If the shapes do not fit, the number of indices is not n k with k > 0, or an index is n or more.
    #[track_caller]
    pub fn forward(
        &self,
        tape: &mut Tape,
        p: &Bound,
        x: Var,
        points: Var,
        index: impl Into<Arc<[u32]>>,
    ) -> Var {
        let index = index.into();
        let n = tape.value(points).rows();
        let k = index.len() / n.max(1);
        assert!(
            tape.value(x).rows() == n && k * n == index.len() && k > 0,
            "point_transformer: features {:?}, points {:?} and {} neighbours",
            tape.value(x).shape(),
            tape.value(points).shape(),
            index.len()
        );
        let here = tape.repeat_rows(points, k);
        let there = tape.gather_rows(points, index.clone());
        let offset = tape.sub(here, there);
        let xi = self.delta.forward(tape, p, offset);

        // The linear maps before the gather: n rows each instead of n k.
        let (alpha, beta, eta) =
            (self.alpha.forward(tape, p, x), self.beta.forward(tape, p, x), self.eta.forward(tape, p, x));
        let beta = tape.repeat_rows(beta, k);
        let eta = tape.gather_rows(eta, index.clone());
        let relation = tape.sub(beta, eta);
        let relation = tape.add(relation, xi);
        let scores = self.gamma.forward(tape, p, relation);
        let weights = tape.softmax_groups(scores, k);

        let alpha = tape.gather_rows(alpha, index);
        let value = tape.add(alpha, xi);
        let weighted = tape.mul(value, weights);
        tape.sum_groups(weighted, k)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::Params;
    use crate::nn::testing::Layer;
    use crate::ops::testing::normal;

    const INDEX: [u32; 15] = [0, 1, 2, 1, 0, 4, 2, 3, 1, 3, 2, 0, 4, 1, 3];

    #[test]
    fn gradients() {
        // Few pairs and channels: of many ReLUs one always lies too close to its kink for differences.
        let near = [1u32, 2, 3, 0, 2, 1, 0, 3];
        let layer = Layer::new(
            &[[4, 2], [4, 3]],
            |s, rng| PointTransformer::new(s, 2, 4, rng),
            |l, t, p, x| l.forward(t, p, x[0], x[1], &near[..]),
        );
        layer.check(6);
        let layer = Layer::new(
            &[[4, 3]],
            |s, rng| PointTransformer::new(s, 3, 4, rng),
            |l, t, p, x| l.forward(t, p, x[0], x[0], &near[..]),
        );
        layer.check(7);
    }

    #[test]
    fn every_parameter_but_the_shift_of_the_scores_has_a_gradient() {
        let layer = Layer::new(
            &[[5, 4], [5, 3]],
            |s, rng| PointTransformer::new(s, 4, 6, rng),
            |l, t, p, x| l.forward(t, p, x[0], x[1], &INDEX[..]),
        );
        layer.assert_alive(&["layer.gamma.layer1.bias"]);
    }

    #[test]
    fn renaming_the_points_renames_the_result() {
        let mut params = Params::new();
        let mut rng = Random::new(3);
        let layer = PointTransformer::new(&mut params.scope("a"), 3, 8, &mut rng);
        let mut t = Tape::new();
        let p = params.bind(&mut t, false);
        let x = t.constant(normal(&[5, 3], 4));
        let y = layer.forward(&mut t, &p, x, x, &INDEX[..]);
        // New point i is old point order[i].
        let order = [3u32, 0, 4, 1, 2];
        let new_of = |old: u32| order.iter().position(|&o| o == old).unwrap() as u32;
        let index: Vec<u32> = order
            .iter()
            .flat_map(|&o| INDEX[3 * o as usize..3 * o as usize + 3].iter().map(|&j| new_of(j)))
            .collect();
        let moved = t.gather_rows(x, &order[..]);
        let moved = layer.forward(&mut t, &p, moved, moved, index);
        let expected = t.gather_rows(y, &order[..]);
        for (a, b) in t.value(moved).data().iter().zip(t.value(expected).data()) {
            assert!((a - b).abs() < 1e-6);
        }
    }

    #[test]
    fn one_neighbour_takes_all_the_weight() {
        // With k = 1 the softmax is 1, so f = alpha(x_j) + delta(p_i - p_j) whatever gamma is.
        let mut params = Params::new();
        let layer = PointTransformer::new(&mut params.scope("a"), 3, 4, &mut Random::new(3));
        let mut t = Tape::new();
        let p = params.bind(&mut t, false);
        let x = t.constant(normal(&[2, 3], 4));
        let y = layer.forward(&mut t, &p, x, x, &[1u32, 0][..]);
        let there = t.gather_rows(x, &[1u32, 0][..]);
        let offset = t.sub(x, there);
        let (a, d) = (layer.alpha.forward(&mut t, &p, there), layer.delta.forward(&mut t, &p, offset));
        let by_hand = t.add(a, d);
        for (a, b) in t.value(y).data().iter().zip(t.value(by_hand).data()) {
            assert!((a - b).abs() < 1e-6);
        }
    }
}
