//! Any text as a configuration file, and any lines as `--set KEY=VALUE`: a sound configuration or an error that says
//! which option, and options that read back to themselves.
#![no_main]

#[path = "../../src/cli/config_text.rs"]
mod config_text;

use bijective_sdf::ErrorKind;
use bijective_sdf::reconstruct::{Config, Phase, Preset};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Ok(table) = config_text::parse(text).inspect_err(check_error) {
        let mut entries = Vec::new();
        if config_text::flatten("", table, &mut entries).inspect_err(check_error).is_ok() {
            try_entries(entries.iter().map(|(key, value)| (key.as_str(), value.as_str())));
        }
    }
    // A number stands for the option of that number, so that keys need not be guessed.
    let known: Vec<&str> = Config::default().entries().into_iter().map(|(key, _)| key).collect();
    let lines = text.lines().filter_map(|line| line.split_once('='));
    try_entries(lines.map(|(key, value)| {
        let number = key.parse::<usize>().ok();
        (number.and_then(|i| known.get(i).copied()).unwrap_or(key), value)
    }));
});

/// Sets options one by one, and looks at what comes of it.
fn try_entries<'a>(entries: impl Iterator<Item = (&'a str, &'a str)>) {
    let mut config = Config::default();
    for (key, value) in entries {
        let before = config.clone();
        if let Err(error) = config.set(key, value) {
            check_error(&error);
            assert!(config == before || has_nan(&config), "{key} = {value} changed something and failed");
        }
    }
    let mut again = Config::preset(Preset::Paper);
    for (key, value) in config.entries() {
        again.set(key, &value).expect("what was written can be read");
    }
    assert_eq!(again.entries(), config.entries());
    match config.validate() {
        Err(error) => check_error(&error),
        Ok(()) => {
            assert!(again == config, "a valid configuration has no NaN");
            let mut trained = config.clone();
            trained.train_up_to = None;
            for (config, points) in [4, 3000, 1 << 24].into_iter().flat_map(|n| [(&config, n), (&trained, n)])
            {
                let adapted = config.clone().for_points(points);
                adapted.validate().expect("what is valid stays so for any number of points");
                let steps: usize = Phase::ALL.into_iter().map(|phase| adapted.steps_in(phase)).sum();
                assert_eq!(steps, adapted.total_steps());
            }
        }
    }
}

/// Not equal to itself.
#[allow(clippy::eq_op)]
fn has_nan(config: &Config) -> bool {
    config != config
}

fn check_error(error: &bijective_sdf::Error) {
    assert_eq!(error.kind(), ErrorKind::Config, "{error}");
}
