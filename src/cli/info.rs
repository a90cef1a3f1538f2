//! `info`: what is in a file.

use std::collections::HashSet;
use std::path::PathBuf;

use bijective_sdf::evaluate::percentile;
use bijective_sdf::geometry::{
    Attribute, Bounds, CleanCloud, KdTree, Normalizer, Position, TriangleMesh, clean_cloud, format_shortest,
};
use bijective_sdf::io::PointCloud;
use bijective_sdf::reconstruct::{Saved, SavedKind};
use clap::Args;

use super::Common;
use super::cleaning::{Outliers, doubts, strays};
use super::console::print;
use super::failure::{Failure, chain};
use super::input::Content;
use super::json::{Object, list, number, quoted};
use super::reading::ReadArgs;
use super::report::offset_text;
use super::report::{bounds_text, gate, topology_json, topology_text};

/// Arguments of `info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// A point cloud, a mesh, a saved field or a checkpoint, or `-`
    file: PathBuf,
    #[command(flatten)]
    reading: ReadArgs,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Exit with 4 unless the file is a closed and oriented mesh
    #[arg(long)]
    check: bool,
}

/// Describes a file.
pub fn run(args: &InfoArgs, common: Common) -> Result<(), Failure> {
    let input = args.reading.with_attributes(&args.file)?;
    if Saved::is_saved(input.bytes()) {
        let saved = Saved::from_bytes(input.bytes()).map_err(|e| Failure::Input(e.in_file(input.path())))?;
        return describe_saved(&saved, args, common);
    }
    match input.content()? {
        Content::Mesh(mesh) => describe_mesh(&mesh, args),
        Content::Cloud(cloud) => {
            common.tell(&cloud.warnings, &cloud.notices);
            describe_cloud(&cloud, args, common)
        }
    }
}

fn describe_saved(saved: &Saved, args: &InfoArgs, common: Common) -> Result<(), Failure> {
    saved.notices.iter().for_each(|notice| common.note(notice));
    let config = &saved.config;
    let kind = match saved.kind {
        SavedKind::Checkpoint { .. } => "checkpoint",
        _ => "field",
    };
    let json = Object::new()
        .text("kind", kind)
        .count("version", saved.version as usize)
        .count("points", saved.points)
        .raw("seed", config.seed);
    let mut text = format!(
        "{kind}\nversion     {}\npoints      {}\nseed        {}\nfield       {}\n",
        saved.version,
        saved.points,
        config.seed,
        match saved.trained {
            true => format!("{} layers of {}", config.field.depth, config.field.width),
            false => "the first shape, without a network".into(),
        }
    );
    let json = match saved.kind {
        SavedKind::Checkpoint { step, total_steps, recoveries } => {
            text += &format!("steps       {step} of {total_steps}\n");
            if recoveries > 0 {
                text += &format!("recoveries  {recoveries}\n");
            }
            json.count("steps", step).count("total_steps", total_steps).count("recoveries", recoveries)
        }
        _ => json,
    };
    let options = config.entries().into_iter().fold(Object::new(), |o, (key, value)| o.text(key, &value));
    if args.json {
        print(format!("{}\n", json.raw("options", options.finish()).finish()))?;
    } else {
        print(text)?;
    }
    if args.check {
        return Err(Failure::Gate(format!("the file is a {kind}, not a closed mesh")));
    }
    Ok(())
}

fn describe_mesh(mesh: &TriangleMesh<[f64; 3]>, args: &InfoArgs) -> Result<(), Failure> {
    let topology = mesh.topology();
    if args.json {
        let json = Object::new().text("kind", "mesh").raw("mesh", topology_json(&topology)).finish();
        print(format!("{json}\n"))?;
    } else {
        print(format!("mesh\n{}", topology_text(&topology)))?;
    }
    if args.check { gate(&topology) } else { Ok(()) }
}

