//! The differentiable operations, one file a family; each is a method of [`Tape`](crate::autodiff::Tape).

mod activation;
mod arithmetic;
mod attention;
mod elementary;
mod local_attention;
mod matmul;
mod norm;
mod reduce;
mod rows;
mod shape;
mod softmax;

#[cfg(test)]
pub(crate) mod testing;
