//! Surfaces of scenes, which a scan saw in part only: what of a closed surface the points speak for, and the rest cut
//! away.

mod support;
mod trim;

pub use support::{Support, nearest_of, support};
pub use trim::{TRIM_FACTOR, Trimmed, trim};
