//! What is kept of a run: one line of JSON.

use bijective_sdf::bsp::Coverage;
use bijective_sdf::evaluate::Report;
use bijective_sdf::geometry::Topology;
use serde_json::Value;

use super::super::coverage::{TruthCoverage, coverage_json};
use super::super::json::Object;
use super::super::report::{report_json, topology_json};
use super::plan::{Job, Measure};

/// What a run came to.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Why it gave no figures, if it did not.
    pub failure: Option<String>,
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

/// The line of a run, without its end.
pub fn line(job: &Job<'_>, outcome: &Outcome, machine: &Machine, measure: Measure) -> String {
    let topology = |t: &Option<Topology>| t.as_ref().map_or("null".to_string(), topology_json);
    let optional = |text: Option<&str>| text.map_or("null".to_string(), super::super::json::quoted);
    let mesh = outcome.topology.as_ref().map(|_| job.mesh_file());
    let surface = outcome.coverage.map(|_| job.surface_file());
    let report = outcome.report.as_ref();
    let options = job.config().entries().into_iter();
    let options = options.fold(Object::new(), |object, (key, value)| object.text(key, &value)).finish();
    let input = &job.setting.input;
    let input = Object::new()
        .raw("points", input.points.map_or("null".to_string(), |n| n.to_string()))
        .raw("noise", optional(input.noise.map(|noise| noise.to_string()).as_deref()))
        .finish();
    Object::new()
        .text("shape", &job.shape.name)
        .raw("truth", optional(job.shape.truth.as_ref().map(|t| t.0.as_str())))
        .text("setting", &job.setting.name)
        .raw("seed", job.seed)
        .text("status", if outcome.failure.is_none() { "ok" } else { "failed" })
        .raw("message", optional(outcome.failure.as_deref()))
        .number("seconds", outcome.seconds)
        .count("threads", machine.threads)
        .count("jobs", machine.jobs)
        .text("version", env!("CARGO_PKG_VERSION"))
        .raw("build", optional(machine.build.as_deref()))
        .text("fingerprint", &job.fingerprint)
        .raw("options", options)
        .raw("input", input)
        .count("points", outcome.points)
        .count("steps", outcome.steps)
        .count("recoveries", outcome.recoveries)
        .number("noise_removed", outcome.noise_removed)
        .count("resolution", measure.resolution)
        .count("samples", measure.samples)
        .raw("mesh", optional(mesh.as_deref()))
        .raw("surface", optional(surface.as_deref()))
        .raw("coverage", coverage_json(outcome.coverage.as_ref()))
        .raw("truth_coverage", outcome.truth_coverage.map_or("null".to_string(), |c| c.json()))
        .raw("report", report.map_or("null".to_string(), |r| report_json(&job.shape.name, r)))
        .raw("result_topology", topology(&outcome.topology))
        .raw("truth_topology", topology(&outcome.truth))
        .finish()
}

/// What the tables need of a topology.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    pub failure: Option<String>,
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

impl Record {
    /// Reads a line, or says what is wrong with it.
    pub fn read(line: &str) -> Result<Record, String> {
        let json = serde_json::from_str::<Value>(line).map_err(|fault| fault.to_string())?;
        let missing = |key: &str| format!("{key} is missing or of another kind");
        let text = |key: &str| json.get(key).and_then(Value::as_str).map(str::to_string);
        let need = |key: &str| text(key).ok_or_else(|| missing(key));
        let failure = match need("status")?.as_str() {
            "ok" => None,
            "failed" => Some(need("message")?),
            other => return Err(format!("the status {other:?} is unknown")),
        };
        let part = |key: &str| json.get(key).filter(|value| !value.is_null());
        // The fingerprint finds the run; these are for other readers of the file.
        need("shape")?;
        need("setting")?;
        part("seed").and_then(Value::as_u64).ok_or_else(|| missing("seed"))?;
        Ok(Record {
            fingerprint: need("fingerprint")?,
            failure,
            seconds: part("seconds").and_then(Value::as_f64).ok_or_else(|| missing("seconds"))?,
            threads: part("threads").and_then(whole).ok_or_else(|| missing("threads"))?,
            build: text("build"),
            mesh: text("mesh"),
            surface: text("surface"),
            cover: cover(&json),
            figures: part("report").map(|r| figures(r).ok_or_else(|| missing("report"))).transpose()?,
            result: part("result_topology")
                .map(|t| form(t).ok_or_else(|| missing("result_topology")))
                .transpose()?,
            truth: part("truth_topology")
                .map(|t| form(t).ok_or_else(|| missing("truth_topology")))
                .transpose()?,
        })
    }
}

