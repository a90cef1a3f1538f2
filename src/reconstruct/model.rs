//! The result: a field and what comes with it, in the input's frame.

use super::Config;
use crate::bsp::Coverage;
use crate::error::{Error, ErrorKind};
use crate::gdo::Field;
use crate::geometry::{NarrowBandOptions, Normalizer, TetGrid, TriangleMesh, extract};

/// A signed distance field, the parameterized surface and the cloud that both come from.
///
/// All coordinates and distances are in the frame and units of the input points.
#[derive(Clone, Debug)]
pub struct Reconstruction {
    pub(super) config: Config,
    pub(super) normalizer: Normalizer,
    /// Distinct points, input frame.
    pub(super) cloud: Vec<[f32; 3]>,
    pub(super) field: Field,
    /// S, working frame.
    pub(super) surface: Vec<[f32; 3]>,
    pub(super) coverage: Option<Coverage>,
    pub(super) notices: Vec<String>,
}

impl Reconstruction {
    /// Signed distances at `points` (n x 3), negative inside, in the input's unit.
    ///
    /// Accurate near the surface; far away only the sign and the order of magnitude are meant.
    pub fn sdf(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let scale = self.normalizer.scale();
        let mut sdf = self.field.sdf(&self.normalizer.forward(points));
        sdf.iter_mut().for_each(|s| *s = (f64::from(*s) * scale) as f32);
        sdf
    }

    /// The gradients of [`sdf`](Self::sdf) at `points` (n x 3): outward, of about unit length, without unit.
    pub fn gradient(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        // Distance and place are scaled alike, so the slope is that of the working frame.
        self.field.gradient(&self.normalizer.forward(points))
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
        let mut mesh = zero_level_set(&self.field, &seeds, resolution, self.config.min_component)?;
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

/// The zero level set of a field, in the working frame, from a grid of `resolution` cubes a side searched near the
/// `seeds` (n x 3) too, without parts below the share `min_part` of the largest part's area.
///
/// # Errors
/// As [`Reconstruction::mesh`].
pub(super) fn zero_level_set(
    field: &Field,
    seeds: &[[f32; 3]],
    resolution: usize,
    min_part: f64,
) -> Result<TriangleMesh, Error> {
    let grid = TetGrid::working_frame(resolution)?;
    let options = NarrowBandOptions { seeds, ..Default::default() };
    let mesh = extract(&grid, &mut |x: &[[f32; 3]]| Ok(field.sdf(x)), &options).map_err(|e| {
        if e.kind() == ErrorKind::NoSurface {
            return e.advise("raise the resolution, or train for more steps");
        }
        e
    })?;
    Ok(mesh.keep_large(min_part))
}
