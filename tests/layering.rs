//! The map of the code, kept: a room uses only rooms below it, files of a room do not use each other in a circle, and
//! two house rules that no lint checks (`lib.rs` and `Cargo.toml` have the lints).

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// The rooms, those of a line above those of the line before. A room uses what is below its line, and itself.
const LAYERS: [&[&str]; 13] = [
    &["error"],
    &["simd", "random"],
    &["tensor", "linalg", "geometry"],
    &["autodiff", "io"],
    &["ops"],
    &["nn", "optim"],
    &["loss", "field"],
    &["bsp", "gdo", "start"],
    &["finish"],
    &["reconstruct"],
    &["scene"],
    &["evaluate"],
    &["cli"],
];
/// Rooms that use less than their line would allow.
const NARROW: [(&str, &[&str]); 2] = [("io", &["error", "geometry"]), ("evaluate", &["error", "geometry"])];
/// Columns of a comment, but for tables; code is the formatter's.
const MAX_COLUMNS: usize = 120;

/// Texts by the path of their file below `src`.
type Files = BTreeMap<String, String>;

fn read(dir: &Path, below: &str, out: &mut Files) {
    for entry in fs::read_dir(dir).unwrap() {
        let entry = entry.unwrap();
        let name = format!("{below}{}", entry.file_name().to_str().unwrap());
        if entry.path().is_dir() {
            read(&entry.path(), &format!("{name}/"), out);
        } else if name.ends_with(".rs") {
            out.insert(name, fs::read_to_string(entry.path()).unwrap());
        }
    }
}

fn tree() -> Files {
    let mut out = Files::new();
    read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), "", &mut out);
    assert!(out.len() > 100, "only {} files found", out.len());
    out
}

/// The code of the rooms: without tests, line comments, and what strings on one line hold.
fn code(files: &Files) -> Files {
    let mut out = files.clone();
    out.retain(|path, _| {
        !path.contains("/tests/") && !path.ends_with("tests.rs") && !path.ends_with("testing.rs")
    });
    out.retain(|path, _| path != "lib.rs" && path != "main.rs");
    out.values_mut().for_each(|text| *text = without_tests(text));
    out
}

fn without_tests(text: &str) -> String {
    let mut out = String::new();
    let mut skipped: Option<usize> = None; // The indent of an item that is left out.
    for line in text.lines() {
        let bare = line.trim_start();
        let indent = line.len() - bare.len();
        if let Some(left) = skipped {
            let ends = indent == left && (bare.starts_with('}') || bare.ends_with([';', ',']));
            skipped = (!ends).then_some(left);
        } else if bare.starts_with("#[cfg(test)]") {
            skipped = Some(indent);
        } else {
            let line = line.split("//").next().unwrap();
            out.extend(line.split('"').step_by(2)); // Every other part is inside of quotes.
            out.push('\n');
        }
    }
    out
}

/// The module path of a file: `geometry/grid/mod.rs` is geometry, grid.
fn module(path: &str) -> Vec<String> {
    let path = path.trim_end_matches(".rs").trim_end_matches("/mod");
    path.split('/').map(str::to_string).collect()
}

/// Every path from `crate::`, `super::`, or a module of the file's own, that a file names, as module names from the
/// root; of `a::{b, c::d}` both. That a `mod.rs`, the door of its room, re-exports what its files have does not count.
fn paths(path: &str, code: &str) -> BTreeSet<Vec<String>> {
    let modules = code.lines().filter_map(|line| line.strip_suffix(';')?.split("mod ").nth(1));
    let mut out = BTreeSet::new();
    for root in modules.chain(["crate", "super"]) {
        for (at, _) in code.match_indices(&format!("{root}::")) {
            let before = code[..at].rsplit('\n').next().unwrap();
            let inner = before.ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':');
            let exported = before.starts_with("pub") && before.ends_with(" use ");
            if inner || exported && !["crate", "super"].contains(&root) {
                continue;
            }
            let (mut rest, mut from) = (&code[at..], module(path));
            while let Some(after) = rest.strip_prefix("super::") {
                (rest, _) = (after, from.pop());
            }
            if let Some(after) = rest.strip_prefix("crate::") {
                (rest, from) = (after, Vec::new());
            }
            expand(rest, &from, &mut out);
        }
    }
    out
}

