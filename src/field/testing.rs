//! The twin of [`Field::fused`], which training takes: the same arithmetic with ordinary operations of the tape.
//!
//! The losses depend on grad g, so training needs second derivatives. One reverse sweep through the layers (multiply
//! by the activation's slope, then by the transposed weight) puts grad g on the tape; pulling back through that is
//! an ordinary backward pass, and no higher-order tape is needed.

use super::{Field, FieldActivation, FieldVars};
use crate::autodiff::{Tape, Var};
use crate::nn::Bound;
use crate::tensor::Tensor;

impl Field {
    /// Weight (c_in x c_out) and bias (1 x c_out) of a layer on the tape.
    fn layer_vars(&self, p: &Bound, l: usize) -> [Var; 2] {
        let var = |part: &str| p.var(self.params().id(&format!("field.{l}.{part}")).unwrap());
        ["weight", "bias"].map(var)
    }

    /// The activation and its slope.
    fn activate(&self, tape: &mut Tape, z: Var) -> (Var, Var) {
        match self.config().activation {
            FieldActivation::Relu => (tape.relu(z), tape.relu_derivative(z)),
            FieldActivation::Softplus { beta } => tape.softplus_and_derivative(z, beta),
        }
    }

    /// The encoding of points (n x 3): [x, sin f x, cos f x, sin 2f x, cos 2f x, ...].
    fn encode(&self, points: &[[f32; 3]]) -> Tensor {
        let c = self.config().encoding_cols();
        let mut out = Tensor::zeros(&[points.len(), c]);
        for (row, x) in out.data_mut().chunks_exact_mut(c).zip(points) {
            row[..3].copy_from_slice(x);
            for (f, part) in self.config().frequencies().zip(row[3..].chunks_exact_mut(6)) {
                for d in 0..3 {
                    (part[d], part[3 + d]) = (f * x[d]).sin_cos();
                }
            }
        }
        out
    }

    /// All outputs at constant points: n x 3 to n x 1, or n x 4 with an offset. `slopes` collects the activations'
    /// slopes, layer by layer.
    fn forward(&self, tape: &mut Tape, p: &Bound, encoded: Var, mut slopes: impl FnMut(Var)) -> Var {
        let mut h = encoded;
        for l in 0..=self.config().depth {
            let [weight, bias] = self.layer_vars(p, l);
            if Some(l) == self.config().skip {
                let joined = tape.concat_cols([h, encoded]);
                h = tape.scale(joined, std::f32::consts::FRAC_1_SQRT_2);
            }
            let z = tape.linear(h, weight, bias);
            if l == self.config().depth {
                return z;
            }
            let (activated, slope) = self.activate(tape, z);
            slopes(slope);
            h = activated;
        }
        unreachable!("the last layer returns")
    }

    /// g, grad g and the displacement at constant points (n x 3, working frame), all on the tape.
    pub(crate) fn outputs(&self, tape: &mut Tape, p: &Bound, points: &[[f32; 3]]) -> FieldVars {
        let encoding = self.encode(points);
        let (sin_cos, c) = (encoding.clone(), self.config().encoding_cols());
        let encoded = tape.constant(encoding);
        let mut layer_slopes = Vec::with_capacity(self.config().depth);
        let out = self.forward(tape, p, encoded, |slope| layer_slopes.push(slope));

        // The adjoint of h, from the last layer down; a row until it meets the first slope.
        let [last, _] = self.layer_vars(p, self.config().depth);
        let column = if self.has_offset() { tape.slice_cols(last, 0..1) } else { last };
        let row = tape.reshape(column, &[1, self.config().width]);
        let mut adjoint_skip = None;
        let mut adjoint = row;
        for l in (0..self.config().depth).rev() {
            let through = tape.mul(layer_slopes[l], adjoint);
            adjoint = tape.matmul_nt(through, self.layer_vars(p, l)[0]);
            if Some(l) == self.config().skip {
                let scaled = tape.scale(adjoint, std::f32::consts::FRAC_1_SQRT_2);
                adjoint = tape.slice_cols(scaled, 0..self.config().width);
                adjoint_skip = Some(tape.slice_cols(scaled, self.config().width..self.config().width + c));
            }
        }
        let adjoint = match adjoint_skip {
            Some(skip) => tape.add(adjoint, skip),
            None => adjoint,
        };
        // Through the encoding: d sin(fx) = f cos(fx), d cos(fx) = -f sin(fx).
        let mut gradient = tape.slice_cols(adjoint, 0..3);
        if self.config().octaves > 0 {
            let mut slopes = Tensor::zeros(&[points.len(), c - 3]);
            for (out, row) in slopes.data_mut().chunks_exact_mut(c - 3).zip(sin_cos.data().chunks_exact(c)) {
                for ((f, out), row) in
                    self.config().frequencies().zip(out.chunks_exact_mut(6)).zip(row[3..].chunks_exact(6))
                {
                    for d in 0..3 {
                        out[d] = f * row[3 + d];
                        out[3 + d] = -f * row[d];
                    }
                }
            }
            let slopes = tape.constant(slopes);
            let waves = tape.slice_cols(adjoint, 3..c);
            let pulled = tape.mul(waves, slopes);
            for part in 0..2 * self.config().octaves {
                let term = tape.slice_cols(pulled, 3 * part..3 * part + 3);
                gradient = tape.add(gradient, term);
            }
        }
        let points = tape.constant(Tensor::from_points(points));
        if self.has_offset() {
            let sdf = tape.slice_cols(out, 0..1);
            FieldVars { points, sdf, gradient, offset: Some(tape.slice_cols(out, 1..4)) }
        } else {
            FieldVars { points, sdf: out, gradient, offset: None }
        }
    }
}
