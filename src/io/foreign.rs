//! Files that are known and not read: their names, and what to do with them.

use std::path::Path;

use crate::{Error, ErrorKind};

/// The message about bytes that show no format.
pub(super) const UNKNOWN: &str = "the file format is unknown";

/// Where a mark stands, the mark, what the file is, and how to convert it.
type Known = (usize, &'static [u8], &'static str, &'static str);

const CLOUD: &str = "export the points as PLY, LAS or E57";
const MESH: &str = "export the mesh as PLY, OBJ or STL";
const UNPACK: &str = "unpack it and give the file inside";
const TEXT: &str = "export the points as CSV or PLY";

const KNOWN: [Known; 29] = [
    (0, b"glTF", "a GLB model", MESH),
    (0, b"Kaydara FBX", "an FBX model", MESH),
    (0, b"ISO-10303-21", "a STEP or IFC file", "export the surface as STL or PLY from the CAD program"),
    (0, b"DRACO", "a Draco file", MESH),
    (0, b"AC10", "a DWG drawing", "export the points as CSV or PLY, or the mesh as STL"),
    (0, b"BLENDER", "a Blender file", MESH),
    (0, b"PXR-USDC", "a USD scene", MESH),
    (0, b"#usda", "a USD scene", MESH),
    (0, b"#VRML", "a VRML scene", MESH),
    (0, b"\x89HDF", "an HDF5 file", "save the array of the points with numpy.save"),
    (0, b"CDF\x01", "a NetCDF file", "save the array of the points with numpy.save"),
    (0, b"MATLAB 5.0", "a MATLAB file", "save the array of the points with writematrix as CSV"),
    (0, b"\x80\x04", "a Python pickle", "save the array of the points with numpy.save"),
    (0, b"\x80\x02", "a Python pickle", "save the array of the points with numpy.save"),
    (0, b"PAR1", "a Parquet table", TEXT),
    (0, b"SQLite format 3", "a database (GeoPackage or other)", TEXT),
    (0, b"#ROSBAG", "a ROS bag", "export its scans as PCD"),
    (0, b"\xd0\xcf\x11\xe0", "an old Excel or Office file", "save the sheet as CSV"),
    (0, b"BZh", "a file packed with bzip2", UNPACK),
    (0, b"\xfd7zXZ", "a file packed with xz", UNPACK),
    (0, b"\x28\xb5\x2f\xfd", "a file packed with zstd", UNPACK),
    (0, b"7z\xbc\xaf", "a 7z archive", UNPACK),
    (0, b"Rar!", "a RAR archive", UNPACK),
    (257, b"ustar", "a tar archive", UNPACK),
    (0, b"%PDF", "a PDF document", TEXT),
    (0, b"\x89PNG", "a picture", "give a point cloud"),
    (0, b"\xff\xd8\xff", "a picture", "give a point cloud"),
    (0, b"II*\0", "a TIFF raster", "export its cells as points, x, y and z, in a CSV file"),
    (
        0,
        b"version https://git-lfs",
        "a pointer of Git LFS, not the file itself",
        "fetch the file with `git lfs pull`",
    ),
];

/// Extensions of formats that have no mark, or none that is public.
const NAMED: [(&str, &str, &str); 24] = [
    ("fls", "a scan of FARO", CLOUD),
    ("lsproj", "a project of FARO", CLOUD),
    ("zfs", "a scan of Zoller+Froehlich", CLOUD),
    ("rcp", "a project of ReCap", CLOUD),
    ("rcs", "a scan of ReCap", CLOUD),
    ("dp", "a scan of DotProduct", CLOUD),
    ("3dd", "a scan of RIEGL", CLOUD),
    ("rdbx", "a database of RIEGL", CLOUD),
    ("cl3", "a scan of Topcon", CLOUD),
    ("clr", "a scan of Topcon", CLOUD),
    ("pod", "a cloud of Pointools", CLOUD),
    ("imp", "a database of Cyclone", CLOUD),
    ("lgs", "a scan of Leica", CLOUD),
    ("dwg", "a DWG drawing", "export the points as CSV or PLY, or the mesh as STL"),
    ("dxf", "a DXF drawing", "export the points as CSV or PLY, or the mesh as STL"),
    ("skp", "a SketchUp model", MESH),
    ("max", "a 3ds Max scene", MESH),
    ("3ds", "a 3DS model", MESH),
    ("gltf", "a glTF model", MESH),
    ("dae", "a COLLADA model", MESH),
    ("xls", "an Excel workbook", "save the sheet as CSV"),
    ("mat", "a MATLAB file", "save the array of the points with writematrix as CSV"),
    ("spz", "a cloud of Gaussians", "export it as PLY"),
    ("bag", "a ROS bag", "export its scans as PCD"),
];

/// Whether the bytes are exactly the binary `points3D.bin` of COLMAP: a count, and for each point an id, three 64-bit
/// numbers, a colour, an error, and a list of views of 8 bytes each. It would pass for a raw file.
pub(super) fn is_colmap(bytes: &[u8]) -> bool {
    let number = |at: usize| {
        let part = bytes.get(at..at.checked_add(8)?)?;
        usize::try_from(part.iter().rev().fold(0_u64, |all, b| all << 8 | u64::from(*b))).ok()
    };
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
    let has = |(at, mark, ..): &&Known| bytes.get(*at..).is_some_and(|b| b.starts_with(mark));
    if let Some((_, _, what, advice)) = KNOWN.iter().find(has) {
        return Some(refuse(what, advice));
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
        return Some(refuse("a DXF drawing", "export the points as CSV or PLY, or the mesh as STL"));
    }
    if lines.first().is_some_and(|l| l.starts_with("ncols")) {
        let advice = "export its cells as points, x, y and z, in a CSV file";
        return Some(refuse("a grid of heights (ESRI ASCII)", advice));
    }
    None
}

/// What a file is that is not read, by its extension in lower case.
fn by_extension(extension: &str) -> Option<Error> {
    NAMED.iter().find(|(e, ..)| *e == extension).map(|(_, what, advice)| refuse(what, advice))
}

/// Adds the file to an error from reading its bytes. Where these show no format, the file's name may still tell one
/// that is not read; then the error says how to convert it.
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
        let options = crate::io::ReadOptions { hint: Some(crate::io::Format::Kitti), ..Default::default() };
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
