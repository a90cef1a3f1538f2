//! Psi: from patches of codes back to points in space.

use super::{BspConfig, Neighbourhood, chart};
use crate::autodiff::{Tape, Var};
use crate::geometry::nearest_distances;
use crate::nn::{Activation, Bound, DecoderBlock, DecoderSizes, GaussianFourier, Mlp, Reach, Scope};
use crate::random::Random;

/// How far an output of 1 moves a point of S from its chart, in mean nearest distances of Q: the mean over the points
/// of Q of the distance to the nearest other one.
const CHART_OFFSET: f32 = 0.1;

/// s = Psi(varphi(features), p) for a code p of a patch: a decoder block whose queries are embedded codes and whose
/// memory is what the perceptron varphi makes of the features of the points within reach (all of them in the paper,
/// equation 2), then a perceptron to space.
///
/// With `average_positions`, s is the average of the attended points' positions under the attention's own weights,
/// plus the perceptron's output times the mean nearest distance of Q: the surface starts among the points
/// instead of anywhere. With charts, s is the place of p in the chart of its patch's centre, plus a tenth of that
/// offset.
///
/// Shapes: features p x c, points p x 3, patches (b M) x 3 to (b M) x 3. Parameters: `query` and `memory` (to c
/// and c channels), `block` (the decoder block), `out` (c to c to c to 3). The frequencies of the code embedding are
/// fixed.
#[derive(Clone, Debug)]
pub struct Inverse {
    embedding: GaussianFourier,
    query: Mlp,
    memory: Mlp,
    block: DecoderBlock,
    out: Mlp,
    patch: usize,
    average_positions: bool,
    /// The mean distance from a point of Q to its nearest other one, working frame.
    mean_nearest: f32,
}

impl Inverse {
    /// A map for Q, `points` (n x 3, working frame), which give the scale of the offsets.
    ///
    /// # Panics
    /// If the channels are odd or not a multiple of the heads.
    #[track_caller]
    pub fn new(scope: &mut Scope<'_>, config: &BspConfig, points: &[[f32; 3]], rng: &mut Random) -> Self {
        let c = config.channels;
        let sizes =
            DecoderSizes { channels: c, memory: c, heads: config.heads, hidden: c, self_attention: false };
        Inverse {
            embedding: GaussianFourier::new(3, c, 1.0, rng),
            query: Mlp::new(&mut scope.scope("query"), &[c, c, c], Activation::Relu, rng),
            memory: Mlp::new(&mut scope.scope("memory"), &[c, c, c], Activation::Relu, rng),
            block: DecoderBlock::new(&mut scope.scope("block"), sizes, rng),
            out: Mlp::new(&mut scope.scope("out"), &[c, c, c, 3], Activation::Relu, rng),
            patch: config.patch,
            average_positions: config.average_positions,
            mean_nearest: mean_nearest(points),
        }
    }

    /// The part of S (b M x 3) of b centres with their patches (b M x 3), from the features (p x c) and
    /// positions (p x 3) of a context; `block` has the rows of the context that each centre's patch attends to, and
    /// the charts, if there are any.
    ///
    /// # Panics
    /// If the shapes do not fit.
    #[track_caller]
    pub fn forward(
        &self,
        tape: &mut Tape,
        p: &Bound,
        features: Var,
        points: Var,
        patches: Var,
        block: &Neighbourhood,
    ) -> Var {
        let reach = match block.reach() {
            None => Reach::All,
            Some(nearest) => {
                let centres = tape.value(patches).rows() / self.patch;
                let k = nearest.len() / centres;
                // Every code of a patch attends to what its centre does.
                let rows = nearest.chunks_exact(k).flat_map(|row| std::iter::repeat_n(row, self.patch));
                Reach::Nearest { index: rows.flatten().copied().collect(), k }
            }
        };
        let embedded = self.embedding.forward(tape, patches);
        let queries = self.query.forward(tape, p, embedded);
        let memory = self.memory.forward(tape, p, features);
        if let Some(charts) = block.charts() {
            let x = self.block.forward(tape, p, queries, &Reach::All, memory, &reach);
            let offset = self.out.forward(tape, p, x);
            let offset = tape.scale(offset, CHART_OFFSET * self.mean_nearest);
            let place = chart::place(tape, patches, charts, self.patch);
            tape.add(place, offset)
        } else if self.average_positions {
            let (x, weights) = self.block.forward_weighted(tape, p, queries, &Reach::All, memory, &reach);
            let offset = self.out.forward(tape, p, x);
            let average = self.block.cross().average(tape, weights, points, &reach);
            let offset = tape.scale(offset, self.mean_nearest);
            tape.add(average, offset)
        } else {
            let x = self.block.forward(tape, p, queries, &Reach::All, memory, &reach);
            self.out.forward(tape, p, x)
        }
    }
}

/// The mean distance from a point to its nearest other point; 0 for a single one.
fn mean_nearest(points: &[[f32; 3]]) -> f32 {
    if points.len() < 2 {
        return 0.0;
    }
    (nearest_distances(points).iter().sum::<f64>() / points.len() as f64) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::Params;
    use crate::tensor::Tensor;

    #[test]
    fn averaged_positions_start_near_the_points_they_attend_to() {
        let points: Vec<[f32; 3]> = crate::geometry::fibonacci_sphere(60);
        let config = super::super::config::tests::small(Some(4), true);
        let mut params = Params::new();
        let mut rng = Random::new(3);
        let psi = Inverse::new(&mut params.scope("psi"), &config, &points, &mut rng);
        let mut tape = Tape::new();
        let p = params.bind(&mut tape, false);
        let features = tape.constant(crate::ops::testing::normal(&[60, 8], 1));
        let q = tape.constant(Tensor::from_points(&points));
        let codes: Vec<[f32; 3]> = points.iter().flat_map(|&u| [u; 3]).collect();
        let codes = tape.constant(Tensor::from_points(&codes));
        let block = Neighbourhood::whole(&points, None, &BspConfig { normal_weight: 0.0, ..config });
        let s = psi.forward(&mut tape, &p, features, q, codes, &block);
        for (i, s) in tape.value(s).to_points().iter().enumerate() {
            let centre = points[i / 3];
            let distance = (0..3).map(|d| (s[d] - centre[d]).powi(2)).sum::<f32>().sqrt();
            assert!(distance < 4.0 * psi.mean_nearest, "{distance}");
        }
    }
}
