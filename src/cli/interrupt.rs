//! Ctrl-C, and the signals to terminate and to hang up: during training they ask for an orderly end, at any other time
//! and the second time they end the program.

use std::process;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use super::failure::Failure;
use super::files::say;

const IDLE: u8 = 0;
const TRAINING: u8 = 1;
const ASKED: u8 = 2;

/// Shared between the handler and the training loop.
#[derive(Clone, Debug)]
pub struct Interrupt(Arc<AtomicU8>);

impl Interrupt {
    /// Installs the handler; once a process. `answer` is what it says the first time.
    pub fn install(answer: &'static str) -> Result<Self, Failure> {
        let state = Arc::new(AtomicU8::new(IDLE));
        let seen = Arc::clone(&state);
        ctrlc::set_handler(move || {
            if seen.compare_exchange(TRAINING, ASKED, Ordering::SeqCst, Ordering::SeqCst).is_err() {
                // Results are written to temporary files first, so ending here leaves no half of one (but maybe a
                // temporary file).
                process::exit(130);
            }
            say(&format!("\n{answer}; press Ctrl-C again to end at once"));
        })
        .map_err(|e| Failure::Usage(format!("cannot watch for Ctrl-C ({e})")))?;
        Ok(Interrupt(state))
    }

    /// From here on a first Ctrl-C only asks.
    pub fn begin(&self) {
        self.0.store(TRAINING, Ordering::SeqCst);
    }

    /// From here on Ctrl-C ends the program; whether it was pressed before.
    pub fn end(&self) -> bool {
        self.0.swap(IDLE, Ordering::SeqCst) == ASKED
    }

    /// Whether Ctrl-C was pressed.
    pub fn asked(&self) -> bool {
        self.0.load(Ordering::SeqCst) == ASKED
    }
}
