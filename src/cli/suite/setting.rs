//! A named way to run: a preset, options, and what is done to the input.

use std::fs;
use std::path::Path;

use bijective_sdf::reconstruct::{Config, Preset};
use bijective_sdf::{Error, ErrorKind};
use toml::{Table, Value};

use super::super::config_text::{flatten, parse, scalar};
use super::super::failure::Failure;
use super::super::sample::Noise;
use super::super::settings::{Settings, named_preset};
use super::ablations::{ABLATIONS, Ablation, OURS, Published, changes};

/// What is done to the input before it is reconstructed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Change {
    /// So many points of the truth in place of the cloud.
    pub points: Option<usize>,
    /// Gaussian noise on every coordinate.
    pub noise: Option<Noise>,
}

/// A named way to run, before seeds.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Its name.
    pub name: String,
    /// All options; the seed does not count.
    pub config: Config,
    /// What is done to the input.
    pub input: Change,
    /// What the paper has to say about it.
    pub ablation: Option<Ablation>,
}

impl Setting {
    /// The name of its directory and files.
    pub fn file_name(&self) -> String {
        let plain = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '-' };
        self.name.chars().map(plain).collect()
    }
}

/// A table of a settings file.
#[derive(Clone, Debug, Default)]
struct Written {
    name: String,
    preset: Option<Preset>,
    options: Vec<(String, String)>,
    input: Change,
}

/// Which settings are wanted.
#[derive(Debug)]
pub struct Wanted<'a> {
    /// The base of all settings that name no preset.
    pub preset: Option<Preset>,
    /// `key=value` options that go into the base, before a setting's own.
    pub set: &'a [String],
    /// Names, of the file or built in.
    pub names: &'a [String],
    /// A TOML file with a table a setting.
    pub file: Option<&'a Path>,
    /// Whether the base and all ablations of it are wanted, too.
    pub ablations: bool,
    /// What is done to inputs where a setting does not say.
    pub input: Change,
}

impl Wanted<'_> {
    /// The settings in order, validated: those named, else those of the file, then the ablations; if nothing is wanted,
    /// the base alone.
    pub fn build(&self) -> Result<Vec<Setting>, Failure> {
        let seed = |pair: &&String| pair.split_once('=').is_some_and(|(key, _)| key.trim() == "seed");
        if let Some(pair) = self.set.iter().find(seed) {
            // The seeds of the runs would take its place.
            let value = pair.split_once('=').map_or("", |(_, value)| value.trim());
            return Err(Failure::Usage(format!("--set {pair}: give it as --seeds {value}, with the comma")));
        }
        let written = match self.file {
            Some(path) => read(path)?,
            None => Vec::new(),
        };
        let base_name = self.preset.unwrap_or(Preset::Default).name();
        let mut names: Vec<String> = self.names.to_vec();
        if names.is_empty() {
            names.extend(written.iter().map(|w| w.name.clone()));
        }
        if self.ablations {
            names.push(base_name.to_string());
            names.extend(ABLATIONS.iter().map(|a| a.name.to_string()));
        }
        if names.is_empty() {
            names.push(base_name.to_string());
        }
        let mut settings: Vec<Setting> = Vec::new();
        for name in names {
            if settings.iter().any(|s| s.name == name) {
                continue;
            }
            let setting = self.setting(&name, &written, base_name)?;
            if let Some(other) = settings.iter().find(|s| s.file_name() == setting.file_name()) {
                return Err(Failure::Usage(format!(
                    "the settings {} and {name} would share files; rename one",
                    other.name
                )));
            }
            settings.push(setting);
        }
        Ok(settings)
    }

    fn setting(&self, name: &str, written: &[Written], base_name: &str) -> Result<Setting, Failure> {
        let within = |e: Error| {
            let e = Error::new(e.kind(), format!("setting {name}")).caused_by(e);
            Failure::Library(match self.file {
                Some(path) if written.iter().any(|w| w.name == name) => e.in_file(path),
                _ => e,
            })
        };
        let mut input = self.input;
        let mut ablation = None;
        let mut config;
        let options = if let Some(own) = written.iter().find(|w| w.name == name) {
            config = self.base(own.preset)?;
            input =
                Change { points: own.input.points.or(input.points), noise: own.input.noise.or(input.noise) };
            own.options.clone()
        } else if let Ok(preset) = name.parse::<Preset>() {
            config = self.base(Some(preset))?;
            let ours = Ablation { name: preset.name(), row: Some("Ours"), published: Some(OURS) };
            ablation = (name == base_name).then_some(ours);
            Vec::new()
        } else {
            config = self.base(None)?;
            let Some(changes) = changes(name, &config) else {
                let built_in: Vec<&str> = Preset::ALL
                    .map(|p| p.name())
                    .into_iter()
                    .chain(ABLATIONS.iter().map(|a| a.name))
                    .collect();
                return Err(Failure::Usage(format!(
                    "there is no setting {name}; built in are {}, and other numbers for patch_, k_, points_ and multiple:",
                    built_in.join(", ")
                )));
            };
            input.points = changes.points.or(input.points);
            ablation = ABLATIONS.iter().find(|a| a.name == name).copied();
            changes.options
        };
        for (key, value) in &options {
            config.set(key, value).map_err(within)?;
        }
        // The seed of the run takes its place.
        config.seed = 0;
        config.validate().map_err(within)?;
        Ok(Setting { name: name.to_string(), config, input, ablation })
    }

    fn base(&self, preset: Option<Preset>) -> Result<Config, Failure> {
        let settings =
            Settings { preset: preset.or(self.preset), set: self.set.to_vec(), ..Settings::default() };
        Ok(settings.build()?.0)
    }
}

