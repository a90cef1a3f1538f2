//! Named parameters and their place on a tape.

use crate::autodiff::{Gradients, Tape, Var};
use crate::tensor::Tensor;
use std::sync::Arc;

/// Which parameter of a [`Params`]: its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ParamId(usize);

impl ParamId {
    /// The position, from 0.
    pub fn index(self) -> usize {
        self.0
    }
}

/// Named parameters in the order in which they were added.
///
/// Each is shared with the tapes that it is bound to, so binding copies nothing. Changing one while a tape still
/// holds it copies it first: clear the tape before an optimiser step.
#[derive(Clone, Debug, Default)]
pub struct Params {
    names: Vec<String>,
    values: Vec<Arc<Tensor>>,
}

impl Params {
    /// No parameters.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a parameter.
    ///
    /// # Panics
    /// If the name is taken.
    #[track_caller]
    pub fn add(&mut self, name: impl Into<String>, value: Tensor) -> ParamId {
        let name = name.into();
        assert!(self.id(&name).is_none(), "params: two parameters of name {name}");
        self.names.push(name);
        self.values.push(Arc::new(value));
        ParamId(self.values.len() - 1)
    }

    /// A door to these parameters that puts `name.` before every name.
    pub fn scope(&mut self, name: &str) -> Scope<'_> {
        Scope { params: self, prefix: format!("{name}.") }
    }

    /// The number of parameters (tensors).
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The number of scalars in all of them.
    pub fn scalars(&self) -> usize {
        self.values.iter().map(|v| v.len()).sum()
    }

    /// The names, in order.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.names.iter().map(String::as_str)
    }

    /// Ids, names and values, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (ParamId, &str, &Tensor)> {
        self.names.iter().zip(&self.values).enumerate().map(|(i, (n, v))| (ParamId(i), n.as_str(), &**v))
    }

    /// The parameter of a name.
    pub fn id(&self, name: &str) -> Option<ParamId> {
        self.names.iter().position(|n| n == name).map(ParamId)
    }

    /// The name of a parameter.
    pub fn name(&self, id: ParamId) -> &str {
        &self.names[id.0]
    }

    /// A value.
    pub fn value(&self, id: ParamId) -> &Tensor {
        &self.values[id.0]
    }

    /// A value, to be changed; copied first if a tape holds it.
    pub fn value_mut(&mut self, id: ParamId) -> &mut Tensor {
        Arc::make_mut(&mut self.values[id.0])
    }

    /// All values, in order.
    pub fn values(&self) -> &[Arc<Tensor>] {
        &self.values
    }

    /// All values, in order, to be changed: what an optimiser steps on. Shapes must stay.
    pub fn values_mut(&mut self) -> &mut [Arc<Tensor>] {
        &mut self.values
    }

    /// All values in one row, 1 x P: one parameter after the other, each row by row.
    pub fn flat(&self) -> Tensor {
        let all: Vec<f32> = self.values.iter().flat_map(|value| value.data()).copied().collect();
        Tensor::from_vec(&[1, all.len()], all)
    }

    /// Parameters of the same names and shapes with other values, P of them in one row.
    ///
    /// # Panics
    /// If there are not P.
    #[track_caller]
    pub fn with_flat(&self, flat: &[f32]) -> Params {
        Params { names: self.names.clone(), values: self.split(flat).into_iter().map(Arc::new).collect() }
    }

    /// A row of P values, such as the gradient at [`flat`](Self::flat), as tensors in the shapes of the parameters.
    ///
    /// # Panics
    /// If there are not P.
    #[track_caller]
    pub fn split(&self, flat: &[f32]) -> Vec<Tensor> {
        assert!(flat.len() == self.scalars(), "params: {} values for {}", flat.len(), self.scalars());
        let mut rest = flat;
        let mut take = |like: &Arc<Tensor>| {
            let (values, after) = rest.split_at(like.len());
            rest = after;
            Tensor::from_vec(like.dims(), values.to_vec())
        };
        self.values.iter().map(&mut take).collect()
    }

    /// Puts all parameters on a tape, without copying; with `trainable` they ask for gradients.
    pub fn bind(&self, tape: &mut Tape, trainable: bool) -> Bound {
        self.bind_where(tape, |_| trainable)
    }

    /// Puts all parameters on a tape, without copying; those whose name `trainable` accepts ask for gradients.
    pub fn bind_where(&self, tape: &mut Tape, trainable: impl Fn(&str) -> bool) -> Bound {
        let leaf = |(value, name): (&Arc<Tensor>, &String)| tape.shared(value.clone(), trainable(name));
        Bound { vars: self.values.iter().zip(&self.names).map(leaf).collect() }
    }
}

