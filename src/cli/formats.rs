//! The formats of files, as arguments name them.

use bijective_sdf::io::Format;
use clap::builder::{PossibleValuesParser, TypedValueParser};

/// The formats that meshes are written in.
pub const MESH_FORMATS: [Format; 5] = [Format::Ply, Format::Obj, Format::Stl, Format::Off, Format::Glb];
/// The formats that clouds are written in.
pub const CLOUD_FORMATS: [Format; 3] = [Format::Ply, Format::Xyz, Format::Csv];

/// Parses the name of a format that is read, and lists the names in the help.
pub fn format_parser() -> impl TypedValueParser<Value = Format> {
    parser_of(Format::ALL.into_iter().filter(|&format| format != Format::Glb).collect())
}

/// Parses the name of one of these formats, and lists the names in the help.
pub fn parser_of(formats: Vec<Format>) -> impl TypedValueParser<Value = Format> {
    let names: Vec<&str> = formats.iter().map(|format| format.name()).collect();
    PossibleValuesParser::new(names)
        .map(move |name| formats.iter().copied().find(|f| f.name() == name).expect("a listed name"))
}
