//! The third phase, the training proper: the field g moves the active vertices V of the grid to V' (equation 4),
//! marching tetrahedra take the surface from them, and the loss draws it to S and Q (equation 7).

use super::pretrain::{forward_map, para_term};
use super::{
    ParamGradients, StepReport, Stop, Update, Workspace, check_gradients, check_near, diverged, go_on,
};
use crate::autodiff::{Tape, Var};
use crate::bsp::SurfaceMap;
use crate::error::{Error, ErrorKind};
use crate::field::{FieldMemory, FieldVars};
use crate::gdo::{FaceSamples, deform};
use crate::geometry::{TetGrid, TriangleBvh, median, vec3};
use crate::nn::Bound;
use crate::optim::{clip_norm, gradient_norm};
use crate::random::Random;
use crate::reconstruct::Phase;
use crate::reconstruct::band::ActiveBand;
use crate::reconstruct::objective::{TermInputs, Terms, add_terms, target};
use crate::reconstruct::setup::Setup;
use crate::reconstruct::shape_samples::BlockSamples;
use crate::reconstruct::state::{State, fresh_adam};
use crate::tensor::Tensor;
use rand::RngExt;

/// Random numbers of the grid's shift in step i come from stream `SHIFT_STREAMS + i`; those of the samples on the faces
/// from stream i + 1.
const SHIFT_STREAMS: u64 = 1 << 40;

/// Prepares a state for the first step of the training. To be called before that step only, as it makes new Adam
/// states; twice before it is as once.
///
/// # Errors
/// [`ErrorKind::Diverged`] if S is not finite.
pub(in crate::reconstruct) fn begin(setup: &Setup, state: &mut State) -> Result<(), Error> {
    // The optimiser's moments of the regression do not fit the losses of the training.
    state.field_adam = fresh_adam(state.field.params());
    if let Some(map) = &state.map {
        let surface = map.surface(&setup.denoised, &setup.blocks);
        check_near("the parameterized surface", surface.as_flattened())?;
        state.surface = surface;
    }
    Ok(())
}

/// For a field in which the first step finds no surface, as after a regression to a blade that is too thin for the
/// network to learn in its steps: unless the median of g at the points is a quarter of a cube of the grid below 0 or
/// more, lowers g by a constant until it is half a cube below. Returns whether it did; a lowered field is not lowered
/// again.
///
/// # Errors
/// As [`TetGrid::working_frame`].
pub(in crate::reconstruct) fn lower_to_points(setup: &Setup, state: &mut State) -> Result<bool, Error> {
    let middle = median(state.field.sdf(&setup.denoised));
    let cube = TetGrid::working_frame(setup.resolution_at(0))?.spacing();
    let outside = setup.shape.is_some() && middle > -0.25 * cube;
    if outside {
        state.field.lower(middle + 0.5 * cube);
    }
    Ok(outside)
}

/// One step of the training, on the active part of the grid.
///
/// # Errors
/// [`ErrorKind::Diverged`] if something is not finite or far away, [`ErrorKind::NoSurface`] if the surface is gone,
/// [`ErrorKind::Cancelled`] if `stop` returns true between two parts.
pub(in crate::reconstruct) fn step(
    setup: &Setup,
    state: &State,
    band: &ActiveBand,
    work: &mut Workspace,
    stop: Stop<'_>,
) -> Result<Update, Error> {
    let (_, step) = setup.config.phase_at(state.step);
    let at = TrainStep::new(setup, state, band, step);
    let seen = at.seen();
    work.tape.clear();
    go_on(stop)?;
    let sampled = at.sample_field(&seen, work)?;
    at.march(&sampled, work)?;
    go_on(stop)?;
    let recorded = at.record(&sampled, &seen, work)?;
    go_on(stop)?;
    let (mut field, map) = at.gradients(&recorded, &sampled, &work.tape);
    let config = &setup.config;
    let gradient_norm = match config.clip {
        None => gradient_norm(&field),
        Some(most) => clip_norm(&mut field, most),
    };
    let loss = work.tape.value(recorded.loss).item();
    if !loss.is_finite() {
        return Err(diverged("the loss is not finite"));
    }
    check_gradients("the field", &field)?;
    if let Some(gradients) = &map {
        check_gradients("the parameterization", gradients)?;
    }
    Ok(Update {
        report: StepReport {
            resolution: Some(band.resolution),
            loss,
            terms: recorded.terms,
            field_rate: config.field_rate.rate_at(at.step, at.steps),
            bsp_rate: config.bsp_rate.rate_at(at.step, at.steps),
            gradient_norm,
            active_verts: band.verts.len(),
            surface_verts: work.iso.edges.len(),
            ..StepReport::default()
        },
        field: Some(field),
        map,
        part_of_s: recorded.surface.zip(seen.block).map(|(s, block)| (block, work.tape.value(s).to_points())),
    })
}

