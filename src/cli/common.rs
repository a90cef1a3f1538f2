//! The options of every command, and what they do to its messages.

use std::num::NonZeroUsize;

use clap::Args;

use super::console::say;

/// Options of every command.
#[derive(Clone, Copy, Debug, Args)]
pub struct Common {
    /// Number of threads [default: one a processor]; the result is the same for any number
    #[arg(long, global = true, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Print errors and warnings only, no progress and no notes
    #[arg(short, long, global = true)]
    pub quiet: bool,
}

impl Common {
    /// A remark on standard error, unless the user wants none.
    pub fn note(self, text: &str) {
        if !self.quiet {
            say(&format!("note: {text}"));
        }
    }

    /// A warning on standard error: the result may be another than the user thinks, so it is always told.
    pub fn warn(self, text: &str) {
        say(&format!("warning: {text}"));
    }
}
