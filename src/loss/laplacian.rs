//! The uniform Laplacian of an extracted mesh.

use crate::autodiff::{At, Op, Tape, Var};
use crate::tensor::Tensor;
use std::sync::Arc;

/// 1 / v sum_i |mean of the neighbours of i - x_i|^2 over the vertices of a triangle mesh.
///
/// Every directed edge of every face counts once, so in a closed mesh each neighbour counts twice: the mean is the
/// same. Vertices without faces count 0.
struct Laplacian {
    faces: Arc<[[u32; 3]]>,
}

/// Calls `f(i, j)` for every directed edge, in both directions, in face order.
fn each_edge(faces: &[[u32; 3]], mut f: impl FnMut(usize, usize)) {
    for &[a, b, c] in faces {
        for (i, j) in [(a, b), (b, c), (c, a)] {
            f(i as usize, j as usize);
            f(j as usize, i as usize);
        }
    }
}

impl Op<1> for Laplacian {
    /// The Laplacian vectors (v x 3) and one over the number of edges at each vertex.
    type Saved = (Vec<[f32; 3]>, Vec<f32>);

    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, Self::Saved) {
        assert!(x.cols() == 3, "laplacian: shape {:?}, v x 3 expected", x.shape());
        let points = x.data().as_chunks::<3>().0;
        let mut delta = vec![[0.0f32; 3]; points.len()];
        let mut degree = vec![0.0f32; points.len()];
        each_edge(&self.faces, |i, j| {
            degree[i] += 1.0;
            for d in 0..3 {
                delta[i][d] += points[j][d] - points[i][d];
            }
        });
        let mut sum = 0.0f64;
        for (delta, degree) in delta.iter_mut().zip(&mut degree) {
            *degree = if *degree > 0.0 { 1.0 / *degree } else { 0.0 };
            for d in delta {
                *d *= *degree;
                sum += f64::from(*d) * f64::from(*d);
            }
        }
        let mut y = x.uninit_like(&[1, 1]);
        y.data_mut()[0] = (sum / points.len().max(1) as f64) as f32;
        (y, (delta, degree))
    }

    fn vjp(&self, at: At<'_, 1, Self::Saved>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let (delta, inverse) = at.saved;
        let mut dx = dy.zeros_like_pool(at.x[0].dims());
        let scale = 2.0 * dy.item() / delta.len().max(1) as f32;
        let out = dx.data_mut().as_chunks_mut::<3>().0;
        // What a vertex pulls at each of its neighbours: once for each vertex, not for each of its edges.
        let pulls: Vec<[f32; 3]> =
            delta.iter().zip(inverse).map(|(delta, inverse)| delta.map(|d| scale * d * inverse)).collect();
        each_edge(&self.faces, |i, j| {
            for d in 0..3 {
                let g = pulls[i][d];
                out[j][d] += g;
                out[i][d] -= g;
            }
        });
        [Some(dx)]
    }
}

impl Tape {
    /// The mean squared uniform Laplacian of a mesh: 1 / v sum_i |mean of i's neighbours - x_i|^2; v x 3 to 1 x 1, in
    /// squared units of the vertices. Off in the `paper` preset; the released code has such a term.
    ///
    /// Gradient: smooth. Panics if `x` does not have 3 columns or a face index is v or more.
    #[track_caller]
    pub fn laplacian(&mut self, x: Var, faces: impl Into<Arc<[[u32; 3]]>>) -> Var {
        self.apply(Laplacian { faces: faces.into() }, [x])
    }
}

#[cfg(test)]
mod tests {
    use crate::autodiff::Tape;
    use crate::ops::testing::{check, normal};
    use crate::tensor::Tensor;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn gradients(v in 3usize..12, faces in prop::collection::vec([0u32..12, 0u32..12, 0u32..12], 0..10), seed: u64) {
            let faces: Vec<[u32; 3]> = faces.into_iter().map(|f| f.map(|i| i % v as u32)).collect();
            check(|t, x| t.laplacian(x[0], faces.clone()), &[normal(&[v, 3], seed)], seed);
        }
    }

    #[test]
    fn a_tetrahedron_by_hand() {
        // The neighbours of each corner average to minus a third of it.
        let corners = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
        let mut t = Tape::new();
        let x = t.constant(Tensor::from_points(&corners));
        let y = t.laplacian(x, vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]);
        assert!((t.value(y).item() - 3.0 * 16.0 / 9.0).abs() < 1e-5);
    }
}
