//! Binary elements, decoded by `ply_rs` one at a time into structs that keep only what is needed.

use std::io;

use ply_rs::parser::{ParseError, Parser};
use ply_rs::ply::{BeginList, ElementDef, Encoding, PropertyAccess, PropertyAccessResult, PropertyType};

use super::super::polygon::push_fan;
use super::super::precision::check_point;
use super::super::{Loaded, NORMAL_NAMES, Want};
use super::elements::{CORNERS, axis_of, cut_short, has_normals, more, wanted};
use super::header::{Header, number_type};
use crate::{Error, ErrorKind};

/// Reads the elements up to the last one of interest.
pub(super) fn read(header: &Header, mut body: &[u8], want: Want, loaded: &mut Loaded) -> Result<(), Error> {
    let decoder = Decoder { little: header.encoding == Encoding::BinaryLittleEndian };
    for (at, def) in header.elements.iter().enumerate() {
        if !wanted(&header.elements[at..], want) {
            return Ok(());
        }
        match def.name.as_str() {
            "vertex" => {
                let normals = want != Want::Mesh && has_normals(def);
                loaded.verts.reserve_exact(def.count);
                loaded.normals.reserve_exact(if normals { def.count } else { 0 });
                for i in 0..def.count {
                    let (point, normal) = if want == Want::Attributes {
                        let row: VertexRow<true> = decoder.read(&mut body, def, i)?;
                        loaded.attributes.iter_mut().zip(row.more).for_each(|(a, x)| a.values.push(x));
                        (row.point, row.normal)
                    } else {
                        let row: VertexRow<false> = decoder.read(&mut body, def, i)?;
                        (row.point, row.normal)
                    };
                    check_point(point, want, "vertex", i)?;
                    loaded.verts.push(point);
                    if normals {
                        loaded.normals.push(normal);
                    }
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
    let extra = body.trim_ascii().len();
    if extra > 0 {
        loaded.warnings.push(more(&format!("{extra} bytes")));
    }
    Ok(())
}

/// Passes over an element that is not of interest.
fn skip(decoder: &Decoder, body: &mut &[u8], def: &ElementDef) -> Result<(), Error> {
    let one: Option<usize> = def
        .properties
        .values()
        .map(|p| match &p.data_type {
            PropertyType::Scalar(t) => Some(number_type(t).size()),
            PropertyType::List(..) => None,
        })
        .sum();
    if let Some(one) = one {
        // The header check made sure of the product; lists before may have used up the bytes, though.
        let bytes = def.count * one;
        if bytes > body.len() {
            return Err(cut_short(def, body.len() / one));
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

/// Position and normal of a vertex, from any number type; with `MORE` all other numbers, too, in their order.
struct VertexRow<const MORE: bool> {
    point: [f64; 3],
    normal: [f32; 3],
    more: Vec<f64>,
}

impl<const MORE: bool> VertexRow<MORE> {
    fn set(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        if let Some(axis) = axis_of(name) {
            self.point[axis] = value;
        } else if let Some(axis) = NORMAL_NAMES.iter().position(|n| *n == name) {
            self.normal[axis] = value as f32;
        } else if MORE {
            self.more.push(value);
        } else {
            return PropertyAccessResult::Ignored;
        }
        PropertyAccessResult::Set
    }
}

impl<const MORE: bool> PropertyAccess for VertexRow<MORE> {
    fn new() -> Self {
        VertexRow { point: [0.0; 3], normal: [0.0; 3], more: Vec::new() }
    }
    fn set_char(&mut self, name: &str, value: i8) -> PropertyAccessResult {
        self.set(name, f64::from(value))
    }
    fn set_uchar(&mut self, name: &str, value: u8) -> PropertyAccessResult {
        self.set(name, f64::from(value))
    }
    fn set_short(&mut self, name: &str, value: i16) -> PropertyAccessResult {
        self.set(name, f64::from(value))
    }
    fn set_ushort(&mut self, name: &str, value: u16) -> PropertyAccessResult {
        self.set(name, f64::from(value))
    }
    fn set_int(&mut self, name: &str, value: i32) -> PropertyAccessResult {
        self.set(name, f64::from(value))
    }
    fn set_uint(&mut self, name: &str, value: u32) -> PropertyAccessResult {
        self.set(name, f64::from(value))
    }
    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        self.set(name, f64::from(value))
    }
    fn set_double(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        self.set(name, value)
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
