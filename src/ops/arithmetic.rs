//! Sums, differences, products and quotients, with rows and columns broadcast; scaling and shifting.

use crate::autodiff::{At, Op, Tape, Var};
use crate::simd::kernel;
use crate::tensor::{Tensor, add_row_sums, copied, map, map_rows, map2, sum_f64};

/// How the second operand is spread over the first, which is n x c.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Spread {
    /// n x c: element by element.
    Same,
    /// 1 x c: every row alike.
    Row,
    /// n x 1: every column alike.
    Column,
    /// 1 x 1.
    Scalar,
}

#[track_caller]
fn spread(name: &str, a: &Tensor, b: &Tensor) -> Spread {
    if a.shape() == b.shape() {
        Spread::Same
    } else if b.len() == 1 {
        Spread::Scalar
    } else if b.rows() == 1 && b.cols() == a.cols() {
        Spread::Row
    } else if b.cols() == 1 && b.rows() == a.rows() {
        Spread::Column
    } else {
        panic!(
            "{name}: {:?} and {:?}; the second must be the same shape, a row, a column or 1x1",
            a.shape(),
            b.shape()
        )
    }
}

macro_rules! binary_kernels {
    ($same:ident, $one:ident, $operator:tt) => {
        kernel! {
            fn $same(out: &mut [f32], a: &[f32], b: &[f32]) {
                for ((o, &a), &b) in out.iter_mut().zip(a).zip(b) { *o = a $operator b; }
            }
        }
        kernel! {
            fn $one(out: &mut [f32], a: &[f32], b: f32) {
                for (o, &a) in out.iter_mut().zip(a) { *o = a $operator b; }
            }
        }
    };
}
binary_kernels!(add_same, add_one, +);
binary_kernels!(sub_same, sub_one, -);
binary_kernels!(mul_same, mul_one, *);
binary_kernels!(div_same, div_one, /);

type SameKernel = fn(&mut [f32], &[f32], &[f32]);
type OneKernel = fn(&mut [f32], &[f32], f32);

/// Applies a kernel over `a` with `b` spread over it.
fn combine(a: &Tensor, b: &Tensor, how: Spread, same: SameKernel, one: OneKernel) -> Tensor {
    match how {
        Spread::Same => map2(a, b, same),
        Spread::Scalar => map(a, |o, x| one(o, x, b.item())),
        Spread::Row | Spread::Column => {
            let c = a.cols();
            let mut out = a.uninit_like(a.dims());
            let (a, b) = (a.data(), b.data());
            map_rows(out.data_mut(), c, |first, piece| {
                for (i, o) in piece.chunks_exact_mut(c.max(1)).enumerate() {
                    let row = &a[(first + i) * c..][..c];
                    match how {
                        Spread::Row => same(o, row, b),
                        _ => one(o, row, b[first + i]),
                    }
                }
            });
            out
        }
    }
}

/// Sums a gradient of the first operand's shape down to the second's: the transpose of the spread.
fn collapse(dy: Tensor, like: &Tensor, how: Spread) -> Tensor {
    match how {
        Spread::Same => dy,
        Spread::Row => {
            let mut out = dy.zeros_like_pool(like.dims());
            add_row_sums(out.data_mut(), dy.data());
            out
        }
        Spread::Column => {
            let mut out = dy.uninit_like(like.dims());
            let c = dy.cols();
            for (o, row) in out.data_mut().iter_mut().zip(dy.data().chunks_exact(c.max(1))) {
                *o = row.iter().sum();
            }
            out
        }
        Spread::Scalar => {
            let mut out = dy.uninit_like(like.dims());
            out.data_mut()[0] = sum_f64(dy.data()) as f32;
            out
        }
    }
}

/// a + b.
struct Add;

