//! VTK, the older ("legacy") format, text or binary: the points of poly data, of unstructured and structured grids with
//! their normals and attributes, and the places of an image. Binary numbers are big-endian.

use super::number::ByteOrder;
use super::precision::check_point;
use super::text::{Lines, float, integer, not_a_number, show, words};
use super::{Loaded, Want};
use crate::{Error, ErrorKind};

mod data;
mod image;
mod rest;

use image::Image;
use rest::{Rest, number_type, wrong};

const MAGIC: &[u8] = b"# vtk DataFile Version";

/// Whether the bytes begin with the first line of a legacy VTK file.
pub(super) fn looks_like_vtk(bytes: &[u8]) -> bool {
    bytes.len() >= MAGIC.len() && bytes[..MAGIC.len()].eq_ignore_ascii_case(MAGIC)
}

/// Reads n x 3 points.
pub(super) fn read(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    let mut rest = Rest { bytes, at: 0, line: 0 };
    if !looks_like_vtk(bytes) {
        return Err(wrong("the file does not begin with \"# vtk DataFile Version\"").at_line(1));
    }
    // The first line, and the title, which may be empty.
    rest.next_line();
    rest.next_line();
    let encoding = rest.next_words().unwrap_or_default();
    let binary = match encoding {
        e if e.eq_ignore_ascii_case(b"ASCII") => false,
        e if e.eq_ignore_ascii_case(b"BINARY") => true,
        other => {
            return Err(wrong(format!("{} is neither ASCII nor BINARY", show(other))).at_line(rest.line));
        }
    };
    let mut kind: &[u8] = b"";
    let mut image = Image::default();
    // The header ends at the points, at the data of an image, or at the end.
    while let Some(line) = rest.next_words() {
        let number = rest.line;
        let at = |e: Error| e.at_line(number);
        let parts: Vec<&[u8]> = words(line).collect();
        let three = |parts: &[&[u8]]| -> Result<[f64; 3], Error> {
            let numbers: Option<Vec<f64>> = parts[1..].iter().map(|w| float(w)).collect();
            match numbers.as_deref() {
                Some(&[a, b, c]) => Ok([a, b, c]),
                _ => Err(at(wrong(format!("three numbers expected behind {}", show(parts[0]))))),
            }
        };
        match parts[0].to_ascii_uppercase().as_slice() {
            b"DATASET" => {
                kind = parts.get(1).copied().unwrap_or_default();
                if kind.eq_ignore_ascii_case(b"RECTILINEAR_GRID") || kind.eq_ignore_ascii_case(b"FIELD") {
                    return Err(Error::new(
                        ErrorKind::Format,
                        format!("a {} has no list of points", String::from_utf8_lossy(kind)),
                    )
                    .at_line(number)
                    .advise("extract the points as poly data and save those"));
                }
            }
            b"POINTS" => {
                let mut loaded = points(&parts, &mut rest, binary, want).map_err(at)?;
                let more = more_points(&parts, &rest, binary);
                if more > 0 {
                    let read = loaded.verts.len() as u64;
                    loaded.warn_of_rest("points", read, read + more as u64);
                } else if data::read(&mut rest, binary, want, &mut loaded).is_none()
                    && want == Want::Attributes
                {
                    loaded.notices.push("what stands behind the points was not read to its end".into());
                }
                return Ok(loaded);
            }
            b"DIMENSIONS" if kind.eq_ignore_ascii_case(b"STRUCTURED_POINTS") => {
                image.size = Some(three(&parts)?);
            }
            b"ORIGIN" => image.origin = three(&parts)?,
            b"SPACING" | b"ASPECT_RATIO" => image.spacing = three(&parts)?,
            b"POINT_DATA" | b"CELL_DATA" if image.size.is_some() => break,
            // Fields in front of the points, in text; the lines of their numbers are passed over.
            b"DIMENSIONS" | b"FIELD" | b"METADATA" | b"INFORMATION" | b"NAME" | b"DATA" => {}
            _ if kind.is_empty() => {
                return Err(at(wrong(format!("a line DATASET expected, {} found", show(line)))));
            }
            _ => {}
        }
    }
    match image.size {
        Some(size) => image.places(size, bytes.len() - rest.at, want),
        None => Err(wrong("truncated: the file has no line POINTS")),
    }
}

/// How many points more than promised stand in front of whatever comes behind the points.
fn more_points(parts: &[&[u8]], rest: &Rest<'_>, binary: bool) -> usize {
    let body = &rest.bytes[rest.at..];
    if !binary {
        let numbers = words(body).take_while(|w| float(w).is_some()).count();
        return numbers / 3;
    }
    let Some(number) = parts.get(2).and_then(|w| number_type(&w.to_ascii_lowercase())) else { return 0 };
    // Behind the points the file ends, or a line begins with the name of a section, be it one that is not known.
    let begins = |rest: &[u8]| {
        data::SECTIONS.iter().any(|name| {
            let word = rest.get(..name.len()).is_some_and(|w| w.eq_ignore_ascii_case(name));
            word && rest.get(name.len()).is_none_or(u8::is_ascii_whitespace)
        })
    };
    let mut name = body.trim_ascii_start().split(u8::is_ascii_whitespace);
    let letters = |word: &[u8]| word.len() >= 4 && word.iter().all(|b| b.is_ascii_alphabetic() || *b == b'_');
    if name.next().is_some_and(letters) {
        return 0;
    }
    let end = (0..body.len()).find(|&at| body[at] == b'\n' && begins(&body[at + 1..]));
    // A file may end with the end of a line.
    let end = end.unwrap_or(body.len() - usize::from(body.ends_with(b"\n")));
    end / (3 * number.size())
}

