//! NPY, the file format of one NumPy array, versions 1 to 3.
//!
//! The array is n rows of 3 or more columns of real numbers in either byte order and either storage order.

use super::text::show;
use super::{Loaded, check_point};
use crate::{Error, ErrorKind};

const MAGIC: &[u8] = b"\x93NUMPY";

/// Reads n x 3 points from the first three columns.
pub(super) fn read(bytes: &[u8]) -> Result<Loaded, Error> {
    let (header, data) = split(bytes)?;
    let number = Number::parse(&text_of(header, "descr")?)?;
    let fortran = match value_of(header, "fortran_order")? {
        v if v.starts_with("True") => true,
        v if v.starts_with("False") => false,
        v => {
            return Err(bad_header(format!("fortran_order is {}, not True or False", show(v.as_bytes()))));
        }
    };
    let (n, columns) = shape(value_of(header, "shape")?)?;

    let needed = n.checked_mul(columns).and_then(|e| e.checked_mul(number.size as u64));
    let Some(needed) = needed.filter(|&b| b <= data.len() as u64) else {
        return Err(Error::new(
            ErrorKind::Format,
            format!(
                "truncated: {n} x {columns} numbers of {} bytes promised, {} bytes are there",
                number.size,
                data.len()
            ),
        )
        .advise("fetch the file again"));
    };
    // Both fit in memory from here on: there are at least 3 bytes for each row.
    let (n, columns) = (n as usize, columns as usize);
    let mut verts = Vec::with_capacity(n);
    for row in 0..n {
        let at = |column: usize| if fortran { column * n + row } else { row * columns + column };
        let point = [0, 1, 2].map(|c| number.read(&data[at(c) * number.size..][..number.size]));
        check_point(point, "point", row)?;
        verts.push(point);
    }

    let mut notices = Vec::new();
    match columns - 3 {
        0 => {}
        1 => notices.push("ignored 1 extra column".to_string()),
        extra => notices.push(format!("ignored {extra} extra columns")),
    }
    let tail = data.len() as u64 - needed;
    if tail > 0 {
        notices.push(format!("ignored {tail} bytes behind the array"));
    }
    Ok(Loaded { verts, notices, ..Loaded::default() })
}

/// Cuts a file into the text of its header and the array's bytes.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), Error> {
    let short = || {
        Error::new(
            ErrorKind::Format,
            format!("truncated: the file ends in its header, at {} bytes", bytes.len()),
        )
        .advise("fetch the file again")
    };
    if !bytes.starts_with(MAGIC) {
        return Err(Error::new(ErrorKind::Format, "the file does not begin with the mark of an NPY file")
            .advise("write it with numpy.save(path, points)"));
    }
    let version = *bytes.get(6).ok_or_else(short)?;
    let (length, start) = match version {
        1 => {
            let b = bytes.get(8..10).ok_or_else(short)?;
            (u64::from(u16::from_le_bytes([b[0], b[1]])), 10)
        }
        2 | 3 => {
            let b = bytes.get(8..12).ok_or_else(short)?;
            (u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])), 12)
        }
        other => return Err(bad_header(format!("version {other} is unknown"))),
    };
    if length > (bytes.len() - start) as u64 {
        return Err(short());
    }
    let (header, data) = bytes[start..].split_at(length as usize);
    let header = std::str::from_utf8(header).map_err(|_| bad_header("the header is not text".to_string()))?;
    Ok((header, data))
}

/// What follows a key of the header, which is a Python dictionary.
fn value_of<'a>(header: &'a str, key: &str) -> Result<&'a str, Error> {
    let found = ['\'', '"'].iter().find_map(|q| header.split_once(&format!("{q}{key}{q}")));
    found
        .and_then(|(_, rest)| rest.trim_start().strip_prefix(':'))
        .map(str::trim_start)
        .ok_or_else(|| bad_header(format!("{key} is missing")))
}

fn text_of(header: &str, key: &str) -> Result<String, Error> {
    let value = value_of(header, key)?;
    let quoted = ['\'', '"'].iter().find_map(|&q| value.strip_prefix(q)?.split_once(q));
    quoted.map(|(text, _)| text.to_string()).ok_or_else(|| {
        bad_header(format!("{key} is {}, not one plain type", show(value.as_bytes())))
            .advise("save an array of one number type, such as points.astype('float32')")
    })
}

