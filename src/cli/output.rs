//! Where results go: files that appear whole or not at all, or the pipe `-`.

use std::fs;
use std::path::{Path, PathBuf};

use bijective_sdf::geometry::{Attribute, Bounds, Number, TriangleMesh, relative_to, widened};
use bijective_sdf::io::{
    Encoding, Format, offset_left_out, write_atomic, write_cloud_to, write_cloud_with_to, write_mesh_with_to,
};
use bijective_sdf::{Error, ErrorKind};

use super::console::{print, say};
use super::failure::Failure;
use super::paths::{check_writable, is_pipe};
use super::report::offset_text;

/// A place for one result, checked before any work is done.
#[derive(Clone, Debug)]
pub struct Output {
    path: PathBuf,
    format: Format,
    encoding: Encoding,
}

impl Output {
    /// Decides on the format and checks that the file can be there.
    pub fn new(
        path: &Path,
        format: Option<Format>,
        ascii: bool,
        allowed: &[Format],
    ) -> Result<Self, Failure> {
        let names = || allowed.iter().map(|f| f.name()).collect::<Vec<_>>().join(", ");
        let format = match format.or_else(|| Format::from_path(path)) {
            Some(format) if allowed.contains(&format) => format,
            Some(format) => {
                return Err(Failure::Usage(format!(
                    "{}: this result is not written as {format}; choose one of {}",
                    path.display(),
                    names()
                )));
            }
            None if is_pipe(path) => Format::Ply,
            None => {
                return Err(Failure::Usage(format!(
                    "{}: the extension means no known format; name the file with one of {}",
                    path.display(),
                    names()
                )));
            }
        };
        check_writable(path)?;
        let encoding = if ascii { Encoding::Ascii } else { Encoding::Binary };
        Ok(Output { path: path.to_path_buf(), format, encoding })
    }

    /// The file name as the user gave it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes points of a result, in 32 bits where that loses nothing that matters.
    pub fn write_cloud(&self, points: &[[f64; 3]]) -> Result<(), Failure> {
        let mut bytes = Vec::new();
        write_cloud_to(&mut bytes, &short_enough(points), self.format, self.encoding)
            .map_err(Failure::Output)?;
        write_bytes(&self.path, &bytes)
    }

    /// Writes points with their normals (n x 3 each), as PLY.
    pub fn write_oriented_cloud(&self, points: &[[f64; 3]], normals: &[[f64; 3]]) -> Result<(), Failure> {
        let of_axis = |(axis, name): (usize, &str)| Attribute {
            name: name.into(),
            number: Number::F32,
            values: normals.iter().map(|n| n[axis]).collect(),
        };
        let attributes: Vec<_> = ["nx", "ny", "nz"].into_iter().enumerate().map(of_axis).collect();
        let mut bytes = Vec::new();
        write_cloud_with_to(&mut bytes, &short_enough(points), &attributes, self.encoding)
            .map_err(Failure::Output)?;
        write_bytes(&self.path, &bytes)
    }

    /// What it is written in.
    pub fn format(&self) -> Format {
        self.format
    }

    /// Writes a mesh with attributes of its vertices.
    pub fn write_mesh(&self, mesh: &TriangleMesh<[f64; 3]>, attributes: &[Attribute]) -> Result<(), Failure> {
        if let Some(offset) = offset_left_out(mesh, self.format) {
            say(&format!(
                "warning: {} files hold 32-bit numbers, too coarse for these coordinates: the mesh is written less the \
                 offset {}; add it again, or write ply or obj",
                self.format,
                offset_text(offset)
            ));
        }
        let mut bytes = Vec::new();
        write_mesh_with_to(&mut bytes, mesh, attributes, self.format, self.encoding)
            .map_err(Failure::Output)?;
        write_bytes(&self.path, &bytes)
    }
}

/// Points of a result, rounded to 32 bits where these hold their detail: everybody reads those, and files are half as
/// long.
pub fn short_enough(points: &[[f64; 3]]) -> Vec<[f64; 3]> {
    match Bounds::of(points) {
        Ok(bounds) if bounds.offset() == [0.0; 3] => widened(&relative_to(points, [0.0; 3])),
        _ => points.to_vec(),
    }
}

/// Writes a whole file, or to standard output; the file appears whole or not at all.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    if is_pipe(path) {
        return print(bytes);
    }
    write_atomic(path, |out| out.write_all(bytes).map_err(|e| Error::cannot_write(path, e)))
        .map_err(Failure::Output)
}

/// Makes a directory and those above it, unless they are there.
pub fn make_directory(path: &Path) -> Result<(), Failure> {
    fs::create_dir_all(path).map_err(|e| {
        Failure::Output(Error::new(ErrorKind::Io, "cannot make the directory").in_file(path).caused_by(e))
    })
}
