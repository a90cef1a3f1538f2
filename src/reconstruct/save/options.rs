//! The options in saved files, read by programs of later versions.
//!
//! A file holds every option of the version that wrote it. What changes later is kept here: names that options had
//! before, and the values that stand for options which came later. A result needs only what its field and its mesh are
//! made by; of all other options it merely says with which values it was trained.

use super::store::{Store, damaged};
use crate::error::Error;
use crate::reconstruct::config::RENAMED;
use crate::reconstruct::{Config, Preset};

/// An option that older files lack.
#[derive(Clone, Copy, Debug)]
struct Added {
    key: &'static str,
    /// The first version of the file format whose files have it.
    since: u32,
    /// The value that stands for what earlier programs did.
    before: &'static str,
}

/// Options that are younger than the oldest files that are read.
const ADDED_TO_RESULTS: &[Added] = &[
    Added { key: "finish", since: 3, before: "none" },
    Added { key: "train_up_to", since: 5, before: "all" },
    Added { key: "band.shift", since: 6, before: "0" },
];
const ADDED_TO_CHECKPOINTS: &[Added] = &[Added { key: "band.shift", since: 7, before: "0" }];

/// Options that a result is read by: the shape of its network, how it is finished, and what its mesh is made by.
fn is_needed(key: &str) -> bool {
    key.starts_with("field.") || ["deformation", "finish", "min_component"].contains(&key)
}

/// Puts all options into a file.
pub(in crate::reconstruct) fn put(store: &mut Store, config: &Config) {
    for (key, value) in config.entries() {
        store.put(&format!("config.{key}"), value);
    }
}

/// The options of a checkpoint of a version, under their present names.
pub(in crate::reconstruct) fn of_checkpoint(store: &Store, version: u32) -> Vec<(String, String)> {
    stored(store, version, RENAMED, ADDED_TO_CHECKPOINTS)
}

/// The options of a file of a version, under their present names, with those that it lacks because they came later.
fn stored(store: &Store, version: u32, renamed: &[(&str, &str)], added: &[Added]) -> Vec<(String, String)> {
    let mut found: Vec<(String, String)> = Vec::new();
    for (key, value) in &store.values {
        if let Some(key) = key.strip_prefix("config.") {
            let present = renamed.iter().find(|(old, _)| *old == key).map_or(key, |(_, new)| new);
            found.push((present.to_string(), Config::usual_text(present, value)));
        }
    }
    for option in added.iter().filter(|option| version < option.since) {
        if !found.iter().any(|(key, _)| key == option.key) {
            found.push((option.key.to_string(), option.before.to_string()));
        }
    }
    found
}

/// The options of a saved result of a version, and what has to be said about them. Of options that the result does not
/// need, unknown ones and values that are none of theirs are left out, and missing ones are those of the preset
/// `default`.
///
/// # Errors
/// [`Checkpoint`](crate::ErrorKind::Checkpoint) if an option that the result needs is missing or cannot be used.
pub(in crate::reconstruct) fn of_result(store: &Store, version: u32) -> Result<(Config, Vec<String>), Error> {
    result_from(&stored(store, version, RENAMED, ADDED_TO_RESULTS))
}

/// The options of a checkpoint of a version, as a configuration; all of them must be known and usable.
///
/// # Errors
/// [`Checkpoint`](crate::ErrorKind::Checkpoint) if one is missing, unknown or cannot be used.
pub(super) fn of_run(store: &Store, version: u32) -> Result<(Config, Vec<String>), Error> {
    let (config, notices) = result_from(&of_checkpoint(store, version))?;
    config.validate().map_err(|e| damaged("its options cannot be used").caused_by(e))?;
    Ok((config, notices))
}

