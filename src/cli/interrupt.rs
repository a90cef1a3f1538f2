//! Ctrl-C, and the signals to terminate and to hang up: during training they ask for an orderly end, at any other time
//! and the second time they end the program.

use std::io;
use std::process;
use std::sync::{Arc, Mutex, PoisonError};

use super::console::say;
use super::failure::Failure;

/// What a signal finds the program doing.
#[derive(Clone, Debug, Default, PartialEq)]
enum State {
    /// No work that an orderly end would save.
    #[default]
    Idle,
    /// The steps are done; the text says what is kept if the program ends now.
    Kept(String),
    /// In the steps: the first signal asks for an end.
    Training,
    /// That signal has come.
    Asked,
}

/// Shared between the handler and the training loop.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<Mutex<State>>);

impl Interrupt {
    /// Installs the handler; once a process. `answer` is what it says the first time.
    pub fn install(answer: &'static str) -> Result<Self, Failure> {
        let interrupt = Interrupt::default();
        let seen = interrupt.clone();
        watch(move || {
            let mut state = seen.lock();
            match &*state {
                State::Training => {
                    *state = State::Asked;
                    say(&format!("\n{answer}; press Ctrl-C again to end at once"));
                    return;
                }
                State::Kept(text) => say(&format!("\ninterrupted: {text}")),
                State::Idle | State::Asked => {}
            }
            // Results are written to temporary files first, so ending here leaves no half of one (but maybe a
            // temporary file, which the next run removes).
            process::exit(130);
        })
        .map_err(|e| Failure::Usage(format!("cannot watch for Ctrl-C ({e})")))?;
        Ok(interrupt)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// From here on a first Ctrl-C only asks.
    pub fn begin(&self) {
        *self.lock() = State::Training;
    }

    /// From here on Ctrl-C ends the program at once. Returns whether it was pressed during the steps.
    pub fn end(&self) -> bool {
        std::mem::take(&mut *self.lock()) == State::Asked
    }

    /// From here on Ctrl-C ends the program, and says what is kept.
    pub fn kept(&self, text: String) {
        *self.lock() = State::Kept(text);
    }

    /// Whether Ctrl-C was pressed.
    pub fn asked(&self) -> bool {
        *self.lock() == State::Asked
    }
}

/// Calls `handle`, on a thread of its own, at every signal to interrupt, to terminate and, unless the program was
/// started so as to ignore it (as `nohup` does), to hang up.
#[cfg(unix)]
fn watch(mut handle: impl FnMut() + Send + 'static) -> io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let hang_up = (!ignores(SIGHUP)).then_some(SIGHUP);
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM].into_iter().chain(hang_up))?;
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || signals.forever().for_each(|_| handle()))?;
    Ok(())
}

/// Whether the process ignores a signal. Where the system does not tell, one to hang up is taken for ignored: then it
/// is left as it is.
#[cfg(unix)]
fn ignores(signal: i32) -> bool {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return true };
    ignored(&status, signal)
}

/// The same from what Linux tells of a process.
#[cfg(unix)]
fn ignored(status: &str, signal: i32) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_none_or(|mask| mask >> (signal - 1) & 1 == 1)
}

#[cfg(not(unix))]
fn watch(handle: impl FnMut() + Send + 'static) -> io::Result<()> {
    ctrlc::set_handler(handle).map_err(io::Error::other)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn the_mask_of_ignored_signals_is_read() {
        let status = "Name:\tx\nSigBlk:\t0000000000000000\nSigIgn:\t0000000000001001\nSigCgt:\t0\n";
        assert!(ignored(status, 1) && ignored(status, 13) && !ignored(status, 2));
        assert!(ignored("Name:\tx\n", 1));
    }
}
