//! Interpolation between neighbours, to compare BSP with: denser points, with nothing learned.

use super::Neighbourhood;
use crate::autodiff::{Tape, Var};
use crate::geometry::KdTree;
use crate::nn::Params;
use crate::tensor::Tensor;

/// M points for each point of Q, each halfway to the middle of two of its nearest neighbours.
///
/// s_nj = q_n / 2 + (q_a + q_b) / 4, where (a, b) is the j-th pair of neighbours of q_n, other than itself and nearest
/// first: (1, 2), (1, 3), (2, 3), (1, 4), ... As many neighbours take part as have M pairs among them, 5 for M = 10.
/// The weight on q_n keeps the points apart that the three corners of a triangle make of it. Where there are not that
/// many neighbours, the pairs are used again from the first; of two points there is one pair, the other point twice; a
/// single point is repeated.
///
/// S depends on Q alone: there are no parameters, no gradients, and nothing random.
///
/// In the paper's ablation "Upsample" a trained network (LDI, Li et al. 2024) densifies Q before the field is
/// learned. This is the part of it that every such method starts from, without the learned correction.
#[derive(Clone, Debug)]
pub struct Upsample {
    points: Vec<[f32; 3]>,
    patch: usize,
    params: Params,
}

impl Upsample {
    /// S for Q, `points` (n x 3), `patch` points each.
    ///
    /// # Panics
    /// If there are no points or `patch` is 0.
    #[track_caller]
    pub fn new(points: &[[f32; 3]], patch: usize) -> Self {
        assert!(!points.is_empty() && patch > 0, "upsample: {} points, {patch} each", points.len());
        let n = points.len();
        let k = (2..).find(|k| k * (k - 1) / 2 >= patch).expect("pairs grow without bound").min(n - 1);
        let pairs: Vec<(usize, usize)> = match k {
            0 => Vec::new(),
            1 => vec![(0, 0)],
            _ => (1..k).flat_map(|b| (0..b).map(move |a| (a, b))).collect(),
        };
        let near = KdTree::new(points).k_nearest(points, k + 1);
        let mut surface = Vec::with_capacity(n * patch);
        for (i, (q, near)) in points.iter().zip(near.chunks_exact(k + 1)).enumerate() {
            // Among points at one place the first k + 1 may lack the point itself; then the last is one too many.
            let others: Vec<[f32; 3]> =
                near.iter().filter(|&&j| j as usize != i).take(k).map(|&j| points[j as usize]).collect();
            for j in 0..patch {
                surface.push(match pairs.get(j % pairs.len().max(1)) {
                    Some(&(a, b)) => {
                        std::array::from_fn(|d| 0.5 * q[d] + 0.25 * (others[a][d] + others[b][d]))
                    }
                    None => *q,
                });
            }
        }
        Upsample { points: surface, patch, params: Params::new() }
    }

    /// No parameters.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// No parameters, to be changed.
    pub fn params_mut(&mut self) -> &mut Params {
        &mut self.params
    }

    /// Points of S for each point of Q.
    pub fn patch(&self) -> usize {
        self.patch
    }

