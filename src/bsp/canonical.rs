//! Phi: from points to features and to codes on the unit sphere.

use crate::autodiff::{Tape, Var};
use crate::nn::{Activation, Bound, LayerNorm, Mlp, PointTransformer, Scope};
use crate::random::Random;
use crate::tensor::Tensor;
use std::sync::Arc;

/// f = relu(norm(point transformer(Q))) over the k nearest neighbours (equation 1 of the paper), and the code
/// u = head(f) / |head(f)|, or with a layout that codes begin in, the direction of the layout plus a small multiple of
/// head(f).
///
/// Shapes: Q n x 3 to features n x c and codes n x 3. Parameters: `attention` (the point transformer), `norm`, `head`
/// (c to c / 2 to 3). Gradient: smooth but for ReLUs. The equation is the layer alone; norm and head are ours, as the
/// paper only says that features are projected to the sphere.
#[derive(Clone, Debug)]
pub struct Canonical {
    attention: PointTransformer,
    norm: LayerNorm,
    head: Mlp,
}

impl Canonical {
    /// A map with c channels.
    pub fn new(scope: &mut Scope<'_>, c: usize, rng: &mut Random) -> Self {
        Canonical {
            attention: PointTransformer::new(&mut scope.scope("attention"), 3, c, rng),
            norm: LayerNorm::new(&mut scope.scope("norm"), c),
            head: Mlp::new(&mut scope.scope("head"), &[c, (c / 2).max(1), 3], Activation::Relu, rng),
        }
    }

    /// Features (n x c) and codes (n x 3) of the points (n x 3); point i has the neighbours
    /// `neighbours[i k .. (i + 1) k]`. With a layout (n x 3, unit length) and a step, the code is
    /// normalize(layout + step head(f)).
    ///
    /// # Panics
    /// If the neighbours or the layout are not those of n points.
    #[track_caller]
    pub fn forward(
        &self,
        tape: &mut Tape,
        p: &Bound,
        points: Var,
        neighbours: Arc<[u32]>,
        layout: Option<(&Arc<Tensor>, f32)>,
    ) -> (Var, Var) {
        let features = self.attention.forward(tape, p, points, points, neighbours);
        let features = self.norm.forward(tape, p, features);
        let features = tape.relu(features);
        let head = self.head.forward(tape, p, features);
        let head = match layout {
            None => head,
            Some((layout, step)) => {
                let layout = tape.shared(layout.clone(), false);
                let moved = tape.scale(head, step);
                tape.add(layout, moved)
            }
        };
        (features, tape.normalize_rows(head))
    }
}
