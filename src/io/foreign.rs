//! Files that are known and not read: their names, and what to do with them.

use std::path::Path;

use super::number::unsigned;
use crate::{Error, ErrorKind};

/// The message about bytes that show no format.
pub(super) const UNKNOWN: &str = "the file format is unknown";

/// A format that is known by its first bytes.
struct Known {
    /// Where the signature stands.
    offset: usize,
    signature: &'static [u8],
    /// What the file is.
    what: &'static str,
    /// How to convert it.
    advice: &'static str,
}

/// A format that is known by the extension of its files.
struct Named {
    extension: &'static str,
    what: &'static str,
    advice: &'static str,
}

const CLOUD: &str = "export the points as PLY, LAS or E57";
const MESH: &str = "export the mesh as PLY, OBJ or STL";
const UNPACK: &str = "unpack it and give the file inside";
const TEXT: &str = "export the points as CSV or PLY";
const NUMPY: &str = "save the array of the points with numpy.save";
const MATLAB: &str = "save the array of the points with writematrix as CSV";
const DRAWING: &str = "export the points as CSV or PLY, or the mesh as STL";
const SHEET: &str = "save the sheet as CSV";
const RASTER: &str = "export its cells as points, x, y and z, in a CSV file";

const KNOWN: [Known; 30] = [
    Known {
        offset: 8,
        signature: b"{\"__metadata__\":{\"bijective_sdf\"",
        what: "a saved field or checkpoint",
        advice: "give a field to `mesh` or `sdf`, a checkpoint to --resume, or either to `info`",
    },
    Known { offset: 0, signature: b"glTF", what: "a GLB model", advice: MESH },
    Known { offset: 0, signature: b"Kaydara FBX", what: "an FBX model", advice: MESH },
    Known {
        offset: 0,
        signature: b"ISO-10303-21",
        what: "a STEP or IFC file",
        advice: "export the surface as STL or PLY from the CAD program",
    },
    Known { offset: 0, signature: b"DRACO", what: "a Draco file", advice: MESH },
    Known { offset: 0, signature: b"AC10", what: "a DWG drawing", advice: DRAWING },
    Known { offset: 0, signature: b"BLENDER", what: "a Blender file", advice: MESH },
    Known { offset: 0, signature: b"PXR-USDC", what: "a USD scene", advice: MESH },
    Known { offset: 0, signature: b"#usda", what: "a USD scene", advice: MESH },
    Known { offset: 0, signature: b"#VRML", what: "a VRML scene", advice: MESH },
    Known { offset: 0, signature: b"\x89HDF", what: "an HDF5 file", advice: NUMPY },
    Known { offset: 0, signature: b"CDF\x01", what: "a NetCDF file", advice: NUMPY },
    Known { offset: 0, signature: b"MATLAB 5.0", what: "a MATLAB file", advice: MATLAB },
    Known { offset: 0, signature: b"\x80\x04", what: "a Python pickle", advice: NUMPY },
    Known { offset: 0, signature: b"\x80\x02", what: "a Python pickle", advice: NUMPY },
    Known { offset: 0, signature: b"PAR1", what: "a Parquet table", advice: TEXT },
    Known {
        offset: 0,
        signature: b"SQLite format 3",
        what: "a database (GeoPackage or other)",
        advice: TEXT,
    },
    Known { offset: 0, signature: b"#ROSBAG", what: "a ROS bag", advice: "export its scans as PCD" },
    Known { offset: 0, signature: b"\xd0\xcf\x11\xe0", what: "an old Excel or Office file", advice: SHEET },
    Known { offset: 0, signature: b"BZh", what: "a file packed with bzip2", advice: UNPACK },
    Known { offset: 0, signature: b"\xfd7zXZ", what: "a file packed with xz", advice: UNPACK },
    Known { offset: 0, signature: b"\x28\xb5\x2f\xfd", what: "a file packed with zstd", advice: UNPACK },
    Known { offset: 0, signature: b"7z\xbc\xaf", what: "a 7z archive", advice: UNPACK },
    Known { offset: 0, signature: b"Rar!", what: "a RAR archive", advice: UNPACK },
    Known { offset: 257, signature: b"ustar", what: "a tar archive", advice: UNPACK },
    Known { offset: 0, signature: b"%PDF", what: "a PDF document", advice: TEXT },
    Known { offset: 0, signature: b"\x89PNG", what: "a picture", advice: "give a point cloud" },
    Known { offset: 0, signature: b"\xff\xd8\xff", what: "a picture", advice: "give a point cloud" },
    Known { offset: 0, signature: b"II*\0", what: "a TIFF raster", advice: RASTER },
    Known {
        offset: 0,
        signature: b"version https://git-lfs",
        what: "a pointer of Git LFS, not the file itself",
        advice: "fetch the file with `git lfs pull`",
    },
];

