//! The header of a PLY file, checked before anything trusts it.
//!
//! The `ply_rs` parser takes a header at its word: a repeated name silently replaces the first one, a count is believed
//! until the bytes run out, a line may be as long as the file, and names outside its grammar or a comment that is not
//! UTF-8 fail the file. So the header is read here, under limits, and `ply_rs` gets definitions that are known to fit.

use ply_rs::ply::{Addable, ElementDef, Encoding, PropertyDef, PropertyType, ScalarType};

use super::super::number::NumberType;
use super::super::text::{show, words};
use crate::{Error, ErrorKind};

const MAX_LINE: usize = 64 << 10;
const MAX_HEADER: usize = 4 << 20;
const MAX_PROPERTIES: usize = 4096;

/// A header whose promises fit the bytes that follow it.
pub(super) struct Header {
    pub encoding: Encoding,
    pub elements: Vec<ElementDef>,
    /// Where the data begin.
    pub body: usize,
    /// How many lines the header has.
    pub lines: u64,
}

impl Header {
    /// Reads and checks the header of a whole file.
    pub(super) fn parse(bytes: &[u8]) -> Result<Header, Error> {
        let mut lines = HeaderLines::new(bytes)?;
        let mut encoding = None;
        let mut elements: Vec<ElementDef> = Vec::new();
        loop {
            let line = lines.next_line()?;
            let number = lines.number;
            let mut parts = words(line);
            // Comments may hold any bytes, so only the first word is looked at before them.
            let Some(keyword) = parts.next() else { continue };
            if matches!(keyword, b"comment" | b"obj_info") {
                continue;
            }
            let parts: Vec<&[u8]> = parts.take(6).collect();
            let result = match (keyword, parts.as_slice()) {
                (b"end_header", []) => break,
                (b"format", parts) if encoding.is_none() => parse_format(parts).map(|e| encoding = Some(e)),
                (b"format", _) => Err(wrong("a second format line")),
                (b"element", &[name, count]) => add_element(&mut elements, name, count),
                (b"property", parts) => add_property(&mut elements, parts),
                _ => Err(wrong(format!("{} is not a PLY header line", show(line)))),
            };
            result.map_err(|e| e.at_line(number))?;
        }
        let encoding = encoding.ok_or_else(|| wrong("the header has no format line"))?;
        let header = Header { encoding, elements, body: lines.at, lines: lines.number };
        header.check_elements()?;
        header.check_counts(bytes.len() - header.body)?;
        Ok(header)
    }

    /// The element of this name.
    pub(super) fn element(&self, name: &str) -> Option<&ElementDef> {
        self.elements.iter().find(|e| e.name == name)
    }

    fn check_elements(&self) -> Result<(), Error> {
        if let Some(e) = self.elements.iter().find(|e| e.properties.is_empty()) {
            return Err(wrong("the element has no properties").at_element(format!("element {}", e.name)));
        }
        let Some(vertex) = self.element("vertex") else {
            let names: Vec<&str> = self.elements.iter().take(8).map(|e| e.name.as_str()).collect();
            return Err(Error::new(
                ErrorKind::Format,
                format!("the file has no element vertex, only [{}]", names.join(", ")),
            )
            .advise("export the points as element vertex with properties x, y, z"));
        };
        for axis in ["x", "y", "z"] {
            let fits = |name: &&String| name.eq_ignore_ascii_case(axis);
            let mut found = vertex.properties.keys().filter(fits);
            let scalar = found.next().and_then(|name| vertex.properties.get(name));
            if found.next().is_some() {
                return Err(wrong(format!("there are two properties {axis}, in small and capital letters"))
                    .at_element("element vertex"));
            }
            if !scalar.is_some_and(|p| matches!(p.data_type, PropertyType::Scalar(_))) {
                return Err(Error::new(ErrorKind::Format, format!("there is no number property {axis}"))
                    .at_element("element vertex")
                    .advise("export the points as element vertex with properties x, y, z"));
            }
        }
        Ok(())
    }

