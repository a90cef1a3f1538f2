//! The field at many points without gradients for its parameters.

use super::Field;
use super::network::{Block, Network, PackedWeights, Scratch};
use rayon::prelude::*;

/// Values of a layer's output that a block has.
const BLOCK_VALUES: usize = 16_384;
/// Blocks of points that one task of a thread goes through.
const BLOCKS_PER_TASK: usize = 8;
impl Field {
    /// Points that are worked on at a time, so that what a layer touches stays in the processor's cache.
    pub(super) fn block_rows(&self) -> usize {
        (BLOCK_VALUES / self.config().width).clamp(64, 256)
    }

    /// g at points (n x 3, working frame), without gradients and in parallel over fixed blocks.
    pub fn sdf(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let mut out = vec![0.0; points.len()];
        let rows = self.block_rows();
        let task = rows * BLOCKS_PER_TASK;
        let network = Network { field: self, weights: &PackedWeights::straight(self) };
        out.par_chunks_mut(task).zip(points.par_chunks(task)).for_each(|(out, points)| {
            let (mut block, mut scratch) = <(Block, Scratch)>::default();
            for (out, points) in out.chunks_mut(rows).zip(points.chunks(rows)) {
                block.sdf(network, points, &mut scratch, out);
            }
        });
        out
    }

    /// grad g at points (n x 3, working frame), in parallel over fixed blocks.
    pub fn gradient(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        self.sdf_and_gradient(points).1
    }

    /// g (n) and grad g (n x 3) at points (n x 3, working frame), in parallel over fixed blocks.
    pub fn sdf_and_gradient(&self, points: &[[f32; 3]]) -> (Vec<f32>, Vec<[f32; 3]>) {
        let (mut sdf, mut gradient) = (vec![0.0; points.len()], vec![[0.0; 3]; points.len()]);
        let rows = self.block_rows();
        let task = rows * BLOCKS_PER_TASK;
        let mut weights = PackedWeights::default();
        weights.fill(self);
        let network = Network { field: self, weights: &weights };
        let tasks = sdf.par_chunks_mut(task).zip(gradient.par_chunks_mut(task)).zip(points.par_chunks(task));
        tasks.for_each(|((sdf, gradient), points)| {
            let (mut block, mut scratch) = <(Block, Scratch)>::default();
            let cols = self.value_cols();
            let mut values = vec![0.0; rows.min(points.len()) * cols];
            let parts = sdf.chunks_mut(rows).zip(gradient.chunks_mut(rows)).zip(points.chunks(rows));
            for ((sdf, gradient), points) in parts {
                let values = &mut values[..points.len() * cols];
                block.forward(network, points, &mut scratch, Some(values));
                for ((s, g), value) in sdf.iter_mut().zip(gradient).zip(values.chunks_exact(cols)) {
                    *s = value[0];
                    g.copy_from_slice(&value[1..4]);
                }
            }
        });
        (sdf, gradient)
    }
}
