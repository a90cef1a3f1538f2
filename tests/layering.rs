//! The map of the code, kept: a room uses only rooms below it, files of a room do not use each other in a circle, and
//! a few house rules that reading can check.

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

/// Source files by their path below `src`, without comments, the contents of strings, and tests.
type Sources = BTreeMap<String, String>;

fn files(dir: &Path, root: &Path, out: &mut BTreeMap<String, String>) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(&path, root, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            let name: Vec<&str> =
                path.strip_prefix(root).unwrap().iter().map(|p| p.to_str().unwrap()).collect();
            out.insert(name.join("/"), fs::read_to_string(&path).unwrap());
        }
    }
}

fn tree() -> BTreeMap<String, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut out = BTreeMap::new();
    files(&root, &root, &mut out);
    assert!(out.len() > 100, "only {} files found", out.len());
    out
}

/// Whether a file holds tests alone.
fn is_test(path: &str) -> bool {
    path.ends_with("tests.rs") || path.contains("/tests/") || path.ends_with("testing.rs")
}

/// The code of a file: without line comments, strings on one line, and items behind `#[cfg(test)]`.
fn code(text: &str) -> String {
    let mut out = String::new();
    let mut skipped: Option<usize> = None; // The indent of an item that is left out.
    for line in text.lines() {
        let bare = line.trim_start();
        let indent = line.len() - bare.len();
        if let Some(left) = skipped {
            let ends = indent == left && (bare.starts_with('}') || bare.ends_with([';', ',']));
            skipped = (!ends).then_some(left);
            continue;
        }
        if bare.starts_with("#[cfg(test)]") {
            skipped = Some(indent);
            continue;
        }
        let line = line.split("//").next().unwrap();
        out.extend(line.split('"').step_by(2)); // Every other part is inside of quotes.
        out.push('\n');
    }
    out
}

fn sources() -> Sources {
    tree().into_iter().filter(|(path, _)| !is_test(path)).map(|(path, text)| (path, code(&text))).collect()
}

/// The module path of a file: `geometry/grid/mod.rs` is geometry, grid.
fn module(path: &str) -> Vec<String> {
    let path = path.trim_end_matches(".rs").trim_end_matches("/mod");
    path.split('/').map(str::to_string).collect()
}

