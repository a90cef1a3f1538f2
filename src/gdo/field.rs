//! The signed distance field g: a multilayer perceptron over a Fourier encoding, and its spatial gradient written
//! with ordinary tape operations.
//!
//! The losses depend on grad g, so training needs second derivatives. One reverse sweep through the layers (multiply
//! by the activation's slope, then by the transposed weight) puts grad g on the tape; pulling back through that is
//! an ordinary backward pass, and no higher-order tape is needed.

use crate::autodiff::{Tape, Var};
use crate::nn::{Bound, ParamId, Params};
use crate::tensor::{Pool, Tensor};
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use rayon::prelude::*;

/// The nonlinearity of the hidden layers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Activation {
    /// max(z, 0), as in the authors' code.
    Relu,
    /// ln(1 + e^(beta z)) / beta: smooth, so that grad g is continuous.
    Softplus {
        /// Sharpness; the corner is about 1 / beta wide.
        beta: f32,
    },
}

/// The shape of the network.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldConfig {
    /// Width c of every hidden layer.
    pub width: usize,
    /// Hidden layers.
    pub depth: usize,
    /// Fourier octaves: sin and cos of `frequency` 2^o x for o below this.
    pub octaves: usize,
    /// Angular frequency of the first octave, in radians per unit of the working frame.
    pub frequency: f32,
    /// Nonlinearity of the hidden layers.
    pub activation: Activation,
    /// Hidden layer (counted from 0) that is fed the encoding again beside its input; `None` for a plain stack.
    pub skip: Option<usize>,
    /// Radius of the sphere that the field starts as, in units of the working frame.
    pub radius: f32,
}

impl FieldConfig {
    /// Columns of the encoding: x itself, and a sine and a cosine of each coordinate for each octave.
    pub fn encoding_cols(&self) -> usize {
        3 + 6 * self.octaves
    }
}

/// The field network: n x 3 points in the working frame to n x 1 signed distances, negative inside.
///
/// Hidden layer l: h = act(h W_l + b_l), with the encoding joined to its input (both divided by sqrt 2) at `skip`; then
/// a linear layer to one value. Parameters: `field.L.weight` (c_in x c_out) and `field.L.bias` (1 x c_out), geometrically
/// initialised so that g(x) is about |x| - radius (Atzmon and Lipman 2020).
#[derive(Clone, Debug)]
pub struct Field {
    config: FieldConfig,
    params: Params,
    layers: Vec<(ParamId, ParamId)>,
}

/// Points evaluated at a time: the activations of a chunk stay in the processor's cache.
pub(crate) const CHUNK: usize = 256;

