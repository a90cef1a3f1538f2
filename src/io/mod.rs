//! Readers and writers of point clouds and triangle meshes.
//!
//! The format is chosen by the content, and by the file name's extension where the content fits several formats or
//! none; or it is named outright. Every reader checks what a file promises against the bytes at hand before it reserves
//! memory. Rows of a cloud that hold no point are left out with a warning, and where it is not certain which numbers
//! are the coordinates, nothing is read; so what comes out can be used as it is. Errors carry the file, the line of a
//! text and the element (`point 17`, `face 3`, counted from 0).
//!
//! | Format | read cloud | read mesh | write cloud | write mesh |
//! |---|---|---|---|---|
//! | PLY (text, binary) | yes | yes | yes | yes |
//! | XYZ, TXT, PTS, ASC | yes | | yes | |
//! | CSV | yes | | yes | |
//! | OBJ | yes | yes | | yes |
//! | STL (text, binary) | yes | yes | | yes |
//! | OFF, COFF, NOFF, STOFF | yes | yes | | yes, as OFF |
//! | GLB | | | | yes |
//! | PCD (text, binary, packed), PTX, legacy VTK | yes | | | |
//! | NPY, NPZ | yes | | | |
//! | LAS; with the feature `formats` LAZ and E57 | yes | | | |
//! | raw floats (KITTI `.bin`) | yes | | | |
//!
//! With the feature `formats` each of them may be packed with gzip. Formats that are not read are named, with how to
//! convert them.
//!
//! A new format takes a file of its own with `read` (and `write`), a variant of [`Format`] with its arms in
//! `format.rs`, a line in `of_content` of `choose.rs` if its first bytes show it, an arm in `load` below, and, if it is
//! written, one in `write.rs`.

use std::fs;
use std::path::Path;

use crate::geometry::{Attribute, TriangleMesh, format_shortest};
use crate::{Error, ErrorKind};

mod atomic;
mod choose;
mod doubt;
mod e57;
mod encoding;
mod fillers;
mod foreign;
mod format;
mod glb;
mod grid;
mod las;
mod loaded;
mod npy;
mod npz;
mod number;
mod obj;
mod off;
mod options;
mod packed;
mod pcd;
mod ply;
mod polygon;
mod precision;
mod ptx;
mod raw;
mod stl;
mod table;
mod text;
mod vtk;
mod write;
mod zip;

pub use atomic::write_atomic;
pub use encoding::Encoding;
pub use foreign::name_file;
pub use format::Format;
pub use grid::{GridFormat, GridValues, write_grid_to};
pub use options::{Columns, RawLayout, ReadOptions};
pub use write::{
    offset_left_out, write_cloud, write_cloud_to, write_cloud_with_to, write_coloured_cloud_to, write_mesh,
    write_mesh_to, write_mesh_with_to,
};

use choose::{choose, unpacked};
use loaded::{Loaded, MAX_ATTRIBUTES, NORMAL_NAMES, Want};
use precision::{check_range, coarse_floats, round_to_floats};

/// The points of a file and what the reader left out.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct PointCloud {
    /// Positions, n x 3, all finite and within the range of 32-bit floats, in the order, units and digits of the file.
    pub points: Vec<[f64; 3]>,
    /// Normals, n x 3, all finite and of the file's lengths, if the file has them: properties or columns `nx`, `ny`,
    /// `nz` (PLY, XYZ, CSV; PCD also `normal_x` ...), an array `normals` (NPZ), `NORMALS` of the points (VTK), or one
    /// for each vertex (OFF, OBJ). A reconstruction uses them if they are given to it as
    /// [`Hints`](crate::reconstruct::Hints).
    pub normals: Option<Vec<[f32; 3]>>,
    /// The places from which the points were seen, one a scan, if the file tells (PCD, PTX, E57) or its format does
    /// (raw laser scans); in the frame of the points.
    pub viewpoints: Vec<[f64; 3]>,
    /// What else the file has of each point, if [asked for](ReadOptions::attributes): number properties of PLY, fields
    /// of PCD (a packed `rgb` as `red`, `green` and `blue`), intensity, classification and colour of LAS, intensity and
    /// colour of PTX and E57, point data of VTK, numbers in named columns of a text, other columns and arrays of NPY
    /// and NPZ, and the colours of OBJ. Of other formats there are none.
    pub attributes: Vec<Attribute>,
    /// One sentence for each thing worth telling the user, such as `ignored 2 extra columns`.
    pub notices: Vec<String>,
    /// One sentence for each reason why the points may not be those that the user expects, such as rows that were left
    /// out. A program should show these whatever else it keeps quiet about.
    pub warnings: Vec<String>,
    /// How many rows of the file were left out because they hold no point; the warnings say why.
    pub left_out: usize,
    /// How many faces the file has beside its points; they were not read.
    pub faces: u64,
}

