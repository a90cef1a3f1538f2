//! The affine layer.

use super::{Bound, ParamId, Scope, init};
use crate::autodiff::{Tape, Var};
use crate::random::Random;
use crate::tensor::Tensor;

/// y = x w + b.
///
/// # Shapes
/// x n x c_in to y n x c_out.
///
/// # Parameters
/// `weight` c_in x c_out and `bias` 1 x c_out, both uniform in +-1 / sqrt(c_in).
///
/// # Gradient
/// Smooth; input and weight are kept.
///
/// ```
/// use bijective_sdf::autodiff::Tape;
/// use bijective_sdf::nn::{Linear, Params};
/// use bijective_sdf::tensor::Tensor;
///
/// let mut params = Params::new();
/// let weight = Tensor::from_vec(&[2, 1], vec![10.0, 1.0]);
/// let layer = Linear::from_tensors(&mut params.scope("a"), weight, Tensor::scalar(0.5));
/// let mut tape = Tape::new();
/// let bound = params.bind(&mut tape, true);
/// let x = tape.constant(Tensor::from_vec(&[1, 2], vec![3.0, 4.0]));
/// let y = layer.forward(&mut tape, &bound, x);
/// assert_eq!(tape.value(y).item(), 34.5);
/// ```
#[derive(Clone, Debug)]
pub struct Linear {
    weight: ParamId,
    bias: ParamId,
}

impl Linear {
    /// A layer with the initial values above.
    #[track_caller]
    pub fn new(scope: &mut Scope<'_>, c_in: usize, c_out: usize, rng: &mut Random) -> Self {
        let bound = 1.0 / (c_in.max(1) as f32).sqrt();
        let weight = init::uniform(&[c_in, c_out], bound, rng);
        let bias = init::uniform(&[1, c_out], bound, rng);
        Self::from_tensors(scope, weight, bias)
    }

    /// A layer with given initial values, weight c_in x c_out and bias 1 x c_out.
    ///
    /// # Panics
    /// If the bias does not have c_out values.
    #[track_caller]
    pub fn from_tensors(scope: &mut Scope<'_>, weight: Tensor, bias: Tensor) -> Self {
        assert!(
            bias.len() == weight.cols(),
            "linear: bias {:?} for weight {:?}",
            bias.shape(),
            weight.shape()
        );
        Linear { weight: scope.add("weight", weight), bias: scope.add("bias", bias) }
    }

    /// x w + b; n x c_in to n x c_out.
    ///
    /// # Panics
    /// If `x` does not have c_in columns.
    #[track_caller]
    pub fn forward(&self, tape: &mut Tape, p: &Bound, x: Var) -> Var {
        tape.linear(x, p.var(self.weight), p.var(self.bias))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::testing::Layer;

    #[test]
    fn gradients() {
        for (n, c, d) in [(1, 1, 1), (4, 3, 5), (7, 2, 1)] {
            let layer =
                Layer::new(&[[n, c]], |s, rng| Linear::new(s, c, d, rng), |l, t, p, x| l.forward(t, p, x[0]));
            layer.check(1);
            layer.assert_alive(&[]);
        }
    }
}
