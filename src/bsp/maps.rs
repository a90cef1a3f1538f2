//! The two maps Phi and Psi as one, with their parameters: from the points Q to codes, patches and the surface S.

use super::layout::code_step;
use super::{BspConfig, Canonical, Inverse, Neighbourhood, PatchSampler, SphereCodes, chart};
use crate::autodiff::{Tape, Var};
use crate::nn::{Bound, Params};
use crate::random::Random;

/// The two maps with their parameters, for one set of points Q.
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
    /// Maps for the points Q, `points` (n x 3, working frame).
    ///
    /// # Panics
    /// If there are no points, or the channels are not a multiple of the heads.
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
            code_step: code_step(n, chart::cap_radius(config.patch, config.codes(n))),
        }
    }

    /// The sizes.
    pub fn config(&self) -> &BspConfig {
        &self.config
    }

    /// The codes of all points (n x 3, unit length) with their patches.
    pub(super) fn codes(&self, points: Vec<[f32; 3]>) -> SphereCodes {
        let (patches, index) = self.sampler.patches(&points);
        SphereCodes { points, patches, index, sphere: self.sampler.sphere().len() }
    }

    /// The parameters of both maps.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// The parameters of both maps, to be changed.
    pub fn params_mut(&mut self) -> &mut Params {
        &mut self.params
    }

    /// Codes, patches and surface of the centres of a block; `context` (p x 3) holds the points of `block.context()`.
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
    use super::super::config::tests::small;
    use super::*;
    use crate::autodiff::check::{CheckOptions, gradient};
    use crate::loss::Direction;
    use crate::ops::testing::normal;
    use crate::tensor::Tensor;

    #[test]
    fn gradients_reach_every_parameter_in_every_form() {
        let q = normal(&[9, 3], 5);
        let points = q.to_points();
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
                let q = t.constant(q.clone());
                let out = bsp.forward(&mut t, &p, q, &whole);
                bsp.sampler.steps(&t.value(out.codes).to_points())
            };
            let forward = |t: &mut Tape, x: &[Var]| {
                let p = Bound::new(x.to_vec());
                let q = t.constant(q.clone());
                let layout = whole.layout().map(|layout| (layout, bsp.code_step));
                let (features, codes) = bsp.canonical.forward(t, &p, q, whole.neighbours(), layout);
                let patches = bsp.sampler.place(t, codes, &steps);
                let surface = bsp.inverse.forward(t, &p, features, q, patches, &whole);
                t.concat_cols([surface, patches])
            };
            // A short step keeps most directions clear of the many ReLUs' kinks.
            let options = CheckOptions { seed: 9, step: 2e-3, ..CheckOptions::default() };
            if let Err(failure) = gradient(forward, &inputs, options) {
                panic!("{failure}; {:?}", bsp.params.names().collect::<Vec<_>>());
            }

            let mut tape = Tape::new();
            let p = bsp.params.bind(&mut tape, true);
            let q = tape.constant(q.clone());
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
        let q = normal(&[7, 3], 1);
        let points = q.to_points();
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
                let q = tape.constant(q.clone());
                let out = bsp.forward(&mut tape, &p, q, &whole);
                tape.value(out.surface).data().to_vec()
            })
            .collect();
        assert!(surfaces[0].iter().zip(&surfaces[1]).all(|(a, b)| (a - b).abs() < 1e-5));
    }
}
