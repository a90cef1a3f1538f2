//! Layer normalisation with gain and bias.

use super::{Bound, ParamId, Scope};
use crate::autodiff::{Tape, Var};
use crate::tensor::Tensor;

/// y = (x - mean) / sqrt(var + eps) gain + bias over each row, eps = 1e-5.
///
/// # Shapes
/// n x c to n x c.
///
/// # Parameters
/// `gain` 1 x c, all 1, and `bias` 1 x c, all 0.
///
/// # Gradient
/// Smooth; the standardised rows are kept.
///
/// # References
/// Ba, Kiros, Hinton 2016, Layer normalization, equation 4.
///
/// ```
/// use bijective_sdf::autodiff::Tape;
/// use bijective_sdf::nn::{LayerNorm, Params};
/// use bijective_sdf::tensor::Tensor;
///
/// let mut params = Params::new();
/// let norm = LayerNorm::new(&mut params.scope("norm"), 2);
/// let mut tape = Tape::new();
/// let bound = params.bind(&mut tape, true);
/// let x = tape.constant(Tensor::from_vec(&[1, 2], vec![10.0, 30.0]));
/// let y = norm.forward(&mut tape, &bound, x);
/// assert!((tape.value(y).data()[1] - 1.0).abs() < 1e-5);
/// ```
#[derive(Clone, Debug)]
pub struct LayerNorm {
    gain: ParamId,
    bias: ParamId,
}

impl LayerNorm {
    const EPS: f32 = 1e-5;

    /// A layer over c channels.
    #[track_caller]
    pub fn new(scope: &mut Scope<'_>, c: usize) -> Self {
        LayerNorm {
            gain: scope.add("gain", Tensor::full(&[1, c], 1.0)),
            bias: scope.add("bias", Tensor::zeros(&[1, c])),
        }
    }

    /// n x c to n x c.
    ///
    /// # Panics
    /// If `x` does not have c columns.
    #[track_caller]
    pub fn forward(&self, tape: &mut Tape, p: &Bound, x: Var) -> Var {
        tape.layer_norm(x, p.var(self.gain), p.var(self.bias), Self::EPS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::testing::Layer;

    #[test]
    fn gradients() {
        let layer = Layer::new(&[[4, 6]], |s, _| LayerNorm::new(s, 6), |l, t, p, x| l.forward(t, p, x[0]));
        layer.check(2);
        layer.assert_alive(&[]);
    }
}