impl Field {
    /// A field that starts as a sphere.
    ///
    /// # Panics
    /// If width or depth is 0, or the skip is not a hidden layer after the first.
    #[track_caller]
    pub fn new(config: FieldConfig, rng: &mut ChaCha8Rng) -> Self {
        let FieldConfig { width, depth, .. } = config;
        assert!(width > 0 && depth > 0, "field: width {width}, depth {depth}");
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
            let to = if layer == depth { 1 } else { width };
            let mut weight = Tensor::zeros(&[from, to]);
            let mut bias = Tensor::zeros(&[1, to]);
            if layer == depth {
                let normal = Normal::new((std::f32::consts::PI / from as f32).sqrt(), 1e-4).expect("finite");
                weight.data_mut().iter_mut().for_each(|w| *w = normal.sample(rng));
                bias.data_mut()[0] = -config.radius;
            } else {
                let normal = Normal::new(0.0, (2.0 / to as f32).sqrt()).expect("finite");
                // Sines and cosines start without influence, so the start is the sphere of a network on x alone.
                let first_encoded = if layer == 0 { 0 } else { width };
                for (i, row) in weight.data_mut().chunks_exact_mut(to).enumerate() {
                    let silent = (layer == 0 || Some(layer) == config.skip) && i >= first_encoded + 3;
                    row.iter_mut().for_each(|w| {
                        let sample = normal.sample(rng);
                        *w = if silent { 0.0 } else { sample };
                    });
                }
            }
            let weight = params.add(format!("field.{layer}.weight"), weight);
            let bias = params.add(format!("field.{layer}.bias"), bias);
            layers.push((weight, bias));
        }
        Field { config, params, layers }
    }

    /// The shape of the network.
    pub fn config(&self) -> &FieldConfig {
        &self.config
    }

    /// Its parameters.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// Its parameters, to be changed.
    pub fn params_mut(&mut self) -> &mut Params {
        &mut self.params
    }

    fn frequencies(&self) -> impl Iterator<Item = f32> {
        let first = self.config.frequency;
        (0..self.config.octaves).map(move |o| first * (1u32 << o) as f32)
    }

    /// The activation and its slope.
    fn activate(&self, tape: &mut Tape, z: Var) -> (Var, Var) {
        match self.config.activation {
            Activation::Relu => (tape.relu(z), tape.relu_derivative(z)),
            Activation::Softplus { beta } => tape.softplus_and_derivative(z, beta),
        }
    }

    /// The encoding of points (n x 3): [x, sin f x, cos f x, sin 2f x, cos 2f x, ...].
    fn encode(&self, points: &[[f32; 3]]) -> Tensor {
        let c = self.config.encoding_cols();
        let mut out = Tensor::zeros(&[points.len(), c]);
        for (row, x) in out.data_mut().chunks_exact_mut(c).zip(points) {
            row[..3].copy_from_slice(x);
            for (f, part) in self.frequencies().zip(row[3..].chunks_exact_mut(6)) {
                for d in 0..3 {
                    (part[d], part[3 + d]) = crate::tensor::sin_cos(f * x[d]);
                }
            }
        }
        out
    }

    /// g at constant points: n x 3 to n x 1. `slopes` collects the activations' slopes, layer by layer.
    fn forward(&self, tape: &mut Tape, p: &Bound, encoded: Var, mut slopes: impl FnMut(Var)) -> Var {
        let mut h = encoded;
        for (l, &(weight, bias)) in self.layers.iter().enumerate() {
            if Some(l) == self.config.skip {
                let joined = tape.concat_cols([h, encoded]);
                h = tape.scale(joined, std::f32::consts::FRAC_1_SQRT_2);
            }
            let z = tape.linear(h, p.var(weight), p.var(bias));
            if l == self.config.depth {
                return z;
            }
            let (activated, slope) = self.activate(tape, z);
            slopes(slope);
            h = activated;
        }
        unreachable!("the last layer returns")
    }

    /// g and grad g at constant points: n x 3 to n x 1 and n x 3, both on the tape.
    pub fn sdf_and_gradient(&self, tape: &mut Tape, p: &Bound, points: &[[f32; 3]]) -> (Var, Var) {
        let encoding = self.encode(points);
        let (sin_cos, c) = (encoding.clone(), self.config.encoding_cols());
        let encoded = tape.constant(encoding);
        let mut layer_slopes = Vec::with_capacity(self.config.depth);
        let sdf = self.forward(tape, p, encoded, |slope| layer_slopes.push(slope));

        // The adjoint of h, from the last layer down; a row until it meets the first slope.
        let (last, _) = self.layers[self.config.depth];
        let row = tape.reshape(p.var(last), &[1, self.config.width]);
        let mut adjoint_skip = None;
        let mut adjoint = row;
        for l in (0..self.config.depth).rev() {
            let through = tape.mul(layer_slopes[l], adjoint);
            adjoint = tape.matmul_nt(through, p.var(self.layers[l].0));
            if Some(l) == self.config.skip {
                let scaled = tape.scale(adjoint, std::f32::consts::FRAC_1_SQRT_2);
                adjoint = tape.slice_cols(scaled, 0..self.config.width);
                adjoint_skip = Some(tape.slice_cols(scaled, self.config.width..self.config.width + c));
            }
        }
        let adjoint = match adjoint_skip {
            Some(skip) => tape.add(adjoint, skip),
            None => adjoint,
        };
        // Through the encoding: d sin(fx) = f cos(fx), d cos(fx) = -f sin(fx).
        let mut gradient = tape.slice_cols(adjoint, 0..3);
        if self.config.octaves > 0 {
            let mut slopes = Tensor::zeros(&[points.len(), c - 3]);
            for (out, row) in slopes.data_mut().chunks_exact_mut(c - 3).zip(sin_cos.data().chunks_exact(c)) {
                for ((f, out), row) in
                    self.frequencies().zip(out.chunks_exact_mut(6)).zip(row[3..].chunks_exact(6))
                {
                    for d in 0..3 {
                        out[d] = f * row[3 + d];
                        out[3 + d] = -f * row[d];
                    }
                }
            }
            let slopes = tape.constant(slopes);
            let waves = tape.slice_cols(adjoint, 3..c);
            let pulled = tape.mul(waves, slopes);
            for part in 0..2 * self.config.octaves {
                let term = tape.slice_cols(pulled, 3 * part..3 * part + 3);
                gradient = tape.add(gradient, term);
            }
        }
        (sdf, gradient)
    }

    /// g at points (n x 3, working frame), without gradients and in parallel over fixed chunks.
    pub fn sdf(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let mut out = vec![0.0; points.len()];
        out.par_chunks_mut(CHUNK * 8).zip(points.par_chunks(CHUNK * 8)).for_each(|(out, points)| {
            let mut tape = Tape::new();
            for (out, points) in out.chunks_mut(CHUNK).zip(points.chunks(CHUNK)) {
                tape.clear();
                let p = self.params.bind(&mut tape, false);
                let encoded = tape.constant(self.encode(points));
                let sdf = self.forward(&mut tape, &p, encoded, |_| ());
                out.copy_from_slice(tape.value(sdf).data());
            }
        });
        out
    }

    /// grad g at points (n x 3, working frame), in parallel over fixed chunks.
    pub fn gradient(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut out = vec![[0.0; 3]; points.len()];
        out.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK)).for_each(|(out, points)| {
            let mut tape = Tape::new();
            let p = self.params.bind(&mut tape, false);
            let (_, gradient) = self.sdf_and_gradient(&mut tape, &p, points);
            out.copy_from_slice(&tape.value(gradient).to_points());
        });
        out
    }
}

