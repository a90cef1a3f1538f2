//! Loops at the width of the processor's registers: plain loops compiled once per instruction set ([`kernel!`]),
//! elementary functions as polynomials, and the inner loops of the matrix product.
//!
//! This is the only place with unsafe code. Loops of [`kernel!`] neither fuse nor reorder float operations, so which
//! instruction set runs changes their speed and never a result. Every value of a matrix product is one chain of
//! multiply-adds in the order of the inner index, fused wherever the instruction set can: AVX2, AVX-512 and NEON agree
//! bit for bit, the portable loop rounds twice where they round once.

mod instruction_set;
mod kernel;
mod math;
pub(crate) mod product;
#[cfg(test)]
pub(crate) mod testing;

pub(crate) use instruction_set::{InstructionSet, instruction_set};
pub(crate) use kernel::kernel;
pub(crate) use math::{
    exp, exp_slice, sigmoid_slice, sin_cos_slice, softplus_sigmoid, softplus_sigmoid_slice, tanh_slice,
};