/// What a step of the training starts from.
#[derive(Clone, Copy)]
pub(in crate::reconstruct) struct TrainStep<'a> {
    pub setup: &'a Setup,
    pub state: &'a State,
    pub band: &'a ActiveBand,
    /// The number of the step within the training.
    pub step: usize,
    /// Steps of the training.
    pub steps: usize,
}

/// The denoised points that a step uses: all of them, or a part if there are more than `batch.points`.
pub(in crate::reconstruct) struct Seen {
    /// Their indices among the denoised points, q.
    pub rows: Vec<u32>,
    /// Their positions, q x 3, working frame.
    pub points: Vec<[f32; 3]>,
    /// The block whose patches are trained, in steps that train the parameterization.
    pub block: Option<usize>,
}

/// The field on the tape of a step, at all places where the step evaluates it.
pub(in crate::reconstruct) struct Sampled {
    /// All parameters of the field in one row, 1 x P.
    parameters: Var,
    /// grad g at all places.
    gradient: Var,
    /// At the active vertices V of the shifted grid; g is raised on the border of the grid, so that the surface ends
    /// before it.
    pub at_verts: FieldVars,
    /// g at the seen points, q x 1; `None` if no term needs it.
    pub at_points: Option<Var>,
    /// g at the points of bridges, if there are any.
    pub at_bridges: Option<Var>,
}

/// The loss of a step on its tape, and what it was made from.
pub(in crate::reconstruct) struct Recorded {
    pub loss: Var,
    /// The parameters of the parameterization, in steps that train it.
    map: Option<Bound>,
    /// The trained block's part of S.
    surface: Option<Var>,
    pub terms: Terms,
}

impl<'a> TrainStep<'a> {
    /// The step that a state is at.
    pub fn new(setup: &'a Setup, state: &'a State, band: &'a ActiveBand, step: usize) -> Self {
        TrainStep { setup, state, band, step, steps: setup.config.steps_in(Phase::Train) }
    }

    /// Chooses the denoised points and the block that this step uses.
    pub fn seen(&self) -> Seen {
        let Setup { config, denoised, order, blocks, .. } = self.setup;
        let (n, step, size) = (denoised.len(), self.step, config.batch.points);
        let rows: Vec<u32> = if n <= size {
            (0..n as u32).collect()
        } else {
            (0..size).map(|i| order[(step * size + i) % n]).collect()
        };
        let learns = self.state.map.as_ref().is_some_and(|map| !map.params().is_empty());
        let every = config.bsp_every.filter(|&every| learns && step.is_multiple_of(every));
        let block = every.map(|every| step / every % blocks.len());
        Seen { points: rows.iter().map(|&i| denoised[i as usize]).collect(), rows, block }
    }

    /// The active vertices of this step (v x 3, working frame): the grid is shifted by up to half of `band.shift` cubes
    /// along each axis, by another vector in every step. Which tetrahedra are active stays as it was searched for.
    ///
    /// # Errors
    /// As [`TetGrid::working_frame`].
    fn shifted_grid(&self) -> Result<Vec<[f32; 3]>, Error> {
        let Setup { config, .. } = self.setup;
        let cube = TetGrid::working_frame(self.band.resolution)?.spacing();
        let mut rng = Random::new(config.seed);
        rng.set_stream(SHIFT_STREAMS + self.step as u64);
        let shift = [(); 3].map(|()| config.band.shift * cube * (rng.source().random::<f32>() - 0.5));
        Ok(self.band.verts.iter().map(|&v| vec3::add(v, shift)).collect())
    }

