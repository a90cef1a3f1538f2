//! The field over many vertices at once, on several threads; its memory does not grow with the vertices beyond a bound.

use super::Field;
use super::network::{Block, Network, Outputs, PackedWeights, Scratch, Seeds};
use crate::tensor::{Pool, Tensor, add_row_sums};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Memory for the activations of a pass, in bytes; what is beyond is computed twice instead of kept.
const MAX_MEMORY: usize = 1 << 30;
/// Blocks whose parameter gradients are alive at the same time.
const WAVE: usize = 16;
/// Parameters that a thread folds at a time.
const FOLD: usize = 1 << 12;

/// The field's values at v vertices, or the loss gradients there.
#[derive(Clone, Debug)]
pub struct FieldValues {
    /// g, v x 1.
    pub sdf: Tensor,
    /// grad g, v x 3.
    pub gradient: Tensor,
    /// The displacement, v x 3, if the field has one; as a gradient, none is zeros.
    pub offset: Option<Tensor>,
}

/// One forward and backward pass of the field over many vertices, block by block on several threads.
///
/// The loss can be taken once over all vertices and its gradient given back to the blocks. Parameter gradients are
/// folded in block order, so they do not depend on the threads. What the first blocks computed is kept for the way
/// back, up to about 1 GiB; the others are computed again then. Sixteen gradients of all parameters come on top.
#[derive(Default)]
pub struct FieldPass {
    blocks: Vec<Block>,
    verts: Vec<[f32; 3]>,
    /// Blocks of the last forward pass that are kept.
    kept: usize,
    /// Bytes that may be kept between the passes.
    limit: Option<usize>,
    /// Parameter gradients of the blocks of a wave, all parameters in one row.
    gradients: Vec<Vec<f32>>,
    /// Of the field of the last forward pass.
    weights: PackedWeights,
    scratch: Mutex<Vec<Scratch>>,
}

impl FieldPass {
    /// A pass without memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// A pass that keeps at most about `bytes` of activations between its two passes.
    pub fn with_memory(bytes: usize) -> Self {
        FieldPass { limit: Some(bytes), ..Self::default() }
    }

