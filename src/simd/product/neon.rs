//! Tiles of 128-bit vectors with fused multiply-adds: 6 x 16 values are 24 sums, four vectors of the panel and one
//! value of the left side at a time, in 32 registers. Four multiply-adds a cycle that take four cycles each, the most
//! that such processors do, need 16 chains.

use super::tile::{MicroKernel, Tile, TileFn, Tiles, each_row};
use std::arch::aarch64::{float32x4_t, vaddq_f32, vdupq_n_f32, vfmaq_n_f32, vld1q_f32, vst1q_f32};

pub(super) struct Neon;

/// Values in a vector.
const LANES: usize = 4;

impl MicroKernel for Neon {
    const COLUMNS: usize = 4 * LANES;
    const NARROW_COLUMNS: usize = 2 * LANES;
    #[cfg(test)]
    const FUSED: bool = true;
    const TILES: Tiles = Tiles { straight: &wide::<false>(), transposed: &wide::<true>() };
    const NARROW_TILES: Tiles = Tiles { straight: &narrow::<false>(), transposed: &narrow::<true>() };
}

const fn wide<const TRANSPOSED: bool>() -> [TileFn; 6] {
    [
        tile::<1, 4, TRANSPOSED>,
        tile::<2, 4, TRANSPOSED>,
        tile::<3, 4, TRANSPOSED>,
        tile::<4, 4, TRANSPOSED>,
        tile::<5, 4, TRANSPOSED>,
        tile::<6, 4, TRANSPOSED>,
    ]
}

const fn narrow<const TRANSPOSED: bool>() -> [TileFn; 10] {
    [
        tile::<1, 2, TRANSPOSED>,
        tile::<2, 2, TRANSPOSED>,
        tile::<3, 2, TRANSPOSED>,
        tile::<4, 2, TRANSPOSED>,
        tile::<5, 2, TRANSPOSED>,
        tile::<6, 2, TRANSPOSED>,
        tile::<7, 2, TRANSPOSED>,
        tile::<8, 2, TRANSPOSED>,
        tile::<9, 2, TRANSPOSED>,
        tile::<10, 2, TRANSPOSED>,
    ]
}

/// R rows by V vectors, 2 or 4.
///
/// # Safety
/// As [`TileFn`].
#[target_feature(enable = "neon")]
unsafe fn tile<const R: usize, const V: usize, const TRANSPOSED: bool>(t: &Tile) {
    let (row_stride, col_stride) = if TRANSPOSED { (1, t.left_stride) } else { (t.left_stride, 1) };
    let mut sums = [[vdupq_n_f32(0.0); V]; R];
    let (mut left, mut panel) = (t.left, t.panel);
    macro_rules! step {
        ($l:literal) => {
            // SAFETY: R rows of the left side and V vectors of a row of the panel can be read from where the pointers
            // are, for every inner index.
            unsafe {
                let panel = panel.add($l * Neon::COLUMNS);
                let b: [float32x4_t; V] = std::array::from_fn(|v| vld1q_f32(panel.add(v * LANES)));
                each_row!(R, |I| {
                    let x = *left.add(I * row_stride + $l * col_stride);
                    sums[I][0] = vfmaq_n_f32(sums[I][0], b[0], x);
                    sums[I][1] = vfmaq_n_f32(sums[I][1], b[1], x);
                    if V == 4 {
                        sums[I][V - 2] = vfmaq_n_f32(sums[I][V - 2], b[V - 2], x);
                        sums[I][V - 1] = vfmaq_n_f32(sums[I][V - 1], b[V - 1], x);
                    }
                });
            }
        };
    }
    for _ in 0..t.depth / 2 {
        step!(0);
        step!(1);
        left = left.wrapping_add(2 * col_stride);
        panel = panel.wrapping_add(2 * Neon::COLUMNS);
    }
    for _ in 0..t.depth % 2 {
        step!(0);
        left = left.wrapping_add(col_stride);
        panel = panel.wrapping_add(Neon::COLUMNS);
    }
    each_row!(R, |I| {
        // SAFETY: the result and its base, if there is one, have R rows of V vectors.
        unsafe { store(t.out.add(I * t.out_stride), sums[I], t.base.wrapping_add(I * t.base_stride)) };
    });
}

/// Writes the sums, added to the base if that is not null.
///
/// # Safety
/// `out` has as many values, and so has a base.
#[target_feature(enable = "neon")]
#[inline]
unsafe fn store<const V: usize>(out: *mut f32, sums: [float32x4_t; V], base: *const f32) {
    for (v, &sum) in sums.iter().enumerate() {
        // SAFETY: this is the v-th of V vectors.
        unsafe {
            let sum = if base.is_null() { sum } else { vaddq_f32(vld1q_f32(base.add(v * LANES)), sum) };
            vst1q_f32(out.add(v * LANES), sum);
        }
    }
}
