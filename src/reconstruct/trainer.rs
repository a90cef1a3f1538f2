//! A run step by step: the present state, and the way back from a step that went wrong.

use super::band::ActiveBand;
use super::coded::{self, Coded};
use super::final_shape::{FinalShape, FoundShape};
use super::phases::{StepReport, Stop, Workspace, pretrain, start, train};
use super::setup::{Prepared, Setup, prepare};
use super::state::State;
use super::{Config, Hints, Phase, Reconstruction};
use crate::error::{Error, ErrorKind};
use crate::geometry::Position;

/// How often a run comes back from a step that went wrong before it fails.
pub(super) const MAX_RECOVERIES: usize = 3;
/// Steps of the first two phases between two states that are kept to come back to.
const KEEP_EVERY: usize = 20;

/// Training in progress.
///
/// One at a time, [`step`](Self::step) by step; [`reconstruct`](super::reconstruct) is the loop around it. The same
/// input points and options give the same bytes for any number of threads.
pub struct Trainer {
    pub(super) setup: Setup,
    pub(super) state: State,
    /// The last kept state whose loss and gradients were finite; in the training proper that of the last search for the
    /// band.
    pub(super) good: State,
    /// The active part of the grid, from the first step of the training proper on. It follows from the last kept state.
    pub(super) band: Option<ActiveBand>,
    pub(super) recoveries: usize,
    pub(super) last_recovery: Option<String>,
    pub(super) work: Workspace,
}

impl Trainer {
    /// Training for the input `points` (n x 3, any frame, of 32 or 64 bits): checks them and finds the shape that the
    /// field is to learn first. All learning is left to the steps.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] for unusable options, [`ErrorKind::Data`] for unusable points, [`ErrorKind::NoSurface`] if
    /// no first shape is found.
    pub fn new<P: Position>(points: &[P], config: &Config) -> Result<Self, Error> {
        Self::with_hints(points, config, &Hints::default())
    }

    /// The same with [`Hints`]: what is known of the input points besides their positions, such as normals.
    ///
    /// # Errors
    /// As [`new`](Self::new); [`ErrorKind::Config`] also for normals with `start.shape = sphere`.
    ///
    /// # Panics
    /// If there are normals, but not one a point.
    #[track_caller]
    pub fn with_hints<P: Position>(points: &[P], config: &Config, hints: &Hints<'_>) -> Result<Self, Error> {
        let prepared = prepare(points, config, hints)?;
        rayon::scope(|_| Self::from_prepared(prepared))
    }

    /// A trainer before its first step.
    pub(super) fn from_prepared(prepared: Prepared) -> Result<Self, Error> {
        let (setup, state) = Setup::new(prepared)?;
        let (good, work) = (state.clone(), Workspace::default());
        Ok(Trainer { setup, state, good, band: None, recoveries: 0, last_recovery: None, work })
    }

    /// One step of the present [`phase`](Self::phase). If it goes wrong (values that are not finite, or no surface
    /// left), goes back to the last good state, which may be of the phase before, and on from there with half the
    /// learning rates, up to three times in a run: the report's `step` is then lower than before.
    ///
    /// # Errors
    /// [`ErrorKind::Diverged`] or [`ErrorKind::NoSurface`] if it goes wrong a fourth time; [`ErrorKind::NoSurface`] at
    /// once if the field has no surface at the first step of the training.
    ///
    /// # Panics
    /// If all steps are done.
    #[track_caller]
    pub fn step(&mut self) -> Result<StepReport, Error> {
        let done = self.step_unless(&|| false)?;
        Ok(done.expect("nobody stops it"))
    }

    /// Like [`step`](Self::step), but calls `stop` between the parts of the step, which take long for many points or
    /// a fine grid: the search for the surface (grid cube by grid cube), the field's values, the loss, its gradients.
    /// If `stop` returns true, the step is abandoned, the state is unchanged and `None` is returned.
    ///
    /// # Errors
    /// As [`step`](Self::step).
    ///
    /// # Panics
    /// If all steps are done.
    #[track_caller]
    pub fn step_unless(&mut self, stop: &(dyn Fn() -> bool + Sync)) -> Result<Option<StepReport>, Error> {
        assert!(!self.is_done(), "step: all {} steps are done", self.total_steps());
        // On a thread of the pool from the first to the last line: from outside, each parallel loop would wait for a
        // thread to wake up.
        rayon::scope(|_| self.step_in_pool(stop))
    }

