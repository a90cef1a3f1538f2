//! Which clouds there are, and which truth belongs to which.

use std::fs;
use std::path::{Path, PathBuf};

use bijective_sdf::io::Format;
use bijective_sdf::{Error, ErrorKind};

use super::super::failure::Failure;
use super::super::input::{Content, Input};
use super::super::paths::is_same_file;
use super::names::{RUNS, TABLES};

/// The files of a shape: a cloud to reconstruct and, if there is one, the truth that it was taken from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShapeFiles {
    /// The stem of the cloud's file.
    pub name: String,
    /// The cloud's file.
    pub cloud: PathBuf,
    /// Stem and file of the truth.
    pub truth: Option<(String, PathBuf)>,
}

/// Whether a text fits a pattern in which each `*` stands for any letters, or none.
pub fn matches(pattern: &str, text: &str) -> bool {
    let mut parts = pattern.split('*');
    let first = parts.next().unwrap_or_default();
    let Some(mut rest) = text.strip_prefix(first) else { return false };
    let parts: Vec<&str> = parts.collect();
    let Some((last, middle)) = parts.split_last() else { return rest.is_empty() };
    // The earliest place of each part leaves the most for the next ones.
    for part in middle {
        match rest.find(part) {
            Some(at) => rest = &rest[at + part.len()..],
            None => return false,
        }
    }
    rest.ends_with(last)
}

/// The longest of `stems` that `name` begins with, where the name ends or an underscore follows.
pub fn truth_of<'a>(name: &str, stems: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let begins =
        |stem: &&str| name.strip_prefix(*stem).is_some_and(|rest| rest.is_empty() || rest.starts_with('_'));
    stems.into_iter().filter(begins).max_by_key(|stem| stem.len())
}

/// Where to look.
#[derive(Clone, Copy, Debug)]
pub struct Search<'a> {
    /// The directory of everything.
    pub dir: &'a Path,
    /// The directory of the truths, if it was given.
    pub truth: Option<&'a Path>,
    /// The pattern of the names of clouds.
    pub inputs: &'a str,
    /// Names of clouds or truths; none means all.
    pub shapes: &'a [String],
    /// The directory of the results, whose own files are no shapes.
    pub out: &'a Path,
}

/// The shapes by name.
pub fn find(search: Search<'_>) -> Result<Vec<ShapeFiles>, Failure> {
    let below = |name: &str| Some(search.dir.join(name)).filter(|d| d.is_dir());
    let from = below("in").unwrap_or_else(|| search.dir.to_path_buf());
    let mut clouds = list(&from, search.out)?;
    let apart = search.truth.map(Path::to_path_buf).or_else(|| below("gt")).filter(|d| *d != from);
    let truths = match apart {
        Some(dir) => list(&dir, search.out)?,
        None => {
            // Beside each other, what has faces is a truth and no input.
            let mut truths = Vec::new();
            let mut rest = Vec::new();
            for (name, path) in clouds {
                let has_faces = matches!(Input::read(&path, None)?.content(), Ok(Content::Mesh(_)));
                if has_faces { truths.push((name, path)) } else { rest.push((name, path)) }
            }
            clouds = rest;
            truths
        }
    };
    let mut shapes: Vec<ShapeFiles> = clouds
        .into_iter()
        .filter(|(name, _)| matches(search.inputs, name))
        .map(|(name, cloud)| {
            let stem = truth_of(&name, truths.iter().map(|(stem, _)| stem.as_str()));
            let truth = stem.and_then(|stem| truths.iter().find(|(s, _)| s == stem).cloned());
            ShapeFiles { name, cloud, truth }
        })
        .collect();
    let is = |shape: &ShapeFiles, wanted: &str| {
        shape.name == wanted || shape.truth.as_ref().is_some_and(|(stem, _)| stem == wanted)
    };
    for wanted in search.shapes {
        if !shapes.iter().any(|s| is(s, wanted)) {
            return Err(Failure::Usage(format!(
                "--shapes {wanted}: no such cloud or truth among the {} that fit --inputs {:?} in {}",
                shapes.len(),
                search.inputs,
                from.display()
            )));
        }
    }
    if !search.shapes.is_empty() {
        shapes.retain(|s| search.shapes.iter().any(|wanted| is(s, wanted)));
    }
    if shapes.is_empty() {
        let text = format!("no point cloud whose name fits {:?}", search.inputs);
        let advice = "give a directory with clouds in it, or in `in` below it, and a fitting --inputs";
        return Err(Failure::Input(Error::new(ErrorKind::Io, text).in_file(&from).advise(advice)));
    }
    Ok(shapes)
}

