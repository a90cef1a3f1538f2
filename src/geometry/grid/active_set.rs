//! The field function that a search of the grid evaluates, and the active vertices and tetrahedra that it finds.

use super::BandTopology;
use crate::error::Error;

/// Samples a field: one value per position, in the same order, negative inside.
pub type FieldFn<'a> = dyn FnMut(&[[f32; 3]]) -> Result<Vec<f32>, Error> + 'a;

/// The part of a grid near the surface: what a training step works on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ActiveSet {
    /// Grid vertex numbers of the active vertices (v), ascending.
    pub ids: Vec<u32>,
    /// Their positions, v x 3.
    pub positions: Vec<[f32; 3]>,
    /// The field there (v), raised above zero on the grid's border.
    pub values: Vec<f32>,
    /// Tetrahedra between them, t x 4, as indices `0..v`, positively oriented.
    pub tets: Vec<[u32; 4]>,
}

impl ActiveSet {
    /// The tetrahedra prepared for marching under many sign patterns.
    pub fn topology(&self) -> BandTopology {
        BandTopology::new(self.ids.len(), self.tets.clone())
    }
}