impl Ablation {
    /// The paper's figures, or three gaps.
    pub fn figures(&self) -> [Option<f64>; 3] {
        match self.published {
            Some(Published { cd_l1, cd_l2, nc }) => [Some(cd_l1), Some(cd_l2), Some(nc)],
            None => [None; 3],
        }
    }
}

/// The tables of a settings file, by name.
fn read(path: &Path) -> Result<Vec<Written>, Failure> {
    let text = fs::read_to_string(path).map_err(|e| Failure::cannot_read(path, e))?;
    Ok(tables(&text).map_err(|e| e.in_file(path))?)
}

fn tables(text: &str) -> Result<Vec<Written>, Error> {
    let mut out = Vec::new();
    for (name, value) in parse(text)? {
        let Value::Table(table) = value else {
            return Err(Error::new(ErrorKind::Config, format!("{name} belongs to no setting"))
                .advise("put options below the name of their setting, such as [mine]"));
        };
        out.push(written(&name, table).map_err(|e| {
            let e = if e.element().is_none() { e.at_element(format!("setting {name}")) } else { e };
            e.advise(format!("this is in the setting {name}"))
        })?);
    }
    Ok(out)
}

fn written(name: &str, mut table: Table) -> Result<Written, Error> {
    let bad = |key: &str, expected: &str| {
        Error::new(ErrorKind::Config, format!("{expected} expected"))
            .at_element(format!("setting {name}, {key}"))
    };
    if name.is_empty() || name.contains(['/', '\\']) || name.starts_with('.') {
        return Err(bad("name", "a name without slashes that does not begin with a dot"));
    }
    let mut own = Written { name: name.to_string(), ..Written::default() };
    if let Some(value) = table.remove("preset") {
        own.preset = Some(named_preset(&value)?);
    }
    if let Some(value) = table.remove("points") {
        let points = value.as_integer().and_then(|n| usize::try_from(n).ok()).filter(|&n| n > 0);
        own.input.points = Some(points.ok_or_else(|| bad("points", "a whole number above 0"))?);
    }
    if let Some(value) = table.remove("noise") {
        let noise = scalar("noise", &value)?.parse();
        own.input.noise = Some(noise.map_err(|e: String| bad("noise", &e))?);
    }
    if table.contains_key("seed") {
        return Err(bad("seed", "--seeds instead of this option"));
    }
    flatten("", table, &mut own.options)?;
    Ok(own)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wanted<'a>() -> Wanted<'a> {
        Wanted { preset: None, set: &[], names: &[], file: None, ablations: false, input: Change::default() }
    }

    fn names(settings: &[Setting]) -> Vec<&str> {
        settings.iter().map(|s| s.name.as_str()).collect()
    }

    #[test]
    fn without_a_wish_the_base_is_run() {
        assert_eq!(names(&wanted().build().unwrap()), ["default"]);
        let paper = Wanted { preset: Some(Preset::Paper), ..wanted() }.build().unwrap();
        assert_eq!((names(&paper), &paper[0].config), (vec!["paper"], &Config::preset(Preset::Paper)));
    }

    #[test]
    fn ablations_are_relative_to_the_base() {
        let set = ["stages=32:5".to_string(), "weights.surf=0.5".to_string()];
        let named = ["sparse".to_string(), "fine".to_string()];
        let wanted =
            Wanted { preset: Some(Preset::Fast), set: &set, names: &named, ablations: true, ..wanted() };
        let settings = wanted.build().unwrap();
        let list = names(&settings);
        assert_eq!(list[..4], ["sparse", "fine", "fast", "upsample"]);
        assert_eq!(list.len(), 2 + ABLATIONS.len());
        let find = |name: &str| settings.iter().find(|s| s.name == name).unwrap();
        for setting in &settings {
            let width = if setting.name == "fine" { 128 } else { 64 };
            assert_eq!(setting.config.field.width, width, "{}", setting.name);
            assert_eq!(setting.config.stages[0].steps, 5);
        }
        assert_eq!(find("fast").config.weights.surf, 0.5);
        assert_eq!(find("without_surf").config.weights.surf, 0.0);
        assert_eq!(find("points_1000").input.points, Some(1000));
        assert_eq!(find("fast").ablation.unwrap().published, Some(OURS));
        assert_eq!(find("fine").ablation, None);
        // 30 steps before and every sixth of 5.
        assert_eq!(find("without_deform").config.bsp_pretrain, 31);
    }

    #[test]
    fn files_hold_a_table_a_setting() {
        let text = "[wide]\npreset = \"fast\"\nfield.width = 32\n[noisy]\nnoise = 0.005\npoints = 500\n\
                    [noisy.weights]\npara = 2\n[part]\nnoise = \"1%\"\n";
        let path = std::env::temp_dir().join(format!("bijective-sdf-suite-{}.toml", std::process::id()));
        fs::write(&path, text).unwrap();
        let input = Change { points: Some(9), noise: None };
        let settings = Wanted { file: Some(&path), input, ..wanted() }.build().unwrap();
        let mut list = names(&settings);
        list.sort_unstable();
        assert_eq!(list, ["noisy", "part", "wide"]);
        let find = |name: &str| settings.iter().find(|s| s.name == name).unwrap();
        let mut wide = Config::preset(Preset::Fast);
        wide.field.width = 32;
        assert_eq!(find("wide").config, wide);
        assert_eq!(find("wide").input, input);
        assert_eq!(find("noisy").input, Change { points: Some(500), noise: Some(Noise::Absolute(0.005)) });
        assert_eq!(find("noisy").config.weights.para, 2.0);
        assert_eq!(find("part").input, Change { points: Some(9), noise: Some(Noise::Relative(0.01)) });
        // Named ones are looked for in the file first, then among the built-in ones.
        let named = ["wide".to_string(), "sparse".to_string()];
        let settings = Wanted { file: Some(&path), names: &named, ..wanted() }.build().unwrap();
        assert_eq!(names(&settings), ["wide", "sparse"]);
        for bad in [
            "width = 3\n",
            "[a]\npoints = 0\n",
            "[a]\npoints = \"x\"\n",
            "[a]\nnoise = -1\n",
            "[a]\npreset = \"best\"\n",
            "[a]\nseed = 3\n",
            "[a]\nfield.widht = 3\n",
            "[a]\nfield.width = 0\n",
            "[\"a/b\"]\nfield.width = 3\n",
            "[\"a b\"]\n[a-b]\n",
        ] {
            fs::write(&path, bad).unwrap();
            let failure = Wanted { file: Some(&path), ..wanted() }.build().unwrap_err();
            assert_eq!(failure.code(), 2, "{bad}: {failure:?}");
        }
        fs::remove_file(path).unwrap();
    }

    #[test]
    fn unknown_settings_are_refused_with_those_there_are() {
        let named = ["sparsely".to_string()];
        let failure = Wanted { names: &named, ..wanted() }.build().unwrap_err();
        assert!(failure.line().unwrap().contains("without_deform"), "{failure:?}");
    }
}
