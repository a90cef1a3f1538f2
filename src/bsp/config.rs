//! The sizes of the parameterization.

/// The sizes of the parameterization; start from the default.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct BspConfig {
    /// Channels c of features and attention. Default 64, paper 128.
    pub channels: usize,
    /// Attention heads h; c is a multiple of it. Default 4.
    pub heads: usize,
    /// Neighbours k of a point in Phi. Default 8.
    pub neighbours: usize,
    /// Codes M in a patch. Default 10.
    pub patch: usize,
    /// Codes on the whole sphere, as a multiple of n M. With about 1 patches whose centres are spread evenly tile it;
    /// the authors' code has 50,000 codes for 300 points, a multiple of 17, whose patches are much smaller than the
    /// gaps between points. Default 1.
    pub code_density: f32,
    /// Points whose features a patch attends to: the nearest in space to its centre. `None` (`all`) is all of them, as
    /// in the paper, at a cost of n^2 M; `Some(n)` is the same but for the order of sums. Default 12.
    pub reach: Option<usize>,
    /// Whether Psi averages the positions of the points it attends to and adds a learned offset, instead of making
    /// positions from nothing. Default true, paper false.
    pub average_positions: bool,
    /// Whether codes begin in a layout that fills the sphere evenly and keeps neighbours together, with what the head
    /// of Phi learns added to it. Without, they are what the head makes of the features, as the paper says: all in one
    /// spot at first. Default false; the preset `paper` has true (`benches/paper.md`).
    pub layout: bool,
    /// Whether Psi adds what it learns to a chart of each point: the patch as a disc around the point, with the
    /// point's share of the surface, in the plane of its normal and bent as its neighbours lie. Needs `layout`, and
    /// takes the place of `average_positions`. Default false; the preset `paper` has true (`benches/paper.md`).
    pub charts: bool,
    /// Points of S nearer to Q than this share of their chart's radius add nothing to L_para, so that S can be
    /// a surface through the points without lying on them everywhere. Has no effect without `charts`. Default 0; the
    /// preset `paper` has 1 (`benches/paper.md`).
    pub slack: f32,
    /// Weight of the difference of the unit normals in the distance that neighbours are chosen by, where Q has normals
    /// (those of the field's first shape). With s the distance from p to its sixth nearest point, that distance is
    /// sqrt(|p - q|^2 + (normal_weight s)^2 |n_p - n_q|^2). It keeps S from bridging sheets that lie close together. 0
    /// is the distance in space, as in the paper. Default 1.5.
    pub normal_weight: f32,
}

impl Default for BspConfig {
    /// Those of the preset `default`.
    fn default() -> Self {
        BspConfig {
            channels: 64,
            heads: 4,
            neighbours: 8,
            patch: 10,
            code_density: 1.0,
            reach: Some(12),
            average_positions: true,
            layout: false,
            charts: false,
            slack: 0.0,
            normal_weight: 1.5,
        }
    }
}

impl BspConfig {
    /// Codes on the whole sphere for n points.
    pub fn codes(&self, n: usize) -> usize {
        let codes = (f64::from(self.code_density) * n as f64 * self.patch as f64).ceil() as usize;
        codes.clamp(self.patch, MAX_CODES.max(self.patch))
    }
}

/// The most codes that a sphere has.
const MAX_CODES: usize = 1 << 24;

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Small sizes for tests.
    pub fn small(reach: Option<usize>, average_positions: bool) -> BspConfig {
        BspConfig {
            channels: 8,
            heads: 2,
            neighbours: 4,
            patch: 3,
            code_density: 1.0,
            reach,
            average_positions,
            layout: false,
            charts: false,
            slack: 0.0,
            normal_weight: 1.5,
        }
    }
}
