//! Where data comes from and goes to: files, or the pipe `-`.

use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use bijective_sdf::evaluate::GroundTruth;
use bijective_sdf::geometry::{Attribute, Bounds, TriangleMesh, about, shortest, widened};
use bijective_sdf::io::{
    Encoding, Format, PointCloud, ReadOptions, name_file, offset_left_out, read_cloud_with, read_mesh_with,
    write_atomic, write_cloud_to, write_mesh_with_to,
};
use bijective_sdf::reconstruct::Reconstruction;
use bijective_sdf::{Error, ErrorKind};
use clap::builder::{PossibleValuesParser, TypedValueParser};

use super::failure::Failure;

/// The formats that meshes are written in.
pub const MESH_FORMATS: [Format; 5] = [Format::Ply, Format::Obj, Format::Stl, Format::Off, Format::Glb];
/// The formats that clouds are written in.
pub const CLOUD_FORMATS: [Format; 3] = [Format::Ply, Format::Xyz, Format::Csv];

/// What a file turned out to hold.
pub enum Content {
    Cloud(PointCloud),
    Mesh(TriangleMesh<[f64; 3]>),
}

impl Content {
    /// What to subtract so that 32 bits hold its detail. Subtract the same from whatever it is compared with.
    pub fn offset(&self) -> [f64; 3] {
        match self {
            Content::Mesh(mesh) => mesh.offset(),
            Content::Cloud(cloud) => Bounds::of(&cloud.points).map_or([0.0; 3], |bounds| bounds.offset()),
        }
    }

    /// The same in 32 bits, less an offset.
    pub fn about(&self, offset: [f64; 3]) -> Local {
        match self {
            Content::Mesh(mesh) => Local::Mesh(mesh.about(offset)),
            Content::Cloud(cloud) => {
                Local::Cloud { points: about(&cloud.points, offset), normals: cloud.normals.clone() }
            }
        }
    }
}

/// What a file holds, in 32 bits about an offset.
pub enum Local {
    Cloud { points: Vec<[f32; 3]>, normals: Option<Vec<[f32; 3]>> },
    Mesh(TriangleMesh),
}

impl Local {
    /// As what predictions are held against.
    pub fn ground_truth(&self) -> GroundTruth<'_> {
        match self {
            Local::Mesh(mesh) => GroundTruth::Mesh(mesh),
            Local::Cloud { points, normals } => GroundTruth::Cloud { points, normals: normals.as_deref() },
        }
    }
}

/// The name of a file in a table: without directory and extension.
pub fn name(path: &Path) -> String {
    path.file_stem().map_or_else(|| path.display().to_string(), |s| s.to_string_lossy().into_owned())
}

/// Parses the name of a format and lists the names in the help.
pub fn format_parser() -> impl TypedValueParser<Value = Format> {
    PossibleValuesParser::new(Format::ALL.map(Format::name))
        .map(|name| Format::ALL.into_iter().find(|f| f.name() == name).expect("a listed name"))
}

/// The bytes of an input and its name for messages. `-` is standard input.
pub struct Input<'a> {
    path: &'a Path,
    options: ReadOptions,
    bytes: Vec<u8>,
}

impl<'a> Input<'a> {
    /// Reads everything; the format is the given one, else what the content shows, else what the file name says.
    pub fn read(path: &'a Path, format: Option<Format>) -> Result<Self, Failure> {
        let mut options = ReadOptions::default();
        options.format = format;
        Self::read_with(path, options)
    }

    /// Reads everything, to be understood as the user says.
    pub fn read_with(path: &'a Path, mut options: ReadOptions) -> Result<Self, Failure> {
        let failed =
            |e| Failure::Input(Error::new(ErrorKind::Io, "cannot read the file").in_file(path).caused_by(e));
        if is_pipe(path) {
            let mut bytes = Vec::new();
            io::stdin().lock().read_to_end(&mut bytes).map_err(|e| {
                Failure::Input(Error::new(ErrorKind::Io, "cannot read standard input").caused_by(e))
            })?;
            return Ok(Input { path: Path::new("standard input"), options, bytes });
        }
        let bytes = fs::read(path).map_err(failed)?;
        options.hint = Format::from_path(path);
        Ok(Input { path, options, bytes })
    }

    /// The bytes as they are.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The field that they hold.
    pub fn field(&self) -> Result<Reconstruction, Failure> {
        Reconstruction::from_bytes(&self.bytes).map_err(|e| Failure::Input(e.in_file(self.path)))
    }

    /// The name for messages.
    pub fn path(&self) -> &Path {
        self.path
    }

