//! The gradients of a whole training step against finite differences of its loss.

use super::super::bridges::Bridges;
use super::super::phases::train::{Recorded, Seen, TrainStep};
use super::super::phases::{ParamGradients, Workspace};
use super::super::*;
use super::{at_training, ball, tiny};
use crate::bsp::Parameterization;
use crate::gdo::Deformation;
use crate::geometry::AnalyticShape;
use crate::optim::gradient_norm;
use crate::tensor::Tensor;

/// Every term, every part, live and smooth; distances start from and lead to the vertices of the surface.
fn all_terms() -> Config {
    let mut config = tiny();
    config.weights = Weights {
        para: 2.0,
        deform: 1.0,
        deform_decay: 0.5,
        surf: 0.1,
        eikonal: 0.05,
        laplacian: 0.1,
        on_points: 0.1,
        pull: 0.3,
        cover: 1.0,
        bridge: 0.2,
    };
    config.start.steps = 100;
    config.band.rings = 1;
    config
}

/// [`all_terms`] as `default` trains: distances start from samples on the faces and lead to the faces, and the loss of
/// late steps, where the weight of L_deform has decayed, is drawn to S and Q. Q has two blocks, and a
/// step sees a part of it.
fn sampled_in_blocks() -> Config {
    let mut config = all_terms();
    config.surface_samples = Some(150);
    config.band.shift = 1.0;
    (config.weights.deform, config.weights.deform_decay) = (8.0, 0.04);
    config.batch = Batch { thin: None, points: 32, centres: 20 };
    config
}

/// The trainer's step on its band, and what it works with.
fn parts(trainer: &mut Trainer) -> (TrainStep<'_>, &mut Workspace) {
    let Trainer { setup, state, band, work, .. } = trainer;
    let (_, step) = setup.config.phase_at(state.step);
    (TrainStep::new(setup, state, band.as_ref().unwrap(), step), work)
}

/// Searches for the band on a grid of 8 cubes.
fn find_band(trainer: &mut Trainer) {
    trainer.band =
        Some(super::super::trainer::find_band(&trainer.setup, &trainer.state, 8, &|| false).unwrap());
}

/// The loss of the trainer's step with the topology of an earlier call of `march`.
fn loss_at(trainer: &mut Trainer) -> f64 {
    let (at, work) = parts(trainer);
    let seen = at.seen();
    work.clear();
    let sampled = at.sample_field(&seen, work).unwrap();
    let recorded = at.record(&sampled, &seen, work).unwrap();
    f64::from(work.tape.value(recorded.loss).item())
}

/// What a step puts on the tape, and its gradients for field and map.
type Differentiated = (Seen, Recorded, ParamGradients, Option<ParamGradients>);

fn differentiate(trainer: &mut Trainer) -> Differentiated {
    let (at, work) = parts(trainer);
    let seen = at.seen();
    work.clear();
    let sampled = at.sample_field(&seen, work).unwrap();
    at.march(&sampled, work).unwrap();
    let recorded = at.record(&sampled, &seen, work).unwrap();
    let (field, map) = at.gradients(&recorded, &sampled, &work.tape);
    (seen, recorded, field, map)
}

/// A random direction of unit length.
fn direction(dims: &[usize], seed: u64) -> Tensor {
    let mut d = crate::ops::testing::normal(dims, seed);
    let length = d.data().iter().map(|x| x * x).sum::<f32>().sqrt();
    d.data_mut().iter_mut().for_each(|x| *x /= length);
    d
}

/// Moves one parameter of the field (or of the map) along a direction.
fn nudge(trainer: &mut Trainer, map: bool, index: usize, along: &Tensor, by: f32) {
    trainer.work.clear();
    let values = match &mut trainer.state.map {
        Some(m) if map => m.params_mut().values_mut(),
        _ => trainer.state.field.params_mut().values_mut(),
    };
    let value = std::sync::Arc::make_mut(&mut values[index]);
    value.data_mut().iter_mut().zip(along.data()).for_each(|(v, d)| *v += by * d);
}

