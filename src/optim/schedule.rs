//! The learning rate as a function of the step.

use std::f64::consts::PI;

/// How the rate falls after the warm-up.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Decay {
    /// The rate stays at its base.
    Constant,
    /// Half a cosine from 1 down to `floor` at the last step (Loshchilov, Hutter 2017, SGDR, equation 5).
    Cosine {
        /// Fraction of the base rate at the end.
        floor: f32,
    },
    /// Times `factor` every `every` steps after the warm-up.
    Step {
        /// Steps between two drops.
        every: usize,
        /// What the rate is multiplied by.
        factor: f32,
    },
}

/// A base rate, a linear warm-up and a decay.
///
/// ```
/// use bijective_sdf::optim::{Decay, Schedule};
///
/// let schedule = Schedule { base: 1.0, warmup: 4, decay: Decay::Cosine { floor: 0.0 } };
/// assert_eq!(schedule.rate_at(0, 104), 0.25);
/// assert_eq!(schedule.rate_at(4, 104), 1.0);
/// assert!((schedule.rate_at(54, 104) - 0.5).abs() < 1e-6);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schedule {
    /// The rate after the warm-up.
    pub base: f32,
    /// Steps over which the rate rises from base / warmup to base.
    pub warmup: usize,
    /// How the rate falls after the warm-up.
    pub decay: Decay,
}

impl Schedule {
    /// The same rate at every step.
    pub fn constant(base: f32) -> Self {
        Schedule { base, warmup: 0, decay: Decay::Constant }
    }

    /// The rate at step `step` (from 0) of `total`.
    pub fn rate_at(&self, step: usize, total: usize) -> f32 {
        if step < self.warmup {
            return (f64::from(self.base) * (step + 1) as f64 / self.warmup as f64) as f32;
        }
        let after = step - self.warmup;
        let factor = match self.decay {
            Decay::Constant => 1.0,
            Decay::Cosine { floor } => {
                let floor = f64::from(floor);
                let whole = total.saturating_sub(self.warmup).max(1);
                let done = (after as f64 / whole as f64).min(1.0);
                floor + (1.0 - floor) * 0.5 * (1.0 + (PI * done).cos())
            }
            Decay::Step { every, factor } => {
                let drops = i32::try_from(after / every.max(1)).unwrap_or(i32::MAX);
                f64::from(factor).powi(drops)
            }
        };
        (f64::from(self.base) * factor) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rises_then_falls_within_its_bounds(warmup in 0usize..20, total in 0usize..60, floor in 0f32..1.0) {
            for decay in [Decay::Constant, Decay::Cosine { floor }, Decay::Step { every: 7, factor: 0.5 }] {
                let s = Schedule { base: 0.1, warmup, decay };
                let rates: Vec<f32> = (0..total + 5).map(|i| s.rate_at(i, total)).collect();
                for (i, pair) in rates.windows(2).enumerate() {
                    let ordered = if i < warmup { pair[1] >= pair[0] } else { pair[1] <= pair[0] };
                    prop_assert!(ordered, "step {i} of {total}: {pair:?}");
                }
                prop_assert!(rates.iter().all(|r| (0.0..=0.1).contains(r)));
            }
        }
    }

    #[test]
    fn values_by_hand() {
        let s = Schedule { base: 1.0, warmup: 2, decay: Decay::Step { every: 3, factor: 0.1 } };
        let rates: Vec<f32> = (0..9).map(|i| s.rate_at(i, 9)).collect();
        let hand = [0.5, 1.0, 1.0, 1.0, 1.0, 0.1, 0.1, 0.1, 0.01];
        assert!(rates.iter().zip(hand).all(|(a, b)| (a - b).abs() < 1e-7));
        let s = Schedule { base: 1.0, warmup: 0, decay: Decay::Cosine { floor: 0.2 } };
        assert!((s.rate_at(10, 10) - 0.2).abs() < 1e-7 && (s.rate_at(99, 10) - 0.2).abs() < 1e-7);
        assert_eq!(Schedule::constant(0.3).rate_at(7, 0), 0.3);
    }
}
