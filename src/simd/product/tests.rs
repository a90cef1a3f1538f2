//! One runner for the tiles of every instruction set: each is compared with a plain chain of multiply-adds, bit for
//! bit.

use super::kernels::{fuses, panel_columns};
use super::{Base, DEPTH, Destination, MatRef, Panels, multiply, rows_of_tile};
use crate::simd::InstructionSet;
use crate::simd::testing::{at, available};
use proptest::prelude::*;

fn values(n: usize, phase: f32) -> Vec<f32> {
    (0..n).map(|i| (i as f32 * 0.37 + phase).sin()).collect()
}

/// A product's shape and how its operands lie in memory.
#[derive(Clone, Copy, Debug)]
struct Case {
    m: usize,
    k: usize,
    n: usize,
    /// Whether the left and the right side are transposes of row-major matrices.
    transposed: [bool; 2],
    /// Values between the rows of all three matrices that belong to none.
    gap: usize,
    base: Start,
}

/// What the product is added to, see [`Base`].
#[derive(Clone, Copy, Debug)]
enum Start {
    Zero,
    Out,
    Row,
}

const STARTS: [Start; 3] = [Start::Zero, Start::Out, Start::Row];

/// A matrix out of `data` in the layout asked for.
fn lay(data: &[f32], rows: usize, cols: usize, gap: usize, transposed: bool) -> MatRef<'_> {
    if transposed {
        MatRef::window(data, cols, rows, rows + gap).t()
    } else {
        MatRef::window(data, rows, cols, cols + gap)
    }
}

/// The result's memory before and after the product at `set`, and what the chains of multiply-adds give.
fn run(case: Case, set: InstructionSet) -> (Vec<f32>, Vec<f32>) {
    let Case { m, k, n, transposed, gap, base } = case;
    let bias = values(n, 4.0);
    let data = [values((m + gap + 1) * (k + gap + 1), 1.1), values((k + gap + 1) * (n + gap + 1), 0.3)];
    let left = lay(&data[0], m, k, gap, transposed[0]);
    let right = lay(&data[1], k, n, gap, transposed[1]);
    let before = values(m * (n + gap), 2.0);

    let mut found = before.clone();
    at(set, || {
        let mut panels = Panels::new();
        // Once for another matrix, so that what is left of it in the padding would be seen.
        panels.fill(MatRef::window(&[f32::NAN; 34 * 70], 34, 70, 70));
        panels.fill(right);
        let base = match base {
            Start::Zero => Base::Zero,
            Start::Out => Base::Out,
            Start::Row => Base::Row(&bias),
        };
        multiply(Destination { data: &mut found, stride: n + gap, base }, left, &panels);
    });

    let fused = fuses(set);
    let mad = |a: f32, b: f32, c: f32| if fused { a.mul_add(b, c) } else { a * b + c };
    let mut want = before;
    for (i, row) in want.chunks_mut((n + gap).max(1)).enumerate() {
        for (j, o) in row.iter_mut().enumerate().take(n) {
            for first in (0..k).step_by(DEPTH) {
                let inner = first..(first + DEPTH).min(k);
                let sum = inner.fold(0.0, |sum, l| mad(left.at(i, l), right.at(l, j), sum));
                *o = match base {
                    _ if first > 0 => *o + sum,
                    Start::Zero => sum,
                    Start::Out => *o + sum,
                    Start::Row => bias[j] + sum,
                };
            }
        }
    }
    (found, want)
}

#[track_caller]
fn check(case: Case) {
    for set in available() {
        let (found, want) = run(case, set);
        let differs = found.iter().zip(&want).position(|(a, b)| a.to_bits() != b.to_bits());
        assert_eq!(differs, None, "{set:?}, {case:?}");
    }
}

#[test]
fn every_tile_is_a_chain_of_multiply_adds() {
    // All rows up to two full tiles and a bit, all columns up to a panel and a narrow one.
    for (m, n) in (1..=26).flat_map(|m| (1..=49).map(move |n| (m, n))) {
        let k = 1 + (3 * m + n) % 11;
        for transposed in [[false, false], [true, false], [false, true], [true, true]] {
            check(Case { m, k, n, transposed, gap: m % 3, base: STARTS[(m + n) % 3] });
        }
    }
}

#[test]
fn inner_sides_around_the_depth_of_a_panel() {
    for k in [DEPTH - 1, DEPTH, DEPTH + 1, 2 * DEPTH, 2 * DEPTH + 3] {
        for transposed in [[false, false], [true, false], [false, true], [true, true]] {
            for base in STARTS {
                check(Case { m: 14, k, n: 40, transposed, gap: 1, base });
            }
        }
    }
}

