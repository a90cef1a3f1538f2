//! The active part of the grid: where it is searched for, kept, and marched through.

#[cfg(feature = "checkpoint")]
use super::Phase;
use super::Trainer;
use super::scale::MOST_RESOLUTION;
use super::step::Sampled;
use crate::autodiff::Tape;
use crate::error::{Error, ErrorKind};
use crate::gdo::FieldPass;
use crate::geometry::{BandTopology, Isosurface, NarrowBandOptions, TetGrid, TriangleBvh, active_set};

/// What steps work with and nothing outlives them for.
#[derive(Default)]
pub(super) struct Workspace {
    pub tape: Tape,
    pub pass: FieldPass,
    pub band: Option<Band>,
    pub iso: Isosurface,
    /// Over the faces of the surface, built anew in each step that asks for it.
    pub tree: Option<TriangleBvh>,
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
const MOST_COARSE_CUBES: usize = 32;

/// What a grid is made finer by at most, and the resolution that this does not take it beyond: that of the finest grid
/// for large clouds, too, whose steps would become many times dearer.
const FINEST: (f64, f64) = (4.0, MOST_RESOLUTION.1);

/// A resolution, a multiple of 4, at which a surface crosses as many cubes as one `ratio` times as large does at the
/// given one; not coarser.
fn finer(resolution: usize, ratio: f64) -> usize {
    let (most, limit) = FINEST;
    let factor = if ratio > 1.0 { ratio.sqrt().min(most).min(limit / resolution as f64) } else { 1.0 };
    let scaled = (resolution as f64 * factor / 4.0).round() as usize * 4;
    if factor > 1.0 { scaled.max(resolution) } else { resolution }
}

impl Trainer {
    /// The grid resolution of a step of the training proper: that of its stage, or finer for a small surface.
    pub(super) fn resolution_at(&self, step: usize) -> usize {
        let mut end = 0;
        let stages = &self.config.stages;
        let in_stage = |s: &&super::Stage| {
            end += s.steps;
            step < end
        };
        let resolution = stages.iter().find(in_stage).or(stages.last()).map_or(0, |s| s.resolution);
        let area = self.shape.as_ref().map_or(f64::INFINITY, |shape| shape.area);
        finer(resolution, self.config.reference_area / area)
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
        let grid = TetGrid::working_frame(resolution)?;
        let field = &self.field;
        let mut eval = |x: &[[f32; 3]]| Ok(field.sdf(x));
        // Half the resolution: what is thinner and not near the cloud no point asks for.
        let options = NarrowBandOptions {
            coarse_resolution: (resolution / 2).clamp(1, MOST_COARSE_CUBES),
            seeds: &self.cloud,
            ..Default::default()
        };
        let active = active_set(&grid, &mut eval, &options, self.config.band.rings)?;
        let on_border = |&(_, &id): &(u32, &u32)| grid.is_border(grid.vertex_coords(id));
        self.work.band = Some(Band {
            resolution,
            border: (0..).zip(&active.ids).filter(on_border).map(|(i, _)| i).collect(),
            outside: 1e-3 * grid.spacing(),
            topology: active.topology(),
            verts: active.positions,
        });
        Ok(())
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

#[cfg(test)]
mod tests {
    use super::finer;

    #[test]
    fn small_surfaces_have_finer_grids_and_large_ones_the_same() {
        for (resolution, ratio, want) in [
            (48, 4.0, 96),
            (48, 1.5, 60),
            (48, 1.0, 48),
            (48, 0.3, 48),
            (48, 0.0, 48),
            (48, f64::NAN, 48),
            (48, f64::INFINITY, 192),
            (48, 100.0, 192),
            (64, 16.0, 192),
            (160, 16.0, 192),
            (300, 16.0, 300),
            (10, 1.01, 12),
        ] {
            assert_eq!(finer(resolution, ratio), want, "{resolution} {ratio}");
        }
    }
}
