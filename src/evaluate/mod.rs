//! How good a reconstruction is: distances, normals, thresholds, and tables of them.
//!
//! A ground truth and a prediction are compared through samples of both ([`compare_samples`]) or, without a sampling
//! floor, from samples of one to the triangles of the other ([`compare_surfaces`]). [`evaluate`] does the sampling, the
//! choice of frame and the floor; [`evaluate_with_scan`] adds one-sided distances to a raw scan. A [`Protocol`] fixes
//! all of this, and the columns, as a family of published tables has it; [`Table`] prints many reports.

mod column;
mod compare;
mod metrics;
mod protocol;
mod render;
mod table;

pub use column::Column;
pub use compare::{Frame, GroundTruth, Options, Report, evaluate, evaluate_with_scan};
pub use metrics::{Directed, FScore, Metrics, Samples, compare_samples, compare_surfaces};
pub use protocol::Protocol;
pub use table::{Table, percentile};