    /// Refuses counts that the bytes at hand cannot hold, so that they may size buffers later.
    fn check_counts(&self, body: usize) -> Result<(), Error> {
        // The last number of a text needs no white space behind it.
        let mut left = body as u64 + u64::from(self.encoding == Encoding::Ascii);
        for e in &self.elements {
            let one: u64 = e.properties.values().map(|p| self.least_bytes(&p.data_type)).sum();
            let needed = (e.count as u64).checked_mul(one);
            left = needed.and_then(|n| left.checked_sub(n)).ok_or_else(|| {
                Error::new(
                    ErrorKind::Format,
                    format!(
                        "truncated: {} elements of at least {one} bytes promised, {left} bytes are there",
                        e.count
                    ),
                )
                .at_element(format!("element {}", e.name))
                .advise("fetch the file again; if it is whole, its header is wrong")
            })?;
        }
        Ok(())
    }

    fn least_bytes(&self, property: &PropertyType) -> u64 {
        match (&self.encoding, property) {
            (Encoding::Ascii, _) => 2,
            (_, PropertyType::Scalar(t) | PropertyType::List(t, _)) => number_type(t).size() as u64,
        }
    }
}

/// The type of a number, in the words of `ply_rs` and in ours.
pub(super) fn number_type(scalar: &ScalarType) -> NumberType {
    match scalar {
        ScalarType::Char => NumberType::I8,
        ScalarType::UChar => NumberType::U8,
        ScalarType::Short => NumberType::I16,
        ScalarType::UShort => NumberType::U16,
        ScalarType::Int => NumberType::I32,
        ScalarType::UInt => NumberType::U32,
        ScalarType::Float => NumberType::F32,
        ScalarType::Double => NumberType::F64,
    }
}

/// Lines of the header. The first line decides how all of them end, because the first byte of binary data behind
/// `end_header` may look like half a line ending.
struct HeaderLines<'a> {
    bytes: &'a [u8],
    at: usize,
    number: u64,
    end: u8,
}

impl<'a> HeaderLines<'a> {
    fn new(bytes: &'a [u8]) -> Result<Self, Error> {
        let line_end = bytes.iter().take(64).position(|b| matches!(b, b'\n' | b'\r'));
        let end = line_end.filter(|&at| bytes[..at].trim_ascii() == b"ply").ok_or_else(|| {
            Error::new(ErrorKind::Format, "the file does not begin with the line \"ply\"")
                .at_line(1)
                .advise("check that it is a PLY file; another format can be named outright")
        })?;
        let lone_return = bytes[end] == b'\r' && bytes.get(end + 1) != Some(&b'\n');
        let mut lines = HeaderLines { bytes, at: 0, number: 0, end: if lone_return { b'\r' } else { b'\n' } };
        lines.next_line()?;
        Ok(lines)
    }

    fn next_line(&mut self) -> Result<&'a [u8], Error> {
        self.number += 1;
        let rest = &self.bytes[self.at..];
        let Some(length) = rest.iter().take(MAX_LINE).position(|&b| b == self.end) else {
            let what = if rest.len() < MAX_LINE {
                "truncated: the header ends without end_header"
            } else {
                "the header line is longer than 64 KiB"
            };
            return Err(Error::new(ErrorKind::Format, what)
                .at_line(self.number)
                .advise("fetch the file again; if it is whole, its header is damaged"));
        };
        self.at += length + 1;
        if self.at > MAX_HEADER {
            return Err(wrong("the header is longer than 4 MiB").at_line(self.number));
        }
        Ok(rest[..length].trim_ascii())
    }
}

fn wrong(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, what).advise("the header is damaged or not PLY 1.0; export the file again")
}

fn parse_format(parts: &[&[u8]]) -> Result<Encoding, Error> {
    match parts {
        [encoding, b"1.0"] => match *encoding {
            b"ascii" => Ok(Encoding::Ascii),
            b"binary_little_endian" => Ok(Encoding::BinaryLittleEndian),
            b"binary_big_endian" => Ok(Encoding::BinaryBigEndian),
            other => Err(wrong(format!("unknown encoding {}", show(other)))),
        },
        [_, version] => Err(wrong(format!("unknown version {}", show(version)))),
        _ => Err(wrong("a format line needs an encoding and a version")),
    }
}

