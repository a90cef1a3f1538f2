//! Dense row-major f32 arrays without gradients: storage, elementwise passes, reductions, products, row moves.
//!
//! A [`Tensor`] has up to four dimensions; most of the crate uses two, n rows by c columns. Every result takes its
//! memory from the [`Pool`] of its first operand, if that has one, and gives it back when it is dropped, so that a
//! training step that repeats the same shapes allocates nothing after the first.

mod buffer;
mod dense;
mod elementwise;
mod matmul;
mod reduce;
mod rows;
mod shape;

pub(crate) use crate::simd::product::{Base, DEPTH, MatRef, Panels};
pub use buffer::Pool;
pub use dense::Tensor;
pub(crate) use elementwise::{MIN_PARALLEL, copied, map, map_rows, map_to_two, map2, row_block};
pub(crate) use matmul::{gemm, gemm_panels_serial, gemm_serial};
pub use matmul::{matmul, matmul_nt, matmul_tn, matmul_tt};
pub(crate) use reduce::{add_row_sums, dot, lane_axpy, lane_dot, lane_max, lane_sum, sum_f64};
pub(crate) use rows::{gather_rows, scatter_add_rows};
pub use shape::{MAX_RANK, Shape};