/// Adds the paths of a use tree behind `prefix`, and returns what follows it.
fn expand<'a>(text: &'a str, prefix: &[String], out: &mut BTreeSet<Vec<String>>) -> &'a str {
    let text = text.trim_start();
    if let Some(mut rest) = text.strip_prefix('{') {
        loop {
            rest = expand(rest, prefix, out).trim_start();
            match rest.strip_prefix(',') {
                Some(next) => rest = next,
                None => return rest.strip_prefix('}').unwrap_or(rest),
            }
        }
    }
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    let (name, rest) = text.split_at(end);
    let mut path = prefix.to_vec();
    path.extend((!name.is_empty() && name != "self").then(|| name.to_string()));
    if let Some(next) = rest.strip_prefix("::") {
        return expand(next, &path, out);
    }
    out.insert(path);
    rest
}

/// The file that defines what a path names: through the re-exports of the doors on the way.
fn definition(path: &[String], sources: &Files) -> Option<String> {
    let (len, file) = (1..=path.len()).rev().find_map(|len| {
        let stem = path[..len].join("/");
        let files = [format!("{stem}.rs"), format!("{stem}/mod.rs")];
        Some((len, files.into_iter().find(|file| sources.contains_key(file))?))
    })?;
    if !file.ends_with("/mod.rs") {
        return Some(file);
    }
    let name = path.get(len)?;
    let mut exports = BTreeSet::new();
    for item in sources[&file].split("use ").skip(1) {
        expand(item, &path[..len], &mut exports);
    }
    let from = exports.iter().find(|export| export.last() == Some(name) && export.len() > len + 1);
    from.and_then(|export| definition(export, sources)).or(Some(file))
}

/// Every use of a room that its user may not use.
fn arrows(sources: &Files) -> Vec<String> {
    let layer = |room: &str| LAYERS.iter().position(|layer| layer.contains(&room));
    let mut out = BTreeSet::new();
    for (path, code) in sources {
        let from = &module(path)[0];
        let Some(height) = layer(from) else {
            out.insert(format!("{path}: {from} has no layer"));
            continue;
        };
        for used in paths(path, code) {
            let to = match used.first().map(String::as_str) {
                None => continue,
                Some("Error" | "ErrorKind") => "error",
                Some(room) => room,
            };
            let narrow = NARROW.iter().find(|(room, _)| room == from);
            let below = layer(to).is_some_and(|below| below < height);
            if to != from && !narrow.map_or(below, |(_, allowed)| allowed.contains(&to)) {
                out.insert(format!("{path}: {from} -> {to}"));
            }
        }
    }
    out.into_iter().collect()
}

/// Files that use each other in circles, and those on the way between two circles.
fn circles(sources: &Files) -> Vec<String> {
    let uses = |(path, code): (&String, &String)| {
        let files = paths(path, code).into_iter().filter_map(|used| definition(&used, sources));
        (path.clone(), files.filter(|file| file != path).collect::<BTreeSet<_>>())
    };
    let mut left: BTreeMap<_, _> = sources.iter().map(uses).collect();
    // A file that uses none of those left, or that none of them uses, is in no circle.
    while let Some(end) = left.keys().find(|file| {
        left[*file].iter().all(|used| !left.contains_key(used))
            || left.values().all(|used| !used.contains(*file))
    }) {
        left.remove(&end.clone());
    }
    left.into_keys().map(|file| format!("{file} uses itself")).collect()
}

/// Breaches of the house rules that no lint sees, as `file:line: rule`.
fn breaches(files: &Files) -> Vec<String> {
    let mut out = Vec::new();
    for (path, text) in files {
        for (i, line) in text.lines().enumerate() {
            let bare = line.trim_start();
            let table = bare.trim_start_matches(['/', '!']).trim_start().starts_with('|');
            let wide = bare.starts_with("//") && !table && line.chars().count() > MAX_COLUMNS;
            let glob = bare.starts_with("pub") && bare.contains(" use ") && bare.contains('*');
            out.extend(wide.then(|| format!("{path}:{}: a comment of more than 120 columns", i + 1)));
            out.extend(glob.then(|| format!("{path}:{}: a glob re-export", i + 1)));
        }
    }
    out
}

