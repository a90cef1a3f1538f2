//! Bijective surface parameterization: the cloud is mapped to codes on the unit sphere (Phi), each code gets a patch
//! of neighbouring codes, and the patches are mapped back to space (Psi) as a denser surface S.

mod atlas;
mod canonical;
mod chart;
mod coverage;
mod inverse;
mod layout;
mod neighbourhood;
mod patch;
mod sheets;
mod surface_map;
mod upsample;

pub use atlas::Atlas;
pub use canonical::Canonical;
pub use coverage::{CodeCoverage, Codes, Coverage, Parameterized, code_colour};
pub use inverse::Inverse;
pub use neighbourhood::Neighbourhood;
pub use patch::PatchSampler;
pub use surface_map::{Parameterization, SurfaceMap};
pub use upsample::Upsample;

use crate::autodiff::{Tape, Var};
use crate::nn::{Bound, Params};
use crate::random::Random;

/// The sizes of the parameterization; start from the default.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct BspConfig {
    /// Channels c of features and attention. Default 64, paper 128.
    pub channels: usize,
    /// Attention heads h; c is a multiple of it. Default 4.
    pub heads: usize,
    /// Neighbours k of a point in Phi. Default 8.
    pub neighbours: usize,
    /// Codes M in a patch. Default 10.
    pub patch: usize,
    /// Codes on the whole sphere, as a multiple of n M. With about 1 the patches tile it; the authors' code has 50,000
    /// codes for 300 points, a multiple of 17, whose patches are much smaller than the gaps between points. Default 1.
    pub code_density: f32,
    /// Points whose features a patch attends to: the nearest in space to its centre. `None` (`all`) is all of them, as
    /// in the paper, at a cost of n^2 M; `Some(n)` is the same but for the order of sums. Default 12.
    pub reach: Option<usize>,
    /// Whether Psi averages the positions of the points it attends to and adds a learned offset, instead of making
    /// positions from nothing. Default true, paper false.
    pub average_positions: bool,
    /// Whether codes begin in a layout that fills the sphere evenly and keeps neighbours together, with what the head
    /// of Phi learns added to it. Without, they are what the head makes of the features, as the paper says: all in one
    /// spot at first. Default false; the preset `paper` has true (`benches/paper.md`).
    pub layout: bool,
    /// Whether Psi adds what it learns to a chart of each point: the patch as a disc around the point, with the
    /// point's share of the surface, in the plane of its normal and bent as its neighbours lie. Needs `layout`, and
    /// takes the place of `average_positions`. Default false; the preset `paper` has true (`benches/paper.md`).
    pub charts: bool,
    /// L_para asks nothing of points of S that are nearer to the cloud than this share of their chart's radius: so that
    /// S need not lie on the points to be a surface through them. Has no effect without `charts`. Default 0; the preset
    /// `paper` has 1 (`benches/paper.md`).
    pub slack: f32,
    /// Weight of the turn of the normal in the distance that neighbours are chosen by, where the cloud has normals
    /// (from the field's first shape): sqrt(|p - q|^2 + (normal_weight s)^2 |n_p - n_q|^2), s the distance from p to
    /// its sixth nearest point. It keeps S from bridging sheets that lie close together. 0 is the distance in space, as
    /// in the paper. Default 1.5.
    pub normal_weight: f32,
}

impl Default for BspConfig {
    /// Those of the preset `default`.
    fn default() -> Self {
        BspConfig {
            channels: 64,
            heads: 4,
            neighbours: 8,
            patch: 10,
            code_density: 1.0,
            reach: Some(12),
            average_positions: true,
            layout: false,
            charts: false,
            slack: 0.0,
            normal_weight: 1.5,
        }
    }
}

impl BspConfig {
    /// Codes on the whole sphere for a cloud of n points.
    pub fn codes(&self, n: usize) -> usize {
        let codes = (f64::from(self.code_density) * n as f64 * self.patch as f64).ceil() as usize;
        codes.clamp(self.patch, MAX_CODES.max(self.patch))
    }
}

/// The most codes that a sphere has.
const MAX_CODES: usize = 1 << 24;

/// The two maps with their parameters, for one cloud.
#[derive(Clone, Debug)]
pub struct Bsp {
    config: BspConfig,
    params: Params,
    canonical: Canonical,
    sampler: PatchSampler,
    inverse: Inverse,
    /// How far an output of 1 of Phi's head moves a code from its layout.
    code_step: f32,
}

/// The variables that a forward pass puts on the tape, for the b centres of a block.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct BspOutput {
    /// The codes of the b centres on the unit sphere, b x 3.
    pub codes: Var,
    /// The codes of their patches on the unit sphere, (b M) x 3, patch by patch.
    pub patches: Var,
    /// The part of the parameterized surface S that the patches make, (b M) x 3, in the working frame.
    pub surface: Var,
}

impl Bsp {
    /// Maps for the cloud Q, `points` (n x 3, working frame).
    ///
    /// # Panics
    /// If the cloud is empty, or the channels are not a multiple of the heads.
    #[track_caller]
    pub fn new(config: BspConfig, points: &[[f32; 3]], rng: &mut Random) -> Self {
        let n = points.len();
        let mut params = Params::new();
        let canonical = Canonical::new(&mut params.scope("phi"), config.channels, rng);
        let sampler = PatchSampler::new(config.codes(n), config.patch);
        let inverse = Inverse::new(&mut params.scope("psi"), &config, points, rng);
        Bsp {
            config,
            params,
            canonical,
            sampler,
            inverse,
            code_step: layout::code_step(n, chart::cap_radius(config.patch, config.codes(n))),
        }
    }

