//! How far training is: a bar on a terminal, else a line now and then.

use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use bijective_sdf::reconstruct::{Phase, StepReport, Trainer};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::console::say;

/// Time between lines where there is no terminal.
const PAUSE: Duration = Duration::from_secs(10);

/// Shows steps.
pub struct Progress {
    shown: Shown,
    /// The phase of the last step.
    current: Option<Current>,
    began: Instant,
    before: usize,
    total: usize,
    recoveries: usize,
}

/// The phase that a run is in.
struct Current {
    phase: Phase,
    /// When this run came to it.
    began: Instant,
    /// The steps made before.
    steps_before: usize,
}

enum Shown {
    Nothing,
    Lines { last: Option<Instant> },
    Bar(ProgressBar),
}

impl Progress {
    /// Progress of a training, some steps of which may be made already.
    pub fn new(trainer: &Trainer, quiet: bool) -> Self {
        let (total, before) = (trainer.total_steps(), trainer.steps_done());
        let shown = if quiet {
            Shown::Nothing
        } else if io::stderr().is_terminal() {
            let bar =
                ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr_with_hz(8));
            let style = ProgressStyle::with_template("{bar:20} {pos}/{len}  {wide_msg}")
                .expect("a valid template")
                .progress_chars("=> ");
            bar.set_style(style);
            bar.set_position(before as u64);
            Shown::Bar(bar)
        } else {
            Shown::Lines { last: None }
        };
        Progress {
            shown,
            current: None,
            began: Instant::now(),
            before,
            total,
            recoveries: trainer.recoveries(),
        }
    }

    /// Shows the losses of a step.
    pub fn step(&mut self, trainer: &Trainer, report: &StepReport) {
        let done = trainer.steps_done();
        if trainer.recoveries() > self.recoveries {
            self.recoveries = trainer.recoveries();
            let reason = trainer.last_recovery().unwrap_or("training went wrong");
            self.note(&format!("{reason}; going on from an earlier state with smaller steps"));
        }
        let new_phase = self.current.as_ref().is_none_or(|current| current.phase != report.phase);
        if new_phase {
            // Steps of different phases take different times; the first of all may have begun before.
            let (began, steps_before) = match self.current {
                None => (self.began, self.before),
                Some(_) => (Instant::now(), done),
            };
            self.current = Some(Current { phase: report.phase, began, steps_before });
        }
        let text = self.describe(done, report);
        match &mut self.shown {
            Shown::Nothing => {}
            Shown::Lines { last } => {
                let due = new_phase || last.is_none_or(|t| t.elapsed() >= PAUSE) || done == self.total;
                if due {
                    *last = Some(Instant::now());
                    say(&format!("step {done}/{}  {text}", self.total));
                }
            }
            Shown::Bar(bar) => {
                bar.set_position(done as u64);
                bar.set_message(text);
            }
        }
    }

    /// Shows a line without disturbing the bar.
    pub fn note(&self, text: &str) {
        match &self.shown {
            Shown::Nothing => {}
            Shown::Lines { .. } => say(&format!("note: {text}")),
            Shown::Bar(bar) => bar.suspend(|| say(&format!("note: {text}"))),
        }
    }

    /// Leaves the last state on the screen.
    pub fn finish(self) {
        if let Shown::Bar(bar) = self.shown {
            bar.abandon();
        }
    }

    fn describe(&self, done: usize, r: &StepReport) -> String {
        // On a narrow terminal the end is cut off.
        match r.phase {
            Phase::Start => format!("first shape  distance {:.2e}", r.loss),
            Phase::Pretrain => format!("parameterization alone  para {:.2e}", r.terms.para),
            _ => {
                let mut text = format!("{}loss {:.2e}", self.left(done), r.loss);
                for (name, value) in r.terms.each().into_iter().filter(|(_, value)| *value > 0.0) {
                    text += &format!("  {name} {value:.1e}");
                }
                text + &r.resolution.map_or(String::new(), |cubes| format!("  grid {cubes}"))
            }
        }
    }

    /// About how long the training still takes, by the steps of its kind made so far.
    fn left(&self, done: usize) -> String {
        match self.current {
            Some(Current { began, steps_before, .. }) if done > steps_before => {
                let step = began.elapsed().as_secs_f64() / (done - steps_before) as f64;
                format!("{} left  ", duration(step * self.total.saturating_sub(done) as f64))
            }
            _ => String::new(),
        }
    }
}

/// A number of seconds for reading.
pub fn duration(seconds: f64) -> String {
    let s = seconds.round() as u64;
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{}:{:02} min", s / 60, s % 60),
        _ => format!("{}:{:02} h", s / 3600, s / 60 % 60),
    }
}