/// Rows and columns of a shape such as `(100, 3)`.
fn shape(value: &str) -> Result<(u64, u64), Error> {
    let wrong = |what: String| {
        Error::new(ErrorKind::Format, what)
            .at_element("NPY header")
            .advise("save an array of shape (n, 3), for example points.reshape(-1, 3)")
    };
    let inside = value.strip_prefix('(').and_then(|v| v.split_once(')')).map(|(inside, _)| inside.trim());
    let Some(inside) = inside else {
        return Err(wrong(format!("the shape is {}", show(value.as_bytes()))));
    };
    let sizes: Option<Vec<u64>> = inside
        .split(',')
        .map(str::trim)
        .filter(|s| !s.is_empty())
        .map(|s| s.trim_end_matches('L').parse().ok())
        .collect();
    match sizes.as_deref() {
        Some(&[n, columns]) if columns >= 3 => Ok((n, columns)),
        _ => Err(wrong(format!("the shape is ({}), not n rows of 3 or more columns", cut(inside)))),
    }
}

fn cut(text: &str) -> String {
    text.chars().take(32).map(|c| if c.is_control() { ' ' } else { c }).collect()
}

fn bad_header(what: String) -> Error {
    Error::new(ErrorKind::Format, what)
        .at_element("NPY header")
        .advise("write it with numpy.save(path, points)")
}

/// The type of the array's numbers.
struct Number {
    kind: u8,
    size: usize,
    big_endian: bool,
}

impl Number {
    fn parse(descr: &str) -> Result<Number, Error> {
        let unsupported = || {
            Error::new(
                ErrorKind::Format,
                format!("numbers of type {} are not supported", show(descr.as_bytes())),
            )
            .at_element("NPY header")
            .advise("save 32- or 64-bit floats or integers, for example points.astype('float32')")
        };
        let (order, rest) = match descr.as_bytes() {
            [order @ (b'<' | b'>' | b'=' | b'|'), rest @ ..] => (*order, rest),
            rest => (b'=', rest),
        };
        let (kind, size) = match rest {
            b"f4" => (b'f', 4),
            b"f8" => (b'f', 8),
            [kind @ (b'i' | b'u'), size @ (b'1' | b'2' | b'4' | b'8')] => (*kind, usize::from(size - b'0')),
            _ => return Err(unsupported()),
        };
        Ok(Number { kind, size, big_endian: order == b'>' })
    }

