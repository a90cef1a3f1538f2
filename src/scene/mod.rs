//! Surfaces of scenes, which a scan saw in part only: how well the points support each part of a closed surface, and
//! the unsupported parts cut away.

mod boundary;
mod support;
#[cfg(test)]
mod testing;
mod trim;

pub use support::{PointSupport, nearest_of, point_support};
pub use trim::{TRIM_FACTOR, Trimmed, trim};
