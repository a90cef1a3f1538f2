//! Moving the grid's vertices along the field (equation 4 of the paper).

use crate::autodiff::{Tape, Var};
use crate::field::FieldVars;

/// How a vertex V moves, given g(V) and n = grad g / |grad g|.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
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

/// The moved vertices V', v x 3, working frame: `field` is what the field is at the vertices V, its points. Which edges
/// the surface crosses and where follows from g at V, not at V'.
///
/// Gradient: to all that enter; smooth except where the field's gradient is 0, where its direction counts as 0.
///
/// # Panics
/// If the shapes do not fit, or the field has no offset to move by.
#[track_caller]
pub fn deform(tape: &mut Tape, how: Deformation, field: &FieldVars) -> Var {
    let verts = field.points;
    let step = match how {
        Deformation::None => return verts,
        Deformation::Offset => {
            let offset = field.offset.expect("deform: a field made with an offset");
            return tape.add(verts, offset);
        }
        Deformation::Projection | Deformation::Tanh => {
            let normal = tape.normalize_rows(field.gradient);
            tape.mul(normal, field.sdf)
        }
    };
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
        fn gradients(n in 1usize..9, which in 0usize..4, seed: u64) {
            let how = ALL[which];
            let mut direction = normal(&[n, 3], seed ^ 2);
            direction.data_mut().chunks_exact_mut(3).for_each(|r| r[0] += r[0].signum());
            let inputs =
                [normal(&[n, 3], seed), normal(&[n, 1], seed ^ 1), direction, normal(&[n, 3], seed ^ 3)];
            let f = |t: &mut Tape, x: &[Var]| {
                deform(t, how, &FieldVars { points: x[0], sdf: x[1], gradient: x[2], offset: Some(x[3]) })
            };
            // The ways differ in what enters; a check needs every input to have a gradient.
            let used = match how {
                Deformation::None => 1,
                Deformation::Offset => 4,
                _ => 3,
            };
            check(
                |t, x| {
                    let mut all = x.to_vec();
                    all.extend(inputs[x.len()..].iter().map(|i| t.constant(i.clone())));
                    f(t, &all)
                },
                &inputs[..used],
                seed,
            );
        }

        #[test]
        fn agrees_with_plain_loops(n in 0usize..12, which in 0usize..4, seed: u64) {
            let how = ALL[which];
            let (x, s) = (normal(&[n, 3], seed), normal(&[n, 1], seed ^ 1));
            let (g, e) = (normal(&[n, 3], seed ^ 2), normal(&[n, 3], seed ^ 3));
            let mut t = Tape::new();
            let [points, sdf, gradient, offset] = [&x, &s, &g, &e].map(|x| t.constant(x.clone()));
            let moved = deform(&mut t, how, &FieldVars { points, sdf, gradient, offset: Some(offset) });
            for i in 0..n {
                let length = g.row(i).iter().map(|g| g * g).sum::<f32>().sqrt();
                for d in 0..3 {
                    let step = s.data()[i] * g.row(i)[d] / length;
                    let want = match how {
                        Deformation::Projection => x.row(i)[d] - step,
                        Deformation::Tanh => x.row(i)[d] - step.tanh(),
                        Deformation::Offset => x.row(i)[d] + e.row(i)[d],
                        Deformation::None => x.row(i)[d],
                    };
                    prop_assert!((t.value(moved).row(i)[d] - want).abs() < 1e-5);
                }
            }
        }
    }

    const ALL: [Deformation; 4] =
        [Deformation::Projection, Deformation::Tanh, Deformation::Offset, Deformation::None];

    #[test]
    fn projection_lands_on_the_sphere() {
        // g = |x| - 1, grad g = x / |x|; any scale of the gradient gives the same move.
        let mut t = Tape::new();
        let x = [[3.0, 0.0, 4.0], [0.0, 0.5, 0.0]];
        let points = t.constant(Tensor::from_points(&x));
        let sdf = t.constant(Tensor::from_vec(&[2, 1], vec![4.0, -0.5]));
        let gradient = t.constant(Tensor::from_points(&[[6.0, 0.0, 8.0], [0.0, 0.1, 0.0]]));
        let field = FieldVars { points, sdf, gradient, offset: None };
        let moved = deform(&mut t, Deformation::Projection, &field);
        for (p, q) in t.value(moved).to_points().iter().zip([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]]) {
            assert!((0..3).all(|i| (p[i] - q[i]).abs() < 1e-6));
        }
    }
}