/// Reads the points of a file, n x 3; of a mesh file, its vertices.
///
/// If name and content do not tell the format or the columns, [`read_cloud_with`] can be told them.
///
/// # Errors
///
/// [`ErrorKind::Io`] if the file cannot be read, [`ErrorKind::Format`] if the format is unknown or the bytes do not
/// follow it, [`ErrorKind::Data`] for a file without points or with a coordinate that is not finite.
pub fn read_cloud(path: impl AsRef<Path>) -> Result<PointCloud, Error> {
    let path = path.as_ref();
    read_cloud_with(&read_file(path)?, &by_name(path)).map_err(|e| name_file(e, path))
}

/// Reads points, n x 3, from the bytes of a file, for example from a pipe; without a format the content decides.
///
/// # Errors
///
/// As [`read_cloud`], without a file name and without [`ErrorKind::Io`].
pub fn read_cloud_bytes(bytes: &[u8], format: Option<Format>) -> Result<PointCloud, Error> {
    read_cloud_with(bytes, &ReadOptions { format, ..ReadOptions::default() })
}

/// Reads points, n x 3, from the bytes of a file, with all that is known about it.
///
/// Rows that hold no point (not finite, or a value that stands for none) are left out with a warning, unless
/// [`ReadOptions::every_row`] or [`ReadOptions::assume`] forbid it.
///
/// # Errors
///
/// As [`read_cloud_bytes`]; [`ErrorKind::Format`] also where it is not certain which numbers are the coordinates, with
/// what to give.
pub fn read_cloud_with(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, Error> {
    let want = match (options.every_row, options.attributes) {
        (true, _) => Want::EveryRow,
        (false, true) => Want::Attributes,
        (false, false) => Want::Cloud,
    };
    let bytes = &unpacked(bytes)?;
    let mut loaded = load(bytes, choose(bytes, options)?, options, want)?;
    let total = loaded.verts.len();
    if !options.every_row {
        fillers::drop_rows(&mut loaded, options.assume);
    }
    if loaded.verts.is_empty() {
        let what = match total {
            0 => "there are no points".to_string(),
            n => format!("none of the {n} points has three finite numbers"),
        };
        return Err(Error::new(ErrorKind::Data, what).advise("give a file with at least 4 points"));
    }
    check_range(&loaded.verts, "point")?;
    round_to_floats(&mut loaded.verts, false);
    let mut warnings = loaded.warnings;
    warnings.extend(coarse_floats(&loaded.verts));
    let points = loaded.verts;
    let mut notices = loaded.notices;
    let mut normals = Some(loaded.normals).filter(|n| !n.is_empty());
    if let Some(i) = normals.iter().flatten().position(|n| n.iter().any(|x| !x.is_finite())) {
        notices.push(format!("ignored the normals: that of point {i} is not finite"));
        normals = None;
    }
    notices.extend(seen_from(&loaded.viewpoints));
    Ok(PointCloud {
        points,
        normals,
        attributes: loaded.attributes,
        viewpoints: loaded.viewpoints,
        notices,
        warnings,
        left_out: loaded.left_out,
        faces: loaded.ignored_faces,
    })
}

/// What to say of the places that points were seen from.
fn seen_from(viewpoints: &[[f64; 3]]) -> Option<String> {
    let name = |p: &[f64; 3]| p.map(format_shortest).join(",");
    match viewpoints {
        [] => None,
        [one] => Some(format!(
            "the points were seen from {0}; --origin {0} takes that side for outside",
            name(one)
        )),
        [first, ..] if viewpoints.iter().all(|p| p == first) => seen_from(&viewpoints[..1]),
        [first, second, more @ ..] => Some(format!(
            "the scans were taken from {} places, ({}), ({}){}; --origin takes one, which fits a file of one scan",
            viewpoints.len(),
            name(first),
            name(second),
            if more.is_empty() { "" } else { ", ..." }
        )),
    }
}

/// Reads a triangle mesh from a PLY, OBJ, STL or OFF file; polygons become fans of triangles.
///
/// Every face index is below the number of vertices. Vertices and faces keep the order of the file, vertices their
/// digits; STL, which repeats each vertex, gets equal positions merged.
///
/// # Errors
///
/// [`ErrorKind::Io`] if the file cannot be read, [`ErrorKind::Format`] if the format is unknown or holds no faces or
/// the bytes do not follow it, [`ErrorKind::Data`] for a file without vertices or faces or with a coordinate that is
/// not finite.
pub fn read_mesh(path: impl AsRef<Path>) -> Result<TriangleMesh<[f64; 3]>, Error> {
    let path = path.as_ref();
    read_mesh_with(&read_file(path)?, &by_name(path)).map_err(|e| name_file(e, path))
}

/// Reads a triangle mesh from the bytes of a file; without a format the content decides.
///
/// # Errors
///
/// As [`read_mesh`], without a file name and without [`ErrorKind::Io`].
pub fn read_mesh_bytes(bytes: &[u8], format: Option<Format>) -> Result<TriangleMesh<[f64; 3]>, Error> {
    read_mesh_with(bytes, &ReadOptions { format, ..ReadOptions::default() })
}

/// Reads a triangle mesh from the bytes of a file, with all that is known about it.
///
/// # Errors
///
/// As [`read_mesh_bytes`].
pub fn read_mesh_with(bytes: &[u8], options: &ReadOptions) -> Result<TriangleMesh<[f64; 3]>, Error> {
    let bytes = &unpacked(bytes)?;
    let mut loaded = load(bytes, choose(bytes, options)?, options, Want::Mesh)?;
    if loaded.verts.is_empty() || loaded.faces.is_empty() {
        let what = if loaded.verts.is_empty() { "vertices" } else { "faces" };
        return Err(Error::new(ErrorKind::Data, format!("there are no {what}"))
            .advise("give a triangle mesh; if the file is a point cloud, reconstruct its surface first"));
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
    check_range(&loaded.verts, "vertex")?;
    round_to_floats(&mut loaded.verts, false);
    Ok(TriangleMesh { verts: loaded.verts, faces: loaded.faces })
}

/// How to read a file of which nothing is known but its name.
fn by_name(path: &Path) -> ReadOptions {
    ReadOptions { hint: Format::of_input(path), ..ReadOptions::default() }
}

fn read_file(path: &Path) -> Result<Vec<u8>, Error> {
    fs::read(path).map_err(|e| Error::cannot_read(path, e))
}

fn load(bytes: &[u8], format: Format, options: &ReadOptions, want: Want) -> Result<Loaded, Error> {
    if want == Want::Mesh && !format.holds_faces() {
        return Err(Error::new(ErrorKind::Format, format!("{format} files hold points without faces"))
            .advise("give a mesh as ply, obj, stl or off"));
    }
    if bytes.is_empty() {
        return Err(Error::new(ErrorKind::Format, "the file is empty").advise("check how it was written"));
    }
    let text = matches!(format, Format::Xyz | Format::Csv);
    let columns = text || matches!(format, Format::Npy | Format::Npz | Format::Raw);
    let unused = [
        (options.columns.is_some() && !columns, "columns"),
        (options.delimiter.is_some() && !text, "a delimiter"),
        (options.skip > 0 && !text, "lines to skip"),
        (options.raw.is_some() && format != Format::Raw, "rows of a raw file"),
    ];
    if let Some((_, what)) = unused.iter().find(|(given, _)| *given) {
        return Err(Error::new(
            ErrorKind::Format,
            format!("{what} cannot be given for a file of the format {format}"),
        )
        .advise("leave the option out, or name the file's --format"));
    }
    match format {
        Format::Ply => ply::read(bytes, want),
        Format::Xyz | Format::Csv => table::read(bytes, options, want),
        Format::Obj => obj::read(bytes, want),
        Format::Stl => stl::read(bytes, want),
        Format::Npy => npy::read(bytes, options, want),
        Format::Npz => npz::read(bytes, options, want),
        Format::Off => off::read(bytes, want),
        Format::Glb => Err(Error::new(ErrorKind::Format, "GLB models are written, not read")
            .advise("convert it to PLY, for example with MeshLab or Blender")),
        Format::Pcd => pcd::read(bytes, want),
        Format::Ptx => ptx::read(bytes, want),
        Format::Vtk => vtk::read(bytes, want),
        Format::Las => las::read(bytes, want),
        Format::E57 => e57::read(bytes, want),
        Format::Raw => raw::read(bytes, options, want),
    }
}

#[cfg(test)]
mod tests;
