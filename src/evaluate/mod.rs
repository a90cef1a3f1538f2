//! How good a reconstruction is: distances, normals, thresholds, and tables of them.
//!
//! A ground truth and a prediction are compared through samples of both ([`compare_samples`]) or, without a sampling
//! floor, from samples of one to the triangles of the other ([`compare_surfaces`]). [`evaluate`] does the sampling, the
//! choice of frame and the floor; [`evaluate_with_scan`] adds one-sided distances to a raw scan, and
//! [`evaluate_points`] does the same for points in place of a predicted mesh. A [`Protocol`] fixes
//! all of this, and the columns, as a family of published tables has it; [`Table`] holds many reports, and
//! [`TextTable`] writes it and other tables up.
//!
//! `benches/compare.md` holds the numbers against those of an independent program: the two differ as two seeds of one.

mod column;
mod compare;
mod metrics;
mod points;
mod protocol;
mod sides;
mod table;
mod text_table;

pub use column::Column;
pub use compare::{CompareOptions, Report, evaluate, evaluate_with_scan};
pub use metrics::{Directed, FScore, Metrics, Samples, compare_samples, compare_surfaces};
pub use points::{PointsReport, evaluate_points};
pub use protocol::Protocol;
pub use sides::{Frame, GroundTruth};
pub use table::{Table, percentile};
pub use text_table::{Cell, TextTable};