/// Every path from `crate::`, `super::`, or a module of the file's own, that a file names, as module names from the
/// root; of `a::{b, c::d}` both.
fn paths(path: &str, code: &str) -> BTreeSet<Vec<String>> {
    let own = module(path);
    let modules = code.lines().filter_map(|line| line.strip_suffix(';')?.split("mod ").nth(1));
    let roots: Vec<String> = modules.chain(["crate", "super"]).map(|name| format!("{name}::")).collect();
    let mut out = BTreeSet::new();
    for (at, _) in roots.iter().flat_map(|root| code.match_indices(root.as_str())) {
        let before = code[..at].chars().next_back().unwrap_or(' ');
        if before.is_alphanumeric() || before == '_' || before == ':' {
            continue;
        }
        let (mut rest, mut from) = (&code[at..], own.clone());
        while let Some(after) = rest.strip_prefix("super::") {
            (rest, _) = (after, from.pop());
        }
        if let Some(after) = rest.strip_prefix("crate::") {
            (rest, from) = (after, Vec::new());
        }
        expand(rest, &from, &mut out);
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
    if !name.is_empty() && name != "self" {
        path.push(name.into());
    }
    match rest.strip_prefix("::") {
        Some(next) => expand(next, &path, out),
        None => {
            out.insert(path);
            rest
        }
    }
}

/// The file that defines what a path names: through the re-exports of the rooms on the way.
fn definition(path: &[String], sources: &Sources) -> Option<String> {
    for len in (1..=path.len()).rev() {
        let stem = path[..len].join("/");
        let door = format!("{stem}/mod.rs");
        if let Some(code) = sources.get(&door) {
            let name = path.get(len)?;
            for export in code.split("use ").skip(1).filter_map(|item| item.split(';').next()) {
                let mut named = BTreeSet::new();
                expand(export, &path[..len], &mut named);
                let found = named.into_iter().find(|p| p.last() == Some(name) && p.len() > len + 1);
                if let Some(file) = found.and_then(|p| definition(&p, sources)) {
                    return Some(file);
                }
            }
            return Some(door);
        }
        if sources.contains_key(&format!("{stem}.rs")) {
            return Some(format!("{stem}.rs"));
        }
    }
    None
}

/// Every use of a room that its user may not use.
fn arrows(sources: &Sources) -> Vec<String> {
    let layer = |room: &str| LAYERS.iter().position(|layer| layer.contains(&room));
    let mut out = BTreeSet::new();
    for (path, code) in sources.iter().filter(|(path, _)| !["lib.rs", "main.rs"].contains(&path.as_str())) {
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

/// Circles between the files of a room. A `mod.rs` is the door of its room: that it names and re-exports the files does
/// not count, but what it defines itself does.
fn circles(sources: &Sources) -> Vec<String> {
    let mut uses: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for (path, code) in sources {
        let code = if path.ends_with("mod.rs") { without_exports(code) } else { code.clone() };
        let files = paths(path, &code).into_iter().filter_map(|used| definition(&used, sources));
        uses.insert(path, files.filter(|file| file != path).collect());
    }
    let reaches = |from: &str, to: &str| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![from]);
        while let Some(next) = open.pop() {
            for file in uses.get(next).into_iter().flatten() {
                if file == to {
                    return true;
                }
                if seen.insert(file) {
                    open.push(file);
                }
            }
        }
        false
    };
    uses.keys()
        .filter(|path| !["lib.rs", "main.rs"].contains(*path))
        .filter(|path| reaches(path, path))
        .map(|path| format!("{path} uses itself"))
        .collect()
}

/// The code of a `mod.rs` without its re-exports.
fn without_exports(code: &str) -> String {
    let mut out = String::new();
    let mut exporting = false;
    for line in code.lines() {
        exporting |= line.starts_with("pub") && line.contains(" use ");
        if !exporting {
            out.push_str(line);
            out.push('\n');
        }
        exporting &= !line.contains(';');
    }
    out
}

/// Breaches of the house rules, as `file:line: rule`.
fn breaches(files: &BTreeMap<String, String>) -> Vec<String> {
    let mut out = Vec::new();
    for (path, text) in files {
        let mut told = |line: usize, rule: &str| out.push(format!("{path}:{}: {rule}", line + 1));
        let (mut exporting, program) = (false, path.starts_with("cli/") || path == "main.rs");
        for (i, line) in text.lines().enumerate() {
            let bare = line.trim_start();
            let comment = bare.starts_with("//");
            let table = bare.trim_start_matches(['/', '!']).trim_start().starts_with('|');
            if comment && !table && line.chars().count() > MAX_COLUMNS {
                told(i, "a comment of more than 120 columns");
            }
            if comment {
                continue;
            }
            let words: Vec<&str> =
                bare.split(|c: char| !c.is_alphanumeric() && c != '_' && c != '!').collect();
            if !program
                && words.iter().any(|w| ["println!", "eprintln!", "print!", "dbg!", "todo!"].contains(w))
            {
                told(i, "printing, or something to do, in the library");
            }
            if words.contains(&"unsafe") && !path.starts_with("simd/") {
                told(i, "unsafe outside of simd");
            }
            exporting |= bare.starts_with("pub use ") || bare.starts_with("pub(crate) use ");
            if exporting && bare.contains('*') {
                told(i, "a glob re-export");
            }
            exporting &= !bare.contains(';');
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
    none(&arrows(&sources()));
}

#[test]
fn files_of_a_room_form_no_circles() {
    none(&circles(&sources()));
}

#[test]
fn house_rules() {
    none(&breaches(&tree()));
}

/// Made-up sources, without their tests.
fn made_up(files: &[(&str, &str)]) -> Sources {
    files.iter().map(|(path, text)| (path.to_string(), code(text))).collect()
}

#[test]
fn upward_arrows_are_found_however_they_are_written() {
    for (path, text, arrow) in [
        ("tensor/mod.rs", "use crate::autodiff::Tape;", "tensor -> autodiff"),
        ("tensor/rows.rs", "use super::super::ops;", "tensor -> ops"),
        ("io/ply/text.rs", "fn f() { super::super::super::nn::g() }", "io -> nn"),
        ("tensor/mod.rs", "use crate::{error::Error,\n    ops::{a, b}};", "tensor -> ops"),
        ("tensor/mod.rs", "#[cfg(test)]\nmod tests {\n}\nuse crate::loss::x;", "tensor -> loss"),
        ("tensor/mod.rs", "use crate::geometry::KdTree;", "tensor -> geometry"),
        ("io/obj.rs", "use crate::tensor::Tensor;", "io -> tensor"),
        ("nn/mlp.rs", "use crate::Trainer;", "nn -> Trainer"),
        ("extra/mod.rs", "", "extra has no layer"),
    ] {
        let found = arrows(&made_up(&[(path, text)]));
        assert!(found.len() == 1 && found[0].ends_with(arrow), "{path}: {text}: {found:?}");
    }
    for (path, text) in [
        ("ops/matmul.rs", "use crate::autodiff::{At, Op}; use crate::tensor::{MatRef, gemm};"),
        ("start/fit.rs", "use super::{GaussField, ThinPlate}; use crate::{Error, ErrorKind};"),
        ("tensor/mod.rs", "/// See [`crate::nn`].\nconst A: &str = \"crate::nn\";"),
        ("tensor/mod.rs", "#[cfg(test)]\nmod tests {\n    use crate::nn::g;\n}"),
        ("bsp/mod.rs", "#[cfg(test)]\nuse crate::loss::Direction;\nuse crate::nn::Mlp;"),
    ] {
        none(&arrows(&made_up(&[(path, text)])));
    }
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
    let wide = format!("    /// {}\n", "x".repeat(MAX_COLUMNS));
    for (path, text, rule) in [
        ("nn/mlp.rs", "fn f() { println!(\"x\") }", "in the library"),
        ("nn/mlp.rs", "fn f() { unsafe { g() } }", "unsafe outside of simd"),
        ("nn/mod.rs", "pub(crate) use mlp::{\n    a, b::*,\n};", "glob re-export"),
        ("nn/mlp.rs", wide.as_str(), "columns"),
    ] {
        let found = breaches(&BTreeMap::from([(path.to_string(), text.to_string())]));
        assert!(found.len() == 1 && found[0].ends_with(rule), "{path}: {text}: {found:?}");
    }
    for (path, text) in [
        ("cli/progress.rs", "fn f() { eprintln!(\"x\") }".to_string()),
        ("simd/a.rs", "fn f() { unsafe { g() } }".to_string()),
        ("nn/mlp.rs", format!("/// | {} |\nfn f(x: &f32) -> f32 {{ (*x) * 2.0 }}", "x".repeat(MAX_COLUMNS))),
    ] {
        none(&breaches(&BTreeMap::from([(path.to_string(), text)])));
    }
}
