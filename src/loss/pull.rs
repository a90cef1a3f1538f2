//! Pulling points onto the nearest point of a target.

use crate::autodiff::{Tape, Var};
use crate::geometry::nearest_points;

/// The mean over v of |moved_i - t_p(i)|^2, where t_p(i) is the target point nearest to where vertex i came from.
///
/// Shapes: `from` v x 3 (constant), `moved` v x 3, `target` m x 3 to 1 x 1, in squared units of the working frame.
/// Gradient: to `moved` and `target`; which point is nearest is constant. Reference: Ma et al. 2021, Neural-Pull,
/// equation 2; alone, the paper's ablation f_TPS.
///
/// # Panics
/// If the shapes do not fit, a set of points is empty or not finite.
#[track_caller]
pub fn pull(tape: &mut Tape, from: &[[f32; 3]], moved: Var, target: Var) -> Var {
    let (nearest, _) = nearest_points(from, &tape.value(target).to_points());
    let nearest = tape.gather_rows(target, nearest);
    let off = tape.sub(moved, nearest);
    let off = tape.square(off);
    let off = tape.sum_cols(off);
    tape.mean(off)
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
        fn gradients(v in 1usize..12, m in 1usize..12, seed: u64) {
            let from = normal(&[v, 3], seed ^ 5).to_points();
            let inputs = [normal(&[v, 3], seed), normal(&[m, 3], seed ^ 1)];
            check(|t, x| pull(t, &from, x[0], x[1]), &inputs, seed);
        }
    }

    #[test]
    fn the_nearest_point_is_chosen_before_the_move() {
        let mut t = Tape::new();
        let moved = t.constant(Tensor::from_points(&[[9.0, 0.0, 0.0]]));
        let target = t.constant(Tensor::from_points(&[[1.0, 0.0, 0.0], [9.0, 0.0, 0.0]]));
        let y = pull(&mut t, &[[0.0; 3]], moved, target);
        assert_eq!(t.value(y).item(), 64.0);
    }
}
