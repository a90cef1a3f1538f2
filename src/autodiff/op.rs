//! What an operation must provide to be recorded.

use crate::tensor::Tensor;

/// A differentiable operation with N tensor inputs and one tensor output.
///
/// Attributes (indices, axes, constants) are the fields of the implementing struct, never inputs. What the backward
/// pass needs beyond inputs and output is returned as `Saved`.
pub trait Op<const N: usize>: Send + Sync + 'static {
    /// Residuals kept from the forward pass.
    type Saved: Send + Sync + 'static;

    /// The value of the operation.
    ///
    /// # Panics
    /// If the shapes of `x` do not fit the operation.
    fn forward(&self, x: [&Tensor; N]) -> (Tensor, Self::Saved);

    /// The vector-Jacobian product: pulls the loss gradient `dy` at the output back to each input that `at.needs`
    /// asks for, in the input's shape. Returns only; the tape adds.
    fn vjp(&self, at: At<'_, N, Self::Saved>, dy: &Tensor) -> [Option<Tensor>; N];
}

/// Where a [`vjp`](Op::vjp) is taken.
pub struct At<'a, const N: usize, S> {
    /// The inputs of the forward pass.
    pub x: [&'a Tensor; N],
    /// Its output.
    pub y: &'a Tensor,
    /// Its residuals.
    pub saved: &'a S,
    /// Which inputs need a gradient.
    pub needs: [bool; N],
}
