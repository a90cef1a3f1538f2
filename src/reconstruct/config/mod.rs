//! The options of a run. Lengths are in the working frame: the input points centred, their longest side 1.

mod documented;
mod options;
mod preset;
mod scale;
mod target;
mod validate;

#[cfg(feature = "checkpoint")]
pub(super) use options::RENAMED;
pub use preset::Preset;
pub use target::Target;

use crate::bsp::{BspConfig, Parameterization};
use crate::field::FieldConfig;
use crate::gdo::Deformation;
use crate::optim::Schedule;
use crate::reconstruct::objective::Weights;
use crate::reconstruct::phase::Phase;

/// The shape that the field starts as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StartShape {
    /// A sphere of radius `field.radius`, by the initial weights alone.
    Sphere,
    /// The surface that the parametric Gauss formula finds among the points (Lin et al. 2022), fitted by regression.
    Gauss,
    /// The surface of least bending through the points: one thin plate for up to 500, for more one of each part of
    /// them, blended (after Huang et al. 2019). Its normals are first guessed by the Gauss formula, whose surface is
    /// kept where no point is near. For more than 262,144 points it is that of the Gauss formula.
    Plate,
}

/// How the field gets its first shape. Only `shape` matters for a sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Start {
    /// Which shape. Default `plate`; the paper does not say, its code starts from a sphere.
    pub shape: StartShape,
    /// Radius within which a dipole of the Gauss formula is smoothed, in neighbour spacings: mean distances of the
    /// point to its seven nearest others. `None` (`auto`) tries 0.25, 0.5 and 1 and keeps the one whose shape fits the
    /// points best; for more than 1,024 points it takes 0.5. Default `auto`.
    pub dipole_radius: Option<f32>,
    /// Weight of the smallest solution in the Gauss formula; larger is smoother. Default 0.05.
    pub regularity: f64,
    /// Steps of the regression. Default 200; more learn the faults of the first shape, too (`benches/accuracy.md`).
    pub steps: usize,
    /// Learning rate of the regression. Default 2e-3.
    pub rate: f32,
}

/// What is done to the field after the training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Finishing {
    /// Nothing.
    None,
    /// Subtracts the interpolated values of the field at the points, which should be 0, and blends in the surface of
    /// least bending where leave-one-out prediction of the points is accurate. For 20 to a million points;
    /// with fewer or more the field is left as it is.
    Points,
}

/// A part of the training, at one grid resolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stage {
    /// Cubes along each side of the grid, for a surface of usual area, see [`Config::reference_area`].
    pub resolution: usize,
    /// Steps.
    pub steps: usize,
}

/// The part of the grid that training works on.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Band {
    /// Steps between two searches for the grid cubes that the surface crosses; each search also keeps a state to fall
    /// back to. Default 4.
    pub refresh: usize,
    /// Rings of cubes around the crossed ones that belong to the band, too. Default 0.
    pub rings: usize,
    /// Random shift of the grid along each axis, drawn anew in each step, in cubes: 1 is up to half a cube either way.
    /// Without, the field is trained at the same places for many steps and is free between them. 0 is no shift. Default
    /// 1.
    pub shift: f32,
}

/// How many of the denoised points one step uses; up to these sizes it uses all.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Batch {
    /// More than `points` points are first thinned to one in each cube of this side, if anything is trained for them.
    /// The unit is the distance between vertices of the finest grid in `stages`, before `reference_area` changes it.
    /// `None` (`off`) keeps all points. Default 0.25.
    pub thin: Option<f32>,
    /// Denoised points in a step, at most: consecutive parts of one fixed random permutation. Default 4096.
    pub points: usize,
    /// Points whose patches are trained in a step, at most: blocks of the denoised points in turn, each of points that
    /// lie together. Default 1024.
    pub centres: usize,
}