#[track_caller]
fn none(found: &[String]) {
    assert!(found.is_empty(), "\n{}\n", found.join("\n"));
}

#[test]
fn rooms_use_rooms_below_them() {
    none(&arrows(&code(&tree())));
}

#[test]
fn files_of_a_room_form_no_circles() {
    none(&circles(&code(&tree())));
}

#[test]
fn house_rules() {
    none(&breaches(&tree()));
}

/// Made-up files.
fn made_up(files: &[(&str, &str)]) -> Files {
    files.iter().map(|(path, text)| (path.to_string(), text.to_string())).collect()
}

/// Checks a rule on files of one line: what it finds ends with the text beside it, and is nothing where that is empty.
#[track_caller]
fn finds(rule: impl Fn(&Files) -> Vec<String>, cases: &[(&str, &str, &str)]) {
    for (path, text, end) in cases {
        let found = rule(&made_up(&[(path, text)]));
        let one = found.len() == 1 && found[0].ends_with(end);
        assert!(if end.is_empty() { found.is_empty() } else { one }, "{path}: {text}: {found:?}");
    }
}

#[test]
fn upward_arrows_are_found_however_they_are_written() {
    finds(
        |files| arrows(&code(files)),
        &[
            ("tensor/mod.rs", "use crate::autodiff::Tape;", "tensor -> autodiff"),
            ("tensor/rows.rs", "use super::super::ops;", "tensor -> ops"),
            ("io/ply/text.rs", "fn f() { super::super::super::nn::g() }", "io -> nn"),
            ("tensor/mod.rs", "use crate::{error::Error,\n    ops::{a, b}};", "tensor -> ops"),
            ("tensor/mod.rs", "#[cfg(test)]\nmod tests {\n}\nuse crate::loss::x;", "tensor -> loss"),
            ("tensor/mod.rs", "pub use crate::geometry::KdTree;", "tensor -> geometry"),
            ("io/obj.rs", "use crate::tensor::Tensor;", "io -> tensor"),
            ("nn/mlp.rs", "use crate::Trainer;", "nn -> Trainer"),
            ("extra/mod.rs", "", "extra has no layer"),
            ("ops/matmul.rs", "use crate::autodiff::{At, Op}; use crate::tensor::{MatRef, gemm};", ""),
            ("start/fit.rs", "use super::{GaussField, ThinPlate}; use crate::{Error, ErrorKind};", ""),
            ("tensor/mod.rs", "/// See [`crate::nn`].\nconst A: &str = \"crate::nn\";", ""),
            ("tensor/mod.rs", "#[cfg(test)]\nmod tests {\n    use crate::nn::g;\n}", ""),
            ("bsp/mod.rs", "#[cfg(test)]\nuse crate::loss::Direction;\nuse crate::nn::Mlp;", ""),
        ],
    );
}

#[test]
fn circles_are_found_through_re_exports() {
    let door = ("a/mod.rs", "mod x;\nmod y;\nmod z;\npub use x::{X, other};\npub use y::Y;");
    let x = ("a/x.rs", "use super::Y;");
    let circle = [door, x, ("a/y.rs", "use crate::a::z::Z;"), ("a/z.rs", "use super::{W, X};")];
    assert_eq!(circles(&made_up(&circle)).len(), 3);
    none(&circles(&made_up(&[door, x, ("a/y.rs", "use crate::a::z::Z;"), ("a/z.rs", "use super::W;")])));
    // W is defined in a door that uses a file which uses W.
    let door = ("a/mod.rs", "mod x;\npub use x::X;\nuse x::helper;\npub struct W;");
    assert_eq!(circles(&made_up(&[door, ("a/x.rs", "use super::W;")])).len(), 2);
    none(&circles(&made_up(&[door, ("a/x.rs", "use super::super::b::V;")])));
}

#[test]
fn breaches_of_the_house_rules_are_found() {
    let wide = "x".repeat(MAX_COLUMNS);
    finds(
        breaches,
        &[
            ("nn/mod.rs", "pub(crate) use mlp::{a, b::*};", "glob re-export"),
            ("nn/mlp.rs", &format!("    /// {wide}\n"), "columns"),
            ("nn/mlp.rs", &format!("/// | {wide} |\nfn f(x: &f32) -> f32 {{ (*x) * 2.0 }}"), ""),
        ],
    );
}
