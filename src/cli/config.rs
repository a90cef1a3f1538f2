//! `presets` and `config`: what can be chosen.

use bijective_sdf::reconstruct::{Config, Phase, Preset};
use clap::Args;

use super::console::print;
use super::failure::Failure;
use super::json::quoted;
use super::settings::Settings;

/// Arguments of `config`.
#[derive(Debug, Args)]
pub struct ConfigArgs {
    #[command(flatten)]
    settings: Settings,
}

/// Prints a configuration as TOML.
pub fn run(args: &ConfigArgs) -> Result<(), Failure> {
    let (config, preset) = args.settings.build()?;
    print(format!(
        "# Delete what you do not change, but not the preset: what is left out is as there.\npreset = \"{preset}\"\n{}",
        to_toml(&config)
    ))
}

/// Prints the names of the presets and what they do.
pub fn list_presets() -> Result<(), Failure> {
    let mut text = String::new();
    for preset in Preset::ALL {
        let config = Config::preset(preset);
        let stages = config.stages.iter().map(|s| format!("{} on {} cubes", s.steps, s.resolution));
        if config.stages.is_empty() {
            text += &format!("{:8} no training; the first shape, finished\n", preset.name());
            continue;
        }
        let steps = [Phase::Start, Phase::Pretrain].map(|phase| config.steps_in(phase));
        text += &format!(
            "{:8} field {} x {}; steps: {} for the first shape, {} for the parameterization alone, then {}\n",
            preset.name(),
            config.field.depth,
            config.field.width,
            steps[0],
            steps[1],
            stages.collect::<Vec<_>>().join(" and "),
        );
    }
    text += "Surfaces of small area have finer grids than these, those of large area coarser ones (reference_area), but \
             with `paper`.\n";
    if let Some(limit) = Config::default().train_up_to {
        text += &format!(
            "Clouds of more than {limit} points keep the first shape, but with `paper`; --set train_up_to=all trains.\n"
        );
    }
    print(text)
}

/// One line an option, with what it means above it; options below an option that has a value itself get quoted keys, as
/// TOML asks.
fn to_toml(config: &Config) -> String {
    let entries = config.entries();
    let mut docs: Vec<(&str, String)> = Config::documentation();
    // The parts of a schedule share their text.
    docs.dedup_by(|next, first| next.1 == first.1);
    let below = |key: &str| {
        entries.iter().any(|(other, _)| key.strip_prefix(other).is_some_and(|rest| rest.starts_with('.')))
    };
    entries
        .iter()
        .map(|(key, value)| {
            let docs = docs.iter().find(|(documented, _)| documented == key).map(|(_, docs)| comment(docs));
            let key = if below(key) { quoted(key) } else { key.to_string() };
            format!("{}{key} = {}\n", docs.unwrap_or_default(), literal(value))
        })
        .collect()
}

/// A text as lines of a comment, after an empty line.
fn comment(text: &str) -> String {
    let mut lines = vec![String::new(), "#".to_string()];
    for word in text.split_whitespace() {
        let last = lines.last_mut().expect("not empty");
        if last.len() + word.len() < 100 {
            *last += &format!(" {word}");
        } else {
            lines.push(format!("# {word}"));
        }
    }
    lines.join("\n") + "\n"
}

/// The value as TOML: a number or truth value where it is one, else a text.
fn literal(value: &str) -> String {
    // TOML integers are signed; a larger seed is given as a text.
    let whole = value.parse::<i64>().is_ok_and(|i| i.to_string() == value);
    let float = value.parse::<f64>().is_ok_and(|f| f.is_finite())
        && format!("x = {value}").parse::<toml::Table>().is_ok();
    if whole || float || ["true", "false"].contains(&value) { value.to_string() } else { quoted(value) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_reads_back() {
        for preset in Preset::ALL {
            let config = Config::preset(preset);
            let text = to_toml(&config);
            let dir =
                std::env::temp_dir().join(format!("bijective-sdf-config-{}-{preset}", std::process::id()));
            std::fs::write(&dir, &text).unwrap();
            let settings = Settings { config: Some(dir.clone()), ..Settings::default() };
            let (back, _) = settings.build().unwrap();
            std::fs::remove_file(dir).unwrap();
            assert_eq!(back, config, "{text}");
        }
    }

    #[test]
    fn every_option_stands_below_what_it_means() {
        let text = to_toml(&Config::default());
        let lines: Vec<&str> = text.lines().collect();
        let above = |key: &str| {
            let at = lines.iter().position(|line| line.starts_with(&format!("{key} = "))).unwrap();
            lines[at - 1]
        };
        for key in ["weights.cover", "bsp.slack", "seed", "field_rate.base", "field.width"] {
            assert!(above(key).starts_with("# "), "{key}: {}", above(key));
        }
        assert!(lines.iter().all(|line| line.len() <= 100 || !line.starts_with('#')));
    }

    #[test]
    fn values_are_typed() {
        let cases = [("1", "1"), ("-0.5", "-0.5"), ("1e-3", "1e-3"), ("true", "true"), ("32:1", "\"32:1\"")];
        for (value, toml) in cases {
            assert_eq!(literal(value), toml);
        }
        assert_eq!(literal("18446744073709551615"), "\"18446744073709551615\"");
        assert_eq!(literal("inf"), "\"inf\"");
    }
}
