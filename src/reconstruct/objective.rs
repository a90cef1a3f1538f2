//! The loss of a step: the table of its terms, and their weighted sum (equation 7 of the paper and what is added to
//! it).
//!
//! A term is one entry of the table below: its name, which is that of its weight ([`Weights`], option `weights.NAME`)
//! and of its value ([`Terms`]), a sentence with the weight's default, and how it comes from the [`TermInputs`]. What
//! it computes has a file of its own in [`loss`](crate::loss).

use super::config::Target;
use crate::autodiff::{Tape, Var};
use crate::field::FieldVars;
use crate::geometry::TriangleBvh;
use crate::loss::{Direction, eikonal, inside, mean_abs, pull, surface_distance};

macro_rules! loss_terms {
    ($($(#[$doc:meta])* $name:ident, $default:literal: $term:expr;)*) => {
        /// Weights of the loss terms; a term of weight 0 is not computed. The paper has the first three, and `pull` in
        /// an ablation.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[non_exhaustive]
        pub struct Weights {
            $($(#[$doc])* #[doc = $default] pub $name: f32,)*
            /// Factor that the weight of L_deform reaches at the last step, by geometric decay; below 1 the points
            /// dominate late steps. Default 1, a constant weight, as in the paper.
            pub deform_decay: f32,
        }

        /// The values of the loss terms in a step, before their weights. In the training a term is 0 where its weight
        /// is 0 or the step does not have it; the pretraining has L_para alone, whatever its weight.
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        #[non_exhaustive]
        pub struct Terms {
            $($(#[$doc])* pub $name: f32,)*
        }

        /// The number of terms.
        const COUNT: usize = [$(stringify!($name)),*].len();

        impl Weights {
            /// No term at all; to be filled in.
            pub const NONE: Weights = Weights { $($name: 0.0,)* deform_decay: 1.0 };

            /// The weights of the terms by name, in the order of the table.
            pub fn each(&self) -> [(&'static str, f32); COUNT] {
                [$((stringify!($name), self.$name)),*]
            }
        }

        impl Terms {
            /// The values of the terms by name, in the order of the table.
            pub fn each(&self) -> [(&'static str, f32); COUNT] {
                [$((stringify!($name), self.$name)),*]
            }
        }

        /// Adds all terms that have a weight, in the order of the table.
        fn add_all(weights: &Weights, sum: &mut Sum<'_>, inputs: &TermInputs<'_>) -> Terms {
            Terms { $($name: sum.add(weights.$name, inputs, $term),)* }
        }

        /// Calls a macro with the names of all terms.
        macro_rules! with_loss_terms {
            ($callback:ident) => {
                $callback! { $($name)* }
            };
        }
        pub(super) use with_loss_terms;
    };
}

loss_terms! {
    /// L_para, the squared Chamfer distance between S and Q (equation 3) with the slack `bsp.slack`, in steps that
    /// train the parameterization; in the pretraining S is also compared with samples of the first shape.
    para, " Default 10, paper 10.": |_, inputs| inputs.para;
    /// L_deform, the squared Chamfer distance between the extracted surface and the target (equation 5): from its
    /// vertices to the target and back, or, with `surface_samples`, from samples on it to the target and from the
    /// target to its faces. The target is S or, with `target` surface-and-cloud, S and Q.
    deform, " Default 0.5, paper 1.": |tape, inputs| Some(match inputs.tree {
        None => tape.chamfer(inputs.drawn, inputs.target, Direction::BOTH),
        Some(tree) => {
            let there = tape.chamfer(inputs.drawn, inputs.target, Direction::FORWARD);
            let back = surface_distance(tape, inputs.crossings, inputs.faces, tree, inputs.target);
            tape.add(there, back)
        }
    });
    /// L_surf, the mean of |g| on the active grid vertices (equation 6).
    surf, " Default 0, paper 0.01.": |tape, inputs| Some(mean_abs(tape, inputs.field.sdf));
    /// The mean of (|grad g| - 1)^2 on the active vertices, the denoised points of the step (all, or `batch.points` of
    /// them) and bridges (Gropp et al. 2020).
    eikonal, " Default 0.001, paper 0.": |tape, inputs| Some(eikonal(tape, inputs.gradient));
    /// The mean squared uniform Laplacian of the extracted mesh.
    laplacian, " Default 0.01, paper 0.": |tape, inputs| Some(tape.laplacian(inputs.crossings, inputs.faces));
    /// The mean of |g| on the denoised points of the step.
    on_points, " Default 0.02, paper 0.": |tape, inputs| inputs.sdf_at_points.map(|sdf| mean_abs(tape, sdf));
    /// The mean squared distance from each moved grid vertex to the target point nearest to it before the move
    /// (Ma et al. 2021, Neural-Pull); alone, the paper's ablation f_TPS.
    pull, " Default 0, paper 0.": |tape, inputs| {
        let verts = tape.value(inputs.field.points).to_points();
        Some(pull(tape, &verts, inputs.moved, inputs.target))
    };
    /// The mean squared distance from each denoised point of the step to the extracted surface.
    cover, " Default 1, paper 0.": |tape, inputs| Some(match inputs.tree {
        None => tape.chamfer(inputs.drawn, inputs.seen, Direction::BACKWARD),
        Some(tree) => surface_distance(tape, inputs.crossings, inputs.faces, tree, inputs.seen),
    });
    /// The mean of max(0, g + depth) at points on bridges: straight lines over gaps, no wider than the neighbour
    /// spacing of the points at their ends (the mean distance to the seven nearest others), from the largest part of
    /// the surface, or from parts joined to it, to loose parts. Gaps are looked for on 128 cubes a side after 0.65 and
    /// 0.8 of the training.
    bridge, " Default 0.01, paper 0.": |tape, inputs| inputs.bridges.map(|(sdf, depth)| inside(tape, sdf, depth));
}

/// The inputs of the loss terms, on the tape of a step. The denoised points are the paper's Q; a step uses all of them
/// or, if there are many, a part, the seen points (q).
pub(super) struct TermInputs<'a> {
    /// Faces of the extracted surface, f x 3.
    pub faces: &'a [[u32; 3]],
    /// The active grid vertices before the move, v x 3, and the field there.
    pub field: FieldVars,
    /// grad g wherever the step evaluates it.
    pub gradient: Var,
    /// g at the seen points, q x 1; `None` if no term needs it.
    pub sdf_at_points: Option<Var>,
    /// g at the points of bridges and the depth below 0 that each is to have (m x 1 each), if there are any.
    pub bridges: Option<(Var, Var)>,
    /// Moved vertices, v x 3.
    pub moved: Var,
    /// Vertices of the extracted surface, one for each edge that it crosses, e x 3.
    pub crossings: Var,
    /// The points from which distances of the extracted surface to others are measured: its vertices or samples on its
    /// faces.
    pub drawn: Var,
    /// The tree over the faces of the extracted surface, if distances to it are measured to its faces (option
    /// `surface_samples`); `None` if they are measured to its vertices, as in the paper.
    pub tree: Option<&'a TriangleBvh>,
    /// The seen points, q x 3.
    pub seen: Var,
    /// The points that the surface is drawn to, m x 3, see [`target`].
    pub target: Var,
    /// L_para, in steps that train the parameterization.
    pub para: Option<Var>,
}

/// The points that the extracted surface is drawn to: S, or S and the seen points of Q, as `target` chooses; the seen
/// points (q x 3) alone if there is no S.
pub(super) fn target(
    tape: &mut Tape,
    weights: &Weights,
    target: Target,
    surface: Option<Var>,
    seen: Var,
) -> Var {
    match (surface, target) {
        (None, _) => seen,
        (Some(surface), Target::SurfaceAndCloud) if weights.deform > 0.0 || weights.pull > 0.0 => {
            tape.concat_rows([surface, seen])
        }
        (Some(surface), _) => surface,
    }
}

/// The weighted sum of all terms that have a weight, and their values; `None` if no term has one.
///
/// `progress` is the share of the training that is done, from 0 to 1.
pub(super) fn add_terms(
    tape: &mut Tape,
    weights: &Weights,
    progress: f32,
    inputs: &TermInputs<'_>,
) -> (Option<Var>, Terms) {
    let now = Weights { deform: weights.deform * weights.deform_decay.powf(progress), ..*weights };
    let mut sum = Sum { tape, loss: None };
    let terms = add_all(&now, &mut sum, inputs);
    (sum.loss, terms)
}

/// A sum on a tape.
struct Sum<'a> {
    tape: &'a mut Tape,
    loss: Option<Var>,
}

impl Sum<'_> {
    /// Adds `weight` times a term, if the weight is not 0 and the step has the term, and returns its value.
    fn add(
        &mut self,
        weight: f32,
        inputs: &TermInputs<'_>,
        term: impl FnOnce(&mut Tape, &TermInputs<'_>) -> Option<Var>,
    ) -> f32 {
        if weight == 0.0 {
            return 0.0;
        }
        let Some(term) = term(self.tape, inputs) else { return 0.0 };
        let value = self.tape.value(term).item();
        let scaled = self.tape.scale(term, weight);
        self.loss = Some(match self.loss {
            Some(loss) => self.tape.add(loss, scaled),
            None => scaled,
        });
        value
    }
}
