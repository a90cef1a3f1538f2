//! The outcome of a backward pass.

use super::Var;
use crate::tensor::Tensor;

/// Gradients of the leaves that asked for one.
#[derive(Debug, Default)]
pub struct Gradients {
    pub(super) of: Vec<Option<Tensor>>,
}

impl Gradients {
    /// The gradient at a leaf; `None` if it did not ask for one or the seeds do not depend on it.
    pub fn get(&self, var: Var) -> Option<&Tensor> {
        self.of.get(var.index()).and_then(Option::as_ref)
    }

    /// Takes the gradient at a leaf out.
    pub fn take(&mut self, var: Var) -> Option<Tensor> {
        self.of.get_mut(var.index()).and_then(Option::take)
    }
}
