//! The signed distance field g: a multilayer perceptron over a Fourier encoding, and how its weights begin.

use super::FieldConfig;
use super::config::MAX_OCTAVES;
use crate::autodiff::{Tape, Var};
use crate::nn::{ParamId, Params};
use crate::random::Random;
use crate::tensor::Tensor;
use rand_distr::{Distribution, Normal};
use std::ops::Range;

/// The field network: n x 3 points in the working frame to n x 1 signed distances, negative inside.
///
/// With an offset there are three more outputs, the displacement of a grid vertex (for
/// `Deformation::Offset` of [`gdo`](crate::gdo)).
///
/// Hidden layer l: h = act(h W_l + b_l), with the encoding joined to its input (both divided by sqrt 2) at `skip`; then
/// a linear layer to one value (or four). Parameters: `field.L.weight` (c_in x c_out) and `field.L.bias` (1 x c_out),
/// geometrically initialised so that g(x) is about |x| - radius (Atzmon and Lipman 2020).
#[derive(Clone, Debug)]
pub struct Field {
    config: FieldConfig,
    params: Params,
    layers: Vec<(ParamId, ParamId)>,
    offset: bool,
}

/// The field's values on a tape, for n points, and the points themselves: what goes on from the values takes the places
/// from here, so that it cannot take others than those of the values.
#[derive(Clone, Copy, Debug)]
pub struct FieldVars {
    /// The points, n x 3, working frame.
    pub points: Var,
    /// g, n x 1.
    pub sdf: Var,
    /// grad g, n x 3.
    pub gradient: Var,
    /// The displacement, n x 3, if the field has one.
    pub offset: Option<Var>,
}

impl FieldVars {
    /// The same at some of the points alone, by their rows.
    pub(crate) fn rows(&self, tape: &mut Tape, rows: Range<usize>) -> FieldVars {
        let mut of = |var: Var| tape.slice_rows(var, rows.clone());
        FieldVars {
            points: of(self.points),
            sdf: of(self.sdf),
            gradient: of(self.gradient),
            offset: self.offset.map(of),
        }
    }
}

/// Standard deviation of the weights that the displacement starts with.
const OFFSET_START: f32 = 1e-3;

impl Field {
    /// A field that starts as a sphere.
    ///
    /// # Panics
    /// If width or depth is 0, the skip is not a hidden layer after the first, or there are more than 32 octaves.
    #[track_caller]
    pub fn new(config: FieldConfig, rng: &mut Random) -> Self {
        Self::build(config, false, rng)
    }

    /// A field that has a displacement (3 values) as a second output besides g; it starts close to 0.
    ///
    /// # Panics
    /// As [`new`](Self::new).
    #[track_caller]
    pub fn with_offset(config: FieldConfig, rng: &mut Random) -> Self {
        Self::build(config, true, rng)
    }

    #[track_caller]
    fn build(config: FieldConfig, offset: bool, rng: &mut Random) -> Self {
        let FieldConfig { width, depth, .. } = config;
        assert!(width > 0 && depth > 0, "field: width {width}, depth {depth}");
        assert!(config.octaves <= MAX_OCTAVES, "field: {} octaves, at most {MAX_OCTAVES}", config.octaves);
        if let Some(skip) = config.skip {
            assert!(skip > 0 && skip < depth, "field: skip at layer {skip} of {depth}");
        }
        let encoded = config.encoding_cols();
        let mut params = Params::new();
        let mut layers = Vec::with_capacity(depth + 1);
        for layer in 0..=depth {
            let from = match layer {
                0 => encoded,
                l if Some(l) == config.skip => width + encoded,
                _ => width,
            };
            let outputs = if offset { 4 } else { 1 };
            let to = if layer == depth { outputs } else { width };
            let mut weight = Tensor::zeros(&[from, to]);
            let mut bias = Tensor::zeros(&[1, to]);
            if layer == depth {
                let normal = Normal::new((std::f32::consts::PI / from as f32).sqrt(), 1e-4).expect("finite");
                let small = Normal::new(0.0, OFFSET_START).expect("finite");
                for (i, w) in weight.data_mut().iter_mut().enumerate() {
                    *w = if i % to == 0 { normal.sample(rng.source()) } else { small.sample(rng.source()) };
                }
                bias.data_mut()[0] = -config.radius;
            } else {
                let normal = Normal::new(0.0, (2.0 / to as f32).sqrt()).expect("finite");
                // Sines and cosines start without influence, so the start is the sphere of a network on x alone.
                let first_encoded = if layer == 0 { 0 } else { width };
                for (i, row) in weight.data_mut().chunks_exact_mut(to).enumerate() {
                    let silent = (layer == 0 || Some(layer) == config.skip) && i >= first_encoded + 3;
                    row.iter_mut().for_each(|w| {
                        let sample = normal.sample(rng.source());
                        *w = if silent { 0.0 } else { sample };
                    });
                }
            }
            let weight = params.add(format!("field.{layer}.weight"), weight);
            let bias = params.add(format!("field.{layer}.bias"), bias);
            layers.push((weight, bias));
        }
        Field { config, params, layers, offset }
    }

