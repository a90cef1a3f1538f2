//! What the elements of a header hold, for the readers of both encodings.

use ply_rs::ply::{ElementDef, PropertyDef, PropertyType};

use super::super::{NORMAL_NAMES, Want};
use super::header::number_type;
use crate::geometry::Attribute;
use crate::{Error, ErrorKind};

/// The two names that the corner list of a face goes by.
pub(super) const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// The axis that a property holds the coordinate of; some programs write capitals.
pub(super) fn axis_of(name: &str) -> Option<usize> {
    ["x", "y", "z"].iter().position(|axis| name.eq_ignore_ascii_case(axis))
}

/// The numbers of a vertex beside position and normal, without values yet, in their order.
pub(super) fn attributes(vertex: &ElementDef) -> Vec<Attribute> {
    let one = |(name, property): (&String, &PropertyDef)| {
        let PropertyType::Scalar(kind) = &property.data_type else { return None };
        let other = axis_of(name).is_none() && !NORMAL_NAMES.contains(&name.as_str());
        other.then(|| Attribute {
            name: name.clone(),
            number: number_type(kind).kept_as(),
            values: Vec::new(),
        })
    };
    vertex.properties.iter().filter_map(one).collect()
}

/// Whether vertices have a normal, as three numbers.
pub(super) fn has_normals(vertex: &ElementDef) -> bool {
    NORMAL_NAMES.iter().all(|name| {
        vertex.properties.get(*name).is_some_and(|p| matches!(p.data_type, PropertyType::Scalar(_)))
    })
}

/// Whether any element from `from` on is of interest; what comes later need not be decoded.
pub(super) fn wanted(elements: &[ElementDef], want: Want) -> bool {
    elements.iter().any(|e| e.name == "vertex" || (e.name == "face" && want == Want::Mesh))
}

/// The warning about what stands behind all that the header promises.
pub(super) fn more(what: &str) -> String {
    format!("{what} behind the last element were not read: the counts of the header may be too small")
}

/// The error of element `index` running out of bytes.
pub(super) fn cut_short(def: &ElementDef, index: usize) -> Error {
    Error::new(ErrorKind::Format, format!("truncated: {} promised, {index} are whole", def.count))
        .at_element(format!("{} {index}", def.name))
        .advise("fetch the file again; if it is whole, its header is wrong")
}
