//! The instruction sets that code is compiled for, and which of them the processor has.

/// The instruction sets a loop is compiled for, from narrow to wide.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum InstructionSet {
    /// What the compilation target guarantees.
    Portable,
    /// aarch64 with 128-bit vectors and fused multiply-adds, which every such processor has.
    Neon,
    /// x86-64 with 256-bit vectors (AVX2) and fused multiply-adds (FMA).
    Avx2,
    /// x86-64 with 512-bit vectors (AVX-512 F and VL).
    Avx512,
}

impl InstructionSet {
    /// Whether this processor has it.
    #[inline]
    pub(crate) fn is_available(self) -> bool {
        match self {
            InstructionSet::Portable => true,
            // The standard library caches the answers in an atomic.
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("fma")
            }
            InstructionSet::Neon => cfg!(target_arch = "aarch64"),
            #[cfg(not(target_arch = "x86_64"))]
            InstructionSet::Avx2 | InstructionSet::Avx512 => false,
        }
    }
}

/// The widest instruction set that this processor has.
#[inline]
pub(crate) fn instruction_set() -> InstructionSet {
    #[cfg(test)]
    if let Some(forced) = super::testing::forced() {
        return forced;
    }
    let wider = [InstructionSet::Avx512, InstructionSet::Avx2, InstructionSet::Neon];
    wider.into_iter().find(|set| set.is_available()).unwrap_or(InstructionSet::Portable)
}
