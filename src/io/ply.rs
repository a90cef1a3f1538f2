//! PLY, text and binary of either byte order.
//!
//! Binary elements are decoded by `ply_rs` into the small structs below, behind the header check of
//! [`ply_header`](super::ply_header). Text elements are split here: the grammar of `ply_rs` refuses numbers such as
//! `1.` and `.5`, blank lines, and an integer property written as `3.0`, all of which real files have.

use std::io::{self, Write};

use ply_rs::parser::{ParseError, Parser};
use ply_rs::ply::{
    BeginList, ElementDef, Encoding, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use super::ply_header::{Header, size};
use super::text::{Lines, integer, not_a_number, show, words, write_floats};
use super::{Loaded, Want, check_point, float, push_fan};
use crate::{Error, ErrorKind};

/// The two names that the corner list of a face goes by.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Reads v x 3 positions and, if wanted, polygons cut into f x 3 triangles.
pub(super) fn read(bytes: &[u8], want: Want) -> Result<Loaded, Error> {
    let header = Header::parse(bytes)?;
    if want == Want::Mesh {
        check_faces(&header)?;
    }
    let mut loaded = Loaded { notices: notices(&header, want), ..Loaded::default() };
    let body = &bytes[header.body..];
    match header.encoding {
        Encoding::Ascii => read_text(&header, body, want, &mut loaded)?,
        Encoding::BinaryLittleEndian | Encoding::BinaryBigEndian => {
            read_binary(&header, body, want, &mut loaded)?;
        }
    }
    Ok(loaded)
}

/// Writes a cloud, or with `faces` a mesh; the caller has checked that indices fit `i32`.
pub(super) fn write(
    out: &mut dyn Write,
    verts: &[[f32; 3]],
    faces: Option<&[[u32; 3]]>,
    encoding: Encoding,
) -> io::Result<()> {
    write!(out, "ply\nformat {encoding} 1.0\nelement vertex {}\n", verts.len())?;
    out.write_all(b"property float x\nproperty float y\nproperty float z\n")?;
    if let Some(faces) = faces {
        write!(out, "element face {}\nproperty list uchar int vertex_indices\n", faces.len())?;
    }
    out.write_all(b"end_header\n")?;
    let faces = faces.unwrap_or_default();
    if encoding == Encoding::Ascii {
        for &p in verts {
            write_floats(out, p, " ")?;
            out.write_all(b"\n")?;
        }
        for [a, b, c] in faces {
            writeln!(out, "3 {a} {b} {c}")?;
        }
        return Ok(());
    }
    let little = encoding == Encoding::BinaryLittleEndian;
    for p in verts {
        let row = p.map(|x| if little { x.to_le_bytes() } else { x.to_be_bytes() });
        out.write_all(row.as_flattened())?;
    }
    for face in faces {
        let mut row = [3; 13];
        let indices = face.map(|i| if little { i.to_le_bytes() } else { i.to_be_bytes() });
        row[1..].copy_from_slice(indices.as_flattened());
        out.write_all(&row)?;
    }
    Ok(())
}

/// Makes sure that there are faces with exactly one corner list.
fn check_faces(header: &Header) -> Result<(), Error> {
    let Some(face) = header.element("face") else {
        let (what, advice) = if header.element("tristrips").is_some() {
            ("the file holds triangle strips", "convert them to faces first")
        } else {
            ("the file has no faces", "give a triangle mesh; this is a point cloud")
        };
        return Err(Error::new(ErrorKind::Format, what).advise(advice));
    };
    let lists: Vec<_> = CORNERS.iter().filter_map(|name| face.properties.get(*name)).collect();
    let what = match lists.as_slice() {
        [one] => match &one.data_type {
            PropertyType::List(_, item) if !matches!(item, ScalarType::Float | ScalarType::Double) => {
                return Ok(());
            }
            _ => "there is no integer list vertex_indices or vertex_index",
        },
        [] => "there is no integer list vertex_indices or vertex_index",
        _ => "there are both vertex_indices and vertex_index",
    };
    Err(Error::new(ErrorKind::Format, what)
        .at_element("element face")
        .advise("export the mesh again with its faces as one such list"))
}

fn notices(header: &Header, want: Want) -> Vec<String> {
    let mut notices = Vec::new();
    for e in &header.elements {
        match e.name.as_str() {
            "vertex" => {
                let extra: Vec<&str> = e
                    .properties
                    .keys()
                    .map(String::as_str)
                    .filter(|k| !["x", "y", "z"].contains(k))
                    .collect();
                let more = if extra.len() > 8 { ", ..." } else { "" };
                let names = extra[..extra.len().min(8)].join(", ");
                match extra.len() {
                    0 => {}
                    1 => notices.push(format!("ignored 1 extra property ({names})")),
                    n => notices.push(format!("ignored {n} extra properties ({names}{more})")),
                }
            }
            "face" if want == Want::Mesh || e.count == 0 => {}
            "face" => notices.push(format!("ignored {} faces; their vertices are the points", e.count)),
            name => notices.push(format!("ignored {} elements {name}", e.count)),
        }
    }
    notices
}

/// Whether any element from `from` on is of interest; what comes later need not be decoded.
fn wanted(elements: &[ElementDef], want: Want) -> bool {
    elements.iter().any(|e| e.name == "vertex" || (e.name == "face" && want == Want::Mesh))
}

/// The error of element `index` running out of bytes.
fn cut_short(def: &ElementDef, index: usize) -> Error {
    Error::new(ErrorKind::Format, format!("truncated: {} promised, {index} are whole", def.count))
        .at_element(format!("{} {index}", def.name))
        .advise("fetch the file again; if it is whole, its header is wrong")
}

fn read_binary(header: &Header, mut body: &[u8], want: Want, loaded: &mut Loaded) -> Result<(), Error> {
    let decoder = Decoder { little: header.encoding == Encoding::BinaryLittleEndian };
    for (at, def) in header.elements.iter().enumerate() {
        if !wanted(&header.elements[at..], want) {
            break;
        }
        match def.name.as_str() {
            "vertex" => {
                loaded.verts.reserve_exact(def.count);
                for i in 0..def.count {
                    let row: VertexRow = decoder.read(&mut body, def, i)?;
                    check_point(row.0, "vertex", i)?;
                    loaded.verts.push(row.0);
                }
            }
            "face" if want == Want::Mesh => {
                // A triangle takes 4 bytes at the least, which bounds what a false count can reserve.
                loaded.faces.reserve(def.count.min(body.len() / 4));
                let mut polygon = Vec::new();
                for i in 0..def.count {
                    let row: FaceRow = decoder.read(&mut body, def, i)?;
                    row.polygon(&mut polygon);
                    push_fan(&mut loaded.faces, &polygon).map_err(|e| e.at_element(format!("face {i}")))?;
                }
            }
            _ => skip(&decoder, &mut body, def)?,
        }
    }
    Ok(())
}

/// Passes over an element that is not of interest.
fn skip(decoder: &Decoder, body: &mut &[u8], def: &ElementDef) -> Result<(), Error> {
    let one: Option<u64> = def
        .properties
        .values()
        .map(|p| match &p.data_type {
            PropertyType::Scalar(t) => Some(size(t)),
            PropertyType::List(..) => None,
        })
        .sum();
    if let Some(one) = one {
        // The header check made sure of the product; lists before may have used up the bytes, though.
        let bytes = def.count * one as usize;
        if bytes > body.len() {
            return Err(cut_short(def, body.len() / one as usize));
        }
        *body = &body[bytes..];
        return Ok(());
    }
    for i in 0..def.count {
        let _: SkippedRow = decoder.read(body, def, i)?;
    }
    Ok(())
}

struct Decoder {
    little: bool,
}

impl Decoder {
    /// Element `index` of those that `def` describes.
    fn read<E: PropertyAccess>(&self, body: &mut &[u8], def: &ElementDef, index: usize) -> Result<E, Error> {
        let parser = Parser::<E>::new();
        let row = if self.little {
            parser.read_little_endian_element(body, def)
        } else {
            parser.read_big_endian_element(body, def)
        };
        row.map_err(|e: ParseError| {
            if e.kind() == io::ErrorKind::UnexpectedEof {
                return cut_short(def, index);
            }
            // Its messages have several lines, ours one.
            let cause = e.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
            Error::new(ErrorKind::Format, "the element cannot be decoded")
                .at_element(format!("{} {index}", def.name))
                .caused_by(cause)
        })
    }
}

/// x, y, z of a vertex, from any number type.
struct VertexRow([f32; 3]);

impl VertexRow {
    fn set(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        let axis = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            _ => return PropertyAccessResult::Ignored,
        };
        self.0[axis] = value;
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for VertexRow {
    fn new() -> Self {
        VertexRow([0.0; 3])
    }
    fn set_char(&mut self, name: &str, value: i8) -> PropertyAccessResult {
        self.set(name, f32::from(value))
    }
    fn set_uchar(&mut self, name: &str, value: u8) -> PropertyAccessResult {
        self.set(name, f32::from(value))
    }
    fn set_short(&mut self, name: &str, value: i16) -> PropertyAccessResult {
        self.set(name, f32::from(value))
    }
    fn set_ushort(&mut self, name: &str, value: u16) -> PropertyAccessResult {
        self.set(name, f32::from(value))
    }
    fn set_int(&mut self, name: &str, value: i32) -> PropertyAccessResult {
        self.set(name, value as f32)
    }
    fn set_uint(&mut self, name: &str, value: u32) -> PropertyAccessResult {
        self.set(name, value as f32)
    }
    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        self.set(name, value)
    }
    fn set_double(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        self.set(name, value as f32)
    }
}

/// The corners of a face: the two usual types are filled in place, narrower ones are widened into `ints`.
#[derive(Default)]
struct FaceRow {
    ints: Vec<i32>,
    uints: Vec<u32>,
}

impl FaceRow {
    fn polygon(&self, polygon: &mut Vec<i64>) {
        polygon.clear();
        polygon.extend(self.ints.iter().map(|&i| i64::from(i)));
        polygon.extend(self.uints.iter().map(|&i| i64::from(i)));
    }

    fn widen<T: Into<i32>>(&mut self, name: &str, values: Vec<T>) -> PropertyAccessResult {
        if !CORNERS.contains(&name) {
            return PropertyAccessResult::Ignored;
        }
        self.ints = values.into_iter().map(Into::into).collect();
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for FaceRow {
    fn new() -> Self {
        FaceRow::default()
    }
    fn begin_list_int(&mut self, name: &str, _: usize) -> BeginList<'_, i32> {
        if CORNERS.contains(&name) { BeginList::Fill(&mut self.ints) } else { BeginList::UseSetter }
    }
    fn begin_list_uint(&mut self, name: &str, _: usize) -> BeginList<'_, u32> {
        if CORNERS.contains(&name) { BeginList::Fill(&mut self.uints) } else { BeginList::UseSetter }
    }
    fn set_list_char(&mut self, name: &str, values: Vec<i8>) -> PropertyAccessResult {
        self.widen(name, values)
    }
    fn set_list_uchar(&mut self, name: &str, values: Vec<u8>) -> PropertyAccessResult {
        self.widen(name, values)
    }
    fn set_list_short(&mut self, name: &str, values: Vec<i16>) -> PropertyAccessResult {
        self.widen(name, values)
    }
    fn set_list_ushort(&mut self, name: &str, values: Vec<u16>) -> PropertyAccessResult {
        self.widen(name, values)
    }
}

/// An element that is read only to get past it.
struct SkippedRow;

impl PropertyAccess for SkippedRow {
    fn new() -> Self {
        SkippedRow
    }
}

fn read_text(header: &Header, body: &[u8], want: Want, loaded: &mut Loaded) -> Result<(), Error> {
    let mut lines = Lines::after(body, header.lines);
    let mut polygon = Vec::new();
    for (at, def) in header.elements.iter().enumerate() {
        if !wanted(&header.elements[at..], want) {
            break;
        }
        match def.name.as_str() {
            "vertex" => loaded.verts.reserve_exact(def.count),
            "face" if want == Want::Mesh => loaded.faces.reserve(def.count.min(body.len() / 4)),
            _ => {}
        }
        for i in 0..def.count {
            // Blank lines are no elements.
            let Some((number, line)) = lines.find(|(_, line)| !line.trim_ascii().is_empty()) else {
                return Err(cut_short(def, i));
            };
            let located = |e: Error| e.at_line(number).at_element(format!("{} {i}", def.name));
            match def.name.as_str() {
                "vertex" => {
                    let point = vertex_of(line, def).map_err(located)?;
                    check_point(point, "vertex", i).map_err(|e| e.at_line(number))?;
                    loaded.verts.push(point);
                }
                "face" if want == Want::Mesh => {
                    polygon_of(line, def, &mut polygon).map_err(located)?;
                    push_fan(&mut loaded.faces, &polygon).map_err(located)?;
                }
                _ => {}
            }
        }
    }
    Ok(())
}

/// x, y, z from the line of a vertex.
fn vertex_of(line: &[u8], def: &ElementDef) -> Result<[f32; 3], Error> {
    let mut point = [0.0; 3];
    each_property(line, def, |name, values| {
        if let Some(axis) = ["x", "y", "z"].iter().position(|a| *a == name) {
            point[axis] = float(values[0]).ok_or_else(|| not_a_number(values[0]))?;
        }
        Ok(())
    })?;
    Ok(point)
}

/// The corner list from the line of a face.
fn polygon_of(line: &[u8], def: &ElementDef, polygon: &mut Vec<i64>) -> Result<(), Error> {
    polygon.clear();
    each_property(line, def, |name, values| {
        if CORNERS.contains(&name) {
            for &value in values {
                polygon.push(integer(value).ok_or_else(|| {
                    Error::new(ErrorKind::Format, format!("{} is not a vertex index", show(value)))
                        .advise("export the mesh again")
                })?);
            }
        }
        Ok(())
    })
}

/// Deals the words of a line out to the properties of its element: one to a number, a count and its items to a list.
fn each_property<'a>(
    line: &'a [u8],
    def: &ElementDef,
    mut take: impl FnMut(&str, &[&'a [u8]]) -> Result<(), Error>,
) -> Result<(), Error> {
    let mut parts = words(line);
    let missing = |name: &str| {
        Error::new(ErrorKind::Format, format!("the line ends before property {name}"))
            .advise("complete the line or export the file again")
    };
    for (name, property) in &def.properties {
        let first = parts.next().ok_or_else(|| missing(name))?;
        match property.data_type {
            PropertyType::Scalar(_) => take(name, &[first])?,
            PropertyType::List(..) => {
                let count = integer(first).and_then(|n| u64::try_from(n).ok()).ok_or_else(|| {
                    Error::new(ErrorKind::Format, format!("{} is not the length of a list", show(first)))
                        .advise("export the file again")
                })?;
                // Only as many words as the line really has can be collected, whatever the count says.
                let values: Vec<&[u8]> =
                    parts.by_ref().take(usize::try_from(count).unwrap_or(usize::MAX)).collect();
                if (values.len() as u64) < count {
                    return Err(missing(name));
                }
                take(name, &values)?;
            }
        }
    }
    match parts.count() {
        0 => Ok(()),
        extra => Err(Error::new(ErrorKind::Format, format!("{extra} words too many on the line"))
            .advise("one element a line is expected, with the properties of the header")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ply_rs::ply::DefaultElement;
    use proptest::prelude::*;

    const ENCODINGS: [Encoding; 3] =
        [Encoding::Ascii, Encoding::BinaryLittleEndian, Encoding::BinaryBigEndian];

    fn message(bytes: &[u8]) -> String {
        read(bytes, Want::Mesh).map(|l| l.verts).unwrap_err().to_string()
    }

    /// A file with two vertices of mixed types, an element to skip, and one face, in each encoding.
    fn mixed(encoding: &Encoding) -> Vec<u8> {
        let header = format!(
            "ply\r\nformat {encoding} 1.0\r\ncomment c\r\nelement skip 1\r\nproperty list uchar short s\r\n\
             property char c\r\nelement vertex 3\r\nproperty double y\r\nproperty uchar red\r\n\
             property short x\r\nproperty list uchar float tags\r\nproperty float32 z\r\nelement face 1\r\n\
             property uchar flags\r\nproperty list int ushort vertex_index\r\nend_header\r\n"
        );
        let mut out = header.into_bytes();
        if *encoding == Encoding::Ascii {
            out.extend(b"2 7 7 -1\r\n\r\n2. 255 1 0 .5\r\n-5e0 0 -4 1 9 6.0\n8 0 +7 2 9 9 9\n1 3 0 1 2");
            return out;
        }
        let big = *encoding == Encoding::BinaryBigEndian;
        let mut put = |little: &[u8]| {
            if big { out.extend(little.iter().rev()) } else { out.extend(little) }
        };
        let vertices: [(i16, f64, f32, &[f32]); 3] =
            [(1, 2.0, 0.5, &[]), (-4, -5.0, 6.0, &[9.0]), (7, 8.0, 9.0, &[9.0, 9.0])];
        put(&[2]);
        put(&7_i16.to_le_bytes());
        put(&7_i16.to_le_bytes());
        put(&[255]);
        for (x, y, z, tags) in vertices {
            put(&y.to_le_bytes());
            put(&[9]);
            put(&x.to_le_bytes());
            put(&[tags.len() as u8]);
            tags.iter().for_each(|t| put(&t.to_le_bytes()));
            put(&z.to_le_bytes());
        }
        put(&[1]);
        put(&3_i32.to_le_bytes());
        (0..3_u16).for_each(|i| put(&i.to_le_bytes()));
        out
    }

    #[test]
    fn reads_mixed_types_orders_and_elements() {
        for encoding in &ENCODINGS {
            let loaded = read(&mixed(encoding), Want::Mesh).unwrap_or_else(|e| panic!("{encoding}: {e}"));
            assert_eq!(loaded.verts, [[1.0, 2.0, 0.5], [-4.0, -5.0, 6.0], [7.0, 8.0, 9.0]], "{encoding}");
            assert_eq!(loaded.faces, [[0, 1, 2]]);
            assert_eq!(loaded.notices, ["ignored 1 elements skip", "ignored 2 extra properties (red, tags)"]);
            let cloud = read(&mixed(encoding), Want::Cloud).unwrap();
            assert_eq!(cloud.verts, loaded.verts);
            assert!(cloud.notices.contains(&"ignored 1 faces; their vertices are the points".to_string()));
        }
    }

    #[test]
    fn corners_may_have_any_integer_type() {
        for (item, width) in
            [("char", 1), ("uint8", 1), ("short", 2), ("ushort", 2), ("int32", 4), ("uint", 4)]
        {
            let mut bytes = format!(
                "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty char x\nproperty char y\n\
                 property char z\nelement face 1\nproperty list uchar {item} vertex_indices\n\
                 property list uchar {item} other\nend_header\n"
            )
            .into_bytes();
            bytes.extend([1, 2, 255, 4]);
            for i in 0..4_u32 {
                bytes.extend(&i.to_le_bytes()[..width]);
            }
            bytes.extend([1, 9, 0, 0, 0]);
            bytes.truncate(bytes.len() - 4 + width);
            let loaded = read(&bytes, Want::Mesh).unwrap_or_else(|e| panic!("{item}: {e}"));
            assert_eq!(loaded.verts, [[1.0, 2.0, -1.0]]);
            assert_eq!(loaded.faces, [[0, 1, 2], [0, 2, 3]], "{item}");
        }
    }

    #[test]
    fn errors_name_line_and_element() {
        let file = |body: &str| {
            format!(
                "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                 element face 1\nproperty list uchar int vertex_indices\nend_header\n{body}"
            )
        };
        let cases = [
            ("0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "line 11: vertex 1: the line ends before property z"),
            ("0 0 0\n1 0 a\n0 1 0\n3 0 1 2\n", "line 11: vertex 1: \"a\" is not a number"),
            ("0 0 0\n1 0 0 5\n0 1 0\n3 0 1 2\n", "line 11: vertex 1: 1 words too many"),
            ("0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n", "line 11: vertex 1: z is NaN"),
            ("0 0 0\n1 0 0\n0 1 0\n\n2 0 1\n", "line 14: face 0: at least 3 corners expected, 2 found"),
            (
                "0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n",
                "line 13: face 0: the line ends before property vertex_indices",
            ),
            ("0 0 0\n1 0 0\n0 1 0\n-3 0 1 2\n", "\"-3\" is not the length of a list"),
            ("0 0 0\n1 0 0\n0 1 0\n3 0 1 -2\n", "vertex -2 is named"),
            ("0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n", "\"1.5\" is not a vertex index"),
            ("0 0 0\n1 0 0\n0 1   0\n\n\n", "face 0: truncated: 1 promised, 0 are whole"),
        ];
        for (body, expected) in cases {
            let text = message(file(body).as_bytes());
            assert!(text.contains(expected), "{body}: {text}");
        }
        let header = |rest: &str| {
            format!(
                "ply\nformat ascii 1.0\nelement vertex 0\nproperty int x\nproperty int y\nproperty int z\n{rest}\
                 end_header\n"
            )
        };
        assert!(message(header("").as_bytes()).contains("no faces; give a triangle mesh"));
        let strips = header("element tristrips 0\nproperty list int int vertex_indices\n");
        assert!(message(strips.as_bytes()).contains("triangle strips"));
        let other = header("element face 0\nproperty int vertex_indices\n");
        assert!(message(other.as_bytes()).contains("no integer list vertex_indices"));
        let both = header(
            "element face 0\nproperty list int int vertex_indices\nproperty list int int vertex_index\n",
        );
        assert!(message(both.as_bytes()).contains("both"));
    }

    #[test]
    fn a_false_list_length_is_a_truncation() {
        let mut bytes =
            b"ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty int x\nproperty int y\n\
            property int z\nelement face 1\nproperty list uint int vertex_indices\nend_header\n"
                .to_vec();
        bytes.extend([0xff; 20]);
        assert!(message(&bytes).contains("face 0: truncated: 1 promised, 0 are whole"));
        let signed = String::from_utf8_lossy(&bytes[..bytes.len() - 20]).replace("uint", "int").into_bytes();
        let text = message(&[signed, vec![0xff; 20]].concat());
        assert!(text.contains("List length cannot be negative") && !text.contains('\n'), "{text}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// What is written comes back to the bit, both here and through the plain parser of `ply_rs`.
        #[test]
        fn every_encoding_comes_back(
            verts in prop::collection::vec(prop::array::uniform3(any::<f32>().prop_filter("finite", |x| x.is_finite())), 1..12),
            picks in prop::collection::vec(prop::array::uniform3(0_u32..1000), 0..12),
        ) {
            let faces: Vec<[u32; 3]> = picks.iter().map(|f| f.map(|i| i % verts.len() as u32)).collect();
            for encoding in ENCODINGS {
                let mut bytes = Vec::new();
                write(&mut bytes, &verts, Some(&faces), encoding).unwrap();
                let loaded = read(&bytes, Want::Mesh).unwrap();
                prop_assert_eq!(bits(&loaded.verts), bits(&verts));
                prop_assert_eq!(&loaded.faces, &faces);
                let ply = Parser::<DefaultElement>::new().read_ply(&mut bytes.as_slice()).unwrap();
                let twin: Vec<[f32; 3]> = ply.payload["vertex"]
                    .iter()
                    .map(|v| ["x", "y", "z"].map(|k| v[k].to_f32_lossy().unwrap()))
                    .collect();
                prop_assert_eq!(bits(&twin), bits(&verts));
                let twin: Vec<Vec<u32>> =
                    ply.payload["face"].iter().map(|f| f["vertex_indices"].to_u32_list().unwrap()).collect();
                prop_assert_eq!(twin.concat(), faces.as_flattened());
            }
        }
    }

    fn bits(points: &[[f32; 3]]) -> Vec<[u32; 3]> {
        points.iter().map(|p| p.map(f32::to_bits)).collect()
    }
}
