//! One iteration of training, from the band to the updated parameters.

use crate::autodiff::{Tape, Var};
use crate::bsp::{Neighbourhood, SurfaceMap};
use crate::error::{Error, ErrorKind};
use crate::field::{FieldValues, FieldVars};
use crate::gdo::{FaceSamples, deform};
use crate::geometry::TriangleBvh;
use crate::loss::Direction;
use crate::nn::Bound;
use crate::optim::{clip_norm, gradient_norm};
use crate::reconstruct::band::Workspace;
use crate::reconstruct::objective::{Scene, Terms, add_terms};
use crate::reconstruct::{Config, Phase, Trainer};
use crate::tensor::Tensor;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::sync::Arc;

/// What happened in a step. Losses are in the working frame, before their weights; 0 where the weight is 0, and where
/// the phase does not have them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct StepReport {
    /// The step, from 0, counted through all phases.
    pub step: usize,
    /// Steps of all phases.
    pub total: usize,
    /// What the step was for.
    pub phase: Phase,
    /// Cubes along each side of the grid; 0 before the training proper.
    pub resolution: usize,
    /// What the step made smaller: the weighted sum of all terms in the training proper, L_para in the pretraining,
    /// and the mean difference between the field and the distance to its first shape (with a small multiple of that
    /// of their gradients) in the start.
    pub loss: f32,
    /// L_para; 0 in steps that do not train the parameterization.
    pub para: f32,
    /// L_deform.
    pub deform: f32,
    /// L_surf.
    pub surf: f32,
    /// The eikonal term.
    pub eikonal: f32,
    /// The Laplacian of the mesh.
    pub laplacian: f32,
    /// The mean of |g| on the cloud.
    pub on_points: f32,
    /// The pull of moved vertices to the target.
    pub pull: f32,
    /// The squared distance from the cloud to the surface.
    pub cover: f32,
    /// What bridges over gaps lack of being inside.
    pub bridge: f32,
    /// Learning rate of the field; 0 in steps of the pretraining.
    pub field_rate: f32,
    /// Learning rate of the parameterization, in steps that train it; 0 in steps of the start.
    pub bsp_rate: f32,
    /// Length of the gradient, before it was clipped: that of the parameterization in the pretraining, otherwise that
    /// of the field.
    pub gradient_norm: f64,
    /// Grid vertices that the step worked on.
    pub active_verts: usize,
    /// Vertices of the extracted surface.
    pub surface_verts: usize,
    /// Recoveries so far.
    pub recoveries: usize,
}

impl StepReport {
    /// The terms of the loss by name, before their weights; 0 where the weight is 0.
    pub fn terms(&self) -> [(&'static str, f32); 9] {
        [
            ("para", self.para),
            ("deform", self.deform),
            ("cover", self.cover),
            ("on_points", self.on_points),
            ("laplacian", self.laplacian),
            ("eikonal", self.eikonal),
            ("surf", self.surf),
            ("pull", self.pull),
            ("bridge", self.bridge),
        ]
    }
}

/// What of the cloud a step sees.
pub(in crate::reconstruct) struct View {
    /// Indices in the cloud (q).
    pub rows: Vec<u32>,
    /// Their points, working frame.
    pub points: Vec<[f32; 3]>,
    /// The block whose patches are trained.
    pub block: Option<usize>,
}

/// The field as a step sees it.
pub(in crate::reconstruct) struct Sampled {
    /// At the active vertices, then at the seen points of the cloud if a term asks for them, then at the bridges.
    pub values: FieldValues,
    /// Rows before those of the bridges.
    without_bridges: usize,
    /// Rows that were raised on the border.
    raised: Vec<u32>,
}

/// A step on the tape.
pub(in crate::reconstruct) struct Recorded {
    pub loss: Var,
    field: FieldVars,
    map: Option<Bound>,
    surface: Option<Var>,
    pub terms: Terms,
}

/// Gradients of the field and of the map, parameter by parameter.
pub(in crate::reconstruct) struct Pulled {
    pub field: Vec<Option<Tensor>>,
    pub map: Option<Vec<Option<Tensor>>>,
}

/// Coordinates beyond this mean that training has left the neighbourhood of the cloud for good.
pub(in crate::reconstruct) const FAR: f32 = 1e6;

impl Trainer {
    /// One iteration of the training proper. On an error the parameters are as before it; what it worked with is not.
    pub(in crate::reconstruct) fn try_step(&mut self) -> Result<StepReport, Error> {
        self.look_for_gaps()?;
        let refreshed = self.refresh_band()?;
        let view = self.view();
        let sampled = self.sample_field(&view)?;
        self.march(&sampled)?;
        let recorded = self.record(&sampled, &view)?;
        let mut pulled = self.pull_back(&recorded, &sampled);
        let mut report = self.report(&recorded);
        report.gradient_norm = match self.config.clip {
            0.0 => gradient_norm(&pulled.field),
            most => clip_norm(&mut pulled.field, most),
        };
        if !report.loss.is_finite() {
            return Err(diverged("the loss is not finite"));
        }
        check_gradients("the field", &pulled.field)?;
        if let Some(gradients) = &pulled.map {
            check_gradients("the parameterization", gradients)?;
        }
        if refreshed {
            // This state is known to have a surface, a finite loss and finite gradients.
            self.good = self.snapshot();
        }
        self.keep_surface(&recorded, &view);
        self.update(&pulled, &report);
        self.step += 1;
        Ok(report)
    }