/// One forward and backward pass of the field over many vertices, chunk by chunk on several threads.
///
/// Every chunk has a tape of its own, so that the loss can be taken once over all vertices and its gradient pulled
/// back through the chunks. Parameter gradients are folded in chunk order, so they do not depend on the threads.
#[derive(Default)]
pub struct FieldPass {
    chunks: Vec<Chunk>,
    used: usize,
}

#[derive(Default)]
struct Chunk {
    tape: Tape,
    bound: Option<Bound>,
    outputs: Option<(Var, Var)>,
    gradients: Vec<Option<Tensor>>,
}

impl FieldPass {
    /// A pass without memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// g (v x 1) and grad g (v x 3) at the vertices, from the memory of `pool`.
    pub fn forward(&mut self, field: &Field, verts: &[[f32; 3]], pool: &Pool) -> (Tensor, Tensor) {
        self.used = verts.len().div_ceil(CHUNK);
        if self.chunks.len() < self.used {
            self.chunks.resize_with(self.used, Chunk::default);
        }
        let mut sdf = Tensor::zeros(&[verts.len(), 1]).into_pool(pool);
        let mut gradient = Tensor::zeros(&[verts.len(), 3]).into_pool(pool);
        self.chunks[..self.used]
            .par_iter_mut()
            .zip(verts.par_chunks(CHUNK))
            .zip(sdf.data_mut().par_chunks_mut(CHUNK))
            .zip(gradient.data_mut().par_chunks_mut(3 * CHUNK))
            .for_each(|(((chunk, verts), sdf), gradient)| {
                chunk.gradients.clear();
                chunk.tape.clear();
                let p = field.params.bind(&mut chunk.tape, true);
                let (s, g) = field.sdf_and_gradient(&mut chunk.tape, &p, verts);
                sdf.copy_from_slice(chunk.tape.value(s).data());
                gradient.copy_from_slice(chunk.tape.value(g).data());
                chunk.bound = Some(p);
                chunk.outputs = Some((s, g));
            });
        (sdf, gradient)
    }

    /// The parameters' gradients from those at g (v x 1) and grad g (v x 3) of the last forward pass.
    ///
    /// # Panics
    /// If the shapes are not those of the last forward pass.
    #[track_caller]
    pub fn backward(&mut self, d_sdf: &Tensor, d_gradient: &Tensor) -> Vec<Option<Tensor>> {
        assert!(
            d_sdf.len().div_ceil(CHUNK) == self.used && d_gradient.len() == 3 * d_sdf.len(),
            "field: gradients {:?} and {:?} for {} chunks",
            d_sdf.shape(),
            d_gradient.shape(),
            self.used
        );
        self.chunks[..self.used]
            .par_iter_mut()
            .zip(d_sdf.data().par_chunks(CHUNK))
            .zip(d_gradient.data().par_chunks(3 * CHUNK))
            .for_each(|((chunk, d_sdf), d_gradient)| {
                let ((s, g), p) =
                    (chunk.outputs.expect("forward first"), chunk.bound.as_ref().expect("forward first"));
                let seed = |values: &[f32], cols| {
                    Tensor::from_vec(&[values.len() / cols, cols], values.to_vec())
                        .into_pool(chunk.tape.pool())
                };
                let mut gradients = chunk.tape.pull([(s, seed(d_sdf, 1)), (g, seed(d_gradient, 3))]);
                chunk.gradients = p.collect(&mut gradients);
            });
        let mut chunks = self.chunks[..self.used].iter_mut();
        let mut total = chunks.next().map(|c| std::mem::take(&mut c.gradients)).unwrap_or_default();
        for chunk in chunks {
            for (sum, gradient) in total.iter_mut().zip(chunk.gradients.drain(..)) {
                match (sum.as_mut(), gradient) {
                    (Some(sum), Some(gradient)) => sum.add_assign(&gradient),
                    (None, gradient) => *sum = gradient,
                    (Some(_), None) => {}
                }
            }
        }
        total
    }

