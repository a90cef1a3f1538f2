//! `demo`: a shape with a known surface, sampled, reconstructed and compared.

use std::path::PathBuf;

use bijective_sdf::evaluate::{CompareOptions, GroundTruth, evaluate, evaluate_points};
use bijective_sdf::geometry::{
    AnalyticShape, Bounds, NarrowBandOptions, TetGrid, TriangleMesh, extract_mesh, relative_to, widened,
};
use bijective_sdf::io::{write_cloud, write_mesh};
use bijective_sdf::reconstruct::Hints;
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use super::Common;
use super::console::print;
use super::coverage::{TruthCoverage, coverage_text};
use super::failure::Failure;
use super::fineness::{RESOLUTION, resolution_parser};
use super::json::Object;
use super::output::{make_directory, write_bytes};
use super::paths::check_apart;
use super::preview::{Axis, View, render};
use super::reconstruct::describe;
use super::report::{gate, report_json, report_text};
use super::sample::add_noise;
use super::settings::Settings;
use super::train::{TrainingPlan, train};

/// Cubes along the grid that the true mesh is taken from.
const TRUTH_RESOLUTION: usize = 160;

/// Arguments of `demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Directory for the results, made if it is not there
    #[arg(long, value_name = "DIR", default_value = "demo-output")]
    out: PathBuf,
    /// The shape
    #[arg(long, default_value = "double-torus", value_parser = shape_parser())]
    shape: Named,
    /// Number of points
    #[arg(short = 'n', long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(4..))]
    points: u32,
    /// Standard deviation of Gaussian noise; the shape is about 1 long
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    noise: f64,
    #[command(flatten)]
    settings: Settings,
    /// Cubes along the longest side of the grid that the mesh is taken from; what is thinner than a cube may get lost
    #[arg(long, default_value_t = RESOLUTION, value_parser = resolution_parser())]
    resolution: usize,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// A built-in shape.
#[derive(Clone, Copy, Debug)]
struct Named {
    name: &'static str,
    shape: AnalyticShape,
}

fn shape_parser() -> impl TypedValueParser<Value = Named> {
    PossibleValuesParser::new(AnalyticShape::gallery().map(|(name, _)| name)).map(|chosen| {
        let (name, shape) =
            AnalyticShape::gallery().into_iter().find(|(name, _)| *name == chosen).expect("a listed name");
        Named { name, shape }
    })
}

/// Runs the demonstration.
pub fn run(args: &DemoArgs, common: Common) -> Result<(), Failure> {
    if !(args.noise.is_finite() && args.noise >= 0.0) {
        return Err(Failure::Usage(format!("--noise {}: a number of at least 0 expected", args.noise)));
    }
    let (config, preset) = args.settings.build()?;
    let path = |file: &str| args.out.join(file);
    let (cloud_file, mesh_file) = (path("cloud.ply"), path("mesh.ply"));
    let (truth_file, picture) = (path("truth.ply"), path("preview.png"));
    if let Some(config) = &args.settings.config {
        for file in [&cloud_file, &mesh_file, &truth_file, &picture] {
            check_apart("--out", file, config)?;
        }
    }
    make_directory(&args.out)?;
    let Named { name, shape } = args.shape;
    let (mut points, _) = shape.sample(args.points as usize, config.seed);
    add_noise(&mut points, args.noise, config.seed);
    common.note(&format!("{} points on {name}, preset {preset}, seed {}", points.len(), config.seed));

    let plan = TrainingPlan { quiet: common.quiet, ..TrainingPlan::default() };
    let trained = train(&widened(&points), &config, &Hints::default(), &plan, None)?;
    let mesh = trained.field.mesh(args.resolution)?;
    let topology = mesh.topology();
    let truth = true_mesh(&shape, config.seed)?;
    let local = mesh.relative_to([0.0; 3]);
    let mut options = CompareOptions::shape();
    options.surface = true;
    let report = evaluate(GroundTruth::Mesh(&truth), &local, &options)?;
    let s = relative_to(&trained.field.surface_points(), [0.0; 3]);
    let sets = [&points[..], &s];
    let sets = if s.is_empty() { &sets[..1] } else { &sets };
    let covered = evaluate_points(GroundTruth::Mesh(&truth), sets, &CompareOptions::shape())?;
    let covered = TruthCoverage::of(&covered).map_or("null".to_string(), |c| c.json());
    let view = View { up: Axis::Z, ..View::default() };
    let image = render(&widened(&points), &mesh, &view)?;

    write_cloud(&cloud_file, &points).map_err(Failure::Output)?;
    write_mesh(&mesh_file, &mesh).map_err(Failure::Output)?;
    write_mesh(&truth_file, &truth).map_err(Failure::Output)?;
    write_bytes(&picture, &image.to_png())?;

    trained.field.coverage().iter().flat_map(|c| coverage_text(c)).for_each(|line| common.note(&line));
    if args.json {
        let json = Object::new()
            .text("shape", name)
            .count("points", points.len())
            .text("preset", preset.name())
            .raw("seed", config.seed);
        let json = describe(json, &trained, &topology)
            .raw("evaluation", report_json(name, &report))
            .raw("truth_coverage", covered)
            .number("seconds", trained.seconds)
            .path("cloud", Some(&cloud_file))
            .path("output", Some(&mesh_file))
            .path("truth", Some(&truth_file))
            .path("preview", Some(&picture));
        print(format!("{}\n", json.finish()))?;
    } else {
        let euler = shape.euler_characteristic();
        let fits = if topology.euler == euler { "as" } else { "not as" };
        print(format!(
            "{}\n{topology}\nEuler number {} {fits} that of the true surface, {euler}; made in {:.1} s\n\n\
             points          {}\nreconstruction  {}\ntrue surface    {}\npicture         {}\n",
            report_text(&report, false),
            topology.euler,
            trained.seconds,
            cloud_file.display(),
            mesh_file.display(),
            truth_file.display(),
            picture.display()
        ))?;
    }
    gate(&topology)
}

/// A fine mesh of the shape itself.
fn true_mesh(shape: &AnalyticShape, seed: u64) -> Result<TriangleMesh, Failure> {
    let (around, _) = shape.sample(5000, seed);
    let bounds = Bounds::of(&around)?;
    let (low, high) = (bounds.min.map(|x| (x - 0.02) as f32), bounds.max.map(|x| (x + 0.02) as f32));
    let grid = TetGrid::covering(low, high, TRUTH_RESOLUTION, 1)?;
    let mut sdf = |p: &[[f32; 3]]| Ok(p.iter().map(|&p| shape.sdf(p)).collect());
    Ok(extract_mesh(&grid, &mut sdf, &NarrowBandOptions::with_seeds(&around))?)
}
