//! VTK, the older ("legacy") format, text or binary: the points of poly data, of unstructured and structured grids with
//! their normals and attributes, and the places of an image. Binary numbers are big-endian.

use super::number::{ByteOrder, NumberType};
use super::precision::check_point;
use super::text::{Lines, float, integer, not_a_number, show, words};
use super::{Loaded, Want};
use crate::geometry::{Attribute, COLOUR, Number};
use crate::{Error, ErrorKind};

/// Attributes that are read at most.
const MAX_ATTRIBUTES: usize = 64;

const MAGIC: &[u8] = b"# vtk DataFile Version";

/// Whether the bytes begin with the first line of a legacy VTK file.
pub(super) fn looks_like_vtk(bytes: &[u8]) -> bool {
    bytes.len() >= MAGIC.len() && bytes[..MAGIC.len()].eq_ignore_ascii_case(MAGIC)
}

/// The bytes behind the header, of which words and lines are taken.
struct Rest<'a> {
    bytes: &'a [u8],
    at: usize,
    line: u64,
}

impl<'a> Rest<'a> {
    fn next_line(&mut self) -> Option<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return None;
        }
        let end = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        self.at += (end + 1).min(rest.len());
        self.line += 1;
        Some(rest[..end].trim_ascii())
    }

    /// The next word, on whatever line.
    fn next_word(&mut self) -> Option<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|b| !b.is_ascii_whitespace())?;
        let length = rest[start..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - start);
        self.at += start + length;
        Some(&rest[start..start + length])
    }

    /// So many numbers of a type.
    fn numbers(&mut self, count: usize, number: NumberType, binary: bool) -> Option<Vec<f64>> {
        let left = self.bytes.len() - self.at;
        if !binary {
            // Each takes a byte at least, so a false count reserves nothing.
            return (count <= left).then(|| (0..count).map(|_| float(self.next_word()?)).collect())?;
        }
        let bytes = count.checked_mul(number.size()).filter(|bytes| *bytes <= left)?;
        let body = &self.bytes[self.at..self.at + bytes];
        self.at += bytes;
        Some(body.chunks_exact(number.size()).map(|bytes| number.read(bytes, ByteOrder::Big)).collect())
    }

    /// The next line that is not empty.
    fn next_words(&mut self) -> Option<&'a [u8]> {
        loop {
            let line = self.next_line()?;
            if !line.is_empty() {
                return Some(line);
            }
        }
    }
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
                if data(&mut rest, binary, want, &mut loaded).is_none() && want == Want::Attributes {
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

/// Reads what the file has of each point behind the points, as far as it is understood; `None` if that is not to the
/// end.
fn data(rest: &mut Rest<'_>, binary: bool, want: Want, loaded: &mut Loaded) -> Option<()> {
    let points = loaded.verts.len();
    // Of what the numbers are: of points, or of cells, which are passed over.
    let (mut of_points, mut tuples) = (false, 0);
    let int = number_type(b"int")?;
    while let Some(line) = rest.next_words() {
        let parts: Vec<&[u8]> = words(line).collect();
        let count = |i: usize| usize::try_from(parts.get(i).and_then(|w| integer(w))?).ok();
        let kind = |i: usize| parts.get(i).and_then(|w| number_type(&w.to_ascii_lowercase()));
        let name = |word: &[u8]| String::from_utf8_lossy(word).into_owned();
        let mut put = |name: String, width: usize, number: NumberType, values: Vec<f64>, colour: bool| {
            let fits = width.checked_mul(points) == Some(values.len());
            if of_points && want == Want::Attributes && fits {
                push(&mut loaded.attributes, &name, width, number.kept_as(), &values, colour);
            }
        };
        match parts[0].to_ascii_uppercase().as_slice() {
            b"VERTICES" | b"LINES" | b"POLYGONS" | b"TRIANGLE_STRIPS" | b"CELLS" => {
                let (first, second) = (count(1)?, count(2)?);
                let here = (rest.at, rest.line);
                let next: Vec<&[u8]> = words(rest.next_words().unwrap_or_default()).collect();
                if next.first().is_some_and(|w| w.eq_ignore_ascii_case(b"OFFSETS")) {
                    // Since version 5.
                    let offsets = number_type(&next.get(1)?.to_ascii_lowercase())?;
                    rest.numbers(first, offsets, binary)?;
                    let next: Vec<&[u8]> = words(rest.next_words()?).collect();
                    rest.numbers(second, number_type(&next.get(1)?.to_ascii_lowercase())?, binary)?;
                } else {
                    (rest.at, rest.line) = here;
                    rest.numbers(second, int, binary)?;
                }
            }
            b"CELL_TYPES" => drop(rest.numbers(count(1)?, int, binary)?),
            b"POINT_DATA" => (of_points, tuples) = (count(1)? == points, count(1)?),
            b"CELL_DATA" => (of_points, tuples) = (false, count(1)?),
            b"SCALARS" => {
                let (number, width) = (kind(2)?, if parts.len() > 3 { count(3)? } else { 1 });
                let here = (rest.at, rest.line);
                if !rest.next_words()?.to_ascii_uppercase().starts_with(b"LOOKUP_TABLE") {
                    (rest.at, rest.line) = here;
                }
                let values = rest.numbers(tuples.checked_mul(width)?, number, binary)?;
                let colour = width >= 3 && number.size() == 1;
                put(name(parts.get(1)?), width, number, values, colour);
            }
            b"COLOR_SCALARS" => {
                let (width, number) =
                    (count(2)?, number_type(if binary { b"unsigned_char" } else { b"float" })?);
                let values = rest.numbers(tuples.checked_mul(width)?, number, binary)?;
                put(name(parts.get(1)?), width, number, values, width >= 3);
            }
            b"LOOKUP_TABLE" => {
                drop(rest.numbers(count(2)?.checked_mul(4)?, number_type(b"unsigned_char")?, binary)?);
            }
            b"NORMALS" => {
                let number = kind(2)?;
                let values = rest.numbers(tuples.checked_mul(3)?, number, binary)?;
                if of_points && want != Want::Mesh {
                    let rows = values.as_chunks::<3>().0;
                    loaded.normals = rows.iter().map(|n| n.map(|x| x as f32)).collect();
                }
            }
            b"VECTORS" | b"TENSORS" => {
                let width = if parts[0].eq_ignore_ascii_case(b"VECTORS") { 3 } else { 9 };
                let number = kind(2)?;
                let values = rest.numbers(tuples.checked_mul(width)?, number, binary)?;
                put(name(parts.get(1)?), width, number, values, false);
            }
            b"TEXTURE_COORDINATES" => {
                let (width, number) = (count(2)?, kind(3)?);
                let values = rest.numbers(tuples.checked_mul(width)?, number, binary)?;
                put(name(parts.get(1)?), width, number, values, false);
            }
            b"FIELD" => {
                for _ in 0..count(2)? {
                    let head: Vec<&[u8]> = words(rest.next_words()?).collect();
                    let size = |i: usize| usize::try_from(head.get(i).and_then(|w| integer(w))?).ok();
                    let number = number_type(&head.get(3)?.to_ascii_lowercase())?;
                    let width = size(1)?;
                    let values = rest.numbers(width.checked_mul(size(2)?)?, number, binary)?;
                    let name = name(head[0]);
                    let colour = width >= 3 && number.size() == 1 && name.to_lowercase().contains("rgb");
                    put(name, width, number, values, colour);
                }
            }
            // Lines up to an empty one.
            b"METADATA" => while rest.next_line().is_some_and(|line| !line.is_empty()) {},
            _ => return None,
        }
    }
    Some(())
}

/// Takes n rows of `width` values as attributes.
fn push(all: &mut Vec<Attribute>, name: &str, width: usize, number: Number, values: &[f64], colour: bool) {
    let parts: &[&str] = if colour { &COLOUR } else { &[] };
    for column in 0..width {
        let name = match parts.get(column) {
            Some(part) => part.to_string(),
            None if width == 1 => name.to_string(),
            None => format!("{name}_{}", column + 1),
        };
        if all.len() < MAX_ATTRIBUTES && all.iter().all(|a| a.name != name) {
            let values = values.iter().skip(column).step_by(width).copied().collect();
            all.push(Attribute { name, number, values });
        }
    }
}

/// The places of an image, which it does not list.
struct Image {
    size: Option<[f64; 3]>,
    origin: [f64; 3],
    spacing: [f64; 3],
}

impl Default for Image {
    fn default() -> Self {
        Image { size: None, origin: [0.0; 3], spacing: [1.0; 3] }
    }
}

impl Image {
    fn places(&self, size: [f64; 3], bytes: usize, want: Want) -> Result<Loaded, Error> {
        let total: f64 = size.iter().product();
        // Each place has a number at least, so a false size reserves nothing.
        if size.iter().any(|n| *n < 1.0 || n.fract() != 0.0) || total > bytes as f64 {
            return Err(wrong(format!(
                "an image of {} x {} x {} places does not fit the {bytes} bytes of its data",
                size[0], size[1], size[2]
            )));
        }
        let [nx, ny, nz] = size.map(|n| n as u64);
        let mut loaded = Loaded::default();
        loaded.warnings.push(format!(
            "the file is an image of {nx} x {ny} x {nz} places, not a list of points; its places were read as points"
        ));
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let at = [x, y, z];
                    let point = [0, 1, 2].map(|a| self.origin[a] + at[a] as f64 * self.spacing[a]);
                    check_point(point, want, "point", loaded.verts.len())?;
                    loaded.verts.push(point);
                }
            }
        }
        Ok(loaded)
    }
}

