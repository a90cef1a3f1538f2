//! The Adam optimiser.

use crate::error::{Error, ErrorKind};
use crate::simd::kernel;
use crate::tensor::Tensor;
use std::sync::Arc;

/// The constants of [`Adam`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct AdamOptions {
    /// Decay of the mean of gradients.
    pub beta1: f64,
    /// Decay of the mean of squared gradients.
    pub beta2: f64,
    /// Added to the root of the second moment.
    pub eps: f64,
    /// Fraction of a parameter that is taken away at every step, per unit of learning rate; decoupled from the
    /// gradient (Loshchilov, Hutter 2019).
    pub weight_decay: f64,
}

impl Default for AdamOptions {
    fn default() -> Self {
        AdamOptions { beta1: 0.9, beta2: 0.999, eps: 1e-8, weight_decay: 0.0 }
    }
}

/// p -= rate m^ / (sqrt(v^) + eps), with m^ and v^ the bias-corrected running means of the gradient and its square.
///
/// A parameter without a gradient keeps its value and moments, and does not count the step: bias correction goes by
/// the steps that the parameter itself has taken, so parts that are trained in stages start well.
///
/// # References
/// Kingma, Ba 2015, Adam, algorithm 1.
///
/// ```
/// use bijective_sdf::optim::{Adam, AdamOptions};
/// use bijective_sdf::tensor::Tensor;
///
/// let mut values = [Tensor::scalar(1.0).into()];
/// let mut adam = Adam::new(&values, AdamOptions::default());
/// // The first step has the length of the learning rate, whatever the gradient's scale.
/// adam.step(&mut values, &[Some(Tensor::scalar(500.0))], 0.1);
/// assert!((values[0].item() - 0.9).abs() < 1e-6);
/// ```
#[derive(Clone, Debug)]
pub struct Adam {
    options: AdamOptions,
    steps: Vec<u64>,
    m: Vec<Tensor>,
    v: Vec<Tensor>,
}

kernel! {
    fn update(
        p: &mut [f32], m: &mut [f32], v: &mut [f32], g: &[f32],
        beta1: f32, rest1: f32, beta2: f32, rest2: f32, rate: f32, root: f32, eps: f32, keep: f32,
    ) {
        for (((p, m), v), &g) in p.iter_mut().zip(m.iter_mut()).zip(v.iter_mut()).zip(g) {
            *m = beta1 * *m + rest1 * g;
            *v = beta2 * *v + rest2 * (g * g);
            *p = *p * keep - rate * *m / (v.sqrt() * root + eps);
        }
    }
}

impl Adam {
    /// An optimiser for parameters of these shapes, all moments 0.
    pub fn new(values: &[Arc<Tensor>], options: AdamOptions) -> Self {
        let zeros = || values.iter().map(|v| Tensor::zeros(v.dims())).collect();
        Adam { options, steps: vec![0; values.len()], m: zeros(), v: zeros() }
    }

    /// The number of steps each parameter has taken.
    pub fn steps(&self) -> &[u64] {
        &self.steps
    }

    /// One step with learning rate `rate`; parameters without a gradient stay.
    ///
    /// # Panics
    /// If the numbers of parameters or a shape differ from those the optimiser was made for.
    #[track_caller]
    pub fn step(&mut self, values: &mut [Arc<Tensor>], gradients: &[Option<Tensor>], rate: f32) {
        let parameters = self.steps.len();
        assert!(
            values.len() == parameters && gradients.len() == parameters,
            "adam: {} values and {} gradients for {parameters} parameters",
            values.len(),
            gradients.len()
        );
        let AdamOptions { beta1, beta2, eps, weight_decay } = self.options;
        for (i, gradient) in gradients.iter().enumerate() {
            let Some(gradient) = gradient else { continue };
            let shape = self.m[i].shape();
            assert!(
                gradient.shape() == shape && values[i].shape() == shape,
                "adam: value {:?} and gradient {:?} for parameter {i} of shape {shape:?}",
                values[i].shape(),
                gradient.shape()
            );
            self.steps[i] += 1;
            let t = i32::try_from(self.steps[i]).unwrap_or(i32::MAX);
            let rate = f64::from(rate);
            update(
                Arc::make_mut(&mut values[i]).data_mut(),
                self.m[i].data_mut(),
                self.v[i].data_mut(),
                gradient.data(),
                beta1 as f32,
                (1.0 - beta1) as f32,
                beta2 as f32,
                (1.0 - beta2) as f32,
                (rate / (1.0 - beta1.powi(t))) as f32,
                (1.0 / (1.0 - beta2.powi(t)).sqrt()) as f32,
                eps as f32,
                (1.0 - rate * weight_decay) as f32,
            );
        }
    }

