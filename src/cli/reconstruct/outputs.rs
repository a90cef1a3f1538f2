//! Where the results of `reconstruct` go, and what came of writing them.

use std::fs;
use std::path::{Path, PathBuf};

use super::super::carry::check_format;
use super::super::codes::CodesFiles;
use super::super::console::{say, say_all_but_last};
use super::super::failure::Failure;
use super::super::formats::{CLOUD_FORMATS, MESH_FORMATS};
use super::super::output::Output;
use super::super::paths::{check_apart, check_writable, is_pipe, is_same_file};
use super::super::preview::check_picture;
use super::ReconstructArgs;

/// Where results go, checked before the work starts.
pub struct Outputs {
    pub mesh: Output,
    /// Where the field is kept until the mesh is there, or for good.
    pub kept_field: Option<PathBuf>,
    pub surface_points: Option<Output>,
    pub codes: Option<CodesFiles>,
}

impl Outputs {
    /// Decides on the files and makes sure that they can be written and that none is named twice.
    pub fn of(args: &ReconstructArgs) -> Result<Self, Failure> {
        let codes = args.codes.as_ref().map(|stem| CodesFiles::new(stem, args.ascii));
        if args.codes.as_deref().is_some_and(is_pipe) {
            return Err(Failure::Usage("--codes needs the beginning of file names, not a pipe".into()));
        }
        let coded = codes.iter().flat_map(|files| &files.paths).map(|path| ("--codes", Some(path)));
        let files: Vec<(&str, &Path)> = [
            ("--output", Some(&args.output)),
            ("--surface-points", args.surface_points.as_ref()),
            ("--save-field", args.save_field.as_ref()),
            ("--preview", args.view.preview.as_ref()),
            ("--checkpoint", args.checkpoint.as_ref()),
        ]
        .into_iter()
        .chain(coded)
        .filter_map(|(option, path)| path.map(|p| (option, p.as_path())))
        .collect();
        for (i, (option, path)) in files.iter().enumerate() {
            if let Some((other, _)) = files[..i].iter().find(|(_, p)| p == path || is_same_file(p, path)) {
                return Err(Failure::Usage(format!("{other} and {option} are both {}", path.display())));
            }
            if is_pipe(path) && *option == "--checkpoint" {
                return Err(Failure::Usage(format!("{option} needs a file, not a pipe")));
            }
            if *option == "--preview" {
                check_picture(path)?;
            }
            if is_pipe(path) && args.json {
                return Err(Failure::Usage(format!("{option} - and --json would mix on standard output")));
            }
            check_apart(option, path, &args.input)?;
            if let Some(config) = &args.settings.config {
                check_apart(option, path, config)?;
            }
            // A run may go on in the checkpoint that it came from.
            if let Some(resume) = args.resume.as_deref().filter(|_| *option != "--checkpoint") {
                check_apart(option, path, resume)?;
            }
            check_writable(path)?;
        }
        let beside =
            || Some(&args.output).filter(|path| is_ordinary(path)).map(|path| behind(path, ".field"));
        let mesh = Output::new(&args.output, args.output_format, args.ascii, &MESH_FORMATS)?;
        check_format(&mesh, args.carry, args.trim.support)?;
        Ok(Outputs {
            codes,
            kept_field: args.save_field.clone().or_else(beside),
            mesh,
            surface_points: match &args.surface_points {
                Some(path) => Some(Output::new(path, None, args.ascii, &CLOUD_FORMATS)?),
                None => None,
            },
        })
    }
}

/// What came of writing the results.
#[derive(Default)]
pub struct Written {
    pub files: Vec<PathBuf>,
    pub failures: Vec<Failure>,
}

impl Written {
    /// Notes whether a file was written, and returns that.
    pub fn wrote(&mut self, path: &Path, outcome: Result<(), Failure>) -> bool {
        match outcome {
            Ok(()) => self.files.push(path.to_path_buf()),
            Err(failure) => self.failures.push(failure),
        }
        self.files.last().is_some_and(|file| file == path)
    }

    /// Prints all failures but the last, which it returns, and what was written nevertheless.
    pub fn end(self, advice: Option<String>) -> Failure {
        let last = say_all_but_last(self.failures).unwrap_or(Failure::Closed);
        if !self.files.is_empty() {
            let names: Vec<String> = self.files.iter().map(|file| file.display().to_string()).collect();
            let advice = advice.map_or(String::new(), |command| format!("; go on with {command}"));
            say(&format!("note: written: {}{advice}", names.join(", ")));
        }
        last
    }
}

/// A file name with something behind it.
pub fn behind(path: &Path, more: &str) -> PathBuf {
    let mut name = path.as_os_str().to_os_string();
    name.push(more);
    PathBuf::from(name)
}

/// Whether a path is that of a regular file, or of one that is yet to come; beside devices nothing is kept.
fn is_ordinary(path: &Path) -> bool {
    !is_pipe(path) && fs::metadata(path).map_or(true, |m| m.is_file())
}
