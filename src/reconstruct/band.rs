//! The active part of the grid: where it is searched for, kept, and marched through.

#[cfg(feature = "checkpoint")]
use super::Phase;
use super::Trainer;
use super::phases::train::Sampled;
use crate::autodiff::Tape;
use crate::error::{Error, ErrorKind};
use crate::field::FieldPass;
use crate::geometry::{BandTopology, Isosurface, NarrowBandOptions, TetGrid, TriangleBvh, active_set};
use crate::start::resolution_for_area;

/// What steps work with and nothing outlives them for.
#[derive(Default)]
pub(super) struct Workspace {
    pub tape: Tape,
    pub pass: FieldPass,
    pub band: Option<Band>,
    pub iso: Isosurface,
    /// Over the faces of the surface, built anew in each step that asks for it.
    pub tree: Option<TriangleBvh>,
    /// Where a test has put an empty cell, the first step leaves its samples on the faces in it and all later ones take
    /// these, since the loss jumps where a sample moves to another face.
    #[cfg(test)]
    pub held_samples: Option<std::sync::OnceLock<crate::gdo::FaceSamples>>,
}

impl Workspace {
    /// Forgets the band and what the last step left.
    pub fn reset(&mut self) {
        self.tape.clear();
        self.pass.release();
        self.band = None;
    }
}

/// The active part of the grid.
pub(super) struct Band {
    pub resolution: usize,
    pub verts: Vec<[f32; 3]>,
    /// Active vertices on the border of the grid, where the field counts as outside, so that the surface is closed.
    pub border: Vec<u32>,
    /// What the field is raised to there.
    pub outside: f32,
    pub topology: BandTopology,
}

/// Cubes along each side of the lattice that the search starts from, at most.
const MAX_COARSE_CUBES: usize = 32;

impl Trainer {
    /// The grid resolution of a step of the training proper: that of its stage, changed by the area of the first shape.
    pub(super) fn resolution_at(&self, step: usize) -> usize {
        let mut end = 0;
        let stages = &self.config.stages;
        let in_stage = |s: &&super::Stage| {
            end += s.steps;
            step < end
        };
        let resolution = stages.iter().find(in_stage).or(stages.last()).map_or(0, |s| s.resolution);
        let area = self.shape.as_ref().map_or(f64::INFINITY, |shape| shape.area);
        resolution_for_area(resolution, area, self.config.reference_area)
    }

    /// Searches for the surface on the grid, if it is time to. Returns whether it was.
    pub(super) fn refresh_band(&mut self) -> Result<bool, Error> {
        let step = self.train_step();
        let resolution = self.resolution_at(step);
        let fresh = self.work.band.as_ref().is_some_and(|b| b.resolution == resolution);
        if fresh && !step.is_multiple_of(self.config.band.refresh) {
            return Ok(false);
        }
        self.build_band(resolution)?;
        Ok(true)
    }

    /// Searches for the surface on the grid by the present field.
    pub(super) fn build_band(&mut self, resolution: usize) -> Result<(), Error> {
        self.work.band = Some(self.band_of(resolution)?);
        Ok(())
    }

    /// The active part of a grid by the present field.
    pub(super) fn band_of(&self, resolution: usize) -> Result<Band, Error> {
        let grid = TetGrid::working_frame(resolution)?;
        let field = &self.field;
        let mut eval = |x: &[[f32; 3]]| Ok(field.sdf(x));
        // Half the resolution: what is thinner and not near the cloud no point asks for.
        let options = NarrowBandOptions {
            coarse_resolution: (resolution / 2).clamp(1, MAX_COARSE_CUBES),
            seeds: &self.cloud,
            ..Default::default()
        };
        let active = active_set(&grid, &mut eval, &options, self.config.band.rings)?;
        let on_border = |&(_, &id): &(u32, &u32)| grid.is_border(grid.vertex_coords(id));
        Ok(Band {
            resolution,
            border: (0..).zip(&active.ids).filter(on_border).map(|(i, _)| i).collect(),
            outside: 1e-3 * grid.spacing(),
            topology: active.topology(),
            verts: active.positions,
        })
    }

    /// Builds the band of the step that last searched for it, by the field as it was then: for a resumed run.
    #[cfg(feature = "checkpoint")]
    pub(super) fn rebuild_band(&mut self) -> Result<(), Error> {
        let now = self.snapshot();
        let good = self.good.clone();
        self.restore(&good);
        // A state of an earlier phase has no band.
        if now.step > good.step && self.phase() == Phase::Train {
            self.build_band(self.resolution_at(self.train_step()))?;
        }
        let band = self.work.band.take();
        self.restore(&now);
        self.work.band = band;
        Ok(())
    }

    /// Finds which edges of the band the surface crosses.
    pub(super) fn march(&mut self, sampled: &Sampled) -> Result<(), Error> {
        let Workspace { band, iso, .. } = &mut self.work;
        let topology = &band.as_ref().expect("refreshed first").topology;
        let sdf = &sampled.values.sdf.data()[..topology.vert_count()];
        let inside: Vec<bool> = sdf.iter().map(|&s| s < 0.0).collect();
        topology.march_into(&inside, iso);
        if iso.faces.is_empty() {
            return Err(Error::new(ErrorKind::NoSurface, "the surface vanished during training"));
        }
        Ok(())
    }
}
