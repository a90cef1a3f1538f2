//! The second phase: the parameterization is trained alone, on L_para.

use super::{StepReport, Update, Workspace, check_gradients, check_near, diverged};
use crate::autodiff::{Tape, Var};
use crate::bsp::{Neighbourhood, SurfaceMap};
use crate::error::Error;
use crate::loss::Direction;
use crate::nn::Bound;
use crate::optim::gradient_norm;
use crate::reconstruct::Phase;
use crate::reconstruct::objective::Terms;
use crate::reconstruct::setup::Setup;
use crate::reconstruct::shape_samples::BlockSamples;
use crate::reconstruct::state::State;
use crate::tensor::Tensor;
use std::sync::Arc;

/// One step of the pretraining of `map`, the map of the state: on the next block of the denoised points, in turn.
/// With `bsp_pretrain_on_shape`, S is drawn to cover samples of the first shape as well.
///
/// # Errors
/// [`ErrorKind::Diverged`](crate::ErrorKind::Diverged) if S, the loss or its gradients are not finite.
pub(in crate::reconstruct) fn step(
    setup: &Setup,
    state: &State,
    map: &SurfaceMap,
    work: &mut Workspace,
) -> Result<Update, Error> {
    let Setup { config, denoised, blocks, .. } = setup;
    let (_, step) = config.phase_at(state.step);
    let block = &blocks[step % blocks.len()];
    let tape = &mut work.tape;
    tape.clear();
    let p = map.params().bind(tape, true);
    let (surface, context) = forward_map(tape, map, &p, denoised, block)?;
    let slack = map.slack(block, denoised.len());
    let samples = setup.samples.as_ref().filter(|_| config.bsp_pretrain_on_shape);
    let around = samples.map_or_else(BlockSamples::default, |samples| samples.around(block));
    let para = para_term(tape, surface, context, block, &around, slack);
    let loss = tape.value(para).item();
    let gradients = p.collect(&mut tape.backward(para));
    let gradient_norm = gradient_norm(&gradients);
    if !loss.is_finite() {
        return Err(diverged("the loss of the parameterization is not finite"));
    }
    check_gradients("the parameterization", &gradients)?;

    let bsp_rate = config.bsp_rate.rate_at(step, config.steps_in(Phase::Pretrain));
    let terms = Terms { para: loss, ..Terms::default() };
    Ok(Update {
        report: StepReport { loss, terms, bsp_rate, gradient_norm, ..StepReport::default() },
        field: None,
        map: Some(gradients),
        part_of_s: None,
    })
}

/// A block's part of S ((b M) x 3 for BSP) and its context (p x 3), on the tape.
pub(super) fn forward_map(
    tape: &mut Tape,
    map: &SurfaceMap,
    p: &Bound,
    denoised: &[[f32; 3]],
    block: &Neighbourhood,
) -> Result<(Var, Var), Error> {
    let context: Vec<[f32; 3]> = block.context().iter().map(|&i| denoised[i as usize]).collect();
    let context = tape.constant(Tensor::from_points(&context));
    let surface = map.forward(tape, p, context, block);
    check_near("the parameterized surface", tape.value(surface).data())?;
    Ok((surface, context))
}

/// L_para of a block, a mean of squared distances both ways: from the block's part of S to the nearest of `context`
/// (p x 3, the points around the block, its centres first), less the slack if there is one; and from the centres to the
/// nearest point of that part of S. Samples of the first shape count as further points: those nearest to a centre as
/// centres, the others as context.
pub(super) fn para_term(
    tape: &mut Tape,
    surface: Var,
    context: Var,
    block: &Neighbourhood,
    samples: &BlockSamples,
    slack: Option<Arc<[f32]>>,
) -> Var {
    let b = block.centres().len();
    let around = with_samples(tape, context, &samples.points);
    if b == block.context().len() && slack.is_none() {
        return tape.chamfer(surface, around, Direction::BOTH);
    }
    let centres = tape.slice_rows(context, 0..b);
    let own = with_samples(tape, centres, &samples.points[..samples.own]);
    let out = match slack {
        None => tape.chamfer(surface, around, Direction::FORWARD),
        Some(slack) => tape.distance_beyond(surface, around, slack),
    };
    let back = tape.chamfer(surface, own, Direction::BACKWARD);
    tape.add(out, back)
}

/// The samples (m x 3) and then the points (p x 3), as rows of one tensor.
fn with_samples(tape: &mut Tape, points: Var, samples: &[[f32; 3]]) -> Var {
    if samples.is_empty() {
        return points;
    }
    let samples = tape.constant(Tensor::from_points(samples));
    tape.concat_rows([samples, points])
}
