//! Linear algebra and smooth minimisation in 64 bits: large symmetric positive definite systems, and L-BFGS.

mod cholesky;
mod lbfgs;

pub(crate) use cholesky::Symmetric;
pub(crate) use lbfgs::{LbfgsOptions, lbfgs};
