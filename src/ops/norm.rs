//! Layer normalisation and normalisation of rows to unit length.

use crate::autodiff::{At, Op, Tape, Var};
use crate::simd::kernel;
use crate::tensor::{Tensor, lane_dot, lane_sum, row_block};
use rayon::prelude::*;

/// y = (x - mean) / sqrt(var + eps) * gain + bias, over each row (Ba, Kiros, Hinton 2016).
struct LayerNorm {
    eps: f32,
}

kernel! {
    /// Normalised rows, and per row 1 / sqrt(var + eps).
    fn standardise(hat: &mut [f32], inverse: &mut [f32], x: &[f32], c: usize, eps: f32) {
        for ((hat, inverse), x) in hat.chunks_exact_mut(c).zip(inverse.iter_mut()).zip(x.chunks_exact(c)) {
            let mean = lane_sum(x) / c as f32;
            for (h, &x) in hat.iter_mut().zip(x) { *h = x - mean; }
            let var = lane_dot(hat, hat);
            *inverse = 1.0 / (var / c as f32 + eps).sqrt();
            for h in hat.iter_mut() { *h *= *inverse; }
        }
    }
}

kernel! {
    fn affine_rows(out: &mut [f32], hat: &[f32], gain: &[f32], bias: &[f32]) {
        for (o, hat) in out.chunks_exact_mut(gain.len()).zip(hat.chunks_exact(gain.len())) {
            for (((o, &h), &g), &b) in o.iter_mut().zip(hat).zip(gain).zip(bias) { *o = h * g + b; }
        }
    }
}

kernel! {
    /// dx = inverse (u - mean(u) - hat mean(u hat)), with u = dy gain.
    fn layer_norm_dx(dx: &mut [f32], dy: &[f32], hat: &[f32], inverse: &[f32], gain: &[f32]) {
        let c = gain.len();
        for (((dx, dy), hat), &inverse) in
            dx.chunks_exact_mut(c).zip(dy.chunks_exact(c)).zip(hat.chunks_exact(c)).zip(inverse)
        {
            for ((o, &d), &g) in dx.iter_mut().zip(dy).zip(gain) { *o = d * g; }
            let mean = lane_sum(dx) / c as f32;
            let along = lane_dot(dx, hat) / c as f32;
            for (o, &h) in dx.iter_mut().zip(hat) { *o = inverse * (*o - mean - h * along); }
        }
    }
}

impl Op<3> for LayerNorm {
    /// The standardised rows (n x c) and 1 / sqrt(var + eps) of each (n x 1).
    type Saved = (Tensor, Tensor);
    fn forward(&self, [x, gain, bias]: [&Tensor; 3]) -> (Tensor, Self::Saved) {
        let c = x.cols();
        assert!(
            gain.len() == c && bias.len() == c && c > 0,
            "layer_norm: {:?} with gain {:?} and bias {:?}",
            x.shape(),
            gain.shape(),
            bias.shape()
        );
        let (mut hat, mut inverse) = (x.uninit_like(x.dims()), x.uninit_like(&[x.rows(), 1]));
        let mut y = x.uninit_like(x.dims());
        let rows = row_block(c);
        y.data_mut()
            .par_chunks_mut(rows * c)
            .zip(hat.data_mut().par_chunks_mut(rows * c).zip(inverse.data_mut().par_chunks_mut(rows)))
            .zip(x.data().par_chunks(rows * c))
            .for_each(|((y, (hat, inverse)), x)| {
                standardise(hat, inverse, x, c, self.eps);
                affine_rows(y, hat, gain.data(), bias.data());
            });
        (y, (hat, inverse))
    }
    fn vjp(&self, at: At<'_, 3, Self::Saved>, dy: &Tensor) -> [Option<Tensor>; 3] {
        let (hat, inverse) = at.saved;
        let [_, gain, bias] = at.x;
        let c = dy.cols();
        let dx = at.needs[0].then(|| {
            let mut dx = dy.uninit_like(dy.dims());
            let rows = row_block(c);
            dx.data_mut()
                .par_chunks_mut(rows * c)
                .zip(dy.data().par_chunks(rows * c).zip(hat.data().par_chunks(rows * c)))
                .zip(inverse.data().par_chunks(rows))
                .for_each(|((dx, (dy, hat)), inverse)| layer_norm_dx(dx, dy, hat, inverse, gain.data()));
            dx
        });
        let dgain = at.needs[1].then(|| {
            let mut sum = dy.zeros_like_pool(gain.dims());
            for (dy, hat) in dy.data().chunks_exact(c).zip(hat.data().chunks_exact(c)) {
                for ((s, &d), &h) in sum.data_mut().iter_mut().zip(dy).zip(hat) {
                    *s += d * h;
                }
            }
            sum
        });
        let dbias = at.needs[2].then(|| {
            let mut sum = dy.zeros_like_pool(bias.dims());
            crate::tensor::add_row_sums(sum.data_mut(), dy.data());
            sum
        });
        [dx, dgain, dbias]
    }
}

/// Rows scaled to unit length. A row shorter than `FLOOR` is divided by `FLOOR` instead, and its gradient likewise: the
/// map stays finite and continuous at 0.
struct NormalizeRows;

const FLOOR: f32 = 1e-12;

