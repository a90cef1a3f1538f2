//! The squared Chamfer distance between two sets of points.

use crate::autodiff::{At, Op, Tape, Var};
use crate::geometry::PointTree;
use crate::tensor::Tensor;

/// Which nearest neighbours enter a [`chamfer`](Tape::chamfer) distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// Weight of the mean over the first set of the squared distance to its nearest point in the second.
    pub forward: f32,
    /// Weight of the mean over the second set of the squared distance to its nearest point in the first.
    pub backward: f32,
}

impl Direction {
    /// Both directions with weight 1: the distance of equations 3 and 5 of the paper.
    pub const BOTH: Direction = Direction { forward: 1.0, backward: 1.0 };
    /// From each point of the first set to the second only.
    pub const FORWARD: Direction = Direction { forward: 1.0, backward: 0.0 };
    /// From each point of the second set to the first only: how well the first covers the second.
    pub const BACKWARD: Direction = Direction { forward: 0.0, backward: 1.0 };
}

/// f / n sum_i |a_i - b_p(i)|^2 + g / m sum_j |b_j - a_q(j)|^2 with p and q the nearest neighbours, held constant.
struct Chamfer {
    direction: Direction,
}

/// The nearest index in the other set, for both directions; empty for a direction of weight 0.
struct Nearest {
    of_a: Vec<u32>,
    of_b: Vec<u32>,
}

/// Weighted mean squared distance and nearest indices of `from` in `to`.
fn one_way(from: &PointTree, to: &PointTree, weight: f32) -> (f64, Vec<u32>) {
    if weight == 0.0 {
        return (0.0, Vec::new());
    }
    let (index, distance_sq) = to.nearest(from);
    let sum: f64 = distance_sq.iter().map(|&d| f64::from(d)).sum();
    (f64::from(weight) * sum / from.len() as f64, index)
}

/// Adds the gradient of one direction: 2 w / n (x_i - y_p(i)) to dx_i and its negative to dy_p(i).
fn pull_one_way(x: &[[f32; 3]], y: &[[f32; 3]], index: &[u32], scale: f32, dx: &mut [f32], dy: &mut [f32]) {
    let (dx, dy) = (dx.as_chunks_mut::<3>().0, dy.as_chunks_mut::<3>().0);
    for ((dx, x), &j) in dx.iter_mut().zip(x).zip(index) {
        let (y, dy) = (&y[j as usize], &mut dy[j as usize]);
        for i in 0..3 {
            let g = 2.0 * scale * (x[i] - y[i]);
            dx[i] += g;
            dy[i] -= g;
        }
    }
}

fn points<'a>(name: &str, t: &'a Tensor) -> &'a [[f32; 3]] {
    assert!(
        t.cols() == 3 && !t.is_empty(),
        "chamfer: {name} of shape {:?}, n x 3 with n > 0 expected",
        t.shape()
    );
    t.data().as_chunks::<3>().0
}

impl Op<2> for Chamfer {
    type Saved = Nearest;

    fn forward(&self, [a, b]: [&Tensor; 2]) -> (Tensor, Nearest) {
        let (pa, pb) = (points("first points", a), points("second points", b));
        // Each direction needs both trees: one to search in, one for the order of the queries.
        let (ta, tb) = rayon::join(|| PointTree::new(pa), || PointTree::new(pb));
        let ((forward, of_a), (backward, of_b)) = rayon::join(
            || one_way(&ta, &tb, self.direction.forward),
            || one_way(&tb, &ta, self.direction.backward),
        );
        let mut y = a.uninit_like(&[1, 1]);
        y.data_mut()[0] = (forward + backward) as f32;
        (y, Nearest { of_a, of_b })
    }

    fn vjp(&self, at: At<'_, 2, Nearest>, dy: &Tensor) -> [Option<Tensor>; 2] {
        let [a, b] = at.x;
        let (pa, pb) = (points("first points", a), points("second points", b));
        let (mut da, mut db) = (dy.zeros_like_pool(a.dims()), dy.zeros_like_pool(b.dims()));
        let forward = dy.item() * self.direction.forward / pa.len() as f32;
        let backward = dy.item() * self.direction.backward / pb.len() as f32;
        pull_one_way(pa, pb, &at.saved.of_a, forward, da.data_mut(), db.data_mut());
        pull_one_way(pb, pa, &at.saved.of_b, backward, db.data_mut(), da.data_mut());
        [at.needs[0].then_some(da), at.needs[1].then_some(db)]
    }
}

