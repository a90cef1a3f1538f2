//! Patches: the nearest codes of a near-uniform sphere around every point's code.

use crate::autodiff::{Tape, Var};
use crate::geometry::{KdTree, fibonacci_sphere};
use crate::tensor::Tensor;
use std::sync::Arc;

/// p = normalize(u + (c - stop(u))) for the M codes c of the sphere nearest to the code u of each point.
///
/// stop(u) is u taken as a constant. The value is c itself; the form lets gradients reach u, and with it the head of
/// Phi. The authors' code detaches u, so its head never learns.
#[derive(Clone, Debug)]
pub struct PatchSampler {
    sphere: Arc<[[f32; 3]]>,
    tree: Arc<KdTree>,
    patch: usize,
}

impl PatchSampler {
    /// Patches of `patch` codes on a Fibonacci sphere of `codes`.
    ///
    /// # Panics
    /// If `patch` is 0 or more than `codes`.
    #[track_caller]
    pub fn new(codes: usize, patch: usize) -> Self {
        assert!(patch > 0 && patch <= codes, "patches of {patch} on a sphere of {codes} codes");
        let sphere = fibonacci_sphere(codes);
        let tree = Arc::new(KdTree::new(&sphere));
        PatchSampler { sphere: sphere.into(), tree, patch }
    }

    /// Codes u (n x 3, unit length) to patches ((n M) x 3, unit length), patch by patch, nearest first.
    ///
    /// Gradient: to u, through the centre of the patch; which codes are nearest is constant. A code that is not finite
    /// gives a patch that is not.
    pub fn forward(&self, tape: &mut Tape, u: Var) -> Var {
        let steps = self.steps(&tape.value(u).to_points());
        self.place(tape, u, &steps)
    }

    /// All codes of the sphere (m x 3).
    pub(super) fn sphere(&self) -> &[[f32; 3]] {
        &self.sphere
    }

    /// The codes of the patch of every centre (n x 3) as they are on the sphere ((n M) x 3), and which they are (n M).
    pub(super) fn patches(&self, centres: &[[f32; 3]]) -> (Vec<[f32; 3]>, Vec<u32>) {
        let index = self.nearest(centres);
        (index.iter().map(|&c| self.sphere[c as usize]).collect(), index)
    }

    /// c - stop(u) for the patch of every centre u: what leads from the centre to its codes, (n M) x 3.
    pub(super) fn steps(&self, centres: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let step = |(i, &c): (usize, &u32)| {
            let (c, u) = (self.sphere[c as usize], centres[i / self.patch]);
            [c[0] - u[0], c[1] - u[1], c[2] - u[2]]
        };
        self.nearest(centres).iter().enumerate().map(step).collect()
    }

    /// The M nearest codes of the sphere of every centre, nearest first (n M).
    fn nearest(&self, centres: &[[f32; 3]]) -> Vec<u32> {
        // The search refuses what is not finite; the steps carry it on, to where the loss is checked.
        let finite = |u: &[f32; 3]| if u.iter().all(|x| x.is_finite()) { *u } else { [0.0, 0.0, 1.0] };
        let places: Vec<[f32; 3]> = centres.iter().map(finite).collect();
        self.tree.k_nearest(&places, self.patch)
    }

    /// The centres u (n x 3) moved along constant steps ((n M) x 3) and back onto the sphere.
    pub(super) fn place(&self, tape: &mut Tape, u: Var, steps: &[[f32; 3]]) -> Var {
        let steps = tape.constant(Tensor::from_points(steps));
        let centre = tape.repeat_rows(u, self.patch);
        let moved = tape.add(centre, steps);
        tape.normalize_rows(moved)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::normal;

    #[test]
    fn patches_are_the_nearest_codes_and_pass_gradients_to_the_centre() {
        let sampler = PatchSampler::new(200, 5);
        let mut tape = Tape::new();
        let raw = tape.input(normal(&[6, 3], 4));
        let u = tape.normalize_rows(raw);
        let patches = sampler.forward(&mut tape, u);
        let (centres, points) = (tape.value(u).to_points(), tape.value(patches).to_points());
        let d = |a: [f32; 3], b: [f32; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>();
        for (i, &centre) in centres.iter().enumerate() {
            let mut all: Vec<f32> = sampler.sphere.iter().map(|&c| d(c, centre)).collect();
            all.sort_by(f32::total_cmp);
            for (found, nearest) in points[5 * i..5 * i + 5].iter().zip(all) {
                assert!((d(*found, centre) - nearest).abs() < 1e-5);
                assert!((d(*found, [0.0; 3]) - 1.0).abs() < 1e-5);
            }
        }
        let loss = tape.square(patches);
        let first = tape.slice_cols(loss, 0..1);
        let loss = tape.sum(first);
        assert!(tape.backward(loss).get(raw).unwrap().data().iter().any(|g| g.abs() > 1e-3));
    }

    #[test]
    fn a_code_that_is_not_finite_gives_a_patch_that_is_not() {
        let sampler = PatchSampler::new(20, 3);
        let mut tape = Tape::new();
        let u = tape.constant(Tensor::from_points(&[[f32::NAN; 3], [1.0, 0.0, 0.0]]));
        let patches = sampler.forward(&mut tape, u);
        let rows = tape.value(patches).to_points();
        assert!(rows[..3].iter().all(|p| p[0].is_nan()) && rows[3..].iter().flatten().all(|x| x.is_finite()));
    }
}
