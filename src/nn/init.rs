//! Initial values. Weights are c_in x c_out; everything is drawn from the generator that is passed in.

use crate::random::Random;
use crate::tensor::Tensor;
use rand_distr::{Distribution, StandardNormal, Uniform};

/// Values from the normal distribution of mean 0 and this standard deviation.
pub fn normal(dims: &[usize], deviation: f32, rng: &mut Random) -> Tensor {
    let mut t = Tensor::zeros(dims);
    for v in t.data_mut() {
        let z: f32 = StandardNormal.sample(rng.source());
        *v = deviation * z;
    }
    t
}

/// Values uniform in [-bound, bound].
///
/// # Panics
/// If `bound` is negative or not finite.
#[track_caller]
pub fn uniform(dims: &[usize], bound: f32, rng: &mut Random) -> Tensor {
    let distribution =
        Uniform::new_inclusive(-bound, bound).expect("init: the bound is finite and not negative");
    let mut t = Tensor::zeros(dims);
    t.data_mut().iter_mut().for_each(|v| *v = distribution.sample(rng.source()));
    t
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_values() {
        let draw = |seed| normal(&[3, 3], 1.0, &mut Random::new(seed));
        assert_eq!(draw(4), draw(4));
        assert_ne!(draw(4), draw(5));
    }
}
