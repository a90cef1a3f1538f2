//! The loss of a step: which terms, on what, with which weights.

use super::{Config, Target};
use crate::autodiff::{Tape, Var};
use crate::field::FieldVars;
use crate::geometry::TriangleBvh;
use crate::loss::{Direction, eikonal, inside, mean_abs, pull, surface_distance};

/// What the terms are taken on.
pub(super) struct Scene<'a> {
    /// Active grid vertices before the move, v x 3.
    pub verts: &'a [[f32; 3]],
    /// Faces of the extracted surface.
    pub faces: &'a [[u32; 3]],
    /// The field at the active vertices.
    pub field: FieldVars,
    /// grad g wherever the step evaluates it.
    pub gradient: Var,
    /// g at the cloud, if a term asks for it.
    pub cloud_sdf: Option<Var>,
    /// g at the bridges, and how far inside they are to be, if there are any.
    pub bridges: Option<(Var, Var)>,
    /// Moved vertices, v x 3.
    pub moved: Var,
    /// Vertices of the extracted surface.
    pub crossings: Var,
    /// What stands for the extracted surface where distances start from it: its vertices or samples on its faces.
    pub drawn: Var,
    /// Its faces, where distances to it are not to its vertices.
    pub tree: Option<&'a TriangleBvh>,
    /// The seen part of the cloud Q.
    pub cloud: Var,
    /// The seen part of S, if there is one.
    pub surface: Option<Var>,
    /// L_para, in steps that train the parameterization.
    pub para: Option<Var>,
}

/// The values of the terms, before their weights.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Terms {
    pub para: f32,
    pub deform: f32,
    pub surf: f32,
    pub eikonal: f32,
    pub laplacian: f32,
    pub on_points: f32,
    pub pull: f32,
    pub cover: f32,
    pub bridge: f32,
}

/// The weighted sum of all terms that have a weight (equation 7 of the paper and what is added to it).
///
/// `progress` is the share of the training that is done, from 0 to 1.
pub(super) fn add_terms(tape: &mut Tape, config: &Config, progress: f32, scene: &Scene<'_>) -> (Var, Terms) {
    let w = &config.weights;
    let deform = w.deform * w.deform_decay.powf(progress);
    let target = match (scene.surface, config.target) {
        (None, _) => scene.cloud,
        (Some(surface), Target::Surface) => surface,
        (Some(surface), Target::SurfaceAndCloud) if w.deform > 0.0 || w.pull > 0.0 => {
            tape.concat_rows([surface, scene.cloud])
        }
        (Some(surface), Target::SurfaceAndCloud) => surface,
    };
    let mut sum = Sum { tape, loss: None };
    let terms = Terms {
        para: sum.add(w.para, |_| scene.para),
        deform: sum.add(deform, |t| {
            Some(match scene.tree {
                None => t.chamfer(scene.drawn, target, Direction::BOTH),
                Some(tree) => {
                    let there = t.chamfer(scene.drawn, target, Direction::FORWARD);
                    let back = surface_distance(t, scene.crossings, scene.faces, tree, target);
                    t.add(there, back)
                }
            })
        }),
        surf: sum.add(w.surf, |t| Some(mean_abs(t, scene.field.sdf))),
        eikonal: sum.add(w.eikonal, |t| Some(eikonal(t, scene.gradient))),
        laplacian: sum.add(w.laplacian, |t| Some(t.laplacian(scene.crossings, scene.faces))),
        on_points: sum.add(w.on_points, |t| scene.cloud_sdf.map(|sdf| mean_abs(t, sdf))),
        pull: sum.add(w.pull, |t| Some(pull(t, scene.verts, scene.moved, target))),
        cover: sum.add(w.cover, |t| {
            Some(match scene.tree {
                None => t.chamfer(scene.drawn, scene.cloud, Direction::BACKWARD),
                Some(tree) => surface_distance(t, scene.crossings, scene.faces, tree, scene.cloud),
            })
        }),
        bridge: sum.add(w.bridge, |t| scene.bridges.map(|(sdf, depth)| inside(t, sdf, depth))),
    };
    (sum.loss.expect("validated: some term has a weight"), terms)
}

struct Sum<'a> {
    tape: &'a mut Tape,
    loss: Option<Var>,
}

impl Sum<'_> {
    /// Adds `weight` times a term that is there, and returns its value.
    fn add(&mut self, weight: f32, term: impl FnOnce(&mut Tape) -> Option<Var>) -> f32 {
        if weight == 0.0 {
            return 0.0;
        }
        let Some(term) = term(self.tape) else { return 0.0 };
        let value = self.tape.value(term).item();
        let scaled = self.tape.scale(term, weight);
        self.loss = Some(match self.loss {
            Some(loss) => self.tape.add(loss, scaled),
            None => scaled,
        });
        value
    }
}
