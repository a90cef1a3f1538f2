//! Layers with parameters.
//!
//! Parameters live in one [`Params`]; a layer is a small struct of [`ParamId`]s and sizes. For every step the
//! parameters are bound to a tape, and layers look their weights up in the resulting [`Bound`]:
//!
//! ```
//! use bijective_sdf::autodiff::Tape;
//! use bijective_sdf::nn::{Activation, Mlp, Params};
//! use bijective_sdf::tensor::Tensor;
//! use bijective_sdf::Random;
//!
//! let mut params = Params::new();
//! let mut rng = Random::new(0);
//! let net = Mlp::new(&mut params.scope("net"), &[3, 16, 1], Activation::Relu, &mut rng);
//! assert_eq!(params.names().next(), Some("net.layer0.weight"));
//!
//! let mut tape = Tape::new();
//! let bound = params.bind(&mut tape, true);
//! let x = tape.constant(Tensor::zeros(&[5, 3]));
//! let y = net.forward(&mut tape, &bound, x);
//! let loss = tape.mean(y);
//! let gradients = bound.collect(&mut tape.backward(loss));
//! assert_eq!(gradients.len(), params.len());
//! ```

mod attention;
mod encoding;
pub mod init;
mod linear;
mod mlp;
mod norm;
mod params;
mod point_attention;
mod transformer;

#[cfg(test)]
pub(crate) mod testing;

pub use attention::{MultiHeadAttention, Reach};
pub use encoding::GaussianFourier;
pub use linear::Linear;
pub use mlp::{Activation, Mlp};
pub use norm::LayerNorm;
pub use params::{Bound, ParamId, Params, Scope};
pub use point_attention::PointTransformer;
pub use transformer::{DecoderBlock, DecoderSizes};
