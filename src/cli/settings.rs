//! The configuration of a run: a preset, then a file, then `--set`, then `--seed`.

use std::fs;
use std::path::PathBuf;

use bijective_sdf::reconstruct::{Config, Preset};
use bijective_sdf::{Error, ErrorKind};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use toml::{Table, Value};

use super::failure::Failure;

/// Options that choose a configuration.
#[derive(Debug, Default, Args)]
pub struct Settings {
    /// Named configuration to start from [default: default]
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
        let mut entries = Vec::new();
        let mut preset = self.preset;
        if let Some(path) = &self.config {
            let text = fs::read_to_string(path).map_err(|e| {
                Failure::Input(Error::new(ErrorKind::Io, "cannot read the file").in_file(path).caused_by(e))
            })?;
            let mut table = parse(&text).map_err(|e| e.in_file(path))?;
            if let Some(name) = table.remove("preset") {
                // The command line wins over the file.
                let named = named_preset(&name).map_err(|e| e.in_file(path))?;
                preset = preset.or(Some(named));
            }
            flatten("", table, &mut entries).map_err(|e| e.in_file(path))?;
        }
        let preset = preset.unwrap_or(Preset::Default);
        let mut config = Config::preset(preset);
        for (key, value) in &entries {
            config.set(key, value).map_err(|e| match &self.config {
                Some(path) => e.in_file(path),
                None => e,
            })?;
        }
        for pair in &self.set {
            let (key, value) = pair.split_once('=').ok_or_else(|| {
                Failure::Usage(format!(
                    "--set {pair}: `key=value` expected; `bijective-sdf config` lists the keys"
                ))
            })?;
            config.set(key.trim(), value.trim())?;
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

/// Reads TOML, or says in which line it is none.
pub fn parse(text: &str) -> Result<Table, Error> {
    text.parse::<Table>().map_err(|e| {
        let line = e
            .span()
            .map(|s| 1 + text.as_bytes()[..s.start.min(text.len())].iter().filter(|&&b| b == b'\n').count());
        let error = Error::new(ErrorKind::Config, format!("not TOML: {}", e.message()))
            .advise("`bijective-sdf config` prints a file to start from");
        match line {
            Some(line) => error.at_line(line as u64),
            None => error,
        }
    })
}

/// Tables and dotted keys become the dotted keys that [`Config::set`] knows.
pub fn flatten(prefix: &str, table: Table, out: &mut Vec<(String, String)>) -> Result<(), Error> {
    for (key, value) in table {
        let key = if prefix.is_empty() { key } else { format!("{prefix}.{key}") };
        match value {
            Value::Table(inner) => flatten(&key, inner, out)?,
            Value::Array(items) => {
                let items = items.iter().map(|v| scalar(&key, v)).collect::<Result<Vec<_>, _>>()?;
                out.push((key, items.join(",")));
            }
            value => {
                let text = scalar(&key, &value)?;
                out.push((key, text));
            }
        }
    }
    Ok(())
}

/// A single value as [`Config::set`] takes it.
pub fn scalar(key: &str, value: &Value) -> Result<String, Error> {
    match value {
        Value::String(s) => Ok(s.clone()),
        Value::Integer(i) => Ok(i.to_string()),
        Value::Float(f) => Ok(f.to_string()),
        Value::Boolean(b) => Ok(b.to_string()),
        _ => Err(Error::new(ErrorKind::Config, format!("{value} is no text, number or truth value"))
            .at_element(format!("option {key}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_and_dotted_keys_mean_the_same() {
        let flat = |text: &str| {
            let mut out = Vec::new();
            flatten("", parse(text).unwrap(), &mut out).unwrap();
            out
        };
        let want = [("a.b", "1"), ("a.c", "0.001"), ("on", "true"), ("s", "x:1,y:2")];
        let want: Vec<_> = want.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
        assert_eq!(flat("on = true\ns = \"x:1,y:2\"\n[a]\nb = 1\nc = 1e-3\n"), want);
        assert_eq!(flat("a.b = 1\na.c = 0.001\non = true\ns = [\"x:1\", \"y:2\"]\n"), want);
        assert_eq!(flat("\"a.b\" = 1\n\"a.c\" = 0.001\non = true\ns = [\"x:1\", \"y:2\"]\n"), want);
    }

    #[test]
    fn damage_is_placed() {
        let e = parse("a = 1\nb = = 2\n").unwrap_err();
        assert_eq!((e.kind(), e.line()), (ErrorKind::Config, Some(2)));
        let mut out = Vec::new();
        let e = flatten("", parse("a.when = 2020-01-01\n").unwrap(), &mut out).unwrap_err();
        assert!(e.to_string().contains("option a.when"), "{e}");
    }
}