/// The points behind a line such as `POINTS 60 float`.
fn points(parts: &[&[u8]], rest: &mut Rest<'_>, binary: bool, want: Want) -> Result<Loaded, Error> {
    let count = parts.get(1).and_then(|w| integer(w)).and_then(|n| u64::try_from(n).ok());
    let Some(count) = count else { return Err(wrong("POINTS is followed by no count")) };
    let name = parts.get(2).map_or(Vec::new(), |w| w.to_ascii_lowercase());
    let body = &rest.bytes[rest.at..];
    let number = number_type(&name).ok_or_else(|| wrong(format!("{} is no type of numbers", show(&name))))?;
    // In text a number takes two bytes with what separates it.
    let least = if binary { number.size() as u64 } else { 2 };
    let needed = count.checked_mul(3).and_then(|n| n.checked_mul(least));
    if needed.is_none_or(|n| n > body.len() as u64 + 1) || (binary && needed > Some(body.len() as u64)) {
        return Err(Error::new(
            ErrorKind::Format,
            format!("truncated: {count} points promised, {} bytes are there", body.len()),
        )
        .advise("fetch the file again; if it is whole, its count is wrong"));
    }
    let count = count as usize;
    let mut loaded = Loaded::default();
    loaded.verts.reserve_exact(count);
    if binary {
        for i in 0..count {
            let row = &body[i * 3 * number.size()..];
            let point = [0, 1, 2].map(|a| number.read(&row[a * number.size()..], ByteOrder::Big));
            check_point(point, want, "point", i)?;
            loaded.verts.push(point);
        }
        rest.at += count * 3 * number.size();
        return Ok(loaded);
    }
    let (mut point, mut axis) = ([0.0; 3], 0);
    let start = body.as_ptr() as usize;
    'lines: for (line, text) in Lines::after(body, rest.line) {
        for word in words(text) {
            if loaded.verts.len() == count {
                break 'lines;
            }
            let at = |e: Error| e.at_line(line).at_element(format!("point {}", loaded.verts.len()));
            point[axis] = float(word).ok_or_else(|| not_a_number(word)).map_err(at)?;
            axis = (axis + 1) % 3;
            if axis == 0 {
                if loaded.verts.len() + 1 == count {
                    rest.at += word.as_ptr() as usize - start + word.len();
                }
                check_point(point, want, "point", loaded.verts.len()).map_err(|e| e.at_line(line))?;
                loaded.verts.push(point);
            }
        }
    }
    if loaded.verts.len() < count {
        return Err(Error::new(
            ErrorKind::Format,
            format!("truncated: {count} points promised, {} are there", loaded.verts.len()),
        )
        .advise("fetch the file again; if it is whole, its count is wrong"));
    }
    Ok(loaded)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub const POINTS: [[f64; 3]; 3] = [[1.0, 2.0, 3.0], [-4.5, 0.25, 6.0], [7.0, 8.0, -9.0]];

    /// The head of a file in front of `rest`.
    pub fn head(encoding: &str, rest: &str) -> String {
        format!("# vtk DataFile Version 3.0\nmade by hand\n{encoding}\n{rest}")
    }

    /// A binary file of the points.
    pub fn sample() -> Vec<u8> {
        let mut bytes = head("BINARY", "DATASET POLYDATA\nPOINTS 3 float\n").into_bytes();
        bytes.extend(POINTS.as_flattened().iter().flat_map(|x| (*x as f32).to_be_bytes()));
        bytes.extend(b"\nVERTICES 1 4\n");
        bytes
    }

    #[test]
    fn reads_points_of_every_kind() {
        let text = "1 2 3 -4.5 .25\n6\n\n7 8 -9\nVERTICES 1 4\n3 0 1 2\n";
        for data in [
            "DATASET POLYDATA\nPOINTS 3 float\n".to_string(),
            "DATASET UNSTRUCTURED_GRID\npoints 3 double\n".into(),
            "DATASET STRUCTURED_GRID\nDIMENSIONS 3 1 1\nPOINTS 3 float\n".into(),
            "\nDATASET POLYDATA\nFIELD FieldData 1\nTIME 1 1 double\n0.5\nPOINTS 3 float\n".into(),
        ] {
            let file = head("ASCII", &(data + text));
            let loaded = read(file.as_bytes(), Want::Cloud).unwrap_or_else(|e| panic!("{file}: {e}"));
            assert_eq!(loaded.verts, POINTS);
        }
        assert_eq!(read(&sample(), Want::Cloud).unwrap().verts, POINTS);
        let mut doubles = head("BINARY", "DATASET UNSTRUCTURED_GRID\nPOINTS 3 double\n").into_bytes();
        doubles.extend(POINTS.as_flattened().iter().flat_map(|x| x.to_be_bytes()));
        assert_eq!(read(&doubles, Want::Cloud).unwrap().verts, POINTS);
        let mut shorts = head("BINARY", "DATASET POLYDATA\nPOINTS 1 short\n").into_bytes();
        shorts.extend([0, 1, 255, 254, 1, 0]);
        assert_eq!(read(&shorts, Want::Cloud).unwrap().verts, [[1.0, -2.0, 256.0]]);
        let image = head(
            "ASCII",
            "DATASET STRUCTURED_POINTS\nDIMENSIONS 2 1 2\nORIGIN 1 0 0\nSPACING 0.5 1 2\nPOINT_DATA 4\n1 1 1 1\n",
        );
        let loaded = read(image.as_bytes(), Want::Cloud).unwrap();
        assert_eq!(loaded.verts, [[1.0, 0.0, 0.0], [1.5, 0.0, 0.0], [1.0, 0.0, 2.0], [1.5, 0.0, 2.0]]);
        assert!(loaded.warnings[0].contains("image of 2 x 1 x 2 places"));
    }

    #[test]
    fn a_count_that_is_too_small_is_warned_of() {
        let expected = "the header promises 2 points, 3 are there; the last 1 were not read";
        let text = "DATASET POLYDATA\nPOINTS 2 float\n1 2 3 -4.5 .25\n6\n\n7 8 -9\n";
        for behind in ["", "VERTICES 1 4\n3 0 1 2\n", "0.5\n"] {
            let loaded = read(head("ASCII", &format!("{text}{behind}")).as_bytes(), Want::Cloud).unwrap();
            assert_eq!((loaded.verts, loaded.warnings), (POINTS[..2].to_vec(), vec![expected.to_string()]));
        }
        let binary = |count: usize, behind: &[u8]| {
            let head = head("BINARY", &format!("DATASET POLYDATA\nPOINTS {count} float\n"));
            let rows = POINTS.as_flattened().iter().flat_map(|x| (*x as f32).to_be_bytes()).collect();
            let loaded =
                read(&[head.into_bytes(), rows, behind.to_vec()].concat(), Want::Attributes).unwrap();
            assert_eq!(loaded.verts, POINTS[..count]);
            loaded.warnings
        };
        let cells = [&b"\nVERTICES 1 4\n"[..], &[3, 0, 1, 2].map(u32::to_be_bytes).concat()].concat();
        let data = b"\nPOINT_DATA 3\nSCALARS heat float 1\nLOOKUP_TABLE default\n0123456789ab";
        for behind in [&b""[..], b"\n", b"1234567890a\n", b"1234567890a\nLINES 0 0\n", &cells, data] {
            assert_eq!(binary(2, behind), [expected]);
            assert!(binary(3, behind).is_empty());
        }
        assert!(binary(3, b"\nSOMETHING_NEW 1 float\n0123456789ab").is_empty());
        // Some programs do not end the line of the numbers.
        assert!(binary(3, &cells[1..]).is_empty());
    }

    #[test]
    fn what_is_wrong_is_said() {
        let cases = [
            (
                "# vtk DataFile Version 3.0\n\nTEXT\n".to_string(),
                "line 3: \"TEXT\" is neither ASCII nor BINARY",
            ),
            (head("ASCII", "POLYDATA\n"), "line 4: a line DATASET expected"),
            (head("ASCII", "DATASET RECTILINEAR_GRID\n"), "no list of points"),
            (head("ASCII", "DATASET POLYDATA\n"), "no line POINTS"),
            (head("ASCII", "DATASET POLYDATA\nPOINTS x float\n"), "line 5: POINTS is followed by no count"),
            (head("ASCII", "DATASET POLYDATA\nPOINTS 2 float\n1 2 3 4 5\n"), "2 points promised, 10 bytes"),
            (
                head("ASCII", "DATASET POLYDATA\nPOINTS 2 float\n1 2 3 4.00 5\n"),
                "2 points promised, 1 are there",
            ),
            (head("ASCII", "DATASET POLYDATA\nPOINTS 1 float\n1 2 x\n"), "point 0: \"x\" is not a number"),
            (head("BINARY", "DATASET POLYDATA\nPOINTS 1 half\n"), "\"half\" is no type"),
            (head("BINARY", "DATASET POLYDATA\nPOINTS 99999999999999 float\n"), "promised"),
            (
                head("ASCII", "DATASET STRUCTURED_POINTS\nDIMENSIONS 9999 9999 9999\nPOINT_DATA 1\n1\n"),
                "does not fit",
            ),
        ];
        for (file, message) in cases {
            let e = read(file.as_bytes(), Want::Cloud).map(|l| l.verts).unwrap_err().to_string();
            assert!(e.contains(message), "{file}: {e}");
        }
    }
}
