//! `sdf`: values of a saved field.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::failure::Failure;
use super::files::{Input, is_pipe, print};
use super::reading::ReadArgs;

/// Arguments of `sdf`.
#[derive(Debug, Args)]
pub struct SdfArgs {
    /// A field that `reconstruct --save-field` wrote, or `-`
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
    if is_pipe(&args.field) && is_pipe(&args.points) {
        return Err(Failure::Usage("field and points cannot both come from standard input".into()));
    }
    let field = Input::read(&args.field, None)?.field()?;
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
