//! Text elements, one a line.

use ply_rs::ply::{ElementDef, PropertyType, ScalarType};

use super::super::polygon::push_fan;
use super::super::precision::{check_point, round_to_floats};
use super::super::text::{Lines, float, integer, not_a_number, push_value, show, words};
use super::super::{Loaded, NORMAL_NAMES, Want};
use super::elements::{CORNERS, axis_of, cut_short, has_normals, more, wanted};
use super::header::Header;
use crate::geometry::Attribute;
use crate::{Error, ErrorKind};

/// Reads the elements up to the last one of interest.
pub(super) fn read(header: &Header, body: &[u8], want: Want, loaded: &mut Loaded) -> Result<(), Error> {
    let mut lines = Lines::after(body, header.lines);
    let mut polygon = Vec::new();
    for (at, def) in header.elements.iter().enumerate() {
        if !wanted(&header.elements[at..], want) {
            return Ok(());
        }
        let normals = want != Want::Mesh && has_normals(def);
        match def.name.as_str() {
            "vertex" => {
                loaded.verts.reserve_exact(def.count);
                loaded.normals.reserve_exact(if normals { def.count } else { 0 });
            }
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
                    let (point, normal) = vertex_of(line, def, &mut loaded.attributes).map_err(located)?;
                    check_point(point, want, "vertex", i).map_err(|e| e.at_line(number))?;
                    loaded.verts.push(point);
                    if normals {
                        loaded.normals.push(normal);
                    }
                }
                "face" if want == Want::Mesh => {
                    polygon_of(line, def, &mut polygon).map_err(located)?;
                    push_fan(&mut loaded.faces, &polygon).map_err(located)?;
                }
                _ => {}
            }
        }
        if def.name == "vertex" && holds_floats(def) {
            round_to_floats(&mut loaded.verts, true);
        }
    }
    let extra = lines.filter(|(_, line)| !line.trim_ascii().is_empty()).count();
    if extra > 0 {
        loaded.warnings.push(more(&format!("{extra} lines")));
    }
    Ok(())
}

/// Whether all coordinates are declared as 32-bit floats.
fn holds_floats(vertex: &ElementDef) -> bool {
    let mut axes = vertex.properties.iter().filter(|(name, _)| axis_of(name).is_some());
    axes.all(|(_, property)| matches!(property.data_type, PropertyType::Scalar(ScalarType::Float)))
}

/// Position and normal from the line of a vertex, whose other numbers go to the attributes. A word that is no number
/// makes the normal or the attribute NaN: nobody may want it.
fn vertex_of(
    line: &[u8],
    def: &ElementDef,
    attributes: &mut [Attribute],
) -> Result<([f64; 3], [f32; 3]), Error> {
    let (mut point, mut normal) = ([0.0; 3], [0.0; 3]);
    let mut more = attributes.iter_mut().peekable();
    each_property(line, def, |name, values| {
        if let Some(axis) = axis_of(name) {
            point[axis] = float(values[0]).ok_or_else(|| not_a_number(values[0]))?;
        } else if let Some(axis) = NORMAL_NAMES.iter().position(|a| *a == name) {
            normal[axis] = values.first().and_then(|v| float(v)).map_or(f32::NAN, |n| n as f32);
        } else if let Some(attribute) = more.next_if(|a| a.name == name) {
            push_value(attribute, float(values[0]).unwrap_or(f64::NAN));
        }
        Ok(())
    })?;
    Ok((point, normal))
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
