//! `mesh`: the surface of a saved field.

use std::path::PathBuf;

use bijective_sdf::geometry::Bounds;
use bijective_sdf::io::{Format, ReadOptions};
use clap::Args;

use super::Common;
use super::carry::{Carried, check_format, vertex_attributes};
use super::failure::Failure;
use super::fineness::FinenessArgs;
use super::formats::{MESH_FORMATS, parser_of};
use super::input::Input;
use super::output::{Output, write_bytes};
use super::paths::{check_apart, check_writable};
use super::preview::{View, ViewArgs, check_picture, render};
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
    #[command(flatten)]
    fineness: FinenessArgs,
    /// Format of the mesh [default: by extension; ply for `-`]
    #[arg(long, value_parser = parser_of(MESH_FORMATS.to_vec()))]
    output_format: Option<Format>,
    /// Write text where the format also has a binary form
    #[arg(long)]
    ascii: bool,
    /// Give each vertex of the mesh what this cloud, from which the field was made, has beside the coordinates of the
    /// point nearest to it, such as colours (ply; obj and glb: colours only)
    #[arg(long, value_name = "CLOUD")]
    carry: Option<PathBuf>,
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
    check_format(&output, args.carry.is_some(), args.trim.support)?;
    if let Some(path) = &args.carry {
        check_apart("--output", &args.output, path)?;
        if let Some(preview) = &args.view.preview {
            check_apart("--preview", preview, path)?;
        }
    }
    let field = Input::read(&args.field, None)?.field()?;
    field.notices().iter().for_each(|notice| common.note(notice));
    args.fineness.check(field.config(), common)?;
    let carried = match &args.carry {
        Some(path) => {
            let mut options = ReadOptions::default();
            options.attributes = true;
            let cloud = Input::read_with(path, options)?.cloud()?;
            common.tell(&cloud.warnings, &cloud.notices);
            if !meets(&cloud.points, field.input_points()) {
                common.warn("the points that are carried from lie elsewhere than those of the field: is it their file?");
            }
            let every: Vec<u32> = (0..cloud.points.len() as u32).collect();
            Carried::new(cloud, &every, &output, common).0
        }
        None => Carried::default(),
    };
    let mesh = args.fineness.of(field.input_points().len()).mesh(&field)?;
    let Part { mesh, cut, support } = args.trim.part(mesh, field.input_points(), common)?;
    let topology = mesh.topology();
    output.write_mesh(&mesh, &vertex_attributes(support, carried.at(&mesh.verts)?))?;
    if let Some(path) = &args.view.preview {
        let image = render(field.input_points(), &mesh, &View::from(&args.view))?;
        write_bytes(path, &image.to_png())?;
    }
    common.note(&topology.to_string());
    if cut.is_some() { gate_open(&topology) } else { gate(&topology) }
}

/// Whether the bounding boxes of two clouds meet.
fn meets(a: &[[f64; 3]], b: &[[f64; 3]]) -> bool {
    match (Bounds::of(a), Bounds::of(b)) {
        (Ok(a), Ok(b)) => (0..3).all(|axis| a.min[axis] <= b.max[axis] && b.min[axis] <= a.max[axis]),
        _ => true,
    }
}