impl Op<2> for Add {
    type Saved = Spread;
    fn forward(&self, [a, b]: [&Tensor; 2]) -> (Tensor, Spread) {
        let how = spread("add", a, b);
        (combine(a, b, how, add_same, add_one), how)
    }
    fn vjp(&self, at: At<'_, 2, Spread>, dy: &Tensor) -> [Option<Tensor>; 2] {
        [at.needs[0].then(|| copied(dy)), at.needs[1].then(|| collapse(copied(dy), at.x[1], *at.saved))]
    }
}

/// a - b.
struct Sub;

impl Op<2> for Sub {
    type Saved = Spread;
    fn forward(&self, [a, b]: [&Tensor; 2]) -> (Tensor, Spread) {
        let how = spread("sub", a, b);
        (combine(a, b, how, sub_same, sub_one), how)
    }
    fn vjp(&self, at: At<'_, 2, Spread>, dy: &Tensor) -> [Option<Tensor>; 2] {
        let negated = || map(dy, |o, x| mul_one(o, x, -1.0));
        [at.needs[0].then(|| copied(dy)), at.needs[1].then(|| collapse(negated(), at.x[1], *at.saved))]
    }
}

/// a b.
struct Mul;

impl Op<2> for Mul {
    type Saved = Spread;
    fn forward(&self, [a, b]: [&Tensor; 2]) -> (Tensor, Spread) {
        let how = spread("mul", a, b);
        (combine(a, b, how, mul_same, mul_one), how)
    }
    fn vjp(&self, at: At<'_, 2, Spread>, dy: &Tensor) -> [Option<Tensor>; 2] {
        let [a, b] = at.x;
        [
            at.needs[0].then(|| combine(dy, b, *at.saved, mul_same, mul_one)),
            at.needs[1].then(|| collapse(combine(dy, a, Spread::Same, mul_same, mul_one), b, *at.saved)),
        ]
    }
}

/// a / b.
struct Div;

impl Op<2> for Div {
    type Saved = Spread;
    fn forward(&self, [a, b]: [&Tensor; 2]) -> (Tensor, Spread) {
        let how = spread("div", a, b);
        (combine(a, b, how, div_same, div_one), how)
    }
    fn vjp(&self, at: At<'_, 2, Spread>, dy: &Tensor) -> [Option<Tensor>; 2] {
        let b = at.x[1];
        let da = combine(dy, b, *at.saved, div_same, div_one);
        // d(a/b)/db = -(a/b)/b.
        let db = at.needs[1].then(|| {
            let full = map2(&da, at.y, |o, d, y| {
                for ((o, &d), &y) in o.iter_mut().zip(d).zip(y) {
                    *o = -d * y;
                }
            });
            collapse(full, b, *at.saved)
        });
        [at.needs[0].then_some(da), db]
    }
}

/// s x.
struct Scale(f32);

impl Op<1> for Scale {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        (map(x, |o, x| mul_one(o, x, self.0)), ())
    }
    fn vjp(&self, _: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        [Some(map(dy, |o, x| mul_one(o, x, self.0)))]
    }
}

/// x + s.
struct Shift(f32);

impl Op<1> for Shift {
    type Saved = ();
    fn forward(&self, [x]: [&Tensor; 1]) -> (Tensor, ()) {
        (map(x, |o, x| add_one(o, x, self.0)), ())
    }
    fn vjp(&self, _: At<'_, 1, ()>, dy: &Tensor) -> [Option<Tensor>; 1] {
        [Some(dy.clone())]
    }
}

/// In all four, `a` is n x c and `b` is n x c, a row 1 x c, a column n x 1 or 1 x 1, spread over `a`.
impl Tape {
    /// a + b, `b` spread over `a`.
    ///
    /// # Panics
    /// If `b` is neither of `a`'s shape, a row, a column nor 1 x 1.
    #[track_caller]
    pub fn add(&mut self, a: Var, b: Var) -> Var {
        self.apply(Add, [a, b])
    }

    /// a - b, `b` spread over `a`.
    ///
    /// # Panics
    /// As [`add`](Self::add).
    #[track_caller]
    pub fn sub(&mut self, a: Var, b: Var) -> Var {
        self.apply(Sub, [a, b])
    }

