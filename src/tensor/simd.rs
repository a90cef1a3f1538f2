//! Compiles a loop once per instruction set and picks at run time, and the innermost loop of the matrix product: the
//! only unsafe code of the crate.
//!
//! The loops of [`kernel!`] are plain Rust; wider registers change the speed and never the result, because Rust neither
//! fuses nor reorders float operations. So the portable version is the twin of the others bit for bit. The matrix
//! product alone asks for fused multiply-adds where the processor has them; its order of additions is the same
//! everywhere.
#![allow(unsafe_code)]

use super::matmul::MatRef;

/// The instruction sets a kernel is compiled for, from narrow to wide.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Level {
    /// What the target guarantees.
    Portable,
    /// 256-bit vectors and fused multiply-adds.
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
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
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
                #[target_feature(enable = "avx2,fma")]
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

/// Where a product goes: m rows of `width` values, `stride` apart, over or onto what is there.
pub(crate) struct Target<'a> {
    pub(crate) data: &'a mut [f32],
    pub(crate) width: usize,
    pub(crate) stride: usize,
    pub(crate) add: bool,
}

/// Columns of a panel on this processor: what [`multiply_panel`] wants.
pub(crate) fn panel_width() -> usize {
    match level() {
        Level::Avx512 => 32,
        _ => 16,
    }
}

/// target (+)= left times a panel: k rows of `width` values, [`panel_width`] apart and at most so many.
///
/// Every value is one chain of multiply-adds in the order of k, whatever the instruction set.
///
/// # Panics
/// If a slice is too short for its shape.
#[track_caller]
pub(crate) fn multiply_panel(mut target: Target<'_>, left: MatRef<'_>, panel: &[f32]) {
    let MatRef { rows, cols, row_stride, col_stride, .. } = left;
    if rows == 0 || cols == 0 {
        return;
    }
    // All that the inner loop takes on trust.
    let last_row = (rows - 1).checked_mul(row_stride);
    let last = last_row.zip((cols - 1).checked_mul(col_stride)).and_then(|(r, c)| r.checked_add(c));
    assert!(last.is_some_and(|last| last < left.data.len()), "panel: left side too short");
    assert!((1..=panel_width()).contains(&target.width), "panel: width {}", target.width);
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2,fma")]
        fn avx2(target: &mut Target<'_>, left: MatRef<'_>, panel: &[f32]) {
            tiles::<6, 16>(target, left, panel, f32::mul_add);
        }
        #[target_feature(enable = "avx512f,avx512vl,fma")]
        fn avx512(target: &mut Target<'_>, left: MatRef<'_>, panel: &[f32]) {
            tiles::<8, 32>(target, left, panel, f32::mul_add);
        }
        match level() {
            // SAFETY: `level` has just found the features that these functions are compiled for.
            Level::Avx512 => return unsafe { avx512(&mut target, left, panel) },
            // SAFETY: as above.
            Level::Avx2 => return unsafe { avx2(&mut target, left, panel) },
            Level::Portable => {}
        }
    }
    if cfg!(target_arch = "aarch64") {
        tiles::<6, 16>(&mut target, left, panel, f32::mul_add);
    } else {
        // Without the instruction a fused multiply-add is a slow library call.
        tiles::<6, 16>(&mut target, left, panel, |a, b, c| a * b + c);
    }
}

/// All rows of the target, MR at a time and the rest one tile of what is left.
#[inline(always)]
fn tiles<const MR: usize, const NR: usize>(
    target: &mut Target<'_>,
    left: MatRef<'_>,
    panel: &[f32],
    mad: impl Fn(f32, f32, f32) -> f32 + Copy,
) {
    let mut first = 0;
    while first < left.rows {
        match left.rows - first {
            rest if rest >= MR => tile::<MR, NR>(target, left, first, panel, mad),
            1 => tile::<1, NR>(target, left, first, panel, mad),
            2 => tile::<2, NR>(target, left, first, panel, mad),
            3 => tile::<3, NR>(target, left, first, panel, mad),
            4 => tile::<4, NR>(target, left, first, panel, mad),
            5 => tile::<5, NR>(target, left, first, panel, mad),
            6 => tile::<6, NR>(target, left, first, panel, mad),
            _ => tile::<7, NR>(target, left, first, panel, mad),
        }
        first += MR;
    }
}