    /// The shape of the network.
    pub fn config(&self) -> &FieldConfig {
        &self.config
    }

    /// Whether it has a displacement as a second output besides g.
    pub fn has_offset(&self) -> bool {
        self.offset
    }

    /// Its parameters.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// Its parameters, to be changed.
    pub fn params_mut(&mut self) -> &mut Params {
        &mut self.params
    }

    /// The same network with other parameters, all of them in one row as [`Params::flat`] puts them.
    ///
    /// # Panics
    /// If there are not as many.
    #[track_caller]
    pub(super) fn with_parameters(&self, flat: &[f32]) -> Field {
        Field { params: self.params.with_flat(flat), ..self.clone() }
    }

    /// Columns of all values at a point: g and grad g, and the displacement if there is one.
    pub(crate) fn value_cols(&self) -> usize {
        if self.offset { 7 } else { 4 }
    }

    /// Makes g smaller by `by` everywhere, in units of the working frame.
    pub fn lower(&mut self, by: f32) {
        let (_, bias) = self.layers[self.config.depth];
        self.params.value_mut(bias).data_mut()[0] -= by;
    }

    /// Weight (c_in x c_out) and bias (1 x c_out) of a layer, the linear one at the end being `depth`.
    pub(super) fn layer(&self, l: usize) -> (&Tensor, &Tensor) {
        let (weight, bias) = self.layers[l];
        (self.params.value(weight), self.params.value(bias))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::FieldActivation;
    use crate::nn::Bound;
    use crate::ops::testing::{check, normal};
    use proptest::prelude::*;

    #[test]
    fn octaves_double_and_their_number_is_limited() {
        let config = |octaves: usize| FieldConfig { octaves, ..*small(None, 1, false, 1).config() };
        let frequencies: Vec<f32> = config(32).frequencies().collect();
        assert!((0..32).all(|o| frequencies[o] == 1.5 * (1u64 << o) as f32));
        let refused = std::panic::catch_unwind(|| Field::new(config(33), &mut Random::new(1)));
        let message = refused.unwrap_err();
        assert!(message.downcast_ref::<String>().unwrap().contains("33 octaves"));
    }

    fn small(skip: Option<usize>, octaves: usize, offset: bool, seed: u64) -> Field {
        let activation = FieldActivation::Softplus { beta: 4.0 };
        let config =
            FieldConfig { width: 9, depth: 3, octaves, frequency: 1.5, activation, skip, radius: 0.4 };
        let mut field = Field::build(config, offset, &mut Random::new(seed));
        // Leave the geometric start, at which the waves are silent.
        for id in 0..field.params.len() {
            let id = field.layers[id / 2];
            for id in [id.0, id.1] {
                let noise = normal(field.params.value(id).dims(), seed ^ 77);
                let value = field.params.value_mut(id);
                value.data_mut().iter_mut().zip(noise.data()).for_each(|(w, n)| *w += 0.1 * n);
            }
        }
        field
    }

    fn points(n: usize, seed: u64) -> Vec<[f32; 3]> {
        normal(&[n, 3], seed).to_points().into_iter().map(|p| p.map(|x| 0.3 * x)).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        #[test]
        fn spatial_gradient_agrees_with_differences(skip: bool, offset: bool, octaves in 0usize..3, seed: u64) {
            let field = small(skip.then_some(1), octaves, offset, seed);
            let x = points(5, seed);
            let analytic = field.gradient(&x);
            for d in 0..3 {
                let shifted = |h: f32| -> Vec<f32> {
                    let moved: Vec<[f32; 3]> = x.iter().map(|p| { let mut p = *p; p[d] += h; p }).collect();
                    field.sdf(&moved)
                };
                for (i, (a, b)) in shifted(4e-3).iter().zip(shifted(-4e-3)).enumerate() {
                    let numeric = (a - b) / 8e-3;
                    prop_assert!((numeric - analytic[i][d]).abs() < 2e-3 * (1.0 + numeric.abs()), "{numeric} {}", analytic[i][d]);
                }
            }
        }

        #[test]
        fn gradients_reach_every_parameter(skip: bool, offset: bool, octaves in 0usize..3, seed: u64) {
            let field = small(skip.then_some(2), octaves, offset, seed);
            let x = points(6, seed);
            let inputs: Vec<Tensor> = field.params.values().iter().map(|t| (**t).clone()).collect();
            check(|t, vars| {
                let p = Bound::new(vars.to_vec());
                let out = field.outputs(t, &p, &x);
                let both = t.concat_cols([out.sdf, out.gradient]);
                match out.offset {
                    Some(offset) => t.concat_cols([both, offset]),
                    None => both,
                }
            }, &inputs, seed);
        }
    }

    /// The network by loops over units, in f64.
    fn naive(field: &Field, x: [f32; 3]) -> Vec<f64> {
        let mut encoded: Vec<f64> = x.iter().map(|&x| f64::from(x)).collect();
        for f in field.config.frequencies() {
            encoded.extend(x.iter().map(|&x| (f64::from(f) * f64::from(x)).sin()));
            encoded.extend(x.iter().map(|&x| (f64::from(f) * f64::from(x)).cos()));
        }
        let mut h = encoded.clone();
        for (l, &(weight, bias)) in field.layers.iter().enumerate() {
            if Some(l) == field.config.skip {
                h.extend(&encoded);
                h.iter_mut().for_each(|h| *h *= 0.5f64.sqrt());
            }
            let (weight, bias) = (field.params.value(weight), field.params.value(bias));
            let unit = |j: usize| {
                let sum: f64 = h.iter().enumerate().map(|(i, h)| h * f64::from(weight.row(i)[j])).sum();
                sum + f64::from(bias.data()[j])
            };
            let z: Vec<f64> = (0..weight.cols()).map(unit).collect();
            let beta = 4.0;
            let soft = |z: &f64| (1.0 + (beta * z).exp()).ln() / beta;
            h = if l == field.config.depth { z } else { z.iter().map(soft).collect() };
        }
        h
    }

    #[test]
    fn values_agree_with_plain_loops() {
        for (skip, octaves, offset) in [(None, 0, false), (Some(1), 2, false), (Some(2), 1, true)] {
            let field = small(skip, octaves, offset, 8);
            for n in 0..12 {
                let x = points(n, n as u64);
                let mut tape = Tape::new();
                let p = field.params.bind(&mut tape, false);
                let out = field.outputs(&mut tape, &p, &x);
                for (i, (&x, s)) in x.iter().zip(field.sdf(&x)).enumerate() {
                    let want = naive(&field, x);
                    let mut found = vec![tape.value(out.sdf).data()[i]];
                    found.extend(out.offset.iter().flat_map(|&o| tape.value(o).row(i)));
                    assert_eq!(found.len(), want.len());
                    assert!((f64::from(s) - want[0]).abs() < 1e-5);
                    assert!(found.iter().zip(&want).all(|(a, b)| (f64::from(*a) - b).abs() < 1e-5));
                }
            }
        }
    }

    #[test]
    fn starts_as_a_sphere() {
        for (depth, skip) in [(4, None), (8, Some(4))] {
            let config = FieldConfig {
                width: 256,
                depth,
                octaves: 3,
                frequency: 1.0,
                activation: FieldActivation::Softplus { beta: 100.0 },
                skip,
                radius: 0.35,
            };
            let field = Field::new(config, &mut Random::new(1));
            let x = points(200, 5);
            let length = |p: &[f32; 3]| p.iter().map(|x| x * x).sum::<f32>().sqrt();
            let off: f32 =
                field.sdf(&x).iter().zip(&x).map(|(s, p)| (s - (length(p) - 0.35)).abs()).sum::<f32>()
                    / 200.0;
            assert!(off < 0.1, "depth {depth}: mean distance from the sphere's field {off}");
        }
    }
}
