//! What the tiles of every instruction set are.

/// One tile of a product as its inner loop sees it; see [`TileFn`].
#[derive(Clone, Copy)]
pub(super) struct Tile {
    /// The first value of the left side.
    pub left: *const f32,
    /// Values between the beginnings of the left side's rows, or of its columns if these are contiguous.
    pub left_stride: usize,
    /// Inner indices.
    pub depth: usize,
    /// `depth` rows of the kernel's columns.
    pub panel: *const f32,
    pub out: *mut f32,
    pub out_stride: usize,
    /// What the sums are added to: rows `base_stride` apart, or null for nothing.
    pub base: *const f32,
    pub base_stride: usize,
}

/// Values of a tile, at most.
pub(super) const MAX_TILE: usize = 12 * 32;

/// Computes a tile of a fixed number of rows and columns.
///
/// # Safety
/// The processor has the kernel's instruction set; all values of the left side (rows x depth) and of the panel (depth x
/// the kernel's columns) can be read, as can the base's if it is not null; those of the result (rows x the tile's
/// columns) can be read and written.
pub(super) type TileFn = unsafe fn(&Tile);

/// The tiles of 1, 2, ... rows with contiguous rows on the left side and those with contiguous columns.
pub(super) struct Tiles {
    pub straight: &'static [TileFn],
    pub transposed: &'static [TileFn],
}

/// Runs a block for the rows 0, 1, ... of a tile, at most 12, each with the row as a constant. The sums of a tile stay
/// in registers only if none of them is reached through a variable index: loops, which the compiler may or may not
/// unroll in time, have put them on the stack.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
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
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(super) use each_row;

/// The tiles of an instruction set.
pub(super) trait MicroKernel {
    /// Columns of a panel, 16 or 32.
    const COLUMNS: usize;
    /// Columns of the narrow tiles, for what is left of the columns.
    const NARROW_COLUMNS: usize;
    /// Whether multiply and add round once.
    #[cfg(test)]
    const FUSED: bool;
    /// Tiles of [`COLUMNS`](Self::COLUMNS), up to as many rows as fit into the registers.
    const TILES: Tiles;
    /// Tiles of [`NARROW_COLUMNS`](Self::NARROW_COLUMNS).
    const NARROW_TILES: Tiles;
}
