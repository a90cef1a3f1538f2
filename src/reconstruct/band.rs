//! The active part of the grid: the tetrahedra around the surface, which a step of the training works on.

use super::phases::{Stop, go_on};
use crate::error::Error;
use crate::field::Field;
use crate::geometry::{BandTopology, NarrowBandOptions, TetGrid, active_set};

/// The most cubes along each side of the lattice that the search starts from.
const MAX_COARSE_CUBES: usize = 32;

/// The active part of a grid for the field as it was when the search was made.
pub(super) struct ActiveBand {
    /// Cubes along each side of the grid.
    pub resolution: usize,
    /// Active vertices before the move, v x 3, working frame.
    pub verts: Vec<[f32; 3]>,
    /// Active vertices on the border of the grid, where the field counts as outside, so that the surface is closed.
    pub border: Vec<u32>,
    /// The value that the field is raised to at these vertices.
    pub outside: f32,
    /// The tetrahedra between the active vertices.
    pub topology: BandTopology,
}

impl ActiveBand {
    /// Searches for the surface of `field` on a grid, on a coarse lattice and near the `denoised` points (n x 3,
    /// working frame), with `rings` rings of cubes around those that the surface crosses. `stop` is called before each
    /// part of the grid.
    ///
    /// # Errors
    /// As [`active_set`], and as [`go_on`].
    pub fn find(
        field: &Field,
        denoised: &[[f32; 3]],
        resolution: usize,
        rings: usize,
        stop: Stop<'_>,
    ) -> Result<Self, Error> {
        let grid = TetGrid::working_frame(resolution)?;
        // Half the resolution: a thinner part of the surface that is near no denoised point is not wanted.
        let options = NarrowBandOptions {
            coarse_resolution: (resolution / 2).clamp(1, MAX_COARSE_CUBES),
            seeds: denoised,
            ..Default::default()
        };
        let mut sdf = |x: &[[f32; 3]]| go_on(stop).map(|()| field.sdf(x));
        let active = active_set(&grid, &mut sdf, &options, rings)?;
        let on_border = |&(_, &id): &(u32, &u32)| grid.is_border(grid.vertex_coords(id));
        Ok(ActiveBand {
            resolution,
            border: (0..).zip(&active.ids).filter(on_border).map(|(i, _)| i).collect(),
            outside: 1e-3 * grid.spacing(),
            topology: active.topology(),
            verts: active.positions,
        })
    }
}