    /// Puts the field on the tape: at the active vertices, the seen points and the bridges, as far as terms need them.
    ///
    /// # Errors
    /// [`ErrorKind::Diverged`] if a value is not finite.
    pub fn sample_field(&self, seen: &Seen, work: &mut Workspace) -> Result<Sampled, Error> {
        let (band, weights, field) = (self.band, &self.setup.config.weights, &self.state.field);
        let Workspace { tape, memory, .. } = work;
        let mut places = self.shifted_grid()?;
        let verts = 0..places.len();
        if weights.on_points > 0.0 || weights.eikonal > 0.0 {
            places.extend_from_slice(&seen.points);
        }
        let points = verts.end..places.len();
        places.extend_from_slice(&self.state.bridges.points);
        let bridges = points.end..places.len();

        let parameters = tape.input(field.params().flat());
        let all = field.fused(tape, parameters, &places, memory);
        let finite = [Some(all.sdf), Some(all.gradient), all.offset];
        if finite.into_iter().flatten().any(|var| !tape.value(var).is_finite()) {
            return Err(diverged("the field is not finite"));
        }
        let all = FieldVars { sdf: tape.raise_rows(all.sdf, band.border.clone(), band.outside), ..all };
        let at_verts = all.rows(tape, verts);
        let on_points = weights.on_points > 0.0 && !points.is_empty();
        Ok(Sampled {
            parameters,
            gradient: all.gradient,
            at_verts,
            at_points: on_points.then(|| tape.slice_rows(all.sdf, points)),
            at_bridges: (!bridges.is_empty()).then(|| tape.slice_rows(all.sdf, bridges)),
        })
    }

    /// Finds which edges of the band the surface crosses.
    ///
    /// # Errors
    /// [`ErrorKind::NoSurface`] if none.
    pub fn march(&self, sampled: &Sampled, work: &mut Workspace) -> Result<(), Error> {
        let sdf = work.tape.value(sampled.at_verts.sdf).data();
        let inside: Vec<bool> = sdf.iter().map(|&s| s < 0.0).collect();
        self.band.topology.march_into(&inside, &mut work.iso);
        if work.iso.faces.is_empty() {
            return Err(Error::new(ErrorKind::NoSurface, "the surface vanished during training"));
        }
        Ok(())
    }

