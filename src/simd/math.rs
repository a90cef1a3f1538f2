//! Elementary functions as polynomials, so that loops over slices vectorise.
//!
//! Each states its error against f64 over the range the tests sweep. All are total: NaN in, NaN out.

use super::kernel;

const LOG2_E: f32 = std::f32::consts::LOG2_E;
// ln 2 in two parts (Cody and Waite): n * LN2_HI is exact for |n| < 2^9.
const LN2_HI: f32 = 355.0 / 512.0;
const LN2_LO: f32 = -2.121_944_4e-4;
// Adding and subtracting 1.5 * 2^23 rounds to the nearest integer, which then stands in the low bits.
const ROUND: f32 = 12_582_912.0;

/// Below this, e^x counts as 0: smaller values soon make subnormal numbers, on which processors are many times slower.
const MIN_EXP: f32 = -80.0;

/// e^x; relative error below 2.5e-7 on [-80, 88], 0 below and held at about 1e38 above.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    // Written as a select on the untouched x so that NaN passes through.
    let c = if x > 88.0 { 88.0 } else { x };
    let c = if c < MIN_EXP { MIN_EXP } else { c };
    let shifted = c * LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = (c - n * LN2_HI) - n * LN2_LO;
    // Taylor to degree 6 on |r| <= ln 2 / 2: remainder 1.2e-7 relative. Pairs of terms do not wait for each other.
    let t = r * r;
    let p = (0.5 + r * (1.0 / 6.0)) + t * ((1.0 / 24.0 + r * (1.0 / 120.0)) + t * (1.0 / 720.0));
    let p = t * p + r + 1.0;
    // 2^n by putting n into the exponent bits.
    let scale = f32::from_bits(shifted.to_bits().wrapping_add(127) << 23);
    if x < MIN_EXP { 0.0 } else { p * scale }
}

/// ln(1 + u) = 2 atanh(s) from s = u / (2 + u) in [0, 1/3].
#[inline(always)]
fn ln_1p_from(s: f32) -> f32 {
    // The series is 1 to the last digit long before powers of s could become subnormal.
    let u = if s > 1e-4 { s } else { 1e-4 };
    let t = u * u;
    let (t2, t4) = (t * t, (t * t) * (t * t));
    let a = 1.0 + t * (1.0 / 3.0);
    let b = 1.0 / 5.0 + t * (1.0 / 7.0);
    // The series goes on with t^6 / 13: 0.0075 t^5 stands for it, to 2e-8 on t <= 1/9.
    let c = 1.0 / 9.0 + t * (1.0 / 11.0 + 0.0075);
    (a + t2 * b + t4 * c) * (2.0 * s)
}

/// 1 / (1 + e^-x); relative error below 3e-7.
#[inline(always)]
pub(crate) fn sigmoid(x: f32) -> f32 {
    let e = exp(-x.abs());
    let small = e / (1.0 + e);
    if x < 0.0 { small } else { 1.0 / (1.0 + e) + x * 0.0 }
}

/// tanh x; absolute error below 2e-7, relative below 1e-6.
#[inline(always)]
pub(crate) fn tanh(x: f32) -> f32 {
    let t = x * x;
    // Odd Taylor polynomial near 0, where 1 - e^-2|x| would cancel.
    let p = -1382.0 / 155_925.0;
    let p = p * t + 62.0 / 2835.0;
    let p = p * t - 17.0 / 315.0;
    let p = p * t + 2.0 / 15.0;
    let p = p * t - 1.0 / 3.0;
    let near = x + x * (p * t);
    let e = exp(-2.0 * x.abs());
    let far = ((1.0 - e) / (1.0 + e)).copysign(x);
    if x.abs() < 0.25 { near } else { far + x * 0.0 }
}

