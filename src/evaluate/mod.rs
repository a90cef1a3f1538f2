//! How good a reconstruction is: distances, normals, thresholds, and tables of them.
//!
//! A ground truth and a prediction are compared through samples of both ([`compare_samples`]) or, without a sampling
//! floor, from samples of one to the triangles of the other ([`compare_surfaces`]). [`evaluate`] does the sampling, the
//! choice of frame and the floor; [`Table`] prints many reports.

mod metrics;
mod protocol;
mod table;

pub use metrics::{Directed, FScore, Metrics, Samples, compare_samples, compare_surfaces};
pub use protocol::{Frame, GroundTruth, Options, Report, evaluate};
pub use table::{Table, percentile};
