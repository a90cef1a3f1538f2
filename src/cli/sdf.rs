//! `sdf`: values of a saved field, at points or on a grid.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use bijective_sdf::io::{GridFormat, write_grid_to};
use bijective_sdf::reconstruct::Reconstruction;
use clap::Args;
use clap::builder::TypedValueParser;

use super::Common;
use super::console::print;
use super::failure::Failure;
use super::input::Input;
use super::output::write_bytes;
use super::paths::{check_apart, check_writable, is_pipe};
use super::reading::ReadArgs;
use super::report::offset_text;

/// Arguments of `sdf`.
#[derive(Debug, Args)]
pub struct SdfArgs {
    /// A field that `reconstruct --save-field` wrote, or `-`
    field: PathBuf,
    /// Points in the frame and unit of the reconstructed cloud, or `-`
    #[arg(required_unless_present = "grid")]
    points: Option<PathBuf>,
    /// Print the gradient behind each value
    #[arg(long, conflicts_with = "grid")]
    gradient: bool,
    /// Write the distances on a grid around the cloud instead, with so many cubes along its longest side
    #[arg(long, value_name = "N", requires = "output", conflicts_with = "points", value_parser = cubes())]
    grid: Option<usize>,
    /// The file of the grid (npy, nrrd, vti), or of the values at points, a line each [default for points: standard
    /// output]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    reading: ReadArgs,
}

fn cubes() -> impl TypedValueParser<Value = usize> {
    clap::value_parser!(u16).range(2..=1024).map(usize::from)
}

/// Writes a line a point, or a grid.
pub fn run(args: &SdfArgs, common: Common) -> Result<(), Failure> {
    if let (Some(cubes), Some(output)) = (args.grid, &args.output) {
        return grid(args, cubes, output, common);
    }
    let Some(points) = &args.points else { return Err(Failure::Usage("points or --grid expected".into())) };
    if is_pipe(&args.field) && is_pipe(points) {
        return Err(Failure::Usage("field and points cannot both come from standard input".into()));
    }
    if let Some(output) = &args.output {
        check_writable(output)?;
        check_apart("--output", output, &args.field)?;
        check_apart("--output", output, points)?;
    }
    let field = load(args, common)?;
    // A line is written for every row, so none may be left out.
    let cloud = args.reading.rows(points)?.cloud()?;
    common.tell(&cloud.warnings, &cloud.notices);
    let values = field.sdf(&cloud.points);
    let gradients = args.gradient.then(|| field.gradient(&cloud.points));
    let mut text = String::new();
    for (i, value) in values.iter().enumerate() {
        let _ = match &gradients {
            None => writeln!(text, "{value}"),
            Some(g) => writeln!(text, "{value} {} {} {}", g[i][0], g[i][1], g[i][2]),
        };
    }
    match &args.output {
        Some(output) => write_bytes(output, text.as_bytes()),
        None => print(text),
    }
}

fn load(args: &SdfArgs, common: Common) -> Result<Reconstruction, Failure> {
    let field = Input::read(&args.field, None)?.field()?;
    field.notices().iter().for_each(|notice| common.note(notice));
    Ok(field)
}

fn grid(args: &SdfArgs, cubes: usize, output: &Path, common: Common) -> Result<(), Failure> {
    let format = match GridFormat::from_path(output) {
        Some(format) => format,
        None if is_pipe(output) => GridFormat::Nrrd,
        None => {
            let names = GridFormat::ALL.map(GridFormat::name).join(", ");
            let text = format!("{}: grids are written as one of {names}", output.display());
            return Err(Failure::Usage(text));
        }
    };
    check_writable(output)?;
    check_apart("--output", output, &args.field)?;
    let grid = load(args, common)?.grid(cubes);
    let mut bytes = Vec::new();
    write_grid_to(&mut bytes, &grid, format).map_err(Failure::Output)?;
    write_bytes(output, &bytes)?;
    let [x, y, z] = grid.size;
    common.note(&format!(
        "{x} x {y} x {z} values from {} in steps of {}",
        offset_text(grid.origin),
        bijective_sdf::geometry::format_shortest(grid.spacing)
    ));
    Ok(())
}
