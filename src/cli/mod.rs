//! Arguments, files, progress and printing of the program; what is computed is computed by the library.

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

mod carry;
mod cleaning;
mod codes;
mod common;
mod config;
mod config_text;
mod console;
mod coverage;
mod demo;
mod evaluate;
mod failure;
mod fineness;
mod formats;
mod info;
mod input;
mod interrupt;
mod json;
mod lock;
mod machine;
mod mesh;
mod output;
mod paths;
mod points;
mod preview;
mod progress;
mod reading;
mod reconstruct;
mod report;
mod sample;
mod sdf;
mod settings;
mod shell;
mod sides;
mod suite;
mod train;
mod trim;

use common::Common;
use failure::Failure;

const AFTER: &str = "Exit codes: 0 done, 1 failure, 2 wrong usage, 3 bad input, 4 finished but the mesh is not closed \
                     and oriented, 130 interrupted (during the steps a checkpoint is written first; while the mesh \
                     is made the field is kept).\n\
                     A file name `-` means standard input or output. Results go to standard output, messages to \
                     standard error.";

/// Signed distance fields and closed meshes from sparse, unoriented point clouds.
#[derive(Debug, Parser)]
#[command(name = "bijective-sdf", version, after_help = AFTER, max_term_width = 110)]
struct Cli {
    #[command(flatten)]
    common: Common,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Fit a signed distance field to a point cloud and write its closed triangle mesh
    Reconstruct(Box<reconstruct::ReconstructArgs>),
    /// Reconstruct a built-in shape and compare with the true surface
    Demo(demo::DemoArgs),
    /// Write the mesh of a saved field
    Mesh(mesh::MeshArgs),
    /// Print the signed distances of a saved field at points, in the unit of the reconstructed cloud, negative inside
    Sdf(sdf::SdfArgs),
    /// Compare reconstructed meshes with ground truths
    Evaluate(evaluate::EvaluateArgs),
    /// Run shapes x settings x seeds and tabulate how good the results are
    Suite(Box<suite::SuiteArgs>),
    /// Draw random points from a mesh
    Sample(sample::SampleArgs),
    /// Describe a point cloud, a mesh, a saved field or a checkpoint
    Info(info::InfoArgs),
    /// List the presets
    Presets,
    /// Print a configuration as TOML, to edit and give to --config
    Config(config::ConfigArgs),
    /// Print the completions of commands and options for a shell
    Completions(shell::CompletionsArgs),
    /// Print the manual page
    Man,
}

/// Runs the program on the process's arguments and says how it should exit.
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    match dispatch(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            if let Some(line) = failure.line() {
                console::say(&line);
            }
            ExitCode::from(failure.code())
        }
    }
}

fn dispatch(cli: &Cli) -> Result<(), Failure> {
    if let Some(threads) = cli.common.threads {
        machine::check_threads(threads.get())?;
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads.get())
            .build_global()
            .map_err(|e| Failure::Usage(format!("cannot start {threads} threads ({e})")))?;
    }
    // Everything on a thread of the pool: from outside, each parallel loop would wait for a thread to wake up.
    rayon::scope(|_| execute(cli))
}

fn execute(cli: &Cli) -> Result<(), Failure> {
    match &cli.command {
        Command::Reconstruct(args) => reconstruct::run(args, cli.common),
        Command::Demo(args) => demo::run(args, cli.common),
        Command::Mesh(args) => mesh::run(args, cli.common),
        Command::Sdf(args) => sdf::run(args, cli.common),
        Command::Evaluate(args) => evaluate::run(args, cli.common),
        Command::Suite(args) => suite::run(args, cli.common),
        Command::Sample(args) => sample::run(args, cli.common),
        Command::Info(args) => info::run(args, cli.common),
        Command::Presets => config::list_presets(),
        Command::Config(args) => config::run(args),
        Command::Completions(args) => shell::completions(args, Cli::command()),
        Command::Man => shell::manual(Cli::command()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arguments_are_consistent() {
        Cli::command().debug_assert();
    }
}
