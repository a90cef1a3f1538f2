//! Readers and writers of point clouds and triangle meshes.
//!
//! The format is chosen by the file name's extension, else by the content, or named outright. Every reader checks what
//! a file promises against the bytes at hand before it reserves memory, and refuses coordinates that are not finite,
//! so what comes out can be used as it is. Errors carry the file, the line of a text and the element (`point 17`,
//! `face 3`, counted from 0).
//!
//! | Format | read cloud | read mesh | write cloud | write mesh |
//! |---|---|---|---|---|
//! | PLY (text, binary) | yes | yes | yes | yes |
//! | XYZ, TXT, PTS, ASC | yes | | yes | |
//! | CSV | yes | | yes | |
//! | OBJ | yes | yes | | yes |
//! | STL (text, binary) | yes | yes | | yes |
//! | NPY | yes | | | |
//! | KITTI `.bin` | yes | | | |
//!
//! Adding a format takes one file with `read` and `write`, a variant of [`Format`] and a line in each of the
//! matches below.

use std::fs;
use std::path::Path;

use crate::geometry::TriangleMesh;
use crate::{Error, ErrorKind};

mod atomic;
mod format;
mod kitti;
mod npy;
mod obj;
mod ply;
mod ply_header;
mod stl;
mod text;
mod write;
mod xyz;

pub use atomic::write_atomic;
pub use format::Format;
pub use write::{
    Encoding, write_cloud, write_cloud_as, write_cloud_to, write_mesh, write_mesh_as, write_mesh_to,
};

use text::float;

/// The points of a file and what the reader left out.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct PointCloud {
    /// Positions, n x 3, all finite, in the order and units of the file.
    pub points: Vec<[f32; 3]>,
    /// One sentence for each thing worth telling the user, such as `ignored 2 extra columns`.
    pub notices: Vec<String>,
}

/// Reads the points of a file, n x 3; of a mesh file, its vertices.
///
/// # Errors
///
/// [`ErrorKind::Io`] if the file cannot be read, [`ErrorKind::Format`] if the format is unknown or the bytes do not
/// follow it, [`ErrorKind::Data`] for a file without points or with a coordinate that is not finite.
pub fn read_cloud(path: impl AsRef<Path>) -> Result<PointCloud, Error> {
    read_cloud_path(path.as_ref(), None)
}

/// Reads the points of a file whose name does not tell its format.
///
/// # Errors
///
/// As [`read_cloud`].
pub fn read_cloud_as(path: impl AsRef<Path>, format: Format) -> Result<PointCloud, Error> {
    read_cloud_path(path.as_ref(), Some(format))
}

/// Reads points, n x 3, from the bytes of a file, for example from a pipe; without a format the content decides.
///
/// # Errors
///
/// As [`read_cloud`], without a file name and without [`ErrorKind::Io`].
pub fn read_cloud_bytes(bytes: &[u8], format: Option<Format>) -> Result<PointCloud, Error> {
    let loaded = load(bytes, choose(bytes, format)?, Want::Cloud)?;
    if loaded.verts.is_empty() {
        return Err(
            Error::new(ErrorKind::Data, "there are no points").advise("give a file with at least 4 points")
        );
    }
    let mut notices = loaded.notices;
    notices.extend(coarse_floats(&loaded.verts));
    Ok(PointCloud { points: loaded.verts, notices })
}

/// Reads a triangle mesh from a PLY, OBJ or STL file; polygons become fans of triangles.
///
/// Every face index is below the number of vertices. Vertices and faces keep the order of the file; STL, which repeats
/// each vertex, gets equal positions merged.
///
/// # Errors
///
/// [`ErrorKind::Io`] if the file cannot be read, [`ErrorKind::Format`] if the format is unknown or holds no faces or
/// the bytes do not follow it, [`ErrorKind::Data`] for a file without vertices or faces or with a coordinate that is
/// not finite.
pub fn read_mesh(path: impl AsRef<Path>) -> Result<TriangleMesh, Error> {
    read_mesh_path(path.as_ref(), None)
}

/// Reads a triangle mesh from a file whose name does not tell its format.
///
/// # Errors
///
/// As [`read_mesh`].
pub fn read_mesh_as(path: impl AsRef<Path>, format: Format) -> Result<TriangleMesh, Error> {
    read_mesh_path(path.as_ref(), Some(format))
}

/// Reads a triangle mesh from the bytes of a file; without a format the content decides.
///
/// # Errors
///
/// As [`read_mesh`], without a file name and without [`ErrorKind::Io`].
pub fn read_mesh_bytes(bytes: &[u8], format: Option<Format>) -> Result<TriangleMesh, Error> {
    let loaded = load(bytes, choose(bytes, format)?, Want::Mesh)?;
    if loaded.verts.is_empty() || loaded.faces.is_empty() {
        let what = if loaded.verts.is_empty() { "vertices" } else { "faces" };
        return Err(Error::new(ErrorKind::Data, format!("there are no {what}")).advise(
            "give a triangle mesh; if the file is a point cloud, reconstruct its surface first",
        ));
    }
    let v = loaded.verts.len();
    if let Some(i) = loaded.faces.iter().position(|f| f.iter().any(|&c| c as usize >= v)) {
        let [a, b, c] = loaded.faces[i];
        return Err(Error::new(
            ErrorKind::Format,
            format!("vertices {a}, {b}, {c} are named, but the file has {v} vertices (counted from 0)"),
        )
        .at_element(format!("triangle {i}"))
        .advise("the file is truncated or its indices are wrong; export it again"));
    }
    Ok(TriangleMesh { verts: loaded.verts, faces: loaded.faces })
}

