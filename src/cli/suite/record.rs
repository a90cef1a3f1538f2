//! What is kept of a run: one line of JSON.

use bijective_sdf::bsp::Coverage;
use bijective_sdf::evaluate::Report;
use bijective_sdf::geometry::Topology;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use std::collections::BTreeMap;

use super::super::coverage::{TruthCoverage, coverage_json};
use super::super::failure::Failure;
use super::super::report::{report_json, topology_json};
use super::plan::{Job, Measure};

/// Why a run gave no result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFailure {
    pub text: String,
    /// The exit code of a command that fails for this.
    pub exit_code: u8,
}

impl From<Failure> for RunFailure {
    fn from(failure: Failure) -> Self {
        RunFailure { text: failure.text(), exit_code: failure.code() }
    }
}

/// What a run came to.
#[derive(Clone, Debug, Default)]
pub struct RunOutcome {
    /// Why it gave no figures, if it did not.
    pub failure: Option<RunFailure>,
    /// Points of the input.
    pub points: usize,
    /// Steps made.
    pub steps: usize,
    /// Times that the training went back to an earlier state.
    pub recoveries: usize,
    /// How far the points were moved to take their noise off, root of the mean square.
    pub noise_removed: f64,
    /// Wall time of training and meshing.
    pub seconds: f64,
    /// What the mesh is like; it is written if there is one.
    pub topology: Option<Topology>,
    /// What the true mesh is like.
    pub truth: Option<Topology>,
    /// How far the one is from the other.
    pub report: Option<Report>,
    /// How well S covers the points and its codes the sphere; S is written if there is this.
    pub coverage: Option<Coverage>,
    /// How the points and S lie to the truth.
    pub truth_coverage: Option<TruthCoverage>,
}

/// On what a run was made.
#[derive(Clone, Debug, Default)]
pub struct Machine {
    /// Threads of the run.
    pub threads: usize,
    /// Runs at the same time.
    pub jobs: usize,
    /// The fingerprint of the program.
    pub build: Option<String>,
}

/// The line of a run.
#[derive(Serialize)]
struct Line<'a> {
    shape: &'a str,
    truth: Option<&'a str>,
    setting: &'a str,
    seed: u64,
    status: Status,
    message: Option<&'a str>,
    exit_code: Option<u8>,
    seconds: f64,
    threads: usize,
    jobs: usize,
    version: &'static str,
    build: Option<&'a str>,
    fingerprint: &'a str,
    options: BTreeMap<&'static str, String>,
    input: InputChange,
    points: usize,
    steps: usize,
    recoveries: usize,
    noise_removed: f64,
    resolution: usize,
    samples: usize,
    mesh: Option<String>,
    surface: Option<String>,
    coverage: Option<Box<RawValue>>,
    truth_coverage: Option<Box<RawValue>>,
    report: Option<Box<RawValue>>,
    result_topology: Option<Box<RawValue>>,
    truth_topology: Option<Box<RawValue>>,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Status {
    Ok,
    Failed,
}

/// What a setting changes about the input.
#[derive(Serialize)]
struct InputChange {
    points: Option<usize>,
    noise: Option<String>,
}

/// The line of a run, without its end.
pub fn line(job: &Job<'_>, outcome: &RunOutcome, machine: &Machine, measure: Measure) -> String {
    let part = |json: String| RawValue::from_string(json).expect("the program writes JSON");
    let input = &job.setting.input;
    let line = Line {
        shape: &job.shape.name,
        truth: job.shape.truth.as_ref().map(|t| t.0.as_str()),
        setting: &job.setting.name,
        seed: job.seed,
        status: if outcome.failure.is_none() { Status::Ok } else { Status::Failed },
        message: outcome.failure.as_ref().map(|failure| failure.text.as_str()),
        exit_code: outcome.failure.as_ref().map(|failure| failure.exit_code),
        seconds: outcome.seconds,
        threads: machine.threads,
        jobs: machine.jobs,
        version: env!("CARGO_PKG_VERSION"),
        build: machine.build.as_deref(),
        fingerprint: &job.fingerprint,
        options: job.config().entries().into_iter().collect(),
        input: InputChange { points: input.points, noise: input.noise.map(|noise| noise.to_string()) },
        points: outcome.points,
        steps: outcome.steps,
        recoveries: outcome.recoveries,
        noise_removed: outcome.noise_removed,
        resolution: measure.resolution,
        samples: measure.samples,
        mesh: outcome.topology.as_ref().map(|_| job.mesh_file()),
        surface: outcome.coverage.map(|_| job.surface_file()),
        coverage: outcome.coverage.as_ref().map(|c| part(coverage_json(Some(c)))),
        truth_coverage: outcome.truth_coverage.map(|c| part(c.json())),
        report: outcome.report.as_ref().map(|r| part(report_json(&job.shape.name, r))),
        result_topology: outcome.topology.as_ref().map(|t| part(topology_json(t))),
        truth_topology: outcome.truth.as_ref().map(|t| part(topology_json(t))),
    };
    serde_json::to_string(&line).expect("keys are texts")
}

