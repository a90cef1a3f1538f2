//! Samples on the faces of the extracted surface, with gradients to its vertices.

use crate::autodiff::{Tape, Var};
use crate::geometry::cumulative_areas;
use crate::random::Random;
use rand::RngExt;

/// Points on the faces of a mesh, as faces and barycentric coordinates: they stay on the mesh when its vertices move.
#[derive(Clone, Debug)]
pub(crate) struct FaceSamples {
    /// For each corner of a face: the vertex and its weight, sample by sample.
    corners: [(Vec<u32>, Vec<f32>); 3],
}

impl FaceSamples {
    /// Chooses `count` points on the faces (f x 3) of a mesh with vertices v x 3.
    ///
    /// The faces are chosen in proportion to their area, at places spread along the cumulative area, so that the
    /// samples are more even than independent ones; the place in a face is uniform. Without area all lie on the first
    /// face.
    ///
    /// # Panics
    /// If there is no face, or a face names a vertex that is not there.
    #[track_caller]
    pub(crate) fn draw(verts: &[[f32; 3]], faces: &[[u32; 3]], count: usize, rng: &mut Random) -> Self {
        assert!(!faces.is_empty(), "samples: no faces");
        let ends = cumulative_areas(verts, faces);
        let total = ends[ends.len() - 1];
        let mut corners: [(Vec<u32>, Vec<f32>); 3] =
            std::array::from_fn(|_| (Vec::with_capacity(count), Vec::with_capacity(count)));
        for i in 0..count {
            let at = (i as f64 + rng.source().random::<f64>()) / count as f64 * total;
            let face = ends.partition_point(|&end| end < at).min(faces.len() - 1);
            // The square root makes the place uniform: a strip near the first corner is narrow.
            let (r, u) = (rng.source().random::<f32>().sqrt(), rng.source().random::<f32>());
            let weights = [1.0 - r, r * (1.0 - u), r * u];
            for ((index, weight), (v, w)) in corners.iter_mut().zip(faces[face].into_iter().zip(weights)) {
                index.push(v);
                weight.push(w);
            }
        }
        FaceSamples { corners }
    }

    /// Their places, count x 3, for vertices v x 3 on a tape.
    ///
    /// Gradient: to the vertices, by the barycentric coordinates; faces and coordinates are constant.
    pub(crate) fn on(self, tape: &mut Tape, verts: Var) -> Var {
        tape.blend_rows(verts, self.corners)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples drawn on the vertices as they are, on the tape.
    fn sample_faces(tape: &mut Tape, verts: Var, faces: &[[u32; 3]], count: usize, rng: &mut Random) -> Var {
        let at = tape.value(verts).to_points();
        FaceSamples::draw(&at, faces, count, rng).on(tape, verts)
    }

    use crate::ops::testing::{check, normal};
    use crate::tensor::Tensor;
    use proptest::prelude::*;

    fn rng(seed: u64) -> Random {
        Random::new(seed)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn gradients(count in 1usize..12, seed: u64) {
            let verts = normal(&[5, 3], seed);
            let faces = [[0, 1, 2], [0, 2, 3], [4, 3, 1]];
            // Areas choose the faces, so they are taken once, from the vertices as they are.
            let ends = cumulative_areas(&verts.to_points(), &faces);
            prop_assume!(ends[0] > 1e-3);
            let one = [faces[0]];
            check(|t, x| sample_faces(t, x[0], &one, count, &mut rng(seed)), &[verts], seed);
        }

        #[test]
        fn samples_lie_on_their_faces(count in 0usize..40, seed: u64) {
            // Two triangles of areas 1 : 3 in different planes.
            let verts = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [5.0, 0.0, 0.0], [5.0, 3.0, 0.0], [5.0, 0.0, 1.0]];
            let faces = [[0, 1, 2], [3, 4, 5]];
            let mut tape = Tape::new();
            let x = tape.constant(Tensor::from_points(&verts));
            let samples = sample_faces(&mut tape, x, &faces, count, &mut rng(seed));
            let samples = tape.value(samples).to_points();
            prop_assert_eq!(samples.len(), count);
            for p in &samples {
                let on_first = p[2] == 0.0 && p[0] >= 0.0 && p[1] >= 0.0 && p[0] + p[1] <= 1.00001;
                let on_second = (p[0] - 5.0).abs() < 1e-5 && p[1] / 3.0 + p[2] <= 1.00001;
                prop_assert!(on_first || on_second, "{:?}", p);
            }
            let first = samples.iter().filter(|p| p[0] < 4.0).count();
            // Spread along the area: a quarter of the samples, to one.
            prop_assert!((4 * first).abs_diff(count) <= 4, "{} of {}", first, count);
        }
    }

    #[test]
    fn faces_without_area_still_give_points() {
        let mut tape = Tape::new();
        let x = tape.constant(Tensor::from_points(&[[1.0, 2.0, 3.0]; 3]));
        let samples = sample_faces(&mut tape, x, &[[0, 1, 2]], 4, &mut rng(1));
        assert!(tape.value(samples).to_points().iter().all(|p| (p[2] - 3.0).abs() < 1e-6));
    }
}
