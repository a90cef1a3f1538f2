//! The field over many vertices at once, on several threads and in bounded memory.

use super::field::{CHUNK, Field, FieldVars};
use crate::autodiff::Tape;
use crate::nn::Bound;
use crate::tensor::{Pool, Tensor};
use rayon::prelude::*;

/// Memory for the activations of a pass, in bytes; what is beyond is computed twice instead of kept.
const MEMORY: usize = 1 << 30;
/// Chunks whose parameter gradients are alive at the same time.
const WAVE: usize = 32;

/// The field's values at v vertices, or the loss gradients there.
#[derive(Clone, Debug)]
pub struct FieldValues {
    /// g, v x 1.
    pub sdf: Tensor,
    /// grad g, v x 3.
    pub gradient: Tensor,
    /// The displacement, v x 3, if the field has one.
    pub offset: Option<Tensor>,
}

/// One forward and backward pass of the field over many vertices, chunk by chunk on several threads.
///
/// Every chunk has a tape of its own, so that the loss can be taken once over all vertices and its gradient pulled
/// back through the chunks. Parameter gradients are folded in chunk order, so they do not depend on the threads. The
/// tapes of the first chunks are kept for the way back, up to about 1 GiB; the others are recorded again then.
#[derive(Default)]
pub struct FieldPass {
    chunks: Vec<Chunk>,
    verts: Vec<[f32; 3]>,
    /// Chunks of the last forward pass whose tapes are kept.
    kept: usize,
    memory: Option<usize>,
}

#[derive(Default)]
struct Chunk {
    tape: Tape,
    recorded: Option<(Bound, FieldVars)>,
}

/// Where one chunk's values go.
struct Slot<'a> {
    verts: &'a [[f32; 3]],
    sdf: &'a mut [f32],
    gradient: &'a mut [f32],
    offset: Option<&'a mut [f32]>,
}

impl Slot<'_> {
    fn fill(&mut self, tape: &Tape, vars: &FieldVars) {
        self.sdf.copy_from_slice(tape.value(vars.sdf).data());
        self.gradient.copy_from_slice(tape.value(vars.gradient).data());
        if let (Some(out), Some(offset)) = (&mut self.offset, vars.offset) {
            out.copy_from_slice(tape.value(offset).data());
        }
    }
}

impl FieldPass {
    /// A pass without memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// A pass that keeps at most about `bytes` of activations between its two halves.
    pub fn with_memory(bytes: usize) -> Self {
        FieldPass { memory: Some(bytes), ..Self::default() }
    }

    /// The field at the vertices (v x 3, working frame), from the memory of `pool`.
    pub fn forward(&mut self, field: &Field, verts: &[[f32; 3]], pool: &Pool) -> FieldValues {
        let used = verts.len().div_ceil(CHUNK);
        self.kept = used.min(self.memory.unwrap_or(MEMORY) / chunk_bytes(field));
        if self.chunks.len() < self.kept {
            self.chunks.resize_with(self.kept, Chunk::default);
        }
        self.verts.clear();
        self.verts.extend_from_slice(verts);
        let zeros = |cols| Tensor::zeros(&[verts.len(), cols]).into_pool(pool);
        let mut values =
            FieldValues { sdf: zeros(1), gradient: zeros(3), offset: field.has_offset().then(|| zeros(3)) };

        let mut offsets = values.offset.as_mut().map(|o| o.data_mut().chunks_mut(3 * CHUNK));
        let mut slots: Vec<Slot<'_>> = verts
            .chunks(CHUNK)
            .zip(values.sdf.data_mut().chunks_mut(CHUNK))
            .zip(values.gradient.data_mut().chunks_mut(3 * CHUNK))
            .map(|((verts, sdf), gradient)| {
                let offset = offsets.as_mut().and_then(Iterator::next);
                Slot { verts, sdf, gradient, offset }
            })
            .collect();
        let (kept, rest) = slots.split_at_mut(self.kept);
        kept.par_iter_mut().zip(&mut self.chunks).for_each(|(slot, chunk)| {
            chunk.record(field, slot.verts);
            let (_, vars) = chunk.recorded.as_ref().expect("recorded above");
            slot.fill(&chunk.tape, vars);
        });
        rest.par_iter_mut().for_each_init(Tape::new, |tape, slot| {
            tape.clear();
            let p = field.params().bind(tape, false);
            let vars = field.outputs(tape, &p, slot.verts);
            slot.fill(tape, &vars);
        });
        values
    }

    /// The parameters' gradients from those at the values of the last forward pass, with the same field.
    ///
    /// # Panics
    /// If the shapes are not those of the last forward pass.
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
        let (kept, rest) = self.verts.split_at((self.kept * CHUNK).min(v));
        let mut total: Vec<Option<Tensor>> = vec![None; field.params().len()];
        let chunks = &mut self.chunks[..self.kept];
        for (wave, chunks) in chunks.chunks_mut(WAVE).enumerate() {
            let pull = |(i, chunk): (usize, &mut Chunk)| chunk.pull(d, (wave * WAVE + i) * CHUNK);
            fold(&mut total, chunks.par_iter_mut().enumerate().map(pull).collect());
        }
        for (wave, verts) in rest.chunks(WAVE * CHUNK).enumerate() {
            let first = kept.len() + wave * WAVE * CHUNK;
            let pull = |chunk: &mut Chunk, (i, verts): (usize, &[[f32; 3]])| {
                chunk.record(field, verts);
                chunk.pull(d, first + i * CHUNK)
            };
            let chunks = verts.par_chunks(CHUNK).enumerate();
            fold(&mut total, chunks.map_init(Chunk::default, pull).collect());
        }
        total
    }

    /// Lets go of the parameters and activations of the last pass, so that changing the parameters copies nothing.
    pub fn release(&mut self) {
        for chunk in &mut self.chunks {
            chunk.tape.clear();
            chunk.recorded = None;
        }
        self.kept = 0;
        self.verts.clear();
    }

    /// Buffers newly allocated so far by all kept chunks; constant once a repeated step has warmed up.
    pub fn allocations(&self) -> usize {
        self.chunks.iter().map(|c| c.tape.pool().allocations()).sum()
    }
}

