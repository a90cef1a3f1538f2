//! Tiles of 512-bit vectors: 12 x 32 values are twenty-four sums, two vectors of the panel and one value of the left
//! side at a time, in thirty-two registers.

use super::tile::{MicroKernel, Tile, TileFn, Tiles, each_row};
use std::arch::x86_64::{
    __m512, _mm512_add_ps, _mm512_fmadd_ps, _mm512_loadu_ps, _mm512_set1_ps, _mm512_setzero_ps,
    _mm512_storeu_ps,
};

pub(super) struct Avx512;

/// Values in a vector.
const LANES: usize = 16;
/// Rows of a tile.
const ROWS: usize = 12;

impl MicroKernel for Avx512 {
    const COLUMNS: usize = 2 * LANES;
    const NARROW_COLUMNS: usize = LANES;
    #[cfg(test)]
    const FUSED: bool = true;
    const TILES: Tiles = Tiles { straight: &tiles::<2, false>(), transposed: &tiles::<2, true>() };
    const NARROW_TILES: Tiles = Tiles { straight: &tiles::<1, false>(), transposed: &tiles::<1, true>() };
}

const fn tiles<const V: usize, const TRANSPOSED: bool>() -> [TileFn; ROWS] {
    [
        tile::<1, V, TRANSPOSED>,
        tile::<2, V, TRANSPOSED>,
        tile::<3, V, TRANSPOSED>,
        tile::<4, V, TRANSPOSED>,
        tile::<5, V, TRANSPOSED>,
        tile::<6, V, TRANSPOSED>,
        tile::<7, V, TRANSPOSED>,
        tile::<8, V, TRANSPOSED>,
        tile::<9, V, TRANSPOSED>,
        tile::<10, V, TRANSPOSED>,
        tile::<11, V, TRANSPOSED>,
        tile::<12, V, TRANSPOSED>,
    ]
}

/// R rows by V vectors.
///
/// # Safety
/// As [`TileFn`].
#[target_feature(enable = "avx512f,avx512vl,fma")]
unsafe fn tile<const R: usize, const V: usize, const TRANSPOSED: bool>(t: &Tile) {
    let (row_stride, col_stride) = if TRANSPOSED { (1, t.left_stride) } else { (t.left_stride, 1) };
    let mut sums = [[_mm512_setzero_ps(); V]; R];
    // Where every third row begins: with one and two strides added in the address, twelve rows take four registers.
    let mut left: [*const f32; 4] = std::array::from_fn(|i| t.left.wrapping_add(3 * i * row_stride));
    let mut panel = t.panel;
    macro_rules! step {
        ($l:literal) => {
            // SAFETY: R rows of the left side and V vectors of a row of the panel can be read from where the pointers
            // are, for every inner index.
            unsafe {
                let panel = panel.add($l * Avx512::COLUMNS);
                let b: [__m512; V] = std::array::from_fn(|v| _mm512_loadu_ps(panel.add(v * LANES)));
                each_row!(R, |I| {
                    let x = _mm512_set1_ps(*left[I / 3].add((I % 3) * row_stride + $l * col_stride));
                    sums[I][0] = _mm512_fmadd_ps(x, b[0], sums[I][0]);
                    if V == 2 {
                        sums[I][V - 1] = _mm512_fmadd_ps(x, b[V - 1], sums[I][V - 1]);
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
        left = left.map(|left| left.wrapping_add(4 * col_stride));
        panel = panel.wrapping_add(4 * Avx512::COLUMNS);
    }
    for _ in 0..t.depth % 4 {
        step!(0);
        left = left.map(|left| left.wrapping_add(col_stride));
        panel = panel.wrapping_add(Avx512::COLUMNS);
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
#[target_feature(enable = "avx512f,avx512vl,fma")]
#[inline]
unsafe fn store<const V: usize>(out: *mut f32, sums: [__m512; V], base: *const f32) {
    for (v, &sum) in sums.iter().enumerate() {
        // SAFETY: this is the v-th of V vectors.
        unsafe {
            let out = out.add(v * LANES);
            let sum =
                if base.is_null() { sum } else { _mm512_add_ps(_mm512_loadu_ps(base.add(v * LANES)), sum) };
            _mm512_storeu_ps(out, sum);
        }
    }
}
