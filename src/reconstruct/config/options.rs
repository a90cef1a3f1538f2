//! Every option under a dotted name, as text: for configuration files, command lines and checkpoints.

use crate::bsp::Parameterization;
use crate::error::{Error, ErrorKind};
use crate::field::FieldActivation;
use crate::gdo::Deformation;
use crate::optim::Decay;
use crate::reconstruct::config::{Config, Finishing, Stage, StartShape, Target};
use crate::reconstruct::objective::with_loss_terms;

/// A value as text that reads back to the same value.
trait Text: Sized {
    fn write(&self) -> String;
    /// The value, or what would have been one.
    fn read(text: &str) -> Result<Self, &'static str>;
}

struct Entry {
    key: &'static str,
    get: fn(&Config) -> String,
    /// Changes the option, or says what would have been a value of it.
    set: fn(&mut Config, &str) -> Result<(), String>,
}

/// Fields of the configuration under their paths, such as `field.width`. `or WORD`: `None` is written as WORD, and 0 is
/// read as `None`, too, for files of earlier versions. `either WORD`: only WORD means `None`.
macro_rules! entries {
    ($($first:ident $(.$rest:ident)* $(or $word:literal)? $(either $strict:literal)?;)*) => {
        &[$(Entry {
            key: concat!(stringify!($first) $(, ".", stringify!($rest))*),
            get: |c| entries!(@write c.$first$(.$rest)* $(, $word)? $(, $strict)?),
            set: |c, text| {
                c.$first$(.$rest)* = entries!(@read text $(, $word)? $(=> $strict)?);
                Ok(())
            },
        }),*]
    };
    (@write $field:expr) => { $field.write() };
    (@write $field:expr, $word:literal) => { write_or(&$field, $word) };
    (@read $text:ident) => { Text::read($text)? };
    (@read $text:ident, $word:literal) => { read_or($text, $word)? };
    (@read $text:ident => $word:literal) => { read_either($text, $word)? };
}

/// The value as text, or the word for none.
fn write_or<T: Text>(value: &Option<T>, word: &str) -> String {
    value.as_ref().map_or_else(|| word.to_string(), T::write)
}

/// The value of a text; none for the word.
fn read_either<T: Text>(text: &str, word: &str) -> Result<Option<T>, String> {
    if text == word {
        return Ok(None);
    }
    T::read(text).map(Some).map_err(|expected| format!("{expected} or {word}"))
}

/// The value of a text; none for the word, and for 0, which said the same in earlier versions.
fn read_or<T: Text + Default + PartialEq>(text: &str, word: &str) -> Result<Option<T>, String> {
    Ok(read_either(text, word)?.filter(|value| *value != T::default()))
}

const FIRST: &[Entry] = entries! {
    seed;
    scale_with_points;
    train_up_to either "all";
    denoise;
    field.width;
    field.depth;
    field.octaves;
    field.frequency;
    field.activation;
    field.skip or "none";
    field.radius;
    parameterization;
    bsp.channels;
    bsp.heads;
    bsp.neighbours;
    bsp.patch;
    bsp.code_density;
    bsp.reach or "all";
    bsp.average_positions;
    bsp.layout;
    bsp.charts;
    bsp.slack;
    bsp.normal_weight;
    bsp_pretrain;
    bsp_pretrain_on_shape;
    bsp_every or "never";
    start.shape;
    start.dipole_radius or "auto";
    start.regularity;
    start.steps;
    start.rate;
    target;
    deformation;
};

/// `weights.NAME` for every term of the loss.
macro_rules! weight_entries {
    ($($name:ident)*) => {
        &[$(Entry {
            key: concat!("weights.", stringify!($name)),
            get: |c| c.weights.$name.write(),
            set: |c, text| {
                c.weights.$name = Text::read(text)?;
                Ok(())
            },
        }),*]
    };
}

const WEIGHTS: &[Entry] = with_loss_terms!(weight_entries);

