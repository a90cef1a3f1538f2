//! Images (`STRUCTURED_POINTS`): a box of places at equal distances, which the file does not list.

use super::super::precision::check_point;
use super::super::{Loaded, Want};
use super::rest::wrong;
use crate::Error;

/// The places of an image, which it does not list.
pub(super) struct Image {
    /// How many places lie along each axis, if the file has told.
    pub size: Option<[f64; 3]>,
    /// The first place.
    pub origin: [f64; 3],
    /// How far places are apart along each axis.
    pub spacing: [f64; 3],
}

impl Default for Image {
    fn default() -> Self {
        Image { size: None, origin: [0.0; 3], spacing: [1.0; 3] }
    }
}

impl Image {
    /// All places as points, x fastest. The data of the image take `bytes` bytes.
    pub fn places(&self, size: [f64; 3], bytes: usize, want: Want) -> Result<Loaded, Error> {
        let total: f64 = size.iter().product();
        // Each place has a number at least, so a false size reserves nothing.
        if size.iter().any(|n| *n < 1.0 || n.fract() != 0.0) || total > bytes as f64 {
            return Err(wrong(format!(
                "an image of {} x {} x {} places does not fit the {bytes} bytes of its data",
                size[0], size[1], size[2]
            )));
        }
        let [nx, ny, nz] = size.map(|n| n as u64);
        let mut loaded = Loaded::default();
        loaded.warnings.push(format!(
            "the file is an image of {nx} x {ny} x {nz} places, not a list of points; its places were read as points"
        ));
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let at = [x, y, z];
                    let point = [0, 1, 2].map(|a| self.origin[a] + at[a] as f64 * self.spacing[a]);
                    check_point(point, want, "point", loaded.verts.len())?;
                    loaded.verts.push(point);
                }
            }
        }
        Ok(loaded)
    }
}
