//! The field network over a block of points: values, spatial gradient and the gradients of the weights, without a tape.
//!
//! `field/testing.rs` writes the same arithmetic with tape operations; that is its twin in the tests.
//! Here every layer is a few matrix products with one pass over the block between them, so that what a layer works
//! on stays in the processor's cache and nothing is allocated once the buffers have grown.
//!
//! With x_0 the encoding, z_l = x_l W_l + b_l and x_(l+1) = act(z_l), the forward pass keeps the slopes
//! s_l = act'(z_l) and sweeps once from the last layer down: r_l = (s_l * r_(l+1)) W_l^T, where r_depth is the last
//! weight column; r_0, taken through the encoding, is grad g. The backward pass runs through that sweep from the
//! encoding up, which leaves what reaches z_l through its slope, and then through the layers from the last one down.
//! That makes six products a layer.

#[cfg(test)]
mod tests;

use super::rows::{
    back_through_activation, back_through_slope, copy_columns, join, multiply, relu_rows, softplus_rows,
};
use super::{Field, FieldActivation, FieldConfig};
use crate::simd::sin_cos_slice;
use crate::tensor::{Base, MatRef, Panels, add_row_sums, gemm_panels_serial, gemm_serial};
use std::f32::consts::FRAC_1_SQRT_2;
use std::ops::Range;

/// Rows of a block that a product and the passes beside it go over before the next ones, so that what one writes is in
/// the first caches when the other reads it; whole tiles for every instruction set.
const STRIP: usize = 48;

/// The strips of n rows.
fn strips(n: usize) -> impl Iterator<Item = Range<usize>> {
    (0..n).step_by(STRIP).map(move |first| first..(first + STRIP).min(n))
}

/// The values of the rows in a slice with `cols` columns.
fn of_rows<'a>(data: &'a [f32], rows: &Range<usize>, cols: usize) -> &'a [f32] {
    &data[rows.start * cols..rows.end * cols]
}

/// The values of the rows in a slice with `cols` columns, to be changed.
fn of_rows_mut<'a>(data: &'a mut [f32], rows: &Range<usize>, cols: usize) -> &'a mut [f32] {
    &mut data[rows.start * cols..rows.end * cols]
}

/// out = left (n x from) times the weights, for a strip of n rows.
fn product(out: &mut [f32], cols: usize, left: &[f32], from: usize, weights: &Panels) {
    gemm_panels_serial(out, cols, Base::Zero, mat(left, left.len() / from.max(1), from), weights);
}

/// The hidden layers' weights as the products want them.
#[derive(Default)]
pub(super) struct PackedWeights {
    straight: Vec<Panels>,
    transposed: Vec<Panels>,
}

impl PackedWeights {
    /// The weights of a field, prepared for its values alone, not for gradients.
    pub(super) fn straight(field: &Field) -> Self {
        let mut weights = PackedWeights::default();
        weights.fill_straight(field);
        weights
    }

    fn fill_straight(&mut self, field: &Field) {
        let depth = field.config().depth;
        self.straight.resize_with(depth, Panels::default);
        self.straight.iter_mut().enumerate().for_each(|(l, w)| w.fill(field.layer(l).0.as_mat()));
    }

    /// Prepares the weights of a field, for values and gradients.
    pub(super) fn fill(&mut self, field: &Field) {
        self.fill_straight(field);
        self.transposed.resize_with(field.config().depth, Panels::default);
        let each = self.transposed.iter_mut().enumerate();
        each.for_each(|(l, w)| w.fill(field.layer(l).0.as_mat().t()));
    }
}

/// A field with its weights prepared.
#[derive(Clone, Copy)]
pub(super) struct Network<'a> {
    /// The field, for its shape, its biases and its last layer.
    pub field: &'a Field,
    /// The prepared weights of the field's hidden layers.
    pub weights: &'a PackedWeights,
}

/// What the forward pass keeps of a block for the backward pass.
#[derive(Default)]
pub(super) struct Block {
    rows: usize,
    /// x_0, n x e.
    encoding: Vec<f32>,
    /// x_l of the layer that the encoding is joined to, n x (c + e).
    joined: Vec<f32>,
    hidden: Vec<Hidden>,
}

/// What the forward pass keeps of one hidden layer; each n x c.
#[derive(Default)]
struct Hidden {
    /// x_(l+1).
    out: Vec<f32>,
    /// s_l.
    slope: Vec<f32>,
    /// r_(l+1), the adjoint of `out`; in the backward pass, what reaches z_l through its slope.
    adjoint: Vec<f32>,
}

/// Memory for what lives only within a block's forward or backward pass; can serve one block after the other.
#[derive(Default)]
pub(super) struct Scratch {
    angles: [Vec<f32>; 3],
    outputs: Vec<f32>,
    encoding: Vec<f32>,
    /// Each n x c, or n x (c + e).
    wide: [Vec<f32>; 4],
}

