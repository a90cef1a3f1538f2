//! A loop compiled once per instruction set and dispatched at run time.

/// Defines a function whose body is compiled for every [`InstructionSet`](super::InstructionSet) and dispatched to the
/// widest that the processor has.
///
/// The body is plain Rust. Wider registers change the speed and never the result, because Rust neither fuses nor
/// reorders float operations: the portable version is the twin of the others bit for bit. The function takes no type
/// parameters; a function parameter is written `f: impl Fn(f32) -> f32 + Copy`.
macro_rules! kernel {
    ($(#[$meta:meta])* $vis:vis fn $name:ident($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? $body:block) => {
        $(#[$meta])*
        #[allow(unsafe_code, clippy::too_many_arguments)]
        $vis fn $name($($arg: $ty),*) $(-> $ret)? {
            #[inline(always)]
            fn portable($($arg: $ty),*) $(-> $ret)? $body
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn avx2($($arg: $ty),*) $(-> $ret)? $body
                #[target_feature(enable = "avx512f,avx512vl,fma")]
                fn avx512($($arg: $ty),*) $(-> $ret)? $body
                use $crate::simd::{InstructionSet, instruction_set};
                match instruction_set() {
                    // SAFETY: `instruction_set` has just found the features that these functions are compiled for.
                    InstructionSet::Avx512 => return unsafe { avx512($($arg),*) },
                    // SAFETY: as above.
                    InstructionSet::Avx2 => return unsafe { avx2($($arg),*) },
                    // The target's own vectors are those of NEON on aarch64.
                    InstructionSet::Portable | InstructionSet::Neon => {}
                }
            }
            portable($($arg),*)
        }
    };
}
pub(crate) use kernel;
