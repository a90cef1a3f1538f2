//! The source of everything random.

use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;

/// A seeded generator of random numbers: the same seed gives the same numbers on every machine (ChaCha with 8 rounds,
/// Bernstein 2008).
#[derive(Debug)]
pub struct Random(ChaCha8Rng);

impl Random {
    /// The generator of a seed.
    pub fn new(seed: u64) -> Self {
        Random(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Goes over to another sequence of the same seed; they start with sequence 0.
    pub(crate) fn set_stream(&mut self, stream: u64) {
        self.0.set_stream(stream);
    }

    /// The generator itself, to draw from.
    pub(crate) fn source(&mut self) -> &mut ChaCha8Rng {
        &mut self.0
    }
}