/// A door to [`Params`] with a prefix, so that layers nest: `field.layer3.weight`.
#[derive(Debug)]
pub struct Scope<'a> {
    params: &'a mut Params,
    prefix: String,
}

impl Scope<'_> {
    /// Adds a parameter under the prefix.
    ///
    /// # Panics
    /// If the name is taken.
    #[track_caller]
    pub fn add(&mut self, name: &str, value: Tensor) -> ParamId {
        self.params.add(format!("{}{name}", self.prefix), value)
    }

    /// A scope within this one.
    pub fn scope(&mut self, name: &str) -> Scope<'_> {
        Scope { prefix: format!("{}{name}.", self.prefix), params: self.params }
    }
}

/// Parameters on a tape.
#[derive(Clone, Debug)]
pub struct Bound {
    vars: Vec<Var>,
}

impl Bound {
    /// Values that already are on a tape, in the order of their [`Params`]: for parameters that are computed from
    /// others, such as normalised weights.
    pub fn new(vars: Vec<Var>) -> Self {
        Bound { vars }
    }

    /// The value of a parameter on the tape.
    pub fn var(&self, id: ParamId) -> Var {
        self.vars[id.0]
    }

    /// Takes the gradients of all parameters out, in order; `None` where the loss does not depend on one.
    pub fn collect(&self, gradients: &mut Gradients) -> Vec<Option<Tensor>> {
        self.vars.iter().map(|&v| gradients.take(v)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scopes_nest_and_order_is_kept() {
        let mut params = Params::new();
        let mut field = params.scope("field");
        let a = field.scope("layer3").add("weight", Tensor::zeros(&[2, 3]));
        let b = field.add("bias", Tensor::zeros(&[1, 3]));
        assert_eq!(params.names().collect::<Vec<_>>(), ["field.layer3.weight", "field.bias"]);
        assert_eq!((a.index(), params.id("field.bias")), (0, Some(b)));
        assert_eq!((params.len(), params.scalars(), params.name(b)), (2, 9, "field.bias"));
    }

    #[test]
    fn one_row_and_back() {
        let mut params = Params::new();
        let a = params.add("a", Tensor::from_vec(&[2, 2], vec![1.0, 2.0, 3.0, 4.0]));
        let b = params.add("b", Tensor::scalar(5.0));
        assert_eq!(params.flat(), Tensor::from_vec(&[1, 5], vec![1.0, 2.0, 3.0, 4.0, 5.0]));
        let other = params.with_flat(&[5.0, 4.0, 3.0, 2.0, 1.0]);
        assert_eq!(other.value(a), &Tensor::from_vec(&[2, 2], vec![5.0, 4.0, 3.0, 2.0]));
        assert_eq!((other.value(b).item(), other.name(b)), (1.0, "b"));
    }

    #[test]
    #[should_panic(expected = "two parameters of name a")]
    fn names_are_unique() {
        let mut params = Params::new();
        params.add("a", Tensor::scalar(0.0));
        params.add("a", Tensor::scalar(0.0));
    }

    #[test]
    fn gradients_come_back_in_order_and_changes_do_not_reach_the_tape() {
        let mut params = Params::new();
        let ids = ["a", "b", "c"].map(|n| params.add(n, Tensor::scalar(2.0)));
        let mut tape = Tape::new();
        let bound = params.bind_where(&mut tape, |name| name != "b");
        let ab = tape.mul(bound.var(ids[0]), bound.var(ids[1]));
        let gradients = bound.collect(&mut tape.backward(ab));
        let items: Vec<_> = gradients.iter().map(|g| g.as_ref().map(Tensor::item)).collect();
        assert_eq!(items, [Some(2.0), None, None]);
        params.value_mut(ids[0]).data_mut()[0] = 7.0;
        assert_eq!((tape.value(bound.var(ids[0])).item(), params.value(ids[0]).item()), (2.0, 7.0));
    }
}
