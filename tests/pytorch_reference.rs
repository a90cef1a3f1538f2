//! Values and gradients of the layers against those of PyTorch; `reference/generate.py` made the numbers.

use bijective_sdf::autodiff::{Tape, Var};
use bijective_sdf::nn::{
    Activation, Bound, DecoderBlock, DecoderSizes, LayerNorm, Linear, Mlp, MultiHeadAttention, Params,
    PointTransformer, Reach,
};
use bijective_sdf::optim::{Adam, AdamOptions};
use bijective_sdf::tensor::Tensor;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The numbers of one case, by kind and name.
struct Case {
    tensors: BTreeMap<(String, String), Tensor>,
}

impl Case {
    fn read(case: &str) -> Self {
        let mut tensors = BTreeMap::new();
        for line in include_str!("reference/layers.txt").lines() {
            let (head, values) = line.split_once(" :").unwrap();
            let head: Vec<&str> = head.split(' ').collect();
            if head[0] == case {
                let dims = [head[3].parse().unwrap(), head[4].parse().unwrap()];
                let values = values.split_whitespace().map(|v| v.parse().unwrap()).collect();
                tensors.insert((head[1].into(), head[2].into()), Tensor::from_vec(&dims, values));
            }
        }
        assert!(!tensors.is_empty(), "no case {case}");
        Case { tensors }
    }

    fn get(&self, kind: &str, name: &str) -> &Tensor {
        &self.tensors[&(kind.to_string(), name.to_string())]
    }

    fn all(&self, kind: &str) -> Vec<&Tensor> {
        self.tensors.iter().filter(|((k, _), _)| k == kind).map(|(_, t)| t).collect()
    }
}

#[track_caller]
fn close(what: &str, ours: &Tensor, theirs: &Tensor) {
    assert_eq!(ours.shape(), theirs.shape(), "{what}");
    for (a, b) in ours.data().iter().zip(theirs.data()) {
        assert!((a - b).abs() <= 1e-5 * (1.0 + b.abs()), "{what}: {a}, PyTorch {b}");
    }
}

/// Runs a layer on the inputs and parameters of a case and compares everything.
fn compare(case: &str, params: &mut Params, forward: impl Fn(&mut Tape, &Bound, &[Var]) -> Var) {
    let reference = Case::read(case);
    assert_eq!(params.len(), reference.all("p").len(), "{case}: parameters");
    let names: Vec<String> = params.names().map(String::from).collect();
    let theirs = |name: &str| name.strip_prefix("layer.").unwrap().to_string();
    for name in &names {
        let id = params.id(name).unwrap();
        let value = reference.get("p", &theirs(name));
        assert_eq!(value.shape(), params.value(id).shape(), "{case}: {name}");
        *params.value_mut(id) = value.clone();
    }
    let mut tape = Tape::new();
    let bound = params.bind(&mut tape, true);
    let x: Vec<Var> = reference.all("x").into_iter().map(|x| tape.input(x.clone())).collect();
    let y = forward(&mut tape, &bound, &x);
    close(&format!("{case}: value"), tape.value(y), reference.get("y", "-"));
    let mut gradients = tape.pull([(y, reference.get("dy", "-").clone())]);
    for (i, (&x, theirs)) in x.iter().zip(reference.all("gx")).enumerate() {
        close(&format!("{case}: gradient of input {i}"), gradients.get(x).unwrap(), theirs);
    }
    for (name, gradient) in names.iter().zip(bound.collect(&mut gradients)) {
        let what = format!("{case}: gradient of {name}");
        close(&what, &gradient.unwrap(), reference.get("gp", &theirs(name)));
    }
}

fn rng() -> bijective_sdf::Random {
    bijective_sdf::Random::new(0)
}

#[test]
fn linear() {
    let mut params = Params::new();
    let layer = Linear::new(&mut params.scope("layer"), 4, 3, &mut rng());
    compare("linear", &mut params, |t, p, x| layer.forward(t, p, x[0]));
}

#[test]
fn softmax() {
    compare("softmax", &mut Params::new(), |t, _, x| t.softmax_cols(x[0]));
}

#[test]
fn layer_norm() {
    let mut params = Params::new();
    let layer = LayerNorm::new(&mut params.scope("layer"), 6);
    compare("norm", &mut params, |t, p, x| layer.forward(t, p, x[0]));
}

#[test]
fn perceptrons() {
    for (case, activation) in [
        ("mlp_relu", Activation::Relu),
        ("mlp_softplus", Activation::Softplus { beta: 5.0 }),
        ("mlp_tanh", Activation::Tanh),
    ] {
        let mut params = Params::new();
        let layer = Mlp::new(&mut params.scope("layer"), &[3, 6, 5, 2], activation, &mut rng());
        compare(case, &mut params, |t, p, x| layer.forward(t, p, x[0]));
    }
}

#[test]
fn attention() {
    let mut params = Params::new();
    let layer = MultiHeadAttention::new(&mut params.scope("layer"), 8, 5, 2, &mut rng());
    compare("attention", &mut params, |t, p, x| layer.forward(t, p, x[0], x[1], &Reach::All));
}

#[test]
fn local_attention() {
    let mut params = Params::new();
    let layer = MultiHeadAttention::new(&mut params.scope("layer"), 6, 6, 3, &mut rng());
    let reach = Reach::Nearest { index: vec![0, 3, 2, 1, 4, 0, 3, 4].into(), k: 2 };
    compare("local", &mut params, |t, p, x| layer.forward(t, p, x[0], x[1], &reach));
}

#[test]
fn decoder_block() {
    let mut params = Params::new();
    let sizes = DecoderSizes { channels: 8, memory: 8, heads: 2, hidden: 10, self_attention: true };
    let layer = DecoderBlock::new(&mut params.scope("layer"), sizes, &mut rng());
    compare("decoder", &mut params, |t, p, x| layer.forward(t, p, x[0], &Reach::All, x[1], &Reach::All));
}

#[test]
fn point_transformer() {
    let mut params = Params::new();
    let layer = PointTransformer::new(&mut params.scope("layer"), 4, 6, &mut rng());
    let index: Arc<[u32]> = vec![0, 1, 2, 1, 0, 4, 2, 3, 1, 3, 2, 0, 4, 1, 3].into();
    compare("points", &mut params, |t, p, x| layer.forward(t, p, x[0], x[1], index.clone()));
}

#[test]
fn adam() {
    let mut decayed = AdamOptions::default();
    (decayed.beta1, decayed.beta2, decayed.eps, decayed.weight_decay) = (0.8, 0.95, 1e-6, 0.3);
    for (case, options) in [("adam", AdamOptions::default()), ("adamw", decayed)] {
        let reference = Case::read(case);
        let mut values = [Arc::new(reference.get("x", "0").clone())];
        let mut adam = Adam::new(&values, options);
        for gradient in reference.all("g") {
            adam.step(&mut values, &[Some(gradient.clone())], 0.05);
        }
        assert_eq!(adam.steps(), [5]);
        close(case, &values[0], reference.get("y", "-"));
    }
}