const REST: &[Entry] = entries! {
    weights.deform_decay;
    stages;
    reference_area or "off";
    band.refresh;
    band.rings;
    band.shift;
    batch.thin or "off";
    batch.points;
    batch.centres;
    surface_samples or "off";
    field_rate.base;
    field_rate.warmup;
    field_rate.decay;
    bsp_rate.base;
    bsp_rate.warmup;
    bsp_rate.decay;
    clip or "off";
    finish;
    min_component;
};

/// Names that options had in earlier versions, and those that they have now. [`Config::set`] refuses the old ones and
/// says the new ones; saved files are read under both.
pub(in crate::reconstruct) const RENAMED: &[(&str, &str)] = &[
    ("bsp.sphere", "bsp.code_density"),
    ("bsp.sheets", "bsp.normal_weight"),
    ("bsp.pretrain", "bsp_pretrain"),
    ("bsp.pretrain_on_shape", "bsp_pretrain_on_shape"),
    ("bsp.every", "bsp_every"),
    ("mesh.min_component", "min_component"),
    ("start.width", "start.dipole_radius"),
    ("weights.points", "weights.on_points"),
];

/// All options, in the order in which they are written.
fn all() -> impl Iterator<Item = &'static Entry> {
    FIRST.iter().chain(WEIGHTS).chain(REST)
}

impl Config {
    /// Changes the option of the field of this path, such as `field.width` to `64`, `stages` to `32:200,64:100` or
    /// `clip` to `off`. For an option with such a word for `None`, 0 means the same.
    ///
    /// Ranges are checked by [`validate`](Self::validate), as one option can make up for another.
    ///
    /// # Errors
    /// [`ErrorKind::Config`] if there is no such option or the text is no value of it; nothing has changed then.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), Error> {
        let Some(entry) = all().find(|e| e.key == key) else {
            return Err(unknown(key));
        };
        (entry.set)(self, value.trim()).map_err(|expected| {
            Error::new(ErrorKind::Config, format!("{value:?} is no value of it"))
                .at_element(format!("option {key}"))
                .advise(format!("use {expected}"))
        })
    }

    /// All options with their present values; [`set`](Self::set) reads each back to the same value.
    pub fn entries(&self) -> Vec<(&'static str, String)> {
        all().map(|e| (e.key, (e.get)(self))).collect()
    }

    /// A value as [`entries`](Self::entries) writes it, from any text that [`set`](Self::set) takes for it; other texts
    /// stay as they are.
    #[cfg(feature = "checkpoint")]
    pub(in crate::reconstruct) fn usual_text(key: &str, value: &str) -> String {
        let mut config = Config::default();
        match all().find(|e| e.key == key) {
            Some(entry) if config.set(key, value).is_ok() => (entry.get)(&config),
            _ => value.to_string(),
        }
    }
}

/// The error for a key that no option has.
fn unknown(key: &str) -> Error {
    let error = Error::new(ErrorKind::Config, "there is no such option").at_element(format!("option {key}"));
    if let Some((_, new)) = RENAMED.iter().find(|(old, _)| *old == key) {
        return error.advise(format!("it is called {new} now"));
    }
    match nearest_key(key) {
        Some(near) => error.advise(format!("did you mean {near}?")),
        None => error.advise("`bijective-sdf config` prints all options with what they mean"),
    }
}

/// The key that takes the fewest changed letters, if those are few.
fn nearest_key(key: &str) -> Option<&'static str> {
    let (changes, near) = all().map(|e| (edit_distance(key, e.key), e.key)).min()?;
    (changes <= 3).then_some(near)
}

/// Letters to insert, remove or replace.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, &y) in b.iter().enumerate() {
            let changed = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = changed.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

macro_rules! number {
    ($($type:ty: $expected:literal),*) => {$(
        impl Text for $type {
            fn write(&self) -> String {
                self.to_string()
            }
            fn read(text: &str) -> Result<Self, &'static str> {
                text.parse().map_err(|_| $expected)
            }
        }
    )*};
}

number!(usize: "a whole number", u64: "a whole number", f32: "a number", f64: "a number", bool: "true or false");

