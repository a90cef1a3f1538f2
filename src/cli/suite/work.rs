//! Making runs, several at a time.

use std::any::Any;
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};
use std::thread;
use std::time::Instant;

use bijective_sdf::evaluate::{CompareOptions, GroundTruth, Metrics, evaluate, evaluate_points};
use bijective_sdf::geometry::{Bounds, Topology, relative_to, sample_surface};
use bijective_sdf::io::{write_cloud, write_mesh};
use bijective_sdf::reconstruct::{Reconstruction, Trainer};
use bijective_sdf::{Error, ErrorKind};

use super::super::console::say;
use super::super::coverage::TruthCoverage;
use super::super::failure::Failure;
use super::super::input::{Content, Input};
use super::super::interrupt::Interrupt;
use super::super::output::{make_directory, short_enough};
use super::super::progress::duration;
use super::super::sample::{Noise, add_noise};
use super::fingerprint;
use super::plan::{Job, Measure};
use super::record::{Machine, Record, RunFailure, RunOutcome, line};
use super::store::RunFile;

/// Added to a run's seed where the truth is sampled for its input: the comparison samples it with small seeds, and its
/// samples must not be the input's. The bytes are the ASCII of "input".
const INPUT_SEED: u64 = 0x696e_7075_7400_0000;

/// A surface that results are held against.
pub struct Truth {
    /// Its mesh or cloud.
    pub content: Content,
    /// The topology, if it is a mesh.
    pub topology: Option<Topology>,
}

impl Truth {
    /// Reads a truth.
    pub fn read(path: &Path) -> Result<Truth, Failure> {
        let content = Input::read(path, None)?.content()?;
        let topology = match &content {
            Content::Mesh(mesh) => Some(mesh.topology()),
            Content::Cloud(_) => None,
        };
        Ok(Truth { content, topology })
    }

    /// What a perfect prediction would score; nothing for a cloud.
    fn floor(&self, options: &CompareOptions) -> Result<Option<Metrics>, Error> {
        match &self.content {
            Content::Mesh(mesh) => {
                let local = mesh.relative_to(mesh.offset());
                let mut options = *options;
                options.floor = true;
                Ok(evaluate(GroundTruth::Mesh(&local), &local, &options)?.floor)
            }
            Content::Cloud(_) => Ok(None),
        }
    }
}

/// The points that a run starts from.
pub fn points_of(job: &Job<'_>, truth: Option<&Truth>) -> Result<Vec<[f64; 3]>, Failure> {
    let points = match job.setting.input.points {
        None => {
            let cloud = Input::read(&job.shape.cloud, None)?.cloud()?;
            let file = job.shape.cloud.display();
            cloud.warnings.iter().for_each(|w| say(&format!("warning: {file}: {w}")));
            cloud.points
        }
        Some(count) => match truth.map(|t| &t.content) {
            Some(Content::Mesh(mesh)) => {
                let offset = mesh.offset();
                let drawn =
                    sample_surface(&mesh.relative_to(offset), count, INPUT_SEED.wrapping_add(job.seed))?;
                added(&drawn.points, offset)
            }
            _ => {
                let error = Error::new(ErrorKind::Data, "the truth has no faces to sample points on");
                return Err(Failure::Input(error));
            }
        },
    };
    let deviation = match job.setting.input.noise {
        None => 0.0,
        Some(Noise::Absolute(x)) => x,
        // As `sample` does, of the true shape where it is known.
        Some(Noise::Relative(part)) => match truth.map(|t| &t.content) {
            Some(Content::Mesh(mesh)) => part * Bounds::of(&mesh.verts)?.longest(),
            _ => part * Bounds::of(&points)?.longest(),
        },
    };
    if deviation == 0.0 {
        return Ok(points);
    }
    let offset = Bounds::of(&points)?.offset();
    let mut local = relative_to(&points, offset);
    add_noise(&mut local, deviation, INPUT_SEED.wrapping_add(job.seed));
    Ok(added(&local, offset))
}

