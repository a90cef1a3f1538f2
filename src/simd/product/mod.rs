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
mod panels;
mod portable;
#[cfg(test)]
mod tests;

pub(crate) use panels::Panels;

use super::InstructionSet;

/// Inner indices that a panel covers: so many rows of a panel stay in the first-level cache.
pub(crate) const DEPTH: usize = 256;

/// A matrix in a slice, row-major or the transpose of a row-major one: rows or columns are contiguous, and `stride`
/// values lie between their beginnings.
#[derive(Clone, Copy)]
pub(crate) struct MatRef<'a> {
    data: &'a [f32],
    rows: usize,
    cols: usize,
    stride: usize,
    transposed: bool,
}

impl<'a> MatRef<'a> {
    /// rows x cols with contiguous rows `stride` apart.
    ///
    /// # Panics
    /// If the slice is too short for the shape.
    #[track_caller]
    pub(crate) fn window(data: &'a [f32], rows: usize, cols: usize, stride: usize) -> Self {
        let long_enough = rows == 0
            || cols == 0
            || (rows - 1)
                .checked_mul(stride)
                .and_then(|last| last.checked_add(cols))
                .is_some_and(|end| end <= data.len());
        assert!(long_enough, "matrix: {rows} x {cols}, rows {stride} apart, in {} values", data.len());
        MatRef { data, rows, cols, stride, transposed: false }
    }

    /// The transpose.
    pub(crate) fn t(self) -> Self {
        MatRef { rows: self.cols, cols: self.rows, transposed: !self.transposed, ..self }
    }

    pub(crate) fn rows(self) -> usize {
        self.rows
    }

    pub(crate) fn cols(self) -> usize {
        self.cols
    }

    /// Whether the columns are contiguous, not the rows.
    pub(crate) fn is_transposed(self) -> bool {
        self.transposed
    }

    fn row_stride(self) -> usize {
        if self.transposed { 1 } else { self.stride }
    }

    fn col_stride(self) -> usize {
        if self.transposed { self.stride } else { 1 }
    }

    /// The value at a row and a column.
    #[inline(always)]
    pub(crate) fn at(self, row: usize, col: usize) -> f32 {
        self.data[row * self.row_stride() + col * self.col_stride()]
    }

    /// The contiguous values of a row, or of a column if the matrix is [transposed](Self::is_transposed).
    #[inline(always)]
    pub(crate) fn line(self, i: usize) -> &'a [f32] {
        &self.data[i * self.stride..][..if self.transposed { self.rows } else { self.cols }]
    }

    /// `rows` x `cols` from a row and a column on.
    ///
    /// # Panics
    /// If it is not within the matrix.
    #[track_caller]
    pub(crate) fn part(self, first_row: usize, rows: usize, first_col: usize, cols: usize) -> Self {
        assert!(
            first_row + rows <= self.rows && first_col + cols <= self.cols,
            "matrix: {rows} x {cols} from ({first_row}, {first_col}) of {} x {}",
            self.rows,
            self.cols
        );
        let start = first_row * self.row_stride() + first_col * self.col_stride();
        MatRef { data: self.data.get(start..).unwrap_or_default(), rows, cols, ..self }
    }
}

/// A rectangle of values in a slice, `stride` between the beginnings of its rows, that a product goes to.
pub(crate) struct Target<'a> {
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

/// One tile of a product as its inner loop sees it; see [`TileFn`].
#[derive(Clone, Copy)]
struct Tile {
    /// The first value of the left side.
    left: *const f32,
    /// Values between the beginnings of the left side's rows, or of its columns if these are contiguous.
    left_stride: usize,
    /// Inner indices.
    depth: usize,
    /// `depth` rows of the kernel's columns.
    panel: *const f32,
    out: *mut f32,
    out_stride: usize,
    /// What the sums are added to: rows `base_stride` apart, or null for nothing.
    base: *const f32,
    base_stride: usize,
}

/// Values of a tile, at most.
const MAX_TILE: usize = 12 * 32;

/// Computes a tile of a fixed number of rows and columns.
///
/// # Safety
/// The processor has the kernel's instruction set; all values of the left side (rows x depth) and of the panel (depth x
/// the kernel's columns) can be read, as can the base's if it is not null; those of the result (rows x the tile's
/// columns) can be read and written.
type TileFn = unsafe fn(&Tile);

/// The tiles of 1, 2, ... rows with contiguous rows on the left side and those with contiguous columns.
struct Tiles {
    straight: &'static [TileFn],
    transposed: &'static [TileFn],
}

/// Runs a block for the rows 0, 1, ... of a tile, at most 12, each with the row as a constant. The sums of a tile stay
/// in registers only if none of them is reached through a variable index: loops, which the compiler may or may not
/// unroll in time, have put them on the stack.
#[cfg(target_arch = "x86_64")]
macro_rules! each_row {
    ($rows:expr, |$i:ident| $body:block) => {
        each_row!(@ $rows, $i, $body, 0 1 2 3 4 5 6 7 8 9 10 11);
    };
    (@ $rows:expr, $i:ident, $body:block, $($at:literal)*) => {
        $(if $at < $rows {
            const $i: usize = $at;
            $body
        })*
    };
}
#[cfg(target_arch = "x86_64")]
use each_row;

/// The tiles of an instruction set.
trait MicroKernel {
    /// Columns of a panel, 16 or 32.
    const COLUMNS: usize;
    /// Columns of the narrow tiles, for what is left of the columns.
    const NARROW_COLUMNS: usize;
    /// Whether multiply and add round once.
    const FUSED: bool;
    /// Tiles of [`COLUMNS`](Self::COLUMNS), up to as many rows as fit into the registers.
    const TILES: Tiles;
    /// Tiles of [`NARROW_COLUMNS`](Self::NARROW_COLUMNS).
    const NARROW_TILES: Tiles;
}

/// Columns of a panel at an instruction set.
fn panel_columns(set: InstructionSet) -> usize {
    match set {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => avx512::Avx512::COLUMNS,
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => avx2::Avx2::COLUMNS,
        _ => portable::Portable::COLUMNS,
    }
}

/// Whether products at an instruction set round once for multiply and add.
#[cfg(test)]
pub(super) fn fuses(set: InstructionSet) -> bool {
    match set {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => avx512::Avx512::FUSED,
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => avx2::Avx2::FUSED,
        _ => portable::Portable::FUSED,
    }
}

/// target = base + left times the matrix in the panels, on this thread.
///
/// # Panics
/// If the inner sides differ or the target is too short.
#[track_caller]
pub(crate) fn multiply(target: Target<'_>, left: MatRef<'_>, right: &Panels) {
    let (m, k, n) = (left.rows, left.cols, right.cols());
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
        _ => multiply_with::<portable::Portable>(target, left, right),
    }
}

/// [`multiply`] with the tiles of K. The processor has its instruction set, and the shapes fit.
fn multiply_with<K: MicroKernel>(target: Target<'_>, left: MatRef<'_>, right: &Panels) {
    let Target { data, stride, base } = target;
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