/// What the tables need of a topology.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub struct Form {
    pub components: usize,
    pub genus: Option<i64>,
    pub closed: bool,
    pub oriented: bool,
}

/// What the tables need of a report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    pub cd_l1: f64,
    pub cd_l2: f64,
    pub nc: Option<f64>,
    pub hd: f64,
    /// At the usual threshold.
    pub f: f64,
    /// The CD L1 of a perfect prediction.
    pub floor: Option<f64>,
}

/// What the tables need of a coverage: of S alone and against the truth. What a line lacks is not known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cover {
    pub mean_code: Option<f64>,
    pub evenness: Option<f64>,
    pub folded: Option<f64>,
    pub distinct: Option<f64>,
    pub q_to_s: Option<f64>,
    pub s_to_q: Option<f64>,
    pub s_to_truth: Option<f64>,
    pub truth_to_s: Option<f64>,
    pub truth_to_q: Option<f64>,
    /// What as many points of the truth as S has would have in `truth_to_s`.
    pub floor: Option<f64>,
}

/// A line, read back.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    pub fingerprint: String,
    /// Why it failed, if it did.
    pub failure: Option<RunFailure>,
    pub seconds: f64,
    pub threads: usize,
    pub build: Option<String>,
    /// The file of the mesh, below the directory of the results.
    pub mesh: Option<String>,
    /// The file of S, likewise; lines of earlier builds have none.
    pub surface: Option<String>,
    pub cover: Cover,
    pub figures: Option<Figures>,
    pub result: Option<Form>,
    pub truth: Option<Form>,
}

/// A line as it is read: what the tables need, and what shows that it is the line of a run. Lines of earlier builds
/// lack some.
#[derive(Deserialize)]
struct ReadLine {
    fingerprint: String,
    /// The fingerprint finds the run; this and the next two are for other readers of the file.
    #[serde(rename = "shape")]
    _shape: String,
    #[serde(rename = "setting")]
    _setting: String,
    #[serde(rename = "seed")]
    _seed: u64,
    status: Status,
    message: Option<String>,
    /// Lines of earlier builds have none.
    exit_code: Option<u8>,
    seconds: f64,
    threads: usize,
    build: Option<String>,
    mesh: Option<String>,
    surface: Option<String>,
    #[serde(default)]
    coverage: Option<ReadCoverage>,
    #[serde(default)]
    truth_coverage: Option<ReadTruthCoverage>,
    report: Option<ReadReport>,
    result_topology: Option<Form>,
    truth_topology: Option<Form>,
}

#[derive(Default, Deserialize)]
struct ReadCoverage {
    mean_code: Option<f64>,
    evenness: Option<f64>,
    folded: Option<f64>,
    distinct_share: Option<f64>,
    q_to_s: Option<f64>,
    s_to_q: Option<f64>,
}

#[derive(Default, Deserialize)]
struct ReadTruthCoverage {
    s_to_truth: Option<f64>,
    truth_to_s: Option<f64>,
    truth_to_q: Option<f64>,
    floor: Option<f64>,
}

#[derive(Deserialize)]
struct ReadReport {
    metrics: ReadMetrics,
    floor: Option<ReadFloor>,
}

