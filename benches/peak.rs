//! How near the matrix product comes to what the processor can do at all: GFLOP/s of every instruction set on one
//! thread, beside a loop of multiply-adds that touches nothing but registers. A slower product shows as a smaller share
//! of the peak, on whichever machine this runs.
//!
//! `cargo bench --bench peak`. Each figure is the best of many short runs, which is what a loaded machine disturbs
//! least; peak and products take turns.
#![allow(unsafe_code)]

// The loops are not public: this program compiles them once more, and uses a part of them.
#[allow(dead_code, unused_imports)]
#[path = "../src/simd/mod.rs"]
mod simd;

use simd::product::{Base, DEPTH, Destination, MatRef, Panels, multiply};
use simd::{InstructionSet, instruction_set};
use std::hint::black_box;
use std::time::Instant;

/// Rows x inner x columns, with whether the left and the right side are transposes: layers of the field over a block of
/// vertices, their way back and the gradient of their weights; layers of the parameterization and its heads.
const SHAPES: [(usize, usize, usize, [bool; 2]); 14] = [
    (256, 21, 128, [false, false]),
    (256, 128, 128, [false, false]),
    (256, 128, 128, [false, true]),
    (128, 256, 128, [true, false]),
    (256, 256, 256, [false, false]),
    (256, 256, 256, [false, true]),
    (256, 256, 256, [true, false]),
    (3000, 128, 128, [false, false]),
    (128, 3000, 128, [true, false]),
    (4000, 32, 32, [false, false]),
    (4000, 64, 64, [false, false]),
    (3000, 32, 300, [false, true]),
    (3000, 300, 32, [false, false]),
    (256, 128, 3, [false, false]),
];

/// Rounds of all measurements.
const ROUNDS: usize = 12;

/// Seconds of the fastest of some calls, which together take about 10 ms.
fn best(mut f: impl FnMut()) -> f64 {
    let began = Instant::now();
    f();
    let once = began.elapsed().as_secs_f64();
    let calls = (0.01 / once.max(1e-9)).clamp(1.0, 1e4) as usize;
    (0..calls).fold(once, |best, _| {
        let began = Instant::now();
        f();
        best.min(began.elapsed().as_secs_f64())
    })
}

/// The sum of twelve chains of `turns` multiply-adds of 8 or 16 values each.
macro_rules! chains {
    ($name:ident, $features:literal, $lanes:literal) => {
        #[target_feature(enable = $features)]
        fn $name(turns: usize) -> f32 {
            let (x, y) = (black_box(0.999f32), black_box(0.5f32));
            let mut sums = [[0.0f32; $lanes]; 12];
            for _ in 0..turns {
                for sums in &mut sums {
                    for sum in sums {
                        *sum = sum.mul_add(x, y);
                    }
                }
            }
            sums.as_flattened().iter().sum()
        }
    };
}
#[cfg(target_arch = "x86_64")]
chains!(chains_avx2, "avx2,fma", 8);
#[cfg(target_arch = "x86_64")]
chains!(chains_avx512, "avx512f,avx512vl,fma", 16);
// Two vectors a chain: four multiply-adds a cycle that take four cycles each need 16 chains.
#[cfg(target_arch = "aarch64")]
chains!(chains_neon, "neon", 8);

/// GFLOP/s of a loop that touches nothing but registers; `None` for the portable loop, whose vectors are the target's.
fn peak(set: InstructionSet) -> Option<f64> {
    const TURNS: usize = 20_000;
    #[cfg(target_arch = "x86_64")]
    {
        let flops = |lanes: usize| (TURNS * 12 * lanes * 2) as f64;
        match set {
            // SAFETY: `main` goes through the instruction sets that the processor has.
            InstructionSet::Avx2 => {
                return Some(flops(8) / best(|| _ = black_box(unsafe { chains_avx2(TURNS) })) / 1e9);
            }
            // SAFETY: as above.
            InstructionSet::Avx512 => {
                return Some(flops(16) / best(|| _ = black_box(unsafe { chains_avx512(TURNS) })) / 1e9);
            }
            InstructionSet::Portable | InstructionSet::Neon => {}
        }
    }
    #[cfg(target_arch = "aarch64")]
    if set == InstructionSet::Neon {
        // SAFETY: every such processor has NEON.
        return Some(
            (TURNS * 12 * 8 * 2) as f64 / best(|| _ = black_box(unsafe { chains_neon(TURNS) })) / 1e9,
        );
    }
    None
}

/// GFLOP/s of a product, panels included.
fn product(set: InstructionSet, (m, k, n, transposed): (usize, usize, usize, [bool; 2])) -> f64 {
    let values = |len: usize| -> Vec<f32> { (0..len).map(|i| (i as f32 * 0.37).sin()).collect() };
    let (a, b) = (values(m * k), values(k * n));
    let lay = |data, rows, cols, transposed| {
        if transposed {
            MatRef::window(data, cols, rows, rows).t()
        } else {
            MatRef::window(data, rows, cols, cols)
        }
    };
    let (left, right) = (lay(&a[..], m, k, transposed[0]), lay(&b[..], k, n, transposed[1]));
    let mut out = vec![0.0; m * n];
    let mut panels = Panels::new();
    let seconds = best(|| {
        for first in (0..k).step_by(DEPTH) {
            let depth = DEPTH.min(k - first);
            panels.fill_for(set, right.part(first, depth, 0, n));
            let base = if first == 0 { Base::Zero } else { Base::Out };
            let target = Destination { data: &mut out, stride: n, base };
            multiply(target, left.part(0, m, first, depth), &panels);
        }
        black_box(&mut out);
    });
    (2 * m * k * n) as f64 / seconds / 1e9
}

fn main() {
    // `cargo test --benches` and `cargo bench -- --test` only ask whether it runs.
    let rounds = if std::env::args().any(|arg| arg == "--test") { 1 } else { ROUNDS };
    use InstructionSet::{Avx2, Avx512, Neon, Portable};
    let sets = [Portable, Neon, Avx2, Avx512];
    for set in sets.into_iter().filter(|set| set.is_available()) {
        let mut most = 0.0f64;
        let mut found = [0.0f64; SHAPES.len()];
        for _ in 0..rounds {
            for (found, shape) in found.iter_mut().zip(SHAPES) {
                most = most.max(peak(set).unwrap_or(0.0));
                *found = found.max(product(set, shape));
            }
        }
        let widest = if set == instruction_set() { ", the widest here" } else { "" };
        // The portable loop has no peak of its own.
        let peak = if most > 0.0 { format!(": registers alone {most:.0} GFLOP/s") } else { String::new() };
        println!("{set:?}{widest}{peak}");
        for (found, (m, k, n, [left, right])) in found.into_iter().zip(SHAPES) {
            let mark = |transposed: bool| if transposed { "'" } else { "" };
            let name = format!("{m} x {k}{} x {n}{}", mark(left), mark(right));
            let share = if most > 0.0 { format!("{:4.0} %", 100.0 * found / most) } else { String::new() };
            println!("  {name:22} {found:6.1} GFLOP/s {share}");
        }
    }
}
