//! The field over many points at once, on several threads; its memory does not grow with the points beyond a bound.

use super::Field;
use super::network::{Block, Network, PackedWeights, Scratch};
use crate::tensor::add_row_sums;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Memory for the activations of a pass, in bytes; what is beyond is computed twice instead of kept.
const MAX_MEMORY: usize = 1 << 30;
/// Blocks whose parameter gradients are alive at the same time.
const WAVE: usize = 16;
/// Parameters that a thread folds at a time.
const FOLD: usize = 1 << 12;

/// A forward pass of a field over many points and the backward pass to it, block by block on several threads.
///
/// Values and loss gradients are rows: n x 4, g and grad g, or n x 7 with the displacement after them. The loss can be
/// taken once over all points and its gradient given back to the blocks. Parameter gradients are folded in block
/// order, so they do not depend on the threads. What the first blocks computed is kept for the way back, up to about
/// 1 GiB; the others are computed again then. Sixteen gradients of all parameters come on top.
#[derive(Default)]
pub(crate) struct FieldPass {
    /// The field of the last forward pass, until it is released.
    field: Option<Field>,
    points: Vec<[f32; 3]>,
    blocks: Vec<Block>,
    /// Blocks of the last forward pass that are kept.
    kept: usize,
    /// Bytes that may be kept between the passes; `None` is [`MAX_MEMORY`].
    limit: Option<usize>,
    /// Parameter gradients of the blocks of a wave, all parameters in one row.
    gradients: Vec<Vec<f32>>,
    weights: PackedWeights,
    scratch: Mutex<Vec<Scratch>>,
}

impl FieldPass {
    /// Writes the values at n points (working frame) to `values`, in rows.
    ///
    /// # Panics
    /// If there is not room for n rows.
    #[track_caller]
    pub fn forward(&mut self, field: &Field, points: &[[f32; 3]], values: &mut [f32]) {
        let (rows, cols) = (field.block_rows(), field.value_cols());
        assert!(
            values.len() == points.len() * cols,
            "field: {} values for {} points",
            values.len(),
            points.len()
        );
        let bytes = Block::bytes(field.config(), rows);
        self.kept = points.len().div_ceil(rows).min(self.limit.unwrap_or(MAX_MEMORY) / bytes);
        if self.blocks.len() < self.kept {
            self.blocks.resize_with(self.kept, Block::default);
        }
        self.points.clear();
        self.points.extend_from_slice(points);
        self.weights.fill(field);
        let field = self.field.insert(field.clone());

        let mut parts: Vec<_> = points.chunks(rows).zip(values.chunks_mut(rows * cols)).collect();
        let (kept, rest) = parts.split_at_mut(self.kept);
        let network = Network { field, weights: &self.weights };
        let scratch = &self.scratch;
        kept.par_iter_mut().zip(&mut self.blocks).for_each(|((points, values), block)| {
            with(scratch, |scratch| block.forward(network, points, scratch, Some(values)));
        });
        rest.par_iter_mut().for_each_init(Block::default, |block, (points, values)| {
            with(scratch, |scratch| block.forward(network, points, scratch, Some(values)));
        });
    }

    /// The parameters' gradients, all in one row as [`Params::flat`](crate::nn::Params::flat) puts them, from the loss
    /// gradients at the values of the last forward pass. When asked again all blocks are computed again.
    ///
    /// # Panics
    /// If there was no forward pass since the last release, or not as many values.
    #[track_caller]
    pub fn backward(&mut self, seeds: &[f32]) -> Vec<f32> {
        let FieldPass { field, points, blocks, kept, gradients, scratch, weights, .. } = self;
        let field = field.as_ref().expect("field: a backward pass follows a forward pass");
        let (rows, cols) = (field.block_rows(), field.value_cols());
        let n = points.len();
        assert!(seeds.len() == n * cols, "field: {} gradients for {n} points", seeds.len());
        let scalars = field.params().scalars();
        let mut total = vec![0.0; scalars];
        let alive = WAVE.min(n.div_ceil(rows));
        if gradients.len() < alive {
            gradients.resize_with(alive, Vec::new);
        }
        let network = Network { field, weights };
        let scratch = &*scratch;
        let of_block = |i: usize| &seeds[i * rows * cols..seeds.len().min((i + 1) * rows * cols)];
        for (wave, blocks) in blocks[..*kept].chunks_mut(WAVE).enumerate() {
            let gradients = &mut gradients[..blocks.len()];
            blocks.par_iter_mut().zip(&mut *gradients).enumerate().for_each(|(i, (block, gradient))| {
                gradient.resize(scalars, 0.0);
                let seeds = of_block(wave * WAVE + i);
                with(scratch, |scratch| block.backward(network, scratch, seeds, gradient));
            });
            fold(&mut total, gradients);
        }
        let again = &points[(*kept * rows).min(n)..];
        for (wave, points) in again.chunks(WAVE * rows).enumerate() {
            let first = *kept + wave * WAVE;
            let gradients = &mut gradients[..points.len().div_ceil(rows)];
            let parts = points.par_chunks(rows).zip(&mut *gradients).enumerate();
            parts.for_each_init(Block::default, |block, (i, (points, gradient))| {
                gradient.resize(scalars, 0.0);
                with(scratch, |scratch| {
                    block.forward(network, points, scratch, None);
                    block.backward(network, scratch, of_block(first + i), gradient);
                });
            });
            fold(&mut total, gradients);
        }
        // The way back has used up what the blocks kept.
        *kept = 0;
        total
    }