/// `len` values of a buffer that grows when it must; what they hold is to be overwritten.
fn room(buffer: &mut Vec<f32>, len: usize) -> &mut [f32] {
    if buffer.len() < len {
        buffer.resize(len, 0.0);
    }
    &mut buffer[..len]
}

/// n x c in a slice.
fn mat(data: &[f32], n: usize, c: usize) -> MatRef<'_> {
    MatRef::window(data, n, c, c)
}

/// Where the gradients of layer l's weight and bias lie in one buffer for all parameters.
fn places(field: &Field, l: usize) -> (Range<usize>, Range<usize>) {
    let len = |l| field.layer(l).0.len() + field.layer(l).1.len();
    let start: usize = (0..l).map(len).sum();
    let weight = start..start + field.layer(l).0.len();
    (weight.clone(), weight.end..start + len(l))
}

#[cfg(test)]
impl Scratch {
    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        let Scratch { angles, outputs, encoding, wide } = self;
        bytes_of(angles.iter().chain([outputs, encoding]).chain(wide))
    }
}

#[cfg(test)]
fn bytes_of<'a>(buffers: impl Iterator<Item = &'a Vec<f32>>) -> usize {
    buffers.map(Vec::capacity).sum::<usize>() * size_of::<f32>()
}

impl Block {
    /// Bytes held.
    #[cfg(test)]
    pub(super) fn memory(&self) -> usize {
        let hidden = self.hidden.iter().flat_map(|h| [&h.out, &h.slope, &h.adjoint]);
        bytes_of([&self.encoding, &self.joined].into_iter().chain(hidden))
    }

    /// About what a block of `rows` points keeps between its passes, in bytes.
    pub(super) fn bytes(config: &FieldConfig, rows: usize) -> usize {
        let joined = config.skip.map_or(0, |_| config.width + config.encoding_cols());
        rows * size_of::<f32>() * (3 * config.width * config.depth + config.encoding_cols() + joined)
    }

    /// The encoding of the points, [x, sin f x, cos f x, sin 2f x, cos 2f x, ...], n x e.
    fn encode(&mut self, config: &FieldConfig, points: &[[f32; 3]], scratch: &mut Scratch) {
        let (n, e, waves) = (points.len(), config.encoding_cols(), 3 * config.octaves);
        let [angles, sin, cos] = &mut scratch.angles;
        let (angles, sin) = (room(angles, n * waves), room(sin, n * waves));
        let cos = room(cos, n * waves);
        if waves > 0 {
            for (row, x) in angles.chunks_exact_mut(waves).zip(points) {
                for (f, part) in config.frequencies().zip(row.chunks_exact_mut(3)) {
                    part.iter_mut().zip(x).for_each(|(a, x)| *a = f * x);
                }
            }
        }
        sin_cos_slice(sin, cos, angles);
        for (i, (row, x)) in room(&mut self.encoding, n * e).chunks_exact_mut(e).zip(points).enumerate() {
            row[..3].copy_from_slice(x);
            for (o, part) in row[3..].chunks_exact_mut(6).enumerate() {
                let at = i * waves + 3 * o;
                part[..3].copy_from_slice(&sin[at..at + 3]);
                part[3..].copy_from_slice(&cos[at..at + 3]);
            }
        }
    }

    /// The layers up to the outputs (n x 1, or n x 4 with a displacement), which are left in the scratch memory.
    fn layers(&mut self, network: Network<'_>, points: &[[f32; 3]], scratch: &mut Scratch) {
        let Network { field, weights } = network;
        let config = field.config();
        let (n, c, e) = (points.len(), config.width, config.encoding_cols());
        self.rows = n;
        self.hidden.resize_with(config.depth, Hidden::default);
        self.encode(config, points, scratch);
        for l in 0..config.depth {
            let (before, rest) = self.hidden.split_at_mut(l);
            let Hidden { out, slope, .. } = &mut rest[0];
            let (weight, bias) = field.layer(l);
            let input = match before.last() {
                None => &self.encoding[..n * e],
                Some(last) if Some(l) == config.skip => {
                    let joined = room(&mut self.joined, n * (c + e));
                    join(joined, &last.out[..n * c], c, &self.encoding, e);
                    &*joined
                }
                Some(last) => &last.out[..n * c],
            };
            let (out, slope) = (room(out, n * c), room(slope, n * c));
            for rows in strips(n) {
                let (out, slope) = (of_rows_mut(out, &rows, c), of_rows_mut(slope, &rows, c));
                product(out, c, of_rows(input, &rows, weight.rows()), weight.rows(), &weights.straight[l]);
                match config.activation {
                    FieldActivation::Softplus { beta } => softplus_rows(out, slope, bias.data(), beta),
                    FieldActivation::Relu => relu_rows(out, slope, bias.data()),
                }
            }
        }
        let (weight, bias) = field.layer(config.depth);
        let outputs = room(&mut scratch.outputs, n * weight.cols());
        let last = &self.hidden[config.depth - 1].out[..n * c];
        gemm_serial(outputs, weight.cols(), Base::Zero, mat(last, n, c), weight.as_mat());
        for row in outputs.chunks_exact_mut(weight.cols()) {
            row.iter_mut().zip(bias.data()).for_each(|(o, b)| *o += b);
        }
    }

