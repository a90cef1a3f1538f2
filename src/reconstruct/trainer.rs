//! Training in progress: what it consists of, how it starts, and how it comes back when a step goes wrong.

use super::band::Workspace;
use super::bridges::Bridges;
use super::first_shape::FirstShape;
use super::model::{FoundShape, Shape};
use super::step::StepReport;
use super::{Config, Phase, Reconstruction};
use crate::bsp::{Neighbourhood, SurfaceMap};
use crate::error::{Error, ErrorKind};
use crate::gdo::{Deformation, Field};
use crate::geometry::{Normalizer, Position, TetGrid, clean_cloud, thin_cloud};
use crate::nn::Params;
use crate::optim::{Adam, AdamOptions};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand::seq::SliceRandom;

/// How often a run comes back from a step that went wrong before it fails.
pub(super) const RECOVERIES: usize = 3;
/// The stream of random numbers that orders the cloud; weights take stream 0, training step i takes i + 1.
const ORDER_STREAM: u64 = u64::MAX;

/// A checked cloud and the options for it.
pub(super) struct Prepared {
    /// Adapted to the number of points.
    pub config: Config,
    /// Distinct points, input frame.
    pub input: Vec<[f64; 3]>,
    /// Points left out as duplicates.
    pub merged: usize,
    pub normalizer: Normalizer,
}

pub(super) fn prepare<P: Position>(points: &[P], config: &Config) -> Result<Prepared, Error> {
    config.validate()?;
    let clean = clean_cloud(points)?;
    let normalizer = Normalizer::of(&clean.points)?;
    Ok(Prepared {
        config: config.clone().for_points(clean.points.len()),
        input: clean.points,
        merged: clean.duplicates_merged,
        normalizer,
    })
}

/// A cloud is not thinned to fewer points than these.
const LEAST_THINNED: usize = 64;

/// The points of a large cloud that training works with.
fn thinned(cloud: Vec<[f32; 3]>, config: &Config) -> Vec<[f32; 3]> {
    let finest = config.stages.iter().map(|s| s.resolution).max();
    let grid = finest.and_then(|resolution| TetGrid::working_frame(resolution).ok());
    match grid {
        Some(grid) if config.batch.thin > 0.0 && cloud.len() > config.batch.points => {
            let kept = thin_cloud(&cloud, config.batch.thin * grid.spacing());
            // A heap of points and a far outlier would become a few points.
            if kept.len() < LEAST_THINNED {
                return cloud;
            }
            kept.into_iter().map(|i| cloud[i as usize]).collect()
        }
        _ => cloud,
    }
}

/// The field as its initial weights make it.
pub(super) fn blank_field(config: &Config, rng: &mut ChaCha8Rng) -> Field {
    match config.deformation {
        Deformation::Offset => Field::with_offset(config.field, rng),
        _ => Field::new(config.field, rng),
    }
}

/// An optimiser that has not made a step.
pub(super) fn untrained(params: &Params) -> Adam {
    Adam::new(params.values(), AdamOptions::default())
}

/// Parameters with their optimiser.
#[derive(Clone, Debug)]
pub(super) struct Learned {
    pub params: Params,
    pub adam: Adam,
}

/// Everything that a step changes: what is needed to go back to a step, or to go on from a checkpoint.
#[derive(Clone, Debug)]
pub(super) struct Snapshot {
    pub step: usize,
    pub field: Learned,
    pub map: Option<Learned>,
    pub surface: Vec<[f32; 3]>,
    pub bridges: Bridges,
}

