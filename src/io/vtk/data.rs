//! What stands behind the points of a VTK file: cells, which are passed over, and the data of the points.

use super::super::number::NumberType;
use super::super::text::{integer, words};
use super::super::{Loaded, MAX_ATTRIBUTES, Want};
use super::rest::{Rest, number_type};
use crate::geometry::{Attribute, COLOUR, Number};

/// The names of the sections that may follow the points.
pub(super) const SECTIONS: [&[u8]; 17] = [
    b"VERTICES",
    b"LINES",
    b"POLYGONS",
    b"TRIANGLE_STRIPS",
    b"CELLS",
    b"CELL_TYPES",
    b"POINT_DATA",
    b"CELL_DATA",
    b"SCALARS",
    b"COLOR_SCALARS",
    b"LOOKUP_TABLE",
    b"NORMALS",
    b"VECTORS",
    b"TENSORS",
    b"TEXTURE_COORDINATES",
    b"FIELD",
    b"METADATA",
];

/// Reads what the file has of each point behind the points, as far as it is understood: normals, and attributes if
/// they are wanted. `None` if something is not understood or cut short; what came before it is kept.
pub(super) fn read(rest: &mut Rest<'_>, binary: bool, want: Want, loaded: &mut Loaded) -> Option<()> {
    let points = loaded.verts.len();
    // Whether the next numbers are those of points (else of cells, which are passed over), and of how many.
    let (mut of_points, mut tuples) = (false, 0);
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
                    rest.numbers(second, NumberType::I32, binary)?;
                }
            }
            b"CELL_TYPES" => drop(rest.numbers(count(1)?, NumberType::I32, binary)?),
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
                let (width, number) = (count(2)?, if binary { NumberType::U8 } else { NumberType::F32 });
                let values = rest.numbers(tuples.checked_mul(width)?, number, binary)?;
                put(name(parts.get(1)?), width, number, values, width >= 3);
            }
            b"LOOKUP_TABLE" => {
                drop(rest.numbers(count(2)?.checked_mul(4)?, NumberType::U8, binary)?);
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

#[cfg(test)]
mod tests {
    use super::super::read;
    use super::super::tests::{POINTS, head};
    use super::*;

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
}
