//! [`SurfaceMap`]: one type for all parameterizations.

use super::{Atlas, Bsp, BspConfig, Neighbourhood, ParameterizedSurface, Upsample};
use crate::autodiff::{Tape, Var};
use crate::nn::{Bound, Params};
use crate::random::Random;
use crate::tensor::Tensor;
use std::sync::Arc;

/// How a denser surface S is made of the points Q; all but the first are the paper's ablations of BSP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Parameterization {
    /// Bijective surface parameterization: local patches on the sphere.
    Bsp,
    /// No S: the surface is drawn to Q alone ("Sparse").
    None,
    /// Interpolation between neighbours, with nothing to learn ("Upsample").
    Upsample,
    /// One perceptron from the sphere to space ("Single").
    Single,
    /// Several perceptrons, each from a square of its own to space ("Multiple"; AtlasNet).
    Multiple {
        /// The number of perceptrons.
        maps: usize,
    },
}

/// The most points that a global map puts on its surface, all of which are computed in every step.
const MAX_GLOBAL_CODES: usize = 40_960;

/// A parameterization with its parameters: it computes S from the points Q.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum SurfaceMap {
    /// Learned local patches: M points of S for each point of Q.
    Bsp(Box<Bsp>),
    /// Global maps: points of S do not belong to points of Q.
    Atlas(Atlas),
    /// Interpolation: M points of S for each point of Q, with nothing to learn.
    Upsample(Upsample),
}

impl SurfaceMap {
    /// The map for Q, `points` (n x 3, working frame); `None` for [`Parameterization::None`]. The global maps
    /// have as many points as BSP would, n M, up to 40,960.
    ///
    /// # Panics
    /// As [`Bsp::new`] and [`Atlas::sphere`].
    #[track_caller]
    pub fn new(
        parameterization: Parameterization,
        config: BspConfig,
        points: &[[f32; 3]],
        rng: &mut Random,
    ) -> Option<Self> {
        let codes = (points.len() * config.patch).min(MAX_GLOBAL_CODES);
        let c = config.channels;
        Some(match parameterization {
            Parameterization::None => return None,
            Parameterization::Bsp => SurfaceMap::Bsp(Box::new(Bsp::new(config, points, rng))),
            Parameterization::Upsample => SurfaceMap::Upsample(Upsample::new(points, config.patch)),
            Parameterization::Single => SurfaceMap::Atlas(Atlas::sphere(codes, c, rng)),
            Parameterization::Multiple { maps } => {
                SurfaceMap::Atlas(Atlas::squares(maps, codes.div_ceil(maps), c, rng))
            }
        })
    }

    /// The parameters.
    pub fn params(&self) -> &Params {
        match self {
            SurfaceMap::Bsp(bsp) => bsp.params(),
            SurfaceMap::Atlas(atlas) => atlas.params(),
            SurfaceMap::Upsample(upsample) => upsample.params(),
        }
    }

    /// The parameters, for an optimiser to change.
    pub fn params_mut(&mut self) -> &mut Params {
        match self {
            SurfaceMap::Bsp(bsp) => bsp.params_mut(),
            SurfaceMap::Atlas(atlas) => atlas.params_mut(),
            SurfaceMap::Upsample(upsample) => upsample.params_mut(),
        }
    }

    /// The parts of Q, `points` (n x 3), of at most `size` centres each, for each of which S is computed at a time; one
    /// for a global map. Unit `normals` (n x 3) tell the sheets of the surface apart, for maps that look at neighbours.
    ///
    /// # Panics
    /// If there are no points, `size` is 0, or there is not one normal a point.
    #[track_caller]
    pub fn blocks(
        &self,
        points: &[[f32; 3]],
        normals: Option<&[[f32; 3]]>,
        size: usize,
    ) -> Vec<Neighbourhood> {
        match self {
            SurfaceMap::Bsp(bsp) => Neighbourhood::blocks(points, normals, bsp.config(), size),
            SurfaceMap::Atlas(_) => vec![Neighbourhood::without_neighbours(points.len())],
            SurfaceMap::Upsample(_) => Neighbourhood::bare_blocks(points, size),
        }
    }

    /// The distances to the n points Q up to which the points of S of a block add nothing to L_para, as
    /// [`Neighbourhood::slack`]; `None` for other maps than BSP.
    pub fn slack(&self, block: &Neighbourhood, n: usize) -> Option<Arc<[f32]>> {
        match self {
            SurfaceMap::Bsp(bsp) => block.slack(bsp.config(), n),
            SurfaceMap::Atlas(_) | SurfaceMap::Upsample(_) => None,
        }
    }