    /// Chooses the points of the cloud and the patches that this step sees.
    pub(in crate::reconstruct) fn view(&self) -> View {
        let n = self.cloud.len();
        let step = self.train_step();
        let size = self.config.batch.points;
        let rows: Vec<u32> = if n <= size {
            (0..n as u32).collect()
        } else {
            (0..size).map(|i| self.order[(step * size + i) % n]).collect()
        };
        let every = self.config.bsp_every;
        let learns = self.map.as_ref().is_some_and(|map| !map.params().is_empty());
        let trains = learns && every > 0 && step.is_multiple_of(every);
        let block = trains.then(|| step / every % self.blocks.len());
        View { points: rows.iter().map(|&i| self.cloud[i as usize]).collect(), rows, block }
    }

    /// Evaluates the field where this step looks at it.
    pub(in crate::reconstruct) fn sample_field(&mut self, view: &View) -> Result<Sampled, Error> {
        let Workspace { tape, pass, band, .. } = &mut self.work;
        let band = band.as_ref().expect("refreshed first");
        tape.clear();
        let mut verts = band.verts.clone();
        if self.config.weights.on_points > 0.0 || self.config.weights.eikonal > 0.0 {
            verts.extend_from_slice(&view.points);
        }
        let without_bridges = verts.len();
        verts.extend_from_slice(&self.bridges.points);
        let mut values = pass.forward(&self.field, &verts, tape.pool());
        let finite = values.sdf.is_finite() && values.gradient.is_finite();
        if !finite || values.offset.as_ref().is_some_and(|o| !o.is_finite()) {
            return Err(diverged("the field is not finite"));
        }
        let sdf = values.sdf.data_mut();
        let raised: Vec<u32> =
            band.border.iter().copied().filter(|&i| sdf[i as usize] < band.outside).collect();
        for &i in &raised {
            sdf[i as usize] = band.outside;
        }
        Ok(Sampled { values, without_bridges, raised })
    }