impl Op<1> for NormalizeRows {
    /// 1 / max(length, FLOOR) of each row, n x 1.
    type Saved = Tensor;
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, Tensor) {
        let c = x.cols();
        let (mut y, mut inverse) = (x.uninit_like(x.dims()), x.uninit_like(&[x.rows(), 1]));
        let rows = y.data_mut().chunks_exact_mut(c.max(1)).zip(x.data().chunks_exact(c.max(1)));
        for ((y, x), inverse) in rows.zip(inverse.data_mut()) {
            // In f64 the square of a tiny f32 does not vanish.
            let length = x.iter().map(|&x| f64::from(x) * f64::from(x)).sum::<f64>().sqrt() as f32;
            *inverse = if length < FLOOR { 1.0 / FLOOR } else { 1.0 / length };
            for (y, &x) in y.iter_mut().zip(x) {
                *y = x * *inverse;
            }
        }
        (y, inverse)
    }
    fn vjp(&self, at: At<'_, 1, Tensor>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let c = dy.cols().max(1);
        let mut dx = dy.uninit_like(dy.dims());
        let rows = dx.data_mut().chunks_exact_mut(c).zip(dy.data().chunks_exact(c));
        for (((dx, dy), y), &inverse) in rows.zip(at.y.data().chunks_exact(c)).zip(at.saved.data()) {
            // Below the floor the divisor is a constant, so nothing is projected out.
            let along: f32 =
                if inverse >= 1.0 / FLOOR { 0.0 } else { dy.iter().zip(y).map(|(d, y)| d * y).sum() };
            for ((o, &d), &y) in dx.iter_mut().zip(dy).zip(y) {
                *o = (d - y * along) * inverse;
            }
        }
        [Some(dx)]
    }
}

impl Tape {
    /// Layer normalisation of each row, then gain and bias; x n x c, gain and bias 1 x c.
    ///
    /// # Panics
    /// If gain or bias does not have c values.
    #[track_caller]
    pub fn layer_norm(&mut self, x: Var, gain: Var, bias: Var, eps: f32) -> Var {
        self.apply(LayerNorm { eps }, [x, gain, bias])
    }

    /// Each row divided by its length; rows shorter than 1e-12 are divided by 1e-12, so a zero row stays zero.
    pub fn normalize_rows(&mut self, x: Var) -> Var {
        self.apply(NormalizeRows, [x])
    }
}

#[cfg(test)]
mod tests {
    use crate::autodiff::Tape;
    use crate::ops::testing::{check, matrix, normal, same_both_ways};
    use crate::simd::testing::rows;
    use crate::tensor::Tensor;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set([a, b, gain, bias] in rows(1..70), [dy] in rows(70..200)) {
            let x = [matrix(&[a, b]), matrix(&[gain]), matrix(&[bias])];
            same_both_ways(|t, x| t.layer_norm(x[0], x[1], x[2], 1e-5), &x, &dy);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..6, c in 2usize..8, seed: u64) {
            // A wide eps keeps rows that happen to be nearly constant away from the singularity.
            let inputs = [normal(&[n, c], seed), normal(&[1, c], seed ^ 1), normal(&[1, c], seed ^ 2)];
            check(|t, x| t.layer_norm(x[0], x[1], x[2], 0.1), &inputs, seed);
            let mut x = normal(&[n, c], seed ^ 3);
            x.data_mut().chunks_exact_mut(c).for_each(|r| r[0] += r[0].signum());
            check(|t, x| t.normalize_rows(x[0]), &[x], seed);
        }
    }

    #[test]
    fn rows_have_mean_zero_and_variance_one() {
        let mut t = Tape::new();
        let x = t.constant(normal(&[4, 50], 3));
        let (gain, bias) = (t.constant(Tensor::full(&[1, 50], 1.0)), t.constant(Tensor::zeros(&[1, 50])));
        let y = t.layer_norm(x, gain, bias, 1e-5);
        for row in t.value(y).data().chunks_exact(50) {
            let mean: f32 = row.iter().sum::<f32>() / 50.0;
            let var: f32 = row.iter().map(|v| v * v).sum::<f32>() / 50.0;
            assert!(mean.abs() < 1e-5 && (var - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn rows_of_several_blocks_are_what_they_are_alone() {
        let c = 8;
        let n = 2 * crate::tensor::row_block(c) + 5;
        let (x, seed) = (normal(&[n, c], 1), normal(&[n, c], 2));
        let both_ways = |x: &[f32], seed: &[f32]| {
            let mut t = Tape::new();
            let dims = [x.len() / c, c];
            let x = t.input(Tensor::from_vec(&dims, x.to_vec()));
            let (gain, bias) = (t.constant(normal(&[1, c], 3)), t.constant(normal(&[1, c], 4)));
            let y = t.layer_norm(x, gain, bias, 1e-5);
            let dx = t.pull([(y, Tensor::from_vec(&dims, seed.to_vec()))]).take(x).unwrap();
            [t.value(y).data().to_vec(), dx.data().to_vec()]
        };
        let whole = both_ways(x.data(), seed.data());
        for first in [0, n / 2 - 9, n - 9] {
            let rows = first * c..(first + 9) * c;
            let alone = both_ways(&x.data()[rows.clone()], &seed.data()[rows.clone()]);
            assert!((0..2).all(|i| alone[i] == whole[i][rows.clone()]), "rows from {first}");
        }
    }

    #[test]
    fn zero_rows_stay_finite_both_ways() {
        let mut t = Tape::new();
        let x = t.input(Tensor::from_vec(&[2, 3], vec![0.0, 0.0, 0.0, 3e-30, 4e-30, 0.0]));
        let y = t.normalize_rows(x);
        assert_eq!(&t.value(y).data()[..3], [0.0; 3]);
        let loss = t.sum(y);
        assert!(t.backward(loss).get(x).unwrap().is_finite());
    }
}
