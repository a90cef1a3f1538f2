//! The differentiable half of deep marching tetrahedra: where the surface crosses the edges that change sign.

use crate::autodiff::{At, Op, Tape, Var};
use crate::geometry::{MARGIN, along, crossing_share};
use crate::tensor::Tensor;
use std::sync::Arc;

/// v = (x_a s_b - x_b s_a) / (s_b - s_a) for every edge (a, b), written as x_a + t (x_b - x_a), t = s_a / (s_a - s_b)
/// clamped to [MARGIN, 1 - MARGIN].
struct EdgeCrossing {
    edges: Arc<[[u32; 2]]>,
}

impl Op<2> for EdgeCrossing {
    /// t of every edge.
    type Saved = Vec<f32>;

    fn forward(&self, [x, s]: [&Tensor; 2]) -> (Tensor, Vec<f32>) {
        assert!(
            x.cols() == 3 && s.len() == x.rows(),
            "edge crossing: vertices {:?} with values {:?}",
            x.shape(),
            s.shape()
        );
        let (points, values) = (x.data().as_chunks::<3>().0, s.data());
        let mut y = x.uninit_like(&[self.edges.len(), 3]);
        let mut saved = Vec::with_capacity(self.edges.len());
        for (out, &[a, b]) in y.data_mut().as_chunks_mut::<3>().0.iter_mut().zip(self.edges.iter()) {
            let (a, b) = (a as usize, b as usize);
            let t = crossing_share(values[a], values[b]);
            *out = along(points[a], points[b], t);
            saved.push(t);
        }
        (y, saved)
    }

    fn vjp(&self, at: At<'_, 2, Vec<f32>>, dy: &Tensor) -> [Option<Tensor>; 2] {
        let [x, s] = at.x;
        let (points, values) = (x.data().as_chunks::<3>().0, s.data());
        let (mut dx, mut ds) = (dy.zeros_like_pool(x.dims()), dy.zeros_like_pool(s.dims()));
        let (out, slopes) = (dx.data_mut().as_chunks_mut::<3>().0, ds.data_mut());
        for ((&[a, b], dy), &t) in self.edges.iter().zip(dy.data().as_chunks::<3>().0).zip(at.saved) {
            let (a, b) = (a as usize, b as usize);
            let mut along = 0.0;
            for d in 0..3 {
                out[a][d] += (1.0 - t) * dy[d];
                out[b][d] += t * dy[d];
                along += dy[d] * (points[b][d] - points[a][d]);
            }
            if t > MARGIN && t < 1.0 - MARGIN {
                // dt/ds_a = -s_b / (s_a - s_b)^2 and dt/ds_b = s_a / (s_a - s_b)^2.
                let difference = values[a] - values[b];
                slopes[a] -= along * values[b] / (difference * difference);
                slopes[b] += along * values[a] / (difference * difference);
            }
        }
        [at.needs[0].then_some(dx), at.needs[1].then_some(ds)]
    }
}

impl Tape {
    /// The surface's crossing points of sign-changing edges: vertices v x 3 and values v x 1 to e x 3.
    ///
    /// Gradient: to positions and values; the choice of edges (topology) is constant. Where the crossing is clamped to
    /// stay off an edge's end, the values get none. Reference: Shen et al. 2021 (DMTet), equation 3.
    ///
    /// # Panics
    /// If the shapes do not fit or an edge index is v or more.
    #[track_caller]
    pub fn edge_crossing(&mut self, verts: Var, sdf: Var, edges: impl Into<Arc<[[u32; 2]]>>) -> Var {
        self.apply(EdgeCrossing { edges: edges.into() }, [verts, sdf])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::{check, normal, positive};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn gradients(inside in 1usize..6, outside in 1usize..6, seed: u64) {
            let v = inside + outside;
            let mut sdf = positive(&[v, 1], seed);
            sdf.data_mut()[..inside].iter_mut().for_each(|s| *s = -*s);
            let edges: Vec<[u32; 2]> =
                (0..inside * outside).map(|e| [(e % inside) as u32, (inside + e / inside) as u32]).collect();
            check(|t, x| t.edge_crossing(x[0], x[1], edges.clone()), &[normal(&[v, 3], seed ^ 1), sdf], seed);
        }
    }

    #[test]
    fn crossings_divide_the_edge_by_the_values_and_stay_off_its_ends() {
        let mut t = Tape::new();
        let x = t.constant(Tensor::from_points(&[[0.0; 3], [4.0, 0.0, 8.0], [1.0, 0.0, 0.0]]));
        let s = t.constant(Tensor::from_vec(&[3, 1], vec![-1.0, 3.0, 0.0]));
        let y = t.edge_crossing(x, s, vec![[0, 1], [0, 2]]);
        assert_eq!(t.value(y).row(0), [1.0, 0.0, 2.0]);
        assert_eq!(t.value(y).row(1)[0], 1.0 - MARGIN);
    }
}