    /// g alone at n points.
    pub(super) fn sdf(
        &mut self,
        network: Network<'_>,
        points: &[[f32; 3]],
        scratch: &mut Scratch,
        out: &mut [f32],
    ) {
        self.layers(network, points, scratch);
        let field = network.field;
        let outputs = field.layer(field.config().depth).0.cols();
        copy_columns(out, 1, &scratch.outputs, outputs, 0, 1.0);
    }

    /// What the backward pass needs at n points (working frame), and all values there if asked for: n x 4, g and
    /// grad g, or n x 7 with the displacement after them.
    pub(super) fn forward(
        &mut self,
        network: Network<'_>,
        points: &[[f32; 3]],
        scratch: &mut Scratch,
        values: Option<&mut [f32]>,
    ) {
        self.layers(network, points, scratch);
        let Network { field, weights } = network;
        let config = field.config();
        let (n, c, e) = (self.rows, config.width, config.encoding_cols());
        let outputs = field.layer(config.depth).0.cols();
        // The adjoint sweep.
        let (last, _) = field.layer(config.depth);
        let [through, wide, column, _] = &mut scratch.wide;
        let column = room(column, c);
        column.iter_mut().zip(last.data().chunks_exact(outputs)).for_each(|(o, row)| *o = row[0]);
        let top = &mut self.hidden[config.depth - 1].adjoint;
        room(top, n * c).chunks_exact_mut(c).for_each(|row| row.copy_from_slice(column));
        let at_encoding = room(&mut scratch.encoding, n * e);
        at_encoding.fill(0.0);
        let (through, wide) = (room(through, STRIP * c), room(wide, STRIP * (c + e)));
        for l in (0..config.depth).rev() {
            let (below, rest) = self.hidden.split_at_mut(l);
            let (Hidden { slope, adjoint, .. }, transposed) = (&rest[0], &weights.transposed[l]);
            let mut below = below.last_mut().map(|below| room(&mut below.adjoint, n * c));
            for rows in strips(n) {
                let through = &mut through[..rows.len() * c];
                multiply(through, of_rows(slope, &rows, c), of_rows(adjoint, &rows, c));
                let at_encoding = of_rows_mut(at_encoding, &rows, e);
                match below.as_deref_mut().map(|below| of_rows_mut(below, &rows, c)) {
                    None => {
                        gemm_panels_serial(at_encoding, e, Base::Out, mat(through, rows.len(), c), transposed)
                    }
                    Some(below) if Some(l) == config.skip => {
                        let wide = &mut wide[..rows.len() * (c + e)];
                        product(wide, c + e, through, c, transposed);
                        copy_columns(below, c, wide, c + e, 0, FRAC_1_SQRT_2);
                        copy_columns(at_encoding, e, wide, c + e, c, FRAC_1_SQRT_2);
                    }
                    Some(below) => product(below, c, through, c, transposed),
                }
            }
        }
        let Some(values) = values else { return };
        let rows = at_encoding.chunks_exact(e).zip(self.encoding.chunks_exact(e));
        let rows = rows.zip(scratch.outputs.chunks_exact(outputs));
        for (out, ((row, encoding), outputs)) in values.chunks_exact_mut(field.value_cols()).zip(rows) {
            out[0] = outputs[0];
            out[4..].copy_from_slice(&outputs[1..]);
            // Through the encoding: d sin(fx) = f cos(fx), d cos(fx) = -f sin(fx).
            let out = &mut out[1..4];
            out.copy_from_slice(&row[..3]);
            let waves = row[3..].chunks_exact(6).zip(encoding[3..].chunks_exact(6));
            for (f, (row, wave)) in config.frequencies().zip(waves) {
                for d in 0..3 {
                    out[d] += f * (wave[3 + d] * row[d] - wave[d] * row[3 + d]);
                }
            }
        }
    }