fn whole(json: &Value) -> Option<usize> {
    json.as_u64()?.try_into().ok()
}

fn form(json: &Value) -> Option<Form> {
    Some(Form {
        components: whole(json.get("components")?)?,
        genus: json.get("genus").and_then(Value::as_i64),
        closed: json.get("closed")?.as_bool()?,
        oriented: json.get("oriented")?.as_bool()?,
    })
}

/// Lines of earlier builds have none of this.
fn cover(json: &Value) -> Cover {
    let number = |part: &str, key: &str| json.get(part)?.get(key)?.as_f64();
    let own = |key: &str| number("coverage", key);
    let truth = |key: &str| number("truth_coverage", key);
    Cover {
        mean_code: own("mean_code"),
        evenness: own("evenness"),
        folded: own("folded"),
        distinct: own("distinct_share"),
        q_to_s: own("q_to_s"),
        s_to_q: own("s_to_q"),
        s_to_truth: truth("s_to_truth"),
        truth_to_s: truth("truth_to_s"),
        truth_to_q: truth("truth_to_q"),
        floor: truth("floor"),
    }
}

fn figures(report: &Value) -> Option<Figures> {
    let metrics = report.get("metrics")?;
    let number = |key: &str| metrics.get(key)?.as_f64();
    Some(Figures {
        cd_l1: number("cd_l1")?,
        cd_l2: number("cd_l2")?,
        nc: number("nc"),
        hd: number("hd")?,
        // At half, once and twice the threshold.
        f: metrics.get("fscores")?.get(1)?.get("f")?.as_f64()?,
        floor: report.get("floor").and_then(|f| f.get("cd_l1")?.as_f64()),
    })
}

#[cfg(test)]
pub mod tests {
    use super::super::plan::tests::{MEASURE, setting};
    use super::*;
    use crate::cli::suite::inputs::Shape;
    use bijective_sdf::bsp::CodeCoverage;
    use bijective_sdf::evaluate::{GroundTruth, Options, evaluate, evaluate_points};
    use bijective_sdf::geometry::TriangleMesh;

    const COVERAGE: Coverage = Coverage {
        points: 3,
        surface: 8,
        distinct: 6,
        q_to_s: 0.125,
        s_to_q: 0.25,
        codes: Some(CodeCoverage { mean_code: 0.5, sphere: 8, used: 2, near_pairs: 10, folded_pairs: 1 }),
    };

    fn tetrahedron() -> TriangleMesh {
        TriangleMesh {
            verts: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            faces: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let shape =
            Shape { name: "a \"b\"".into(), cloud: "a".into(), truth: Some(("a".into(), "b".into())) };
        let setting = setting("multiple:3");
        let job = Job { shape: &shape, setting: &setting, seed: u64::MAX, fingerprint: "f00".into() };
        let mesh = tetrahedron();
        let options = Options { samples: 200, ..Options::shape() };
        let report = evaluate(GroundTruth::Mesh(&mesh), &mesh, &options).unwrap();
        let sets: [&[[f32; 3]]; 2] = [&mesh.verts, &mesh.verts[..2]];
        let points = evaluate_points(GroundTruth::Mesh(&mesh), &sets, &options).unwrap();
        let outcome = Outcome {
            points: 300,
            seconds: 1.25,
            topology: Some(mesh.topology()),
            truth: Some(mesh.topology()),
            report: Some(report.clone()),
            coverage: Some(COVERAGE),
            truth_coverage: TruthCoverage::of(&points),
            ..Outcome::default()
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

        let failed = Outcome { failure: Some("no\nsurface".into()), ..Outcome::default() };
        let read = Record::read(&line(&job, &failed, &machine, MEASURE)).unwrap();
        let want = Record {
            failure: failed.failure,
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