/// Both directions of an enumeration whose values have no parts.
macro_rules! names {
    ($type:ty, $expected:literal, $($name:literal => $value:path),*) => {
        impl Text for $type {
            fn write(&self) -> String {
                match self { $($value => $name.into()),* }
            }
            fn read(text: &str) -> Result<Self, &'static str> {
                match text { $($name => Ok($value),)* _ => Err($expected) }
            }
        }
    };
}

names!(StartShape, "sphere, gauss or plate",
    "sphere" => StartShape::Sphere, "gauss" => StartShape::Gauss, "plate" => StartShape::Plate);
names!(Finishing, "none or points", "none" => Finishing::None, "points" => Finishing::Points);
names!(Target, "surface or surface-and-cloud",
    "surface" => Target::Surface, "surface-and-cloud" => Target::SurfaceAndCloud);
names!(Deformation, "projection, tanh, offset or none",
    "projection" => Deformation::Projection, "tanh" => Deformation::Tanh,
    "offset" => Deformation::Offset, "none" => Deformation::None);

impl Text for FieldActivation {
    fn write(&self) -> String {
        match self {
            FieldActivation::Relu => "relu".into(),
            FieldActivation::Softplus { beta } => format!("softplus:{beta}"),
        }
    }
    fn read(text: &str) -> Result<Self, &'static str> {
        let expected = "relu or softplus:BETA, such as softplus:100";
        match text.split_once(':') {
            None if text == "relu" => Ok(FieldActivation::Relu),
            Some(("softplus", beta)) => {
                Ok(FieldActivation::Softplus { beta: beta.parse().map_err(|_| expected)? })
            }
            _ => Err(expected),
        }
    }
}

impl Text for Parameterization {
    fn write(&self) -> String {
        match self {
            Parameterization::Bsp => "bsp".into(),
            Parameterization::None => "none".into(),
            Parameterization::Upsample => "upsample".into(),
            Parameterization::Single => "single".into(),
            Parameterization::Multiple { maps } => format!("multiple:{maps}"),
        }
    }
    fn read(text: &str) -> Result<Self, &'static str> {
        let expected = "bsp, none, upsample, single or multiple:MAPS, such as multiple:20";
        match (text, text.split_once(':')) {
            ("bsp", _) => Ok(Parameterization::Bsp),
            ("none", _) => Ok(Parameterization::None),
            ("upsample", _) => Ok(Parameterization::Upsample),
            ("single", _) => Ok(Parameterization::Single),
            (_, Some(("multiple", maps))) => {
                Ok(Parameterization::Multiple { maps: maps.parse().map_err(|_| expected)? })
            }
            _ => Err(expected),
        }
    }
}

impl Text for Decay {
    fn write(&self) -> String {
        match self {
            Decay::Constant => "constant".into(),
            Decay::Cosine { floor } => format!("cosine:{floor}"),
            Decay::Step { every, factor } => format!("step:{every}:{factor}"),
        }
    }
    fn read(text: &str) -> Result<Self, &'static str> {
        let expected = "constant, cosine:FLOOR or step:EVERY:FACTOR, such as cosine:0.05";
        let parts: Vec<&str> = text.split(':').collect();
        match parts[..] {
            ["constant"] => Ok(Decay::Constant),
            ["cosine", floor] => Ok(Decay::Cosine { floor: floor.parse().map_err(|_| expected)? }),
            ["step", every, factor] => Ok(Decay::Step {
                every: every.parse().map_err(|_| expected)?,
                factor: factor.parse().map_err(|_| expected)?,
            }),
            _ => Err(expected),
        }
    }
}