/// All options of a reconstruction.
///
/// Start from [`Config::preset`] and change fields, or [`set`](Self::set) them by name. Lengths are in the working
/// frame, where the longest side of the input points is 1.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Config {
    /// Seed of everything random. Default 0.
    pub seed: u64,
    /// Whether a run first adapts these options to the number of points, by [`for_points`](Self::for_points).
    /// Default true.
    pub scale_with_points: bool,
    /// The most input points (without duplicates) for which anything is trained. For more, the result is the finished
    /// first shape, as with the preset `start`: its detail grows with the points, that of the network does not
    /// (`benches/method.md`). Applies only if `scale_with_points` is set and the field does not start as a sphere.
    /// `None` (`all`) trains for any number. Default 1,000, paper all.
    pub train_up_to: Option<usize>,
    /// Whether working points that scatter about a smooth surface, by the measure of cross-validation, are moved onto
    /// it first (denoised points); for 50 to 500 points whose field does not start as a sphere. Default true, paper
    /// false.
    pub denoise: bool,
    /// The network g.
    pub field: FieldConfig,
    /// How a denser surface is made of the points. Default `bsp`.
    pub parameterization: Parameterization,
    /// The sizes of BSP; `patch` and, where they learn, `channels` hold for the other parameterizations, too.
    pub bsp: BspConfig,
    /// Steps on L_para alone before the training. Default 30, paper 0.
    pub bsp_pretrain: usize,
    /// Whether S covers the field's first shape in the pretraining, and not the points alone. Default true.
    pub bsp_pretrain_on_shape: bool,
    /// The parameterization is trained in every this many-th step of the training. `None` (`never`) freezes it after
    /// its pretraining (the paper's ablation without L_deform for BSP). Default 6, paper 1.
    pub bsp_every: Option<usize>,
    /// The shape that the field starts as.
    pub start: Start,
    /// What the extracted surface is drawn to. Default `surface-and-cloud`, paper `surface`.
    pub target: Target,
    /// How grid vertices move (equation 4). Default `projection`.
    pub deformation: Deformation,
    /// Weights of the loss terms.
    pub weights: Weights,
    /// Resolutions and steps of the training, in order. With none (`none`), nothing is trained, and the result is the
    /// first shape itself. Default `32:60,48:60`, which is 60 steps on 32 cubes a side and then 60 on 48.
    pub stages: Vec<Stage>,
    /// Reference area (working frame). Resolutions in `stages` are multiplied by the square root of this over the area
    /// of the first shape, by 0.5 to 4 and up to 192 cubes, so that the surface crosses about as many cubes whatever
    /// the shape. The first shape itself is taken from grids by a rule of its own. `None` (`off`) trains on the grids
    /// of `stages`, as the paper does. Default 2.2.
    pub reference_area: Option<f64>,
    /// The active part of the grid.
    pub band: Band,
    /// How many of the denoised points a step uses.
    pub batch: Batch,
    /// Samples drawn on the faces of the extracted surface, from which distances to other points are measured;
    /// distances from other points to the surface are then to its faces. `None` (`off`) takes the vertices of the
    /// surface for both, as the paper does. Default 4,000, which lie more evenly than those vertices.
    pub surface_samples: Option<usize>,
    /// Learning rate of the field over the training. Default base 5e-4, warmup 20, decay `cosine:0.05`.
    pub field_rate: Schedule,
    /// Learning rate of the parameterization over each of its phases. Default base 1e-3, warmup 20, decay
    /// `cosine:0.05`.
    pub bsp_rate: Schedule,
    /// What is done to the field after the training. Default `points`, paper `none`.
    pub finish: Finishing,
    /// Largest Euclidean norm of the gradient of the loss by the field's parameters; a longer one is scaled down to it.
    /// Default `off`, which is `None`.
    pub clip: Option<f64>,
    /// A part of the mesh whose area is below this share of the largest part's area is dropped; 0 keeps all parts. With
    /// `weights.bridge`, gaps to such parts are not bridged in the training either. Default 0.01, paper 0.
    pub min_component: f64,
}

/// The highest frequency of the field's encoding.
pub(in crate::reconstruct) const MAX_FREQUENCY: f32 = 1000.0;
/// The most steps of a stage or phase.
pub(in crate::reconstruct) const MAX_STEPS: usize = 10_000_000;
/// The most samples on the surface.
pub(in crate::reconstruct) const MAX_DRAWN: usize = 10_000_000;

impl Config {
    /// The steps of a phase; none without `stages`. A sphere needs no start, and without a parameterization, or one
    /// that has nothing to learn, there is none to pretrain.
    pub fn steps_in(&self, phase: Phase) -> usize {
        match phase {
            _ if self.stages.is_empty() => 0,
            Phase::Start if self.start.shape == StartShape::Sphere => 0,
            Phase::Start => self.start.steps,
            Phase::Pretrain => match self.parameterization {
                Parameterization::None | Parameterization::Upsample => 0,
                _ => self.bsp_pretrain,
            },
            Phase::Train => self.stages.iter().map(|s| s.steps).sum(),
        }
    }

    /// The steps of all phases together.
    pub fn total_steps(&self) -> usize {
        Phase::ALL.into_iter().map(|phase| self.steps_in(phase)).sum()
    }

    /// The phase of a step of the whole run, from 0, and the step's number within it. Steps beyond the last belong to
    /// the training.
    pub fn phase_at(&self, step: usize) -> (Phase, usize) {
        let mut within = step;
        for phase in [Phase::Start, Phase::Pretrain] {
            let steps = self.steps_in(phase);
            if within < steps {
                return (phase, within);
            }
            within -= steps;
        }
        (Phase::Train, within)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::Preset;

    #[test]
    fn every_step_belongs_to_one_phase() {
        let mut config = Config::preset(Preset::Default);
        config.start.steps = 3;
        config.bsp_pretrain = 2;
        config.stages = vec![Stage { resolution: 8, steps: 1 }, Stage { resolution: 12, steps: 3 }];
        use Phase::{Pretrain, Start, Train};
        let phases = |config: &Config| -> Vec<(Phase, usize)> {
            (0..config.total_steps()).map(|i| config.phase_at(i)).collect()
        };
        let (start, train) = ([(Start, 0), (Start, 1), (Start, 2)], [0, 1, 2, 3].map(|i| (Train, i)));
        let pretrain = [(Pretrain, 0), (Pretrain, 1)];
        assert_eq!(phases(&config), [&start[..], &pretrain, &train].concat());
        assert_eq!(config.phase_at(9), (Train, 4));
        for untrained in [Parameterization::Upsample, Parameterization::None] {
            config.parameterization = untrained;
            assert_eq!(phases(&config), [&start[..], &train].concat());
        }
        config.start.shape = StartShape::Sphere;
        assert_eq!(phases(&config), train);
        // The paper knows no phases.
        let paper = Config::preset(Preset::Paper);
        assert_eq!(paper.total_steps(), paper.steps_in(Train));
    }
}