/// The type of numbers that goes by this name, in small letters.
fn number_type(name: &[u8]) -> Option<NumberType> {
    Some(match name {
        b"float" => NumberType::F32,
        b"double" => NumberType::F64,
        b"char" => NumberType::I8,
        b"unsigned_char" => NumberType::U8,
        b"short" => NumberType::I16,
        b"unsigned_short" => NumberType::U16,
        b"int" | b"vtkidtype" => NumberType::I32,
        b"unsigned_int" => NumberType::U32,
        b"long" | b"vtktypeint64" => NumberType::I64,
        b"unsigned_long" | b"vtktypeuint64" => NumberType::U64,
        _ => return None,
    })
}

fn wrong(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, what).advise("the file is damaged or not legacy VTK; export it again")
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const POINTS: [[f64; 3]; 3] = [[1.0, 2.0, 3.0], [-4.5, 0.25, 6.0], [7.0, 8.0, -9.0]];

    fn head(encoding: &str, rest: &str) -> String {
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

    /// Text and binary, the cells of old and new versions, and every kind of data.
    #[test]
    fn normals_and_attributes_are_read_if_asked_for() {
        let text = head(
            "ASCII",
            "DATASET POLYDATA\nPOINTS 3 float\n1 2 3 -4.5 .25 6 7 8 -9\nVERTICES 1 4\n3 0 1 2\nCELL_DATA 1\n\
             SCALARS odd int\nLOOKUP_TABLE default\n5\nPOINT_DATA 3\nSCALARS heat float 1\nLOOKUP_TABLE default\n\
             0.5 1\n1.5\nMETADATA\nINFORMATION 0\n\nNORMALS up float\n0 0 1 0 1 0 1 0 0\nCOLOR_SCALARS paint 3\n\
             1 0 0.5 0 0 0 1 1 1\nVECTORS flow double\n1 2 3 4 5 6 7 8 9\nFIELD FieldData 2\nclass 1 3 unsigned_char\n\
             2 6 9\npair 2 3 int\n1 2 3 4 5 6\n",
        );
        let loaded = read(text.as_bytes(), Want::Attributes).unwrap();
        let found: Vec<(&str, Number, &[f64])> =
            loaded.attributes.iter().map(|a| (a.name.as_str(), a.number, &a.values[..])).collect();
        let want: [(&str, Number, &[f64]); 10] = [
            ("heat", Number::F32, &[0.5, 1.0, 1.5]),
            ("red", Number::F32, &[1.0, 0.0, 1.0]),
            ("green", Number::F32, &[0.0, 0.0, 1.0]),
            ("blue", Number::F32, &[0.5, 0.0, 1.0]),
            ("flow_1", Number::F64, &[1.0, 4.0, 7.0]),
            ("flow_2", Number::F64, &[2.0, 5.0, 8.0]),
            ("flow_3", Number::F64, &[3.0, 6.0, 9.0]),
            ("class", Number::U8, &[2.0, 6.0, 9.0]),
            ("pair_1", Number::I32, &[1.0, 3.0, 5.0]),
            ("pair_2", Number::I32, &[2.0, 4.0, 6.0]),
        ];
        assert_eq!((found, loaded.notices.len()), (want.to_vec(), 0));
        assert_eq!(loaded.normals, [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]);
        let plain = read(text.as_bytes(), Want::Cloud).unwrap();
        assert!(plain.attributes.is_empty() && plain.normals.len() == 3);
        let cells = [
            [&b"\nVERTICES 1 4\n"[..], &[3, 0, 1, 2].map(u32::to_be_bytes).concat()].concat(),
            [
                &b"\nVERTICES 2 3\nOFFSETS vtktypeint64\n"[..],
                &[0, 3].map(u64::to_be_bytes).concat(),
                b"\nCONNECTIVITY vtktypeint64\n",
                &[0, 1, 2].map(u64::to_be_bytes).concat(),
            ]
            .concat(),
        ];
        for cells in cells {
            let mut bytes = head("BINARY", "DATASET POLYDATA\nPOINTS 3 float\n").into_bytes();
            bytes.extend(POINTS.as_flattened().iter().flat_map(|x| (*x as f32).to_be_bytes()));
            bytes.extend(cells);
            bytes.extend(b"\nPOINT_DATA 3\nSCALARS depth short\nLOOKUP_TABLE default\n");
            bytes.extend([1i16, -2, 300].map(i16::to_be_bytes).concat());
            bytes.extend(b"\nCOLOR_SCALARS rgb 3\n\x01\x02\x03\x04\x05\x06\x07\x08\x09\n");
            let found = read(&bytes, Want::Attributes).unwrap().attributes;
            let names: Vec<&str> = found.iter().map(|a| a.name.as_str()).collect();
            assert_eq!(names, ["depth", "red", "green", "blue"]);
            assert_eq!(
                (&found[0].values[..], &found[3].values[..]),
                (&[1.0, -2.0, 300.0][..], &[3.0, 6.0, 9.0][..])
            );
            // A width beyond all numbers is no width.
            let mut odd = bytes.clone();
            odd.extend(b"FIELD FieldData 1\nwide 9223372036854775807 0 float\n");
            assert_eq!(read(&odd, Want::Attributes).unwrap().attributes.len(), 4);
            // Whatever is cut off behind the points, these are there.
            for end in bytes.len() - 60..bytes.len() {
                let cut = read(&bytes[..end], Want::Attributes).unwrap();
                assert!(cut.verts == POINTS && cut.attributes.iter().all(|a| a.values.len() == 3), "{end}");
            }
        }
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
