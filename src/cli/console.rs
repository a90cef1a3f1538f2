//! Standard output for results, standard error for messages.

use std::io::{self, Write};

use super::failure::Failure;

/// Writes to standard output.
pub fn print(bytes: impl AsRef<[u8]>) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    out.write_all(bytes.as_ref()).and_then(|()| out.flush()).map_err(Failure::of_stdout)
}

/// Writes a line to standard error. Nobody can be told that this failed.
pub fn say(line: &str) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}

/// Prints all failures but the last, which it returns: `run` prints that one and exits with its code.
pub fn say_all_but_last(mut failures: Vec<Failure>) -> Option<Failure> {
    let last = failures.pop();
    failures.iter().filter_map(Failure::line).for_each(|line| say(&line));
    last
}
