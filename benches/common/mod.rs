//! What the benchmark files share.
//!
//! Times are for the number of threads in `RAYON_NUM_THREADS` (all cores if unset). To keep one-thread and two-thread
//! figures apart, give each a baseline:
//! `RAYON_NUM_THREADS=1 cargo bench -- --save-baseline one`.
#![allow(dead_code)] // Every benchmark file is a program of its own and uses a part of this.

use bijective_sdf::Random;
use bijective_sdf::tensor::{Pool, Tensor};
use criterion::Criterion;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use std::time::Duration;

/// Few samples, so that all benchmarks together take a few minutes.
pub fn criterion() -> Criterion {
    Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2))
}

/// Runs a file's benchmarks on a thread of the pool, as a training step runs: from outside, every parallel loop would
/// wait for a thread to wake up.
pub fn in_pool(benches: fn()) {
    rayon::scope(|_| {
        benches();
        Criterion::default().configure_from_args().final_summary();
    });
}

/// The generator of a benchmark's inputs.
pub fn rng(seed: u64) -> Random {
    Random::new(seed)
}

/// Standard normal values, in recycled memory as on a tape.
pub fn normal(dims: &[usize], seed: u64) -> Tensor {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut t = Tensor::zeros(dims).into_pool(&Pool::default());
    t.data_mut().iter_mut().for_each(|v| *v = StandardNormal.sample(&mut rng));
    t
}

/// Points uniform in the unit cube, n x 3.
pub fn cube(n: usize, seed: u64) -> Vec<[f32; 3]> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..n).map(|_| std::array::from_fn(|_| rng.random())).collect()
}

/// Points within normal noise of a sphere, n x 3.
pub fn sphere(n: usize, radius: f32, noise: f32, seed: u64) -> Vec<[f32; 3]> {
    let (directions, offsets) = (normal(&[n, 3], seed).to_points(), normal(&[n, 3], seed ^ 1).to_points());
    let place = |(d, o): (&[f32; 3], &[f32; 3])| {
        let length = d.iter().map(|d| d * d).sum::<f32>().sqrt();
        std::array::from_fn(|i| radius * d[i] / length + noise * o[i])
    };
    directions.iter().zip(&offsets).map(place).collect()
}
