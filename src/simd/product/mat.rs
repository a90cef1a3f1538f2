//! A matrix in a slice, for reading.

/// A matrix in a slice, row-major or the transpose of a row-major one: rows or columns are contiguous, and `stride`
/// values lie between their beginnings.
#[derive(Clone, Copy)]
pub(crate) struct MatRef<'a> {
    pub(super) data: &'a [f32],
    pub(super) rows: usize,
    pub(super) cols: usize,
    pub(super) stride: usize,
    pub(super) transposed: bool,
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

    pub(super) fn row_stride(self) -> usize {
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
