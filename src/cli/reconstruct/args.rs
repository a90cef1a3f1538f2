//! The arguments of `reconstruct`.

use std::path::PathBuf;
use std::time::Duration;

use bijective_sdf::io::Format;
use clap::Args;

use super::super::cleaning::Outliers;
use super::super::fineness::FinenessArgs;
use super::super::formats::{MESH_FORMATS, parser_of};
use super::super::preview::ViewArgs;
use super::super::reading::ReadArgs;
use super::super::settings::Settings;
use super::super::sides::{SidesArgs, three_numbers};
use super::super::trim::TrimArgs;

/// Seconds between two checkpoints.
const CHECKPOINT_SECONDS: u64 = 60;

/// Arguments of `reconstruct`.
#[derive(Debug, Args)]
pub struct ReconstructArgs {
    /// The point cloud, or `-`; `bijective-sdf reconstruct --help` lists the formats at --format
    pub input: PathBuf,
    /// The mesh to write (ply, obj, stl, off, glb), or `-`
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    #[command(flatten)]
    pub settings: Settings,
    #[command(flatten)]
    pub fineness: FinenessArgs,
    #[command(flatten)]
    pub reading: ReadArgs,
    /// Points that belong to no surface, far from all others and off the surface that these suggest
    #[arg(long, value_enum, default_value_t)]
    pub outliers: Outliers,
    #[command(flatten)]
    pub sides: SidesArgs,
    /// What the axes are multiplied by for the work, for points that lie closer along one direction than along others:
    /// `1,1,0.2` for slices across z that are far apart. The mesh and the field are in the frame of the input
    #[arg(long, value_name = "X,Y,Z", value_parser = three_numbers, allow_hyphen_values = true)]
    pub anisotropy: Option<[f64; 3]>,
    /// Format of the mesh [default: by extension; ply for `-`]
    #[arg(long, value_parser = parser_of(MESH_FORMATS.to_vec()))]
    pub output_format: Option<Format>,
    /// Write text where the format also has a binary form
    #[arg(long)]
    pub ascii: bool,
    /// Write checkpoints to this file now and then and at the end
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Seconds between two checkpoints
    #[arg(long, value_name = "SECONDS", default_value_t = CHECKPOINT_SECONDS, requires = "checkpoint")]
    pub checkpoint_every: u64,
    /// Go on from a checkpoint of the same cloud, with its options; those that are given must agree with it
    #[arg(long, value_name = "FILE")]
    pub resume: Option<PathBuf>,
    /// Stop the steps after this time and write what there is then: the trained field, or the first shape if the
    /// training proper has not begun. Only steps are left out: finding the first shape before them, at least one step,
    /// and taking the mesh behind them are not limited
    #[arg(long, value_name = "SECONDS", value_parser = seconds, allow_negative_numbers = true)]
    pub time_limit: Option<Duration>,
    /// Write the denser points that the surface was drawn to in the training (ply, xyz, csv)
    #[arg(long, value_name = "FILE")]
    pub surface_points: Option<PathBuf>,
    /// Write point clouds in the colours of their codes on the sphere, rgb = (code + 1) / 2, to draw the
    /// parameterization with: STEM-points.ply (the points Q), STEM-codes.ply (their codes U), STEM-surface.ply (the
    /// denser points S), STEM-patches.ply (the codes P of S), STEM-grid.ply (the vertices V of the training's grid
    /// around the surface) and STEM-moved.ply (V', the same moved along the field); a vertex has the code of the point
    /// of S nearest to it in V'
    #[arg(long, value_name = "STEM")]
    pub codes: Option<PathBuf>,
    /// Write the field, for the commands `sdf` and `mesh`. Until the mesh is written it is kept in any case, beside it
    #[arg(long, value_name = "FILE")]
    pub save_field: Option<PathBuf>,
    /// Give each vertex of the mesh what the input has beside the coordinates of the point nearest to it, such as
    /// colours, intensities and classes (ply; obj and glb: colours only)
    #[arg(long)]
    pub carry: bool,
    #[command(flatten)]
    pub trim: TrimArgs,
    #[command(flatten)]
    pub view: ViewArgs,
    /// Print one JSON object about the run
    #[arg(long)]
    pub json: bool,
}

fn seconds(text: &str) -> Result<Duration, String> {
    text.parse::<f64>()
        .ok()
        .and_then(|s| Duration::try_from_secs_f64(s).ok())
        .ok_or_else(|| "a number of seconds expected".into())
}
