//! Compiles a loop once per instruction set and picks at run time: the only unsafe code of the crate.
//!
//! The loops are plain Rust; wider registers change the speed and never the result, because Rust neither fuses nor
//! reorders float operations. So the portable version is the twin of the others bit for bit.
#![allow(unsafe_code)]

/// The instruction sets a kernel is compiled for, from narrow to wide.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Level {
    /// What the target guarantees.
    Portable,
    /// 256-bit vectors.
    Avx2,
    /// 512-bit vectors.
    Avx512,
}

/// The widest level this processor has.
#[inline]
pub(crate) fn level() -> Level {
    #[cfg(target_arch = "x86_64")]
    {
        // The standard library caches the answer in an atomic.
        if std::arch::is_x86_feature_detected!("avx512f") && std::arch::is_x86_feature_detected!("avx512vl") {
            return Level::Avx512;
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            return Level::Avx2;
        }
    }
    Level::Portable
}

/// Defines a function whose body is compiled for every [`Level`] and dispatched at run time.
///
/// The first form takes no type parameters; a function parameter is written `f: impl Fn(f32) -> f32 + Copy`.
macro_rules! kernel {
    ($(#[$meta:meta])* $vis:vis fn $name:ident($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? $body:block) => {
        $(#[$meta])*
        #[allow(unsafe_code, clippy::too_many_arguments)]
        $vis fn $name($($arg: $ty),*) $(-> $ret)? {
            #[inline(always)]
            fn portable($($arg: $ty),*) $(-> $ret)? $body
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn avx2($($arg: $ty),*) $(-> $ret)? $body
                #[target_feature(enable = "avx512f,avx512vl")]
                fn avx512($($arg: $ty),*) $(-> $ret)? $body
                match $crate::tensor::level() {
                    // SAFETY: `level` has just found the features that these functions are compiled for.
                    $crate::tensor::Level::Avx512 => return unsafe { avx512($($arg),*) },
                    // SAFETY: as above.
                    $crate::tensor::Level::Avx2 => return unsafe { avx2($($arg),*) },
                    $crate::tensor::Level::Portable => {}
                }
            }
            portable($($arg),*)
        }
    };
}
pub(crate) use kernel;