/// Points with an offset added again.
fn added(points: &[[f32; 3]], offset: [f64; 3]) -> Vec<[f64; 3]> {
    points.iter().map(|p| std::array::from_fn(|a| f64::from(p[a]) + offset[a])).collect()
}

/// Where, how and with what the runs of a suite are made.
pub struct Runner<'a> {
    /// The directory of all results.
    pub out: &'a Path,
    /// How the meshes of all runs are taken and measured.
    pub measure: Measure,
    /// Runs at the same time.
    pub jobs: usize,
    /// Threads for all of them together.
    pub threads: usize,
    /// Asked before each step.
    pub interrupt: &'a Interrupt,
    /// Say nothing.
    pub quiet: bool,
}

/// A truth that several runs share, with its floor.
type Shared = OnceLock<Result<(Truth, Option<Metrics>), RunFailure>>;

impl Runner<'_> {
    /// Makes the runs and stores each as soon as it is done. Ends early with an error if a run cannot be stored, and
    /// without one if the user interrupts. Returns what was made.
    pub fn make(&self, open: &[&Job<'_>], store: RunFile) -> Result<HashMap<String, Record>, Failure> {
        let truths: HashMap<&Path, Shared> = open
            .iter()
            .filter_map(|j| j.shape.truth.as_ref())
            .map(|t| (t.1.as_path(), OnceLock::new()))
            .collect();
        // Few runs share all threads.
        let jobs = self.jobs.min(open.len()).max(1);
        let machine =
            Machine { threads: (self.threads / jobs).max(1), jobs, build: fingerprint::of_program() };
        let finished =
            Mutex::new(Finished { store, made: HashMap::new(), failure: None, began: Instant::now() });
        let next = AtomicUsize::new(0);
        thread::scope(|scope| {
            for _ in 0..jobs {
                scope.spawn(|| {
                    let pool = match rayon::ThreadPoolBuilder::new().num_threads(machine.threads).build() {
                        Ok(pool) => pool,
                        Err(e) => {
                            let text = format!("cannot start {} threads ({e})", machine.threads);
                            return finished.lock().expect("no panic within").fail(Failure::Usage(text));
                        }
                    };
                    while !self.interrupt.asked() && !finished.lock().expect("no panic within").failed() {
                        let Some(job) = open.get(next.fetch_add(1, Ordering::Relaxed)) else { break };
                        let truth = job.shape.truth.as_ref().map(|t| &truths[t.1.as_path()]);
                        match pool.install(|| self.run(job, truth)) {
                            Ok(Some(outcome)) => {
                                let text = line(job, &outcome, &machine, self.measure);
                                let mut finished = finished.lock().expect("no panic within");
                                finished.keep(&text);
                                if !self.quiet && !finished.failed() {
                                    say(&finished.progress(job, &outcome, open.len()));
                                }
                            }
                            Ok(None) => break,
                            Err(failure) => finished.lock().expect("no panic within").fail(failure),
                        }
                    }
                });
            }
        });
        let finished = finished.into_inner().expect("no panic within");
        match finished.failure {
            Some(failure) => Err(failure),
            None => Ok(finished.made),
        }
    }

    /// Makes a run; nothing if it was asked to stop. What goes wrong in the run itself is an outcome, too.
    fn run(&self, job: &Job<'_>, truth: Option<&Shared>) -> Result<Option<RunOutcome>, Failure> {
        let mut outcome = RunOutcome::default();
        let tried = catch_unwind(AssertUnwindSafe(|| self.attempt(job, truth, &mut outcome)));
        match tried {
            Ok(Ok(())) => {}
            Ok(Err(Stop::Asked)) => return Ok(None),
            Ok(Err(Stop::Fatal(failure))) => return Err(failure),
            Ok(Err(Stop::Failed(failure))) => outcome.failure = Some(failure),
            Err(panic) => {
                let text = format!("panic: {}", message(&*panic));
                outcome.failure = Some(RunFailure { text, exit_code: 1 });
            }
        }
        Ok(Some(outcome))
    }

    fn attempt(&self, job: &Job<'_>, truth: Option<&Shared>, outcome: &mut RunOutcome) -> Result<(), Stop> {
        let mut options = CompareOptions::shape();
        (options.samples, options.floor) = (self.measure.samples, false);
        let truth = match (truth, &job.shape.truth) {
            (Some(shared), Some((_, path))) => {
                let read = || -> Result<_, Failure> {
                    let truth = Truth::read(path)?;
                    let floor = truth.floor(&options)?;
                    Ok((truth, floor))
                };
                let read = shared.get_or_init(|| read().map_err(RunFailure::from));
                Some(read.as_ref().map_err(|failure| Stop::Failed(failure.clone()))?)
            }
            _ => None,
        };
        outcome.truth = truth.and_then(|(truth, _)| truth.topology.clone());
        let points = points_of(job, truth.map(|(truth, _)| truth))?;
        outcome.points = points.len();
        let began = Instant::now();
        let trained = self.train(job, &points, outcome);
        let trained = trained.and_then(|field| Ok((field.mesh(self.measure.resolution)?, field)));
        outcome.seconds = began.elapsed().as_secs_f64();
        let (mesh, field) = trained?;
        let surface = field.surface_points();

        let lost = |e| Stop::Fatal(Failure::Output(e));
        write_mesh(self.place(&job.mesh_file())?, &mesh).map_err(lost)?;
        outcome.topology = Some(mesh.topology());
        if let Some(coverage) = field.coverage() {
            write_cloud(self.place(&job.surface_file())?, &short_enough(&surface)).map_err(lost)?;
            outcome.coverage = Some(*coverage);
        }
        if let Some((truth, floor)) = truth {
            let offset = truth.content.offset();
            let truth = truth.content.relative_to(offset);
            let mut report = evaluate(truth.ground_truth(), &mesh.relative_to(offset), &options)?;
            report.floor = *floor;
            outcome.report = Some(report);
            let sets = [relative_to(field.input_points(), offset), relative_to(&surface, offset)];
            let sets = [&sets[0][..], &sets[1]];
            let sets = if surface.is_empty() { &sets[..1] } else { &sets };
            // With the floor, which is another for every number of points.
            options.floor = true;
            let reports = evaluate_points(truth.ground_truth(), sets, &options)?;
            outcome.truth_coverage = TruthCoverage::of(&reports);
        }
        Ok(())
    }

    /// The place of a file below the directory of the results, whose own directory is made.
    fn place(&self, file: &str) -> Result<PathBuf, Stop> {
        let path = self.out.join(file);
        if let Some(parent) = path.parent() {
            make_directory(parent).map_err(Stop::Fatal)?;
        }
        Ok(path)
    }

    fn train(
        &self,
        job: &Job<'_>,
        points: &[[f64; 3]],
        outcome: &mut RunOutcome,
    ) -> Result<Reconstruction, Stop> {
        let mut trainer = Trainer::new(points, &job.config())?;
        while !trainer.is_done() {
            if self.interrupt.asked() {
                return Err(Stop::Asked);
            }
            trainer.step()?;
        }
        outcome.steps = trainer.total_steps();
        outcome.recoveries = trainer.recoveries();
        outcome.noise_removed = trainer.noise_removed();
        Ok(trainer.finish())
    }
}

