//! Activations by name, and the multi-layer perceptron.

use super::{Bound, Linear, Scope, init};
use crate::autodiff::{Tape, Var};
use crate::tensor::Tensor;
use rand::rngs::ChaCha8Rng;

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

    /// The derivative at `x`, as a value on the tape that has a gradient itself.
    pub fn derivative(self, tape: &mut Tape, x: Var) -> Var {
        match self {
            Activation::Relu => tape.relu_derivative(x),
            Activation::Softplus { beta } => tape.softplus_derivative(x, beta),
            Activation::Tanh => {
                let y = tape.tanh(x);
                let squared = tape.square(y);
                let negated = tape.neg(squared);
                tape.shift(negated, 1.0)
            }
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
/// use rand::{SeedableRng, rngs::ChaCha8Rng};
///
/// let mut params = Params::new();
/// let mut rng = ChaCha8Rng::seed_from_u64(0);
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
    pub fn new(
        scope: &mut Scope<'_>,
        widths: &[usize],
        activation: Activation,
        rng: &mut ChaCha8Rng,
    ) -> Self {
        Self::build(scope, widths, activation, |_, c_in, c_out| {
            let bound = 1.0 / (c_in.max(1) as f32).sqrt();
            (init::uniform(&[c_in, c_out], bound, rng), init::uniform(&[1, c_out], bound, rng))
        })
    }

    /// A perceptron that starts as about |x| - `radius` of its first three inputs, for ReLU or a sharp softplus; the
    /// other inputs (an encoding) start without influence.
    ///
    /// # Panics
    /// If there are fewer than three widths, the first is less than 3 or the last is not 1.
    ///
    /// # References
    /// Atzmon, Lipman 2020, SAL: sign agnostic learning, theorem 1.
    #[track_caller]
    pub fn geometric(
        scope: &mut Scope<'_>,
        widths: &[usize],
        activation: Activation,
        radius: f32,
        rng: &mut ChaCha8Rng,
    ) -> Self {
        let fits = widths.len() >= 3 && widths[0] >= 3 && widths[widths.len() - 1] == 1;
        assert!(fits, "mlp: a geometric start needs widths [3 or more, ..., 1], not {widths:?}");
        Self::build(scope, widths, activation, |i, c_in, c_out| {
            if i + 2 == widths.len() {
                init::geometric_output(c_in, radius, rng)
            } else {
                let silent = if i == 0 { 3..c_in } else { 0..0 };
                init::geometric_hidden(c_in, c_out, silent, rng)
            }
        })
    }

    #[track_caller]
    fn build(
        scope: &mut Scope<'_>,
        widths: &[usize],
        activation: Activation,
        mut start: impl FnMut(usize, usize, usize) -> (Tensor, Tensor),
    ) -> Self {
        assert!(widths.len() >= 2, "mlp: widths {widths:?}, at least an input and an output expected");
        let mut layers = Vec::with_capacity(widths.len() - 1);
        for (i, pair) in widths.windows(2).enumerate() {
            let (weight, bias) = start(i, pair[0], pair[1]);
            layers.push(Linear::from_tensors(&mut scope.scope(&format!("layer{i}")), weight, bias));
        }
        Mlp { layers, activation }
    }

    /// The linear layers, first to last.
    pub fn layers(&self) -> &[Linear] {
        &self.layers
    }

    /// The activation between them.
    pub fn activation(&self) -> Activation {
        self.activation
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
    use crate::nn::Params;
    use crate::nn::testing::Layer;
    use crate::ops::testing::check;
    use crate::ops::testing::normal;
    use rand::SeedableRng;

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

    #[test]
    fn derivative_is_that_of_the_value() {
        for activation in ALL {
            let x = normal(&[5, 3], 8);
            let mut t = Tape::new();
            let v = t.input(x.clone());
            let (y, d) = (activation.apply(&mut t, v), activation.derivative(&mut t, v));
            let pulled = t.pull([(y, Tensor::full(&[5, 3], 1.0))]);
            for (a, b) in pulled.get(v).unwrap().data().iter().zip(t.value(d).data()) {
                assert!((a - b).abs() < 1e-6);
            }
            check(|t, x| activation.derivative(t, x[0]), &[x], 3);
        }
    }

    #[test]
    fn geometric_start_is_near_the_distance_to_a_sphere() {
        for (activation, octaves) in
            [(Activation::Relu, 0), (Activation::Softplus { beta: 100.0 }, 0), (Activation::Relu, 3)]
        {
            let mut params = Params::new();
            let mut rng = ChaCha8Rng::seed_from_u64(2);
            let width = 3 * (1 + 2 * octaves);
            let widths = [width, 256, 256, 256, 1];
            let net = Mlp::geometric(&mut params.scope("f"), &widths, activation, 0.5, &mut rng);
            let grid: Vec<[f32; 3]> =
                (0..9 * 9 * 9).map(|i| [i % 9, i / 9 % 9, i / 81].map(|c| (c as f32 - 4.0) / 4.0)).collect();
            let mut t = Tape::new();
            let p = params.bind(&mut t, false);
            let x = t.constant(Tensor::from_points(&grid));
            let x = t.fourier(x, octaves);
            let y = net.forward(&mut t, &p, x);
            let (mut total, mut worst) = (0.0, 0.0f32);
            for (x, y) in grid.iter().zip(t.value(y).data()) {
                let length = x.iter().map(|v| v * v).sum::<f32>().sqrt();
                let error = (y - (length - 0.5)).abs();
                total += error;
                worst = worst.max(error / (0.2 + length));
            }
            let mean = total / grid.len() as f32;
            // The finite width leaves an error in proportion to the length. Softplus adds ln 2 / beta in every unit,
            // which flattens the field around the centre and leaves the rest.
            let bound = if activation == Activation::Relu { 0.25 } else { 1.5 };
            assert!(mean < 0.12 && worst < bound, "{activation:?}: mean {mean}, worst {worst}");
        }
    }
}
