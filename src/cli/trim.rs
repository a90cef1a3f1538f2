//! `--trim`: the surface cut where no point supports it.

use bijective_sdf::Error;
use bijective_sdf::geometry::TriangleMesh;
use bijective_sdf::scene::{TRIM_FACTOR, Trimmed, point_support, trim};
use clap::Args;

use super::Common;
use super::failure::Failure;
use super::json::Object;

/// Options that say which part of a surface is written.
#[derive(Debug, Args)]
pub struct TrimArgs {
    /// Cut away what no point supports: what is farther from the nearest point on the same side of the surface than
    /// FACTOR times the surface spacing there (the side of the square of surface that each point around stands for, or
    /// how far the lines of a scanner are apart), except small holes. What is left is cut back until it ends 0.6 FACTOR
    /// spacings beyond the outermost points, and scraps are dropped; the mesh is open then [FACTOR if left out: 1]
    #[arg(long, value_name = "FACTOR", num_args = 0..=1, default_missing_value = DEFAULT, value_parser = factor)]
    pub trim: Option<f32>,
    /// Write how far each vertex is from the nearest point on the same side of the surface, over the surface spacing
    /// there, as the property `support` of a ply mesh: 0 at a point, about 0.7 between evenly spread points, large
    /// where no point is near; what --trim compares with FACTOR
    #[arg(long)]
    pub support: bool,
}

/// [`TRIM_FACTOR`] as text.
const DEFAULT: &str = "1";
const _: () = assert!(TRIM_FACTOR == 1.0);

fn factor(text: &str) -> Result<f32, String> {
    let number = text.parse::<f32>().ok().filter(|f| *f > 0.0 && f.is_finite());
    number.ok_or_else(|| "a number above 0 expected; before a file name write --trim=1".into())
}

/// What is left of a mesh, and how much was cut away.
pub struct Part {
    pub mesh: TriangleMesh<[f64; 3]>,
    /// The factor and the share of the area that was removed; none if nothing was asked for.
    pub cut: Option<(f32, f64)>,
    /// The gap of each vertex, which `--support` writes, if asked for.
    pub support: Option<Vec<f32>>,
}

impl TrimArgs {
    /// The part of a mesh that the options leave, for the points it was made from.
    pub fn part(
        &self,
        mesh: TriangleMesh<[f64; 3]>,
        points: &[[f64; 3]],
        common: Common,
    ) -> Result<Part, Failure> {
        if self.trim.is_none() && !self.support {
            return Ok(Part { mesh, cut: None, support: None });
        }
        let near = point_support(&mesh, points)?;
        let Some(factor) = self.trim else { return Ok(Part { mesh, cut: None, support: Some(near.gap) }) };
        let Trimmed { mesh, removed, gap, .. } = trim(&mesh, &near, factor);
        if mesh.faces.is_empty() {
            return Err(Failure::from(nothing_left(factor)));
        }
        common.note(&if removed > 0.0 {
            format!("cut away {:.1} % of the area: the mesh is open where no point is near", 100.0 * removed)
        } else {
            "cut nothing away: points are near everywhere".to_string()
        });
        Ok(Part { mesh, cut: Some((factor, removed)), support: self.support.then_some(gap) })
    }
}

fn nothing_left(factor: f32) -> Error {
    let text = format!("no part of the surface is within {factor} surface spacings of a point");
    Error::new(bijective_sdf::ErrorKind::NoSurface, text).advise("give a larger --trim")
}

impl Part {
    /// As a JSON value: `null`, or the factor and the share removed.
    pub fn json(&self) -> String {
        self.cut.map_or("null".to_string(), |(factor, removed)| {
            Object::new().number("factor", f64::from(factor)).number("removed", removed).finish()
        })
    }
}
