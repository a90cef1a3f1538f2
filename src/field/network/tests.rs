//! The network against its twin on the tape, finite differences, and itself at other instruction sets.

use super::*;
use crate::autodiff::{At, Op, Tape};
use crate::field::{FieldPass, FieldValues};
use crate::ops::testing::{check, normal};
use crate::random::Random;
use crate::simd::testing::same_where_products_fuse;
use crate::tensor::{Pool, Tensor};
use proptest::prelude::*;

const ACTIVATIONS: [Activation; 2] = [Activation::Softplus { beta: 4.0 }, Activation::Relu];

fn config(depth: usize, skip: Option<usize>, octaves: usize, activation: Activation) -> FieldConfig {
    FieldConfig { width: 7, depth, octaves, frequency: 1.5, activation, skip, radius: 0.4 }
}

fn field(config: FieldConfig, offset: bool, seed: u64) -> Field {
    let mut rng = Random::new(seed);
    let mut field = if offset { Field::with_offset(config, &mut rng) } else { Field::new(config, &mut rng) };
    // Leave the geometric start, at which the waves are silent.
    for (i, value) in field.params_mut().values_mut().iter_mut().enumerate() {
        let noise = normal(value.dims(), seed ^ (77 + i as u64));
        let value = std::sync::Arc::make_mut(value);
        value.data_mut().iter_mut().zip(noise.data()).for_each(|(w, n)| *w += 0.1 * n);
    }
    field
}

fn points(n: usize, seed: u64) -> Vec<[f32; 3]> {
    normal(&[n, 3], seed).to_points().into_iter().map(|p| p.map(|x| 0.3 * x)).collect()
}

/// The pass as an operation on all parameters in one row, so that the checker can run it.
struct WholeField {
    field: Field,
    points: Vec<[f32; 3]>,
}

impl WholeField {
    fn at(&self, parameters: &Tensor) -> Field {
        let mut field = self.field.clone();
        let mut rest = parameters.data();
        for value in field.params_mut().values_mut() {
            let (values, after) = rest.split_at(value.len());
            std::sync::Arc::make_mut(value).data_mut().copy_from_slice(values);
            rest = after;
        }
        field
    }
}