fn describe_cloud(cloud: &PointCloud, args: &InfoArgs, common: Common) -> Result<(), Failure> {
    let points = &cloud.points;
    let bounds = Bounds::of(points)?;
    let (low, high, offset) = (bounds.min, bounds.max, bounds.offset());
    // As `reconstruct` has them.
    let cleaned = clean_cloud(points).map(CleanCloud::sorted);
    let problem = cleaned.as_ref().err().map(|e| chain(e));
    // Adding 0 turns -0 into 0.
    let places: HashSet<[u64; 3]> = points.iter().map(|p| p.map(|x| (x + 0.0).to_bits())).collect();
    let merged = points.len() - places.len();
    let distinct = cleaned.as_ref().map_or(&[][..], |c| &c.points);
    let (stray, told) = strays(distinct, Outliers::Keep);
    let doubts: Vec<String> =
        told.into_iter().chain(cleaned.iter().flat_map(|clean| doubts(clean, false))).collect();
    common.tell(&doubts, &[]);
    let nearest = nearest_distances(cleaned.as_ref().map_or(points.as_slice(), |c| &c.points));
    if args.json {
        let corner = |c: [f64; 3]| list(c.map(|x| number(Some(x))));
        let json = Object::new()
            .text("kind", "cloud")
            .count("points", points.len())
            .count("duplicates", merged)
            .raw("bounds", list([low, high].map(corner)))
            .raw("offset", corner(offset))
            .raw(
                "spacing",
                nearest.map_or("null".into(), |[least, middle, most]| {
                    Object::new().number("min", least).number("median", middle).number("max", most).finish()
                }),
            )
            .count("left_out", cloud.left_out)
            .raw("strays", list(stray.iter().map(|&i| corner(distinct[i as usize]))))
            .raw("warnings", list(cloud.warnings.iter().chain(&doubts).map(|w| quoted(w))))
            .raw("notices", list(cloud.notices.iter().map(|n| quoted(n))))
            .flag("normals", cloud.normals.is_some())
            .raw("attributes", list(cloud.attributes.iter().map(attribute_json)))
            .flag("usable", problem.is_none())
            .raw("problem", problem.as_deref().map_or("null".into(), quoted))
            .finish();
        print(format!("{json}\n"))?;
    } else {
        let mut text = format!("cloud\npoints      {}\nduplicates  {merged}\n", points.len());
        if cloud.left_out > 0 {
            text += &format!("left out    {}\n", cloud.left_out);
        }
        text += &bounds_text(low, high);
        text += &format!("longest     {}\n", format_shortest(bounds.longest()));
        if offset != [0.0; 3] {
            text += &format!(
                "offset      {}, subtract it before storing the coordinates in 32 bits\n",
                offset_text(offset)
            );
        }
        if !stray.is_empty() {
            text += &format!("strays      {}\n", stray.len());
        }
        if let Some([least, middle, most]) = nearest {
            text += &format!(
                "spacing     {middle:.4e} median, {least:.4e} least, {most:.4e} most (to the nearest other point)\n"
            );
        }
        if cloud.normals.is_some() {
            text += "normals     one a point\n";
        }
        cloud.attributes.iter().for_each(|a| text += &attribute_text(a));
        text += &match &problem {
            None => "usable      yes\n".to_string(),
            Some(problem) => format!("usable      no: {problem}\n"),
        };
        print(text)?;
    }
    if args.check {
        return Err(Failure::Gate("the file is a point cloud, not a closed mesh".into()));
    }
    Ok(())
}

/// A line about what a file has beside the coordinates, as `--carry` gives it to a mesh.
fn attribute_text(attribute: &Attribute) -> String {
    let range = attribute.range().map_or("no values".to_string(), |[low, high]| {
        format!("from {} to {}", format_shortest(low), format_shortest(high))
    });
    let missing = match attribute.values.iter().filter(|x| x.is_nan()).count() {
        0 => String::new(),
        n => format!(", {n} without a value"),
    };
    format!("attribute   {} ({}) {range}{missing}\n", attribute.name, attribute.number.name())
}

fn attribute_json(attribute: &Attribute) -> String {
    let range = attribute.range();
    Object::new()
        .text("name", &attribute.name)
        .text("type", attribute.number.name())
        .number("min", range.map(|r| r[0]))
        .number("max", range.map(|r| r[1]))
        .finish()
}

/// Least, median and largest distance of a point to the nearest other one. Not the surface spacing that `--trim` cuts
/// by, which is the side of the square of surface that a point stands for.
pub fn nearest_distances<P: Position>(points: &[P]) -> Option<[f64; 3]> {
    if points.len() < 2 {
        return None;
    }
    // In the unit frame, where squares of distances neither overflow nor vanish.
    let frame = Normalizer::of(points).ok()?;
    let unit = frame.forward(points);
    let neighbours = KdTree::new(&unit).k_nearest(&unit, 2);
    let distances: Vec<f64> = neighbours
        .chunks_exact(2)
        .zip(&unit)
        .map(|(pair, p)| {
            // Of two points at one place either may come first.
            let to =
                |i: u32| (0..3).map(|a| f64::from(p[a] - unit[i as usize][a]).powi(2)).sum::<f64>().sqrt();
            to(pair[0]).max(to(pair[1])) * frame.scale()
        })
        .collect();
    Some([percentile(&distances, 0.0)?, percentile(&distances, 50.0)?, percentile(&distances, 100.0)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_of_points_on_a_line() {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [7.0, 0.0, 0.0]];
        let [least, middle, most] = nearest_distances(&points).unwrap();
        assert!((least - 1.0).abs() < 1e-5 && (middle - 1.5).abs() < 1e-5 && (most - 4.0).abs() < 1e-5);
        assert_eq!(nearest_distances(&points[..1]), None);
        assert_eq!(nearest_distances(&[[1.0; 3]; 3]), None);
    }
}
