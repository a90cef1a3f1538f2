//! The right side of products, copied so that the inner loop reads it from front to back.

use super::MatRef;
use super::kernels::panel_columns;
use crate::simd::{InstructionSet, instruction_set};
use rayon::prelude::*;

/// Inner indices that a panel covers: this many rows of a panel stay in the first-level cache.
pub(crate) const DEPTH: usize = 256;

/// Values of a right side below which its panels are filled on the calling thread.
const MIN_PARALLEL_COPY: usize = 1 << 17;
/// Values in a cache line: panels begin at one.
const LINE: usize = 16;

/// A matrix, k x n, in panels: for each block of [`DEPTH`] rows, panel after panel of the columns, each row by row and
/// filled up with zeros.
#[derive(Clone, Debug)]
pub(crate) struct Panels {
    data: Vec<f32>,
    /// Where the panels begin in `data`.
    start: usize,
    rows: usize,
    cols: usize,
    set: InstructionSet,
}

impl Default for Panels {
    fn default() -> Self {
        Self::new()
    }
}

impl Panels {
    /// Of an empty matrix; holds no memory.
    pub(crate) const fn new() -> Self {
        Panels { data: Vec::new(), start: 0, rows: 0, cols: 0, set: InstructionSet::Portable }
    }

    /// Values that the memory they hold has room for.
    pub(crate) fn capacity(&self) -> usize {
        self.data.capacity()
    }

    pub(crate) fn rows(&self) -> usize {
        self.rows
    }

    pub(crate) fn cols(&self) -> usize {
        self.cols
    }

    /// Whose products they are for.
    pub(crate) fn instruction_set(&self) -> InstructionSet {
        self.set
    }

    /// Makes these the panels of a matrix, in the memory that is there.
    pub(crate) fn fill(&mut self, b: MatRef<'_>) {
        self.fill_for(instruction_set(), b);
    }

    /// [`fill`](Self::fill) for products at an instruction set, which need not be the widest.
    pub(crate) fn fill_for(&mut self, set: InstructionSet, b: MatRef<'_>) {
        self.set = set;
        (self.rows, self.cols) = (b.rows, b.cols);
        let width = panel_columns(self.set);
        let padded = b.cols.next_multiple_of(width);
        let len = b.rows * padded;
        if self.data.len() < len + LINE {
            self.data.resize(len + LINE, 0.0);
        }
        self.start = self.data.as_ptr().align_offset(LINE * size_of::<f32>()).min(LINE);
        let data = &mut self.data[self.start..][..len];
        let fill = |(i, part): (usize, &mut [f32])| {
            let rows = DEPTH.min(b.rows - i * DEPTH);
            let columns = (0..b.cols).step_by(width);
            for (column, panel) in columns.zip(part.chunks_exact_mut(rows * width)) {
                let b = b.part(i * DEPTH, rows, column, width.min(b.cols - column));
                if width == 32 { fill_panel::<32>(panel, b) } else { fill_panel::<16>(panel, b) }
            }
        };
        let deep = (DEPTH * padded).max(1);
        if len < MIN_PARALLEL_COPY {
            data.chunks_mut(deep).enumerate().for_each(fill);
        } else {
            data.par_chunks_mut(deep).enumerate().for_each(fill);
        }
    }

    /// The panel whose first value is at a row that is a multiple of [`DEPTH`] and a column that is one of the panel's
    /// width.
    pub(super) fn panel(&self, row: usize, column: usize) -> &[f32] {
        let width = panel_columns(self.set);
        let rows = DEPTH.min(self.rows - row);
        let at = self.start + row * self.cols.next_multiple_of(width) + rows * column;
        &self.data[at..][..rows * width]
    }
}

/// A panel of W columns out of k x c values, c <= W; zeros in the other columns.
fn fill_panel<const W: usize>(panel: &mut [f32], b: MatRef<'_>) {
    let rows = panel.as_chunks_mut::<W>().0;
    match (b.transposed, b.cols) {
        (false, c) if c == W => {
            for (l, to) in rows.iter_mut().enumerate() {
                to.copy_from_slice(b.line(l));
            }
        }
        (false, c) => {
            for (l, to) in rows.iter_mut().enumerate() {
                to[..c].copy_from_slice(b.line(l));
                to[c..].fill(0.0);
            }
        }
        (true, c) => {
            // Squares of eight by eight: both sides move along few cache lines at a time.
            let whole = if c == W { b.rows / 8 * 8 } else { 0 };
            for l in (0..whole).step_by(8) {
                for j in (0..W).step_by(8) {
                    let square: [[f32; 8]; 8] =
                        std::array::from_fn(|j8| *b.line(j + j8)[l..].first_chunk().expect("eight rows"));
                    for (l8, to) in rows[l..l + 8].iter_mut().enumerate() {
                        for (j8, from) in square.iter().enumerate() {
                            to[j + j8] = from[l8];
                        }
                    }
                }
            }
            for (l, to) in rows.iter_mut().enumerate().skip(whole) {
                for (j, to) in to[..c].iter_mut().enumerate() {
                    *to = b.line(j)[l];
                }
                to[c..].fill(0.0);
            }
        }
    }
}
