//! Shapes x settings x seeds, each with a fingerprint of all that its result depends on.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};

use bijective_sdf::reconstruct::Config;

use super::super::failure::Failure;
use super::super::sample::Noise;
use super::fingerprint::Fingerprint;
use super::inputs::ShapeFiles;
use super::setting::Setting;

/// What holds for all runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Measure {
    /// Cubes along the longest side of the grid that meshes are taken from.
    pub resolution: usize,
    /// Samples of each surface in a comparison.
    pub samples: usize,
}

/// A run to make.
#[derive(Clone, Debug)]
pub struct Job<'a> {
    /// What to reconstruct.
    pub shape: &'a ShapeFiles,
    /// How.
    pub setting: &'a Setting,
    /// With which seed.
    pub seed: u64,
    /// The name of all this; runs of the same fingerprint have the same result.
    pub fingerprint: String,
}

impl Job<'_> {
    /// All options, the seed included.
    pub fn config(&self) -> Config {
        let mut config = self.setting.config.clone();
        config.seed = self.seed;
        config
    }

    /// The file of the mesh, below the directory of the results. The beginning of the fingerprint keeps apart what runs
    /// with other options, or on another cloud of that name, have left there.
    pub fn mesh_file(&self) -> String {
        self.file("meshes")
    }

    /// The file of the denser points S, likewise.
    pub fn surface_file(&self) -> String {
        self.file("surfaces")
    }

    fn file(&self, directory: &str) -> String {
        let print = &self.fingerprint[..self.fingerprint.len().min(8)];
        format!("{directory}/{}/{}_s{}_{print}.ply", self.setting.file_name(), self.shape.name, self.seed)
    }
}

/// All runs, seed by seed and setting by setting.
#[derive(Debug)]
pub struct Plan<'a> {
    /// The shapes by name.
    pub shapes: &'a [ShapeFiles],
    /// The settings in the order they were asked for.
    pub settings: &'a [Setting],
    /// The runs.
    pub jobs: Vec<Job<'a>>,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

impl<'a> Plan<'a> {
    /// Plans all runs; reads every file once.
    pub fn new(
        shapes: &'a [ShapeFiles],
        settings: &'a [Setting],
        seeds: &[u64],
        measure: Measure,
    ) -> Result<Self, Failure> {
        let mut digests: HashMap<&Path, String> = HashMap::new();
        for path in shapes.iter().flat_map(|s| [Some(&s.cloud), s.truth.as_ref().map(|t| &t.1)]).flatten() {
            if !digests.contains_key(path.as_path()) {
                digests.insert(path, digest(path)?);
            }
        }
        let mut jobs = Vec::new();
        for &seed in seeds {
            for setting in settings {
                for shape in shapes.iter().filter(|s| s.truth.is_some() || setting.input.points.is_none()) {
                    let mut job = Job { shape, setting, seed, fingerprint: String::new() };
                    job.fingerprint = fingerprint(&job, &digests, measure);
                    jobs.push(job);
                }
            }
        }
        let lone = shapes.iter().filter(|s| s.truth.is_none()).count();
        let mut notes = Vec::new();
        if lone > 0 {
            notes.push(format!("{lone} of the shapes have no truth: only their topology and time are told"));
            for setting in settings.iter().filter(|s| s.input.points.is_some()) {
                notes.push(format!("{} leaves out shapes without a truth to sample", setting.name));
            }
        }
        Ok(Plan { shapes, settings, jobs, notes })
    }

    /// The runs of a setting.
    pub fn of(&self, setting: &Setting) -> impl Iterator<Item = &Job<'a>> {
        let name = setting.name.clone();
        self.jobs.iter().filter(move |job| job.setting.name == name)
    }

    /// The first run of each fingerprint that has no record, by whatever is kept of records.
    pub fn open<Record>(&self, records: &HashMap<String, Record>) -> Vec<&Job<'a>> {
        let mut seen = HashSet::new();
        self.jobs
            .iter()
            .filter(|job| !records.contains_key(&job.fingerprint) && seen.insert(job.fingerprint.as_str()))
            .collect()
    }

    /// An earlier setting whose runs are all the same.
    pub fn same_as(&self, setting: &Setting) -> Option<&'a Setting> {
        let prints = |s: &Setting| self.of(s).map(|job| job.fingerprint.as_str()).collect::<Vec<_>>();
        let own = prints(setting);
        self.settings
            .iter()
            .take_while(|s| s.name != setting.name)
            .find(|s| !own.is_empty() && prints(s) == own)
    }
}

fn digest(path: &PathBuf) -> Result<String, Failure> {
    let bytes = fs::read(path).map_err(|e| Failure::cannot_read(path, e))?;
    Ok(Fingerprint::new().part(&bytes).finish())
}

fn fingerprint(job: &Job<'_>, digests: &HashMap<&Path, String>, measure: Measure) -> String {
    let of = |path: &PathBuf| digests[path.as_path()].as_bytes();
    let mut print = Fingerprint::new();
    print = match job.setting.input.points {
        Some(points) => print.part(format!("{points} points of the truth").as_bytes()),
        None => print.part(of(&job.shape.cloud)),
    };
    if let Some((_, path)) = &job.shape.truth {
        print = print.part(of(path));
    }
    let noise = match job.setting.input.noise {
        None | Some(Noise::Absolute(0.0) | Noise::Relative(0.0)) => String::new(),
        Some(noise) => format!("{noise:?}"),
    };
    let entries = job.config().entries();
    let config: String = entries.iter().map(|(key, value)| format!("{key}={value}\n")).collect();
    print.part(noise.as_bytes()).part(config.as_bytes()).part(format!("{measure:?}").as_bytes()).finish()
}

