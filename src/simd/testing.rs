//! Runs code at each instruction set of the processor in turn, for tests that compare them.

use super::InstructionSet;
use std::cell::Cell;

thread_local! {
    static FORCED: Cell<Option<InstructionSet>> = const { Cell::new(None) };
}

/// The instruction set that [`at`] has asked for on this thread.
pub(super) fn forced() -> Option<InstructionSet> {
    FORCED.get()
}

/// Every instruction set that this processor has, the portable one first.
pub(crate) fn available() -> Vec<InstructionSet> {
    let all = [InstructionSet::Portable, InstructionSet::Avx2, InstructionSet::Avx512];
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

/// Asserts that `f` gives the same bits at every instruction set, and returns them.
#[track_caller]
pub(crate) fn same_at_all(mut f: impl FnMut() -> Vec<f32>) -> Vec<f32> {
    let bits = |values: &[f32]| -> Vec<u32> { values.iter().map(|v| v.to_bits()).collect() };
    let portable = at(InstructionSet::Portable, &mut f);
    for set in available() {
        let found = at(set, &mut f);
        let differs = bits(&found).iter().zip(bits(&portable)).position(|(a, b)| *a != b);
        assert!(
            found.len() == portable.len() && differs.is_none(),
            "{set:?} differs from the portable loop at {differs:?}"
        );
    }
    portable
}