    /// Forgets the last pass and keeps its memory for the next one.
    pub fn release(&mut self) {
        self.field = None;
        self.kept = 0;
        self.points.clear();
    }
}

/// Calls `f` with scratch memory that no one else uses.
fn with<R>(store: &Mutex<Vec<Scratch>>, f: impl FnOnce(&mut Scratch) -> R) -> R {
    let taken = store.lock().unwrap_or_else(PoisonError::into_inner).pop();
    let mut scratch = taken.unwrap_or_default();
    let result = f(&mut scratch);
    store.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    result
}

/// Adds the blocks' gradients to `total` in block order.
fn fold(total: &mut [f32], gradients: &[Vec<f32>]) {
    total.par_chunks_mut(FOLD).enumerate().for_each(|(i, total)| {
        for gradient in gradients {
            add_row_sums(total, &gradient[i * FOLD..][..total.len()]);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autodiff::Tape;
    use crate::field::{FieldActivation, FieldConfig};
    use crate::ops::testing::normal;
    use crate::random::Random;
    use crate::tensor::Tensor;

    fn field(activation: FieldActivation) -> Field {
        let config = FieldConfig {
            width: 9,
            depth: 3,
            octaves: 2,
            frequency: 1.5,
            activation,
            skip: Some(1),
            radius: 0.4,
        };
        Field::with_offset(config, &mut Random::new(3))
    }

    fn points(n: usize, seed: u64) -> Vec<[f32; 3]> {
        normal(&[n, 3], seed).to_points().into_iter().map(|p| p.map(|x| 0.3 * x)).collect()
    }

    fn seeds(n: usize) -> Vec<f32> {
        normal(&[n, 7], 1).data().to_vec()
    }

    /// The values at points, and the parameters' gradients.
    fn run(pass: &mut FieldPass, field: &Field, points: &[[f32; 3]], seeds: &[f32]) -> [Vec<f32>; 2] {
        let mut values = vec![0.0; seeds.len()];
        pass.forward(field, points, &mut values);
        [values, pass.backward(seeds)]
    }

    #[test]
    fn blocks_equal_one_tape_with_and_without_memory() {
        let field = field(FieldActivation::Softplus { beta: 4.0 });
        let rows = field.block_rows();
        let n = 2 * rows + 17;
        let (x, d) = (points(n, 9), seeds(n));
        let mut first: Option<[Vec<f32>; 2]> = None;
        for blocks in [0, 1, 2, 3] {
            let limit = Some(blocks * Block::bytes(field.config(), rows));
            let mut pass = FieldPass { limit, ..FieldPass::default() };
            let mut values = vec![0.0; d.len()];
            pass.forward(&field, &x, &mut values);
            assert_eq!(pass.kept, blocks);
            let found = [values, pass.backward(&d)];
            // Asked again, the pass has kept nothing and computes all blocks again.
            assert_eq!(pass.kept, 0);
            assert!(pass.backward(&d) == found[1], "{blocks} blocks kept, twice");
            assert!(*first.get_or_insert(found.clone()) == found, "{blocks} blocks kept");
        }

        let mut tape = Tape::new();
        let p = field.params().bind(&mut tape, true);
        let out = field.outputs(&mut tape, &p, &x);
        let all = tape.concat_cols([out.sdf, out.gradient, out.offset.unwrap()]);
        let whole = p.collect(&mut tape.pull([(all, Tensor::from_vec(&[n, 7], d))]));
        let [values, gradients] = first.unwrap();
        let gradients = field.params().split(&gradients);
        let found = std::iter::once(&values[..]).chain(gradients.iter().map(Tensor::data));
        for (a, b) in found.zip(std::iter::once(tape.value(all)).chain(whole.iter().flatten())) {
            let scale = b.data().iter().fold(1.0f32, |m, x| m.max(x.abs()));
            assert!(a.iter().zip(b.data()).all(|(a, b)| (a - b).abs() < 1e-4 * scale));
        }
    }

    /// Bytes that a pass holds on to.
    fn memory(pass: &FieldPass) -> usize {
        let scratch = pass.scratch.lock().unwrap();
        let gradients = pass.gradients.iter().map(Vec::capacity).sum::<usize>() * size_of::<f32>();
        let blocks = pass.blocks.iter().map(Block::memory).sum::<usize>();
        gradients + blocks + scratch.iter().map(Scratch::memory).sum::<usize>()
    }

    #[test]
    fn a_repeated_pass_grows_no_buffer_and_repeats_its_bits() {
        let field = field(FieldActivation::Relu);
        let (x, d) = (points(700, 2), seeds(700));
        let mut pass = FieldPass::default();
        let mut first: Option<[Vec<f32>; 2]> = None;
        for threads in [1, 2, 3, 1] {
            let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let found = workers.install(|| run(&mut pass, &field, &x, &d));
            assert!(*first.get_or_insert(found.clone()) == found, "{threads} threads");
        }
        // With one thread there is one scratch memory in use, the same every time once all have grown.
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let mut pass = FieldPass::default();
        let mut held = Vec::new();
        for _ in 0..3 {
            alone.install(|| run(&mut pass, &field, &x, &d));
            pass.release();
            held.push(memory(&pass));
        }
        assert!(held[0] > 0 && held[1] == held[0] && held[2] == held[0], "{held:?}");
    }
}
