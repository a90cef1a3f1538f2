//! The configuration of a run: a preset, then the options of a file, then `--set`, then `--seed`; what comes later
//! wins.

use std::fs;
use std::path::PathBuf;

use bijective_sdf::reconstruct::{Config, Preset};
use bijective_sdf::{Error, ErrorKind};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use toml::Value;

use super::config_text::{flatten, parse};
use super::console::say;
use super::failure::Failure;

/// Options that choose a configuration.
#[derive(Debug, Default, Args)]
pub struct Settings {
    /// Named configuration to start from; the options of --config and --set change it [default: default]
    #[arg(long, value_parser = preset_parser())]
    pub preset: Option<Preset>,
    /// TOML file with options, as `bijective-sdf config` prints them
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Set one option; may be repeated. `bijective-sdf config` lists the keys
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Seed of everything random
    #[arg(long)]
    pub seed: Option<u64>,
}

/// Parses the name of a preset and lists the names in the help.
pub fn preset_parser() -> impl TypedValueParser<Value = Preset> {
    PossibleValuesParser::new(Preset::ALL.map(|p| p.name())).map(|name| name.parse().expect("a listed name"))
}

impl Settings {
    /// The configuration, validated, and the preset it comes from.
    pub fn build(&self) -> Result<(Config, Preset), Failure> {
        let (config, preset) = self.build_on(None)?;
        Ok((config, preset.unwrap_or(Preset::Default)))
    }

    /// As [`build`](Self::build), but starting from the options of `run`, if there is one, unless a preset is given;
    /// returns that preset, if any.
    pub fn build_on(&self, run: Option<&Config>) -> Result<(Config, Option<Preset>), Failure> {
        let mut entries = Vec::new();
        let mut preset = self.preset;
        if let Some(path) = &self.config {
            let text = fs::read_to_string(path).map_err(|e| Failure::cannot_read(path, e))?;
            let mut table = parse(&text).map_err(|e| e.in_file(path))?;
            if let Some(name) = table.remove("preset") {
                // The command line wins over the file.
                let named = named_preset(&name).map_err(|e| e.in_file(path))?;
                preset = preset.or(Some(named));
            }
            flatten("", table, &mut entries).map_err(|e| e.in_file(path))?;
        }
        let mut config = match (preset, run) {
            (None, Some(run)) => run.clone(),
            (preset, _) => Config::preset(preset.unwrap_or(Preset::Default)),
        };
        let mut changed = 0;
        for (key, value) in &entries {
            let before = config.clone();
            config.set(key, value).map_err(|e| match &self.config {
                Some(path) => e.in_file(path),
                None => e,
            })?;
            changed += usize::from(config != before);
        }
        if let (Some(preset), Some(path), true) = (self.preset, &self.config, changed > 0) {
            say(&format!(
                "warning: {} sets {changed} options otherwise than the preset {preset}; the file wins",
                path.display()
            ));
        }
        for pair in &self.set {
            let (key, value) = pair.split_once('=').ok_or_else(|| {
                Failure::Usage(format!(
                    "--set {pair}: `key=value` expected; `bijective-sdf config` lists the keys"
                ))
            })?;
            let key = key.trim();
            if key == "preset" || key == "resolution" {
                // Options of the program, of which no setting of the method has the name.
                return Err(Failure::Usage(format!("--set {pair}: give it as --{key} {}", value.trim())));
            }
            config.set(key, value.trim())?;
        }
        if let Some(seed) = self.seed {
            config.seed = seed;
        }
        config.validate()?;
        Ok((config, preset))
    }
}

/// The preset of a name in a file.
pub fn named_preset(value: &Value) -> Result<Preset, Error> {
    value.as_str().unwrap_or_default().parse().map_err(|_| {
        let names = Preset::ALL.map(|p| p.name()).join(", ");
        Error::new(ErrorKind::Config, format!("{value} is no preset"))
            .at_element("preset")
            .advise(format!("choose one of {names}"))
    })
}