    /// Goes on with the tape from the field to the loss: moved vertices, surface, target, terms.
    pub fn record(&self, sampled: &Sampled, seen: &Seen, work: &mut Workspace) -> Result<Recorded, Error> {
        let Setup { config, denoised, blocks, .. } = self.setup;
        let state = self.state;
        let progress = self.step as f32 / self.steps.max(1) as f32;
        let Workspace {
            tape,
            iso,
            tree,
            #[cfg(test)]
            held_samples,
            ..
        } = work;
        let moved = deform(tape, config.deformation, &sampled.at_verts);
        let crossings = tape.edge_crossing(moved, sampled.at_verts.sdf, &iso.edges[..]);
        check_near("the extracted surface", tape.value(crossings).data())?;
        let (drawn, tree) = match config.surface_samples {
            None => (crossings, None),
            Some(count) => {
                let mut rng = Random::new(config.seed);
                rng.set_stream(self.step as u64 + 1);
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
        let q = tape.constant(Tensor::from_points(&seen.points));

        let (mut bound, mut live, mut para) = (None, None, None);
        if let (Some(map), Some(block)) = (&state.map, seen.block) {
            let block = &blocks[block];
            let p = map.params().bind(tape, true);
            let (surface, context) = forward_map(tape, map, &p, denoised, block)?;
            if config.weights.para > 0.0 {
                let slack = map.slack(block, denoised.len());
                para = Some(para_term(tape, surface, context, block, &BlockSamples::default(), slack));
            }
            (bound, live) = (Some(p), Some(surface));
        }
        let surface =
            state.map.as_ref().map(|map| seen_surface(tape, map, live, &state.surface, blocks.len(), seen));

        let bridges = sampled.at_bridges.map(|sdf| {
            let depths = &state.bridges.depths;
            (sdf, tape.constant(Tensor::from_vec(&[depths.len(), 1], depths.clone())))
        });
        let inputs = TermInputs {
            faces: &iso.faces,
            field: sampled.at_verts,
            sdf_at_points: sampled.at_points,
            bridges,
            gradient: sampled.gradient,
            moved,
            crossings,
            drawn,
            tree,
            seen: q,
            target: target(tape, &config.weights, config.target, surface, q),
            para,
        };
        let (loss, terms) = add_terms(tape, &config.weights, progress, &inputs);
        let none =
            || Error::new(ErrorKind::Config, "no term of the loss has a weight").at_element("option weights");
        Ok(Recorded { loss: loss.ok_or_else(none)?, map: bound, surface: live, terms })
    }

    /// The gradients of the loss by the parameters of the field and, if the step trains it, of the parameterization.
    pub fn gradients(
        &self,
        recorded: &Recorded,
        sampled: &Sampled,
        tape: &Tape,
    ) -> (ParamGradients, Option<ParamGradients>) {
        let mut gradients = tape.backward(recorded.loss);
        let params = self.state.field.params();
        let flat = gradients.take(sampled.parameters);
        let flat = flat.unwrap_or_else(|| Tensor::zeros(&[1, params.scalars()]));
        let field = params.split(flat.data()).into_iter().map(Some).collect();
        (field, recorded.map.as_ref().map(|p| p.collect(&mut gradients)))
    }

    /// V and V' of this step's grid, without its shift (v x 3 each, working frame).
    ///
    /// # Errors
    /// [`ErrorKind::Diverged`] if V' is not finite or far away.
    pub fn moved_verts(&self) -> Result<[Vec<[f32; 3]>; 2], Error> {
        let verts = &self.band.verts;
        let mut tape = Tape::new();
        let parameters = tape.constant(self.state.field.params().flat());
        let field = self.state.field.fused(&mut tape, parameters, verts, &FieldMemory::default());
        let moved = deform(&mut tape, self.setup.config.deformation, &field);
        check_near("the moved grid", tape.value(moved).data())?;
        Ok([verts.clone(), tape.value(moved).to_points()])
    }
}

/// The points of S used in a step. One block: all of S, with gradients if it is being trained. Several blocks: the
/// trained block with gradients, and the stored patches of the seen points.
fn seen_surface(
    tape: &mut Tape,
    map: &SurfaceMap,
    live: Option<Var>,
    remembered: &[[f32; 3]],
    blocks: usize,
    seen: &Seen,
) -> Var {
    if blocks == 1 {
        return live.unwrap_or_else(|| tape.constant(Tensor::from_points(remembered)));
    }
    let rows = seen.rows.iter().flat_map(|&point| &remembered[map.rows_of(point)]);
    let rows: Vec<[f32; 3]> = rows.copied().collect();
    let rows = tape.constant(Tensor::from_points(&rows));
    match live {
        Some(live) => tape.concat_rows([live, rows]),
        None => rows,
    }
}

#[cfg(test)]
mod tests {
    use super::{TrainStep, Workspace, lower_to_points};
    use crate::field::Field;
    use crate::geometry::TetGrid;
    use crate::reconstruct::tests::{at_training, ball, tiny};

    #[test]
    fn the_grid_is_shifted_by_less_than_half_a_cube_and_otherwise_in_every_step() {
        let mut config = tiny();
        config.band.shift = 1.0;
        let mut trainer = at_training(&ball(60), &config);
        trainer.step().unwrap();
        let band = trainer.band.as_ref().unwrap();
        // Where the field is evaluated, which is where the vertices are from then on.
        let shift = |step: usize| {
            let (at, mut work) =
                (TrainStep::new(&trainer.setup, &trainer.state, band, step), Workspace::default());
            let sampled = at.sample_field(&at.seen(), &mut work).unwrap();
            let grid = work.tape.value(sampled.at_verts.points).to_points();
            assert_eq!(grid.len(), band.verts.len());
            let by = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|k| a[k] - b[k]);
            let all: Vec<[f32; 3]> = grid.iter().zip(&band.verts).map(by).collect();
            assert!(all.iter().all(|v| (0..3).all(|k| (v[k] - all[0][k]).abs() < 1e-6)));
            all[0]
        };
        let shifts: Vec<[f32; 3]> = (0..40).map(shift).collect();
        let half = 0.5 * TetGrid::working_frame(band.resolution).unwrap().spacing();
        for k in 0..3 {
            let along = || shifts.iter().map(|s| s[k]);
            assert!(along().all(|x| x.abs() <= half + 1e-6));
            // Of 40 even draws some are in each outer quarter.
            assert!(along().any(|x| x > 0.5 * half) && along().any(|x| x < -0.5 * half), "{shifts:?}");
        }
        assert!(shifts.windows(2).all(|pair| pair[0] != pair[1]));
    }

    #[test]
    fn a_field_without_an_inside_is_lowered_to_the_points() {
        let mut trainer = at_training(&ball(60), &tiny());
        trainer.state.field.lower(-0.6);
        let outside = trainer.state.field.clone();
        let report = trainer.step().unwrap();
        assert!(report.surface_verts > 0 && report.recoveries == 0, "{report:?}");
        let lowered = |field: &Field| {
            let mut values = field.sdf(&trainer.setup.denoised);
            values.sort_by(f32::total_cmp);
            values[30]
        };
        // Half a cube of a grid of 10 cubes a side is 0.05; the step changes it a little.
        let now = lowered(&trainer.state.field);
        assert!(lowered(&outside) > 0.2 && (-0.12..0.0).contains(&now), "{now}");
        // Once lowered, it is not lowered again.
        assert!(!lower_to_points(&trainer.setup, &mut trainer.state).unwrap());
    }
}
