//! Bijective surface parameterization: the points Q are mapped to codes on the unit sphere (Phi), each code gets a
//! patch of neighbouring codes, and the patches are mapped back to space (Psi) as a denser surface S. In a run, Q is
//! the denoised points; here it is any n points.

mod atlas;
mod canonical;
mod chart;
mod config;
mod coverage;
mod inverse;
mod layout;
mod maps;
mod neighbourhood;
mod patch;
mod sheets;
mod surface_map;
mod upsample;

pub use atlas::Atlas;
pub use canonical::Canonical;
pub use config::BspConfig;
pub use coverage::{CodeCoverage, Coverage, ParameterizedSurface, SphereCodes, code_colour};
pub use inverse::Inverse;
pub use maps::{Bsp, BspOutput};
pub use neighbourhood::Neighbourhood;
pub use patch::PatchSampler;
pub use surface_map::{Parameterization, SurfaceMap};
pub use upsample::Upsample;
