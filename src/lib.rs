//! Signed distance fields and closed triangle meshes from sparse, unoriented point clouds, on the CPU, in pure Rust.
//!
//! A few hundred points on a surface, without normals, become a continuous signed distance field and a watertight
//! mesh. The method is bijective surface parameterization with grid deformation optimization (CVPR 2025): a map to the
//! unit sphere and back makes a denser surface S of the points, and a small network g learns the field by moving the
//! vertices of a tetrahedral grid onto S. Everything is trained for the one cloud given; there is no training data.
//! Training starts from a first shape that the points determine (module [`start`]), except with the preset `paper`;
//! clouds of more than 1,000 points keep that shape and are not trained unless the options ask for it
//! ([`Config::train_up_to`]).
//!
//! ```
//! use bijective_sdf::geometry::AnalyticShape;
//! use bijective_sdf::reconstruct::Stage;
//! use bijective_sdf::{Config, Preset, reconstruct};
//!
//! // 150 points on a sphere of radius 2; `io::read_cloud` reads them from a file.
//! let (points, _) = AnalyticShape::Sphere { radius: 2.0 }.sample(150, 1);
//! let mut config = Config::preset(Preset::Fast);
//! // 40 steps on a grid of 16 cubes, after 100 steps on the first shape: much less than usual.
//! config.stages = vec![Stage { resolution: 16, steps: 40 }];
//! config.start.steps = 100;
//!
//! // `reconstruct_with` reports its progress and can be stopped.
//! let result = reconstruct(&points, &config)?;
//!
//! let sdf = result.sdf(&[[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]);
//! assert!(sdf[0] < 0.0 && sdf[1] > 0.0);
//! let mesh = result.mesh(32)?;
//! let topology = mesh.topology();
//! assert!(topology.closed && topology.genus == Some(0));
//! # Ok::<(), bijective_sdf::Error>(())
//! ```
//!
//! # Conventions
//!
//! - **Frame.** Points go in, of 32 or 64 bits ([`geometry::Position`]), and meshes and distances come out in the
//!   input's frame and unit, however large the coordinates are. All work in between happens, in 32 bits, in the
//!   *working frame*, where the bounding box of the input points is centred at the origin and its longest side is 1
//!   ([`geometry::Normalizer`]). Lengths in [`Config`] are in the working frame.
//! - **Points.** The *input points* are those that the caller passes, made distinct and sorted, in the input's frame
//!   (the program leaves strays out before). The *working points* are the input points in the working frame, made even
//!   if they lie on scan lines, and thinned to some 4,000 if there are more and they are to be trained. The *denoised
//!   points* are the working points without the noise that was found, or the same if none was; they are the paper's Q,
//!   for which S and the field are trained. A *cloud* is what a file holds.
//! - **Sign.** The field is negative inside.
//! - **Winding.** Faces run counter-clockwise seen from outside, so a closed mesh has a positive volume.
//! - **Dimensions.** Shapes in the documentation use one alphabet: n points, m codes or places to evaluate at, k
//!   neighbours, c channels, h heads, v vertices, e edges, t tetrahedra, f faces; M codes in a patch, i points of S; b
//!   centres of a block of points and p points of its context, the centres and points around them; q points that a step
//!   sees. Tensors are row-major.
//! - **Randomness.** The seed is part of the options. The same input, seed and options give the same bytes for any
//!   number of threads on one machine.
//! - **Errors.** Wrong data gives an [`Error`] with where and what to do; wrong shapes are bugs and panic, naming both.
//!
//! # Building and matching public types
//!
//! Types that will grow are `#[non_exhaustive]`: options, reports of what was found, and enumerations of kinds such as
//! presets, formats and parameterizations. Take such options from a preset or the default and assign fields; match such
//! enumerations with a last arm `_`. Data that is complete as it is, such as a stage, a schedule, a mesh or a cloud,
//! is open: write the struct out.
//!
//! ```
//! use bijective_sdf::reconstruct::Stage;
//! use bijective_sdf::{Config, Preset};
//!
//! let mut config = Config::preset(Preset::Fine);
//! config.field.width = 64;
//! config.clip = Some(1.0);
//! config.stages = vec![Stage { resolution: 40, steps: 200 }];
//! assert!(config.validate().is_ok());
//! ```
//!
//! # Modules
//!
//! Most programs need [`mod@reconstruct`], [`io`] and [`geometry`]; the rest are the parts that the training is made
//! of, for losses and layers of one's own. A module uses those below it; `io` and `evaluate` use `geometry` only.
//!
//! - [`mod@reconstruct`]: options and presets, the training, its checkpoints, and the result.
//! - [`scene`]: how well the points support each part of a surface; cuts away what they do not support.
//! - [`start`]: strays among the points, and what kind of sampling they are.
//! - [`bsp`]: from the points to codes on the sphere (Phi), patches around them, and back to space (Psi).
//! - [`gdo`]: the move of grid vertices along the field, and the differentiable surface.
//! - [`field`]: the field g and its spatial gradient.
//! - [`loss`]: Chamfer distances and the other terms.
//! - [`nn`], [`optim`]: layers with parameters; Adam and schedules.
//! - [`ops`], [`autodiff`], [`tensor`]: operations with their gradients, the tape, and dense `f32` arrays.
//! - [`geometry`]: clouds, neighbours, the tetrahedral grid, marching, meshes and what they are like.
//! - [`io`]: readers and writers. [`evaluate`]: metrics against a ground truth.
//!
//! To change something here, read `src/README.md`: the map, the rules, and where a new operation, loss term, format or
//! option goes.
#![cfg_attr(docsrs, feature(doc_cfg))]
// The library prints nothing and leaves nothing to do.
#![deny(clippy::print_stdout, clippy::print_stderr, clippy::dbg_macro, clippy::todo, clippy::unimplemented)]

pub mod autodiff;
pub mod bsp;
mod error;
pub mod evaluate;
pub mod field;
mod finish;
pub mod gdo;
pub mod geometry;
pub mod io;
mod linalg;
pub mod loss;
pub mod nn;
pub mod ops;
pub mod optim;
mod random;
pub mod reconstruct;
pub mod scene;
mod simd;
pub mod start;
pub mod tensor;

pub use error::{Error, ErrorKind};
pub use random::Random;
pub use reconstruct::{
    Config, Event, Outcome, Preset, Reconstruction, Trainer, reconstruct, reconstruct_with,
};