/// Extensions of formats that have no signature, or none that is public.
const NAMED: [Named; 24] = [
    Named { extension: "fls", what: "a scan of FARO", advice: CLOUD },
    Named { extension: "lsproj", what: "a project of FARO", advice: CLOUD },
    Named { extension: "zfs", what: "a scan of Zoller+Froehlich", advice: CLOUD },
    Named { extension: "rcp", what: "a project of ReCap", advice: CLOUD },
    Named { extension: "rcs", what: "a scan of ReCap", advice: CLOUD },
    Named { extension: "dp", what: "a scan of DotProduct", advice: CLOUD },
    Named { extension: "3dd", what: "a scan of RIEGL", advice: CLOUD },
    Named { extension: "rdbx", what: "a database of RIEGL", advice: CLOUD },
    Named { extension: "cl3", what: "a scan of Topcon", advice: CLOUD },
    Named { extension: "clr", what: "a scan of Topcon", advice: CLOUD },
    Named { extension: "pod", what: "a cloud of Pointools", advice: CLOUD },
    Named { extension: "imp", what: "a database of Cyclone", advice: CLOUD },
    Named { extension: "lgs", what: "a scan of Leica", advice: CLOUD },
    Named { extension: "dwg", what: "a DWG drawing", advice: DRAWING },
    Named { extension: "dxf", what: "a DXF drawing", advice: DRAWING },
    Named { extension: "skp", what: "a SketchUp model", advice: MESH },
    Named { extension: "max", what: "a 3ds Max scene", advice: MESH },
    Named { extension: "3ds", what: "a 3DS model", advice: MESH },
    Named { extension: "gltf", what: "a glTF model", advice: MESH },
    Named { extension: "dae", what: "a COLLADA model", advice: MESH },
    Named { extension: "xls", what: "an Excel workbook", advice: SHEET },
    Named { extension: "mat", what: "a MATLAB file", advice: MATLAB },
    Named { extension: "spz", what: "a cloud of Gaussians", advice: "export it as PLY" },
    Named { extension: "bag", what: "a ROS bag", advice: "export its scans as PCD" },
];

/// Whether the bytes are exactly the binary `points3D.bin` of COLMAP: a count, and for each point an id, three 64-bit
/// numbers, a colour, an error, and a list of views of 8 bytes each. It would pass for a raw file.
pub(super) fn is_colmap(bytes: &[u8]) -> bool {
    let number = |at: usize| usize::try_from(unsigned(bytes, at, 8)?).ok();
    let Some(count) = number(0).filter(|n| (1..=bytes.len() / 51).contains(n)) else { return false };
    let mut at = 8;
    for _ in 0..count {
        let Some(views) = number(at + 43).and_then(|n| n.checked_mul(8)).filter(|n| *n <= bytes.len()) else {
            return false;
        };
        at += 51 + views;
    }
    at == bytes.len()
}

/// The error about such a file.
pub(super) fn colmap() -> Error {
    refuse(
        "the binary points3D.bin of COLMAP",
        "convert it with `colmap model_converter --output_type TXT` or `PLY`",
    )
}

