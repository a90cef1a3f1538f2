//! The parts of a training step: the field with its spatial gradient, the parameterization, and Adam.

mod common;

use bijective_sdf::autodiff::Tape;
use bijective_sdf::bsp::{Bsp, BspConfig, Neighbourhood};
use bijective_sdf::field::{Field, FieldConfig, FieldMemory};
use bijective_sdf::gdo::{Deformation, deform};
use bijective_sdf::loss::{Direction, mean_abs};
use bijective_sdf::optim::{Adam, AdamOptions};
use bijective_sdf::tensor::Tensor;
use common::{normal, rng, sphere};
use criterion::{Criterion, criterion_group};
use std::sync::Arc;

/// g and grad g at the vertices, the loss mean |V - g n|^2 + 0.01 mean |g|, and back to the weights.
fn field(c: &mut Criterion) {
    for (width, depth, v) in [(64, 4, 2000), (128, 4, 4000), (128, 4, 16000), (256, 8, 4000)] {
        let mut config = FieldConfig::default();
        (config.width, config.depth, config.frequency) = (width, depth, 1.0);
        let field = Field::new(config, &mut rng(1));
        let verts = sphere(v, 0.4, 0.01, 2);
        let (memory, mut tape) = (FieldMemory::default(), Tape::new());
        c.bench_function(&format!("field {width}x{depth} @ {v}"), |bench| {
            bench.iter(|| {
                tape.clear();
                let parameters = tape.input(field.params().flat());
                let vars = field.fused(&mut tape, parameters, &verts, &memory);
                let moved = deform(&mut tape, Deformation::Projection, &vars);
                let moved_sq = tape.square(moved);
                let length_sq = tape.sum_cols(moved_sq);
                let length_sq = tape.mean(length_sq);
                let magnitude = mean_abs(&mut tape, vars.sdf);
                let magnitude = tape.scale(magnitude, 0.01);
                let loss = tape.add(length_sq, magnitude);
                let mut gradients = tape.backward(loss);
                gradients.take(parameters)
            });
        });
    }
}

/// The surface S from the cloud, its Chamfer distance to the cloud, and back to the weights.
fn bsp(c: &mut Criterion) {
    // Attention to all points and positions from nothing, as in the paper; or attention to the nearest points, whose
    // positions are averaged.
    for (n, kind, reach, average_positions) in
        [300, 1024].into_iter().flat_map(|n| [(n, "", None, false), (n, " local", Some(12), true)])
    {
        let mut config = BspConfig::default();
        (config.channels, config.reach, config.average_positions) = (128, reach, average_positions);
        config.normal_weight = 0.0;
        let points = sphere(n, 0.5, 0.0, 1);
        let bsp = Bsp::new(config, &points, &mut rng(2));
        let whole = Neighbourhood::whole(&points, None, &config);
        let mut tape = Tape::new();
        c.bench_function(&format!("bsp {n}x10{kind}"), |bench| {
            bench.iter(|| {
                tape.clear();
                let p = bsp.params().bind(&mut tape, true);
                let q = tape.constant(Tensor::from_points(&points));
                let out = bsp.forward(&mut tape, &p, q, &whole);
                let loss = tape.chamfer(out.surface, q, Direction::BOTH);
                p.collect(&mut tape.backward(loss))
            });
        });
    }
}

fn adam(c: &mut Criterion) {
    let mut values = [Arc::new(normal(&[1, 500_000], 1))];
    let gradients = [Some(normal(&[1, 500_000], 2))];
    let mut adam = Adam::new(&values, AdamOptions::default());
    c.bench_function("adam 500000", |bench| bench.iter(|| adam.step(&mut values, &gradients, 1e-3)));
}

criterion_group! { name = benches; config = common::criterion(); targets = field, bsp, adam }

fn main() {
    common::in_pool(benches);
}
