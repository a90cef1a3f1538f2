//! `completions` and `man`: what shells and readers of manuals want to know of the program.

use clap::{Args, Command};
use clap_complete::Shell;

use super::console::print;
use super::failure::Failure;

/// Arguments of `completions`.
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell
    shell: Shell,
}

/// Prints a script that tells a shell of commands and options.
pub fn completions(args: &CompletionsArgs, mut command: Command) -> Result<(), Failure> {
    let mut script = Vec::new();
    let name = command.get_name().to_string();
    clap_complete::generate(args.shell, &mut command, name, &mut script);
    print(script)
}

/// Prints the manual page: that of the program, and behind it those of its commands.
pub fn manual(mut command: Command) -> Result<(), Failure> {
    command.build();
    let mut page = Vec::new();
    clap_mangen::Man::new(command.clone()).render(&mut page).map_err(Failure::of_stdout)?;
    for sub in command.get_subcommands().filter(|sub| sub.get_name() != "help") {
        let name = format!("{}-{}", command.get_name(), sub.get_name());
        let sub = sub.clone().display_name(name.clone()).name(name);
        clap_mangen::Man::new(sub).render(&mut page).map_err(Failure::of_stdout)?;
    }
    print(page)
}
