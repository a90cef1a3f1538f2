//! An encoding of coordinates that lets a network see fine detail. Nothing here is trained.

use super::init;
use crate::autodiff::{Tape, Var};
use crate::random::Random;
use crate::tensor::Tensor;
use std::f32::consts::TAU;
use std::sync::Arc;

/// `[sin(2 pi x B), cos(2 pi x B)]` with a fixed normal matrix B.
///
/// # Shapes
/// n x c_in to n x c; B is c_in x c/2 and not trained: the same generator state gives it again.
///
/// # Gradient
/// Smooth.
///
/// # References
/// Tancik et al. 2020, Fourier features let networks learn high frequency functions, section 6.
#[derive(Clone, Debug)]
pub struct GaussianFourier {
    /// 2 pi B.
    frequencies: Arc<Tensor>,
}

impl GaussianFourier {
    /// An encoding of c_in coordinates in c channels; the entries of B have standard deviation `scale`, in cycles per
    /// unit of length.
    ///
    /// # Panics
    /// If c is odd.
    #[track_caller]
    pub fn new(c_in: usize, c: usize, scale: f32, rng: &mut Random) -> Self {
        assert!(c.is_multiple_of(2), "gaussian_fourier: {c} channels, an even number expected");
        GaussianFourier { frequencies: Arc::new(init::normal(&[c_in, c / 2], TAU * scale, rng)) }
    }

    /// The columns of the result.
    pub fn width(&self) -> usize {
        2 * self.frequencies.cols()
    }

    /// n x c_in to n x c.
    ///
    /// # Panics
    /// If `x` does not have c_in columns.
    #[track_caller]
    pub fn forward(&self, tape: &mut Tape, x: Var) -> Var {
        let frequencies = tape.shared(self.frequencies.clone(), false);
        let phase = tape.matmul(x, frequencies);
        let (sin, cos) = (tape.sin(phase), tape.cos(phase));
        tape.concat_cols([sin, cos])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::{check, normal};

    #[test]
    fn gradients_and_widths() {
        let random = GaussianFourier::new(3, 8, 0.3, &mut Random::new(1));
        let x = normal(&[5, 3], 2);
        check(|t, x| random.forward(t, x[0]), std::slice::from_ref(&x), 1);
        let mut t = Tape::new();
        let x = t.constant(x);
        let b = random.forward(&mut t, x);
        assert_eq!(t.value(b).cols(), random.width());
        for row in t.value(b).data().chunks_exact(8) {
            for i in 0..4 {
                assert!((row[i].powi(2) + row[i + 4].powi(2) - 1.0).abs() < 1e-5);
            }
        }
    }
}