#[cfg(test)]
pub mod tests {
    use super::super::ablations::ABLATIONS;
    use super::super::setting::Change;
    use super::*;

    pub const MEASURE: Measure = Measure { resolution: 32, samples: 100 };

    pub fn setting(name: &str) -> Setting {
        let ablation = ABLATIONS.iter().find(|a| a.name == name).copied();
        Setting { name: name.into(), config: Config::default(), input: Change::default(), ablation }
    }

    /// Shapes with a truth each, files in a directory of their own.
    pub fn shapes(dir: &Path, names: &[&str]) -> Vec<ShapeFiles> {
        let _ = fs::remove_dir_all(dir);
        fs::create_dir_all(dir).unwrap();
        let file = |name: String| {
            let path = dir.join(&name);
            fs::write(&path, name).unwrap();
            path
        };
        names
            .iter()
            .map(|name| ShapeFiles {
                name: name.to_string(),
                cloud: file(format!("{name}_300.xyz")),
                truth: Some((name.to_string(), file(format!("{name}.ply")))),
            })
            .collect()
    }

    #[test]
    fn a_fingerprint_tells_everything_apart_that_changes_the_result() {
        let dir = std::env::temp_dir().join(format!("bijective-sdf-suite-plan-{}", std::process::id()));
        let shapes = shapes(&dir, &["a", "b"]);
        let mut settings = vec![setting("one"), setting("two"), setting("three"), setting("four")];
        settings[1].config.weights.para = 3.0;
        settings[2].input.points = Some(300);
        settings[3].input.noise = Some(Noise::Absolute(0.01));
        let plan = Plan::new(&shapes, &settings, &[0, 1], MEASURE).unwrap();
        assert_eq!(plan.jobs.len(), 16);
        let prints: HashSet<_> = plan.jobs.iter().map(|j| j.fingerprint.clone()).collect();
        assert_eq!(prints.len(), 16);
        assert_eq!(plan.open::<()>(&HashMap::new()).len(), 16);

        let again = Plan::new(&shapes, &settings, &[0, 1], MEASURE).unwrap();
        assert!(again.jobs.iter().all(|j| prints.contains(&j.fingerprint)));
        for measure in [Measure { resolution: 33, ..MEASURE }, Measure { samples: 99, ..MEASURE }] {
            let other = Plan::new(&shapes, &settings, &[0], measure).unwrap();
            assert!(other.jobs.iter().all(|j| !prints.contains(&j.fingerprint)));
        }
        // A changed cloud changes what is made of it, not what is sampled from the truth.
        fs::write(&shapes[0].cloud, "other").unwrap();
        let other = Plan::new(&shapes, &settings, &[0], MEASURE).unwrap();
        for job in &other.jobs {
            let known = job.shape.name == "b" || job.setting.name == "three";
            assert_eq!(prints.contains(&job.fingerprint), known, "{job:?}");
        }
        fs::write(&shapes[1].truth.as_ref().unwrap().1, "other").unwrap();
        let other = Plan::new(&shapes, &settings, &[0], MEASURE).unwrap();
        let of_b = other.jobs.iter().filter(|j| j.shape.name == "b");
        assert!(of_b.clone().count() > 0 && of_b.clone().all(|j| !prints.contains(&j.fingerprint)));
        fs::remove_dir_all(dir).unwrap();
    }

    #[test]
    fn settings_that_come_to_the_same_run_once() {
        let dir = std::env::temp_dir().join(format!("bijective-sdf-suite-same-{}", std::process::id()));
        let mut shapes = shapes(&dir, &["a", "b"]);
        shapes[1].truth = None;
        let mut settings = vec![setting("default"), setting("k_8"), setting("k_4"), setting("points_300")];
        settings[2].config.bsp.neighbours = 4;
        settings[3].input.points = Some(300);
        let plan = Plan::new(&shapes, &settings, &[0], MEASURE).unwrap();
        // Without a truth there is nothing to sample.
        assert_eq!(plan.jobs.len(), 7);
        assert_eq!(plan.notes.len(), 2);
        let open = plan.open::<()>(&HashMap::new());
        let names: Vec<_> = open.iter().map(|j| (j.setting.name.as_str(), j.shape.name.as_str())).collect();
        assert_eq!(
            names,
            [("default", "a"), ("default", "b"), ("k_4", "a"), ("k_4", "b"), ("points_300", "a")]
        );
        let same: Vec<_> = settings.iter().map(|s| plan.same_as(s).map(|s| s.name.as_str())).collect();
        assert_eq!(same, [None, Some("default"), None, None]);
        let print = &plan.jobs[0].fingerprint[..8];
        assert_eq!(plan.jobs[0].mesh_file(), format!("meshes/default/a_s0_{print}.ply"));
        fs::remove_dir_all(dir).unwrap();
    }
}