/// Why a run ended without a result.
enum Stop {
    /// The user wants an end.
    Asked,
    /// It failed, as another might not.
    Failed(RunFailure),
    /// No other run could be kept either.
    Fatal(Failure),
}

impl From<Error> for Stop {
    fn from(e: Error) -> Self {
        Stop::Failed(Failure::Library(e).into())
    }
}

impl From<Failure> for Stop {
    fn from(failure: Failure) -> Self {
        Stop::Failed(failure.into())
    }
}

fn message(panic: &(dyn Any + Send)) -> &str {
    match (panic.downcast_ref::<&str>(), panic.downcast_ref::<String>()) {
        (Some(text), _) => text,
        (_, Some(text)) => text,
        _ => "without a message",
    }
}

/// Where finished runs go.
struct Finished {
    store: RunFile,
    made: HashMap<String, Record>,
    /// Why no more runs can be kept.
    failure: Option<Failure>,
    began: Instant,
}

impl Finished {
    fn keep(&mut self, line: &str) {
        let record = Record::read(line).expect("a line of our own");
        match self.store.append(line) {
            Ok(()) => {
                self.made.insert(record.fingerprint.clone(), record);
            }
            Err(failure) => self.fail(failure),
        }
    }

    fn fail(&mut self, failure: Failure) {
        self.failure.get_or_insert(failure);
    }

