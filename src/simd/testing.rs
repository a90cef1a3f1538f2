//! Runs code at each instruction set of the processor in turn, for tests that compare them.

use super::{InstructionSet, product};
use proptest::collection::vec;
use proptest::prelude::*;
use std::cell::Cell;
use std::ops::Range;

thread_local! {
    static FORCED: Cell<Option<InstructionSet>> = const { Cell::new(None) };
}

/// The instruction set that [`at`] has asked for on this thread.
pub(super) fn forced() -> Option<InstructionSet> {
    FORCED.get()
}

/// Every instruction set that this processor has, the portable one first.
pub(crate) fn available() -> Vec<InstructionSet> {
    use InstructionSet::{Avx2, Avx512, Neon, Portable};
    let all = [Portable, Neon, Avx2, Avx512];
    all.into_iter().filter(|set| set.is_available()).collect()
}

/// Calls `f` with every kernel on this thread at `set`, which the processor must have; kernels on other threads stay at
/// the widest.
pub(crate) fn at<R>(set: InstructionSet, f: impl FnOnce() -> R) -> R {
    /// Takes the choice back, even if `f` panics.
    struct Restore(Option<InstructionSet>);
    impl Drop for Restore {
        fn drop(&mut self) {
            FORCED.set(self.0);
        }
    }
    assert!(set.is_available(), "{set:?} is not available");
    let _restore = Restore(FORCED.replace(Some(set)));
    f()
}

/// Asserts that `f`, on this thread, gives the same values at every instruction set, and returns them. The same is: the
/// same bits, or both not a number, since Rust leaves the bits of a NaN open.
#[track_caller]
pub(crate) fn same_at_all<T: Copy + Into<f64>>(f: impl FnMut() -> Vec<T>) -> Vec<T> {
    same_at(&available(), f)
}

/// [`same_at_all`] for what contains matrix products: at every instruction set that fuses multiply and add.
#[track_caller]
pub(crate) fn same_where_products_fuse<T: Copy + Into<f64>>(f: impl FnMut() -> Vec<T>) -> Vec<T> {
    let mut sets = available();
    sets.retain(|&set| product::fuses(set));
    same_at(&sets, f)
}

#[track_caller]
fn same_at<T: Copy + Into<f64>>(sets: &[InstructionSet], mut f: impl FnMut() -> Vec<T>) -> Vec<T> {
    // Widening keeps the bits apart, and subnormal values and the sign of zero.
    let bits = |x: &T| -> u64 {
        let x: f64 = (*x).into();
        if x.is_nan() { u64::MAX } else { x.to_bits() }
    };
    let Some((&first, others)) = sets.split_first() else { return f() };
    let expected = at(first, &mut f);
    for &set in others {
        let found = at(set, &mut f);
        let differs = found.iter().zip(&expected).position(|(a, b)| bits(a) != bits(b));
        assert!(
            found.len() == expected.len() && differs.is_none(),
            "{set:?} differs from {first:?} at {differs:?}"
        );
    }
    expected
}

/// N rows of as many values each: mostly of everyday size, and among them large, tiny, subnormal and infinite ones,
/// zeros of either sign and NaN.
pub(crate) fn rows<const N: usize>(len: Range<usize>) -> impl Strategy<Value = [Vec<f32>; N]> {
    let value = prop_oneof![
        12 => -8.0f32..8.0,
        1 => prop::sample::select(&[0.0, -0.0, 1.0, -1e30, 1e30, f32::MAX, 1e-30, -1e-40, f32::NAN][..]),
        1 => prop::num::f32::ANY,
    ];
    len.prop_flat_map(move |n| vec(value.clone(), N * n))
        .prop_map(|all| std::array::from_fn(|i| all[i * (all.len() / N)..][..all.len() / N].to_vec()))
}

#[test]
fn a_difference_between_instruction_sets_is_seen() {
    let two = [InstructionSet::Portable, InstructionSet::Portable];
    let differ = |a: f32, b: f32| {
        let mut calls = 0;
        let run = || {
            calls += 1;
            vec![1.0, if calls == 1 { a } else { b }]
        };
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| same_at(&two, run))).is_err()
    };
    assert!(
        differ(1.0, 1.0 + f32::EPSILON) && differ(0.0, -0.0) && differ(0.0, 1e-45) && differ(0.0, f32::NAN)
    );
    assert!(!differ(2.0, 2.0) && !differ(f32::NAN, -f32::NAN));
    for set in available() {
        assert_eq!(at(set, super::instruction_set), set);
    }
    assert_eq!(forced(), None);
}
