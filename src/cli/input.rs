//! Where data comes from: files, or the pipe `-`.

use std::fs;
use std::io::{self, Read};
use std::path::Path;

use bijective_sdf::evaluate::GroundTruth;
use bijective_sdf::geometry::{Bounds, TriangleMesh, relative_to};
use bijective_sdf::io::{Format, PointCloud, ReadOptions, name_file, read_cloud_with, read_mesh_with};
use bijective_sdf::reconstruct::Reconstruction;
use bijective_sdf::{Error, ErrorKind};

use super::failure::Failure;
use super::paths::is_pipe;

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
        if is_pipe(path) {
            let mut bytes = Vec::new();
            io::stdin().lock().read_to_end(&mut bytes).map_err(|e| {
                Failure::Input(Error::new(ErrorKind::Io, "cannot read standard input").caused_by(e))
            })?;
            return Ok(Input { path: Path::new("standard input"), options, bytes });
        }
        let bytes = fs::read(path).map_err(|e| Failure::cannot_read(path, e))?;
        options.hint = Format::of_input(path);
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
    pub fn relative_to(&self, offset: [f64; 3]) -> Local {
        match self {
            Content::Mesh(mesh) => Local::Mesh(mesh.relative_to(offset)),
            Content::Cloud(cloud) => {
                Local::Cloud { points: relative_to(&cloud.points, offset), normals: cloud.normals.clone() }
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
