//! Tiles of 256-bit vectors with fused multiply-adds: 6 x 16 values are twelve sums, two vectors of the panel and one
//! value of the left side at a time, in sixteen registers. Twelve chains cover the latency of two multiply-adds a
//! cycle.

use super::tile::{MicroKernel, Tile, TileFn, Tiles, each_row};
use std::arch::x86_64::{
    __m256, _mm256_add_ps, _mm256_broadcast_ss, _mm256_fmadd_ps, _mm256_loadu_ps, _mm256_setzero_ps,
    _mm256_storeu_ps,
};

pub(super) struct Avx2;

/// Values in a vector.
const LANES: usize = 8;

impl MicroKernel for Avx2 {
    const COLUMNS: usize = 2 * LANES;
    const NARROW_COLUMNS: usize = LANES;
    #[cfg(test)]
    const FUSED: bool = true;
    const TILES: Tiles = Tiles { straight: &wide::<false>(), transposed: &wide::<true>() };
    const NARROW_TILES: Tiles = Tiles { straight: &narrow::<false>(), transposed: &narrow::<true>() };
}

const fn wide<const TRANSPOSED: bool>() -> [TileFn; 6] {
    [
        tile::<1, 2, TRANSPOSED>,
        tile::<2, 2, TRANSPOSED>,
        tile::<3, 2, TRANSPOSED>,
        tile::<4, 2, TRANSPOSED>,
        tile::<5, 2, TRANSPOSED>,
        tile::<6, 2, TRANSPOSED>,
    ]
}

/// One vector a row: more rows for about as many chains. From ten rows on the compiler moves loads so far ahead that
/// some of the sums go through the stack.
const fn narrow<const TRANSPOSED: bool>() -> [TileFn; 8] {
    [
        tile::<1, 1, TRANSPOSED>,
        tile::<2, 1, TRANSPOSED>,
        tile::<3, 1, TRANSPOSED>,
        tile::<4, 1, TRANSPOSED>,
        tile::<5, 1, TRANSPOSED>,
        tile::<6, 1, TRANSPOSED>,
        tile::<7, 1, TRANSPOSED>,
        tile::<8, 1, TRANSPOSED>,
    ]
}

/// R rows by V vectors.
///
/// # Safety
/// As [`TileFn`].
#[target_feature(enable = "avx2,fma")]
unsafe fn tile<const R: usize, const V: usize, const TRANSPOSED: bool>(t: &Tile) {
    let (row_stride, col_stride) = if TRANSPOSED { (1, t.left_stride) } else { (t.left_stride, 1) };
    let mut sums = [[_mm256_setzero_ps(); V]; R];
    let (mut left, mut panel) = (t.left, t.panel);
    macro_rules! step {
        ($l:literal) => {
            // SAFETY: R rows of the left side and V vectors of a row of the panel can be read from where the pointers
            // are, for every inner index.
            unsafe {
                let panel = panel.add($l * Avx2::COLUMNS);
                let b: [__m256; V] = std::array::from_fn(|v| _mm256_loadu_ps(panel.add(v * LANES)));
                each_row!(R, |I| {
                    let x = _mm256_broadcast_ss(&*left.add(I * row_stride + $l * col_stride));
                    sums[I][0] = _mm256_fmadd_ps(x, b[0], sums[I][0]);
                    if V == 2 {
                        sums[I][V - 1] = _mm256_fmadd_ps(x, b[V - 1], sums[I][V - 1]);
                    }
                });
            }
        };
    }
    for _ in 0..t.depth / 4 {
        step!(0);
        step!(1);
        step!(2);
        step!(3);
        left = left.wrapping_add(4 * col_stride);
        panel = panel.wrapping_add(4 * Avx2::COLUMNS);
    }
    for _ in 0..t.depth % 4 {
        step!(0);
        left = left.wrapping_add(col_stride);
        panel = panel.wrapping_add(Avx2::COLUMNS);
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
#[target_feature(enable = "avx2,fma")]
#[inline]
unsafe fn store<const V: usize>(out: *mut f32, sums: [__m256; V], base: *const f32) {
    for (v, &sum) in sums.iter().enumerate() {
        // SAFETY: this is the v-th of V vectors.
        unsafe {
            let out = out.add(v * LANES);
            let sum =
                if base.is_null() { sum } else { _mm256_add_ps(_mm256_loadu_ps(base.add(v * LANES)), sum) };
            _mm256_storeu_ps(out, sum);
        }
    }
}
