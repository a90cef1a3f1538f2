//! The result: a field and what comes with it, in the input's frame.

use super::{Config, Finishing};
use crate::bsp::Coverage;
use crate::error::{Error, ErrorKind};
use crate::gdo::{FINISHED_POINTS, Field, Finish};
use crate::geometry::{NarrowBandOptions, Normalizer, TetGrid, TriangleBvh, TriangleMesh, extract};
use rayon::prelude::*;

/// A signed distance field, the parameterized surface and the cloud that both come from.
///
/// All coordinates and distances are in the frame and units of the input points.
#[derive(Clone, Debug)]
pub struct Reconstruction {
    pub(super) config: Config,
    pub(super) normalizer: Normalizer,
    /// Distinct points, input frame.
    pub(super) cloud: Vec<[f32; 3]>,
    pub(super) shape: Shape,
    /// What is blended into the shape, if [`Config::finish`] asks for it and the points allow it.
    pub(super) finish: Option<Finish>,
    /// S, working frame.
    pub(super) surface: Vec<[f32; 3]>,
    pub(super) coverage: Option<Coverage>,
    pub(super) notices: Vec<String>,
}

/// What a run ends with before it is finished, in the working frame.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    /// A trained network.
    Learned(Field),
    /// The first shape itself, where nothing was to be trained.
    Found(FoundShape),
}

/// A closed mesh as a signed distance.
#[derive(Clone, Debug)]
pub(super) struct FoundShape {
    pub mesh: TriangleMesh,
    tree: TriangleBvh,
}

impl FoundShape {
    /// # Errors
    /// As [`TriangleBvh::new`] for an empty mesh.
    pub fn new(mesh: TriangleMesh) -> Result<Self, Error> {
        Ok(FoundShape { tree: TriangleBvh::new(&mesh)?, mesh })
    }
}

impl Shape {
    /// Signed distances at `points` (m x 3).
    fn sdf(&self, points: &[[f32; 3]]) -> Vec<f32> {
        match self {
            Shape::Learned(field) => field.sdf(points),
            Shape::Found(found) => points.par_iter().map(|&x| found.tree.signed_distance(x).0).collect(),
        }
    }

    /// What finishes the shape for `points` (n x 3), as far as `config` asks for it and they allow it.
    pub fn finished_for(&self, points: &[[f32; 3]], config: &Config) -> Option<Finish> {
        match config.finish {
            Finishing::Points if FINISHED_POINTS.contains(&points.len()) => {
                Finish::fit(points, &self.sdf(points), &self.gradient(points)).ok()
            }
            _ => None,
        }
    }

    /// Their gradients.
    fn gradient(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        match self {
            Shape::Learned(field) => field.gradient(points),
            Shape::Found(found) => points.par_iter().map(|&x| found.tree.signed_distance(x).1).collect(),
        }
    }
}

/// Half the way between the two places that a derivative of the finished distance is taken from, working frame.
const DIFFERENCE: f32 = 1e-3;

impl Reconstruction {
    /// Signed distances in the working frame, finished.
    fn working_sdf(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let mut sdf = self.shape.sdf(points);
        if let Some(finish) = &self.finish {
            finish.apply(points, &mut sdf, &self.shape.gradient(points));
        }
        sdf
    }

    /// Signed distances at `points` (n x 3), negative inside, in the input's unit.
    ///
    /// Accurate near the surface; far away only the sign and the order of magnitude are meant.
    pub fn sdf(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let scale = self.normalizer.scale();
        let mut sdf = self.working_sdf(&self.normalizer.forward(points));
        sdf.iter_mut().for_each(|s| *s = (f64::from(*s) * scale) as f32);
        sdf
    }

    /// The gradients of [`sdf`](Self::sdf) at `points` (n x 3): outward, of about unit length, without unit. Where the
    /// result is finished ([`Config::finish`]) they are differences over 2e-3 of the longest side.
    pub fn gradient(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        // Distance and place are scaled alike, so the slope is that of the working frame.
        let points = self.normalizer.forward(points);
        if self.finish.is_none() {
            return self.shape.gradient(&points);
        }
        let beside = |axis: usize, step: f32| {
            let mut moved = points.clone();
            moved.iter_mut().for_each(|p| p[axis] += step);
            self.working_sdf(&moved)
        };
        let sides = [0, 1, 2].map(|axis| (beside(axis, DIFFERENCE), beside(axis, -DIFFERENCE)));
        let slope =
            |i: usize| [0, 1, 2].map(|axis| (sides[axis].0[i] - sides[axis].1[i]) / (2.0 * DIFFERENCE));
        (0..points.len()).map(slope).collect()
    }

    /// The zero level set as a closed mesh, from a grid of `resolution` cubes along each side of the cube around the
    /// cloud. Parts below the share `mesh.min_component` of the largest part's area are left out.
    ///
    /// # Errors
    /// [`ErrorKind::NoSurface`] if the field is nowhere negative on the grid,
    /// [`ErrorKind::Config`] for a resolution below 3 or beyond 32-bit vertex numbers,
    /// [`ErrorKind::Diverged`] if the field is not finite.
    pub fn mesh(&self, resolution: usize) -> Result<TriangleMesh, Error> {
        let seeds = self.normalizer.forward(&self.cloud);
        let sdf = |x: &[[f32; 3]]| self.working_sdf(x);
        let mut mesh = zero_level_set(&sdf, &seeds, resolution, self.config.min_component)?;
        mesh.verts = self.normalizer.inverse(&mesh.verts);
        Ok(mesh)
    }

    /// The parameterized surface S, i x 3: what the patches of all points come to; empty without a parameterization.
    pub fn surface_points(&self) -> Vec<[f32; 3]> {
        self.normalizer.inverse(&self.surface)
    }

    /// How well S covers the points that the training worked with (without their noise, and thinned if there are many),
    /// and its codes the sphere, in the working frame.
    ///
    /// `None` without a parameterization, and for a result that was loaded from a file: its field is all that there is
    /// of the training. A checkpoint has the state that this follows from; resume it and finish.
    pub fn coverage(&self) -> Option<&Coverage> {
        self.coverage.as_ref()
    }

    /// The distinct points it was made from, n x 3, as given.
    pub fn cloud(&self) -> &[[f32; 3]] {
        &self.cloud
    }

    /// What a user should know of the file that it was loaded from, such as options that this version does not have;
    /// empty for one that was just made.
    pub fn notices(&self) -> &[String] {
        &self.notices
    }

    /// The options it was made with, adapted to the number of points.
    pub fn config(&self) -> &Config {
        &self.config
    }
}

/// The zero level set of signed distances in the working frame, from a grid of `resolution` cubes a side searched near the
/// `seeds` (n x 3) too, without parts below the share `min_part` of the largest part's area.
///
/// # Errors
/// As [`Reconstruction::mesh`].
pub(super) fn zero_level_set(
    sdf: &dyn Fn(&[[f32; 3]]) -> Vec<f32>,
    seeds: &[[f32; 3]],
    resolution: usize,
    min_part: f64,
) -> Result<TriangleMesh, Error> {
    let grid = TetGrid::working_frame(resolution)?;
    let options = NarrowBandOptions { seeds, ..Default::default() };
    let mesh = extract(&grid, &mut |x: &[[f32; 3]]| Ok(sdf(x)), &options).map_err(|e| {
        if e.kind() == ErrorKind::NoSurface {
            return e.advise("raise the resolution, or train for more steps");
        }
        e
    })?;
    Ok(mesh.keep_large(min_part))
}
