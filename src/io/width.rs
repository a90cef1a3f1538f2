//! With how many bits coordinates are written.

use crate::geometry::{Bounds, are_f32};

/// The bits that a coordinate is written with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Width {
    /// 32.
    Single,
    /// 64.
    Double,
}

impl Width {
    /// 32 bits where these hold all coordinates exactly.
    pub fn of_cloud(points: &[[f64; 3]]) -> Width {
        if are_f32(points) { Width::Single } else { Width::Double }
    }

    /// 32 bits, which every program reads, unless they would lose detail ([`Bounds::offset`] is not 0 then).
    pub fn of_mesh(verts: &[[f64; 3]]) -> Width {
        let near = Bounds::of(verts).is_ok_and(|bounds| bounds.offset() == [0.0; 3]);
        if near { Width::Single } else { Width::of_cloud(verts) }
    }
}