    fn step_in_pool(&mut self, stop: Stop<'_>) -> Result<Option<StepReport>, Error> {
        loop {
            let bridges = self.state.bridges.clone();
            let error = match self.try_step(stop) {
                Ok(report) => return Ok(Some(report)),
                Err(error) => error,
            };
            if error.kind() == ErrorKind::Cancelled {
                // The abandoned step may have added bridges at its beginning.
                self.state.bridges = bridges;
                self.work.clear();
                return Ok(None);
            }
            let (phase, step) = self.setup.config.phase_at(self.state.step);
            // Where the first step of the training finds no surface, no earlier state has one either.
            let lost = error.kind() == ErrorKind::NoSurface && (phase, step) == (Phase::Train, 0);
            if lost && train::lower_to_points(&self.setup, &mut self.state)? {
                continue;
            }
            let recoverable = matches!(error.kind(), ErrorKind::Diverged | ErrorKind::NoSurface) && !lost;
            if !recoverable || self.recoveries >= MAX_RECOVERIES {
                let advice = match phase {
                    Phase::Start => "lower start.rate, or take another start.shape",
                    Phase::Pretrain => "lower bsp_rate.base, or set bsp_pretrain to 0",
                    Phase::Train if lost => {
                        "raise start.steps or the resolution of the first stage, or take another start.shape"
                    }
                    Phase::Train => {
                        "lower field_rate.base and bsp_rate.base, raise their warmup, set clip to 1, or take another \
                         start.shape"
                    }
                };
                let tries =
                    format!("this is after {} recoveries with lower rates; {advice}", self.recoveries);
                return Err(error.advise(tries));
            }
            self.recoveries += 1;
            self.last_recovery = Some(format!("step {}: {}", self.state.step, error.message()));
            self.go_to(self.good.clone());
        }
    }

    /// One step of the present phase. On an error the parameters are as before it.
    fn try_step(&mut self, stop: Stop<'_>) -> Result<StepReport, Error> {
        let (phase, step) = self.setup.config.phase_at(self.state.step);
        let Trainer { setup, state, band, work, .. } = self;
        let due = step.is_multiple_of(KEEP_EVERY);
        let (mut update, keep) = match (phase, &setup.shape, &state.map) {
            (Phase::Start, Some(shape), _) => (start::step(setup, state, shape, work)?, due),
            (Phase::Pretrain, _, Some(map)) => (pretrain::step(setup, state, map, work)?, due),
            _ => {
                if step == 0 {
                    train::begin(setup, state)?;
                }
                look_for_gaps(setup, state, step)?;
                let (band, searched) = current_band(setup, state, step, band, stop)?;
                // A state whose band was searched for just now, and whose step went well, has a surface, a finite loss
                // and finite gradients.
                (train::step(setup, state, band, work, stop)?, searched)
            }
        };
        if keep {
            self.good = self.state.clone();
        }
        self.work.clear();
        let lower = 0.5f32.powi(self.recoveries as i32);
        update.report = StepReport {
            step: self.state.step,
            total: self.total_steps(),
            phase,
            recoveries: self.recoveries,
            field_rate: lower * update.report.field_rate,
            bsp_rate: lower * update.report.bsp_rate,
            ..update.report
        };
        self.state.apply(&self.setup.blocks, &update);
        Ok(update.report)
    }

    /// Goes on from a state; the band is searched for anew.
    fn go_to(&mut self, state: State) {
        self.work.clear();
        self.band = None;
        self.state = state;
    }

    /// The phase that the next step belongs to; the training once all steps are done.
    pub fn phase(&self) -> Phase {
        self.setup.config.phase_at(self.state.step).0
    }

    /// Whether all steps are done.
    pub fn is_done(&self) -> bool {
        self.state.step >= self.total_steps()
    }

    /// Steps done; goes back with a recovery.
    pub fn steps_done(&self) -> usize {
        self.state.step
    }