    /// The patches of a block's centres (b M x 3), as a constant.
    ///
    /// # Panics
    /// If the block is of more points.
    #[track_caller]
    pub fn forward(&self, tape: &mut Tape, block: &Neighbourhood) -> Var {
        let patch = |&i: &u32| &self.points[i as usize * self.patch..(i as usize + 1) * self.patch];
        let points: Vec<[f32; 3]> = block.centres().iter().flat_map(patch).copied().collect();
        tape.constant(Tensor::from_points(&points))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::normal;
    use proptest::prelude::*;

    /// The other points from near to far, ties by index, by looking at all of them.
    fn others(points: &[[f32; 3]], i: usize) -> Vec<[f32; 3]> {
        let dist_sq = |j: usize| -> f32 { (0..3).map(|d| (points[i][d] - points[j][d]).powi(2)).sum() };
        let mut order: Vec<usize> = (0..points.len()).filter(|&j| j != i).collect();
        order.sort_by(|&a, &b| dist_sq(a).total_cmp(&dist_sq(b)).then(a.cmp(&b)));
        order.into_iter().map(|j| points[j]).collect()
    }

    #[test]
    fn points_are_those_of_the_formula() {
        // Neighbours of the first, near to far: (4, 0, 0), (0, 8, 0), (0, 0, 16), (0, 0, -32).
        let points = [[0.0f32; 3], [0.0, 8.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, -32.0], [0.0, 0.0, 16.0]];
        let first = |patch: usize| Upsample::new(&points, patch).points[..patch].to_vec();
        let expected = [[1.0, 2.0, 0.0], [1.0, 0.0, 4.0], [0.0, 2.0, 4.0]];
        assert_eq!(first(1), expected[..1]);
        assert_eq!(first(3), expected);
        assert_eq!(first(6)[3..], [[1.0, 0.0, -8.0], [0.0, 2.0, -8.0], [0.0, 0.0, -4.0]]);
        // Four neighbours have six pairs; then from the first again.
        assert_eq!(first(9)[6..], expected);
        assert_eq!(Upsample::new(&points[..1], 2).points, [[0.0; 3]; 2]);
        assert_eq!(Upsample::new(&points[..2], 2).points, [[0.0, 4.0, 0.0]; 4]);
    }

    #[test]
    fn few_points_equal_the_twin() {
        for n in 1..=12 {
            let points = normal(&[n, 3], n as u64).to_points();
            for patch in [1, 2, 3, 5, 10, 15] {
                let up = Upsample::new(&points, patch);
                assert_eq!(up.points.len(), n * patch);
                for (i, got) in up.points.chunks(patch).enumerate() {
                    let near = others(&points, i);
                    // Pairs by their farther neighbour, then by the nearer.
                    let most =
                        (0..).find(|m| m * (m + 1) / 2 >= patch).unwrap().min(near.len().saturating_sub(1));
                    let mut pairs = Vec::new();
                    for b in 1..=most {
                        pairs.extend((0..b).map(|a| (a, b)));
                    }
                    for (j, s) in got.iter().enumerate() {
                        let (a, b) = match near.len() {
                            0 => (points[i], points[i]),
                            1 => (near[0], near[0]),
                            _ => (near[pairs[j % pairs.len()].0], near[pairs[j % pairs.len()].1]),
                        };
                        for d in 0..3 {
                            let want =
                                0.5 * f64::from(points[i][d]) + 0.25 * (f64::from(a[d]) + f64::from(b[d]));
                            assert!((f64::from(s[d]) - want).abs() < 1e-6, "n {n}, patch {patch}, {i}, {j}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn points_made_of_general_positions_are_distinct() {
        let points = normal(&[60, 3], 4).to_points();
        let mut all: Vec<[u32; 3]> =
            Upsample::new(&points, 10).points.iter().map(|p| p.map(f32::to_bits)).collect();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), 600);
    }

    #[test]
    fn blocks_take_their_patches() {
        let points = normal(&[23, 3], 4).to_points();
        let up = Upsample::new(&points, 3);
        let blocks = Neighbourhood::bare_blocks(&points, 8);
        assert!(blocks.len() > 2);
        let mut tape = Tape::new();
        for block in &blocks {
            let part = up.forward(&mut tape, block);
            let part = tape.value(part).to_points();
            for (&centre, patch) in block.centres().iter().zip(part.chunks(3)) {
                assert_eq!(patch, &up.points[3 * centre as usize..][..3]);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// No plane has a point of S beyond the point it belongs to and its neighbours.
        #[test]
        fn points_lie_in_the_hull_of_the_point_and_its_neighbours(
            points in prop::collection::vec(prop::array::uniform3(-1.0f32..1.0), 1..40),
            patch in 1..16usize,
            directions in prop::collection::vec(prop::array::uniform3(-1.0f64..1.0), 40),
        ) {
            let up = Upsample::new(&points, patch);
            // The number of neighbours that have at least `patch` pairs.
            let k = (2..).find(|k| k * (k - 1) / 2 >= patch).unwrap();
            for (i, patch) in up.points.chunks(patch).enumerate() {
                let mut hull = others(&points, i);
                hull.truncate(k);
                hull.push(points[i]);
                let along = |d: &[f64; 3], p: &[f32; 3]| -> f64 {
                    d.iter().zip(p).map(|(d, &x)| d * f64::from(x)).sum()
                };
                for d in &directions {
                    let most = hull.iter().map(|p| along(d, p)).fold(f64::NEG_INFINITY, f64::max);
                    for s in patch {
                        prop_assert!(along(d, s) <= most + 1e-6, "{:?} outside", s);
                    }
                }
            }
        }
    }
}