    /// The sizes.
    pub fn config(&self) -> &BspConfig {
        &self.config
    }

    /// The codes of a whole cloud with their patches, from the codes of its points (n x 3, unit length).
    pub(super) fn codes(&self, points: Vec<[f32; 3]>) -> Codes {
        let (patches, index) = self.sampler.patches(&points);
        Codes { points, patches, index, sphere: self.sampler.sphere().len() }
    }

    /// The parameters of both maps.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// The parameters of both maps, to be changed.
    pub fn params_mut(&mut self) -> &mut Params {
        &mut self.params
    }

    /// Codes, patches and surface of the centres of a block; `context` (c x 3) holds the points of `block.context()`.
    ///
    /// # Panics
    /// If `context` does not fit the block.
    #[track_caller]
    pub fn forward(&self, tape: &mut Tape, p: &Bound, context: Var, block: &Neighbourhood) -> BspOutput {
        let layout = block.layout().map(|layout| (layout, self.code_step));
        let (features, codes) = self.canonical.forward(tape, p, context, block.neighbours(), layout);
        let b = block.centres().len();
        let codes = if b < block.context().len() { tape.slice_rows(codes, 0..b) } else { codes };
        let patches = self.sampler.forward(tape, codes);
        let surface = self.inverse.forward(tape, p, features, context, patches, block);
        BspOutput { codes, patches, surface }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autodiff::check::{Options, gradient};
    use crate::loss::Direction;
    use crate::ops::testing::normal;
    use crate::tensor::Tensor;

    pub(super) fn small(reach: Option<usize>, average_positions: bool) -> BspConfig {
        BspConfig {
            channels: 8,
            heads: 2,
            neighbours: 4,
            patch: 3,
            code_density: 1.0,
            reach,
            average_positions,
            layout: false,
            charts: false,
            slack: 0.0,
            normal_weight: 1.5,
        }
    }

    #[test]
    fn gradients_reach_every_parameter_in_every_form() {
        let cloud = normal(&[9, 3], 5);
        let points = cloud.to_points();
        for (reach, average, charts) in [
            (None, false, false),
            (None, true, false),
            (Some(4), false, false),
            (Some(4), true, false),
            (None, false, true),
            (Some(4), false, true),
        ] {
            let config = BspConfig { layout: charts, charts, ..small(reach, average) };
            let bsp = Bsp::new(config, &points, &mut Random::new(2));
            let whole = Neighbourhood::whole(&points, None, bsp.config());
            let inputs: Vec<Tensor> = bsp.params.values().iter().map(|v| (**v).clone()).collect();
            // The patches' steps hold the codes that they lead away from, which differences must not move.
            let steps = {
                let mut t = Tape::new();
                let p = bsp.params.bind(&mut t, false);
                let q = t.constant(cloud.clone());
                let out = bsp.forward(&mut t, &p, q, &whole);
                bsp.sampler.steps(&t.value(out.codes).to_points())
            };
            let forward = |t: &mut Tape, x: &[Var]| {
                let p = Bound::new(x.to_vec());
                let q = t.constant(cloud.clone());
                let layout = whole.layout().map(|layout| (layout, bsp.code_step));
                let (features, codes) = bsp.canonical.forward(t, &p, q, whole.neighbours(), layout);
                let patches = bsp.sampler.place(t, codes, &steps);
                let surface = bsp.inverse.forward(t, &p, features, q, patches, &whole);
                t.concat_cols([surface, patches])
            };
            // A short step keeps most directions clear of the many ReLUs' kinks.
            let options = Options { seed: 9, step: 2e-3, ..Options::default() };
            if let Err(failure) = gradient(forward, &inputs, options) {
                panic!("{failure}; {:?}", bsp.params.names().collect::<Vec<_>>());
            }

            let mut tape = Tape::new();
            let p = bsp.params.bind(&mut tape, true);
            let q = tape.constant(cloud.clone());
            let out = bsp.forward(&mut tape, &p, q, &whole);
            let loss = tape.chamfer(out.surface, q, Direction::BOTH);
            let gradients = p.collect(&mut tape.backward(loss));
            // A softmax ignores what shifts all its scores alike.
            let silent =
                ["phi.attention.gamma.layer1.bias", "phi.attention.eta.bias", "psi.block.cross.key.bias"];
            for (name, found) in bsp.params.names().zip(&gradients) {
                let gradient = found.as_ref().unwrap_or_else(|| panic!("{name} has no gradient"));
                let size = gradient.data().iter().map(|g| g.abs()).sum::<f32>();
                assert!(size.is_finite() && (size > 0.0 || silent.contains(&name)), "{name}: {size}");
            }
        }
    }

    #[test]
    fn global_attention_equals_a_reach_of_all_points() {
        let cloud = normal(&[7, 3], 1);
        let points = cloud.to_points();
        let surfaces: Vec<Vec<f32>> = [None, Some(6)]
            .iter()
            .map(|&reach| {
                let bsp = Bsp::new(small(reach, true), &points, &mut Random::new(2));
                let mut whole = Neighbourhood::whole(&points, None, bsp.config());
                if reach.is_some() {
                    // All seven, though a reach of n is otherwise taken as global.
                    whole.attend_to_all(&points);
                }
                let mut tape = Tape::new();
                let p = bsp.params.bind(&mut tape, false);
                let q = tape.constant(cloud.clone());
                let out = bsp.forward(&mut tape, &p, q, &whole);
                tape.value(out.surface).data().to_vec()
            })
            .collect();
        assert!(surfaces[0].iter().zip(&surfaces[1]).all(|(a, b)| (a - b).abs() < 1e-5));
    }
}