/// The files of a directory whose extension is that of a known format, by stem; without the tables of earlier runs if
/// it is that of the results, `to`, too.
///
/// # Errors
/// [`Failure::Usage`] if a file has the name of a table and cannot be one, as there are no runs: it would be replaced.
fn list(dir: &Path, to: &Path) -> Result<Vec<(String, PathBuf)>, Failure> {
    let failed =
        |e| Failure::Input(Error::new(ErrorKind::Io, "cannot read the directory").in_file(dir).caused_by(e));
    let mut out: Vec<(String, PathBuf)> = Vec::new();
    let with_results = is_same_file(dir, to);
    for entry in fs::read_dir(dir).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if with_results && path.file_name().is_some_and(|name| TABLES.iter().any(|table| name == *table)) {
            if !to.join(RUNS).exists() {
                let text = format!("--out would overwrite {}; give another directory", path.display());
                return Err(Failure::Usage(text));
            }
            continue;
        }
        let stem = path.file_stem().and_then(|s| s.to_str());
        if let Some(stem) = stem.filter(|s| !s.starts_with('.'))
            && path.is_file()
            && Format::from_path(&path).is_some()
        {
            out.push((stem.to_string(), path));
        }
    }
    out.sort();
    if let Some(pair) = out.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        return Err(Failure::Usage(format!(
            "{} and {} have the same name; results would be mixed up",
            pair[0].1.display(),
            pair[1].1.display()
        )));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bijective_sdf::geometry::TriangleMesh;
    use bijective_sdf::io::write_mesh;

    #[test]
    fn stars_stand_for_anything() {
        for (pattern, text, fits) in [
            ("*", "", true),
            ("*", "kitten_300", true),
            ("*_300", "kitten_300", true),
            ("*_300", "kitten_300_n005", false),
            ("*_300", "_300", true),
            ("sn_*_300", "sn_tv_300", true),
            ("sn_*_300", "sn_300", false),
            ("kitten", "kitten", true),
            ("kitten", "kitten_300", false),
            ("", "", true),
            ("", "a", false),
            ("a*b*c", "aXbYbZc", true),
            ("a*b*c", "aXcYb", false),
            ("a*a", "a", false),
            ("**a", "ba", true),
        ] {
            assert_eq!(matches(pattern, text), fits, "{pattern} {text}");
        }
    }

    #[test]
    fn the_longest_beginning_at_an_underscore_is_the_truth() {
        let stems = ["sn", "sn_tv", "sn_tvstand", "kitten", "fandisk"];
        for (name, truth) in [
            ("kitten_300", Some("kitten")),
            ("kitten_vipss500_h001", Some("kitten")),
            ("kitten", Some("kitten")),
            ("sn_tv_300", Some("sn_tv")),
            ("sn_tvstand_300", Some("sn_tvstand")),
            ("sn_tvs_300", Some("sn")),
            ("kittens_300", None),
            ("300_kitten", None),
        ] {
            assert_eq!(truth_of(name, stems), truth, "{name}");
        }
    }

    fn names(shapes: &[ShapeFiles]) -> Vec<(&str, Option<&str>)> {
        shapes.iter().map(|s| (s.name.as_str(), s.truth.as_ref().map(|t| t.0.as_str()))).collect()
    }

    #[test]
    fn directories_are_searched_as_they_are_laid_out() {
        let dir = std::env::temp_dir().join(format!("bijective-sdf-suite-inputs-{}", std::process::id()));
        let _ = fs::remove_dir_all(&dir);
        let mesh =
            TriangleMesh { verts: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], faces: vec![[0, 1, 2]] };
        let cloud = |path: &str| fs::write(dir.join(path), "0 0 0\n1 0 0\n0 1 0\n0 0 1\n").unwrap();
        for sub in ["in", "gt", "beside"] {
            fs::create_dir_all(dir.join(sub)).unwrap();
        }
        for path in ["in/a_300.xyz", "in/b_100.xyz", "in/lone.xyz", "gt/b.xyz", "in/readme.md", "in/.c.xyz"] {
            cloud(path);
        }
        write_mesh(dir.join("gt/a.ply"), &mesh).unwrap();
        for path in ["beside/a_300.xyz", "beside/a_300_n005.xyz"] {
            cloud(path);
        }
        write_mesh(dir.join("beside/a.ply"), &mesh).unwrap();

        let search = Search { dir: &dir, truth: None, inputs: "*", shapes: &[], out: &dir.join("out") };
        let found = find(search).unwrap();
        assert_eq!(names(&found), [("a_300", Some("a")), ("b_100", Some("b")), ("lone", None)]);
        let found = find(Search { inputs: "*_300", ..search }).unwrap();
        assert_eq!(names(&found), [("a_300", Some("a"))]);
        let wanted = ["b".to_string(), "lone".to_string()];
        let found = find(Search { shapes: &wanted, ..search }).unwrap();
        assert_eq!(names(&found), [("b_100", Some("b")), ("lone", None)]);
        // A noisy cloud beside the clean one: the mesh is the truth of both.
        let beside = dir.join("beside");
        let found = find(Search { dir: &beside, ..search }).unwrap();
        assert_eq!(names(&found), [("a_300", Some("a")), ("a_300_n005", Some("a"))]);
        let found = find(Search { dir: &beside, truth: Some(&dir.join("in")), ..search }).unwrap();
        assert_eq!(names(&found), [("a", None), ("a_300", Some("a_300")), ("a_300_n005", Some("a_300"))]);

        // Results beside the shapes. A table that no run has made is a cloud of the user.
        let out = dir.join("in/../beside");
        cloud("beside/shapes.csv");
        assert_eq!(names(&find(Search { dir: &beside, ..search }).unwrap()).len(), 3);
        let with_results = Search { dir: &beside, out: &out, ..search };
        let refused = find(with_results).unwrap_err();
        assert!(refused.code() == 2 && refused.text().contains("shapes.csv"), "{refused:?}");
        fs::write(beside.join(RUNS), "").unwrap();
        assert_eq!(names(&find(with_results).unwrap()), [("a_300", Some("a")), ("a_300_n005", Some("a"))]);

        assert!(matches!(find(Search { inputs: "x*", ..search }), Err(Failure::Input(_))));
        assert!(matches!(find(Search { shapes: &["x".into()], ..search }), Err(Failure::Usage(_))));
        assert!(matches!(find(Search { dir: &dir.join("none"), ..search }), Err(Failure::Input(_))));
        cloud("in/a_300.csv");
        assert!(matches!(find(search), Err(Failure::Usage(_))));
        fs::remove_dir_all(dir).unwrap();
    }
}