    /// Lets go of the parameters and activations of the last pass, so that changing the parameters copies nothing.
    pub fn release(&mut self) {
        self.chunks.iter_mut().for_each(|c| c.tape.clear());
        self.used = 0;
    }

    /// Buffers newly allocated so far by all chunks; constant once a repeated step has warmed up.
    pub fn allocations(&self) -> usize {
        self.chunks.iter().map(|c| c.tape.pool().allocations()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::{check, normal};
    use proptest::prelude::*;
    use rand::SeedableRng;

    fn small(activation: Activation, skip: Option<usize>, octaves: usize, seed: u64) -> Field {
        let config =
            FieldConfig { width: 9, depth: 3, octaves, frequency: 1.5, activation, skip, radius: 0.4 };
        let mut field = Field::new(config, &mut ChaCha8Rng::seed_from_u64(seed));
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

    const SOFT: Activation = Activation::Softplus { beta: 4.0 };

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        #[test]
        fn spatial_gradient_agrees_with_differences(skip: bool, octaves in 0usize..3, seed: u64) {
            let field = small(SOFT, skip.then_some(1), octaves, seed);
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
        fn gradients_reach_every_parameter(skip: bool, octaves in 0usize..3, seed: u64) {
            let field = small(SOFT, skip.then_some(2), octaves, seed);
            let x = points(6, seed);
            let inputs: Vec<Tensor> = field.params.values().iter().map(|t| (**t).clone()).collect();
            check(|t, vars| {
                let p = Bound::new(vars.to_vec());
                let (s, g) = field.sdf_and_gradient(t, &p, &x);
                t.concat_cols([s, g])
            }, &inputs, seed);
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
                activation: Activation::Softplus { beta: 100.0 },
                skip,
                radius: 0.35,
            };
            let field = Field::new(config, &mut ChaCha8Rng::seed_from_u64(1));
            let x = points(200, 5);
            let length = |p: &[f32; 3]| p.iter().map(|x| x * x).sum::<f32>().sqrt();
            let off: f32 =
                field.sdf(&x).iter().zip(&x).map(|(s, p)| (s - (length(p) - 0.35)).abs()).sum::<f32>()
                    / 200.0;
            assert!(off < 0.1, "depth {depth}: mean distance from the sphere's field {off}");
        }
    }

    #[test]
    fn chunked_pass_equals_one_tape() {
        let field = small(SOFT, Some(1), 2, 3);
        let n = 2 * CHUNK + 17;
        let x = points(n, 9);
        let (ds, dg) = (normal(&[n, 1], 1), normal(&[n, 3], 2));
        let mut pass = FieldPass::new();
        let pool = Pool::default();
        let (sdf, gradient) = pass.forward(&field, &x, &pool);
        let chunked = pass.backward(&ds, &dg);

        let mut tape = Tape::new();
        let p = field.params.bind(&mut tape, true);
        let (s, g) = field.sdf_and_gradient(&mut tape, &p, &x);
        let whole = p.collect(&mut tape.pull([(s, ds), (g, dg)]));
        assert!(sdf.data().iter().zip(tape.value(s).data()).all(|(a, b)| (a - b).abs() < 1e-5));
        assert!(gradient.data().iter().zip(tape.value(g).data()).all(|(a, b)| (a - b).abs() < 1e-4));
        for (a, b) in chunked.iter().zip(&whole) {
            let (a, b) = (a.as_ref().unwrap(), b.as_ref().unwrap());
            let scale = b.data().iter().fold(1.0f32, |m, x| m.max(x.abs()));
            assert!(a.data().iter().zip(b.data()).all(|(a, b)| (a - b).abs() < 1e-4 * scale));
        }
    }

    #[test]
    fn a_repeated_pass_allocates_nothing_and_repeats_its_bits() {
        let field = small(Activation::Relu, None, 1, 3);
        let x = points(700, 2);
        let (ds, dg) = (normal(&[700, 1], 1), normal(&[700, 3], 2));
        let mut pass = FieldPass::new();
        let pool = Pool::default();
        let mut first: Option<Vec<Vec<f32>>> = None;
        let mut counts = Vec::new();
        for threads in [1, 2, 3, 1] {
            let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let bits: Vec<Vec<f32>> = workers.install(|| {
                let (sdf, gradient) = pass.forward(&field, &x, &pool);
                let gradients = pass.backward(&ds, &dg);
                let gradients = gradients.iter().map(|g| g.as_ref().unwrap());
                [&sdf, &gradient].into_iter().chain(gradients).map(|t| t.data().to_vec()).collect()
            });
            counts.push(pass.allocations());
            assert!(*first.get_or_insert(bits.clone()) == bits, "{threads} threads");
        }
        assert_eq!(counts[1], counts[3]);
    }
}
