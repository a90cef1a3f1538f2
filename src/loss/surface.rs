//! Terms on the field itself: values near the surface, and the length of its gradient.

use crate::autodiff::{Tape, Var};

/// The mean of |g|: over the grid vertices near the surface it is L_surf (equation 6 of the paper), over points it
/// draws the surface through the points.
///
/// Shapes: `sdf` v x 1 to 1 x 1, in units of the working frame. Gradient: the sign of g over v; 0 where g is 0.
pub fn mean_abs(tape: &mut Tape, sdf: Var) -> Var {
    let magnitude = tape.abs(sdf);
    tape.mean(magnitude)
}

/// The mean of max(0, g + d): how far g is above -d, which it is where a point is less than d inside; not in the paper.
///
/// Shapes: `sdf` and `depth` v x 1 to 1 x 1, in units of the working frame. Gradient: 1 / v over v where g > -d, and 0
/// elsewhere.
pub fn inside(tape: &mut Tape, sdf: Var, depth: Var) -> Var {
    let above = tape.add(sdf, depth);
    let lack = tape.relu(above);
    tape.mean(lack)
}

/// The mean of (|grad g| - 1)^2, which keeps the field a distance (Gropp et al. 2020); not in the paper.
///
/// Shapes: `gradient` v x 3 to 1 x 1. Gradient: smooth except where grad g is 0, where it is taken as 0.
pub fn eikonal(tape: &mut Tape, gradient: Var) -> Var {
    let squared = tape.square(gradient);
    let squared = tape.sum_cols(squared);
    let length = tape.sqrt(squared);
    let off = tape.shift(length, -1.0);
    let off_sq = tape.square(off);
    tape.mean(off_sq)
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
        fn gradients(n in 1usize..20, seed: u64) {
            check(|t, x| mean_abs(t, x[0]), &[normal(&[n, 1], seed)], seed);
            check(|t, x| eikonal(t, x[0]), &[normal(&[n, 3], seed)], seed);
            check(|t, x| inside(t, x[0], x[1]), &[normal(&[n, 1], seed), normal(&[n, 1], seed ^ 1)], seed);
        }
    }

    #[test]
    fn unit_gradients_cost_nothing() {
        let mut t = Tape::new();
        let g = t.constant(Tensor::from_points(&[[1.0, 0.0, 0.0], [0.0, -0.6, 0.8]]));
        let y = eikonal(&mut t, g);
        assert!(t.value(y).item() < 1e-12);
        let s = t.constant(Tensor::from_vec(&[2, 1], vec![-3.0, 1.0]));
        let y = mean_abs(&mut t, s);
        assert_eq!(t.value(y).item(), 2.0);
        let depth = t.constant(Tensor::from_vec(&[2, 1], vec![2.0, 0.5]));
        let y = inside(&mut t, s, depth);
        assert_eq!(t.value(y).item(), 0.75);
    }
}
