//! The sizes of a mesh and of its faces.

use super::TriangleMesh;
use crate::geometry::vec3::{dot, length, sub, triangle_normal};
use crate::geometry::{Bounds, Position, are_f32, relative_to};

/// What the volumes and areas of a mesh are computed from.
pub(super) struct Measure {
    /// The vertices in 32 bits, v x 3: as they are where 32 bits hold them exactly, else less `offset`.
    verts: Vec<[f32; 3]>,
    /// What was subtracted from all of them, see [`TriangleMesh::offset`].
    offset: [f64; 3],
    /// The least and greatest coordinates of `verts`, NaN on an axis where one is NaN; zero if there are none.
    box_corners: [[f32; 3]; 2],
    /// The middle of `box_corners`. Volumes are measured from here, so that a mesh far from the origin loses no digits.
    centre: [f64; 3],
}

impl Measure {
    pub fn of<P: Position>(mesh: &TriangleMesh<P>) -> Self {
        let offset = if are_f32(&mesh.verts) { [0.0; 3] } else { mesh.offset() };
        let verts = relative_to(&mesh.verts, offset);
        let box_corners = box_corners(&verts);
        let [lo, hi] = box_corners;
        let centre = std::array::from_fn(|a| 0.5 * (f64::from(lo[a]) + f64::from(hi[a])));
        Measure { verts, offset, box_corners, centre }
    }

    /// The signed volume of the tetrahedron between a face and the centre, and the area of the face.
    pub fn volume_and_area(&self, face: [u32; 3]) -> (f64, f64) {
        let corners = face.map(|v| self.verts[v as usize].map(f64::from));
        let normal = triangle_normal(corners);
        (dot(sub(corners[0], self.centre), normal) / 6.0, 0.5 * length(normal))
    }

    /// The least and greatest coordinates of the `mesh` it was made of, see [`Topology`](super::Topology).
    pub fn bounds<P: Position>(&self, mesh: &TriangleMesh<P>) -> Option<[[f64; 3]; 2]> {
        if self.offset != [0.0; 3] {
            // There is an offset only where every coordinate is finite.
            return Bounds::of(&mesh.verts).ok().map(|b| [b.min, b.max]);
        }
        (!self.verts.is_empty()).then(|| self.box_corners.map(|corner| corner.map(f64::from)))
    }
}

/// The least and greatest coordinates of positions, v x 3, NaN on an axis where one is NaN; zero if there are none.
fn box_corners(verts: &[[f32; 3]]) -> [[f32; 3]; 2] {
    let pick = |old: f32, new: f32, better: bool| {
        if old.is_nan() || new.is_nan() {
            f32::NAN
        } else if better {
            new
        } else {
            old
        }
    };
    let first = verts.first().copied().unwrap_or_default();
    verts.iter().fold([first; 2], |[lo, hi], p| {
        [
            std::array::from_fn(|a| pick(lo[a], p[a], p[a] < lo[a])),
            std::array::from_fn(|a| pick(hi[a], p[a], p[a] > hi[a])),
        ]
    })
}