/// (sin x, cos x); absolute error below 3e-7 for |x| <= 1000.
#[inline(always)]
pub(crate) fn sin_cos(x: f32) -> (f32, f32) {
    // x = n * pi/2 + r with pi/2 in three parts.
    let shifted = x * std::f32::consts::FRAC_2_PI + ROUND;
    let n = shifted - ROUND;
    let r = ((x - n * 1.570_312_5) - n * 4.837_513e-4) - n * 7.549_79e-8;
    let t = r * r;
    let s = -1.0 / 5040.0 + t * (1.0 / 362_880.0);
    let s = s * t + 1.0 / 120.0;
    let s = s * t - 1.0 / 6.0;
    let sin = r + r * (s * t);
    let c = 1.0 / 40320.0 - t * (1.0 / 3_628_800.0);
    let c = c * t - 1.0 / 720.0;
    let c = c * t + 1.0 / 24.0;
    let c = c * t - 0.5;
    let cos = c * t + 1.0;
    let q = shifted.to_bits();
    let (a, b) = if q & 1 == 0 { (sin, cos) } else { (cos, sin) };
    // The sign of sine flips in quadrants 2 and 3, that of cosine in 1 and 2.
    let sin_sign = (q & 2) << 30;
    let cos_sign = (q.wrapping_add(1) & 2) << 30;
    (f32::from_bits(a.to_bits() ^ sin_sign), f32::from_bits(b.to_bits() ^ cos_sign))
}

kernel! {
    /// out = e^x.
    pub(crate) fn exp_slice(out: &mut [f32], x: &[f32]) {
        for (o, &x) in out.iter_mut().zip(x) { *o = exp(x); }
    }
}
/// Beyond this, ln(1 + e^x) is max(x, 0) and its slope 0 or 1; off by less than 5e-18.
const SOFTPLUS_CORNER: f32 = 40.0;

/// (ln(1 + e^x), 1 / (1 + e^-x)) from one exponential and one division; relative errors below 4e-7 above -40, 0 below.
#[inline(always)]
pub(crate) fn softplus_sigmoid(x: f32) -> (f32, f32) {
    let away = x.abs();
    let e = exp(-away);
    let e = if away > SOFTPLUS_CORNER { 0.0 } else { e };
    let (one, two) = (1.0 + e, 2.0 + e);
    // 1 / (1 + e) and s = e / (2 + e) from the inverse of their product.
    let inverse = 1.0 / (one * two);
    let s = e * (inverse * one);
    let large = inverse * two;
    let positive = if x > 0.0 { x } else { x * 0.0 };
    (positive + ln_1p_from(s), if x < 0.0 { e * large } else { large + x * 0.0 })
}