/// Training in progress.
///
/// One at a time, [`step`](Self::step) by step; [`reconstruct`](super::reconstruct) is the loop around it. The same
/// cloud and options give the same bytes for any number of threads.
pub struct Trainer {
    pub(super) config: Config,
    /// Distinct points, input frame.
    pub(super) input: Vec<[f64; 3]>,
    pub(super) normalizer: Normalizer,
    /// Distinct points, working frame, thinned if there are many, and without their noise once the first shape is
    /// found.
    pub(super) cloud: Vec<[f32; 3]>,
    /// The order in which a cloud larger than a step is gone through.
    pub(super) order: Vec<u32>,
    /// The parts in which S is made.
    pub(super) blocks: Vec<Neighbourhood>,
    pub(super) field: Field,
    pub(super) field_adam: Adam,
    pub(super) map: Option<SurfaceMap>,
    pub(super) map_adam: Option<Adam>,
    /// S as last computed, working frame; empty without a map.
    pub(super) surface: Vec<[f32; 3]>,
    /// What the field and S learn first; none where the field starts as a sphere. It follows from the cloud and the
    /// options.
    pub(super) shape: Option<FirstShape>,
    /// What is to be inside, so that near parts of the surface stay joined.
    pub(super) bridges: Bridges,
    /// Steps done, of all phases.
    pub(super) step: usize,
    /// The last kept state whose loss and gradients were finite; in the training proper that of the last refresh of
    /// the band.
    pub(super) good: Snapshot,
    pub(super) recoveries: usize,
    pub(super) last_recovery: Option<String>,
    pub(super) work: Workspace,
}

impl Trainer {
    /// Training for the cloud `points` (n x 3, any frame, of 32 or 64 bits): checks the cloud and finds the shape that
    /// the field is to learn first. All learning is left to the steps.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] for unusable options, [`ErrorKind::Data`] for unusable points, [`ErrorKind::NoSurface`] if
    /// no first shape is found.
    pub fn new<P: Position>(points: &[P], config: &Config) -> Result<Self, Error> {
        let prepared = prepare(points, config)?;
        rayon::scope(|_| Self::from_prepared(prepared))
    }

    pub(super) fn from_prepared(prepared: Prepared) -> Result<Self, Error> {
        let mut trainer = Self::blank(prepared);
        trainer.find_shape()?;
        Ok(trainer)
    }

    /// All parts in their initial state, before the first shape is found: what a checkpoint is read into.
    pub(super) fn blank(prepared: Prepared) -> Self {
        let Prepared { config, input, normalizer, .. } = prepared;
        let cloud = thinned(normalizer.forward(&input), &config);
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        let field = blank_field(&config, &mut rng);
        let map = SurfaceMap::new(config.parameterization, config.bsp, &cloud, &mut rng);
        let field_adam = untrained(field.params());
        let map_adam = map.as_ref().map(|m| untrained(m.params()));
        let surface = vec![[0.0; 3]; map.as_ref().map_or(0, |m| m.surface_len(cloud.len()))];
        let mut order: Vec<u32> = (0..cloud.len() as u32).collect();
        rng.set_stream(ORDER_STREAM);
        order.shuffle(&mut rng);
        let good = Snapshot {
            step: 0,
            field: Learned { params: Params::new(), adam: Adam::new(&[], AdamOptions::default()) },
            map: None,
            surface: Vec::new(),
            bridges: Bridges::default(),
        };
        let mut trainer = Trainer {
            config,
            input,
            normalizer,
            cloud,
            order,
            blocks: Vec::new(),
            field,
            field_adam,
            map,
            map_adam,
            surface,
            shape: None,
            bridges: Bridges::default(),
            step: 0,
            good,
            recoveries: 0,
            last_recovery: None,
            work: Workspace::default(),
        };
        trainer.good = trainer.snapshot();
        trainer
    }

    /// One step of the present [`phase`](Self::phase). If it goes wrong (values that are not finite, or no surface
    /// left), goes back to the last good state, which may be of the phase before, and on from there with half the
    /// learning rates, up to three times in a run: the report's `step` is then lower than before.
    ///
    /// # Errors
    /// [`ErrorKind::Diverged`] or [`ErrorKind::NoSurface`] if it goes wrong a fourth time.
    ///
    /// # Panics
    /// If all steps are done.
    #[track_caller]
    pub fn step(&mut self) -> Result<StepReport, Error> {
        assert!(!self.is_done(), "step: all {} steps are done", self.total_steps());
        // On a thread of the pool from the first to the last line: from outside, each parallel loop would wait for a
        // thread to wake up (an eighth of a run with one thread).
        rayon::scope(|_| self.step_in_pool())
    }

