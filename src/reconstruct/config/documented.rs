//! What options mean, for programs: the comments of their fields, read from the sources, so that they stand once. A
//! test holds the defaults that they state against [`Config::default`].

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

impl Config {
    /// What each option means, by its key as in [`entries`](Self::entries) and in their order: the documentation of its
    /// field, in one line, with code in backticks and without links.
    pub fn documentation() -> Vec<(&'static str, String)> {
        let mut all: Vec<(String, String)> = Vec::new();
        for (path, name, source) in GROUPS {
            let mut fields = documented(source, name);
            if name == "Weights" {
                // The table's comments lie between lines of code.
                fields.extend(documented_terms(source));
            }
            all.extend(
                fields.into_iter().map(|(field, docs)| (format!("{path}{field}"), without_links(&docs))),
            );
        }
        let of = |key: &str| all.iter().find(|(k, _)| k == key).map(|(_, docs)| docs.trim().to_string());
        let keys = Config::default().entries().into_iter().map(|(key, _)| key);
        // A schedule's parts are documented with the whole.
        keys.map(|key| (key, of(key).or_else(|| of(key.rsplit_once('.')?.0)).unwrap_or_default())).collect()
    }
}

/// The loss terms with the comments above their entries, and the default that the entry states.
fn documented_terms(source: &str) -> Vec<(String, String)> {
    let mut docs = String::new();
    let mut terms = Vec::new();
    for line in source.lines().map(str::trim) {
        if let Some(text) = line.strip_prefix("///") {
            docs += text;
        } else {
            let entry = line.split_once("\": ").and_then(|(entry, _)| entry.split_once(", \""));
            let above = std::mem::take(&mut docs);
            terms.extend(entry.map(|(name, default)| (name.to_string(), above + default)));
        }
    }
    terms
}

/// Replaces `[text](target)` and `[text]` by the text.
fn without_links(docs: &str) -> String {
    let mut out = String::new();
    let mut rest = docs;
    while let Some((before, after)) = rest.split_once("[`") {
        let Some((text, tail)) = after.split_once("`]") else { break };
        out += &format!("{before}`{text}`");
        rest = tail.strip_prefix('(').and_then(|tail| tail.split_once(')')).map_or(tail, |(_, tail)| tail);
    }
    out + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::Preset;

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
            let mut read = Config::preset(Preset::Paper);
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

    #[test]
    fn every_option_is_documented_in_plain_text() {
        let all = Config::documentation();
        assert_eq!(all.len(), Config::default().entries().len());
        for (key, docs) in &all {
            assert!(docs.len() > 10 && !docs.contains("](") && !docs.contains("[`"), "{key}: {docs}");
        }
        let of = |key: &str| all.iter().find(|(k, _)| *k == key).unwrap().1.clone();
        assert!(
            of("weights.cover").contains("Default") && of("weights.cover").len() > 60,
            "{}",
            of("weights.cover")
        );
        assert_eq!(of("field_rate.base"), of("field_rate.warmup"));
        assert_eq!(without_links("see [`a`](b), [`c`] and [d]"), "see `a`, `c` and [d]");
    }
}