/// What a file is that is not read, by its content.
pub(super) fn by_content(bytes: &[u8]) -> Option<Error> {
    let has = |known: &&Known| bytes.get(known.offset..).is_some_and(|b| b.starts_with(known.signature));
    if let Some(known) = KNOWN.iter().find(has) {
        return Some(refuse(known.what, known.advice));
    }
    let start = &bytes[..bytes.len().min(2048)];
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start).trim_ascii_start();
    let text = String::from_utf8_lossy(start).to_lowercase();
    if text.starts_with("<!doctype html") || text.starts_with("<html") {
        return Some(refuse("a web page", "the download failed; fetch the file again"));
    }
    if text.starts_with('<') {
        return Some(match () {
            () if text.contains("<vtkfile") => {
                refuse("a VTK file in XML", "save it in the older VTK format, or as PLY or CSV")
            }
            () if text.contains("<collada") => refuse("a COLLADA model", MESH),
            () if text.contains("<x3d") => refuse("an X3D scene", MESH),
            () if text.contains("landxml") => refuse("a LandXML file", TEXT),
            () => refuse("an XML file", TEXT),
        });
    }
    if text.starts_with('{') || text.starts_with('[') {
        let what = if text.contains("\"asset\"") { "a glTF model" } else { "a JSON file" };
        return Some(refuse(what, if what == "a JSON file" { TEXT } else { MESH }));
    }
    // A DXF file is pairs of lines, a number and a value, and the first names a section.
    let lines: Vec<&str> = text.lines().map(str::trim).take(4).collect();
    if let ["0", "section", "2", _] = lines[..] {
        return Some(refuse("a DXF drawing", DRAWING));
    }
    if lines.first().is_some_and(|l| l.starts_with("ncols")) {
        return Some(refuse("a grid of heights (ESRI ASCII)", RASTER));
    }
    None
}

/// What a file is that is not read, by its extension in lower case.
fn by_extension(extension: &str) -> Option<Error> {
    NAMED.iter().find(|named| named.extension == extension).map(|named| refuse(named.what, named.advice))
}

/// Adds the file to an error from reading its bytes. If the content shows no known format but the extension is that of
/// a format which is not read, the error becomes the one that names this format and says how to convert it.
pub fn name_file(error: Error, path: impl AsRef<Path>) -> Error {
    let path = path.as_ref();
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match by_extension(&extension) {
        Some(known) if error.message() == UNKNOWN => known,
        _ => error,
    }
    .in_file(path)
}

fn refuse(what: &str, advice: &str) -> Error {
    Error::new(ErrorKind::Format, format!("the file is {what}, which is not read")).advise(advice)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_binary_model_of_colmap_is_no_raw_file() {
        let mut bytes = 2_u64.to_le_bytes().to_vec();
        for views in [1_u64, 3] {
            bytes.extend(
                [[7; 8].as_slice(), &[0; 35], &views.to_le_bytes(), &vec![1; 8 * views as usize]].concat(),
            );
        }
        assert!(is_colmap(&bytes) && !is_colmap(&bytes[..bytes.len() - 1]) && !is_colmap(&[0; 64]));
        let options = crate::io::ReadOptions { hint: Some(crate::io::Format::Raw), ..Default::default() };
        let e = crate::io::read_cloud_with(&bytes, &options).unwrap_err().to_string();
        assert!(e.contains("points3D.bin of COLMAP") && e.contains("model_converter"), "{e}");
    }

    #[test]
    fn known_files_are_named_with_a_cure() {
        let cases: [(&[u8], &str); 10] = [
            (b"glTF\x02\0\0\0", "a GLB model, which is not read; export the mesh"),
            (b"ISO-10303-21;\nHEADER;", "STEP or IFC"),
            (b"<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\">", "a VTK file in XML"),
            (b"<!DOCTYPE html><html>", "a web page, which is not read; the download failed"),
            (b"{\"asset\": {}}", "a glTF model"),
            (b"[[1, 2, 3]]", "a JSON file"),
            (b"  0\r\nSECTION\r\n  2\r\nENTITIES\r\n", "a DXF drawing"),
            (b"ncols 4\nnrows 5\n", "ESRI ASCII"),
            (b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
            (b"\xd0\xcf\x11\xe0\xa1\xb1", "Excel"),
        ];
        for (bytes, part) in cases {
            let e = by_content(bytes).unwrap_or_else(|| panic!("{part}")).to_string();
            assert!(e.contains(part), "{e}");
        }
        let e = crate::io::read_cloud_bytes(b"0\nSECTION\n2\nHEADER\n", None).unwrap_err().to_string();
        assert!(e.contains("DXF"), "{e}");
        for plain in [&b"1 2 3\n"[..], b"", b"x,y,z\n", b"ply\n", b"0\nSECTION\n"] {
            assert!(by_content(plain).is_none());
        }
        assert!(by_extension("rcp").unwrap().to_string().contains("ReCap") && by_extension("ply").is_none());
    }
}
