//! The network against its twin on the tape, finite differences, and itself at other instruction sets.

use super::*;
use crate::autodiff::Tape;
use crate::field::FieldPass;
use crate::ops::testing::normal;
use crate::random::Random;
use crate::simd::testing::same_where_products_fuse;
use crate::tensor::Tensor;

const ACTIVATIONS: [FieldActivation; 2] = [FieldActivation::Softplus { beta: 4.0 }, FieldActivation::Relu];

fn config(depth: usize, skip: Option<usize>, octaves: usize, activation: FieldActivation) -> FieldConfig {
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
        let (x, seeds) = (points(n, 3), normal(&[n, 7], 1));
        same_where_products_fuse(|| {
            let mut weights = PackedWeights::default();
            weights.fill(&field);
            let network = Network { field: &field, weights: &weights };
            let (mut block, mut scratch) = (Block::default(), Scratch::default());
            let mut values = vec![0.0; 7 * n];
            block.forward(network, &x, &mut scratch, Some(&mut values));
            let mut total = vec![0.0; field.params().scalars()];
            block.backward(network, &mut scratch, seeds.data(), &mut total);
            [values, total].concat()
        });
    }
}

/// All values in rows and the parameters' gradients by tape operations.
fn twin(field: &Field, x: &[[f32; 3]], d: &Tensor) -> Vec<Tensor> {
    let mut tape = Tape::new();
    let p = field.params().bind(&mut tape, true);
    let out = field.outputs(&mut tape, &p, x);
    let values = tape.concat_cols([out.sdf, out.gradient]);
    let values = out.offset.map_or(values, |offset| tape.concat_cols([values, offset]));
    let gradients = p.collect(&mut tape.pull([(values, d.clone())]));
    let like = field.params().values();
    let gradients = gradients.into_iter().zip(like).map(|(g, like)| g.unwrap_or(Tensor::zeros(like.dims())));
    std::iter::once(tape.value(values).clone()).chain(gradients).collect()
}

#[test]
fn agrees_with_the_tape_for_every_kind_of_network() {
    for (depth, skip) in [(1, None), (2, None), (2, Some(1)), (3, Some(1)), (4, Some(3))] {
        for (octaves, offset) in [(0, false), (2, false), (1, true)] {
            for activation in ACTIVATIONS {
                let field = field(config(depth, skip, octaves, activation), offset, depth as u64);
                let cols = field.value_cols();
                // The last ones are more than a strip, and more than two.
                for n in (1..12).chain([49, 100]) {
                    let (x, d) = (points(n, n as u64), normal(&[n, cols], 1));
                    let mut pass = FieldPass::default();
                    let mut values = Tensor::zeros(&[n, cols]);
                    pass.forward(&field, &x, values.data_mut());
                    let gradients = field.params().split(&pass.backward(d.data()));
                    let found: Vec<Tensor> = std::iter::once(values).chain(gradients).collect();
                    let want = twin(&field, &x, &d);
                    assert_eq!(found.len(), want.len());
                    for (a, b) in found.iter().zip(&want) {
                        assert_eq!(a.shape(), b.shape());
                        let scale = b.data().iter().fold(1.0f32, |m, x| m.max(x.abs()));
                        let off = a.data().iter().zip(b.data()).map(|(a, b)| (a - b).abs());
                        assert!(off.fold(0.0, f32::max) < 2e-5 * scale, "{depth} {skip:?} {octaves} {n}");
                    }
                    let (sdf, gradient) = field.sdf_and_gradient(&x);
                    assert_eq!(field.sdf(&x), sdf);
                    for i in 0..n {
                        assert_eq!((sdf[i], &gradient[i][..]), (found[0].row(i)[0], &found[0].row(i)[1..4]));
                    }
                }
            }
        }
    }
}

#[test]
fn no_points_are_no_values() {
    let field = field(config(2, None, 1, ACTIVATIONS[0]), false, 1);
    assert!(field.sdf(&[]).is_empty() && field.gradient(&[]).is_empty());
    let mut pass = FieldPass::default();
    pass.forward(&field, &[], &mut []);
    assert!(pass.backward(&[]).iter().all(|&g| g == 0.0));
}
