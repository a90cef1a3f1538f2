//! Nearest neighbours and the Chamfer distance.

mod common;

use bijective_sdf::autodiff::Tape;
use bijective_sdf::geometry::{KdTree, PointTree, farthest_point_sample};
use bijective_sdf::loss::Direction;
use bijective_sdf::tensor::Tensor;
use common::{cube, sphere};
use criterion::{Criterion, criterion_group};
use std::sync::Arc;

fn trees(c: &mut Criterion) {
    for n in [3000, 20000] {
        let points = sphere(n, 0.5, 0.01, 1);
        c.bench_function(&format!("kd-tree build {n}"), |bench| bench.iter(|| KdTree::new(&points)));
        c.bench_function(&format!("point tree build {n}"), |bench| bench.iter(|| PointTree::new(&points)));
    }
    let (few, many) = (sphere(3000, 0.5, 0.01, 1), sphere(20000, 0.5, 0.01, 2));
    let tree = KdTree::new(&few);
    for (name, shift) in [("", 0.0), (" far away", 3.0)] {
        let moved: Vec<[f32; 3]> = many.iter().map(|p| [p[0] + shift, p[1], p[2]]).collect();
        let (queries, points) = (PointTree::new(&moved), PointTree::new(&few));
        let name = format!("nearest 20000 in 3000{name}");
        c.bench_function(&name, |bench| bench.iter(|| points.nearest(&queries)));
    }
    c.bench_function("8 nearest 3000 in 3000", |bench| bench.iter(|| tree.k_nearest(&few, 8)));
    c.bench_function("farthest points 300 of 20000", |bench| {
        bench.iter(|| farthest_point_sample(&many, 300, 0));
    });
}

/// Both directions, trees built anew, and back to both clouds.
fn chamfer(c: &mut Criterion) {
    let [a, b] = [(3000, 1), (20000, 2)].map(|(n, seed)| Arc::new(Tensor::from_points(&cube(n, seed))));
    let mut tape = Tape::new();
    c.bench_function("chamfer 3000x20000", |bench| {
        bench.iter(|| {
            tape.clear();
            let (a, b) = (tape.shared(a.clone(), true), tape.shared(b.clone(), true));
            let loss = tape.chamfer(a, b, Direction::BOTH);
            tape.backward(loss)
        });
    });
}

criterion_group! { name = benches; config = common::criterion(); targets = chamfer, trees }

fn main() {
    common::in_pool(benches);
}