impl Op<1> for WholeField {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        let values = FieldPass::new().forward(&self.at(x), &self.points, &Pool::default());
        let parts = [Some(values.sdf), Some(values.gradient), values.offset];
        let all: Vec<f32> = parts.iter().flatten().flat_map(|t| t.data().to_vec()).collect();
        (Tensor::from_vec(&[1, all.len()], all), ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let n = self.points.len();
        let part = |from: usize, c: usize| Tensor::from_vec(&[n, c], dy.data()[from..from + n * c].to_vec());
        let d = FieldValues {
            sdf: part(0, 1),
            gradient: part(n, 3),
            offset: self.field.has_offset().then(|| part(4 * n, 3)),
        };
        let field = self.at(at.x[0]);
        let mut pass = FieldPass::new();
        pass.forward(&field, &self.points, &Pool::default());
        let gradients = pass.backward(&field, &d);
        let all: Vec<f32> = gradients.iter().flatten().flat_map(|t| t.data().to_vec()).collect();
        [Some(Tensor::from_vec(at.x[0].dims(), all))]
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn gradients_of_a_whole_pass(skip: bool, offset: bool, octaves in 0usize..3, seed: u64) {
        let config = config(3, skip.then_some(2), octaves, ACTIVATIONS[0]);
        let field = field(config, offset, seed);
        let all: Vec<f32> = field.params().values().iter().flat_map(|t| t.data().to_vec()).collect();
        let all = Tensor::from_vec(&[1, all.len()], all);
        let x = points(6, seed);
        check(|t, v| t.apply(WholeField { field: field.clone(), points: x.clone() }, [v[0]]), &[all], seed);
    }
}

#[test]
fn a_pass_is_the_same_where_products_fuse() {
    // Rows up to a strip, a strip and more; widths with and without columns that no tile fills.
    for (n, width, activation) in [
        (1, 7, ACTIVATIONS[0]),
        (47, 32, ACTIVATIONS[1]),
        (100, 41, ACTIVATIONS[0]),
        (64, 64, ACTIVATIONS[1]),
    ] {
        let config = FieldConfig { width, ..config(3, Some(2), 2, activation) };
        let field = field(config, true, 5);
        let (x, seeds) = (points(n, 3), [1, 3, 3].map(|c| normal(&[n, c], c as u64)));
        same_where_products_fuse(|| {
            let mut weights = PackedWeights::default();
            weights.fill(&field);
            let network = Network { field: &field, weights: &weights };
            let (mut block, mut scratch) = (Block::default(), Scratch::default());
            let mut values = [1, 3, 3].map(|c| vec![0.0; n * c]);
            let [sdf, gradient, offset] = &mut values;
            let out = &mut Outputs { sdf, gradient, offset: Some(offset) };
            block.forward(network, &x, &mut scratch, Some(out));
            let mut total = vec![0.0; field.params().scalars()];
            let [sdf, gradient, offset] = seeds.each_ref().map(Tensor::data);
            let seeds = Seeds { sdf, gradient, offset: Some(offset) };
            block.backward(network, &mut scratch, seeds, &mut total);
            [values.concat(), total].concat()
        });
    }
}

/// Values and parameter gradients by tape operations.
fn twin(field: &Field, x: &[[f32; 3]], d: &FieldValues) -> Vec<Tensor> {
    let mut tape = Tape::new();
    let p = field.params().bind(&mut tape, true);
    let out = field.outputs(&mut tape, &p, x);
    let mut seeds = vec![(out.sdf, d.sdf.clone()), (out.gradient, d.gradient.clone())];
    seeds.extend(out.offset.zip(d.offset.clone()));
    let values = [Some(out.sdf), Some(out.gradient), out.offset];
    let values: Vec<Tensor> = values.iter().flatten().map(|var| tape.value(*var).clone()).collect();
    let gradients = p.collect(&mut tape.pull(seeds));
    values.into_iter().chain(gradients.into_iter().flatten()).collect()
}

#[test]
fn agrees_with_the_tape_for_every_kind_of_network() {
    for (depth, skip) in [(1, None), (2, None), (2, Some(1)), (3, Some(1)), (4, Some(3))] {
        // With a displacement, and a loss that depends on it or does not.
        for (octaves, offset, moved) in
            [(0, false, false), (2, false, false), (1, true, true), (1, true, false)]
        {
            for activation in ACTIVATIONS {
                let field = field(config(depth, skip, octaves, activation), offset, depth as u64);
                // The last ones are more than a strip, and more than two.
                for n in (1..12).chain([49, 100]) {
                    let x = points(n, n as u64);
                    let d = FieldValues {
                        sdf: normal(&[n, 1], 1),
                        gradient: normal(&[n, 3], 2),
                        offset: moved.then(|| normal(&[n, 3], 3)),
                    };
                    let mut pass = FieldPass::new();
                    let values = pass.forward(&field, &x, &Pool::default());
                    let gradients = pass.backward(&field, &d);
                    let found = [Some(values.sdf), Some(values.gradient), values.offset];
                    let found: Vec<Tensor> = found.into_iter().chain(gradients).flatten().collect();
                    let want = twin(&field, &x, &d);
                    assert_eq!(found.len(), want.len());
                    for (a, b) in found.iter().zip(&want) {
                        assert_eq!(a.shape(), b.shape());
                        let scale = b.data().iter().fold(1.0f32, |m, x| m.max(x.abs()));
                        let off = a.data().iter().zip(b.data()).map(|(a, b)| (a - b).abs());
                        assert!(off.fold(0.0, f32::max) < 2e-5 * scale, "{depth} {skip:?} {octaves} {n}");
                    }
                    assert_eq!(field.sdf(&x), found[0].data());
                    assert_eq!(field.gradient(&x).as_flattened(), found[1].data());
                }
            }
        }
    }
}

#[test]
fn no_points_are_no_values() {
    let field = field(config(2, None, 1, ACTIVATIONS[0]), false, 1);
    assert!(field.sdf(&[]).is_empty() && field.gradient(&[]).is_empty());
    let values = FieldPass::new().forward(&field, &[], &Pool::default());
    assert_eq!((values.sdf.rows(), values.gradient.rows()), (0, 0));
}
