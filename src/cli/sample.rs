//! `sample`: a point cloud from a mesh.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;
use std::str::FromStr;

use bijective_sdf::geometry::{Bounds, sample_surface};
use bijective_sdf::io::Format;
use clap::Args;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::Common;
use super::failure::Failure;
use super::formats::{CLOUD_FORMATS, format_parser, parser_of};
use super::input::Input;
use super::output::Output;
use super::paths::check_apart;

/// Arguments of `sample`.
#[derive(Debug, Args)]
pub struct SampleArgs {
    /// A triangle mesh (ply, obj, stl, off), or `-`
    mesh: PathBuf,
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

/// Samples a mesh.
pub fn run(args: &SampleArgs, common: Common) -> Result<(), Failure> {
    let output = Output::new(&args.output, args.output_format, args.ascii, &CLOUD_FORMATS)?;
    check_apart("--output", &args.output, &args.mesh)?;
    let mesh = Input::read(&args.mesh, args.format)?.mesh()?;
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
pub fn add_noise(points: &mut [[f32; 3]], deviation: f64, seed: u64) {
    if deviation == 0.0 {
        return;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    // Streams from 0 upwards place the points.
    rng.set_stream(u64::MAX);
    for x in points.as_flattened_mut() {
        let z: f64 = StandardNormal.sample(&mut rng);
        *x = (f64::from(*x) + deviation * z) as f32;
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
