//! `sample`: a point cloud from a mesh, or of a made-up scene.

use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use bijective_sdf::geometry::{Bounds, Position, SpinningScanner, SyntheticScene, sample_surface};
use bijective_sdf::io::Format;
use clap::{Args, ValueEnum};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::Common;
use super::failure::Failure;
use super::formats::{CLOUD_FORMATS, format_parser, parser_of};
use super::input::Input;
use super::output::Output;
use super::paths::check_apart;
use super::sides::three_numbers;

/// Arguments of `sample`.
#[derive(Debug, Args)]
pub struct SampleArgs {
    /// A triangle mesh (ply, obj, stl, off), or `-`
    #[arg(required_unless_present = "scene")]
    mesh: Option<PathBuf>,
    /// Take this made-up scene instead of a mesh; metres, z points up
    #[arg(long, conflicts_with_all = ["mesh", "count", "format"])]
    scene: Option<SceneName>,
    /// Points a square metre of the scene, spread evenly at random
    #[arg(long, value_name = "N", default_value = "100", requires = "scene", value_parser = positive)]
    density: f64,
    /// What a spinning laser scanner at this place of the scene sees, instead of points spread evenly: 64 rings of
    /// 2,000 rays, up to 80 m; `--noise` is that of the range
    #[arg(long, value_name = "X,Y,Z", requires = "scene", conflicts_with = "density", value_parser = three_numbers,
        allow_hyphen_values = true)]
    scanner: Option<[f64; 3]>,
    /// Length of the street, metres
    #[arg(long, value_name = "M", default_value = "100", requires = "scene", value_parser = positive)]
    length: f64,
    /// Write the scene's normals too, which `evaluate` compares with those of a mesh (ply only)
    #[arg(long, requires = "scene", conflicts_with = "scanner")]
    normals: bool,
    /// The point cloud to write (ply, xyz, csv), or `-`
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Number of points
    #[arg(short = 'n', long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    count: u32,
    /// Standard deviation of Gaussian noise, in units of the mesh or, as in `0.5%`, of its longest side
    #[arg(long, default_value = "0", allow_negative_numbers = true)]
    noise: Noise,
    /// Seed of places and noise
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Format of the mesh [default: by content, and where that fits several, by extension]
    #[arg(long, value_parser = format_parser())]
    format: Option<Format>,
    /// Format of the cloud [default: by extension; ply for `-`]
    #[arg(long, value_parser = parser_of(CLOUD_FORMATS.to_vec()))]
    output_format: Option<Format>,
    /// Write text where the format also has a binary form
    #[arg(long)]
    ascii: bool,
}

/// The scenes that can be made up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SceneName {
    /// A furnished room of 5 x 4 x 2.6 m
    Room,
    /// A street of houses, cars, posts, signs and trees, 30 m wide
    Street,
}

/// How much noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Noise {
    /// In the units of the mesh.
    Absolute(f64),
    /// As a part of the longest side.
    Relative(f64),
}

impl Display for Noise {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Noise::Absolute(x) => write!(f, "{x}"),
            Noise::Relative(part) => write!(f, "{}%", 100.0 * part),
        }
    }
}

impl FromStr for Noise {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let (number, relative) = match s.strip_suffix('%') {
            Some(number) => (number, true),
            None => (s, false),
        };
        match number.trim().parse::<f64>() {
            Ok(x) if x.is_finite() && x >= 0.0 => {
                Ok(if relative { Noise::Relative(x / 100.0) } else { Noise::Absolute(x) })
            }
            _ => Err("a number of at least 0 expected, such as 0.01 or 0.5%".into()),
        }
    }
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err("a number above 0 expected".into()),
    }
}