kernel! {
    /// value = ln(1 + e^(beta x)) / beta and slope = 1 / (1 + e^(-beta x)).
    pub(crate) fn softplus_sigmoid_slice(value: &mut [f32], slope: &mut [f32], x: &[f32], beta: f32) {
        let inverse = 1.0 / beta;
        for ((v, s), &x) in value.iter_mut().zip(slope.iter_mut()).zip(x) {
            let (a, b) = softplus_sigmoid(beta * x);
            *v = a * inverse;
            *s = b;
        }
    }
}
kernel! {
    /// out = 1 / (1 + e^(-beta x)).
    pub(crate) fn sigmoid_slice(out: &mut [f32], x: &[f32], beta: f32) {
        for (o, &x) in out.iter_mut().zip(x) { *o = sigmoid(beta * x); }
    }
}
kernel! {
    /// out = tanh x.
    pub(crate) fn tanh_slice(out: &mut [f32], x: &[f32]) {
        for (o, &x) in out.iter_mut().zip(x) { *o = tanh(x); }
    }
}
kernel! {
    /// sin and cos of every value.
    pub(crate) fn sin_cos_slice(sin: &mut [f32], cos: &mut [f32], x: &[f32]) {
        for ((s, c), &x) in sin.iter_mut().zip(cos.iter_mut()).zip(x) { (*s, *c) = sin_cos(x); }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::testing::{rows, same_at_all};
    use proptest::prelude::*;

    /// Largest (absolute, relative) error over a sweep of [lo, hi].
    fn sweep(lo: f64, hi: f64, f: impl Fn(f32) -> f32, truth: impl Fn(f64) -> f64) -> (f64, f64) {
        let n = 200_003;
        (0..=n).fold((0.0, 0.0), |(a, r), i| {
            let x = (lo + (hi - lo) * i as f64 / n as f64) as f32;
            let t = truth(f64::from(x));
            let e = (f64::from(f(x)) - t).abs();
            (f64::max(a, e), f64::max(r, if t == 0.0 { 0.0 } else { e / t.abs() }))
        })
    }

    #[test]
    fn errors_stay_under_the_stated_bounds() {
        let (_, r) = sweep(-80.0, 88.0, exp, f64::exp);
        assert!(r < 2.5e-7, "exp {r:e}");
        let (_, r) = sweep(-80.0, 80.0, sigmoid, |x| 1.0 / (1.0 + (-x).exp()));
        assert!(r < 3e-7, "sigmoid {r:e}");
        let softplus = |x: f64| if x > 40.0 { x } else { x.exp().ln_1p() };
        let slope = |x: f64| 1.0 / (1.0 + (-x).exp());
        let (_, r) = sweep(-40.0, 80.0, |x| softplus_sigmoid(x).0, softplus);
        assert!(r < 4e-7, "softplus of the pair {r:e}");
        let (_, r) = sweep(-40.0, 80.0, |x| softplus_sigmoid(x).1, slope);
        assert!(r < 4e-7, "sigmoid of the pair {r:e}");
        let (a, _) = sweep(-90.0, -40.0, |x| softplus_sigmoid(x).0, softplus);
        let (b, _) = sweep(-90.0, -40.0, |x| softplus_sigmoid(x).1, slope);
        assert!(a < 5e-18 && b < 5e-18, "tails of the pair {a:e} {b:e}");
        let (a, r) = sweep(-12.0, 12.0, tanh, f64::tanh);
        assert!(a < 2e-7 && r < 1e-6, "tanh {a:e} {r:e}");
        let (a, _) = sweep(-1000.0, 1000.0, |x| sin_cos(x).0, f64::sin);
        assert!(a < 3e-7, "sin {a:e}");
        let (a, _) = sweep(-1000.0, 1000.0, |x| sin_cos(x).1, f64::cos);
        assert!(a < 3e-7, "cos {a:e}");
    }

    #[test]
    fn extremes_are_finite_and_nan_is_kept() {
        let softplus = |x| softplus_sigmoid(x).0;
        let slope = |x| softplus_sigmoid(x).1;
        let all: [&dyn Fn(f32) -> f32; 5] = [&exp, &softplus, &slope, &sigmoid, &tanh];
        for f in all {
            assert!(f(f32::NAN).is_nan());
            assert!(f(-1e30).is_finite());
        }
        assert!(sin_cos(f32::NAN).0.is_nan() && sin_cos(f32::NAN).1.is_nan());
        assert_eq!(softplus(1e30), 1e30);
        assert_eq!((tanh(50.0), tanh(-50.0), tanh(0.0)), (1.0, -1.0, 0.0));
    }

    #[test]
    fn no_result_is_subnormal() {
        for i in 0..=40_000 {
            let x = i as f32 * -0.005;
            let (value, slope) = softplus_sigmoid(x);
            assert!(
                [exp(x), sigmoid(x), value, slope, value * 0.01].iter().all(|y| !y.is_subnormal()),
                "{x}"
            );
        }
    }

    proptest! {
        #[test]
        fn slices_are_the_functions_at_every_instruction_set([x] in rows(0..70), beta in 0.5f32..100.0) {
            let n = x.len();
            type Slices<'a> = &'a dyn Fn(&mut [f32], &mut [f32]);
            type Function<'a> = &'a dyn Fn(f32) -> (f32, f32);
            let all: [(Slices<'_>, Function<'_>); 5] = [
                (&|a, _| exp_slice(a, &x), &|x| (exp(x), 0.0)),
                (&|a, _| sigmoid_slice(a, &x, beta), &|x| (sigmoid(beta * x), 0.0)),
                (&|a, _| tanh_slice(a, &x), &|x| (tanh(x), 0.0)),
                (&|a, b| sin_cos_slice(a, b, &x), &sin_cos),
                (&|a, b| softplus_sigmoid_slice(a, b, &x, beta), &|x| {
                    let (value, slope) = softplus_sigmoid(beta * x);
                    (value * (1.0 / beta), slope)
                }),
            ];
            for (i, (slices, function)) in all.into_iter().enumerate() {
                let found = same_at_all(|| {
                    let mut out = vec![0.0; 2 * n];
                    let (a, b) = out.split_at_mut(n);
                    slices(a, b);
                    out
                });
                for (j, &x) in x.iter().enumerate() {
                    for (found, want) in [(found[j], function(x).0), (found[n + j], function(x).1)] {
                        let same = found.to_bits() == want.to_bits() || found.is_nan() && want.is_nan();
                        prop_assert!(same, "function {i} of {x}: {found} is not {want}");
                    }
                }
            }
        }
    }
}