fn add_element(elements: &mut Vec<ElementDef>, name: &[u8], count: &[u8]) -> Result<(), Error> {
    let name = name_of(name)?;
    if elements.iter().any(|e| e.name == name) {
        return Err(wrong(format!("a second element {name}")));
    }
    if elements.len() == MAX_PROPERTIES {
        return Err(wrong(format!("more than {MAX_PROPERTIES} elements")));
    }
    // Parsing as u64 refuses signs, fractions and what does not fit.
    let digits = std::str::from_utf8(count).ok().filter(|c| c.bytes().all(|b| b.is_ascii_digit()));
    let count = digits
        .and_then(|c| c.parse::<u64>().ok())
        .and_then(|c| usize::try_from(c).ok())
        .ok_or_else(|| wrong(format!("{} is not a count", show(count))))?;
    let mut element = ElementDef::new(name);
    element.count = count;
    elements.push(element);
    Ok(())
}

fn add_property(elements: &mut [ElementDef], parts: &[&[u8]]) -> Result<(), Error> {
    let element = elements.last_mut().ok_or_else(|| wrong("a property before any element"))?;
    let (data_type, name) = match *parts {
        [b"list", count, item, name] => {
            let count = scalar(count)?;
            if matches!(count, ScalarType::Float | ScalarType::Double) {
                return Err(wrong("the length of a list cannot be a float"));
            }
            (PropertyType::List(count, scalar(item)?), name)
        }
        [item, name] => (PropertyType::Scalar(scalar(item)?), name),
        _ => return Err(wrong("a property needs a type and a name")),
    };
    let name = name_of(name)?;
    if element.properties.contains_key(&name) {
        return Err(wrong(format!("a second property {name}")));
    }
    if element.properties.len() == MAX_PROPERTIES {
        return Err(wrong(format!("more than {MAX_PROPERTIES} properties")));
    }
    element.properties.add(PropertyDef::new(name, data_type));
    Ok(())
}

fn name_of(name: &[u8]) -> Result<String, Error> {
    let text = std::str::from_utf8(name).ok().filter(|n| n.len() <= 256 && !n.chars().any(char::is_control));
    text.map(str::to_string).ok_or_else(|| wrong(format!("{} is not a name", show(name))))
}

