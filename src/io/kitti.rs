//! KITTI laser scans: bare rows of little-endian `f32` x, y, z, intensity.

use super::{Loaded, check_point};
use crate::{Error, ErrorKind};

const ROW: usize = 16;

/// Reads n x 3 points and drops the intensities.
pub(super) fn read(bytes: &[u8]) -> Result<Loaded, Error> {
    if !bytes.len().is_multiple_of(ROW) {
        return Err(Error::new(
            ErrorKind::Format,
            format!(
                "truncated: {} bytes are {} rows of {ROW} bytes and {} bytes more",
                bytes.len(),
                bytes.len() / ROW,
                bytes.len() % ROW
            ),
        )
        .advise("a KITTI scan is rows of 4 little-endian 32-bit floats: x, y, z, intensity"));
    }
    let mut verts = Vec::with_capacity(bytes.len() / ROW);
    for (i, row) in bytes.as_chunks::<ROW>().0.iter().enumerate() {
        let point = [0, 4, 8].map(|at| f32::from_le_bytes([row[at], row[at + 1], row[at + 2], row[at + 3]]));
        check_point(point, "point", i)?;
        verts.push(point);
    }
    Ok(Loaded { verts, notices: vec!["ignored the intensity column".to_string()], ..Loaded::default() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan(rows: &[[f32; 4]]) -> Vec<u8> {
        rows.iter().flatten().flat_map(|x| x.to_le_bytes()).collect()
    }

    #[test]
    fn reads_rows_and_drops_the_intensity() {
        let loaded = read(&scan(&[[1.0, 2.0, 3.0, 0.5], [-4.0, 5.0, -6.0, f32::NAN]])).unwrap();
        assert_eq!(loaded.verts, [[1.0, 2.0, 3.0], [-4.0, 5.0, -6.0]]);
        assert_eq!(loaded.notices, ["ignored the intensity column"]);
    }

    #[test]
    fn refuses_cut_rows_and_nan() {
        let bytes = scan(&[[1.0, 2.0, 3.0, 0.5], [1.0, f32::INFINITY, 3.0, 0.5]]);
        let e = read(&bytes[..17]).map(|l| l.verts).unwrap_err();
        assert!(e.to_string().contains("17 bytes are 1 rows of 16 bytes and 1 bytes more"), "{e}");
        let e = read(&bytes).map(|l| l.verts).unwrap_err();
        assert_eq!((e.kind(), e.element()), (ErrorKind::Data, Some("point 1")));
    }
}