    /// The state under stable names, for a checkpoint: `m.` and `v.` and the parameter's name, both of the
    /// parameter's shape, and `steps`, 1 x the number of parameters (exact up to 2^24 steps).
    ///
    /// # Panics
    /// If there is not one name per parameter.
    #[track_caller]
    pub fn state<'a>(&self, names: impl IntoIterator<Item = &'a str>) -> Vec<(String, Tensor)> {
        let names: Vec<&str> = names.into_iter().collect();
        let parameters = self.steps.len();
        assert!(names.len() == parameters, "adam: {} names for {parameters} parameters", names.len());
        let moments = |prefix: &'static str, of: &[Tensor]| -> Vec<(String, Tensor)> {
            names.iter().zip(of).map(|(name, t)| (format!("{prefix}.{name}"), t.clone())).collect()
        };
        let mut state = moments("m", &self.m);
        state.extend(moments("v", &self.v));
        let steps = self.steps.iter().map(|&s| s as f32).collect();
        state.push(("steps".into(), Tensor::from_vec(&[1, parameters], steps)));
        state
    }

    /// Takes up a state that [`state`](Self::state) gave, looked up by name.
    ///
    /// # Errors
    /// If a tensor is missing or has another shape; the optimiser is then as before.
    ///
    /// # Panics
    /// If there is not one name per parameter.
    #[track_caller]
    pub fn restore<'a>(
        &mut self,
        names: impl IntoIterator<Item = &'a str>,
        lookup: impl Fn(&str) -> Option<Tensor>,
    ) -> Result<(), Error> {
        let mut found = Vec::new();
        for (name, like) in self.state(names) {
            let damaged = |message: String| {
                Error::new(ErrorKind::Checkpoint, message)
                    .at_element(format!("tensor {name}"))
                    .advise("resume with the options that the checkpoint was written with")
            };
            let tensor =
                lookup(&name).ok_or_else(|| damaged("missing from the state of the optimiser".into()))?;
            if tensor.shape() != like.shape() {
                let message = format!("shape {:?} found, {:?} expected", tensor.shape(), like.shape());
                return Err(damaged(message));
            }
            found.push(tensor);
        }
        let steps = found.pop().expect("the state ends with the steps");
        self.steps = steps.data().iter().map(|&s| s as u64).collect();
        self.v = found.split_off(self.steps.len());
        self.m = found;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::normal;
    use crate::simd::testing::{rows, same_at_all};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_same_at_every_instruction_set([p, m, v, g] in rows(0..70), rate in 0.0f32..1.0) {
            same_at_all(|| {
                let [mut p, mut m, mut v] = [p.clone(), m.clone(), v.clone()];
                update(&mut p, &mut m, &mut v, &g, 0.9, 0.1, 0.999, 0.001, rate, 1.2, 1e-8, 0.99);
                [p, m, v].concat()
            });
        }
    }

    fn values(dims: &[[usize; 2]]) -> Vec<Arc<Tensor>> {
        dims.iter().enumerate().map(|(i, d)| Arc::new(normal(d, i as u64))).collect()
    }

    #[test]
    fn agrees_with_the_algorithm_in_f64() {
        for n in 0..40 {
            let mut p = values(&[[1, n]]);
            let mut truth: Vec<[f64; 3]> = p[0].data().iter().map(|&p| [f64::from(p), 0.0, 0.0]).collect();
            let options = AdamOptions { weight_decay: 0.1, ..AdamOptions::default() };
            let mut adam = Adam::new(&p, options);
            for t in 1..=4 {
                let g = normal(&[1, n], 100 + t as u64);
                adam.step(&mut p, &[Some(g.clone())], 0.01);
                for ([p, m, v], &g) in truth.iter_mut().zip(g.data()) {
                    let g = f64::from(g);
                    *m = 0.9 * *m + 0.1 * g;
                    *v = 0.999 * *v + 0.001 * g * g;
                    let (mean, square) = (*m / (1.0 - 0.9f64.powi(t)), *v / (1.0 - 0.999f64.powi(t)));
                    *p = *p * (1.0 - 0.01 * 0.1) - 0.01 * mean / (square.sqrt() + 1e-8);
                }
            }
            for (p, truth) in p[0].data().iter().zip(truth) {
                assert!((f64::from(*p) - truth[0]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn parameters_without_gradient_stay() {
        let mut p = values(&[[2, 2], [2, 2], [2, 2]]);
        let before = p.clone();
        let mut adam = Adam::new(&p, AdamOptions::default());
        let g = || Some(Tensor::full(&[2, 2], 3.0));
        adam.step(&mut p, &[g(), None, g()], 0.1);
        assert_eq!(p[1], before[1]);
        assert_eq!(adam.steps(), [1, 0, 1]);
        for i in 0..4 {
            assert!((before[0].data()[i] - p[0].data()[i] - 0.1).abs() < 1e-6);
            assert!((before[2].data()[i] - p[2].data()[i] - 0.1).abs() < 1e-6);
        }
    }

    #[test]
    fn a_restored_state_goes_on_to_the_same_bytes() {
        let names = ["a", "b"];
        let mut p = values(&[[3, 2], [1, 5]]);
        let mut adam = Adam::new(&p, AdamOptions::default());
        let gradients = |t: u64| [Some(normal(&[3, 2], t)), Some(normal(&[1, 5], t + 50))];
        for t in 0..3 {
            adam.step(&mut p, &gradients(t), 0.01);
        }
        let saved = adam.state(names);
        assert_eq!(saved[0].0, "m.a");
        let lookup = |name: &str| saved.iter().find(|(n, _)| n == name).map(|(_, t)| t.clone());
        let mut other = Adam::new(&p, AdamOptions::default());
        other.restore(names, lookup).unwrap();
        let mut q = p.clone();
        adam.step(&mut p, &gradients(9), 0.01);
        other.step(&mut q, &gradients(9), 0.01);
        assert_eq!(p, q);
        let missing = other.restore(names, |n| lookup(n).filter(|_| n != "v.b")).unwrap_err();
        assert!(missing.to_string().starts_with("tensor v.b: missing"), "{missing}");
        let wrong =
            other.restore(names, |n| lookup(n).map(|t| if n == "m.a" { Tensor::scalar(0.0) } else { t }));
        assert!(wrong.unwrap_err().to_string().contains("[1x1] found, [3x2] expected"));
    }
}
