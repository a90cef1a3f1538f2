//! The defaults that the docs of options state are those of [`Config::default`].

use super::Config;

/// The structs that options are fields of: the path of the struct in the configuration, its name, and its source.
const GROUPS: [(&str, &str, &str); 7] = [
    ("", "Config", include_str!("mod.rs")),
    ("start.", "Start", include_str!("mod.rs")),
    ("band.", "Band", include_str!("mod.rs")),
    ("batch.", "Batch", include_str!("mod.rs")),
    ("field.", "FieldConfig", include_str!("../../field/config.rs")),
    ("bsp.", "BspConfig", include_str!("../../bsp/config.rs")),
    ("weights.", "Weights", include_str!("../objective.rs")),
];

/// Fields of a struct with their docs, each in one line.
fn documented(source: &str, name: &str) -> Vec<(String, String)> {
    let start = format!("pub struct {name} {{");
    let body = source.lines().map(str::trim).skip_while(|line| *line != start).skip(1);
    let mut fields = Vec::new();
    let mut docs = String::new();
    for line in body.take_while(|line| *line != "}") {
        if let Some(text) = line.strip_prefix("///") {
            docs += text;
        } else if let Some((field, _)) = line.strip_prefix("pub ").and_then(|rest| rest.split_once(':')) {
            fields.push((field.to_string(), std::mem::take(&mut docs)));
        }
    }
    fields
}

/// The loss terms with the docs of their weights, by the entries `name, "docs": ...` of their table.
fn documented_weights(source: &str) -> Vec<(String, String)> {
    let entries = source.lines().filter_map(|line| line.trim().split_once("\": "));
    entries
        .filter_map(|(entry, _)| entry.split_once(", \""))
        .map(|(name, docs)| (name.to_string(), docs.to_string()))
        .collect()
}

/// What follows `word` in some docs, as the text of an option: the part in backticks, or the number, or the word.
fn stated(docs: &str, word: &str) -> Option<String> {
    let (_, rest) = docs.split_once(word)?;
    let rest = rest.trim_start();
    if let Some(quoted) = rest.strip_prefix('`') {
        return quoted.split_once('`').map(|(value, _)| value.to_string());
    }
    let value = rest.split([' ', ';']).next()?.trim_end_matches(['.', ',']);
    Some(value.replace(',', ""))
}

#[test]
fn the_docs_state_the_defaults() {
    let config = Config::default();
    let entries = config.entries();
    let mut found = Vec::new();
    let mut compare = |key: String, docs: &str, word: &str| {
        let Some((_, value)) = entries.iter().find(|(k, _)| *k == key) else { return };
        let text = stated(docs, word).unwrap_or_else(|| panic!("{key}: no {word:?} in {docs:?}"));
        let mut read = Config::preset(super::Preset::Paper);
        read.set(&key, &text).unwrap_or_else(|e| panic!("{e}: {docs}"));
        let read = read.entries().into_iter().find(|(k, _)| *k == key).unwrap().1;
        assert_eq!(read, *value, "{key}: {docs}");
        found.push(key);
    };
    for (path, name, source) in GROUPS {
        let mut fields = documented(source, name);
        if name == "Weights" {
            fields.extend(documented_weights(source));
        }
        for (field, docs) in fields {
            let key = format!("{path}{field}");
            compare(key.clone(), &docs, "Default ");
            if field.ends_with("_rate") {
                for part in ["base", "warmup", "decay"] {
                    compare(format!("{key}.{part}"), &docs, &format!(" {part} "));
                }
            }
        }
    }
    let missing: Vec<_> = entries.iter().filter(|(key, _)| !found.iter().any(|f| f == key)).collect();
    assert!(missing.is_empty(), "no docs of {missing:?}");
    assert_eq!(found.len(), entries.len());
}
