//! Elementary functions, element by element: exp, ln, sin, cos, sqrt, abs, square, tanh.

use crate::autodiff::{At, Op, Tape, Var};
use crate::simd::{exp_slice, kernel, sin_cos_slice, tanh_slice};
use crate::tensor::{Tensor, map, map_to_two, map2};

/// Defines y = f(x) with dx = dy * g(x, y), both as loops over slices.
macro_rules! elementary {
    ($(#[$doc:meta])* $op:ident, $forward:expr, $gradient:ident, |$d:ident, $x:ident, $y:ident| $dx:expr) => {
        $(#[$doc])*
        struct $op;

        kernel! {
            fn $gradient(out: &mut [f32], d: &[f32], x: &[f32], y: &[f32]) {
                for (((o, &$d), &$x), &$y) in out.iter_mut().zip(d).zip(x).zip(y) { *o = $dx; }
            }
        }

        impl Op<1> for $op {
            type Saved = ();
            fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
                (map(x, $forward), ())
            }
            fn vjp(&self, at: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
                let mut dx = dy.uninit_like(dy.dims());
                $gradient(dx.data_mut(), dy.data(), at.x[0].data(), at.y.data());
                [Some(dx)]
            }
        }
    };
}

kernel! {
    fn ln_slice(out: &mut [f32], x: &[f32]) { for (o, &x) in out.iter_mut().zip(x) { *o = x.ln(); } }
}
kernel! {
    fn sqrt_slice(out: &mut [f32], x: &[f32]) { for (o, &x) in out.iter_mut().zip(x) { *o = x.sqrt(); } }
}
kernel! {
    fn abs_slice(out: &mut [f32], x: &[f32]) { for (o, &x) in out.iter_mut().zip(x) { *o = x.abs(); } }
}
kernel! {
    fn square_slice(out: &mut [f32], x: &[f32]) { for (o, &x) in out.iter_mut().zip(x) { *o = x * x; } }
}

elementary!(/** e^x. */ Exp, exp_slice, exp_gradient, |d, _x, y| d * y);
elementary!(/** Natural logarithm. */ Ln, ln_slice, ln_gradient, |d, x, _y| d / x);
elementary!(/** Square root; its slope at 0 is taken as 0. */ Sqrt, sqrt_slice, sqrt_gradient,
    |d, _x, y| if y > 0.0 { 0.5 * d / y } else { 0.0 });
elementary!(/** Absolute value; its slope at 0 is taken as 0. */ Abs, abs_slice, abs_gradient,
    |d, x, _y| if x > 0.0 { d } else if x < 0.0 { -d } else { 0.0 });
elementary!(/** x^2. */ Square, square_slice, square_gradient, |d, x, _y| 2.0 * d * x);
elementary!(/** Hyperbolic tangent. */ Tanh, tanh_slice, tanh_gradient, |d, _x, y| d * (1.0 - y * y));

/// Sine or cosine; the other one is kept for the gradient.
struct Circular {
    cosine: bool,
}

impl Op<1> for Circular {
    /// The other function of the same argument.
    type Saved = Tensor;
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, Tensor) {
        let (mut sin, mut cos) = (x.uninit_like(x.dims()), x.uninit_like(x.dims()));
        map_to_two(&mut sin, &mut cos, x, sin_cos_slice);
        if self.cosine { (cos, sin) } else { (sin, cos) }
    }
    fn vjp(&self, at: At<'_, 1, Tensor>, dy: &Tensor) -> [Option<Tensor>; 1] {
        let sign = if self.cosine { -1.0 } else { 1.0 };
        [Some(map2(dy, at.saved, |o, d, s| {
            for ((o, &d), &s) in o.iter_mut().zip(d).zip(s) {
                *o = sign * d * s;
            }
        }))]
    }
}

impl Tape {
    /// e^x.
    pub fn exp(&mut self, x: Var) -> Var {
        self.apply(Exp, [x])
    }

    /// Natural logarithm.
    pub fn ln(&mut self, x: Var) -> Var {
        self.apply(Ln, [x])
    }

    /// sin x.
    pub fn sin(&mut self, x: Var) -> Var {
        self.apply(Circular { cosine: false }, [x])
    }

    /// cos x.
    pub fn cos(&mut self, x: Var) -> Var {
        self.apply(Circular { cosine: true }, [x])
    }

    /// Square root. Gradient: 0 at 0, where the slope is infinite.
    pub fn sqrt(&mut self, x: Var) -> Var {
        self.apply(Sqrt, [x])
    }

    /// |x|. Gradient: 0 at 0.
    pub fn abs(&mut self, x: Var) -> Var {
        self.apply(Abs, [x])
    }

    /// x^2.
    pub fn square(&mut self, x: Var) -> Var {
        self.apply(Square, [x])
    }

    /// tanh x.
    pub fn tanh(&mut self, x: Var) -> Var {
        self.apply(Tanh, [x])
    }
}

#[cfg(test)]
mod tests {
    use crate::autodiff::{Tape, Var};
    use crate::ops::testing::{check, matrix, normal, positive, same_both_ways};
    use crate::simd::testing::rows;
    use crate::tensor::Tensor;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set([x, dy] in rows(0..70)) {
            let ops: [fn(&mut Tape, Var) -> Var; 8] = [
                Tape::exp, Tape::sin, Tape::cos, Tape::abs, Tape::square, Tape::tanh, Tape::ln, Tape::sqrt,
            ];
            for op in ops {
                same_both_ways(|t, x| op(t, x[0]), &[matrix(std::slice::from_ref(&x))], &dy);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(n in 1usize..6, c in 1usize..6, seed: u64) {
            let ops: [fn(&mut Tape, Var) -> Var; 6] =
                [Tape::exp, Tape::sin, Tape::cos, Tape::abs, Tape::square, Tape::tanh];
            for op in ops {
                check(|t, x| op(t, x[0]), &[normal(&[n, c], seed)], seed);
            }
            for op in [Tape::ln, Tape::sqrt] {
                check(|t, x| op(t, x[0]), &[positive(&[n, c], seed)], seed);
            }
        }
    }

    #[test]
    fn slopes_at_zero_are_zero_not_infinite() {
        for op in [Tape::sqrt, Tape::abs] {
            let mut t = Tape::new();
            let x = t.input(Tensor::scalar(0.0));
            let y = op(&mut t, x);
            assert_eq!(t.backward(y).get(x).unwrap().item(), 0.0);
        }
    }
}