/// Shifts the field so that no active vertex lies close to its zero level: a sign that switches is a kink, and near one
/// the crossing of an edge moves too fast for differences in f32.
fn clear_the_level(trainer: &mut Trainer) {
    let (at, work) = parts(trainer);
    let sampled = at.sample_field(&at.seen(), work).unwrap();
    let places = [Some(sampled.at_verts.sdf), sampled.at_points, sampled.at_bridges];
    let values = places.into_iter().flatten().flat_map(|var| work.tape.value(var).data());
    let mut values: Vec<f32> = values.copied().filter(|s| s.abs() < 0.03).collect();
    values.sort_by(f32::total_cmp);
    let widest = values.windows(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0]))).unwrap();
    let shift = -0.5 * (widest[0] + widest[1]);
    let last = trainer.state.field.params().id("field.2.bias").unwrap();
    trainer.work.clear();
    trainer.state.field.params_mut().value_mut(last).data_mut()[0] += shift;
    find_band(trainer);
}

/// The sum of the terms with their weights, as the options document them; `progress` is the share of the training done.
fn weighted_terms(config: &Config, terms: &Terms, progress: f32) -> f64 {
    let w = &config.weights;
    let decayed = |(name, weight): (&str, f32)| match name {
        "deform" => weight * w.deform_decay.powf(progress),
        _ => weight,
    };
    let weights = w.each().map(decayed);
    weights
        .into_iter()
        .zip(terms.each())
        .map(|(weight, (_, term))| {
            assert!(term > 0.0, "{terms:?}");
            f64::from(weight) * f64::from(term)
        })
        .sum()
}

/// Compares the gradients of step `step` of the training with differences of its loss, for every parameter of the field
/// and of Psi. (Those of Phi also go straight through the choice of patches, which differences do not see; they are
/// checked with Phi.) Returns how many agreed and how many differences had not settled.
fn check_step(config: &Config, step: usize, seed: u64) -> (usize, usize) {
    let points = AnalyticShape::Torus { major: 0.33, minor: 0.16 }.sample(40, seed).0;
    let config = Config { seed, ..config.clone() };
    let mut trainer = at_training(&points, &config);
    let parts_of_s = if config.batch.centres < points.len() { 2 } else { 1 };
    assert_eq!(trainer.setup.blocks.len(), parts_of_s);
    trainer.state.step += step;
    trainer.state.bridges = Bridges {
        points: vec![[0.31, 0.1, -0.2], [0.0, 0.4, 0.1], [0.0; 3]],
        depths: vec![0.3, 0.2, 0.1],
        looked: 0,
    };
    find_band(&mut trainer);
    clear_the_level(&mut trainer);
    trainer.work.held_samples = Some(Default::default());
    let (seen, recorded, of_field, of_map) = differentiate(&mut trainer);
    let base = loss_at(&mut trainer);
    let progress = step as f32 / config.steps_in(Phase::Train) as f32;
    // Without the training of the parameterization there is no L_para in the step.
    if config.bsp_every.is_some() {
        assert_eq!(seen.block, Some(step / 2 % trainer.setup.blocks.len()));
        let sum = weighted_terms(&config, &recorded.terms, progress);
        assert!((base - sum).abs() < 1e-5 * sum, "{base} is not the sum {sum} of {:?}", recorded.terms);
    }

    let map = trainer.state.map.as_ref().unwrap();
    let field = (0..).zip(trainer.state.field.params().names()).zip(of_field).map(|p| (false, p));
    let psi = (0..).zip(map.params().names()).zip(of_map.unwrap_or_default()).map(|p| (true, p));
    let gradients: Vec<(bool, usize, String, Tensor)> = field
        .chain(psi.filter(|(_, ((_, name), _))| name.starts_with("psi")))
        .map(|(map, ((i, name), gradient))| (map, i, name.to_string(), gradient.expect("a gradient")))
        .collect();
    let (mut agreed, mut unsettled) = (0, 0);
    for (map, index, name, gradient) in gradients {
        assert!(gradient.is_finite());
        let along = direction(gradient.dims(), seed ^ index as u64);
        let analytic: f64 =
            gradient.data().iter().zip(along.data()).map(|(g, d)| f64::from(*g) * f64::from(*d)).sum();
        let mut at = |by: f32| {
            nudge(&mut trainer, map, index, &along, by);
            let loss = loss_at(&mut trainer);
            nudge(&mut trainer, map, index, &along, -by);
            loss
        };
        let mut difference = |h: f32| (at(h) - at(-h)) / (2.0 * f64::from(h));
        // The loss is rounded to f32, and so is much on the way to it.
        let close = |a: f64, b: f64, h: f64| (a - b).abs() <= 0.02 * a.abs().max(b.abs()) + 1e-6 * base / h;
        let (wide, narrow) = (difference(4e-4), difference(1e-4));
        if close(wide, analytic, 4e-4) || close(narrow, analytic, 1e-4) {
            agreed += 1;
        } else {
            let settled = close(wide, narrow, 1e-4);
            assert!(
                !settled,
                "seed {seed}, {name}: {analytic:e}, but by differences {wide:e} and {narrow:e}"
            );
            unsettled += 1;
        }
    }
    (agreed, unsettled)
}

