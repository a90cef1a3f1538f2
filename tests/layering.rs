//! The map of the code, kept: modules use only what is below them, and some house rules that reading can check.

use std::fs;
use std::path::Path;

/// Every module with its layer. A module may use those of lower layers and itself, not its neighbours.
const LAYERS: [(&str, usize); 21] = [
    ("error", 0),
    ("simd", 1),
    ("linalg", 2),
    ("tensor", 2),
    ("geometry", 2),
    ("io", 3),
    ("autodiff", 3),
    ("ops", 4),
    ("nn", 5),
    ("optim", 5),
    ("loss", 6),
    ("field", 6),
    ("bsp", 7),
    ("gdo", 7),
    ("start", 7),
    ("finish", 8),
    ("reconstruct", 9),
    ("evaluate", 10),
    ("cli", 11),
    ("main", 12),
    ("lib", 12),
];

/// Modules that may use less than their layer would allow.
const NARROW: [(&str, &[&str]); 2] = [("io", &["error", "geometry"]), ("evaluate", &["error", "geometry"])];

/// What `lib.rs` re-exports, with the module it comes from; the front page's own re-exports count as the page's.
const ROOT_NAMES: [(&str, &str); 2] = [("Error", "error"), ("ErrorKind", "error")];

/// Files that may print: the program.
const MAY_PRINT: [&str; 2] = ["cli", "main"];
const PRINTING: [&str; 7] = ["print", "println", "eprint", "eprintln", "dbg", "todo", "unimplemented"];
/// The room that may be unsafe: the loops at the width of the registers.
const UNSAFE_ROOM: &str = "simd/";
const MAX_LINES: usize = 600;
/// Columns of a comment, but for tables; code is the formatter's.
const MAX_COLUMNS: usize = 120;

/// A source file: its path below `src`, with `/`, and its text.
type Source = (String, String);

