//! Packed files: gzip, and the deflated files of zip archives. Unpacking needs a feature; naming does not.

use crate::{Error, ErrorKind};

/// The most bytes that a file may unpack to; a damaged or malicious file could fill the memory otherwise.
#[cfg(feature = "formats")]
const MAX_UNPACKED: u64 = 4 << 30;

/// Whether the bytes begin like a gzip file.
pub(super) fn looks_like_gzip(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\x1f\x8b\x08")
}

/// Unpacks a gzip file of one or more members.
#[cfg(feature = "formats")]
pub(super) fn gunzip(bytes: &[u8]) -> Result<Vec<u8>, Error> {
    read_all(flate2::read::MultiGzDecoder::new(bytes), MAX_UNPACKED, "gzip")
}

/// Unpacks deflated bytes that promise to become `size`.
#[cfg(feature = "formats")]
pub(super) fn inflate(bytes: &[u8], size: u64) -> Result<Vec<u8>, Error> {
    let out = read_all(flate2::read::DeflateDecoder::new(bytes), size.min(MAX_UNPACKED), "zip")?;
    if out.len() as u64 == size {
        return Ok(out);
    }
    Err(Error::new(ErrorKind::Format, format!("truncated: {size} bytes promised, {} are there", out.len()))
        .advise("fetch the file again"))
}

#[cfg(feature = "formats")]
fn read_all(reader: impl std::io::Read, most: u64, what: &str) -> Result<Vec<u8>, Error> {
    use std::io::Read;
    let mut out = Vec::new();
    reader.take(most + 1).read_to_end(&mut out).map_err(|e| {
        Error::new(ErrorKind::Format, format!("the {what} data are damaged"))
            .caused_by(e)
            .advise("fetch the file again")
    })?;
    if out.len() as u64 > most {
        return Err(Error::new(
            ErrorKind::Format,
            format!("the {what} data unpack to more than {most} bytes"),
        )
        .advise("unpack the file first, and check that it is what it should be"));
    }
    Ok(out)
}

/// Without the feature `formats`: the error that says how to unpack the file.
#[cfg(not(feature = "formats"))]
pub(super) fn gunzip(_: &[u8]) -> Result<Vec<u8>, Error> {
    Err(Error::new(ErrorKind::Format, "the file is packed with gzip, which this build does not unpack")
        .advise("unpack it first, or build with the feature `formats`"))
}

/// Without the feature `formats`: the error that says how to save the file unpacked.
#[cfg(not(feature = "formats"))]
pub(super) fn inflate(_: &[u8], _: u64) -> Result<Vec<u8>, Error> {
    Err(Error::new(ErrorKind::Format, "the archive is packed, which this build does not unpack")
        .advise("save it with numpy.savez instead of savez_compressed, or build with the feature `formats`"))
}

#[cfg(all(test, feature = "formats"))]
mod tests {
    use super::*;
    use std::io::Write;

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
        out.write_all(bytes).unwrap();
        out.finish().unwrap()
    }

    #[test]
    fn members_are_joined_and_damage_is_refused() {
        let two = [gzip(b"1 2 3\n"), gzip(b"4 5 6\n")].concat();
        assert_eq!(gunzip(&two).unwrap(), b"1 2 3\n4 5 6\n");
        for end in 3..two.len() {
            if end != gzip(b"1 2 3\n").len() {
                assert!(gunzip(&two[..end]).is_err(), "{end}");
            }
        }
        let zeros = gzip(&[0; 100_000]);
        assert!(read_all(flate2::read::GzDecoder::new(&zeros[..]), 99_999, "gzip").is_err());
        assert_eq!(inflate(&zeros[10..zeros.len() - 8], 100_000).unwrap().len(), 100_000);
        assert!(inflate(&zeros[10..zeros.len() - 8], 100_001).is_err());
        assert!(inflate(&zeros[10..zeros.len() - 8], 99_999).is_err());
    }
}