    /// Puts the step on the tape: moved vertices, surface, target, and the loss.
    pub(in crate::reconstruct) fn record(
        &mut self,
        sampled: &Sampled,
        view: &View,
    ) -> Result<Recorded, Error> {
        let step = self.train_step();
        let progress = step as f32 / self.config.steps_in(Phase::Train).max(1) as f32;
        let Workspace {
            tape,
            band,
            iso,
            tree,
            #[cfg(test)]
            held_samples,
            ..
        } = &mut self.work;
        let band = band.as_ref().expect("refreshed first");
        let v = band.verts.len();
        tape.clear();
        let all = FieldVars {
            sdf: tape.input(sampled.values.sdf.clone()),
            gradient: tape.input(sampled.values.gradient.clone()),
            offset: sampled.values.offset.clone().map(|o| tape.input(o)),
        };
        let (seen, rows) = (sampled.without_bridges, tape.value(all.sdf).rows());
        let at_verts = FieldVars {
            sdf: tape.slice_rows(all.sdf, 0..v),
            gradient: tape.slice_rows(all.gradient, 0..v),
            offset: all.offset.map(|o| tape.slice_rows(o, 0..v)),
        };
        let verts = tape.constant(Tensor::from_points(&band.verts));
        let moved = deform(tape, self.config.deformation, verts, &at_verts);
        let crossings = tape.edge_crossing(moved, at_verts.sdf, &iso.edges[..]);
        check_near("the extracted surface", tape.value(crossings).data())?;
        let (drawn, tree) = match self.config.surface_samples {
            0 => (crossings, None),
            count => {
                let mut rng = ChaCha8Rng::seed_from_u64(self.config.seed);
                rng.set_stream(step as u64 + 1);
                let at = tape.value(crossings).data().as_chunks().0;
                let samples = FaceSamples::draw(at, &iso.faces, count, &mut rng);
                #[cfg(test)]
                let samples = match &*held_samples {
                    Some(held) => held.get_or_init(|| samples).clone(),
                    None => samples,
                };
                let drawn = samples.on(tape, crossings);
                let tree = tree.get_or_insert_with(TriangleBvh::over_nothing);
                tree.rebuild(tape.value(crossings).data().as_chunks().0, &iso.faces)?;
                (drawn, Some(&*tree))
            }
        };
        let cloud = tape.constant(Tensor::from_points(&view.points));

        let mut bound = None;
        let mut live = None;
        let mut para = None;
        if let (Some(map), Some(block)) = (&self.map, view.block) {
            let block = &self.blocks[block];
            let p = map.params().bind(tape, true);
            let (surface, context) = forward_map(tape, map, &p, &self.cloud, block)?;
            if self.config.weights.para > 0.0 {
                let slack = map.slack(block, self.cloud.len());
                para = Some(para_term(tape, surface, context, block, slack));
            }
            (bound, live) = (Some(p), Some(surface));
        }
        let target = self
            .map
            .as_ref()
            .map(|map| surface_target(tape, map, live, &self.surface, self.blocks.len(), view));

        let scene = Scene {
            verts: &band.verts,
            faces: &iso.faces,
            field: at_verts,
            cloud_sdf: (seen > v && self.config.weights.on_points > 0.0)
                .then(|| tape.slice_rows(all.sdf, v..seen)),
            bridges: (rows > seen).then(|| {
                let depths = Tensor::from_vec(&[rows - seen, 1], self.bridges.depths.clone());
                (tape.slice_rows(all.sdf, seen..rows), tape.constant(depths))
            }),
            gradient: all.gradient,
            moved,
            crossings,
            drawn,
            tree,
            cloud,
            surface: target,
            para,
        };
        let (loss, terms) = add_terms(tape, &self.config, progress, &scene);
        Ok(Recorded { loss, field: all, map: bound, surface: live, terms })
    }

    /// The gradients of all parameters: through the tape to the field's values, and chunk by chunk through the field.
    pub(in crate::reconstruct) fn pull_back(&mut self, recorded: &Recorded, sampled: &Sampled) -> Pulled {
        let Workspace { tape, pass, .. } = &mut self.work;
        let mut gradients = tape.backward(recorded.loss);
        let mut take =
            |var: Var, like: &Tensor| gradients.take(var).unwrap_or_else(|| Tensor::zeros(like.dims()));
        let values = &sampled.values;
        let mut d = FieldValues {
            sdf: take(recorded.field.sdf, &values.sdf),
            gradient: take(recorded.field.gradient, &values.gradient),
            offset: recorded.field.offset.zip(values.offset.as_ref()).map(|(var, like)| take(var, like)),
        };
        // A raised value does not depend on the field.
        for &i in &sampled.raised {
            d.sdf.data_mut()[i as usize] = 0.0;
        }
        Pulled {
            field: pass.backward(&self.field, &d),
            map: recorded.map.as_ref().map(|p| p.collect(&mut gradients)),
        }
    }

    fn report(&self, recorded: &Recorded) -> StepReport {
        let Config { field_rate, bsp_rate, .. } = &self.config;
        let (step, total) = (self.train_step(), self.config.steps_in(Phase::Train));
        let band = self.work.band.as_ref();
        let terms = &recorded.terms;
        StepReport {
            step: self.step,
            total: self.total_steps(),
            phase: Phase::Train,
            resolution: band.map_or(0, |b| b.resolution),
            loss: self.work.tape.value(recorded.loss).item(),
            para: terms.para,
            deform: terms.deform,
            surf: terms.surf,
            eikonal: terms.eikonal,
            laplacian: terms.laplacian,
            on_points: terms.on_points,
            pull: terms.pull,
            cover: terms.cover,
            bridge: terms.bridge,
            field_rate: self.rate_factor() * field_rate.rate_at(step, total),
            bsp_rate: self.rate_factor() * bsp_rate.rate_at(step, total),
            gradient_norm: 0.0,
            active_verts: band.map_or(0, |b| b.verts.len()),
            surface_verts: self.work.iso.edges.len(),
            recoveries: self.recoveries,
        }
    }

