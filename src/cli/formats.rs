//! The formats of files, as arguments name them.

use bijective_sdf::io::Format;
use clap::builder::{PossibleValuesParser, TypedValueParser};

/// The formats that meshes are written in.
pub const MESH_FORMATS: [Format; 5] = [Format::Ply, Format::Obj, Format::Stl, Format::Off, Format::Glb];
/// The formats that clouds are written in.
pub const CLOUD_FORMATS: [Format; 3] = [Format::Ply, Format::Xyz, Format::Csv];

/// Parses the name of a format and lists the names in the help.
pub fn format_parser() -> impl TypedValueParser<Value = Format> {
    PossibleValuesParser::new(Format::ALL.map(Format::name))
        .map(|name| Format::ALL.into_iter().find(|f| f.name() == name).expect("a listed name"))
}