/// Samples a mesh or a scene.
pub fn run(args: &SampleArgs, common: Common) -> Result<(), Failure> {
    let output = Output::new(&args.output, args.output_format, args.ascii, &CLOUD_FORMATS)?;
    match (&args.mesh, args.scene) {
        (_, Some(scene)) => sample_scene(args, scene, &output, common),
        (Some(mesh), None) => sample_mesh(args, mesh, &output, common),
        (None, None) => Err(Failure::Usage("a mesh or --scene is needed".into())),
    }
}

fn sample_scene(args: &SampleArgs, scene: SceneName, output: &Output, common: Common) -> Result<(), Failure> {
    let Noise::Absolute(noise) = args.noise else {
        return Err(Failure::Usage("--noise of a scene is in metres".into()));
    };
    if args.normals && output.format() != Format::Ply {
        return Err(Failure::Usage(format!("--normals are not written as {}; write ply", output.format())));
    }
    let (made, elevations) = match scene {
        SceneName::Room => (SyntheticScene::furnished_room(), [-60.0, 60.0]),
        SceneName::Street => (SyntheticScene::street(args.length), [-25.0, 15.0]),
    };
    let (points, normals) = match args.scanner {
        Some(place) if made.sdf(place) <= 0.0 => {
            return Err(Failure::Usage("--scanner is not in free space".into()));
        }
        Some(place) => {
            let scanner = SpinningScanner {
                place,
                rings: 64,
                elevations,
                rays: 2000,
                max_range: 80.0,
                range_noise: noise,
            };
            (made.scan(&scanner, args.seed), Vec::new())
        }
        None => {
            let (mut points, normals) = made.sample(args.density, args.seed);
            add_noise(&mut points, noise, args.seed);
            (points, normals)
        }
    };
    let count = points.len();
    if args.normals {
        output.write_oriented_cloud(&points, &normals)?;
    } else {
        output.write_cloud(&points)?;
    }
    common.note(&format!("{count} points with noise {noise}"));
    Ok(())
}

fn sample_mesh(args: &SampleArgs, path: &Path, output: &Output, common: Common) -> Result<(), Failure> {
    check_apart("--output", &args.output, path)?;
    let mesh = Input::read(path, args.format)?.mesh()?;
    let offset = mesh.offset();
    let mut points = sample_surface(&mesh.relative_to(offset), args.count as usize, args.seed)?.points;
    let deviation = match args.noise {
        Noise::Absolute(x) => x,
        Noise::Relative(part) => part * Bounds::of(&mesh.verts)?.longest(),
    };
    add_noise(&mut points, deviation, args.seed);
    let place = |p: &[f32; 3]| -> [f64; 3] { std::array::from_fn(|a| f64::from(p[a]) + offset[a]) };
    output.write_cloud(&points.iter().map(place).collect::<Vec<_>>())?;
    common.note(&format!("{} points with noise {deviation}", points.len()));
    Ok(())
}

/// Moves every coordinate by a Gaussian number of the given standard deviation.
pub fn add_noise<P: Position>(points: &mut [P], deviation: f64, seed: u64) {
    if deviation == 0.0 {
        return;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    // Streams from 0 upwards place the points.
    rng.set_stream(u64::MAX);
    for p in points {
        *p = P::of_wide(p.wide().map(|x| {
            let z: f64 = StandardNormal.sample(&mut rng);
            x + deviation * z
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_read_and_has_its_size() {
        assert_eq!("0.5%".parse(), Ok(Noise::Relative(0.005)));
        assert_eq!("2".parse(), Ok(Noise::Absolute(2.0)));
        for bad in ["-1", "x", "", "%", "nan", "inf"] {
            assert!(bad.parse::<Noise>().is_err(), "{bad}");
        }
        let mut points = vec![[1.0f32; 3]; 4000];
        add_noise(&mut points, 0.5, 1);
        let var = points.as_flattened().iter().map(|x| f64::from(x - 1.0).powi(2)).sum::<f64>() / 12_000.0;
        assert!((var.sqrt() - 0.5).abs() < 0.01, "{var}");
    }
}