    /// The number of points on S for n points Q; the same for any n if the map is global.
    pub fn surface_len(&self, n: usize) -> usize {
        match self {
            SurfaceMap::Bsp(bsp) => n * bsp.config().patch,
            SurfaceMap::Atlas(atlas) => atlas.surface_len(),
            SurfaceMap::Upsample(upsample) => n * upsample.patch(),
        }
    }

    /// Points of S for each point of Q, where they come patch by patch.
    fn patch(&self) -> Option<usize> {
        match self {
            SurfaceMap::Bsp(bsp) => Some(bsp.config().patch),
            SurfaceMap::Atlas(_) => None,
            SurfaceMap::Upsample(upsample) => Some(upsample.patch()),
        }
    }

    /// A block's part of S. `context` is p x 3: the points of `block.context()`.
    ///
    /// # Panics
    /// If `context` does not fit the block.
    #[track_caller]
    pub fn forward(&self, tape: &mut Tape, p: &Bound, context: Var, block: &Neighbourhood) -> Var {
        match self {
            SurfaceMap::Bsp(bsp) => bsp.forward(tape, p, context, block).surface,
            SurfaceMap::Atlas(atlas) => atlas.forward(tape, p),
            SurfaceMap::Upsample(upsample) => upsample.forward(tape, block),
        }
    }

    /// The rows of S that come from a point of Q; all rows for a global map.
    pub fn rows_of(&self, point: u32) -> std::ops::Range<usize> {
        match self.patch() {
            Some(patch) => point as usize * patch..(point as usize + 1) * patch,
            None => 0..self.surface_len(0),
        }
    }

    /// Puts a block's part of S, as [`forward`](Self::forward) gives it, into its rows of the whole.
    ///
    /// # Panics
    /// If a number of points does not fit.
    #[track_caller]
    pub fn place(&self, block: &Neighbourhood, part: &[[f32; 3]], surface: &mut [[f32; 3]]) {
        match self.patch() {
            Some(patch) => {
                let patches = part.chunks_exact(patch);
                assert!(patches.len() == block.centres().len(), "place: {} points of S", part.len());
                for (&centre, patch) in block.centres().iter().zip(patches) {
                    surface[self.rows_of(centre)].copy_from_slice(patch);
                }
            }
            None => surface.copy_from_slice(part),
        }
    }

    /// All of S (i x 3) for Q, `points` (n x 3), block by block and without gradients.
    pub fn surface(&self, points: &[[f32; 3]], blocks: &[Neighbourhood]) -> Vec<[f32; 3]> {
        self.forward_all(points, blocks).0
    }

    /// All of S for Q, `points` (n x 3) with the codes that it comes from, block by block and without gradients.
    pub fn parameterize(&self, points: &[[f32; 3]], blocks: &[Neighbourhood]) -> ParameterizedSurface {
        let (surface, codes) = self.forward_all(points, blocks);
        let codes = match self {
            SurfaceMap::Bsp(bsp) => Some(bsp.codes(codes)),
            SurfaceMap::Atlas(_) | SurfaceMap::Upsample(_) => None,
        };
        ParameterizedSurface { points: points.to_vec(), surface, codes }
    }

