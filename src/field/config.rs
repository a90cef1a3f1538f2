//! The shape of the network.

/// The nonlinearity of the hidden layers.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum FieldActivation {
    /// max(z, 0), as in the authors' code.
    Relu,
    /// ln(1 + e^(beta z)) / beta: smooth, so that grad g is continuous.
    Softplus {
        /// Sharpness; the corner is about 1 / beta wide.
        beta: f32,
    },
}

/// The shape of the network; start from the default.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct FieldConfig {
    /// Width c of every hidden layer. Default 64, paper 256.
    pub width: usize,
    /// Hidden layers. Default 4, paper 8.
    pub depth: usize,
    /// Fourier octaves: sin and cos of `frequency` 2^o x for o below this. Default 3.
    pub octaves: usize,
    /// Angular frequency of the first octave, in radians per unit of the working frame. Default 2, paper 1.
    pub frequency: f32,
    /// Nonlinearity of the hidden layers. Default `softplus:100`, paper `relu`.
    pub activation: FieldActivation,
    /// Hidden layer (counted from 0) that gets the encoding again in addition to its input. `None` (`none`) is a plain
    /// stack of layers. Default `none`.
    pub skip: Option<usize>,
    /// Radius of the sphere that the field starts as, in units of the working frame. Default 0.35.
    pub radius: f32,
}

impl Default for FieldConfig {
    /// The network of the preset `default`.
    fn default() -> Self {
        FieldConfig {
            width: 64,
            depth: 4,
            octaves: 3,
            frequency: 2.0,
            activation: FieldActivation::Softplus { beta: 100.0 },
            skip: None,
            radius: 0.35,
        }
    }
}

impl FieldConfig {
    /// Columns of the encoding: x itself, and a sine and a cosine of each coordinate for each octave.
    pub fn encoding_cols(&self) -> usize {
        3 + 6 * self.octaves
    }

    /// The angular frequency of every octave.
    pub(crate) fn frequencies(&self) -> impl Iterator<Item = f32> {
        let first = self.frequency;
        (0..self.octaves).map(move |o| first * octave_factor(o))
    }
}

/// The frequency of an octave as a multiple of that of octave 0: 2^octave, infinite from octave 128 on.
pub(crate) fn octave_factor(octave: usize) -> f32 {
    2f32.powi(octave.min(128) as i32)
}

/// Fourier octaves of a field, at most: sines of still higher frequencies are noise.
pub(super) const MAX_OCTAVES: usize = 32;