    /// Remembers the trained block's part of S for the steps that do not compute it.
    fn keep_surface(&mut self, recorded: &Recorded, view: &View) {
        if let (Some(map), Some(part), Some(block)) = (&self.map, recorded.surface, view.block) {
            let part = self.work.tape.value(part).to_points();
            map.place(&self.blocks[block], &part, &mut self.surface);
        }
    }

    /// Steps along the gradients.
    fn update(&mut self, pulled: &Pulled, report: &StepReport) {
        // Parameters that a tape holds would be copied.
        self.work.tape.clear();
        self.work.pass.release();
        self.field_adam.step(self.field.params_mut().values_mut(), &pulled.field, report.field_rate);
        if let (Some(map), Some(adam), Some(gradients)) = (&mut self.map, &mut self.map_adam, &pulled.map) {
            adam.step(map.params_mut().values_mut(), gradients, report.bsp_rate);
        }
    }
}

/// A block's part of S and its context (c x 3), on the tape.
pub(in crate::reconstruct) fn forward_map(
    tape: &mut Tape,
    map: &SurfaceMap,
    p: &Bound,
    cloud: &[[f32; 3]],
    block: &Neighbourhood,
) -> Result<(Var, Var), Error> {
    let context: Vec<[f32; 3]> = block.context().iter().map(|&i| cloud[i as usize]).collect();
    let context = tape.constant(Tensor::from_points(&context));
    let surface = map.forward(tape, p, context, block);
    check_near("the parameterized surface", tape.value(surface).data())?;
    Ok((surface, context))
}

/// L_para of a block: from its part of S to all points around, beyond a slack if there is one, and from its centres to
/// its part of S.
pub(in crate::reconstruct) fn para_term(
    tape: &mut Tape,
    surface: Var,
    context: Var,
    block: &Neighbourhood,
    slack: Option<Arc<[f32]>>,
) -> Var {
    let b = block.centres().len();
    if b == block.context().len() && slack.is_none() {
        return tape.chamfer(surface, context, Direction::BOTH);
    }
    let centres = tape.slice_rows(context, 0..b);
    let out = match slack {
        None => tape.chamfer(surface, context, Direction::FORWARD),
        Some(slack) => tape.distance_beyond(surface, context, slack),
    };
    let back = tape.chamfer(surface, centres, Direction::BACKWARD);
    tape.add(out, back)
}

/// The part of S that stands for it in this step: all of it, live if it is being trained; for a cloud in several blocks
/// the live part with the remembered patches of the points in view.
fn surface_target(
    tape: &mut Tape,
    map: &SurfaceMap,
    live: Option<Var>,
    remembered: &[[f32; 3]],
    blocks: usize,
    view: &View,
) -> Var {
    if blocks == 1 {
        return live.unwrap_or_else(|| tape.constant(Tensor::from_points(remembered)));
    }
    let rows = view.rows.iter().flat_map(|&point| &remembered[map.rows_of(point)]);
    let rows: Vec<[f32; 3]> = rows.copied().collect();
    let rows = tape.constant(Tensor::from_points(&rows));
    match live {
        Some(live) => tape.concat_rows([live, rows]),
        None => rows,
    }
}

pub(in crate::reconstruct) fn diverged(message: impl Into<String>) -> Error {
    Error::new(ErrorKind::Diverged, message)
}

/// Refuses coordinates that neighbour searches cannot take.
pub(in crate::reconstruct) fn check_near(what: &str, points: &[f32]) -> Result<(), Error> {
    // Written so that NaN is refused.
    if points.iter().all(|x| x.abs() < FAR) {
        return Ok(());
    }
    Err(diverged(format!("{what} is not finite or far away")))
}

/// Refuses gradients that are not finite.
pub(in crate::reconstruct) fn check_gradients(what: &str, gradients: &[Option<Tensor>]) -> Result<(), Error> {
    if gradient_norm(gradients).is_finite() {
        return Ok(());
    }
    Err(diverged(format!("the gradient of {what} is not finite")))
}
