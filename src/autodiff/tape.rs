//! The tape: values in the order they were computed, each with the operation that made it.

use super::{At, Op};
use crate::tensor::{Pool, Tensor};
use std::sync::Arc;

/// A value on a [`Tape`]: an index, valid until the tape is cleared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Var(u32);

impl Var {
    fn index(self) -> usize {
        self.0 as usize
    }
}

/// Gradients of the leaves that asked for one.
#[derive(Debug, Default)]
pub struct Gradients {
    of: Vec<Option<Tensor>>,
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

/// A record of operations; append order is topological order.
///
/// Values and gradients take their memory from the tape's [`Pool`], so clearing and refilling the same tape every
/// step allocates nothing new. A tape belongs to one thread at a time; several tapes can run side by side.
///
/// ```
/// use bijective_sdf::autodiff::Tape;
/// use bijective_sdf::tensor::Tensor;
///
/// let mut tape = Tape::new();
/// let x = tape.input(Tensor::from_vec(&[1, 2], vec![3.0, 4.0]));
/// let y = tape.square(x);
/// let loss = tape.sum(y);
/// let gradients = tape.backward(loss);
/// assert_eq!(gradients.get(x).unwrap().data(), [6.0, 8.0]);
/// ```
#[derive(Default)]
pub struct Tape {
    nodes: Vec<Node>,
    pool: Pool,
}

struct Node {
    value: Value,
    needs: bool,
    record: Option<Box<dyn Backward>>,
}

enum Value {
    Owned(Tensor),
    Shared(Arc<Tensor>),
}

impl Node {
    fn value(&self) -> &Tensor {
        match &self.value {
            Value::Owned(t) => t,
            Value::Shared(t) => t,
        }
    }
}

/// An operation applied to inputs, its type erased.
trait Backward: Send + Sync {
    fn pull(&self, nodes: &[Node], y: &Tensor, dy: &Tensor, add: &mut dyn FnMut(Var, Tensor));
}

struct Applied<O: Op<N>, const N: usize> {
    op: O,
    inputs: [Var; N],
    saved: O::Saved,
}

impl<O: Op<N>, const N: usize> Backward for Applied<O, N> {
    fn pull(&self, nodes: &[Node], y: &Tensor, dy: &Tensor, add: &mut dyn FnMut(Var, Tensor)) {
        let x = self.inputs.map(|v| nodes[v.index()].value());
        let needs = self.inputs.map(|v| nodes[v.index()].needs);
        let gradients = self.op.vjp(At { x, y, saved: &self.saved, needs }, dy);
        for (i, gradient) in gradients.into_iter().enumerate() {
            let Some(gradient) = gradient else {
                assert!(!needs[i], "{}: no gradient for input {i}", std::any::type_name::<O>());
                continue;
            };
            assert!(
                gradient.shape() == x[i].shape(),
                "{}: gradient {:?} for input {i} of shape {:?}",
                std::any::type_name::<O>(),
                gradient.shape(),
                x[i].shape()
            );
            if needs[i] {
                add(self.inputs[i], gradient);
            }
        }
    }
}

impl Tape {
    /// An empty tape.
    pub fn new() -> Self {
        Self::default()
    }

    /// Forgets all values and keeps their memory for the next ones.
    pub fn clear(&mut self) {
        self.nodes.clear();
    }

    /// The store that values and gradients take their memory from.
    pub fn pool(&self) -> &Pool {
        &self.pool
    }

    /// The number of values on the tape.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether nothing is on the tape.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Puts a value on the tape that asks for a gradient.
    pub fn input(&mut self, value: Tensor) -> Var {
        let value = Value::Owned(value.into_pool(&self.pool));
        self.push(value, true, None)
    }

    /// Puts a value on the tape that has no gradient.
    pub fn constant(&mut self, value: Tensor) -> Var {
        let value = Value::Owned(value.into_pool(&self.pool));
        self.push(value, false, None)
    }

    /// Puts a shared value on the tape without copying it, such as a parameter that several tapes use.
    pub fn shared(&mut self, value: Arc<Tensor>, needs_gradient: bool) -> Var {
        self.push(Value::Shared(value), needs_gradient, None)
    }

    /// Applies an operation and records it.
    ///
    /// # Panics
    /// If the shapes do not fit the operation, or a var is not of this tape.
    #[track_caller]
    pub fn apply<O: Op<N>, const N: usize>(&mut self, op: O, inputs: [Var; N]) -> Var {
        let (value, saved) = op.forward(inputs.map(|v| self.value(v)));
        let needs = inputs.iter().any(|v| self.nodes[v.index()].needs);
        let record: Option<Box<dyn Backward>> =
            if needs { Some(Box::new(Applied { op, inputs, saved })) } else { None };
        self.push(Value::Owned(value), needs, record)
    }