fn scalar(name: &[u8]) -> Result<ScalarType, Error> {
    Ok(match name {
        b"char" | b"int8" => ScalarType::Char,
        b"uchar" | b"uint8" => ScalarType::UChar,
        b"short" | b"int16" => ScalarType::Short,
        b"ushort" | b"uint16" => ScalarType::UShort,
        b"int" | b"int32" => ScalarType::Int,
        b"uint" | b"uint32" => ScalarType::UInt,
        b"float" | b"float32" => ScalarType::Float,
        b"double" | b"float64" => ScalarType::Double,
        other => return Err(wrong(format!("unknown type {}", show(other)))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const VERTEX: &str = "element vertex 0\nproperty float x\nproperty float y\nproperty float z\n";

    fn message(header: &str) -> String {
        Header::parse(header.as_bytes()).map(|h| h.body).unwrap_err().to_string()
    }

    #[test]
    fn comments_and_line_endings_do_not_matter() {
        for end in ["\n", "\r\n", "\r"] {
            let text = "ply\ncomment\n\nformat ascii 1.0 \nobj_info a b\nelement vertex 0\nproperty  int8  x\n\
                property\tfloat64 y\nproperty uint32 z\nproperty float scalar_Coord._X\ncomment end_header\nend_header\n";
            let bytes = [text.replace('\n', end).as_bytes(), b"\nrest"].concat();
            let header = Header::parse(&bytes).unwrap();
            assert_eq!(&bytes[header.body..], b"\nrest", "{end:?}");
            assert_eq!((header.lines, header.elements[0].properties.len()), (12, 4));
        }
        let mut bytes = b"ply\ncomment \xff\xfe\n".to_vec();
        bytes.extend(format!("format ascii 1.0\n{VERTEX}end_header\n").bytes());
        assert!(Header::parse(&bytes).is_ok());
    }

    #[test]
    fn every_lie_is_named() {
        let tail = "end_header\n";
        let cases = [
            ("plywood\n".to_string(), "line 1: the file does not begin"),
            ("ply\n".to_string(), "line 2: truncated: the header ends without end_header"),
            (format!("ply\n{VERTEX}{tail}"), "no format line"),
            (format!("ply\nformat ascii 2.0\n{tail}"), "line 2: unknown version \"2.0\""),
            (format!("ply\nformat text 1.0\n{tail}"), "unknown encoding \"text\""),
            (format!("ply\nformat ascii 1.0\nformat ascii 1.0\n{tail}"), "a second format line"),
            (format!("ply\nformat ascii 1.0\nwhat\n{tail}"), "line 3: \"what\" is not a PLY header line"),
            (format!("ply\nformat ascii 1.0\n{VERTEX}{VERTEX}{tail}"), "line 7: a second element vertex"),
            (format!("ply\nformat ascii 1.0\n{VERTEX}property int x\n{tail}"), "a second property x"),
            (format!("ply\nformat ascii 1.0\nproperty int x\n{tail}"), "a property before any element"),
            (format!("ply\nformat ascii 1.0\nelement vertex -1\n{tail}"), "\"-1\" is not a count"),
            (format!("ply\nformat ascii 1.0\nelement vertex +1\n{tail}"), "\"+1\" is not a count"),
            (format!("ply\nformat ascii 1.0\nelement vertex 99999999999999999999\n{tail}"), "is not a count"),
            (
                format!("ply\nformat ascii 1.0\nelement vertex 0\n{tail}"),
                "vertex: the element has no properties",
            ),
            (
                format!("ply\nformat ascii 1.0\nelement p 0\nproperty int x\n{tail}"),
                "no element vertex, only [p]",
            ),
            (
                format!("ply\nformat ascii 1.0\nelement vertex 0\nproperty int x\nproperty int y\n{tail}"),
                "no number property z",
            ),
            (
                format!("ply\nformat ascii 1.0\n{VERTEX}property list float int a\n{tail}"),
                "length of a list cannot be a float",
            ),
            (format!("ply\nformat ascii 1.0\n{VERTEX}property half a\n{tail}"), "unknown type \"half\""),
            (format!("ply\ncomment {}\n", "x".repeat(70_000)), "longer than 64 KiB"),
        ];
        for (header, expected) in cases {
            let text = message(&header);
            assert!(text.contains(expected), "{header}: {text}");
        }
    }

    #[test]
    fn counts_must_fit_the_bytes() {
        let file = |encoding: &str, count: u64, body: &str| {
            let vertex = VERTEX.replace("vertex 0", &format!("vertex {count}"));
            format!("ply\nformat {encoding} 1.0\n{vertex}end_header\n{body}")
        };
        assert!(Header::parse(file("binary_little_endian", 2, &"x".repeat(24)).as_bytes()).is_ok());
        assert_eq!(
            message(&file("binary_little_endian", 2, &"x".repeat(23))),
            "element vertex: truncated: 2 elements of at least 12 bytes promised, 23 bytes are there; fetch the file \
             again; if it is whole, its header is wrong"
        );
        assert!(Header::parse(file("ascii", 2, "1 2 3\n4 5 6").as_bytes()).is_ok());
        assert!(message(&file("ascii", 2, "1 2 3\n4 5 ")).contains("truncated"));
        assert!(message(&file("binary_big_endian", u64::MAX, "")).contains("truncated"));
        assert!(message(&file("ascii", u64::MAX / 2, "1 2 3\n")).contains("truncated"));
    }
}