#[test]
fn panels_that_several_threads_fill() {
    for transposed in [[false, false], [false, true]] {
        check(Case { m: 3, k: 2 * DEPTH + 20, n: 300, transposed, gap: 0, base: Start::Zero });
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_shape_at_any_instruction_set(
        (m, k, n) in (1usize..60, 1usize..300, 1usize..90), transposed: [bool; 2], gap in 0usize..5,
        base in prop::sample::select(&STARTS[..]),
    ) {
        check(Case { m, k, n, transposed, gap, base });
    }
}

#[test]
fn tiles_cover_all_rows_once() {
    for most in 1..=12 {
        for rows in 1..=100 {
            let (mut left, mut smallest) = (rows, most);
            while left > 0 {
                let tile = rows_of_tile(left, most);
                assert!((1..=most).contains(&tile) && tile <= left);
                smallest = smallest.min(tile);
                left -= tile;
            }
            assert!(rows < most || smallest >= most / 2, "{rows} rows in tiles of {most}: one of {smallest}");
        }
    }
}

#[test]
fn nothing_is_written_for_an_empty_result() {
    let mut out = [7.0; 4];
    let mut panels = Panels::new();
    panels.fill(MatRef::window(&[], 3, 0, 0));
    multiply(
        Destination { data: &mut out, stride: 2, base: Base::Zero },
        MatRef::window(&[0.0; 6], 2, 3, 3),
        &panels,
    );
    panels.fill(MatRef::window(&[0.0; 6], 3, 2, 2));
    multiply(
        Destination { data: &mut out, stride: 2, base: Base::Zero },
        MatRef::window(&[], 0, 3, 3),
        &panels,
    );
    assert_eq!(out, [7.0; 4]);
}

#[test]
fn panels_begin_at_a_cache_line() {
    let mut panels = Panels::new();
    panels.fill(MatRef::window(&[1.0; 40], 5, 8, 8));
    assert_eq!(panels.panel(0, 0).as_ptr().align_offset(64), 0);
    assert_eq!(panels.panel(0, 0).len(), 5 * panel_columns(panels.instruction_set()));
}

#[test]
#[should_panic(expected = "matrix: 3 x 4, rows 4 apart, in 11 values")]
fn a_matrix_that_its_slice_does_not_hold_is_refused() {
    let _ = MatRef::window(&[0.0; 11], 3, 4, 4);
}

#[test]
#[should_panic(expected = "matrix: 2 x 4 from (2, 0) of 3 x 4")]
fn a_part_beyond_its_matrix_is_refused() {
    let _ = MatRef::window(&[0.0; 12], 3, 4, 4).part(2, 2, 0, 4);
}

#[test]
#[should_panic(expected = "product: result of 7 values for [2x4]")]
fn a_result_that_is_too_short_is_refused() {
    let mut panels = Panels::new();
    panels.fill(MatRef::window(&[0.0; 12], 3, 4, 4));
    multiply(
        Destination { data: &mut [0.0; 7], stride: 4, base: Base::Zero },
        MatRef::window(&[0.0; 6], 2, 3, 3),
        &panels,
    );
}

#[test]
#[should_panic(expected = "product: [2x2] and [3x4]")]
fn inner_sides_that_differ_are_refused() {
    let mut panels = Panels::new();
    panels.fill(MatRef::window(&[0.0; 12], 3, 4, 4));
    multiply(
        Destination { data: &mut [0.0; 8], stride: 4, base: Base::Zero },
        MatRef::window(&[0.0; 4], 2, 2, 2),
        &panels,
    );
}

#[test]
fn panels_for_an_instruction_set_that_is_not_there_are_refused() {
    for set in [InstructionSet::Neon, InstructionSet::Avx2, InstructionSet::Avx512] {
        let mut panels = Panels::new();
        panels.fill_for(set, MatRef::window(&[1.0; 12], 3, 4, 4));
        let run = || {
            let mut out = [0.0; 8];
            let target = Destination { data: &mut out, stride: 4, base: Base::Zero };
            multiply(target, MatRef::window(&[1.0; 6], 2, 3, 3), &panels);
            out
        };
        let found = std::panic::catch_unwind(run);
        if set.is_available() {
            assert_eq!(found.unwrap(), [3.0; 8]);
        } else {
            assert!(found.is_err(), "{set:?} ran");
        }
    }
}