impl Text for Vec<Stage> {
    fn write(&self) -> String {
        if self.is_empty() {
            return "none".into();
        }
        let stages: Vec<String> = self.iter().map(|s| format!("{}:{}", s.resolution, s.steps)).collect();
        stages.join(",")
    }
    fn read(text: &str) -> Result<Self, &'static str> {
        let expected = "RESOLUTION:STEPS, stages separated by commas, such as 32:200,64:100, or none";
        if text == "none" {
            return Ok(Vec::new());
        }
        let number = |text: &str| text.trim().parse::<usize>().map_err(|_| expected);
        let stage = |text: &str| {
            let (resolution, steps) = text.split_once(':').ok_or(expected)?;
            Ok(Stage { resolution: number(resolution)?, steps: number(steps)? })
        };
        text.split(',').map(stage).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::Preset;

    #[test]
    fn entries_read_back_to_the_same_configuration() {
        let mut odd = Config::preset(Preset::Fine);
        odd.seed = u64::MAX;
        odd.field.frequency = 0.1 + 0.2;
        odd.field.skip = Some(2);
        odd.parameterization = Parameterization::Multiple { maps: 7 };
        odd.field_rate.decay = Decay::Step { every: 30, factor: 0.3 };
        odd.bsp_rate.decay = Decay::Constant;
        odd.deformation = Deformation::Offset;
        let upsample = Config { parameterization: Parameterization::Upsample, ..odd.clone() };
        for config in Preset::ALL.map(Config::preset).into_iter().chain([odd, upsample]) {
            let mut read = Config::preset(Preset::Paper);
            read.seed = 99;
            for (key, value) in config.entries() {
                read.set(key, &value).unwrap();
            }
            assert_eq!(read, config);
        }
    }

    #[test]
    fn words_stand_for_none_and_so_does_zero() {
        for (key, word, some) in [
            ("field.skip", "none", "1"),
            ("bsp.reach", "all", "3"),
            ("bsp_every", "never", "4"),
            ("start.dipole_radius", "auto", "0.75"),
            ("reference_area", "off", "1.5"),
            ("batch.thin", "off", "0.5"),
            ("surface_samples", "off", "10"),
            ("clip", "off", "2"),
        ] {
            let text = |value: &str| {
                let mut config = Config::preset(Preset::Default);
                config.set(key, value).unwrap();
                config.entries().into_iter().find(|e| e.0 == key).unwrap().1
            };
            assert_eq!([text(word), text("0"), text(some)], [word, word, some]);
            let error = Config::default().set(key, "nothing").unwrap_err();
            assert!(error.advice().unwrap().ends_with(&format!("number or {word}")), "{error}");
        }
    }

    #[test]
    fn keys_are_unique_and_every_one_changes_something() {
        let (a, b) = (Config::preset(Preset::Paper), Config::preset(Preset::Default));
        let mut keys: Vec<_> = all().map(|e| e.key).collect();
        keys.sort_unstable();
        keys.dedup();
        assert_eq!(keys.len(), all().count());
        for (key, value) in a.entries() {
            let mut changed = b.clone();
            changed.set(key, &value).unwrap();
            assert_eq!(changed.entries().iter().find(|e| e.0 == key).unwrap().1, value);
            let others = |c: &Config| c.entries().into_iter().filter(|e| e.0 != key).collect::<Vec<_>>();
            assert_eq!(others(&changed), others(&b), "{key} changed another option");
        }
    }

    #[test]
    fn mistakes_say_what_to_do() {
        let mut config = Config::preset(Preset::Default);
        let before = config.clone();
        let unknown = config.set("field.widht", "3").unwrap_err();
        assert_eq!(unknown.advice(), Some("did you mean field.width?"));
        let renamed = config.set("bsp.sphere", "1").unwrap_err();
        assert_eq!(
            (renamed.kind(), renamed.advice()),
            (ErrorKind::Config, Some("it is called bsp.code_density now"))
        );
        for (key, value) in [
            ("field.width", "-1"),
            ("stages", "32"),
            ("stages", ""),
            ("field.activation", "softplus"),
            ("target", "q"),
            ("bsp.average_positions", "yes"),
            ("field_rate.decay", "step:3"),
        ] {
            let error = config.set(key, value).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Config);
            assert!(error.advice().unwrap().starts_with("use "), "{error}");
        }
        assert_eq!(config, before);
    }
}