fn result_from(options: &[(String, String)]) -> Result<(Config, Vec<String>), Error> {
    let unusable = |e: Error| damaged("its options cannot be used").caused_by(e);
    let mut config = Config::preset(Preset::Default);
    let mut notices = Vec::new();
    let known: Vec<&str> = config.entries().into_iter().map(|(key, _)| key).collect();
    for (key, value) in options {
        if !known.contains(&key.as_str()) {
            notices.push(format!(
                "option {key} = {value} of the file is unknown to this version and was ignored"
            ));
            continue;
        }
        match config.set(key, value) {
            Ok(()) => {}
            Err(e) if is_needed(key) => return Err(unusable(e)),
            Err(_) => notices.push(format!(
                "{value} is no value of the option {key} in this version; its default takes its place, which changes \
                 nothing about the result"
            )),
        }
    }
    for key in known {
        if options.iter().any(|(stored, _)| stored == key) {
            continue;
        }
        if is_needed(key) {
            return Err(damaged(format!("it has no config.{key}")));
        }
        notices.push(format!(
            "the file has no option {key}; its default takes its place, which changes nothing about the result"
        ));
    }
    config.validate_result().map_err(unusable)?;
    Ok((config, notices))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorKind;

    fn options(config: &Config) -> Vec<(String, String)> {
        config.entries().into_iter().map(|(key, value)| (key.to_string(), value)).collect()
    }

    fn set(options: &mut [(String, String)], key: &str, value: &str) {
        options.iter_mut().find(|(k, _)| k == key).unwrap().1 = value.into();
    }

    #[test]
    fn a_result_has_the_options_it_was_saved_with() {
        for preset in Preset::ALL {
            let config = Config { seed: 7, ..Config::preset(preset) };
            assert_eq!(result_from(&options(&config)).unwrap(), (config, Vec::new()));
        }
    }

    #[test]
    fn what_a_result_does_not_need_may_be_missing_or_strange() {
        let config = Config::preset(Preset::Fine);
        for key in config.entries().into_iter().map(|(key, _)| key) {
            let mut some = options(&config);
            some.retain(|(k, _)| k != key);
            let mut strange = options(&config);
            set(&mut strange, key, "?");
            for changed in [some, strange] {
                let outcome = result_from(&changed);
                if is_needed(key) {
                    assert_eq!(outcome.unwrap_err().kind(), ErrorKind::Checkpoint, "{key}");
                } else {
                    let (read, notices) = outcome.unwrap();
                    assert!(notices.len() == 1 && notices[0].contains(key), "{key}: {notices:?}");
                    assert_eq!((read.field, read.min_component), (config.field, config.min_component));
                }
            }
        }
        let mut more = options(&config);
        more.push(("field.sharpness".into(), "3".into()));
        let (read, notices) = result_from(&more).unwrap();
        assert!(
            read == config && notices.len() == 1 && notices[0].contains("field.sharpness = 3"),
            "{notices:?}"
        );
    }

    #[test]
    fn ranges_hold_for_what_a_result_needs_alone() {
        let config = Config::preset(Preset::Default);
        for (key, value, fits) in [
            ("field.width", "1000000000", false),
            ("field.octaves", "40", false),
            ("field.skip", "9", false),
            ("min_component", "NaN", false),
            ("batch.points", "1", true),
            ("weights.cover", "-1", true),
        ] {
            let mut changed = options(&config);
            set(&mut changed, key, value);
            assert_eq!(result_from(&changed).is_ok(), fits, "{key} = {value}");
        }
    }

    #[test]
    fn old_names_and_later_options_are_read() {
        let mut store = Store::default();
        store.put("kind", "result");
        store.put("config.old.name", 3);
        store.put("config.seed", 4);
        // Earlier versions wrote 0 for what has a word today.
        store.put("config.clip", 0);
        store.put("config.batch.thin", "0.5");
        let renamed = [("old.name", "new.name")];
        let added =
            [Added { key: "later", since: 3, before: "off" }, Added { key: "seed", since: 3, before: "0" }];
        let read = |version: u32| stored(&store, version, &renamed, &added);
        let pair = |key: &str, value: &str| (key.to_string(), value.to_string());
        // What the file has wins over what stands for it in older ones.
        let present =
            [pair("new.name", "3"), pair("seed", "4"), pair("clip", "off"), pair("batch.thin", "0.5")];
        assert_eq!(read(2), [&present[..], &[pair("later", "off")]].concat());
        assert_eq!(read(3), present);
        // The names of today are those that options have, and no option has an old one.
        let known: Vec<&str> = Config::default().entries().into_iter().map(|(key, _)| key).collect();
        let present = ADDED_TO_RESULTS.iter().chain(ADDED_TO_CHECKPOINTS).map(|option| option.key);
        assert!(RENAMED.iter().map(|(_, new)| *new).chain(present).all(|key| known.contains(&key)));
        assert!(RENAMED.iter().all(|(old, _)| !known.contains(old)));
    }
}
