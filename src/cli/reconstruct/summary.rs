//! The JSON object about a run.

use bijective_sdf::geometry::Topology;

use super::super::coverage::coverage_json;
use super::super::fineness::Fineness;
use super::super::json::{Object, list, number, quoted};
use super::super::report::{passes_gate, topology_json};
use super::super::train::Trained;
use super::super::trim::Part;
use super::ReconstructArgs;
use super::cloud::PreparedCloud;
use super::outputs::Outputs;

/// A run that is done, with the seconds that it and its meshing took.
pub struct Run<'a> {
    pub args: &'a ReconstructArgs,
    pub outputs: &'a Outputs,
    pub cloud: &'a PreparedCloud,
    pub preset: &'static str,
    pub seed: u64,
    pub trained: &'a Trained,
    pub fineness: Fineness,
    pub part: &'a Part,
    pub topology: &'a Topology,
    pub mesh_seconds: f64,
    pub total_seconds: f64,
}

impl Run<'_> {
    /// Everything that is known of the run.
    pub fn json(&self) -> String {
        let Run { args, outputs, cloud, trained, .. } = self;
        let place = |p: [f64; 3]| list(p.map(|x| number(Some(x))));
        let json = Object::new()
            .path("input", Some(&args.input))
            .path("output", Some(outputs.mesh.path()))
            .count("points", cloud.points.len())
            .count("duplicates", cloud.duplicates)
            .count("left_out", cloud.rows_left_out)
            .raw("offset", place(cloud.offset))
            .text("outliers", args.outliers.name())
            .raw("strays", list(cloud.strays.iter().map(|&p| place(p))))
            .raw("warnings", list(cloud.warnings.iter().map(|w| quoted(w))))
            .raw("notices", list(cloud.notices.iter().map(|n| quoted(n))))
            .text("sides", cloud.sides)
            .raw("anisotropy", args.anisotropy.map_or("null".into(), place))
            .flag("turned", trained.field.is_turned())
            .text("preset", self.preset)
            .raw("seed", self.seed)
            .raw("resolution", self.fineness.json());
        let seconds = Object::new()
            .number("train", trained.seconds)
            .number("mesh", self.mesh_seconds)
            .number("total", self.total_seconds)
            .finish();
        describe(json, trained, self.topology)
            .raw("trim", self.part.json())
            .flag("support", args.trim.support)
            .raw("carried", cloud.carried.json())
            .raw("seconds", seconds)
            .path("surface_points", args.surface_points.as_deref())
            .raw(
                "codes",
                outputs.codes.as_ref().map_or("null".to_string(), |files| {
                    list(files.paths.iter().map(|path| quoted(&path.to_string_lossy())))
                }),
            )
            .path("field", args.save_field.as_deref())
            .path("preview", args.view.preview.as_deref())
            .path("checkpoint", args.checkpoint.as_deref())
            .finish()
    }
}

/// Adds what training and meshing came to.
pub fn describe(json: Object, trained: &Trained, topology: &Topology) -> Object {
    let losses = trained.last.as_ref().map_or("null".to_string(), |r| {
        let loss = Object::new().number("loss", f64::from(r.loss));
        let terms = r.terms.each().into_iter();
        terms.fold(loss, |json, (name, value)| json.number(name, f64::from(value))).finish()
    });
    json.count("steps", trained.steps)
        .count("total_steps", trained.total)
        .raw("phase", trained.last.map_or("null".to_string(), |r| format!("\"{}\"", r.phase)))
        .text("ended", if trained.timed_out { "time-limit" } else { "done" })
        .number("noise_removed", trained.noise_removed)
        .raw("losses", losses)
        .raw("coverage", coverage_json(trained.field.coverage()))
        .raw("mesh", topology_json(topology))
        .flag("closed_and_oriented", passes_gate(topology))
}