    /// Writes the parameters' gradients to `total`, which holds weight and bias of layer after layer, from the loss
    /// gradients at the values of the last forward pass, in rows like theirs. Can be called once for each forward pass.
    pub(super) fn backward(
        &mut self,
        network: Network<'_>,
        scratch: &mut Scratch,
        seeds: &[f32],
        total: &mut [f32],
    ) {
        let Network { field, weights } = network;
        let config = field.config();
        let (n, c, e) = (self.rows, config.width, config.encoding_cols());
        let beta = match config.activation {
            FieldActivation::Softplus { beta } => beta,
            FieldActivation::Relu => 0.0,
        };
        // Back through the adjoint sweep, from the encoding up.
        let at_encoding = room(&mut scratch.encoding, n * e);
        let rows = at_encoding.chunks_exact_mut(e).zip(self.encoding.chunks_exact(e));
        for (seed, (row, encoding)) in seeds.chunks_exact(field.value_cols()).zip(rows) {
            let g = &seed[1..4];
            row[..3].copy_from_slice(g);
            let waves = row[3..].chunks_exact_mut(6).zip(encoding[3..].chunks_exact(6));
            for (f, (row, wave)) in config.frequencies().zip(waves) {
                for d in 0..3 {
                    row[d] = f * wave[3 + d] * g[d];
                    row[3 + d] = -f * wave[d] * g[d];
                }
            }
        }
        let [through, joined, mut d, mut next] = scratch.wide.each_mut();
        for l in 0..config.depth {
            let Hidden { slope, adjoint, .. } = &mut self.hidden[l];
            let (slope, adjoint) = (&slope[..n * c], &mut adjoint[..n * c]);
            let from = field.layer(l).0.rows();
            let through = room(through, n * c);
            multiply(through, slope, adjoint);
            let d_input = if l == 0 {
                mat(at_encoding, n, e)
            } else if Some(l) == config.skip {
                let joined = room(joined, n * from);
                join(joined, d, c, at_encoding, e);
                mat(joined, n, from)
            } else {
                mat(d, n, c)
            };
            gemm_serial(&mut total[places(field, l).0], c, Base::Zero, d_input.t(), mat(through, n, c));
            let d_through = room(next, n * c);
            for rows in strips(n) {
                let d_through = of_rows_mut(d_through, &rows, c);
                let d_input = d_input.part(rows.start, rows.len(), 0, from);
                gemm_panels_serial(d_through, c, Base::Zero, d_input, &weights.straight[l]);
                back_through_slope(d_through, of_rows_mut(adjoint, &rows, c), of_rows(slope, &rows, c), beta);
            }
            std::mem::swap(&mut d, &mut next);
        }
        let (last, _) = field.layer(config.depth);
        let outputs = last.cols();
        let (dw, db) = places(field, config.depth);
        let sums = room(through, c);
        sums.fill(0.0);
        add_row_sums(sums, &d[..n * c]);
        total[dw.clone()].fill(0.0);
        total[dw.clone()].iter_mut().step_by(outputs).zip(sums).for_each(|(w, s)| *w += *s);

        // Back through the layers, from the outputs down.
        let at_outputs = room(&mut scratch.outputs, n * outputs);
        for (row, seed) in at_outputs.chunks_exact_mut(outputs).zip(seeds.chunks_exact(field.value_cols())) {
            row[0] = seed[0];
            row[1..].copy_from_slice(&seed[4..]);
        }
        total[db.clone()].fill(0.0);
        add_row_sums(&mut total[db], at_outputs);
        let at_outputs = mat(at_outputs, n, outputs);
        gemm_serial(
            &mut total[dw],
            outputs,
            Base::Out,
            mat(&self.hidden[config.depth - 1].out, n, c).t(),
            at_outputs,
        );
        gemm_serial(room(d, n * c), c, Base::Zero, at_outputs, last.as_mat().t());
        for l in (0..config.depth).rev() {
            let Hidden { slope, adjoint, .. } = &self.hidden[l];
            let from = field.layer(l).0.rows();
            let (dw, db) = places(field, l);
            total[db.clone()].fill(0.0);
            back_through_activation(&mut d[..n * c], slope, adjoint, &mut total[db]);
            let input = match l {
                0 => &self.encoding,
                _ if Some(l) == config.skip => &self.joined,
                _ => &self.hidden[l - 1].out,
            };
            let dz = mat(d, n, c);
            gemm_serial(&mut total[dw], c, Base::Out, mat(input, n, from).t(), dz);
            if l == 0 {
                break;
            }
            if Some(l) == config.skip {
                let joined = room(joined, n * from);
                gemm_panels_serial(joined, from, Base::Zero, dz, &weights.transposed[l]);
                copy_columns(room(next, n * c), c, joined, from, 0, FRAC_1_SQRT_2);
            } else {
                gemm_panels_serial(room(next, n * c), c, Base::Zero, dz, &weights.transposed[l]);
            }
            std::mem::swap(&mut d, &mut next);
        }
    }
}
