//! Which tiles an instruction set has.

#[cfg(target_arch = "aarch64")]
use super::neon::Neon;
use super::portable::Portable;
use super::tile::MicroKernel;
#[cfg(target_arch = "x86_64")]
use super::{avx2::Avx2, avx512::Avx512};
use crate::simd::InstructionSet;

/// Columns of a panel at an instruction set.
pub(super) fn panel_columns(set: InstructionSet) -> usize {
    match set {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => Avx512::COLUMNS,
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => Avx2::COLUMNS,
        #[cfg(target_arch = "aarch64")]
        InstructionSet::Neon => Neon::COLUMNS,
        _ => Portable::COLUMNS,
    }
}

/// Whether products at an instruction set round once for multiply and add.
#[cfg(test)]
pub(in crate::simd) fn fuses(set: InstructionSet) -> bool {
    match set {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => Avx512::FUSED,
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => Avx2::FUSED,
        #[cfg(target_arch = "aarch64")]
        InstructionSet::Neon => Neon::FUSED,
        _ => Portable::FUSED,
    }
}
