//! What readers of all formats are asked for and hand back.

use crate::geometry::Attribute;

/// What is of interest.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Want {
    /// Points; rows that hold none may stay in (not finite), to be left out later.
    Cloud,
    /// As `Cloud`, with what else the file has of each point.
    Attributes,
    /// Points; a row that holds none is an error.
    EveryRow,
    /// Vertices and faces; every vertex must be finite.
    Mesh,
}

/// The names of a normal's components.
pub(super) const NORMAL_NAMES: [&str; 3] = ["nx", "ny", "nz"];

/// Attributes of a NumPy or VTK file that are read at most: such files may hold any number of columns.
pub(super) const MAX_ATTRIBUTES: usize = 64;

/// What a reader hands back.
#[derive(Default)]
pub(super) struct Loaded {
    /// Positions, v x 3, finite unless a cloud is wanted.
    pub verts: Vec<[f64; 3]>,
    /// Normals, v x 3 or none, finite or not.
    pub normals: Vec<[f32; 3]>,
    /// Indices, f x 3, not yet checked against v.
    pub faces: Vec<[u32; 3]>,
    /// What else the file has of each vertex, v values each.
    pub attributes: Vec<Attribute>,
    /// As [`PointCloud::viewpoints`](super::PointCloud::viewpoints).
    pub viewpoints: Vec<[f64; 3]>,
    /// Faces that the file has beside the points that are wanted.
    pub ignored_faces: u64,
    /// Rows without a point that the reader itself passed over.
    pub left_out: usize,
    /// As [`PointCloud::notices`](super::PointCloud::notices).
    pub notices: Vec<String>,
    /// As [`PointCloud::warnings`](super::PointCloud::warnings).
    pub warnings: Vec<String>,
}

impl Loaded {
    /// Warns if the file holds more than its header promises, of which only so much was read.
    pub fn warn_of_rest(&mut self, what: &str, promised: u64, found: u64) {
        if found > promised {
            let rest = found - promised;
            self.warnings.push(format!(
                "the header promises {promised} {what}, {found} are there; the last {rest} were not read"
            ));
        }
    }

    /// Says that faces are not read.
    pub fn ignore_faces(&mut self, faces: u64) {
        if faces > 0 {
            self.ignored_faces = faces;
            self.notices.push(format!("ignored {faces} faces; their vertices are the points"));
        }
    }
}