#[derive(Deserialize)]
struct ReadMetrics {
    cd_l1: f64,
    cd_l2: f64,
    nc: Option<f64>,
    hd: f64,
    /// At half, once and twice the threshold.
    fscores: [ReadScore; 3],
}

#[derive(Deserialize)]
struct ReadScore {
    f: f64,
}

#[derive(Deserialize)]
struct ReadFloor {
    cd_l1: f64,
}

impl Record {
    /// Reads a line, or says what is wrong with it.
    pub fn read(line: &str) -> Result<Record, String> {
        let line: ReadLine = serde_json::from_str(line).map_err(|fault| fault.to_string())?;
        let failure = match line.status {
            Status::Ok => None,
            Status::Failed => Some(RunFailure {
                text: line.message.ok_or("a failed run has no message")?,
                exit_code: line.exit_code.unwrap_or(1),
            }),
        };
        let (own, truth) = (line.coverage.unwrap_or_default(), line.truth_coverage.unwrap_or_default());
        Ok(Record {
            fingerprint: line.fingerprint,
            failure,
            seconds: line.seconds,
            threads: line.threads,
            build: line.build,
            mesh: line.mesh,
            surface: line.surface,
            cover: Cover {
                mean_code: own.mean_code,
                evenness: own.evenness,
                folded: own.folded,
                distinct: own.distinct_share,
                q_to_s: own.q_to_s,
                s_to_q: own.s_to_q,
                s_to_truth: truth.s_to_truth,
                truth_to_s: truth.truth_to_s,
                truth_to_q: truth.truth_to_q,
                floor: truth.floor,
            },
            figures: line.report.map(|ReadReport { metrics, floor }| Figures {
                cd_l1: metrics.cd_l1,
                cd_l2: metrics.cd_l2,
                nc: metrics.nc,
                hd: metrics.hd,
                f: metrics.fscores[1].f,
                floor: floor.map(|floor| floor.cd_l1),
            }),
            result: line.result_topology,
            truth: line.truth_topology,
        })
    }
}

#[cfg(test)]
pub mod tests {
    use super::super::plan::tests::{MEASURE, setting};
    use super::*;
    use crate::cli::coverage::tests::some_coverage;
    use crate::cli::suite::inputs::ShapeFiles;
    use bijective_sdf::evaluate::{CompareOptions, GroundTruth, evaluate, evaluate_points};
    use bijective_sdf::geometry::TriangleMesh;
    use serde_json::Value;

    fn coverage() -> Coverage {
        let mut coverage = some_coverage(true);
        (coverage.surface, coverage.distinct) = (8, 6);
        (coverage.q_to_s, coverage.s_to_q) = (0.125, 0.25);
        let codes = coverage.codes.as_mut().unwrap();
        (codes.used, codes.near_pairs, codes.folded_pairs) = (2, 10, 1);
        coverage
    }

