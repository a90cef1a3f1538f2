//! What a caller may know of the input points besides their positions.

use super::frame::WorkingFrame;
use crate::geometry::Position;
use crate::geometry::vec3::unit_vector;

/// What a run may be given besides input points and options.
///
/// ```
/// use bijective_sdf::geometry::AnalyticShape;
/// use bijective_sdf::reconstruct::Hints;
/// use bijective_sdf::{Config, Preset, Trainer};
///
/// // A ball seen from within, as a room is: its normals point to where the scanner stood.
/// let (points, normals) = AnalyticShape::Sphere { radius: 2.0 }.sample(150, 1);
/// let inward: Vec<[f32; 3]> = normals.iter().map(|n| n.map(|x| -x)).collect();
/// let mut hints = Hints::default();
/// hints.normals = Some(&inward);
/// let room = Trainer::with_hints(&points, &Config::preset(Preset::Start), &hints)?.finish();
/// assert!(room.sdf(&[[0.0f32; 3]])[0] > 0.0 && room.is_turned());
/// # Ok::<(), bijective_sdf::Error>(())
/// ```
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
pub struct Hints<'a> {
    /// Normals at the input points, n x 3, outward, of any length; one that is zero or not finite is ignored. They
    /// decide inside and outside for the first shape and need not be exact: those of a surface seen from one side only,
    /// or of one seen from within, are enough. Without a first shape (`start.shape` is `sphere`) they cannot be used.
    pub normals: Option<&'a [[f32; 3]]>,
    /// What the axes x, y and z are multiplied by for the work, where points lie closer along one direction than along
    /// others, as on slices: `[1.0, 1.0, 0.2]` for slices across z that are far apart. The result is in the frame of
    /// the input nevertheless; its distances are then exact to first order only.
    pub anisotropy: Option<[f64; 3]>,
}

impl Hints<'_> {
    /// The normals of the input points that are `kept` (their indices), in the working frame, of unit length or zero.
    pub(super) fn unit_normals(&self, kept: &[u32], frame: &WorkingFrame) -> Option<Vec<[f32; 3]>> {
        let normals = self.normals?;
        let unit = |i: &u32| {
            let wide = frame.normal(normals[*i as usize].wide());
            unit_vector(wide).map_or([0.0; 3], |unit| unit.map(|x| x as f32))
        };
        Some(kept.iter().map(unit).collect())
    }
}