impl Chunk {
    fn record(&mut self, field: &Field, verts: &[[f32; 3]]) {
        self.tape.clear();
        let p = field.params().bind(&mut self.tape, true);
        let vars = field.outputs(&mut self.tape, &p, verts);
        self.recorded = Some((p, vars));
    }

    /// The parameters' gradients from the rows of `d` that belong to this chunk, the first of which is `row`.
    fn pull(&mut self, d: &FieldValues, row: usize) -> Vec<Option<Tensor>> {
        let (p, vars) = self.recorded.as_ref().expect("forward first");
        let n = self.tape.value(vars.sdf).rows();
        let seed = |of: &Tensor| {
            let cols = of.cols();
            let rows = of.data()[row * cols..(row + n) * cols].to_vec();
            Tensor::from_vec(&[n, cols], rows).into_pool(self.tape.pool())
        };
        let mut seeds = vec![(vars.sdf, seed(&d.sdf)), (vars.gradient, seed(&d.gradient))];
        if let (Some(var), Some(offset)) = (vars.offset, &d.offset) {
            seeds.push((var, seed(offset)));
        }
        p.collect(&mut self.tape.pull(seeds))
    }
}

/// Adds the chunks' gradients to `total` in chunk order.
fn fold(total: &mut [Option<Tensor>], chunks: Vec<Vec<Option<Tensor>>>) {
    for gradients in chunks {
        for (sum, gradient) in total.iter_mut().zip(gradients) {
            match (sum.as_mut(), gradient) {
                (Some(sum), Some(gradient)) => sum.add_assign(&gradient),
                (None, gradient) => *sum = gradient,
                (Some(_), None) => {}
            }
        }
    }
}

/// About what the tape of a chunk takes: eight values for each hidden unit, four for each input.
fn chunk_bytes(field: &Field) -> usize {
    let config = field.config();
    CHUNK * size_of::<f32>() * (8 * config.width * config.depth + 4 * config.encoding_cols() + 16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gdo::{Activation, FieldConfig};
    use crate::ops::testing::normal;
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;

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
        Field::with_offset(config, &mut ChaCha8Rng::seed_from_u64(3))
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
    fn chunked_pass_equals_one_tape_with_and_without_memory() {
        let field = field(Activation::Softplus { beta: 4.0 });
        let n = 2 * CHUNK + 17;
        let x = points(n, 9);
        let d = seeds(n);
        let mut first: Option<Vec<Vec<f32>>> = None;
        for chunks in [0, 1, 2, 3] {
            let mut pass = FieldPass::with_memory(chunks * chunk_bytes(&field));
            let values = pass.forward(&field, &x, &Pool::default());
            let gradients = pass.backward(&field, &d);
            assert_eq!(pass.kept, chunks);
            let bits = bits(&values, &gradients);
            assert!(*first.get_or_insert(bits.clone()) == bits, "{chunks} chunks kept");
        }
        let chunked = first.unwrap();

        let mut tape = Tape::new();
        let p = field.params().bind(&mut tape, true);
        let out = field.outputs(&mut tape, &p, &x);
        let offset = out.offset.unwrap();
        let seeds = [(out.sdf, d.sdf), (out.gradient, d.gradient), (offset, d.offset.unwrap())];
        let whole = p.collect(&mut tape.pull(seeds));
        let values = [out.sdf, out.gradient, offset].map(|v| tape.value(v).clone());
        for (a, b) in chunked.iter().zip(values.iter().chain(whole.iter().flatten())) {
            let scale = b.data().iter().fold(1.0f32, |m, x| m.max(x.abs()));
            assert!(a.iter().zip(b.data()).all(|(a, b)| (a - b).abs() < 1e-4 * scale));
        }
    }

    #[test]
    fn a_repeated_pass_allocates_nothing_and_repeats_its_bits() {
        let field = field(Activation::Relu);
        let x = points(700, 2);
        let d = seeds(700);
        let mut pass = FieldPass::new();
        let pool = Pool::default();
        let mut first: Option<Vec<Vec<f32>>> = None;
        let mut counts = Vec::new();
        for threads in [1, 2, 3, 1] {
            let workers = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let bits = workers.install(|| {
                let values = pass.forward(&field, &x, &pool);
                bits(&values, &pass.backward(&field, &d))
            });
            counts.push(pass.allocations());
            assert!(*first.get_or_insert(bits.clone()) == bits, "{threads} threads");
        }
        assert_eq!(counts[1], counts[3]);
    }
}
