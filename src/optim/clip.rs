//! The length of all gradients together, and a bound on it.

use crate::simd::kernel;
use crate::tensor::Tensor;

kernel! {
    /// The sum of squares in f64, in eight interleaved partial sums folded in a fixed order.
    fn square_sum(x: &[f32]) -> f64 {
        let (x8, rest) = x.as_chunks::<8>();
        let mut sums = [0.0f64; 8];
        for x in x8 {
            for i in 0..8 { sums[i] += f64::from(x[i]) * f64::from(x[i]); }
        }
        let mut total = 0.0;
        for &x in rest { total += f64::from(x) * f64::from(x); }
        for s in sums { total += s; }
        total
    }
}

kernel! {
    fn scale(x: &mut [f32], s: f32) {
        for x in x.iter_mut() { *x *= s; }
    }
}

/// The Euclidean length of all gradients taken as one vector; NaN or infinite if any value is.
///
/// ```
/// use bijective_sdf::optim::gradient_norm;
/// use bijective_sdf::tensor::Tensor;
///
/// let gradients = [Some(Tensor::scalar(3.0)), None, Some(Tensor::scalar(4.0))];
/// assert_eq!(gradient_norm(&gradients), 5.0);
/// ```
pub fn gradient_norm(gradients: &[Option<Tensor>]) -> f64 {
    gradients.iter().flatten().map(|g| square_sum(g.data())).sum::<f64>().sqrt()
}

/// Scales all gradients by one factor so that their common length is at most `max`; returns the length before. If that
/// is not finite, nothing is changed: the caller has to drop the step.
pub fn clip_norm(gradients: &mut [Option<Tensor>], max: f64) -> f64 {
    let norm = gradient_norm(gradients);
    if norm.is_finite() && norm > max {
        for g in gradients.iter_mut().flatten() {
            scale(g.data_mut(), (max / norm) as f32);
        }
    }
    norm
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::normal;
    use crate::simd::testing::{rows, same_at_all};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set([x] in rows(0..70), s in -2.0f32..2.0) {
            same_at_all(|| vec![square_sum(&x)]);
            same_at_all(|| { let mut x = x.clone(); scale(&mut x, s); x });
        }
    }

    #[test]
    fn norms_agree_with_plain_sums_at_every_size() {
        for n in 0..40 {
            let g = [Some(normal(&[1, n], 1)), None, Some(normal(&[n, 2], 2))];
            let plain: f64 = g.iter().flatten().flat_map(|g| g.data()).map(|&v| f64::from(v).powi(2)).sum();
            assert!((gradient_norm(&g) - plain.sqrt()).abs() < 1e-12 * (1.0 + plain));
        }
    }

    #[test]
    fn clips_to_the_bound_keeps_the_direction_and_leaves_short_and_bad_ones() {
        let original = [Some(Tensor::scalar(30.0)), Some(Tensor::scalar(-40.0))];
        let mut g = original.clone();
        assert_eq!(clip_norm(&mut g, 5.0), 50.0);
        assert!((gradient_norm(&g) - 5.0).abs() < 1e-6);
        assert!((g[1].as_ref().unwrap().item() + 4.0).abs() < 1e-6);
        let mut g = original.clone();
        clip_norm(&mut g, 60.0);
        assert_eq!(g, original);
        let mut g = [Some(Tensor::scalar(f32::NAN)), Some(Tensor::scalar(9.0))];
        assert!(clip_norm(&mut g, 1.0).is_nan());
        assert_eq!(g[1].as_ref().unwrap().item(), 9.0);
    }
}
