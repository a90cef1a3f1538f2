//! Preparation of a run: from the input points to the first state.

use super::first_shape::FirstShape;
use super::frame::WorkingFrame;
use super::shape_samples::ShapeSamples;
use super::state::State;
use super::{Config, Hints, Stage, StartShape};
use crate::bsp::{Neighbourhood, SurfaceMap};
use crate::error::{Error, ErrorKind};
use crate::field::Field;
use crate::gdo::Deformation;
use crate::geometry::{Position, TetGrid, clean_cloud, evened, thin_points};
use crate::random::Random;
use crate::start::resolution_for_area;
use rand::seq::SliceRandom;

/// The stream of random numbers that orders the denoised points; weights take stream 0, training step i takes i + 1.
const ORDER_STREAM: u64 = u64::MAX;
/// The fewest input points that are made even if they lie on scan lines.
const MIN_EVENED: usize = 2000;
/// The fewest points that thinning may leave; otherwise all are kept.
const MIN_THINNED: usize = 64;

/// Checked input points and the options for them.
pub(super) struct Prepared {
    /// Adapted to the number of points.
    pub config: Config,
    /// The input points without duplicates, sorted, n x 3, input frame.
    pub input: Vec<[f64; 3]>,
    /// Normals at the input points, n x 3, of unit length or zero, where they are given.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Points left out as duplicates.
    pub merged: usize,
    pub frame: WorkingFrame,
}

/// Checks points (n x 3, any frame) and options.
///
/// # Panics
/// If there are normals, but not one a point.
#[track_caller]
pub(super) fn prepare<P: Position>(
    points: &[P],
    config: &Config,
    hints: &Hints<'_>,
) -> Result<Prepared, Error> {
    let given = hints.normals.map_or(points.len(), <[_]>::len);
    assert!(given == points.len(), "hints: {given} normals for {} points", points.len());
    config.validate()?;
    if hints.normals.is_some() && config.start.shape == StartShape::Sphere {
        return Err(Error::new(
            ErrorKind::Config,
            "normals are of no use for a field that starts as a sphere",
        )
        .at_element("option start.shape")
        .advise("take another start.shape, such as plate, or leave the normals out"));
    }
    let clean = clean_cloud(points)?.sorted();
    let frame = WorkingFrame::of(&clean.points, hints.anisotropy.unwrap_or([1.0; 3]))?;
    Ok(Prepared {
        config: config.clone().for_points(clean.points.len()),
        normals: hints.unit_normals(&clean.given, &frame),
        input: clean.points,
        merged: clean.duplicates_merged,
        frame,
    })
}

/// The part of a run that no step changes. It follows from the input points, the options and the hints.
pub(super) struct Setup {
    pub config: Config,
    /// The input points, distinct and sorted, input frame.
    pub input: Vec<[f64; 3]>,
    /// Their normals, if given, n x 3, of unit length or zero; a checkpoint stores a fingerprint of them.
    #[cfg(feature = "checkpoint")]
    pub normals: Option<Vec<[f32; 3]>>,
    pub frame: WorkingFrame,
    /// The denoised points, n x 3, working frame: the working points (the input points, made even if they lie on scan
    /// lines, and thinned if there are many and they are trained) without the noise that was found; the working points
    /// themselves if none was. They may be fewer than the input points.
    pub denoised: Vec<[f32; 3]>,
    /// A permutation of the denoised points (n): if there are more than one step may use, steps take consecutive parts
    /// of it.
    pub order: Vec<u32>,
    /// Blocks of the denoised points; S is computed one block at a time. None without a map.
    pub blocks: Vec<Neighbourhood>,
    /// The shape that the field learns first; none where it starts as a sphere.
    pub shape: Option<FirstShape>,
    /// Points on that shape for S to cover in its pretraining.
    pub samples: Option<ShapeSamples>,
}

