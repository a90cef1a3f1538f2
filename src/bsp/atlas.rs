//! Global parametric maps, to compare BSP with: perceptrons that depend on the points through the loss only.

use crate::autodiff::{Tape, Var};
use crate::geometry::fibonacci_sphere;
use crate::nn::{Activation, Bound, Mlp, Params};
use crate::random::Random;
use crate::tensor::Tensor;
use std::sync::Arc;

/// One perceptron from the unit sphere to space, or several, each from a unit square of its own.
///
/// s = mlp_j(code) with four linear layers of c channels. One map is a closed surface by construction, as in the
/// method that the paper calls "Single"; several are AtlasNet's patches ("Multiple", Groueix et al. 2018), with nothing
/// that holds them together. Parameters: `atlas.J` (3 or 2 to c to c to c to 3).
#[derive(Clone, Debug)]
pub struct Atlas {
    params: Params,
    maps: Vec<(Mlp, Arc<Tensor>)>,
}

impl Atlas {
    /// One map from `codes` codes of a Fibonacci sphere.
    ///
    /// # Panics
    /// If a size is 0.
    #[track_caller]
    pub fn sphere(codes: usize, channels: usize, rng: &mut Random) -> Self {
        Self::new(1, &Tensor::from_points(&fibonacci_sphere(codes)), channels, rng)
    }

    /// `maps` maps, each from the same `codes` places in the unit square.
    ///
    /// # Panics
    /// If a size is 0.
    #[track_caller]
    pub fn squares(maps: usize, codes: usize, channels: usize, rng: &mut Random) -> Self {
        // The additive sequence of the plastic number fills a square evenly at any length (Roberts 2018).
        const PLASTIC: f64 = 1.324_717_957_244_746;
        let place = |i: usize, d: i32| ((i as f64 + 0.5) * PLASTIC.powi(-d)).fract() as f32;
        let codes_xy = (0..codes).flat_map(|i| [place(i, 1), place(i, 2)]).collect();
        Self::new(maps, &Tensor::from_vec(&[codes, 2], codes_xy), channels, rng)
    }

    #[track_caller]
    fn new(maps: usize, codes: &Tensor, channels: usize, rng: &mut Random) -> Self {
        assert!(maps > 0 && channels > 0 && !codes.is_empty(), "atlas: {maps} maps, {channels} channels");
        let mut params = Params::new();
        let widths = [codes.cols(), channels, channels, channels, 3];
        let codes = Arc::new(codes.clone());
        let map = |j: usize| {
            let mut scope = params.scope("atlas");
            let mlp =
                Mlp::new(&mut scope.scope(&j.to_string()), &widths, Activation::Softplus { beta: 20.0 }, rng);
            (mlp, codes.clone())
        };
        let maps = (0..maps).map(map).collect();
        Atlas { params, maps }
    }

    /// The parameters of all maps.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// The parameters of all maps, to be changed.
    pub fn params_mut(&mut self) -> &mut Params {
        &mut self.params
    }

    /// The number of points i on the surface.
    pub fn surface_len(&self) -> usize {
        self.maps.iter().map(|(_, codes)| codes.rows()).sum()
    }

    /// The surface S, i x 3, map by map. Gradient: smooth.
    pub fn forward(&self, tape: &mut Tape, p: &Bound) -> Var {
        let mut surface = None;
        for (mlp, codes) in &self.maps {
            let codes = tape.shared(codes.clone(), false);
            let part = mlp.forward(tape, p, codes);
            surface = Some(match surface {
                Some(s) => tape.concat_rows([s, part]),
                None => part,
            });
        }
        surface.expect("at least one map")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::check;

    #[test]
    fn gradients_reach_every_parameter() {
        let mut rng = Random::new(4);
        for atlas in [Atlas::sphere(7, 6, &mut rng), Atlas::squares(3, 5, 6, &mut rng)] {
            let inputs: Vec<Tensor> = atlas.params.values().iter().map(|v| (**v).clone()).collect();
            check(|t, x| atlas.forward(t, &Bound::new(x.to_vec())), &inputs, 3);
            let mut tape = Tape::new();
            let p = atlas.params.bind(&mut tape, true);
            let s = atlas.forward(&mut tape, &p);
            assert_eq!(tape.value(s).rows(), atlas.surface_len());
            let squared = tape.square(s);
            let loss = tape.sum(squared);
            for (name, g) in atlas.params.names().zip(p.collect(&mut tape.backward(loss))) {
                let size: f32 = g.unwrap().data().iter().map(|g| g.abs()).sum();
                assert!(size.is_finite() && size > 0.0, "{name}: {size}");
            }
        }
    }

    #[test]
    fn codes_fill_the_square() {
        let atlas = Atlas::squares(2, 64, 4, &mut Random::new(0));
        let mut cells = [0; 16];
        for code in atlas.maps[0].1.data().chunks_exact(2) {
            assert!(code.iter().all(|c| (0.0..1.0).contains(c)));
            cells[(code[0] * 4.0) as usize + 4 * (code[1] * 4.0) as usize] += 1;
        }
        assert!(cells.iter().all(|&c| (2..=6).contains(&c)), "{cells:?}");
    }
}
