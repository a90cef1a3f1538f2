//! Fourier octaves of coordinates.

use crate::autodiff::{At, Op, Tape, Var};
use crate::simd::sin_cos_slice;
use crate::tensor::{Tensor, map_rows};

/// `[x, sin x, cos x, sin 2x, cos 2x, ...]`, each a block of c columns.
struct Fourier {
    octaves: usize,
}

impl Op<1> for Fourier {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        let c = x.cols();
        let width = c * (1 + 2 * self.octaves);
        let mut y = x.dirty(&[x.rows(), width]);
        map_rows(y.data_mut(), width, |first, piece| {
            let x = &x.data()[first * c..][..piece.len() / width.max(1) * c];
            let (mut scaled, mut sin, mut cos) = (x.to_vec(), vec![0.0; x.len()], vec![0.0; x.len()]);
            let mut place = |block: usize, values: &[f32]| {
                for (o, v) in piece.chunks_exact_mut(width.max(1)).zip(values.chunks_exact(c.max(1))) {
                    o[block * c..][..c].copy_from_slice(v);
                }
            };
            place(0, x);
            for octave in 0..self.octaves {
                sin_cos_slice(&mut sin, &mut cos, &scaled);
                place(1 + 2 * octave, &sin);
                place(2 + 2 * octave, &cos);
                scaled.iter_mut().for_each(|s| *s *= 2.0);
            }
        });
        (y, ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let c = at.x[0].cols();
        let mut dx = dy.dirty(at.x[0].dims());
        map_rows(dx.data_mut(), c, |first, piece| {
            for (i, o) in piece.chunks_exact_mut(c.max(1)).enumerate() {
                let (y, d) = (at.y.row(first + i), dy.row(first + i));
                o.copy_from_slice(&d[..c]);
                let mut frequency = 1.0;
                for octave in 0..self.octaves {
                    let (sin, cos) = ((1 + 2 * octave) * c, (2 + 2 * octave) * c);
                    for (j, o) in o.iter_mut().enumerate() {
                        *o += frequency * (d[sin + j] * y[cos + j] - d[cos + j] * y[sin + j]);
                    }
                    frequency *= 2.0;
                }
            }
        });
        [Some(dx)]
    }
}

impl Tape {
    /// `[x, sin x, cos x, sin 2x, cos 2x, ..., sin 2^(o-1) x, cos 2^(o-1) x]`: n x c to n x c (1 + 2 o).
    pub fn fourier(&mut self, x: Var, octaves: usize) -> Var {
        self.apply(Fourier { octaves }, [x])
    }
}

#[cfg(test)]
mod tests {
    use crate::autodiff::Tape;
    use crate::ops::testing::{check, normal};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..6, c in 1usize..5, octaves in 0usize..4, seed: u64) {
            check(|t, x| t.fourier(x[0], octaves), &[normal(&[n, c], seed)], seed);
        }

        #[test]
        fn agrees_with_plain_operations(n in 0usize..13, c in 1usize..5, seed: u64) {
            let mut t = Tape::new();
            let x = t.constant(normal(&[n, c], seed));
            let doubled = t.scale(x, 2.0);
            let parts = [x, t.sin(x), t.cos(x), t.sin(doubled), t.cos(doubled)];
            let (plain, fused) = (t.concat_cols(parts), t.fourier(x, 2));
            prop_assert_eq!(t.value(plain), t.value(fused));
        }
    }
}
