//! The signed distance that a run ends with, in the working frame, and the surface that it has.

use super::{Config, Finishing};
use crate::error::{Error, ErrorKind};
use crate::field::Field;
use crate::finish::{FINISHED_POINTS, Finish};
use crate::geometry::{NarrowBandOptions, TetGrid, TriangleBvh, TriangleMesh, extract_mesh};
use crate::start::COARSE;

/// The signed distance that a run ends with, before the corrections of [`Finish`]; working frame.
#[derive(Clone, Debug)]
pub(super) enum FinalShape {
    /// A trained network.
    Learned(Field),
    /// The first shape itself, where nothing was to be trained.
    Found(FoundShape),
}

/// A closed mesh as a signed distance.
#[derive(Clone, Debug)]
pub(super) struct FoundShape {
    /// The mesh, to be saved.
    #[cfg(feature = "checkpoint")]
    pub mesh: TriangleMesh,
    tree: TriangleBvh,
}

impl FoundShape {
    /// # Errors
    /// As [`TriangleBvh::new`] for an empty mesh.
    pub fn new(mesh: TriangleMesh) -> Result<Self, Error> {
        Ok(FoundShape {
            tree: TriangleBvh::new(&mesh)?,
            #[cfg(feature = "checkpoint")]
            mesh,
        })
    }
}

impl FinalShape {
    /// Signed distances at `points` (m x 3).
    pub fn sdf(&self, points: &[[f32; 3]]) -> Vec<f32> {
        match self {
            FinalShape::Learned(field) => field.sdf(points),
            FinalShape::Found(found) => found.tree.signed_distances(points).0,
        }
    }

    /// Signed distances and their gradients at `points` (m x 3).
    pub fn sdf_and_gradient(&self, points: &[[f32; 3]]) -> (Vec<f32>, Vec<[f32; 3]>) {
        match self {
            FinalShape::Learned(field) => field.sdf_and_gradient(points),
            FinalShape::Found(found) => found.tree.signed_distances(points),
        }
    }

    /// The corrections to the shape for `points` (n x 3), if `config` asks for them and there are neither too few
    /// points nor too many.
    ///
    /// # Errors
    /// As [`Finish::fit`].
    pub fn finished_for(&self, points: &[[f32; 3]], config: &Config) -> Result<Option<Finish>, Error> {
        match config.finish {
            Finishing::Points if FINISHED_POINTS.contains(&points.len()) => {
                let (sdf, gradient) = self.sdf_and_gradient(points);
                Finish::fit(points, &sdf, &gradient).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// The gradients of the signed distances at `points` (m x 3).
    pub fn gradient(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        match self {
            FinalShape::Learned(field) => field.gradient(points),
            FinalShape::Found(found) => found.tree.signed_distances(points).1,
        }
    }
}

/// The zero level set of signed distances in the working frame, from a grid of `resolution` cubes a side searched near
/// the `seeds` (n x 3) too, without parts below the share `min_part` of the largest part's area.
///
/// # Errors
/// As [`Reconstruction::mesh`](super::Reconstruction::mesh).
pub(super) fn zero_level_set(
    sdf: &dyn Fn(&[[f32; 3]]) -> Vec<f32>,
    seeds: &[[f32; 3]],
    resolution: usize,
    min_part: f64,
) -> Result<TriangleMesh, Error> {
    let grid = TetGrid::working_frame(resolution)?;
    let options = NarrowBandOptions { coarse_resolution: COARSE, seeds, ..Default::default() };
    let mesh = extract_mesh(&grid, &mut |x: &[[f32; 3]]| Ok(sdf(x)), &options).map_err(|e| {
        if e.kind() == ErrorKind::NoSurface {
            return e.advise("raise the resolution, or train for more steps where anything is trained");
        }
        e
    })?;
    Ok(mesh.keep_large(min_part))
}
