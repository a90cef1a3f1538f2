//! The program `bijective-sdf`: meshes and signed distance fields from sparse point clouds, on the command line.

use std::process::ExitCode;

mod cli;

fn main() -> ExitCode {
    cli::run()
}