    /// Steps of all phases.
    pub fn total_steps(&self) -> usize {
        self.setup.config.total_steps()
    }

    /// The options, adapted to the number of points.
    pub fn config(&self) -> &Config {
        &self.setup.config
    }

    /// The root mean square of the distances from the working points to the denoised points, in the unit of the input;
    /// 0 if no noise was found (see [`Config::denoise`]).
    pub fn noise_removed(&self) -> f64 {
        self.setup.noise_removed() * self.setup.frame.scale()
    }

    /// How often the run went back to a good state so far.
    pub fn recoveries(&self) -> usize {
        self.recoveries
    }

    /// What went wrong when the training last went back to a good state.
    pub fn last_recovery(&self) -> Option<&str> {
        self.last_recovery.as_deref()
    }

    /// Denoised points, S and the vertices of the grid with their codes, by the present parameters; `None` if there are
    /// no codes, which only [`Parameterization::Bsp`](crate::bsp::Parameterization::Bsp) has.
    ///
    /// # Errors
    /// [`ErrorKind::NoSurface`] if the field has no zero level on the grid, [`ErrorKind::Diverged`] if it is not
    /// finite.
    pub fn coded(&self) -> Result<Option<Coded>, Error> {
        rayon::scope(|_| coded::coded(&self.setup, &self.state))
    }

    /// The result so far: the field, or the first shape itself before the first step of the training proper.
    pub fn finish(self) -> Reconstruction {
        rayon::scope(|_| self.finish_in_pool())
    }

    fn finish_in_pool(self) -> Reconstruction {
        let Trainer { setup, state, .. } = self;
        let parameterized = coded::parameterized(&setup, &state);
        let turned = setup.shape.as_ref().is_some_and(|shape| shape.turned);
        // Before the first step of the training proper the field is at best on its way to the first shape.
        let trained = matches!(setup.config.phase_at(state.step), (Phase::Train, within) if within > 0);
        let found = match setup.shape {
            Some(shape) if !trained => FoundShape::new(shape.mesh).ok(),
            _ => None,
        };
        let shape = found.map_or(FinalShape::Learned(state.field), FinalShape::Found);
        let mut notices = Vec::new();
        let finish = shape.finished_for(&setup.denoised, &setup.config).unwrap_or_else(|e| {
            notices.push(format!("the field is left as it is at the points (finish=points): {e}"));
            None
        });
        Reconstruction {
            coverage: parameterized.as_ref().and_then(|p| p.coverage().ok()),
            surface: parameterized.map_or_else(Vec::new, |p| p.surface),
            config: setup.config,
            frame: setup.frame,
            input: setup.input,
            shape,
            finish,
            turned,
            notices,
        }
    }
}

/// Looks for gaps before a step of the training, if it is time to, and adds bridges over them to the state.
fn look_for_gaps(setup: &Setup, state: &mut State, step: usize) -> Result<(), Error> {
    let config = &setup.config;
    if config.weights.bridge == 0.0 || !state.bridges.are_due(step, config.steps_in(Phase::Train)) {
        return Ok(());
    }
    state.bridges.look(&state.field, &setup.denoised, config.min_component, step)
}

/// The active part of the grid for a step of the training, and whether it was searched for just now: every few steps,
/// and where the resolution changes.
fn current_band<'a>(
    setup: &Setup,
    state: &State,
    step: usize,
    band: &'a mut Option<ActiveBand>,
    stop: Stop<'_>,
) -> Result<(&'a ActiveBand, bool), Error> {
    let resolution = setup.resolution_at(step);
    let current = band.take().filter(|b| b.resolution == resolution);
    let due = step.is_multiple_of(setup.config.band.refresh);
    let (current, searched) = match current {
        Some(current) if !due => (current, false),
        _ => (find_band(setup, state, resolution, stop)?, true),
    };
    Ok((band.insert(current), searched))
}

/// The active part of a grid by the field of a state.
pub(super) fn find_band(
    setup: &Setup,
    state: &State,
    resolution: usize,
    stop: Stop<'_>,
) -> Result<ActiveBand, Error> {
    ActiveBand::find(&state.field, &setup.denoised, resolution, setup.config.band.rings, stop)
}