/// MR rows of the target from row `first` on; the sums stay in registers.
#[inline(always)]
fn tile<const MR: usize, const NR: usize>(
    target: &mut Target<'_>,
    left: MatRef<'_>,
    first: usize,
    panel: &[f32],
    mad: impl Fn(f32, f32, f32) -> f32 + Copy,
) {
    let MatRef { data, rows, cols, row_stride, col_stride } = left;
    debug_assert!(first + MR <= rows);
    let mut sums = [[0.0f32; NR]; MR];
    for (l, b) in panel[..cols * NR].as_chunks::<NR>().0.iter().enumerate() {
        for (i, sums) in sums.iter_mut().enumerate() {
            // SAFETY: the row is below `rows` and l is below `cols`, and `multiply_panel` has made sure that the last
            // value of the last row lies in `data`. A check here would keep the sums out of the registers.
            let x = unsafe { *data.get_unchecked((first + i) * row_stride + l * col_stride) };
            for (sum, &b) in sums.iter_mut().zip(b) {
                *sum = mad(x, b, *sum);
            }
        }
    }
    for (i, sums) in sums.iter().enumerate() {
        let out = &mut target.data[(first + i) * target.stride..][..target.width];
        match <&mut [f32; NR]>::try_from(&mut *out) {
            Ok(out) if target.add => out.iter_mut().zip(sums).for_each(|(o, s)| *o += s),
            Ok(out) => *out = *sums,
            Err(_) if target.add => out.iter_mut().zip(sums).for_each(|(o, s)| *o += s),
            Err(_) => out.copy_from_slice(&sums[..target.width]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(n: usize, phase: f32) -> Vec<f32> {
        (0..n).map(|i| (i as f32 * 0.37 + phase).sin()).collect()
    }

    #[test]
    fn a_panel_product_is_a_chain_of_multiply_adds_at_every_size() {
        let nr = panel_width();
        let fused = level() != Level::Portable || cfg!(target_arch = "aarch64");
        let mad = |a: f32, b: f32, c: f32| if fused { a.mul_add(b, c) } else { a * b + c };
        for (rows, cols, width) in
            (0..20).flat_map(|m| (0..9).flat_map(move |k| [1, nr / 2, nr].map(move |w| (m, k, w))))
        {
            let panel = values(cols * nr, 0.3);
            for (row_stride, col_stride) in [(cols.max(1), 1), (1, rows.max(1)), (2 * cols.max(1) + 1, 2)] {
                let data = values(rows * row_stride + cols * col_stride + 1, 1.1);
                for add in [false, true] {
                    let before = values(rows * (width + 3), 2.0);
                    let mut out = before.clone();
                    let left = MatRef { data: &data, rows, cols, row_stride, col_stride };
                    multiply_panel(Target { data: &mut out, width, stride: width + 3, add }, left, &panel);
                    for (at, (&found, &old)) in out.iter().zip(&before).enumerate() {
                        let (i, j) = (at / (width + 3), at % (width + 3));
                        let x = |l: usize| data[i * row_stride + l * col_stride];
                        let sum = (0..cols).fold(0.0, |sum, l| mad(x(l), panel[l * nr + j.min(nr - 1)], sum));
                        let want = if j >= width || cols == 0 {
                            old
                        } else if add {
                            old + sum
                        } else {
                            sum
                        };
                        assert_eq!(found.to_bits(), want.to_bits(), "{rows}x{cols}x{width}, {i} {j}");
                    }
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "left side too short")]
    fn a_left_side_that_is_too_short_is_refused() {
        let left = MatRef { data: &[0.0; 11], rows: 3, cols: 4, row_stride: 4, col_stride: 1 };
        let target = Target { data: &mut [0.0; 12], width: 4, stride: 4, add: false };
        multiply_panel(target, left, &[0.0; 4 * 32]);
    }
}
