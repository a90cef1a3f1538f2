//! The file formats with their names and extensions, and what files of each can hold.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use crate::geometry::COLOUR;
use crate::{Error, ErrorKind};

/// A file format of point clouds, meshes or both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Format {
    /// Polygon file format, text or binary of either byte order; clouds and meshes.
    Ply,
    /// Text with one point a line, columns separated by white space; clouds only.
    Xyz,
    /// Text with one point a line, columns separated by commas or semicolons; clouds only.
    Csv,
    /// Wavefront text; clouds (its `v` lines) and meshes.
    Obj,
    /// Stereolithography triangles, text or binary; meshes, or a cloud of their corners.
    Stl,
    /// Object file format of Geomview, with COFF, NOFF and STOFF, text; clouds and meshes.
    Off,
    /// Binary glTF 2.0; meshes, written only.
    Glb,
    /// Point Cloud Library, text, binary or packed; clouds only.
    Pcd,
    /// Scans of Leica with their poses, text; clouds only.
    Ptx,
    /// The older format of the Visualization Toolkit, text or binary; its points.
    Vtk,
    /// A NumPy array of points; clouds only.
    Npy,
    /// An archive of NumPy arrays; clouds only.
    Npz,
    /// Laser scans from the air, LAS or, with the feature `formats`, LAZ; clouds only.
    Las,
    /// Terrestrial laser scans, with the feature `formats`; clouds only.
    E57,
    /// Rows of little-endian floats without a header, by the name `kitti`: x, y, z, intensity as `f32`, as in the KITTI
    /// laser scans, unless [`ReadOptions::raw`](super::ReadOptions::raw) says otherwise; clouds only.
    Raw,
}

impl Format {
    /// Every format, in the order in which messages list them.
    pub const ALL: [Format; 15] = [
        Format::Ply,
        Format::Xyz,
        Format::Csv,
        Format::Obj,
        Format::Stl,
        Format::Off,
        Format::Glb,
        Format::Pcd,
        Format::Ptx,
        Format::Vtk,
        Format::Npy,
        Format::Npz,
        Format::Las,
        Format::E57,
        Format::Raw,
    ];

    /// The name by which a user chooses it, in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Format::Ply => "ply",
            Format::Xyz => "xyz",
            Format::Csv => "csv",
            Format::Obj => "obj",
            Format::Stl => "stl",
            Format::Off => "off",
            Format::Glb => "glb",
            Format::Pcd => "pcd",
            Format::Ptx => "ptx",
            Format::Vtk => "vtk",
            Format::Npy => "npy",
            Format::Npz => "npz",
            Format::Las => "las",
            Format::E57 => "e57",
            // The name of the data set whose files are the best known of this kind.
            Format::Raw => "kitti",
        }
    }

    /// The file name extensions that mean it, in lower case and without the dot.
    pub fn extensions(self) -> &'static [&'static str] {
        match self {
            Format::Ply => &["ply"],
            Format::Xyz => &["xyz", "txt", "pts", "asc"],
            Format::Csv => &["csv"],
            Format::Obj => &["obj"],
            Format::Stl => &["stl"],
            Format::Off => &["off", "coff", "noff"],
            Format::Glb => &["glb"],
            Format::Pcd => &["pcd"],
            Format::Ptx => &["ptx"],
            Format::Vtk => &["vtk"],
            Format::Npy => &["npy"],
            Format::Npz => &["npz"],
            Format::Las => &["las", "laz"],
            Format::E57 => &["e57"],
            Format::Raw => &["bin"],
        }
    }

    /// The format that the extension of `path` means, in any letter case; `.gz` behind it does not count.
    pub fn from_path(path: impl AsRef<Path>) -> Option<Format> {
        let mut path = path.as_ref();
        let mut extension = path.extension()?.to_str()?.to_ascii_lowercase();
        if extension == "gz" {
            path = Path::new(path.file_stem()?);
            extension = path.extension()?.to_str()?.to_ascii_lowercase();
        }
        Format::ALL.into_iter().find(|f| f.extensions().contains(&extension.as_str()))
    }

    /// The format that the extension of a file to be read means: that of [`from_path`](Self::from_path), or a table for
    /// `.tsv`, which is not written.
    pub fn of_input(path: impl AsRef<Path>) -> Option<Format> {
        let path = path.as_ref();
        let name = path.to_str().map(str::to_ascii_lowercase).unwrap_or_default();
        let table = name.ends_with(".tsv") || name.ends_with(".tsv.gz");
        Format::from_path(path).or(table.then_some(Format::Csv))
    }

    /// Whether files of this format can hold faces.
    pub fn holds_faces(self) -> bool {
        matches!(self, Format::Ply | Format::Obj | Format::Stl | Format::Off | Format::Glb)
    }

    /// Whether meshes of this format have a place for an attribute of this name at each vertex: PLY for any, OBJ and
    /// GLB for colours.
    pub fn holds_attribute(self, name: &str) -> bool {
        match self {
            Format::Ply => true,
            Format::Obj | Format::Glb => COLOUR.contains(&name),
            _ => false,
        }
    }

    /// The supported formats with their extensions, for messages: `ply (.ply), xyz (.xyz .txt ...)`.
    pub fn list() -> String {
        let one = |f: Format| {
            let extensions: Vec<String> = f.extensions().iter().map(|e| format!(".{e}")).collect();
            let only = if f == Format::Glb { ", written only" } else { "" };
            format!("{} ({}{only})", f.name(), extensions.join(" "))
        };
        Format::ALL.map(one).join(", ")
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Format {
    type Err = Error;

    /// The format of this name or extension, in any letter case.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Format`] for an unknown name; the advice lists the supported ones.
    fn from_str(name: &str) -> Result<Format, Error> {
        let wanted = name.trim_start_matches('.').to_ascii_lowercase();
        Format::ALL
            .into_iter()
            .find(|f| f.name() == wanted || f.extensions().contains(&wanted.as_str()))
            .ok_or_else(|| {
                Error::new(ErrorKind::Format, format!("unknown file format {name:?}"))
                    .advise(format!("supported are {}", Format::list()))
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_between_tabs_are_read_by_their_extension() {
        for (path, format) in [
            ("a.tsv", Some(Format::Csv)),
            ("A.TSV.gz", Some(Format::Csv)),
            ("a.ply", Some(Format::Ply)),
            ("tsv", None),
        ] {
            assert_eq!(Format::of_input(path), format, "{path}");
        }
        assert_eq!(Format::from_path("a.tsv"), None);
    }

    #[test]
    fn names_and_extensions_lead_back_to_the_format() {
        for format in Format::ALL {
            assert_eq!(format.name().parse::<Format>().unwrap(), format);
            assert_eq!(format.to_string().to_uppercase().parse::<Format>().unwrap(), format);
            for extension in format.extensions() {
                assert_eq!(Format::from_path(format!("a.b/c.{extension}")), Some(format));
                assert_eq!(Format::from_path(format!("C.{}", extension.to_uppercase())), Some(format));
                assert_eq!(format!(".{extension}").parse::<Format>().unwrap(), format);
            }
        }
        assert_eq!(Format::from_path("cloud"), None);
        assert_eq!(Format::from_path("cloud.dxf"), None);
        assert_eq!(Format::from_path("a/cloud.XYZ.gz"), Some(Format::Xyz));
        let e = "dxf".parse::<Format>().unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Format);
        for format in Format::ALL {
            assert!(e.to_string().contains(format.name()), "{e}");
        }
    }
}
