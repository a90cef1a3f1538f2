//! `sdf`: values of a saved field.

use std::fmt::Write;
use std::path::PathBuf;

use bijective_sdf::reconstruct::Reconstruction;
use clap::Args;

use super::Common;
use super::failure::Failure;
use super::files::print;
use super::reading::ReadArgs;

/// Arguments of `sdf`.
#[derive(Debug, Args)]
pub struct SdfArgs {
    /// A field that `reconstruct --save-field` wrote
    field: PathBuf,
    /// Points in the coordinates of the reconstructed cloud, or `-`
    points: PathBuf,
    /// Print the gradient behind each value
    #[arg(long)]
    gradient: bool,
    #[command(flatten)]
    reading: ReadArgs,
}

/// Prints a line a point.
pub fn run(args: &SdfArgs, common: Common) -> Result<(), Failure> {
    let field = Reconstruction::load(&args.field).map_err(Failure::Input)?;
    field.notices().iter().for_each(|notice| common.note(notice));
    // A line is printed for every row, so none may be left out.
    let cloud = args.reading.rows(&args.points)?.cloud()?;
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
    print(text)
}
