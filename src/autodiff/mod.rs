//! Reverse-mode differentiation: operations recorded on a tape, gradients pulled back through it.

pub mod check;
mod op;
mod tape;

pub use op::{At, Op};
pub use tape::{Gradients, Tape, Var};
