//! Reverse-mode differentiation: operations recorded on a tape, gradients pulled back through it.

pub mod check;
mod gradients;
mod op;
mod tape;

pub use gradients::Gradients;
pub use op::{At, Op};
pub use tape::{Tape, Var};
