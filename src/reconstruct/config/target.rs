//! What the extracted surface is drawn to.

/// What the extracted surface is drawn to; the denoised points Q alone if there is no parameterization.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Target {
    /// The parameterized surface S (equation 5 of the paper).
    Surface,
    /// S united with the denoised points Q, as in the authors' code.
    SurfaceAndCloud,
}
