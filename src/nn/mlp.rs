//! Activations by name, and the multi-layer perceptron.

use super::{Bound, Linear, Scope};
use crate::autodiff::{Tape, Var};
use crate::random::Random;

/// An activation, element by element.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Activation {
    /// max(x, 0).
    Relu,
    /// ln(1 + e^(beta x)) / beta: a ReLU with a corner about 1 / beta wide.
    Softplus {
        /// Sharpness of the corner.
        beta: f32,
    },
    /// tanh x.
    Tanh,
}

impl Activation {
    /// The value.
    pub fn apply(self, tape: &mut Tape, x: Var) -> Var {
        match self {
            Activation::Relu => tape.relu(x),
            Activation::Softplus { beta } => tape.softplus(x, beta),
            Activation::Tanh => tape.tanh(x),
        }
    }
}

/// Linear layers with an activation between them: y = W_l a(... a(x W_1 + b_1) ...) + b_l. None after the last.
///
/// # Shapes
/// x n x `widths[0]` to y n x `widths[l]`.
///
/// # Parameters
/// `layer0`, `layer1`, ... with `weight` and `bias` each, initialised as [`Linear`].
///
/// # Gradient
/// As smooth as the activation.
///
/// ```
/// use bijective_sdf::autodiff::Tape;
/// use bijective_sdf::nn::{Activation, Mlp, Params};
/// use bijective_sdf::tensor::Tensor;
/// use bijective_sdf::Random;
///
/// let mut params = Params::new();
/// let mut rng = Random::new(0);
/// let net = Mlp::new(&mut params.scope("net"), &[1, 2, 1], Activation::Relu, &mut rng);
/// // |x| = relu(x) + relu(-x).
/// for (name, values) in [
///     ("net.layer0.weight", vec![1.0, -1.0]), ("net.layer0.bias", vec![0.0, 0.0]),
///     ("net.layer1.weight", vec![1.0, 1.0]), ("net.layer1.bias", vec![0.0]),
/// ] {
///     let id = params.id(name).unwrap();
///     params.value_mut(id).data_mut().copy_from_slice(&values);
/// }
/// let mut tape = Tape::new();
/// let bound = params.bind(&mut tape, true);
/// let x = tape.constant(Tensor::from_vec(&[2, 1], vec![-3.0, 5.0]));
/// let y = net.forward(&mut tape, &bound, x);
/// assert_eq!(tape.value(y).data(), [3.0, 5.0]);
/// ```
#[derive(Clone, Debug)]
pub struct Mlp {
    layers: Vec<Linear>,
    activation: Activation,
}

impl Mlp {
    /// A perceptron of these widths, input and output included.
    ///
    /// # Panics
    /// If there are fewer than two widths.
    #[track_caller]
    pub fn new(scope: &mut Scope<'_>, widths: &[usize], activation: Activation, rng: &mut Random) -> Self {
        assert!(widths.len() >= 2, "mlp: widths {widths:?}, at least an input and an output expected");
        let mut layers = Vec::with_capacity(widths.len() - 1);
        for (i, pair) in widths.windows(2).enumerate() {
            layers.push(Linear::new(&mut scope.scope(&format!("layer{i}")), pair[0], pair[1], rng));
        }
        Mlp { layers, activation }
    }

    /// n x `widths[0]` to n x `widths[l]`.
    ///
    /// # Panics
    /// If `x` does not have `widths[0]` columns.
    #[track_caller]
    pub fn forward(&self, tape: &mut Tape, p: &Bound, x: Var) -> Var {
        let mut x = x;
        for (i, layer) in self.layers.iter().enumerate() {
            if i > 0 {
                x = self.activation.apply(tape, x);
            }
            x = layer.forward(tape, p, x);
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::testing::Layer;

    const ALL: [Activation; 3] = [Activation::Relu, Activation::Softplus { beta: 2.0 }, Activation::Tanh];

    #[test]
    fn gradients() {
        for activation in ALL {
            for widths in [&[2, 3][..], &[3, 5, 2], &[1, 4, 4, 1]] {
                let layer = Layer::new(
                    &[[4, widths[0]]],
                    |s, rng| Mlp::new(s, widths, activation, rng),
                    |l, t, p, x| l.forward(t, p, x[0]),
                );
                layer.check(1);
                layer.assert_alive(&[]);
            }
        }
    }
}