impl Tape {
    /// The squared Chamfer distance between the points a (n x 3) and b (m x 3): the mean squared distance to the
    /// nearest point of the other set, per direction, weighted and summed; 1 x 1, in squared units of the points.
    ///
    /// Gradient: to both sets of points, with the nearest neighbours held constant; smooth except where one changes.
    /// Reference: equations 3 and 5 of the paper (`Direction::BOTH`).
    ///
    /// # Panics
    /// If a set of points is empty, does not have 3 columns, or is not finite.
    ///
    /// ```
    /// use bijective_sdf::autodiff::Tape;
    /// use bijective_sdf::loss::Direction;
    /// use bijective_sdf::tensor::Tensor;
    ///
    /// let mut tape = Tape::new();
    /// let a = tape.input(Tensor::from_points(&[[0.0; 3]]));
    /// let b = tape.constant(Tensor::from_points(&[[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]]));
    /// let loss = tape.chamfer(a, b, Direction::BOTH);
    /// assert_eq!(tape.value(loss).item(), 1.0 + (1.0 + 4.0) / 2.0);
    /// assert_eq!(tape.backward(loss).get(a).unwrap().data(), [-2.0 - 1.0, -2.0, 0.0]);
    /// ```
    #[track_caller]
    pub fn chamfer(&mut self, a: Var, b: Var, direction: Direction) -> Var {
        self.apply(Chamfer { direction }, [a, b])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::{check, normal};
    use proptest::prelude::*;

    /// All pairs, in f64.
    fn naive(a: &[[f32; 3]], b: &[[f32; 3]], direction: Direction) -> f64 {
        let d = |x: &[f32; 3], y: &[f32; 3]| {
            (0..3).map(|i| (f64::from(x[i]) - f64::from(y[i])).powi(2)).sum::<f64>()
        };
        let way = |x: &[[f32; 3]], y: &[[f32; 3]]| {
            x.iter().map(|p| y.iter().map(|q| d(p, q)).fold(f64::INFINITY, f64::min)).sum::<f64>()
                / x.len() as f64
        };
        f64::from(direction.forward) * way(a, b) + f64::from(direction.backward) * way(b, a)
    }

    /// Points in general position, on a lattice with duplicates, in a plane, and on a line.
    fn some_points() -> impl Strategy<Value = Vec<[f32; 3]>> {
        (prop::collection::vec([-2i8..3, -2i8..3, -2i8..3], 1..40), 0..4).prop_map(|(points, form)| {
            let place = |p: [i8; 3]| {
                let x = p.map(f32::from);
                match form {
                    0 => [x[0] + 0.13 * x[1], x[1] - 0.29 * x[2], x[2] + 0.41 * x[0]],
                    1 => x,
                    2 => [x[0], x[1], 0.5],
                    _ => [x[0], 0.0, 0.0],
                }
            };
            points.into_iter().map(place).collect()
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn agrees_with_all_pairs(a in some_points(), b in some_points(), forward in 0f32..2.0, one_sided: bool) {
            let direction = Direction { forward, backward: if one_sided { 0.0 } else { 0.7 } };
            let mut t = Tape::new();
            let (va, vb) = (t.constant(Tensor::from_points(&a)), t.constant(Tensor::from_points(&b)));
            let y = t.chamfer(va, vb, direction);
            let truth = naive(&a, &b, direction);
            prop_assert!((f64::from(t.value(y).item()) - truth).abs() <= 1e-5 * (1.0 + truth));
        }

        #[test]
        fn gradients(n in 1usize..12, m in 1usize..12, seed: u64) {
            let sets = [normal(&[n, 3], seed), normal(&[m, 3], seed ^ 1)];
            let both = Direction { forward: 0.8, backward: 1.3 };
            for direction in [both, Direction::FORWARD, Direction::BACKWARD] {
                check(|t, x| t.chamfer(x[0], x[1], direction), &sets, seed);
            }
        }
    }

    #[test]
    fn a_set_is_at_distance_zero_from_itself() {
        let mut t = Tape::new();
        let a = t.input(normal(&[50, 3], 1));
        let y = t.chamfer(a, a, Direction::BOTH);
        assert_eq!(t.value(y).item(), 0.0);
        assert!(t.backward(y).get(a).unwrap().data().iter().all(|&g| g == 0.0));
    }
}