impl Setup {
    /// Makes the working points of the input points, finds the first shape and the denoised points, and builds field,
    /// map and blocks for the denoised points.
    ///
    /// # Errors
    /// [`ErrorKind::NoSurface`](crate::ErrorKind::NoSurface) if no first shape is found.
    pub fn new(prepared: Prepared) -> Result<(Setup, State), Error> {
        let Prepared { config, input, normals, frame, .. } = prepared;
        let (all, normals_of_all) = evenly(frame.forward(&input), normals.as_deref());
        let (working, sides) = match thinned(&all, &config) {
            Some(kept) => {
                let of = |rows: &[[f32; 3]]| kept.iter().map(|&i| rows[i as usize]).collect::<Vec<_>>();
                (of(&all), normals_of_all.as_deref().map(of))
            }
            None => (all, normals_of_all),
        };
        let shape = FirstShape::find(&working, sides.as_deref(), &config)?;
        let found = shape.as_ref().and_then(|shape| shape.denoised.as_ref());
        let denoised = found.map_or(working, |found| found.points.clone());

        let mut rng = Random::new(config.seed);
        let field = initial_field(&config, &mut rng);
        let map = SurfaceMap::new(config.parameterization, config.bsp, &denoised, &mut rng);
        let mut order: Vec<u32> = (0..denoised.len() as u32).collect();
        rng.set_stream(ORDER_STREAM);
        order.shuffle(rng.source());

        let outward = shape.as_ref().map(|shape| &shape.normals[..]);
        let size = config.batch.centres;
        let blocks = map.as_ref().map_or_else(Vec::new, |map| map.blocks(&denoised, outward, size));
        let points_of_s = map.as_ref().map_or(0, |map| map.surface_len(denoised.len()));
        let samples = match &shape {
            Some(shape) => Some(ShapeSamples::of(&shape.mesh, &denoised, points_of_s, config.seed)?),
            None => None,
        };
        let state = State::new(field, map, points_of_s);
        let setup = Setup {
            config,
            input,
            #[cfg(feature = "checkpoint")]
            normals,
            frame,
            denoised,
            order,
            blocks,
            shape,
            samples,
        };
        Ok((setup, state))
    }

    /// The grid resolution of a step of the training proper: that of its stage, changed by the area of the first shape.
    pub fn resolution_at(&self, step: usize) -> usize {
        let mut end = 0;
        let stages = &self.config.stages;
        let in_stage = |s: &&Stage| {
            end += s.steps;
            step < end
        };
        let resolution = stages.iter().find(in_stage).or(stages.last()).map_or(0, |s| s.resolution);
        let area = self.shape.as_ref().map_or(f64::INFINITY, |shape| shape.area);
        let usual = self.config.reference_area;
        usual.map_or(resolution, |usual| resolution_for_area(resolution, area, usual))
    }

    /// The root mean square of the distances from the working points to the denoised points, working frame; 0 if no
    /// noise was found.
    pub fn noise_removed(&self) -> f64 {
        let denoised = self.shape.as_ref().and_then(|shape| shape.denoised.as_ref());
        denoised.map_or(0.0, |denoised| denoised.moved)
    }
}

/// Points (n x 3, working frame) with means in place of those that lie close to each other along scan lines, if there
/// are many, and the normals of the points that this leaves.
fn evenly(points: Vec<[f32; 3]>, normals: Option<&[[f32; 3]]>) -> (Vec<[f32; 3]>, Option<Vec<[f32; 3]>>) {
    let found = if points.len() >= MIN_EVENED { evened(&points) } else { None };
    match found {
        None => (points, normals.map(<[_]>::to_vec)),
        Some(even) => {
            let normals = normals.map(|normals| even.directions(normals));
            (even.points, normals)
        }
    }
}

/// The indices of those of many points (n x 3, working frame) that become working points; `None` for all.
fn thinned(points: &[[f32; 3]], config: &Config) -> Option<Vec<u32>> {
    let finest = config.stages.iter().map(|s| s.resolution).max();
    let grid = finest.and_then(|resolution| TetGrid::working_frame(resolution).ok());
    match (grid, config.batch.thin) {
        (Some(grid), Some(cubes)) if points.len() > config.batch.points => {
            let kept = thin_points(points, cubes * grid.spacing());
            // A dense heap with a far outlier would become a few points: then all points are kept.
            (kept.len() >= MIN_THINNED).then_some(kept)
        }
        _ => None,
    }
}

/// The field as its initial weights make it.
pub(super) fn initial_field(config: &Config, rng: &mut Random) -> Field {
    match config.deformation {
        Deformation::Offset => Field::with_offset(config.field, rng),
        _ => Field::new(config.field, rng),
    }
}
