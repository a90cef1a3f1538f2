//! Layers of the parameterization, forward and backward, at 300 points with patches of 10 codes and 128 channels.

mod common;

use bijective_sdf::autodiff::{Tape, Var};
use bijective_sdf::geometry::KdTree;
use bijective_sdf::nn::{Params, PointTransformer};
use bijective_sdf::tensor::Tensor;
use common::{normal, rng, sphere};
use criterion::{BatchSize, Criterion, criterion_group};
use std::sync::Arc;

const POINTS: usize = 300;
const CODES: usize = 10 * POINTS;
const CHANNELS: usize = 128;
const HEADS: usize = 4;

/// Times `forward` on the inputs together with pulling a gradient of its output back to all of them.
fn both_ways(c: &mut Criterion, name: &str, inputs: &[Tensor], forward: impl Fn(&mut Tape, &[Var]) -> Var) {
    let inputs: Vec<Arc<Tensor>> = inputs.iter().cloned().map(Arc::new).collect();
    let mut tape = Tape::new();
    let place =
        |tape: &mut Tape| -> Vec<Var> { inputs.iter().map(|x| tape.shared(x.clone(), true)).collect() };
    let vars = place(&mut tape);
    let y = forward(&mut tape, &vars);
    let seed = normal(tape.value(y).dims(), 9);
    c.bench_function(name, |bench| {
        let step = |seed: Tensor| {
            tape.clear();
            let vars = place(&mut tape);
            let y = forward(&mut tape, &vars);
            tape.pull([(y, seed)])
        };
        bench.iter_batched(|| seed.clone(), step, BatchSize::PerIteration);
    });
}

/// The neighbours of every point, `k` each.
fn nearest(n: usize, k: usize) -> Arc<[u32]> {
    let points = sphere(n, 0.5, 0.0, 1);
    KdTree::new(&points).k_nearest(&points, k).into()
}

fn softmax(c: &mut Criterion) {
    let scores = [normal(&[HEADS * CODES, POINTS], 1)];
    both_ways(c, "softmax_cols 12000x300", &scores, |t, x| t.softmax_cols(x[0]));
    let scores = [normal(&[POINTS * 8, CHANNELS], 1)];
    both_ways(c, "softmax_groups 300x8x128", &scores, |t, x| t.softmax_groups(x[0], 8));
}

fn attention(c: &mut Criterion) {
    let [q, k, v] = [CODES, POINTS, POINTS].map(|n| normal(&[n, CHANNELS], n as u64));
    let inputs = [q, k, v];
    both_ways(c, "attention global 3000x300", &inputs, |t, x| t.attention(x[0], x[1], x[2], HEADS));
    // Every code attends to the 16 points nearest to the centre of its patch.
    let index: Arc<[u32]> =
        nearest(POINTS, 16).chunks_exact(16).flat_map(|row| row.repeat(CODES / POINTS)).collect();
    both_ways(c, "attention local 3000x16", &inputs, |t, x| {
        t.local_attention(x[0], x[1], x[2], index.clone(), HEADS)
    });
}

fn point_transformer(c: &mut Criterion) {
    let mut params = Params::new();
    let layer = PointTransformer::new(&mut params.scope("layer"), 3, CHANNELS, &mut rng(1));
    let points = Tensor::from_points(&sphere(POINTS, 0.5, 0.0, 1));
    let index = nearest(POINTS, 8);
    both_ways(c, "point_transformer 300x8", &[points], |t, x| {
        let bound = params.bind(t, true);
        layer.forward(t, &bound, x[0], x[0], index.clone())
    });
}

fn layer_norm(c: &mut Criterion) {
    let inputs = [normal(&[CODES, CHANNELS], 1), normal(&[1, CHANNELS], 2), normal(&[1, CHANNELS], 3)];
    both_ways(c, "layer_norm 3000x128", &inputs, |t, x| t.layer_norm(x[0], x[1], x[2], 1e-5));
}

criterion_group! {
    name = benches;
    config = common::criterion();
    targets = softmax, attention, point_transformer, layer_norm
}

fn main() {
    common::in_pool(benches);
}