    /// The points.
    pub fn cloud(&self) -> Result<PointCloud, Failure> {
        read_cloud_with(&self.bytes, &self.options).map_err(|e| Failure::Input(name_file(e, self.path)))
    }

    /// The mesh.
    pub fn mesh(&self) -> Result<TriangleMesh<[f64; 3]>, Failure> {
        read_mesh_with(&self.bytes, &self.options).map_err(|e| Failure::Input(name_file(e, self.path)))
    }

    /// The mesh, or the points if the file has no faces.
    pub fn content(&self) -> Result<Content, Failure> {
        let found = || Format::of(&self.bytes, self.options.hint).ok();
        if self.options.format.or_else(found).is_some_and(|f| !f.holds_faces()) {
            return self.cloud().map(Content::Cloud);
        }
        match self.mesh() {
            // No usable mesh. If the file reads as a cloud and has no faces, it is one; if it does not even read as a
            // cloud, that error is told; if it has faces, the error of the mesh is.
            Err(Failure::Input(e)) if e.kind() == ErrorKind::Data => match self.cloud() {
                Ok(cloud) if cloud.faces == 0 => Ok(Content::Cloud(cloud)),
                Err(own) => Err(own),
                Ok(_) => Err(Failure::Input(e)),
            },
            result => result.map(Content::Mesh),
        }
    }
}

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
        Ok(bounds) if bounds.offset() == [0.0; 3] => widened(&about(points, [0.0; 3])),
        _ => points.to_vec(),
    }
}

/// An offset in words.
pub fn offset_text(offset: [f64; 3]) -> String {
    format!("({})", offset.map(shortest).join(", "))
}

/// Whether a path stands for standard input or output.
pub fn is_pipe(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Fails early where a later write would: hours of work should not end at a misspelt directory.
pub fn check_writable(path: &Path) -> Result<(), Failure> {
    if is_pipe(path) {
        return Ok(());
    }
    let refuse = |text: &str, advice: &str| {
        Err(Failure::Output(Error::new(ErrorKind::Io, text).in_file(path).advise(advice)))
    };
    if path.is_dir() {
        return refuse("cannot write the file: it is a directory", "give a file name");
    }
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() && !parent.is_dir() => {
            refuse("cannot write the file: its directory does not exist", "create the directory first")
        }
        _ => Ok(()),
    }
}

/// Whether two paths name one file, however they are written and over whatever links, also if it is not there yet.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    if is_pipe(a) || is_pipe(b) {
        return false;
    }
    // A file that is yet to be written has the place of its directory.
    let place = |path: &Path| {
        fs::canonicalize(path).ok().or_else(|| {
            let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            Some(fs::canonicalize(parent).ok()?.join(path.file_name()?))
        })
    };
    let same_place = place(a).is_some_and(|a| place(b).is_some_and(|b| a == b));
    a == b || same_place || is_hard_link(a, b)
}

#[cfg(unix)]
fn is_hard_link(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let of = |path: &Path| fs::metadata(path).ok().filter(fs::Metadata::is_file).map(|m| (m.dev(), m.ino()));
    of(a).is_some_and(|a| of(b) == Some(a))
}

#[cfg(not(unix))]
fn is_hard_link(_: &Path, _: &Path) -> bool {
    false
}

/// Refuses to write over what is read.
pub fn check_apart(option: &str, output: &Path, input: &Path) -> Result<(), Failure> {
    if is_same_file(output, input) {
        let text = format!("{option} would overwrite the input, {}", output.display());
        return Err(Failure::Usage(text));
    }
    Ok(())
}

/// Writes a whole file, or to standard output; the file appears whole or not at all.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    if is_pipe(path) {
        return print(bytes);
    }
    write_atomic(path, |out| {
        out.write_all(bytes).map_err(|e| Error::new(ErrorKind::Io, "writing failed").caused_by(e))
    })
    .map_err(Failure::Output)
}

/// Writes to standard output.
pub fn print(bytes: impl AsRef<[u8]>) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    out.write_all(bytes.as_ref()).and_then(|()| out.flush()).map_err(Failure::of_stdout)
}

/// Prints all failures but the last, which it returns: `run` prints that one and exits with its code.
pub fn say_all_but_last(mut failures: Vec<Failure>) -> Option<Failure> {
    let last = failures.pop();
    failures.iter().filter_map(Failure::line).for_each(|line| say(&line));
    last
}

/// Writes a line to standard error. Nobody can be told that this failed.
pub fn say(line: &str) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}