    /// The field at the vertices (v x 3, working frame), from the memory of `pool`.
    pub fn forward(&mut self, field: &Field, verts: &[[f32; 3]], pool: &Pool) -> FieldValues {
        let rows = field.block_rows();
        let bytes = Block::bytes(field.config(), rows);
        self.kept = verts.len().div_ceil(rows).min(self.limit.unwrap_or(MAX_MEMORY) / bytes);
        if self.blocks.len() < self.kept {
            self.blocks.resize_with(self.kept, Block::default);
        }
        self.verts.clear();
        self.verts.extend_from_slice(verts);
        let zeros = |cols| Tensor::zeros(&[verts.len(), cols]).into_pool(pool);
        let mut values =
            FieldValues { sdf: zeros(1), gradient: zeros(3), offset: field.has_offset().then(|| zeros(3)) };

        let mut offsets = values.offset.as_mut().map(|o| o.data_mut().chunks_mut(3 * rows));
        let mut parts: Vec<(&[[f32; 3]], Outputs<'_>)> = verts
            .chunks(rows)
            .zip(values.sdf.data_mut().chunks_mut(rows))
            .zip(values.gradient.data_mut().chunks_mut(3 * rows))
            .map(|((verts, sdf), gradient)| {
                let offset = offsets.as_mut().and_then(Iterator::next);
                (verts, Outputs { sdf, gradient, offset })
            })
            .collect();
        let (kept, rest) = parts.split_at_mut(self.kept);
        self.weights.fill(field);
        let network = Network { field, weights: &self.weights };
        let scratch = &self.scratch;
        kept.par_iter_mut().zip(&mut self.blocks).for_each(|((verts, values), block)| {
            with(scratch, |scratch| block.forward(network, verts, scratch, Some(values)));
        });
        rest.par_iter_mut().for_each_init(Block::default, |block, (verts, values)| {
            with(scratch, |scratch| block.forward(network, verts, scratch, Some(values)));
        });
        values
    }

    /// The parameters' gradients from those at the values of the last forward pass, with the same field.
    ///
    /// # Panics
    /// If the shapes are not those of the last forward pass, or if there was none since the last call.
    #[track_caller]
    pub fn backward(&mut self, field: &Field, d: &FieldValues) -> Vec<Option<Tensor>> {
        let v = self.verts.len();
        let shapes = [Some(&d.sdf), Some(&d.gradient), d.offset.as_ref()].map(|t| t.map(Tensor::shape));
        assert!(
            d.sdf.len() == v
                && d.gradient.len() == 3 * v
                && d.offset.as_ref().is_none_or(|o| o.len() == 3 * v),
            "field: gradients {shapes:?} for {v} vertices"
        );
        let rows = field.block_rows();
        let scalars = field.params().scalars();
        let mut total = vec![0.0; scalars];
        let alive = WAVE.min(v.div_ceil(rows));
        if self.gradients.len() < alive {
            self.gradients.resize_with(alive, Vec::new);
        }
        let FieldPass { blocks, verts, kept, gradients, scratch, weights, .. } = self;
        let network = Network { field, weights };
        let (kept_blocks, scratch) = (&mut blocks[..*kept], &*scratch);
        for (wave, blocks) in kept_blocks.chunks_mut(WAVE).enumerate() {
            let gradients = &mut gradients[..blocks.len()];
            blocks.par_iter_mut().zip(&mut *gradients).enumerate().for_each(|(i, (block, gradient))| {
                gradient.resize(scalars, 0.0);
                let seeds = seeds_of(d, (wave * WAVE + i) * rows, rows);
                with(scratch, |scratch| block.backward(network, scratch, seeds, gradient));
            });
            fold(&mut total, gradients);
        }
        let first = (*kept * rows).min(v);
        for (wave, verts) in verts[first..].chunks(WAVE * rows).enumerate() {
            let first = first + wave * WAVE * rows;
            let gradients = &mut gradients[..verts.len().div_ceil(rows)];
            let parts = verts.par_chunks(rows).zip(&mut *gradients).enumerate();
            parts.for_each_init(Block::default, |block, (i, (verts, gradient))| {
                gradient.resize(scalars, 0.0);
                let seeds = seeds_of(d, first + i * rows, rows);
                with(scratch, |scratch| {
                    block.forward(network, verts, scratch, None);
                    block.backward(network, scratch, seeds, gradient);
                });
            });
            fold(&mut total, gradients);
        }
        self.release();
        let mut rest = &total[..];
        let mut take = |like: &Tensor| {
            let (values, after) = rest.split_at(like.len());
            rest = after;
            Some(Tensor::from_vec(like.dims(), values.to_vec()))
        };
        field.params().values().iter().map(|value| take(value)).collect()
    }

    /// Forgets the last pass and keeps its memory for the next one.
    pub fn release(&mut self) {
        self.kept = 0;
        self.verts.clear();
    }

    /// Bytes that the pass holds on to; constant once a repeated step has warmed up.
    pub fn memory(&self) -> usize {
        let scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        let gradients = self.gradients.iter().map(Vec::capacity).sum::<usize>() * size_of::<f32>();
        let blocks = self.blocks.iter().map(Block::memory).sum::<usize>();
        gradients + blocks + scratch.iter().map(Scratch::memory).sum::<usize>()
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

/// The seeds of the block whose first row is `row` and that has up to `rows` of them.
fn seeds_of(d: &FieldValues, row: usize, rows: usize) -> Seeds<'_> {
    let end = (row + rows).min(d.sdf.len());
    Seeds {
        sdf: &d.sdf.data()[row..end],
        gradient: &d.gradient.data()[3 * row..3 * end],
        offset: d.offset.as_ref().map(|o| &o.data()[3 * row..3 * end]),
    }
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
    use crate::field::{Activation, FieldConfig};
    use crate::ops::testing::normal;
    use crate::random::Random;

    fn field(activation: Activation) -> Field {
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

    fn seeds(n: usize) -> FieldValues {
        FieldValues {
            sdf: normal(&[n, 1], 1),
            gradient: normal(&[n, 3], 2),
            offset: Some(normal(&[n, 3], 3)),
        }
    }

    fn bits(values: &FieldValues, gradients: &[Option<Tensor>]) -> Vec<Vec<f32>> {
        let gradients = gradients.iter().map(|g| g.as_ref().unwrap());
        let values = [&values.sdf, &values.gradient, values.offset.as_ref().unwrap()];
        values.into_iter().chain(gradients).map(|t| t.data().to_vec()).collect()
    }

    #[test]
    fn blocks_equal_one_tape_with_and_without_memory() {
        let field = field(Activation::Softplus { beta: 4.0 });
        let rows = field.block_rows();
        let n = 2 * rows + 17;
        let x = points(n, 9);
        let d = seeds(n);
        let mut first: Option<Vec<Vec<f32>>> = None;
        for blocks in [0, 1, 2, 3] {
            let mut pass = FieldPass::with_memory(blocks * Block::bytes(field.config(), rows));
            let values = pass.forward(&field, &x, &Pool::default());
            assert_eq!(pass.kept, blocks);
            let gradients = pass.backward(&field, &d);
            let bits = bits(&values, &gradients);
            assert!(*first.get_or_insert(bits.clone()) == bits, "{blocks} blocks kept");
        }
        let blocks = first.unwrap();

        let mut tape = Tape::new();
        let p = field.params().bind(&mut tape, true);
        let out = field.outputs(&mut tape, &p, &x);
        let offset = out.offset.unwrap();
        let seeds = [(out.sdf, d.sdf), (out.gradient, d.gradient), (offset, d.offset.unwrap())];
        let whole = p.collect(&mut tape.pull(seeds));
        let values = [out.sdf, out.gradient, offset].map(|v| tape.value(v).clone());
        for (a, b) in blocks.iter().zip(values.iter().chain(whole.iter().flatten())) {
            let scale = b.data().iter().fold(1.0f32, |m, x| m.max(x.abs()));
            assert!(a.iter().zip(b.data()).all(|(a, b)| (a - b).abs() < 1e-4 * scale));
        }
    }

    #[test]
    fn a_repeated_pass_grows_no_buffer_and_repeats_its_bits() {
        let field = field(Activation::Relu);
        let x = points(700, 2);
        let d = seeds(700);
        let mut pass = FieldPass::new();
        let pool = Pool::default();
        let mut first: Option<Vec<Vec<f32>>> = None;
        for threads in [1, 2, 3, 1] {
            let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut one = || {
                let values = pass.forward(&field, &x, &pool);
                bits(&values, &pass.backward(&field, &d))
            };
            let bits = workers.install(&mut one);
            assert!(*first.get_or_insert(bits.clone()) == bits, "{threads} threads");
        }
        // With one thread there is one scratch memory in use, the same every time once all have grown.
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let mut pass = FieldPass::new();
        let mut held = Vec::new();
        for _ in 0..3 {
            alone.install(|| {
                pass.forward(&field, &x, &pool);
                pass.backward(&field, &d);
            });
            held.push(pass.memory());
        }
        assert!(held[0] > 0 && held[1] == held[0] && held[2] == held[0], "{held:?}");
    }
}