    fn tetrahedron() -> TriangleMesh {
        TriangleMesh {
            verts: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            faces: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let shape =
            ShapeFiles { name: "a \"b\"".into(), cloud: "a".into(), truth: Some(("a".into(), "b".into())) };
        let setting = setting("multiple:3");
        let job = Job { shape: &shape, setting: &setting, seed: u64::MAX, fingerprint: "f00".into() };
        let mesh = tetrahedron();
        let mut options = CompareOptions::shape();
        options.samples = 200;
        let report = evaluate(GroundTruth::Mesh(&mesh), &mesh, &options).unwrap();
        let sets: [&[[f32; 3]]; 2] = [&mesh.verts, &mesh.verts[..2]];
        let points = evaluate_points(GroundTruth::Mesh(&mesh), &sets, &options).unwrap();
        let outcome = RunOutcome {
            points: 300,
            seconds: 1.25,
            topology: Some(mesh.topology()),
            truth: Some(mesh.topology()),
            report: Some(report.clone()),
            coverage: Some(coverage()),
            truth_coverage: TruthCoverage::of(&points),
            ..RunOutcome::default()
        };
        let machine = Machine { threads: 2, jobs: 1, build: Some("1234".into()) };
        let text = line(&job, &outcome, &machine, MEASURE);
        assert!(!text.contains('\n'));
        let read = Record::read(&text).unwrap();
        let json: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(json["shape"], "a \"b\"");
        assert_eq!(json["setting"], "multiple:3");
        assert_eq!(json["seed"], u64::MAX);
        // The seed of the options is the run's; nothing is done to the input.
        assert_eq!(json["options"]["seed"], u64::MAX.to_string());
        assert_eq!(json["options"]["bsp.patch"], setting.config.bsp.patch.to_string());
        assert!(json["input"]["points"].is_null() && json["input"]["noise"].is_null());
        let form = Form { components: 1, genus: Some(0), closed: true, oriented: true };
        let m = &report.metrics;
        let figures = Figures {
            cd_l1: m.cd_l1(),
            cd_l2: m.cd_l2(),
            nc: m.nc(),
            hd: m.hd(),
            f: m.fscore().f,
            floor: report.floor.map(|f| f.cd_l1()),
        };
        let want = Record {
            fingerprint: "f00".into(),
            failure: None,
            seconds: 1.25,
            threads: 2,
            build: Some("1234".into()),
            mesh: Some(format!("meshes/multiple-3/a \"b\"_s{}_f00.ply", u64::MAX)),
            surface: Some(format!("surfaces/multiple-3/a \"b\"_s{}_f00.ply", u64::MAX)),
            cover: Cover {
                mean_code: Some(0.5),
                evenness: Some(0.25),
                folded: Some(0.1),
                distinct: Some(0.75),
                q_to_s: Some(0.125),
                s_to_q: Some(0.25),
                s_to_truth: Some(points[1].to_gt),
                truth_to_s: Some(points[1].from_gt),
                truth_to_q: Some(points[0].from_gt),
                floor: points[1].floor,
            },
            figures: Some(figures),
            result: Some(form),
            truth: Some(form),
        };
        assert_eq!(read, want);
        assert!(want.cover.floor.is_some() && json["coverage"]["distinct"] == 6);
        // What a build without these figures wrote is read as before.
        let mut old = json.clone();
        for key in ["surface", "coverage", "truth_coverage"] {
            old.as_object_mut().unwrap().remove(key).unwrap();
        }
        let without = Record { surface: None, cover: Cover::default(), ..want.clone() };
        assert_eq!(Record::read(&old.to_string()).unwrap(), without);

        let failure = RunFailure { text: "no\nsurface".into(), exit_code: 3 };
        let failed = RunOutcome { failure: Some(failure), ..RunOutcome::default() };
        let read = Record::read(&line(&job, &failed, &machine, MEASURE)).unwrap();
        let want = Record {
            failure: failed.failure.clone(),
            seconds: 0.0,
            mesh: None,
            surface: None,
            cover: Cover::default(),
            figures: None,
            result: None,
            truth: None,
            ..want
        };
        assert_eq!(read, want);
        let mut old: Value = serde_json::from_str(&line(&job, &failed, &machine, MEASURE)).unwrap();
        old.as_object_mut().unwrap().remove("exit_code").unwrap();
        assert_eq!(Record::read(&old.to_string()).unwrap().failure.unwrap().exit_code, 1);
    }

    #[test]
    fn lines_of_another_kind_are_refused() {
        let good = "{\"fingerprint\":\"f\",\"shape\":\"a\",\"setting\":\"b\",\"seed\":0,\"status\":\"ok\",\
                    \"seconds\":1,\"threads\":1}";
        Record::read(good).unwrap();
        for (from, to) in [
            ("\"seed\":0", "\"seed\":-1"),
            ("\"seed\":0", "\"seed\":0.5"),
            ("\"ok\"", "\"good\""),
            ("\"ok\"", "\"failed\""),
            ("\"shape\":\"a\",", ""),
            ("\"threads\":1", "\"threads\":1,\"report\":{}"),
            ("\"threads\":1", "\"threads\":1,\"truth_topology\":{\"closed\":true}"),
            ("}", ""),
        ] {
            assert!(Record::read(&good.replace(from, to)).is_err(), "{from} {to}");
        }
    }
}
