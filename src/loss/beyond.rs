//! The squared distance to a set of points, as far as it exceeds a slack.

use crate::autodiff::{At, Op, Tape, Var};
use crate::geometry::nearest_points;
use crate::geometry::vec3::length;
use crate::tensor::Tensor;
use std::sync::Arc;

/// 1 / n sum_i max(0, |a_i - b_p(i)| - h_i)^2 with p the nearest neighbours, held constant.
struct Beyond {
    slack: Arc<[f32]>,
}

fn points(t: &Tensor) -> &[[f32; 3]] {
    t.data().as_chunks::<3>().0
}

/// b - a, and how much longer it is than the slack; 0 for a point within it.
fn step(a: &[f32; 3], b: &[f32; 3], slack: f32) -> ([f32; 3], f32, f32) {
    let step: [f32; 3] = std::array::from_fn(|d| b[d] - a[d]);
    let length = length(step);
    (step, length, (length - slack).max(0.0))
}

impl Op<2> for Beyond {
    type Saved = Vec<u32>;

    fn forward(&self, [a, b]: [&Tensor; 2]) -> (Tensor, Vec<u32>) {
        let (pa, pb) = (points(a), points(b));
        let (index, _) = nearest_points(pa, pb);
        let square = |((a, &j), &slack): ((&[f32; 3], &u32), &f32)| {
            f64::from(step(a, &pb[j as usize], slack).2).powi(2)
        };
        let sum: f64 = pa.iter().zip(&index).zip(self.slack.iter()).map(square).sum();
        let mut y = a.uninit_like(&[1, 1]);
        y.data_mut()[0] = (sum / pa.len() as f64) as f32;
        (y, index)
    }

    fn vjp(&self, at: At<'_, 2, Vec<u32>>, dy: &Tensor) -> [Option<Tensor>; 2] {
        let [a, b] = at.x;
        let (pa, pb) = (points(a), points(b));
        let (mut da, mut db) = (dy.zeros_like_pool(a.dims()), dy.zeros_like_pool(b.dims()));
        let share = 2.0 * dy.item() / pa.len() as f32;
        {
            let (da, db) = (da.data_mut().as_chunks_mut::<3>().0, db.data_mut().as_chunks_mut::<3>().0);
            for (i, (a, &j)) in pa.iter().zip(at.saved).enumerate() {
                let (step, length, beyond) = step(a, &pb[j as usize], self.slack[i]);
                if beyond > 0.0 {
                    for d in 0..3 {
                        let g = share * beyond * step[d] / length;
                        da[i][d] -= g;
                        db[j as usize][d] += g;
                    }
                }
            }
        }
        [at.needs[0].then_some(da), at.needs[1].then_some(db)]
    }
}

impl Tape {
    /// The mean over the points a (n x 3) of max(0, distance to the nearest point of b (m x 3) - slack)^2, with a slack
    /// of its own for every point of a (n); 1 x 1, in squared units of the points. With a slack of 0 it is one
    /// direction of the squared Chamfer distance.
    ///
    /// Gradient: to both sets of points, with the nearest neighbours held constant; 0 within the slack.
    ///
    /// # Panics
    /// If a set of points is empty, does not have 3 columns or is not finite, or there is not one slack a point, finite
    /// and not negative.
    #[track_caller]
    pub fn distance_beyond(&mut self, a: Var, b: Var, slack: Arc<[f32]>) -> Var {
        let (x, y) = (self.value(a), self.value(b));
        let fits = [x, y].iter().all(|t| t.cols() == 3 && !t.is_empty()) && slack.len() == x.rows();
        assert!(fits, "distance_beyond: {:?} and {:?}, {} slacks", x.shape(), y.shape(), slack.len());
        assert!(
            slack.iter().all(|h| h.is_finite() && *h >= 0.0),
            "distance_beyond: a slack below 0 or not finite"
        );
        self.apply(Beyond { slack }, [a, b])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loss::Direction;
    use crate::ops::testing::{check, normal};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..6, m in 1usize..6, slack in 0f32..0.8, seed: u64) {
            let inputs = [normal(&[n, 3], seed), normal(&[m, 3], seed ^ 1)];
            let slack: Arc<[f32]> = (0..n).map(|i| slack * (1 + i % 2) as f32).collect();
            check(|t, x| t.distance_beyond(x[0], x[1], slack.clone()), &inputs, seed);
        }
    }

    #[test]
    fn without_slack_it_is_one_direction_of_the_chamfer_distance() {
        let mut t = Tape::new();
        let (a, b) = (t.constant(normal(&[40, 3], 1)), t.constant(normal(&[30, 3], 2)));
        let beyond = t.distance_beyond(a, b, vec![0.0; 40].into());
        let chamfer = t.chamfer(a, b, Direction::FORWARD);
        assert!((t.value(beyond).item() - t.value(chamfer).item()).abs() < 1e-6);
    }

    #[test]
    fn points_in_one_place_have_no_gradient() {
        let mut t = Tape::new();
        let a = t.input(Tensor::from_points(&[[1.0, 2.0, 3.0]]));
        let b = t.constant(Tensor::from_points(&[[1.0, 2.0, 3.0]]));
        let y = t.distance_beyond(a, b, vec![0.0].into());
        assert_eq!(t.backward(y).get(a).unwrap().data(), [0.0; 3]);
    }

    #[test]
    fn within_the_slack_nothing_is_asked() {
        let mut t = Tape::new();
        let a = t.input(Tensor::from_points(&[[0.3, 0.0, 0.0], [5.0, 0.0, 0.0]]));
        let b = t.constant(Tensor::from_points(&[[0.0; 3]]));
        let y = t.distance_beyond(a, b, vec![0.5, 1.0].into());
        assert_eq!(t.value(y).item(), 8.0);
        assert_eq!(t.backward(y).get(a).unwrap().data(), [0.0, 0.0, 0.0, 4.0, 0.0, 0.0]);
    }
}
