//! Initial values. Weights are c_in x c_out; everything is drawn from the generator that is passed in.

use crate::tensor::Tensor;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, Uniform};
use std::f32::consts::PI;
use std::ops::Range;

/// Values from the normal distribution of mean 0 and this standard deviation.
pub fn normal(dims: &[usize], deviation: f32, rng: &mut ChaCha8Rng) -> Tensor {
    let mut t = Tensor::zeros(dims);
    for v in t.data_mut() {
        let z: f32 = StandardNormal.sample(rng);
        *v = deviation * z;
    }
    t
}

/// Values uniform in [-bound, bound].
///
/// # Panics
/// If `bound` is negative or not finite.
#[track_caller]
pub fn uniform(dims: &[usize], bound: f32, rng: &mut ChaCha8Rng) -> Tensor {
    let distribution =
        Uniform::new_inclusive(-bound, bound).expect("init: the bound is finite and not negative");
    let mut t = Tensor::zeros(dims);
    t.data_mut().iter_mut().for_each(|v| *v = distribution.sample(rng));
    t
}

/// Uniform with variance 2 / c_in, which keeps the scale of activations through ReLU layers.
///
/// # References
/// He, Zhang, Ren, Sun 2015, Delving deep into rectifiers, equation 10.
pub fn kaiming_uniform(c_in: usize, c_out: usize, rng: &mut ChaCha8Rng) -> Tensor {
    uniform(&[c_in, c_out], (6.0 / c_in.max(1) as f32).sqrt(), rng)
}

/// Normal with variance 2 / c_in; as [`kaiming_uniform`].
pub fn kaiming_normal(c_in: usize, c_out: usize, rng: &mut ChaCha8Rng) -> Tensor {
    normal(&[c_in, c_out], (2.0 / c_in.max(1) as f32).sqrt(), rng)
}

/// Uniform with variance 2 / (c_in + c_out), which keeps the scale of values and of gradients through linear layers.
///
/// # References
/// Glorot, Bengio 2010, Understanding the difficulty of training deep feedforward networks, equation 16.
pub fn xavier_uniform(c_in: usize, c_out: usize, rng: &mut ChaCha8Rng) -> Tensor {
    uniform(&[c_in, c_out], (6.0 / (c_in + c_out).max(1) as f32).sqrt(), rng)
}

/// Normal with variance 2 / (c_in + c_out); as [`xavier_uniform`].
pub fn xavier_normal(c_in: usize, c_out: usize, rng: &mut ChaCha8Rng) -> Tensor {
    normal(&[c_in, c_out], (2.0 / (c_in + c_out).max(1) as f32).sqrt(), rng)
}

/// Weight and bias of a hidden layer of a field that starts as a sphere: normal with variance 2 / c_out, so that the
/// length of the input is kept through the ReLU; bias 0. The rows in `silent` start at 0: inputs that are not
/// coordinates, such as the octaves of an encoding.
///
/// # Panics
/// If `silent` ends past c_in.
///
/// # References
/// Atzmon, Lipman 2020, SAL: sign agnostic learning, theorem 1.
#[track_caller]
pub fn geometric_hidden(
    c_in: usize,
    c_out: usize,
    silent: Range<usize>,
    rng: &mut ChaCha8Rng,
) -> (Tensor, Tensor) {
    assert!(silent.end <= c_in, "geometric_hidden: rows {silent:?} of {c_in}");
    let mut weight = normal(&[c_in, c_out], (2.0 / c_out.max(1) as f32).sqrt(), rng);
    weight.data_mut()[silent.start * c_out..silent.end * c_out].fill(0.0);
    (weight, Tensor::zeros(&[1, c_out]))
}

/// Weight and bias of the last layer of a field that starts as a sphere of `radius`: all weights about
/// sqrt(pi / c_in), so that it sums the ReLUs to about the length of the input; bias -radius.
///
/// # References
/// As [`geometric_hidden`].
pub fn geometric_output(c_in: usize, radius: f32, rng: &mut ChaCha8Rng) -> (Tensor, Tensor) {
    let mean = (PI / c_in.max(1) as f32).sqrt();
    // A little noise, so that the units do not stay alike.
    let mut weight = normal(&[c_in, 1], 1e-4, rng);
    weight.data_mut().iter_mut().for_each(|w| *w += mean);
    (weight, Tensor::scalar(-radius))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn variances_are_as_stated() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (i, o) = (100, 300);
        let cases = [
            (kaiming_uniform(i, o, &mut rng), 2.0 / 100.0),
            (kaiming_normal(i, o, &mut rng), 2.0 / 100.0),
            (xavier_uniform(i, o, &mut rng), 2.0 / 400.0),
            (xavier_normal(i, o, &mut rng), 2.0 / 400.0),
        ];
        for (t, variance) in cases {
            assert_eq!(t.dims(), [i, o]);
            let mean = t.data().iter().sum::<f32>() / t.len() as f32;
            let measured = t.data().iter().map(|v| v * v).sum::<f32>() / t.len() as f32;
            // Three standard errors of 30000 normal draws: 2.5 percent.
            assert!((measured / variance - 1.0).abs() < 0.025, "{measured} {variance}");
            assert!(mean.abs() < 3.0 * (variance / t.len() as f32).sqrt());
        }
        assert!(kaiming_uniform(6, 50, &mut rng).data().iter().all(|v| v.abs() <= 1.0));
    }

    #[test]
    fn the_same_seed_gives_the_same_values() {
        let draw = |seed| normal(&[3, 3], 1.0, &mut ChaCha8Rng::seed_from_u64(seed));
        assert_eq!(draw(4), draw(4));
        assert_ne!(draw(4), draw(5));
    }

    #[test]
    fn silent_rows_are_zero() {
        let (w, b) = geometric_hidden(5, 4, 3..5, &mut ChaCha8Rng::seed_from_u64(1));
        assert!(w.data()[12..].iter().all(|&v| v == 0.0) && w.data()[..12].iter().all(|&v| v != 0.0));
        assert_eq!(b.data(), [0.0; 4]);
    }
}