    /// Records an operation whose value has already been computed, as when one pass computes two values.
    pub(crate) fn record<O: Op<N>, const N: usize>(
        &mut self,
        op: O,
        inputs: [Var; N],
        value: Arc<Tensor>,
        saved: O::Saved,
    ) -> Var {
        let needs = inputs.iter().any(|v| self.nodes[v.index()].needs);
        let record: Option<Box<dyn Backward>> =
            if needs { Some(Box::new(Applied { op, inputs, saved })) } else { None };
        self.push(Value::Shared(value), needs, record)
    }

    /// The value of a var.
    ///
    /// # Panics
    /// If the var is not of this tape.
    #[track_caller]
    pub fn value(&self, var: Var) -> &Tensor {
        self.nodes[var.index()].value()
    }

    /// Whether a var carries a gradient.
    pub fn needs_gradient(&self, var: Var) -> bool {
        self.nodes[var.index()].needs
    }

    /// The gradients of a one-element loss with respect to every leaf that asked for one.
    ///
    /// # Panics
    /// If `loss` has more than one element.
    #[track_caller]
    pub fn backward(&self, loss: Var) -> Gradients {
        let value = self.value(loss);
        assert!(value.len() == 1, "backward: loss of shape {:?}, one element expected", value.shape());
        let mut seed = value.uninit_like(value.dims());
        seed.data_mut()[0] = 1.0;
        self.pull([(loss, seed)])
    }

    /// Pulls given gradients at some vars back to the leaves: the general form of [`backward`](Self::backward), for
    /// a computation whose loss was taken elsewhere.
    ///
    /// # Panics
    /// If a seed does not have its var's shape.
    #[track_caller]
    pub fn pull(&self, seeds: impl IntoIterator<Item = (Var, Tensor)>) -> Gradients {
        let mut gradients = Gradients { of: Vec::new() };
        gradients.of.resize_with(self.nodes.len(), || None);
        for (var, seed) in seeds {
            let shape = self.value(var).shape();
            assert!(seed.shape() == shape, "pull: seed {:?} for a value of shape {shape:?}", seed.shape());
            if self.nodes[var.index()].needs {
                accumulate(&mut gradients.of[var.index()], seed);
            }
        }
        for i in (0..self.nodes.len()).rev() {
            let node = &self.nodes[i];
            let Some(record) = &node.record else { continue };
            let Some(dy) = gradients.of[i].take() else { continue };
            record.pull(&self.nodes, node.value(), &dy, &mut |var, gradient| {
                accumulate(&mut gradients.of[var.index()], gradient);
            });
        }
        gradients
    }

    fn push(&mut self, value: Value, needs: bool, record: Option<Box<dyn Backward>>) -> Var {
        self.nodes.push(Node { value, needs, record });
        Var(u32::try_from(self.nodes.len() - 1).expect("a tape holds at most 2^32 values"))
    }
}

fn accumulate(slot: &mut Option<Tensor>, gradient: Tensor) {
    match slot {
        Some(sum) => sum.add_assign(&gradient),
        None => *slot = Some(gradient),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_used_twice_gets_both_gradients() {
        let mut tape = Tape::new();
        let x = tape.input(Tensor::scalar(3.0));
        let xx = tape.mul(x, x);
        let y = tape.add(xx, x);
        assert_eq!(tape.value(y).item(), 12.0);
        assert_eq!(tape.backward(y).get(x).unwrap().item(), 7.0);
    }

    #[test]
    fn constants_record_nothing() {
        let mut tape = Tape::new();
        let c = tape.constant(Tensor::scalar(3.0));
        let y = tape.square(c);
        assert!(!tape.needs_gradient(y) && tape.nodes[y.index()].record.is_none());
        assert!(tape.backward(y).get(c).is_none());
    }

    #[test]
    fn pulling_a_seed_equals_backward_of_the_weighted_sum() {
        let mut tape = Tape::new();
        let x = tape.input(Tensor::from_vec(&[1, 3], vec![0.1, 0.2, 0.3]));
        let y = tape.exp(x);
        let weights = Tensor::from_vec(&[1, 3], vec![1.0, -2.0, 3.0]);
        let pulled = tape.pull([(y, weights.clone())]);
        let w = tape.constant(weights);
        let weighted = tape.mul(y, w);
        let loss = tape.sum(weighted);
        assert_eq!(tape.backward(loss).get(x).unwrap(), pulled.get(x).unwrap());
    }

    #[test]
    fn a_repeated_step_allocates_nothing() {
        let mut tape = Tape::new();
        let mut counts = Vec::new();
        for _ in 0..4 {
            tape.clear();
            let x = tape.input(Tensor::full(&[40, 7], 0.5));
            let y = tape.exp(x);
            let z = tape.mul(x, y);
            let loss = tape.sum(z);
            drop(tape.backward(loss));
            counts.push(tape.pool().allocations());
        }
        assert_eq!(counts[1], counts[3]);
    }

    #[test]
    #[should_panic(expected = "pull: seed [1x2] for a value of shape [1x3]")]
    fn a_wrong_seed_names_both_shapes() {
        let mut tape = Tape::new();
        let x = tape.input(Tensor::zeros(&[1, 3]));
        tape.pull([(x, Tensor::zeros(&[1, 2]))]);
    }
}