/// Whether faces are of interest.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Want {
    Cloud,
    Mesh,
}

/// What a reader hands back: v x 3 finite positions, f x 3 indices (not yet checked against v), and notices.
#[derive(Default)]
struct Loaded {
    verts: Vec<[f32; 3]>,
    faces: Vec<[u32; 3]>,
    notices: Vec<String>,
}

fn read_cloud_path(path: &Path, format: Option<Format>) -> Result<PointCloud, Error> {
    let bytes = read_file(path)?;
    read_cloud_bytes(&bytes, format.or_else(|| Format::from_path(path))).map_err(|e| e.in_file(path))
}

fn read_mesh_path(path: &Path, format: Option<Format>) -> Result<TriangleMesh, Error> {
    let bytes = read_file(path)?;
    read_mesh_bytes(&bytes, format.or_else(|| Format::from_path(path))).map_err(|e| e.in_file(path))
}

fn read_file(path: &Path) -> Result<Vec<u8>, Error> {
    fs::read(path).map_err(|e| Error::new(ErrorKind::Io, "cannot read the file").in_file(path).caused_by(e))
}

fn choose(bytes: &[u8], format: Option<Format>) -> Result<Format, Error> {
    format.or_else(|| Format::from_content(bytes)).ok_or_else(|| {
        let what = if bytes.is_empty() { "the file is empty" } else { "the file format is unknown" };
        Error::new(ErrorKind::Format, what).advise(format!("supported are {}", Format::list()))
    })
}

fn load(bytes: &[u8], format: Format, want: Want) -> Result<Loaded, Error> {
    let holds_faces = matches!(format, Format::Ply | Format::Obj | Format::Stl);
    if want == Want::Mesh && !holds_faces {
        return Err(Error::new(ErrorKind::Format, format!("{format} files hold points without faces"))
            .advise("give a mesh as ply, obj or stl"));
    }
    if bytes.is_empty() {
        return Err(Error::new(ErrorKind::Format, "the file is empty").advise("check how it was written"));
    }
    match format {
        Format::Ply => ply::read(bytes, want),
        Format::Xyz | Format::Csv => xyz::read(bytes),
        Format::Obj => obj::read(bytes, want),
        Format::Stl => stl::read(bytes),
        Format::Npy => npy::read(bytes),
        Format::Kitti => kitti::read(bytes),
    }
}

/// Refuses NaN, infinities and what overflowed `f32`, before anything downstream can hide them.
fn check_point(point: [f32; 3], noun: &str, index: usize) -> Result<(), Error> {
    match point.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(axis) => Err(Error::new(
            ErrorKind::Data,
            format!("{} is {}, not a finite 32-bit number", ["x", "y", "z"][axis], point[axis]),
        )
        .at_element(format!("{noun} {index}"))
        .advise("remove or repair it (elements are counted from 0)")),
    }
}

/// Cuts a polygon into triangles that share its first corner.
fn push_fan(faces: &mut Vec<[u32; 3]>, polygon: &[i64]) -> Result<(), Error> {
    if polygon.len() < 3 {
        return Err(Error::new(
            ErrorKind::Format,
            format!("at least 3 corners expected, {} found", polygon.len()),
        )
        .advise("remove the face or export the file again"));
    }
    let index = |i: i64| {
        u32::try_from(i).map_err(|_| {
            Error::new(ErrorKind::Format, format!("vertex {i} is named, which is not a possible index"))
                .advise("the file is damaged; export it again")
        })
    };
    let first = index(polygon[0])?;
    let mut previous = index(polygon[1])?;
    for &corner in &polygon[2..] {
        let next = index(corner)?;
        faces.push([first, previous, next]);
        previous = next;
    }
    Ok(())
}

/// A notice where the coordinates are so large against the cloud's size that 32-bit floats lose its detail, as with
/// map coordinates.
fn coarse_floats(points: &[[f32; 3]]) -> Option<String> {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for p in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(p[axis]);
            high[axis] = high[axis].max(p[axis]);
        }
    }
    let widest = (0..3).map(|a| f64::from(high[a]) - f64::from(low[a])).fold(0.0, f64::max);
    let largest = (0..3).map(|a| f64::from(high[a].max(-low[a]))).fold(0.0, f64::max);
    let step = largest * f64::from(f32::EPSILON);
    (widest > 0.0 && step > 1e-4 * widest).then(|| {
        format!(
            "coordinates near {largest:.3e} are kept to steps of {step:.1e} only, and the cloud measures \
             {widest:.3e}; subtract a common offset from the file to keep its detail"
        )
    })
}