    #[track_caller]
    fn step_in_pool(&mut self) -> Result<StepReport, Error> {
        loop {
            let phase = self.phase();
            let attempt = match phase {
                Phase::Start => self.try_start(),
                Phase::Pretrain => self.try_pretrain(),
                Phase::Train => {
                    let ready = if self.train_step() == 0 { self.begin_training() } else { Ok(()) };
                    ready.and_then(|()| self.try_step())
                }
            };
            let error = match attempt {
                Ok(report) => return Ok(report),
                Err(error) => error,
            };
            // Without a surface at the beginning there is none to go back to either.
            let lost =
                error.kind() == ErrorKind::NoSurface && phase == Phase::Train && self.train_step() == 0;
            if lost && self.lower_to_points()? {
                continue;
            }
            let recoverable = matches!(error.kind(), ErrorKind::Diverged | ErrorKind::NoSurface) && !lost;
            if !recoverable || self.recoveries >= RECOVERIES {
                let advice = match phase {
                    Phase::Start => "lower start.rate, or take another start.shape",
                    Phase::Pretrain => "lower bsp_rate.base, or set bsp.pretrain to 0",
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
            self.last_recovery = Some(format!("step {}: {}", self.step, error.message()));
            let good = self.good.clone();
            self.restore(&good);
        }
    }

    /// The factor on all learning rates, halved by every recovery.
    pub(super) fn caution(&self) -> f32 {
        0.5f32.powi(self.recoveries as i32)
    }

    pub(super) fn snapshot(&self) -> Snapshot {
        let learned = |params: &Params, adam: &Adam| Learned { params: params.clone(), adam: adam.clone() };
        Snapshot {
            step: self.step,
            field: learned(self.field.params(), &self.field_adam),
            map: self.map.as_ref().zip(self.map_adam.as_ref()).map(|(m, adam)| learned(m.params(), adam)),
            surface: self.surface.clone(),
            bridges: self.bridges.clone(),
        }
    }

    /// Goes back to a state; the band is searched for anew.
    pub(super) fn restore(&mut self, to: &Snapshot) {
        self.work.reset();
        self.step = to.step;
        *self.field.params_mut() = to.field.params.clone();
        self.field_adam = to.field.adam.clone();
        if let (Some(map), Some(learned)) = (&mut self.map, &to.map) {
            *map.params_mut() = learned.params.clone();
            self.map_adam = Some(learned.adam.clone());
        }
        self.surface.clone_from(&to.surface);
        self.bridges.clone_from(&to.bridges);
    }

    /// Whether all steps are done.
    pub fn is_done(&self) -> bool {
        self.step >= self.total_steps()
    }

    /// Steps done; goes back with a recovery.
    pub fn steps_done(&self) -> usize {
        self.step
    }

    /// Steps of all phases.
    pub fn total_steps(&self) -> usize {
        self.config.total_steps()
    }

    /// The options, adapted to the number of points.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// How far the points were moved to take their noise off: the root of the mean square, in the unit of the input; 0
    /// if they were left alone (see [`Config::denoise`]).
    pub fn noise_removed(&self) -> f64 {
        let moved = self.shape.as_ref().map_or(0.0, |shape| shape.cloud.moved);
        moved * self.normalizer.scale()
    }

    /// How often the run went back to a good state so far.
    pub fn recoveries(&self) -> usize {
        self.recoveries
    }

    /// What went wrong when the training last went back to a good state.
    pub fn last_recovery(&self) -> Option<&str> {
        self.last_recovery.as_deref()
    }

    /// The result so far.
    pub fn finish(self) -> Reconstruction {
        rayon::scope(|_| self.finish_in_pool())
    }

    fn finish_in_pool(self) -> Reconstruction {
        let parameterized = self.parameterized();
        let found = match self.shape {
            Some(shape) if self.config.stages.is_empty() => FoundShape::new(shape.mesh).ok(),
            _ => None,
        };
        let shape = found.map_or(Shape::Learned(self.field), Shape::Found);
        let finish = shape.finished_for(&self.cloud, &self.config);
        Reconstruction {
            coverage: parameterized.as_ref().and_then(|p| p.coverage().ok()),
            surface: parameterized.map_or_else(Vec::new, |p| p.surface),
            config: self.config,
            normalizer: self.normalizer,
            cloud: self.input,
            shape,
            finish,
            notices: Vec::new(),
        }
    }
}
