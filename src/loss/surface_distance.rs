//! The distance from points to the faces of a mesh.

use crate::autodiff::{Tape, Var};
use crate::geometry::TriangleBvh;

/// The mean over the m points of the squared distance to the nearest point on the faces of a mesh.
///
/// Shapes: `verts` v x 3, `faces` f x 3, `points` m x 3 to 1 x 1, in squared units of the points; `tree` is over these
/// faces with these vertices. Gradient: to the vertices by the barycentric coordinates of the nearest points, which are
/// constant, and to the points: that of the distance itself, except where the nearest point jumps. Not in the paper,
/// which takes the distance to the nearest vertex.
///
/// # Panics
/// If the shapes do not fit, the tree is of another mesh, or a point is not finite.
#[track_caller]
pub fn surface_distance(
    tape: &mut Tape,
    verts: Var,
    faces: &[[u32; 3]],
    tree: &TriangleBvh,
    points: Var,
) -> Var {
    let hits = tree.nearest_all(&tape.value(points).to_points());
    let m = hits.len();
    let mut corners: [(Vec<u32>, Vec<f32>); 3] =
        std::array::from_fn(|_| (Vec::with_capacity(m), Vec::with_capacity(m)));
    for hit in &hits {
        let face = faces[hit.face as usize];
        for ((index, weight), (v, w)) in corners.iter_mut().zip(face.into_iter().zip(hit.weights)) {
            index.push(v);
            weight.push(w);
        }
    }
    let nearest = tape.blend_rows(verts, corners);
    let off = tape.sub(points, nearest);
    let off = tape.square(off);
    let off = tape.sum_cols(off);
    tape.mean(off)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::TriangleMesh;
    use crate::ops::testing::{check, normal};
    use crate::tensor::Tensor;
    use proptest::prelude::*;

    fn tree(verts: &Tensor, faces: &[[u32; 3]]) -> TriangleBvh {
        TriangleBvh::new(&TriangleMesh { verts: verts.to_points(), faces: faces.to_vec() }).unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn gradients(m in 1usize..8, seed: u64) {
            let faces = [[0u32, 1, 2], [2, 1, 3], [3, 4, 5]];
            let inputs = [normal(&[6, 3], seed), normal(&[m, 3], seed ^ 1)];
            // The tree follows the vertices, as in a step of training.
            check(|t, x| {
                let tree = tree(t.value(x[0]), &faces);
                surface_distance(t, x[0], &faces, &tree, x[1])
            }, &inputs, seed);
        }
    }

    #[test]
    fn the_distance_is_to_the_face_and_not_to_its_corners() {
        let mut t = Tape::new();
        let corners = Tensor::from_points(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let tree = tree(&corners, &[[0, 1, 2]]);
        let verts = t.input(corners);
        let points = t.input(Tensor::from_points(&[[0.25, 0.25, 0.5], [0.0, -3.0, 0.0]]));
        let y = surface_distance(&mut t, verts, &[[0, 1, 2]], &tree, points);
        assert_eq!(t.value(y).item(), (0.25 + 9.0) / 2.0);
        let gradients = t.backward(y);
        assert_eq!(gradients.get(points).unwrap().data(), [0.0, 0.0, 0.5, 0.0, -3.0, 0.0]);
        // Half, a quarter and a quarter of the first pull; all of the second at the first corner.
        let pulled = gradients.get(verts).unwrap().data();
        assert_eq!(pulled, [0.0, 3.0, -0.25, 0.0, 0.0, -0.125, 0.0, 0.0, -0.125]);
    }
}