#[test]
fn the_gradient_of_a_whole_step_agrees_with_differences() {
    let (mut agreed, mut unsettled) = (0, 0);
    let mut add = |(a, u): (usize, usize)| {
        agreed += a;
        unsettled += u;
    };
    for (seed, deformation, target) in [
        (1, Deformation::Projection, Target::Surface),
        (2, Deformation::Tanh, Target::SurfaceAndCloud),
        (4, Deformation::Offset, Target::Surface),
    ] {
        add(check_step(&Config { deformation, target, ..all_terms() }, 0, seed));
    }
    // A parameterization that is not trained in this step.
    add(check_step(&Config { bsp_every: None, ..all_terms() }, 0, 3));
    assert!(unsettled * 20 < agreed, "{unsettled} of {} differences had not settled", agreed + unsettled);
}

#[test]
fn the_gradient_of_a_late_step_with_samples_and_blocks_agrees_with_differences() {
    let (mut agreed, mut unsettled) = (0, 0);
    // Both blocks: the parameterization is trained in every second step, each time on the next block.
    for (step, seed) in [(8, 5), (10, 6)] {
        let (a, u) = check_step(&sampled_in_blocks(), step, seed);
        agreed += a;
        unsettled += u;
    }
    assert!(unsettled * 20 < agreed, "{unsettled} of {} differences had not settled", agreed + unsettled);
}

#[test]
fn every_parameter_has_a_gradient_that_is_not_zero() {
    let mut silent: Vec<String> = Vec::new();
    for parameterization in
        [Parameterization::Bsp, Parameterization::Single, Parameterization::Multiple { maps: 3 }]
    {
        let config = Config { parameterization, ..all_terms() };
        let mut trainer = at_training(&ball(40), &config);
        find_band(&mut trainer);
        let (_, _, of_field, of_map) = differentiate(&mut trainer);
        let map = trainer.state.map.as_ref().unwrap();
        let names = trainer.state.field.params().names().chain(map.params().names());
        for (name, gradient) in names.zip(of_field.into_iter().chain(of_map.unwrap())) {
            let norm = gradient_norm(&[gradient]);
            assert!(norm.is_finite(), "{name}");
            if norm < 1e-9 {
                silent.push(name.to_string());
            }
        }
    }
    silent.retain(|name| {
        // A softmax ignores what shifts all its scores alike.
        !["phi.attention.gamma.layer1.bias", "phi.attention.eta.bias", "psi.block.cross.key.bias"]
            .contains(&name.as_str())
    });
    assert_eq!(silent, [""; 0]);
}