    /// The number in `size` bytes as `f32`; wide types are rounded to the nearest.
    fn read(&self, bytes: &[u8]) -> f32 {
        let mut word = [0; 8];
        for (to, i) in word.iter_mut().zip(0..self.size) {
            *to = bytes[if self.big_endian { self.size - 1 - i } else { i }];
        }
        let bits = u64::from_le_bytes(word);
        let unused = 64 - 8 * self.size as u32;
        match (self.kind, self.size) {
            (b'f', 4) => f32::from_bits(bits as u32),
            (b'f', _) => f64::from_bits(bits) as f32,
            (b'i', _) => ((bits << unused) as i64 >> unused) as f32,
            _ => bits as f32,
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// An NPY file with `header` as its dictionary.
    pub fn file(version: u8, header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend([version, 0]);
        let text = format!("{header}\n");
        match version {
            1 => bytes.extend((text.len() as u16).to_le_bytes()),
            _ => bytes.extend((text.len() as u32).to_le_bytes()),
        }
        bytes.extend(text.as_bytes());
        bytes.extend(data);
        bytes
    }

    /// The points as an NPY file of little-endian `f32`, row by row.
    pub fn write(points: &[[f32; 3]]) -> Vec<u8> {
        let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, 3), }}", points.len());
        let data: Vec<u8> = points.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        file(1, &header, &data)
    }

    fn array(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
        let order = if fortran { "True" } else { "False" };
        file(2, &format!("{{'shape': {shape}, \"fortran_order\": {order}, 'descr': '{descr}'}}"), data)
    }

    fn message(bytes: &[u8]) -> String {
        read(bytes).map(|l| l.verts).unwrap_err().to_string()
    }

    #[test]
    fn reads_every_type_byte_order_and_storage_order() {
        let rows = [[1.0, -2.0, 3.0, 9.0], [4.0, 5.0, -6.0, 9.0]];
        let columns: Vec<f64> = (0..4).flat_map(|c| rows.map(|r: [f64; 4]| r[c])).collect();
        for (fortran, values) in [(false, rows.as_flattened().to_vec()), (true, columns)] {
            let flat = |f: &dyn Fn(f64) -> Vec<u8>| values.iter().flat_map(|&x| f(x)).collect::<Vec<u8>>();
            let cases = [
                ("<f4", flat(&|x| (x as f32).to_le_bytes().to_vec())),
                (">f4", flat(&|x| (x as f32).to_be_bytes().to_vec())),
                ("<f8", flat(&|x| x.to_le_bytes().to_vec())),
                (">f8", flat(&|x| x.to_be_bytes().to_vec())),
                ("|i1", flat(&|x| (x as i8).to_le_bytes().to_vec())),
                (">i2", flat(&|x| (x as i16).to_be_bytes().to_vec())),
                ("<i4", flat(&|x| (x as i32).to_le_bytes().to_vec())),
                (">i4", flat(&|x| (x as i32).to_be_bytes().to_vec())),
                ("<i8", flat(&|x| (x as i64).to_le_bytes().to_vec())),
                (">i8", flat(&|x| (x as i64).to_be_bytes().to_vec())),
            ];
            for (descr, data) in cases {
                let loaded = read(&array(descr, fortran, "(2, 4)", &data)).unwrap();
                assert_eq!(loaded.verts, [[1.0, -2.0, 3.0], [4.0, 5.0, -6.0]], "{descr} {fortran}");
                assert_eq!(loaded.notices, ["ignored 1 extra column"]);
            }
        }
        let loaded = read(&array("|u1", false, "(1, 3)", &[1, 200, 255])).unwrap();
        assert_eq!(loaded.verts, [[1.0, 200.0, 255.0]]);
        let loaded = read(&array("|u1", false, "(1, 3)", &[1, 2, 3, 4])).unwrap();
        assert_eq!(loaded.notices, ["ignored 1 bytes behind the array"]);
        assert_eq!(read(&write(&[[0.5, 1.5, 2.5]])).unwrap().verts, [[0.5, 1.5, 2.5]]);
    }

    #[test]
    fn errors_say_what_to_save_instead() {
        assert!(message(b"PK\x03\x04").contains("mark of an NPY file"));
        assert!(message(b"\x93NUMPY\x01\x00\xff").contains("ends in its header, at 9 bytes"));
        assert!(message(&file(9, "{}", &[])).contains("version 9"));
        assert!(message(&file(1, "{}", &[])).contains("descr is missing"));
        assert!(message(&array("<c8", false, "(1, 3)", &[])).contains("\"<c8\" are not supported"));
        assert!(message(&file(1, "{'descr': [('x', '<f4')]}", &[])).contains("not one plain type"));
        assert!(message(&array("<f4", false, "(3,)", &[])).contains("the shape is (3,)"));
        assert!(message(&array("<f4", false, "(9, 2)", &[])).contains("reshape(-1, 3)"));
        assert!(message(&array("<f4", false, "(2, 3, 3)", &[])).contains("the shape is (2, 3, 3)"));
        assert!(
            message(&array("<f4", false, "(2, 3)", &[0; 20]))
                .contains("2 x 3 numbers of 4 bytes promised, 20 bytes are there")
        );
        // The product overflows 64 bits; nothing may be reserved for it.
        let huge = array("<f8", false, "(18446744073709551615, 18446744073709551615)", &[0; 24]);
        assert!(message(&huge).contains("truncated"));
        let nan: Vec<u8> = [0.0, f32::NAN, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        assert!(message(&array("<f4", false, "(1, 3)", &nan)).contains("point 0: y is NaN"));
        let wide: Vec<u8> = [0.0, 1e200, 0.0].iter().flat_map(|x: &f64| x.to_le_bytes()).collect();
        assert!(message(&array("<f8", false, "(1, 3)", &wide)).contains("not a finite 32-bit number"));
    }
}
