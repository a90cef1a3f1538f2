//! Polygons as triangles.

use crate::{Error, ErrorKind};

/// Cuts a polygon into triangles that share its first corner.
pub(super) fn push_fan(faces: &mut Vec<[u32; 3]>, polygon: &[i64]) -> Result<(), Error> {
    if polygon.len() < 3 {
        return Err(Error::new(
            ErrorKind::Format,
            format!("at least 3 corners expected, {} found", polygon.len()),
        )
        .advise("remove the face or export the file again"));
    }
    let index = |i: i64| {
        u32::try_from(i).map_err(|_| {
            Error::new(ErrorKind::Format, format!("vertex {i} is named, which is not a possible index"))
                .advise("the file is damaged; export it again")
        })
    };
    let first = index(polygon[0])?;
    let mut previous = index(polygon[1])?;
    for &corner in &polygon[2..] {
        let next = index(corner)?;
        faces.push([first, previous, next]);
        previous = next;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_become_fans() {
        let mut faces = Vec::new();
        for polygon in [&[0, 1, 2][..], &[7, 5, 6, 9, 8]] {
            push_fan(&mut faces, polygon).unwrap();
        }
        assert_eq!(faces, [[0, 1, 2], [7, 5, 6], [7, 6, 9], [7, 9, 8]]);
        for (polygon, message) in [
            (&[1, 2][..], "at least 3 corners expected, 2 found"),
            (&[0, 1, -1], "vertex -1 is named"),
            (&[1 << 32, 1, 2], "vertex 4294967296 is named"),
        ] {
            let e = push_fan(&mut faces, polygon).unwrap_err().to_string();
            assert!(e.contains(message), "{e}");
        }
    }
}
