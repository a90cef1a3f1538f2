//! Tiles in plain Rust, for the target's own vectors: for processors without the other instruction sets.

use super::tile::{MicroKernel, Tile, TileFn, Tiles};

pub(super) struct Portable;

/// Rows of a tile.
const ROWS: usize = 6;

impl MicroKernel for Portable {
    const COLUMNS: usize = 16;
    const NARROW_COLUMNS: usize = 8;
    #[cfg(test)]
    const FUSED: bool = false;
    const TILES: Tiles = Tiles { straight: &tiles::<16, false>(), transposed: &tiles::<16, true>() };
    const NARROW_TILES: Tiles = Tiles { straight: &tiles::<8, false>(), transposed: &tiles::<8, true>() };
}

const fn tiles<const W: usize, const TRANSPOSED: bool>() -> [TileFn; ROWS] {
    [
        tile::<1, W, TRANSPOSED>,
        tile::<2, W, TRANSPOSED>,
        tile::<3, W, TRANSPOSED>,
        tile::<4, W, TRANSPOSED>,
        tile::<5, W, TRANSPOSED>,
        tile::<6, W, TRANSPOSED>,
    ]
}

/// R rows by W columns.
///
/// # Safety
/// As [`TileFn`].
unsafe fn tile<const R: usize, const W: usize, const TRANSPOSED: bool>(t: &Tile) {
    let (row_stride, col_stride) = if TRANSPOSED { (1, t.left_stride) } else { (t.left_stride, 1) };
    let mut sums = [[0.0f32; W]; R];
    for l in 0..t.depth {
        // SAFETY: the panel has `depth` rows of COLUMNS values, of which these are the first.
        let b = unsafe { &*t.panel.add(l * Portable::COLUMNS).cast::<[f32; W]>() };
        for (i, sums) in sums.iter_mut().enumerate() {
            // SAFETY: the left side has R x depth values.
            let x = unsafe { *t.left.add(i * row_stride + l * col_stride) };
            for (sum, &b) in sums.iter_mut().zip(b) {
                // Where there is no instruction for it, a fused multiply-add is a slow library call.
                *sum += x * b;
            }
        }
    }
    for (i, sums) in sums.iter().enumerate() {
        // SAFETY: a base has R rows of W values. It may be the result itself, so it is copied.
        let base = (!t.base.is_null()).then(|| unsafe { *t.base.add(i * t.base_stride).cast::<[f32; W]>() });
        // SAFETY: the result has R rows of W values, and no one else has them.
        let out = unsafe { &mut *t.out.add(i * t.out_stride).cast::<[f32; W]>() };
        match base {
            None => *out = *sums,
            Some(base) => out.iter_mut().zip(base.iter().zip(sums)).for_each(|(o, (b, sum))| *o = b + sum),
        }
    }
}
