//! The matrix product on one thread, out = base + a b, at the speed of the instruction set.
//!
//! The right side is copied into [`Panels`] of a few columns each. The left side is read as it lies. A *tile* of the
//! result, some rows by the columns of a panel, stays in registers while the inner index runs; one file per instruction
//! set writes the tiles with its own vectors. Every value of the result is one chain of multiply-adds in the order of
//! the inner index for each [`DEPTH`] of it, and these partial sums are added in order: the same bits for every shape
//! of tile, and for every instruction set that fuses multiply and add.
#![allow(unsafe_code)]

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod kernels;
mod mat;
#[cfg(target_arch = "aarch64")]
mod neon;
mod panels;
mod portable;
#[cfg(test)]
mod tests;
mod tile;

#[cfg(test)]
pub(super) use kernels::fuses;
pub(crate) use mat::MatRef;
pub(crate) use panels::{DEPTH, Panels};

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use super::InstructionSet;
use tile::{MAX_TILE, MicroKernel, Tile, Tiles};

/// A rectangle of values in a slice, `stride` between the beginnings of its rows, that a product goes to.
pub(crate) struct Destination<'a> {
    pub(crate) data: &'a mut [f32],
    pub(crate) stride: usize,
    pub(crate) base: Base<'a>,
}

/// What a product is added to.
#[derive(Clone, Copy)]
pub(crate) enum Base<'a> {
    /// Nothing: the result is the product.
    Zero,
    /// What the result's place holds.
    Out,
    /// The same row for every row of the result, such as a bias: as many values as the result has columns.
    Row(&'a [f32]),
}

/// target = base + left times the matrix in the panels, on this thread.
///
/// # Panics
/// If the inner sides differ or the target is too short.
#[track_caller]
pub(crate) fn multiply(target: Destination<'_>, left: MatRef<'_>, right: &Panels) {
    let (m, k, n) = (left.rows(), left.cols(), right.cols());
    assert!(k == right.rows(), "product: [{m}x{k}] and [{}x{n}]", right.rows());
    if m == 0 || n == 0 {
        return;
    }
    let len = target.data.len();
    let end = (m - 1).checked_mul(target.stride).and_then(|last| last.checked_add(n));
    assert!(end.is_some_and(|end| end <= len), "product: result of {len} values for [{m}x{n}]");
    if let Base::Row(base) = target.base {
        assert!(base.len() == n, "product: row of {} values for [{m}x{n}]", base.len());
    }
    let set = right.instruction_set();
    // The panels may come from another place, and nothing below checks again.
    assert!(set.is_available(), "product: panels for {set:?}");
    match set {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => multiply_with::<avx512::Avx512>(target, left, right),
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => multiply_with::<avx2::Avx2>(target, left, right),
        #[cfg(target_arch = "aarch64")]
        InstructionSet::Neon => multiply_with::<neon::Neon>(target, left, right),
        _ => multiply_with::<portable::Portable>(target, left, right),
    }
}

/// [`multiply`] with the tiles of K. The processor has its instruction set, and the shapes fit.
fn multiply_with<K: MicroKernel>(target: Destination<'_>, left: MatRef<'_>, right: &Panels) {
    let Destination { data, stride, base } = target;
    let pick = |tiles: Tiles| if left.transposed { tiles.transposed } else { tiles.straight };
    let (wide, narrow) = (pick(K::TILES), pick(K::NARROW_TILES));
    // Where a tile goes that has more columns than are left of the result.
    let mut edge = [0.0f32; MAX_TILE];
    for first in (0..left.cols).step_by(DEPTH) {
        let depth = DEPTH.min(left.cols - first);
        let left = left.part(0, left.rows, first, depth);
        let base = if first == 0 { base } else { Base::Out };
        for column in (0..right.cols()).step_by(K::COLUMNS) {
            let width = K::COLUMNS.min(right.cols() - column);
            let (tiles, columns) =
                if width <= K::NARROW_COLUMNS { (narrow, K::NARROW_COLUMNS) } else { (wide, K::COLUMNS) };
            let panel = right.panel(first, column);
            debug_assert_eq!(panel.len(), depth * K::COLUMNS);
            let mut row = 0;
            while row < left.rows {
                let rows = rows_of_tile(left.rows - row, tiles.len());
                let at = row * stride + column;
                let (out, out_stride, base_here) = if width == columns {
                    (data[at..].as_mut_ptr(), stride, base)
                } else {
                    (edge.as_mut_ptr(), columns, Base::Zero)
                };
                let (base_at, base_stride) = match base_here {
                    Base::Zero => (std::ptr::null(), 0),
                    Base::Out => (out.cast_const(), out_stride),
                    Base::Row(row) => (row[column..].as_ptr(), 0),
                };
                let tile = Tile {
                    left: left.data[row * left.row_stride()..].as_ptr(),
                    left_stride: left.stride,
                    depth,
                    panel: panel.as_ptr(),
                    out,
                    out_stride,
                    base: base_at,
                    base_stride,
                };
                // SAFETY: `multiply` has found the instruction set, and has made sure that the result has room for
                // `left.rows` x `right.cols` values and that a base for all rows has `right.cols`. `edge` has room for
                // any tile. `left` holds its shape, which `MatRef` keeps; `panel` has `depth` rows of COLUMNS.
                unsafe { tiles[rows - 1](&tile) };
                if width < columns {
                    for (i, sums) in edge.chunks_exact(columns).take(rows).enumerate() {
                        let out = &mut data[at + i * stride..][..width];
                        match base {
                            Base::Zero => out.copy_from_slice(&sums[..width]),
                            Base::Out => out.iter_mut().zip(sums).for_each(|(o, &sum)| *o += sum),
                            Base::Row(row) => {
                                let base = row[column..].iter().zip(sums);
                                out.iter_mut().zip(base).for_each(|(o, (&b, &sum))| *o = b + sum);
                            }
                        }
                    }
                }
                row += rows;
            }
        }
    }
}

/// Rows of the next tile of `left` rows, where tiles have at most `most`: two tiles of about the same size are faster
/// than a full one and a small one.
fn rows_of_tile(left: usize, most: usize) -> usize {
    if left >= 2 * most || left == most {
        most
    } else if left > most {
        left.div_ceil(2)
    } else {
        left
    }
}