fn sources() -> Vec<Source> {
    fn visit(root: &Path, dir: &Path, out: &mut Vec<Source>) {
        for entry in fs::read_dir(dir).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                visit(root, &path, out);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let parts: Vec<&str> =
                    path.strip_prefix(root).unwrap().iter().map(|p| p.to_str().unwrap()).collect();
                out.push((parts.join("/"), fs::read_to_string(&path).unwrap()));
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut out = Vec::new();
    visit(&root, &root, &mut out);
    out.sort();
    out
}

/// The code alone: comments and the insides of literals become spaces, lines stay.
fn code_only(source: &str) -> Vec<char> {
    let mut text: Vec<char> = source.chars().collect();
    let n = text.len();
    let at = |text: &[char], i: usize| text.get(i).copied().unwrap_or('\0');
    let blank = |text: &mut [char], range: std::ops::Range<usize>| {
        text[range].iter_mut().filter(|c| **c != '\n').for_each(|c| *c = ' ');
    };
    let mut i = 0;
    while i < n {
        let start = i;
        match (text[i], at(&text, i + 1)) {
            ('/', '/') => {
                while i < n && text[i] != '\n' {
                    i += 1;
                }
                blank(&mut text, start..i);
            }
            ('/', '*') => {
                let mut depth = 0;
                loop {
                    match (at(&text, i), at(&text, i + 1)) {
                        ('/', '*') => (depth, i) = (depth + 1, i + 2),
                        ('*', '/') => (depth, i) = (depth - 1, i + 2),
                        _ => i += 1,
                    }
                    if depth == 0 || i >= n {
                        break;
                    }
                }
                i = i.min(n);
                blank(&mut text, start..i);
            }
            ('"', _) => {
                // A raw string counts the # in front of it; in any other a backslash guards what follows.
                let mut back = start;
                while back > 0 && text[back - 1] == '#' {
                    back -= 1;
                }
                let hashes = start - back;
                let raw = back > 0 && text[back - 1] == 'r' && (back < 2 || !is_word(text[back - 2]));
                i += 1;
                while i < n {
                    if text[i] == '"' && (!raw || (1..=hashes).all(|k| at(&text, i + k) == '#')) {
                        break;
                    }
                    i += if text[i] == '\\' && !raw { 2 } else { 1 };
                }
                i = i.min(n);
                blank(&mut text, start + 1..i);
                i += 1;
            }
            // A character and not a lifetime: 'x' or '\...'.
            ('\'', second) if second == '\\' || at(&text, i + 2) == '\'' => {
                i += if second == '\\' { 3 } else { 2 };
                while i < n && text[i] != '\'' {
                    i += 1;
                }
                blank(&mut text, start + 1..i.min(n));
                i += 1;
            }
            _ => i += 1,
        }
    }
    text
}

/// Blanks every item behind `#[cfg(test)]`, up to its closing brace or semicolon.
fn without_tests(mut code: Vec<char>) -> Vec<char> {
    let mark: Vec<char> = "#[cfg(test)]".chars().collect();
    let mut i = 0;
    while i + mark.len() <= code.len() {
        if code[i..i + mark.len()] != mark[..] {
            i += 1;
            continue;
        }
        let start = i;
        let mut depth = 0;
        while i < code.len() {
            i += 1;
            match code[i - 1] {
                '{' => depth += 1,
                '}' => depth -= 1,
                ';' if depth == 0 => break,
                _ => continue,
            }
            if depth == 0 {
                break;
            }
        }
        code[start..i].iter_mut().filter(|c| **c != '\n').for_each(|c| *c = ' ');
    }
    code
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Words, each other character that is not white space, and the line of each.
fn tokens(code: &[char]) -> Vec<(String, usize)> {
    let mut out: Vec<(String, usize)> = Vec::new();
    let (mut line, mut in_word) = (1, false);
    for &c in code {
        if is_word(c) && in_word {
            out.last_mut().unwrap().0.push(c);
        } else if !c.is_whitespace() {
            out.push((c.to_string(), line));
        }
        in_word = is_word(c);
        line += usize::from(c == '\n');
    }
    out
}

/// The first names behind the path prefix that ends at token `i`: one, or all of a group in braces.
fn heads(tokens: &[(String, usize)], mut i: usize) -> Vec<&str> {
    let text = |i: usize| tokens.get(i).map_or("", |t| t.0.as_str());
    if text(i) != "{" {
        return vec![text(i)];
    }
    let (mut depth, mut out, mut first) = (0, Vec::new(), true);
    loop {
        match text(i) {
            "{" => depth += 1,
            "}" => depth -= 1,
            "," => {}
            name if first && depth == 1 => out.push(name),
            _ => {}
        }
        first = matches!(text(i), "{" | ",");
        i += 1;
        if depth == 0 || i >= tokens.len() {
            return out;
        }
    }
}

/// The module at the top of the tree that a file belongs to.
fn module(path: &str) -> &str {
    path.split('/').next().unwrap().trim_end_matches(".rs")
}

/// How many `super` lead from a file's own code to the crate root.
fn depth(path: &str) -> usize {
    let parts: Vec<&str> = path.split('/').collect();
    let file = usize::from(!matches!(parts[parts.len() - 1], "mod.rs" | "lib.rs" | "main.rs"));
    parts.len() - 1 + file
}

/// Every use of a module that its user may not use, as `file:line: user -> used`.
fn arrows(files: &[Source]) -> Vec<String> {
    let layer = |name: &str| LAYERS.iter().find(|(n, _)| *n == name).map(|(_, l)| *l);
    let mut out = Vec::new();
    for (path, source) in files {
        let from = module(path);
        let Some(height) = layer(from) else {
            out.push(format!("{path}:1: module {from} has no layer"));
            continue;
        };
        if from == "main" || from == "lib" {
            continue; // The roots use everything, and nothing can use them.
        }
        let tokens = tokens(&without_tests(code_only(source)));
        let text = |i: usize| tokens.get(i).map_or("", |t| t.0.as_str());
        let (mut i, up) = (0, depth(path));
        while i < tokens.len() {
            let start = i;
            // `crate::`, or as many `super::` as reach the root.
            let mut supers = 0;
            while text(i) == "super" && text(i + 1) == ":" && text(i + 2) == ":" {
                (i, supers) = (i + 3, supers + 1);
            }
            if text(i) == "crate" && text(i + 1) == ":" && text(i + 2) == ":" {
                (i, supers) = (i + 3, up);
            }
            if i == start {
                i += 1;
                continue;
            }
            if supers != up {
                continue;
            }
            for name in heads(&tokens, i) {
                let to = ROOT_NAMES.iter().find(|(n, _)| *n == name).map_or(name, |(_, m)| m);
                let narrow = NARROW.iter().find(|(n, _)| *n == from);
                let fits = to == from
                    || match (layer(to), narrow) {
                        (_, Some((_, allowed))) => allowed.contains(&to),
                        (Some(below), None) => below < height,
                        (None, None) => false,
                    };
                if !fits {
                    out.push(format!("{path}:{}: {from} -> {to}", tokens[start].1));
                }
            }
        }
    }
    out
}

/// Every breach of the house rules that can be found by reading, as `file:line: rule`.
fn breaches(files: &[Source]) -> Vec<String> {
    let mut out = Vec::new();
    for (path, source) in files {
        let lines = source.lines().count();
        if lines > MAX_LINES {
            out.push(format!("{path}:{lines}: more than {MAX_LINES} lines, split it"));
        }
        for (i, line) in source.lines().enumerate() {
            let comment = line.trim_start();
            let table = comment.trim_start_matches(['/', '!']).trim_start().starts_with('|');
            if comment.starts_with("//") && !table && line.chars().count() > MAX_COLUMNS {
                out.push(format!("{path}:{}: a comment of more than {MAX_COLUMNS} columns", i + 1));
            }
        }
        let tokens = tokens(&code_only(source));
        let text = |i: usize| tokens.get(i).map_or("", |t| t.0.as_str());
        let mut exported = false;
        for (i, (token, line)) in tokens.iter().enumerate() {
            let printing = PRINTING.contains(&token.as_str()) && text(i + 1) == "!";
            if printing && !MAY_PRINT.contains(&module(path)) {
                out.push(format!("{path}:{line}: {token}! in the library"));
            }
            if token == "unsafe" && !path.starts_with(UNSAFE_ROOM) {
                out.push(format!("{path}:{line}: unsafe outside {UNSAFE_ROOM}"));
            }
            // `pub use` and `pub(crate) use`, up to the semicolon.
            exported |= token == "use" && i > 0 && (text(i - 1) == "pub" || text(i - 1) == ")");
            exported &= token != ";";
            if exported && token == "*" {
                out.push(format!("{path}:{line}: glob re-export"));
            }
        }
    }
    out
}

#[track_caller]
fn none(found: &[String]) {
    assert!(found.is_empty(), "\n{}\n", found.join("\n"));
}

#[test]
fn arrows_point_down() {
    let files = sources();
    assert!(files.len() > 20, "only {} files found", files.len());
    none(&arrows(&files));
}

#[test]
fn house_rules() {
    none(&breaches(&sources()));
}

fn made_up(path: &str, source: &str) -> Vec<Source> {
    vec![(path.to_string(), source.to_string())]
}

#[test]
fn an_upward_arrow_is_rejected_however_it_is_written() {
    let rejected = [
        ("tensor/mod.rs", "use crate::autodiff::Tape;", "tensor -> autodiff"),
        ("tensor/mod.rs", "use super::ops;", "tensor -> ops"),
        ("tensor/rows.rs", "use super::super::ops;", "tensor -> ops"),
        ("io/ply/text.rs", "fn f() { super::super::super::nn::g() }", "io -> nn"),
        ("tensor/mod.rs", "use crate::{error::Error, ops::{a, b}};", "tensor -> ops"),
        ("tensor/mod.rs", "fn f() { crate::nn::init::normal() }", "tensor -> nn"),
        ("tensor/mod.rs", "macro_rules! m { () => { $crate::nn::f() } }", "tensor -> nn"),
        // Behind what looks like the start of a string, a comment or a character.
        ("tensor/mod.rs", "const Q: char = '\"'; use crate::cli::run;", "tensor -> cli"),
        ("tensor/mod.rs", "fn f<'a>(s: &'a str) { crate::cli::run(r#\"\"\"#) }", "tensor -> cli"),
        ("tensor/mod.rs", "const S: &str = \"\\\"//\"; use crate::cli::run;", "tensor -> cli"),
        ("tensor/mod.rs", "#[cfg(test)]\nmod tests { }\nuse crate::loss::x;", "tensor -> loss"),
        // Neighbours, and what is narrower than its layer.
        ("tensor/mod.rs", "use crate::geometry::KdTree;", "tensor -> geometry"),
        ("geometry/knn.rs", "use crate::tensor::kernel;", "geometry -> tensor"),
        ("nn/mlp.rs", "use crate::optim::Adam;", "nn -> optim"),
        ("field/mod.rs", "use crate::loss::Direction;", "field -> loss"),
        ("io/obj.rs", "use crate::tensor::Tensor;", "io -> tensor"),
        ("evaluate/table.rs", "use crate::reconstruct::Config;", "evaluate -> reconstruct"),
        // Names that the map does not have.
        ("nn/mlp.rs", "use crate::Trainer;", "nn -> Trainer"),
        ("extra/mod.rs", "", "module extra has no layer"),
    ];
    for (path, source, arrow) in rejected {
        let found = arrows(&made_up(path, source));
        assert!(found.len() == 1 && found[0].ends_with(arrow), "{path}: {source}: {found:?}");
    }
}

#[test]
fn other_arrows_pass() {
    let accepted = [
        ("ops/matmul.rs", "use crate::autodiff::{At, Op}; use crate::tensor::{MatRef, gemm};"),
        ("start/fit.rs", "use super::{GaussField, ThinPlate}; use crate::{Error, ErrorKind};"),
        ("io/ply/text.rs", "use super::super::text::float; use crate::geometry::TriangleMesh;"),
        ("tensor/mod.rs", "/// See [`crate::nn`]. /* */\n// crate::nn\n/* crate::nn /* */ crate::nn */"),
        ("tensor/mod.rs", "const A: &str = \"crate::nn\"; const B: &str = r#\"\" crate::nn \"#;"),
        ("tensor/mod.rs", "#[cfg(test)]\nmod tests { fn f() { crate::nn::g() } }"),
        ("bsp/mod.rs", "#[cfg(test)]\nuse crate::loss::Direction;\nuse crate::nn::Mlp;"),
        ("reconstruct/step.rs", "use crate::{bsp::Bsp, gdo::deform, io::write_atomic};"),
        ("lib.rs", "pub use crate::reconstruct::Trainer;"),
    ];
    for (path, source) in accepted {
        none(&arrows(&made_up(path, source)));
    }
}

#[test]
fn breaches_of_the_house_rules_are_found() {
    let long = "\n".repeat(MAX_LINES + 1);
    let wide = format!("    /// {}\n", "x".repeat(MAX_COLUMNS));
    let table = format!("/// | {} |\n", "x".repeat(MAX_COLUMNS));
    assert!(breaches(&made_up("nn/mlp.rs", &table)).is_empty());
    let rejected = [
        ("nn/mlp.rs", "fn f() { println!(\"x\") }", "println! in the library"),
        ("nn/mlp.rs", "#[cfg(test)]\nmod tests { fn f() { dbg!(1) } }", "dbg! in the library"),
        ("nn/mlp.rs", "fn f() { unsafe { g() } }", "unsafe outside simd/"),
        // Not every file of that name lies in the room.
        ("tensor/simd.rs", "fn f() { unsafe { g() } }", "unsafe outside simd/"),
        ("nn/mod.rs", "pub use mlp::*;", "glob re-export"),
        ("nn/mod.rs", "pub(crate) use mlp::{a, b::*};", "glob re-export"),
        ("nn/mlp.rs", long.as_str(), "split it"),
        ("nn/mlp.rs", wide.as_str(), "columns"),
    ];
    for (path, source, rule) in rejected {
        let found = breaches(&made_up(path, source));
        assert!(found.len() == 1 && found[0].ends_with(rule), "{path}: {source}: {found:?}");
    }
    let accepted = [
        ("cli/progress.rs", "fn f() { eprintln!(\"x\") }"),
        ("main.rs", "fn f() { eprintln!(\"x\") }"),
        ("simd/a.rs", "fn f() { unsafe { g() } }"),
        ("simd/product/a.rs", "fn f() { unsafe { g() } }"),
        ("lib.rs", "#![deny(unsafe_code)]"),
        ("nn/mlp.rs", "use a::b; fn f(x: &f32) -> f32 { (*x) * 2.0 }\n// println!()\nfn todo() {}"),
        ("nn/mlp.rs", "#[cfg(test)]\nmod tests { use super::*; }"),
    ];
    for (path, source) in accepted {
        none(&breaches(&made_up(path, source)));
    }
}