    /// S (i x 3) and the codes of the points (n x 3), which only BSP has; other maps leave them 0.
    fn forward_all(&self, points: &[[f32; 3]], blocks: &[Neighbourhood]) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
        let mut surface = vec![[0.0; 3]; self.surface_len(points.len())];
        let mut codes = vec![[0.0; 3]; points.len()];
        let mut tape = Tape::new();
        for block in blocks {
            tape.clear();
            let p = self.params().bind(&mut tape, false);
            let context: Vec<[f32; 3]> = block.context().iter().map(|&i| points[i as usize]).collect();
            let context = tape.constant(Tensor::from_points(&context));
            let part = match self {
                SurfaceMap::Bsp(bsp) => {
                    let out = bsp.forward(&mut tape, &p, context, block);
                    let own = tape.value(out.codes).to_points();
                    block.centres().iter().zip(own).for_each(|(&i, code)| codes[i as usize] = code);
                    out.surface
                }
                SurfaceMap::Atlas(_) | SurfaceMap::Upsample(_) => self.forward(&mut tape, &p, context, block),
            };
            self.place(block, &tape.value(part).to_points(), &mut surface);
        }
        (surface, codes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::normal;

    #[test]
    fn blocks_give_the_surface_that_the_whole_gives_where_their_context_is_complete() {
        // With all points in every context the blocks differ from the whole in nothing but the order of sums.
        let points = normal(&[21, 3], 3).to_points();
        let config = BspConfig {
            neighbours: 4,
            reach: Some(21),
            ..super::super::config::tests::small(Some(21), true)
        };
        let map = SurfaceMap::new(Parameterization::Bsp, config, &points, &mut Random::new(1)).unwrap();
        let whole = map.surface(&points, &map.blocks(&points, None, 100));
        let blocks = map.blocks(&points, None, 6);
        assert!(blocks.len() > 3);
        for (a, b) in whole.iter().zip(map.surface(&points, &blocks)) {
            assert!((0..3).all(|d| (a[d] - b[d]).abs() < 1e-4), "{a:?} {b:?}");
        }
    }

    #[test]
    fn the_codes_of_points_are_those_that_their_surface_comes_from() {
        let points = normal(&[21, 3], 3).to_points();
        let config =
            BspConfig { neighbours: 4, reach: Some(5), ..super::super::config::tests::small(Some(5), true) };
        let map = SurfaceMap::new(Parameterization::Bsp, config, &points, &mut Random::new(1)).unwrap();
        let SurfaceMap::Bsp(bsp) = &map else { panic!("asked for BSP") };
        let blocks = map.blocks(&points, None, 6);
        let all = map.parameterize(&points, &blocks);
        assert_eq!((&all.points, &all.surface), (&points, &map.surface(&points, &blocks)));
        let codes = all.codes.as_ref().unwrap();
        assert_eq!((codes.points.len(), codes.patches.len(), codes.sphere), (21, 63, 63));
        for block in &blocks {
            let mut tape = Tape::new();
            let p = map.params().bind(&mut tape, false);
            let context: Vec<[f32; 3]> = block.context().iter().map(|&i| points[i as usize]).collect();
            let context = tape.constant(Tensor::from_points(&context));
            let out = bsp.forward(&mut tape, &p, context, block);
            let (u, patches) = (tape.value(out.codes).to_points(), tape.value(out.patches).to_points());
            for (i, &centre) in block.centres().iter().enumerate() {
                assert_eq!(codes.points[centre as usize], u[i]);
                for (a, b) in codes.patches[map.rows_of(centre)].iter().zip(&patches[3 * i..]) {
                    assert!((0..3).all(|d| (a[d] - b[d]).abs() < 1e-6), "{a:?} {b:?}");
                }
            }
        }
        let coverage = all.coverage().unwrap();
        assert!(coverage.codes.unwrap().used <= 63 && coverage.distinct <= 63);
    }

    #[test]
    fn interpolation_is_the_same_in_blocks_and_has_no_parameters() {
        let points = normal(&[40, 3], 3).to_points();
        let config = super::super::config::tests::small(Some(4), true);
        let map = SurfaceMap::new(Parameterization::Upsample, config, &points, &mut Random::new(1)).unwrap();
        assert!(map.params().is_empty());
        let blocks = map.blocks(&points, None, 6);
        assert!(blocks.len() > 6);
        assert_eq!(map.surface(&points, &blocks), map.surface(&points, &map.blocks(&points, None, 40)));
        let surface = map.surface(&points, &blocks);
        assert_eq!(surface[map.rows_of(7)], surface[21..24]);
    }

    #[test]
    fn every_parameterization_gives_its_number_of_points() {
        let points = normal(&[9, 3], 3).to_points();
        for (kind, want) in [
            (Parameterization::Bsp, 27),
            (Parameterization::Upsample, 27),
            (Parameterization::Single, 27),
            (Parameterization::Multiple { maps: 5 }, 30),
        ] {
            let config = super::super::config::tests::small(Some(4), true);
            let map = SurfaceMap::new(kind, config, &points, &mut Random::new(1)).unwrap();
            let surface = map.surface(&points, &map.blocks(&points, None, 4));
            assert_eq!((surface.len(), map.surface_len(9)), (want, want));
            assert!(surface.iter().flatten().all(|x| x.is_finite()));
            let all = map.parameterize(&points, &map.blocks(&points, None, 4));
            assert_eq!((all.surface, all.codes.is_some()), (surface, kind == Parameterization::Bsp));
        }
        let mut rng = Random::new(1);
        let none = Parameterization::None;
        assert!(
            SurfaceMap::new(none, super::super::config::tests::small(Some(4), true), &points, &mut rng)
                .is_none()
        );
    }
}
