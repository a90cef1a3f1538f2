//! Moving the grid's vertices along the field (equation 4 of the paper).

use crate::autodiff::{Tape, Var};

/// How a vertex V moves, given g(V) and n = grad g / |grad g|.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Deformation {
    /// V' = V - g n: the foot point on the zero level set, were g an exact distance. The paper's two formulas are
    /// misprinted (a norm of vectors, and g where grad g is meant); this is what they must mean.
    Projection,
    /// V' = V - tanh(g n), component by component, as in the authors' code.
    Tanh,
    /// V' = V + eps with eps from three more outputs of the network, as in DMTet (Shen et al. 2021); the paper's
    /// ablation f_offset.
    Offset,
    /// V' = V: plain marching tetrahedra, for comparison.
    None,
}

/// The moved vertices; `verts` v x 3, `sdf` v x 1 and `gradient` v x 3 to v x 3, in the working frame.
///
/// Gradient: to all three; smooth except where `gradient` is 0, where its direction counts as 0.
///
/// # Panics
/// If the shapes do not fit.
#[track_caller]
pub fn deform(tape: &mut Tape, how: Deformation, verts: Var, sdf: Var, gradient: Var) -> Var {
    if how == Deformation::None {
        return verts;
    }
    let normal = tape.normalize_rows(gradient);
    let step = tape.mul(normal, sdf);
    let step = if how == Deformation::Tanh { tape.tanh(step) } else { step };
    tape.sub(verts, step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::{check, normal};
    use crate::tensor::Tensor;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn gradients(n in 1usize..9, tanh: bool, seed: u64) {
            let how = if tanh { Deformation::Tanh } else { Deformation::Projection };
            let mut direction = normal(&[n, 3], seed ^ 2);
            direction.data_mut().chunks_exact_mut(3).for_each(|r| r[0] += r[0].signum());
            let inputs = [normal(&[n, 3], seed), normal(&[n, 1], seed ^ 1), direction];
            check(|t, x| deform(t, how, x[0], x[1], x[2]), &inputs, seed);
        }
    }

    #[test]
    fn projection_lands_on_the_sphere() {
        // g = |x| - 1, grad g = x / |x|; any scale of the gradient gives the same move.
        let mut t = Tape::new();
        let x = [[3.0, 0.0, 4.0], [0.0, 0.5, 0.0]];
        let v = t.constant(Tensor::from_points(&x));
        let g = t.constant(Tensor::from_vec(&[2, 1], vec![4.0, -0.5]));
        let d = t.constant(Tensor::from_points(&[[6.0, 0.0, 8.0], [0.0, 0.1, 0.0]]));
        let moved = deform(&mut t, Deformation::Projection, v, g, d);
        for (p, q) in t.value(moved).to_points().iter().zip([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]]) {
            assert!((0..3).all(|i| (p[i] - q[i]).abs() < 1e-6));
        }
    }
}
