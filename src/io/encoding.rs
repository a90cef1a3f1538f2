//! How numbers are written: as bytes or as digits, with 32 or with 64 bits.

use crate::geometry::{Bounds, are_f32};

/// Whether numbers are written as bytes or as digits; both read back to the same bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Encoding {
    /// Little-endian binary where the format has it, else text.
    #[default]
    Binary,
    /// Text.
    Ascii,
}

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