    /// a b element by element, `b` spread over `a`.
    ///
    /// # Panics
    /// As [`add`](Self::add).
    #[track_caller]
    pub fn mul(&mut self, a: Var, b: Var) -> Var {
        self.apply(Mul, [a, b])
    }

    /// a / b element by element, `b` spread over `a`; not guarded against zeros in `b`.
    ///
    /// # Panics
    /// As [`add`](Self::add).
    #[track_caller]
    pub fn div(&mut self, a: Var, b: Var) -> Var {
        self.apply(Div, [a, b])
    }

    /// s x.
    pub fn scale(&mut self, x: Var, s: f32) -> Var {
        self.apply(Scale(s), [x])
    }

    /// -x.
    pub fn neg(&mut self, x: Var) -> Var {
        self.scale(x, -1.0)
    }

    /// x + s.
    pub fn shift(&mut self, x: Var, s: f32) -> Var {
        self.apply(Shift(s), [x])
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
        fn the_same_at_every_instruction_set([a, b, c, dy] in rows(1..70)) {
            let n = a.len();
            let x = matrix(&[a, b.clone()]);
            let seconds =
                [matrix(&[c.clone(), b.clone()]), matrix(std::slice::from_ref(&c)), matrix(&[c[..1].to_vec(), b[..1].to_vec()])];
            let ops: [fn(&mut Tape, Var, Var) -> Var; 4] = [Tape::add, Tape::sub, Tape::mul, Tape::div];
            for (op, second) in ops.iter().flat_map(|op| seconds.iter().map(move |second| (op, second))) {
                same_both_ways(|t, x| op(t, x[0], x[1]), &[x.clone(), second.clone()], &dy);
            }
            same_both_ways(|t, x| t.mul(x[0], x[1]), &[x.clone(), Tensor::scalar(c[n - 1])], &dy);
            same_both_ways(|t, x| { let y = t.scale(x[0], b[0]); t.shift(y, c[0]) }, &[x], &dy);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn gradients(n in 1usize..7, c in 1usize..7, form in 0usize..4, seed: u64) {
            let dims = [[n, c], [1, c], [n, 1], [1, 1]][form];
            let (a, b) = (normal(&[n, c], seed), positive(&dims, seed ^ 1));
            let ops: [fn(&mut Tape, Var, Var) -> Var; 4] = [Tape::add, Tape::sub, Tape::mul, Tape::div];
            for op in ops {
                check(|t, x| op(t, x[0], x[1]), &[a.clone(), b.clone()], seed);
            }
            check(|t, x| t.scale(x[0], -1.7), std::slice::from_ref(&a), seed);
            check(|t, x| t.shift(x[0], 0.3), &[a], seed);
        }
    }

    #[test]
    fn spreads_rows_and_columns() {
        let mut t = Tape::new();
        let a = t.constant(Tensor::from_vec(&[2, 2], vec![1., 2., 3., 4.]));
        let row = t.constant(Tensor::from_vec(&[1, 2], vec![10., 20.]));
        let column = t.constant(Tensor::from_vec(&[2, 1], vec![10., 20.]));
        let one = t.constant(Tensor::scalar(2.0));
        let y = t.add(a, row);
        assert_eq!(t.value(y).data(), [11., 22., 13., 24.]);
        let y = t.mul(a, column);
        assert_eq!(t.value(y).data(), [10., 20., 60., 80.]);
        let y = t.div(a, one);
        assert_eq!(t.value(y).data(), [0.5, 1., 1.5, 2.]);
    }

    #[test]
    #[should_panic(expected = "add: [2x3] and [3x2]")]
    fn shapes_that_do_not_fit_are_named() {
        let mut t = Tape::new();
        let (a, b) = (t.constant(Tensor::zeros(&[2, 3])), t.constant(Tensor::zeros(&[3, 2])));
        t.add(a, b);
    }
}
