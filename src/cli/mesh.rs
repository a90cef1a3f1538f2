//! `mesh`: the surface of a saved field.

use std::path::PathBuf;

use bijective_sdf::io::Format;
use clap::Args;

use super::Common;
use super::failure::Failure;
use super::files::{Input, MESH_FORMATS, Output, check_apart, check_writable, format_parser, write_bytes};
use super::machine::check_memory;
use super::preview::{View, ViewArgs, check_picture, render};
use super::reconstruct::RESOLUTION;
use super::report::{gate, gate_open};
use super::trim::{Part, TrimArgs};

/// Arguments of `mesh`.
#[derive(Debug, Args)]
pub struct MeshArgs {
    /// A field that `reconstruct --save-field` wrote, or `-`
    field: PathBuf,
    /// The mesh to write (ply, obj, stl, off, glb), or `-`
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Cubes along the longest side of the grid that the mesh is taken from; what is thinner than a cube may get lost
    #[arg(long, default_value_t = RESOLUTION, value_parser = super::reconstruct::resolution_parser())]
    resolution: usize,
    /// Format of the mesh [default: by extension; ply for `-`]
    #[arg(long, value_parser = format_parser())]
    output_format: Option<Format>,
    /// Write text where the format also has a binary form
    #[arg(long)]
    ascii: bool,
    #[command(flatten)]
    trim: TrimArgs,
    #[command(flatten)]
    view: ViewArgs,
}

/// Writes the mesh of a field.
pub fn run(args: &MeshArgs, common: Common) -> Result<(), Failure> {
    let output = Output::new(&args.output, args.output_format, args.ascii, &MESH_FORMATS)?;
    check_apart("--output", &args.output, &args.field)?;
    if let Some(path) = &args.view.preview {
        check_writable(path)?;
        check_picture(path)?;
        check_apart("--preview", path, &args.field)?;
    }
    let field = Input::read(&args.field, None)?.field()?;
    field.notices().iter().for_each(|notice| common.note(notice));
    check_memory(field.config(), args.resolution, common)?;
    let Part { mesh, cut } = args.trim.part(field.mesh(args.resolution)?, field.cloud(), common)?;
    let topology = mesh.topology();
    output.write_mesh(&mesh)?;
    if let Some(path) = &args.view.preview {
        let image = render(field.cloud(), &mesh, &View::from(&args.view))?;
        write_bytes(path, &image.to_png())?;
    }
    common.note(&topology.to_string());
    if cut.is_some() { gate_open(&topology) } else { gate(&topology) }
}
