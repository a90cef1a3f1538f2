//! Values by their rank among others: medians and quantiles.

use std::cmp::Ordering;

/// Numbers in the order of `total_cmp`: what is not a number is beyond both infinities.
pub(crate) trait Ordered: Copy {
    /// How this number compares with another.
    fn order(&self, other: &Self) -> Ordering;
}

impl Ordered for f32 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl Ordered for f64 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

/// The value that has the given rank among all `values`, 0 for the least; the values change their places.
///
/// # Panics
/// If there are not more than `rank` values.
#[track_caller]
pub(crate) fn ranked<T: Ordered>(values: &mut [T], rank: usize) -> T {
    assert!(rank < values.len(), "rank {rank} of {} values", values.len());
    *values.select_nth_unstable_by(rank, T::order).1
}

/// The least of the `values` that is as large as the given share (0 to 1) of the others or larger: with 0 the least of
/// all, with 1 the largest. It is one of the values, not a number between two of them.
///
/// # Panics
/// If there are no values, or the share is not between 0 and 1.
#[track_caller]
pub(crate) fn quantile<T: Ordered>(mut values: Vec<T>, share: f64) -> T {
    assert!(!values.is_empty() && (0.0..=1.0).contains(&share), "share {share} of {} values", values.len());
    let rank = (share * (values.len() - 1) as f64).ceil() as usize;
    ranked(&mut values, rank)
}

/// The value in the middle; of the two in the middle of an even number of values, the larger.
///
/// # Panics
/// If there are no values.
#[track_caller]
pub(crate) fn median<T: Ordered>(values: Vec<T>) -> T {
    quantile(values, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// By sorting.
        #[test]
        fn are_those_of_the_sorted_values(
            values in prop::collection::vec(prop::num::f64::ANY, 1..13),
            share in 0.0f64..=1.0,
        ) {
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);
            let n = values.len();
            for (rank, want) in sorted.iter().enumerate() {
                prop_assert_eq!(ranked(&mut values.clone(), rank).to_bits(), want.to_bits());
            }
            prop_assert_eq!(median(values.clone()).to_bits(), sorted[n / 2].to_bits());
            let rank = (0..n).find(|&rank| rank as f64 >= share * (n - 1) as f64).unwrap();
            prop_assert_eq!(quantile(values, share).to_bits(), sorted[rank].to_bits());
        }
    }

    #[test]
    fn ends_and_middles() {
        assert_eq!([0.0, 0.5, 1.0].map(|share| quantile(vec![3.0, 1.0, 2.0], share)), [1.0, 2.0, 3.0]);
        assert_eq!((median(vec![4.0f32, 1.0]), median(vec![7.0f32])), (4.0, 7.0));
        assert_eq!(quantile((0..=10).map(f64::from).collect(), 0.9), 9.0);
    }

    #[test]
    #[should_panic(expected = "of 0 values")]
    fn nothing_has_no_median() {
        median::<f64>(Vec::new());
    }
}
