//! Writing PLY.

use std::io::{self, Write};

use super::super::encoding::{Encoding, Width};
use super::super::number::{ByteOrder, append};
use super::super::text::write_position;
use crate::geometry::{Attribute, Number};

/// Writes a cloud, or with `faces` a mesh, with one property more for each attribute; the caller has checked that
/// indices fit `i32`, and that each attribute has a value a vertex and a name of its own.
pub(in super::super) fn write(
    out: &mut dyn Write,
    verts: &[[f64; 3]],
    width: Width,
    attributes: &[Attribute],
    faces: Option<&[[u32; 3]]>,
    encoding: Encoding,
) -> io::Result<()> {
    let encoding = match encoding {
        Encoding::Binary => ply_rs::ply::Encoding::BinaryLittleEndian,
        Encoding::Ascii => ply_rs::ply::Encoding::Ascii,
    };
    write_encoded(out, verts, width, attributes, faces, encoding)
}

/// As [`write`], in any encoding of the format.
pub(in super::super) fn write_encoded(
    out: &mut dyn Write,
    verts: &[[f64; 3]],
    width: Width,
    attributes: &[Attribute],
    faces: Option<&[[u32; 3]]>,
    encoding: ply_rs::ply::Encoding,
) -> io::Result<()> {
    write!(out, "ply\nformat {encoding} 1.0\nelement vertex {}\n", verts.len())?;
    let number = match width {
        Width::Single => "float",
        Width::Double => "double",
    };
    write!(out, "property {number} x\nproperty {number} y\nproperty {number} z\n")?;
    for attribute in attributes {
        writeln!(out, "property {} {}", type_name(attribute.number), attribute.name)?;
    }
    if let Some(faces) = faces {
        write!(out, "element face {}\nproperty list uchar int vertex_indices\n", faces.len())?;
    }
    out.write_all(b"end_header\n")?;
    let faces = faces.unwrap_or_default();
    if encoding == ply_rs::ply::Encoding::Ascii {
        for (i, &p) in verts.iter().enumerate() {
            write_position(out, p, width, " ")?;
            for attribute in attributes {
                match attribute.number {
                    Number::F32 => write!(out, " {}", attribute.values[i] as f32)?,
                    _ => write!(out, " {}", attribute.values[i])?,
                }
            }
            out.write_all(b"\n")?;
        }
        for [a, b, c] in faces {
            writeln!(out, "3 {a} {b} {c}")?;
        }
        return Ok(());
    }
    let little = encoding == ply_rs::ply::Encoding::BinaryLittleEndian;
    let order = if little { ByteOrder::Little } else { ByteOrder::Big };
    let mut bytes = Vec::with_capacity(64);
    for (i, p) in verts.iter().enumerate() {
        bytes.clear();
        let position = match width {
            Width::Single => Number::F32,
            Width::Double => Number::F64,
        };
        p.iter().for_each(|&x| append(&mut bytes, x, position, order));
        attributes.iter().for_each(|a| append(&mut bytes, a.values[i], a.number, order));
        out.write_all(&bytes)?;
    }
    for face in faces {
        let mut row = [3; 13];
        let indices = face.map(|i| if little { i.to_le_bytes() } else { i.to_be_bytes() });
        row[1..].copy_from_slice(indices.as_flattened());
        out.write_all(&row)?;
    }
    Ok(())
}

/// The name of a type in a header.
fn type_name(number: Number) -> &'static str {
    match number {
        Number::I8 => "char",
        Number::U8 => "uchar",
        Number::I16 => "short",
        Number::U16 => "ushort",
        Number::I32 => "int",
        Number::U32 => "uint",
        Number::F32 => "float",
        Number::F64 => "double",
    }
}
