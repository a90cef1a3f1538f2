//! Which format a file has: the one that is named outright, else what its content shows, else what its name means.

use std::borrow::Cow;

use super::options::ReadOptions;
use super::text::{Lines, float, words};
use super::{Format, e57, foreign, las, npy, off, packed, pcd, ply, ptx, stl, vtk, zip};
use crate::{Error, ErrorKind};

impl Format {
    /// The format of a file whose name means `hint`, whose bytes may be packed with gzip.
    ///
    /// # Errors
    ///
    /// As [`read_cloud_bytes`](super::read_cloud_bytes) where the bytes cannot be unpacked or are of a format that is
    /// not read.
    pub fn of(bytes: &[u8], hint: Option<Format>) -> Result<Format, Error> {
        let options = ReadOptions { hint, ..Default::default() };
        choose(&unpacked(bytes)?, &options)
    }
}

/// The format: the one named outright, else what the content shows, else what the name means.
pub(super) fn choose(bytes: &[u8], options: &ReadOptions) -> Result<Format, Error> {
    if let Some(format) = options.format {
        return Ok(format);
    }
    let found = of_content_and_name(bytes, options.hint);
    // Numbers in columns are no signature: any text file could look like them, so files that are not read are ruled out
    // first.
    let signed = of_content(bytes).filter(|f| !matches!(f, Format::Xyz | Format::Csv));
    if let Some(format) = found.filter(|_| signed.is_some()) {
        return Ok(format);
    }
    if foreign::is_colmap(bytes) {
        return Err(foreign::colmap());
    }
    if options.hint != Some(Format::Raw)
        && let Some(e) = foreign::by_content(bytes)
    {
        return Err(e);
    }
    found.ok_or_else(|| {
        let what = if bytes.is_empty() { "the file is empty" } else { foreign::UNKNOWN };
        Error::new(ErrorKind::Format, what).advise(format!("supported are {}", Format::list()))
    })
}

/// The bytes of a file, unpacked if they are packed with gzip.
pub(super) fn unpacked(bytes: &[u8]) -> Result<Cow<'_, [u8]>, Error> {
    if packed::looks_like_gzip(bytes) {
        packed::gunzip(bytes).map(Cow::Owned)
    } else {
        Ok(Cow::Borrowed(bytes))
    }
}

/// The format of a file whose name means `hint`: what the content shows wins, and the name decides where the
/// content fits several formats or none.
fn of_content_and_name(bytes: &[u8], hint: Option<Format>) -> Option<Format> {
    match (of_content(bytes), hint) {
        // Columns of numbers are read alike under both names.
        (Some(Format::Xyz | Format::Csv), Some(hint @ (Format::Xyz | Format::Csv))) => Some(hint),
        // The name OFF may be missing in the file; the counts that are first then may be those of vertices alone.
        (Some(Format::Xyz), Some(Format::Off)) if off::begins_with_counts(bytes) => Some(Format::Off),
        // Rows of floats may happen to be text, or to have the size that a binary STL names.
        (Some(Format::Stl), Some(Format::Raw)) if !bytes.starts_with(b"solid") => Some(Format::Raw),
        (found, hint) => found.or(hint),
    }
}

/// The format that the first bytes of a file point to.
///
/// Raw rows of floats have no signature, so [`Format::Raw`] is never guessed.
fn of_content(bytes: &[u8]) -> Option<Format> {
    type Mark = (fn(&[u8]) -> bool, Format);
    let marks: [Mark; 10] = [
        (npy::looks_like_npy, Format::Npy),
        (ply::looks_like_ply, Format::Ply),
        (zip::looks_like_zip, Format::Npz),
        (las::looks_like_las, Format::Las),
        (e57::looks_like_e57, Format::E57),
        (vtk::looks_like_vtk, Format::Vtk),
        (pcd::looks_like_pcd, Format::Pcd),
        (off::looks_like_off, Format::Off),
        (ptx::looks_like_ptx, Format::Ptx),
        (stl::looks_like_stl, Format::Stl),
    ];
    if let Some((_, format)) = marks.iter().find(|(fits, _)| fits(bytes)) {
        return Some(*format);
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    from_text(&bytes[..bytes.len().min(4096)])
}

/// Tells OBJ, CSV and XYZ apart by the first lines that are neither comments nor column names.
fn from_text(start: &[u8]) -> Option<Format> {
    if start.iter().any(|&b| b < b' ' && !b"\t\n\r\x0c".contains(&b)) {
        return None;
    }
    for (_, line) in Lines::new(start).take(64) {
        let line = line.trim_ascii();
        if line.is_empty() || line.starts_with(b"#") || line.starts_with(b"//") || line.starts_with(b"%") {
            continue;
        }
        let first = words(line).next()?;
        if [&b"v"[..], b"vn", b"vt", b"vp", b"f", b"o", b"g", b"mtllib", b"usemtl"].contains(&first) {
            return Some(Format::Obj);
        }
        let field = line.split(|&b| b",;| \t".contains(&b)).next()?;
        if float(field).is_some() {
            let commas = line.contains(&b',') || line.contains(&b';');
            return Some(if commas { Format::Csv } else { Format::Xyz });
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_tells_the_format() {
        let cases: [(&[u8], Option<Format>); 22] = [
            (b"ply \nformat ascii 1.0\n", Some(Format::Ply)),
            (b"PK\x03\x04", Some(Format::Npz)),
            (b"LASF\0\0", Some(Format::Las)),
            (b"ASTM-E57", Some(Format::E57)),
            (b"# vtk DataFile Version 2.0\n", Some(Format::Vtk)),
            (b"# .PCD v0.7\nVERSION 0.7\n", Some(Format::Pcd)),
            (b"COFF\n1 0 0\n", Some(Format::Off)),
            (ptx::tests::SCANS.as_bytes(), Some(Format::Ptx)),
            (b"% x y z\n1 2 3\n", Some(Format::Xyz)),
            (b"ply\nformat ascii 1.0\n", Some(Format::Ply)),
            (b"ply\r\nformat ascii 1.0\r\n", Some(Format::Ply)),
            (b"\x93NUMPY\x01\x00", Some(Format::Npy)),
            (b"solid a b c\nfacet normal 0 0 1\n", Some(Format::Stl)),
            (b"# made by hand\n\nv 0 0 0\n", Some(Format::Obj)),
            (b"mtllib a.mtl\nv 0 0 0\n", Some(Format::Obj)),
            (b"0.5 1 2\n", Some(Format::Xyz)),
            (b"\xef\xbb\xbf3\r\n0.5\t1\t2\r\n", Some(Format::Xyz)),
            (b"x,y,z\n1,2,3\n", Some(Format::Csv)),
            (b"1; 2; 3\n", Some(Format::Csv)),
            (b"plywood 1 2\n", None),
            (b"\x00\x01\x02\x03\x04\x05", None),
            (b"", None),
        ];
        for (bytes, format) in cases {
            assert_eq!(of_content(bytes), format, "{:?}", String::from_utf8_lossy(bytes));
        }
    }
}
