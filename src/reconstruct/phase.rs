//! The phases that a run goes through.

use std::fmt;

/// The parts of a run, in order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Phase {
    /// The field learns its first shape by regression (`start.steps`).
    #[default]
    Start,
    /// The parameterization is trained alone, on L_para (`bsp_pretrain`).
    Pretrain,
    /// The training proper (`stages`): field, grid and parameterization together.
    Train,
}

impl Phase {
    /// All phases, in order.
    pub const ALL: [Phase; 3] = [Phase::Start, Phase::Pretrain, Phase::Train];

    /// The name: `start`, `pretrain` or `train`.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Start => "start",
            Phase::Pretrain => "pretrain",
            Phase::Train => "train",
        }
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