    fn failed(&self) -> bool {
        self.failure.is_some()
    }

    fn progress(&self, job: &Job<'_>, outcome: &RunOutcome, all: usize) -> String {
        let done = self.made.len();
        let result = match (&outcome.failure, &outcome.report, &outcome.topology) {
            (Some(failure), ..) => format!("failed: {}", failure.text),
            (_, Some(report), _) => format!("10 CD_L1 {:.4}", 10.0 * report.metrics.cd_l1()),
            (.., topology) => {
                topology.as_ref().map_or(String::new(), |t| format!("{} components", t.components))
            }
        };
        let wanted = job.config();
        let untrained =
            !wanted.stages.is_empty() && !wanted.trains(outcome.points) && outcome.failure.is_none();
        let kept = if untrained { " (first shape, train_up_to)" } else { "" };
        let left = self.began.elapsed().as_secs_f64() / done.max(1) as f64 * all.saturating_sub(done) as f64;
        let left = if done < all { format!("; {} left", duration(left)) } else { String::new() };
        format!(
            "{done}/{all}  {}  {}  seed {}  {result}{kept}  {:.1} s{left}",
            job.setting.name, job.shape.name, job.seed, outcome.seconds
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::inputs::ShapeFiles;
    use super::super::plan::tests::setting;
    use super::*;
    use bijective_sdf::geometry::TriangleMesh;

    #[test]
    fn inputs_are_sampled_with_the_seed_of_the_run_and_apart_from_the_comparison() {
        let mesh: TriangleMesh<[f64; 3]> = TriangleMesh {
            verts: vec![[0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]],
            faces: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        };
        let truth = Truth { topology: Some(mesh.topology()), content: Content::Mesh(mesh.clone()) };
        let shape = ShapeFiles { name: "a".into(), cloud: "none.xyz".into(), truth: None };
        let mut many = setting("many");
        many.input.points = Some(50);
        let mut noisy = many.clone();
        noisy.input.noise = Some(Noise::Relative(0.01));
        let of = |setting, seed| {
            let job = Job { shape: &shape, setting, seed, fingerprint: String::new() };
            points_of(&job, Some(&truth)).unwrap()
        };
        assert_eq!(of(&many, 1), of(&many, 1));
        assert_ne!(of(&many, 1), of(&many, 2));
        for seed in 0..8 {
            let drawn = sample_surface(&mesh.relative_to([0.0; 3]), 50, seed).unwrap().points;
            assert_ne!(of(&many, 0), added(&drawn, [0.0; 3]));
        }
        let (clean, moved) = (of(&many, 1), of(&noisy, 1));
        let off = clean.as_flattened().iter().zip(moved.as_flattened()).map(|(a, b)| (a - b).powi(2));
        let deviation = (off.sum::<f64>() / 150.0).sqrt();
        assert!((0.03..0.05).contains(&deviation), "{deviation}");
        let job = Job { shape: &shape, setting: &many, seed: 0, fingerprint: String::new() };
        assert!(points_of(&job, None).unwrap_err().text().contains("no faces"));
    }

    #[test]
    fn panics_keep_their_message() {
        let of = |f: fn()| message(&*catch_unwind(f).unwrap_err()).to_string();
        assert_eq!(of(|| std::panic::panic_any("text")), "text");
        assert_eq!(of(|| std::panic::panic_any(String::from("text"))), "text");
        assert_eq!(of(|| std::panic::panic_any(3)), "without a message");
    }
}
