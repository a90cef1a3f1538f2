//! Matrix products at the shapes of a training step, and the affine layer.

mod common;

use bijective_sdf::autodiff::Tape;
use bijective_sdf::tensor::{Tensor, matmul, matmul_nt, matmul_tn};
use common::normal;
use criterion::{BatchSize, Criterion, Throughput, criterion_group};
use std::sync::Arc;

/// Throughput is multiply-adds: a figure of 10 Gelem/s is 20 GFLOP/s.
fn products(c: &mut Criterion) {
    type Product = fn(&Tensor, &Tensor) -> Tensor;
    let kinds: [(&str, Product, [bool; 2]); 3] = [
        ("matmul", matmul, [false, false]),
        ("matmul_nt", matmul_nt, [false, true]),
        ("matmul_tn", matmul_tn, [true, false]),
    ];
    let mut group = c.benchmark_group("product");
    // Rows x inner x columns: the first and the hidden layers of the field over one chunk of vertices, its last layer
    // (one column), the first step of its adjoint (one inner value), and the layers of the parameterization.
    let shapes =
        [[256, 21, 128], [256, 128, 128], [256, 256, 256], [256, 128, 1], [256, 1, 128], [3000, 128, 128]];
    for (name, product, [transpose_a, transpose_b]) in kinds {
        for [m, k, n] in shapes {
            let a = normal(&if transpose_a { [k, m] } else { [m, k] }, 1);
            let b = normal(&if transpose_b { [n, k] } else { [k, n] }, 2);
            group.throughput(Throughput::Elements((m * k * n) as u64));
            group.bench_function(format!("{name} {m}x{k}x{n}"), |bench| bench.iter(|| product(&a, &b)));
        }
    }
    // A gradient of weights sums over all rows.
    let (a, b) = (normal(&[3000, 128], 1), normal(&[3000, 128], 2));
    group.throughput(Throughput::Elements(3000 * 128 * 128));
    group.bench_function("matmul_tn 128x3000x128", |bench| bench.iter(|| matmul_tn(&a, &b)));
    group.finish();
}

/// x w + b and softplus, and back to x, w and b.
fn linear(c: &mut Criterion) {
    for (v, width) in [(4000, 128), (16000, 128), (4000, 256)] {
        let x = Arc::new(normal(&[v, width], 1));
        let mut w = normal(&[width, width], 2);
        w.data_mut().iter_mut().for_each(|w| *w /= (width as f32).sqrt());
        let (w, b) = (Arc::new(w), Arc::new(normal(&[1, width], 3)));
        let seed = normal(&[v, width], 4);
        let mut tape = Tape::new();
        c.bench_function(&format!("linear {v}x{width}"), |bench| {
            let step = |seed: Tensor| {
                tape.clear();
                let [x, w, b] = [&x, &w, &b].map(|t| tape.shared(t.clone(), true));
                let z = tape.linear(x, w, b);
                let y = tape.softplus(z, 100.0);
                tape.pull([(y, seed)])
            };
            bench.iter_batched(|| seed.clone(), step, BatchSize::PerIteration);
        });
    }
}

criterion_group! { name = benches; config = common::criterion(); targets = linear, products }

fn main() {
    common::in_pool(benches);
}
