//! What a run begins with: a shape found among the points, for the field to learn and for S to cover.

use super::{Config, StartShape};
use crate::autodiff::{Tape, Var};
use crate::bsp::Neighbourhood;
use crate::error::Error;
use crate::geometry::{TriangleBvh, TriangleMesh, nearest_points, sample_surface};
use crate::loss::Direction;
use crate::start::{
    DENOISED_POINTS, Denoised, GaussField, MAX_PLATE_POINTS, ShapeFit, best_fitting, denoise, gauss_shapes,
    plate_shapes,
};
use crate::tensor::Tensor;
use std::sync::Arc;

/// Radii of dipoles that are tried where `start.dipole_radius` is `None`, in neighbour spacings.
const DIPOLE_RADII: [f32; 3] = [0.25, 0.5, 1.0];

/// The most points for which all of them are tried.
const MAX_RADII_POINTS: usize = 1024;

/// The indicator at the points by given normals ([`GaussField::at_points`]) below which they are those of a body seen
/// from within, such as a room: -1/2 if it is closed, -0.3 or so if half of it is missing, 0 for a sheet.
const WITHIN: f32 = -0.1;

/// The shape that a run begins with.
pub(super) struct FirstShape {
    /// The shape, a closed mesh in the working frame.
    pub mesh: TriangleMesh,
    /// The field's regression to it.
    pub fit: ShapeFit,
    /// The cloud without its noise, if that is asked for and some was found; the shape was found for it then.
    pub denoised: Option<Denoised>,
    /// The area of the shape, working frame.
    pub area: f64,
    /// Its outward unit normals at the working points, n x 3.
    pub normals: Vec<[f32; 3]>,
    /// Whether given normals point into it: it is the free space around which the body lies.
    pub turned: bool,
}

impl FirstShape {
    /// The shape for a cloud (n x 3, working frame), on the sides that `normals` (n x 3, of unit length or zero) tell,
    /// if they are given; `None` if the field starts as a sphere, which needs none.
    ///
    /// # Errors
    /// As [`gauss_shapes`].
    pub fn find(
        given: &[[f32; 3]],
        normals: Option<&[[f32; 3]]>,
        config: &Config,
    ) -> Result<Option<Self>, Error> {
        let (start, seed) = (config.start, config.seed);
        if start.shape == StartShape::Sphere {
            return Ok(None);
        }
        let radii = match &start.dipole_radius {
            // For large clouds no gain was measured that would be worth the time.
            None if given.len() > MAX_RADII_POINTS => &DIPOLE_RADII[1..2],
            None => &DIPOLE_RADII[..],
            Some(radius) => std::slice::from_ref(radius),
        };
        let turned = normals
            .is_some_and(|normals| GaussField::of_normals(given, normals, 1.0, seed).at_points() < WITHIN);
        let outward = normals.map(|normals| match turned {
            true => normals.iter().map(|n| n.map(|x| -x)).collect(),
            false => normals.to_vec(),
        });
        let sides = outward.as_deref();
        let mut rough = gauss_shapes(given, sides, radii, start.regularity, seed)?;
        let denoised = if config.denoise && DENOISED_POINTS.contains(&given.len()) {
            let best = best_fitting(&rough, given, seed)?;
            denoise(given, &TriangleBvh::new(&rough[best])?.normals_near(given))
        } else {
            None
        };
        let cloud = denoised.as_ref().map_or(given, |denoised| &denoised.points);
        let plates = match start.shape {
            StartShape::Plate if cloud.len() <= MAX_PLATE_POINTS => plate_shapes(cloud, sides, &rough).ok(),
            _ => None,
        };
        let mesh = match plates {
            Some(mut plates) => plates.swap_remove(best_fitting(&plates, cloud, seed)?),
            // Points that determine no surface of least bending still have the rough ones.
            None => rough.swap_remove(best_fitting(&rough, cloud, seed)?),
        };
        let normals = TriangleBvh::new(&mesh)?.normals_near(cloud);
        let (area, fit) = (mesh.topology().area, ShapeFit::new(&mesh, seed)?);
        Ok(Some(FirstShape { mesh, fit, denoised, area, normals, turned }))
    }
}

/// Points on the first shape that S is to cover in its pretraining.
pub(super) struct Samples {
    /// m x 3, working frame.
    points: Vec<[f32; 3]>,
    /// The working point nearest to each, m.
    owners: Vec<u32>,
    /// Working points.
    cloud_len: usize,
}

/// The samples that a block's part of S is to cover.
pub(super) struct BlockSamples {
    /// Those nearest to a point of the context, those nearest to a centre first.
    points: Vec<[f32; 3]>,
    /// How many are nearest to a centre.
    own: usize,
}

impl Samples {
    /// `count` points on a mesh, for a cloud (n x 3).
    ///
    /// # Errors
    /// As [`sample_surface`].
    pub fn of(mesh: &TriangleMesh, cloud: &[[f32; 3]], count: usize, seed: u64) -> Result<Self, Error> {
        let points = sample_surface(mesh, count, seed)?.points;
        let owners = if points.is_empty() { Vec::new() } else { nearest_points(&points, cloud).0 };
        Ok(Samples { points, owners, cloud_len: cloud.len() })
    }

    /// The samples around the points of a block.
    pub fn around(&self, block: &Neighbourhood) -> BlockSamples {
        let mut role = vec![Role::Outside; self.cloud_len];
        block.context().iter().for_each(|&i| role[i as usize] = Role::Context);
        block.centres().iter().for_each(|&i| role[i as usize] = Role::Centre);
        let of = |wanted: Role| {
            let chosen = self.points.iter().zip(&self.owners);
            chosen.filter(|(_, owner)| role[**owner as usize] == wanted).map(|(p, _)| *p).collect::<Vec<_>>()
        };
        let mut points = of(Role::Centre);
        let own = points.len();
        points.extend(of(Role::Context));
        BlockSamples { points, own }
    }
}

/// Whether a point of the cloud is a centre of a block, in its context, or neither.
#[derive(Clone, Copy, PartialEq)]
enum Role {
    Outside,
    Context,
    Centre,
}

/// L_para of a block with the shape beside the cloud: from its part of S (m x 3) to the points and samples around, and
/// from its centres and their samples to its part of S; `context` is c x 3.
pub(super) fn shape_term(
    tape: &mut Tape,
    surface: Var,
    context: Var,
    block: &Neighbourhood,
    around: &BlockSamples,
    slack: Option<Arc<[f32]>>,
) -> Var {
    let b = block.centres().len();
    let all = with_samples(tape, context, &around.points);
    if b == block.context().len() && slack.is_none() {
        return tape.chamfer(surface, all, Direction::BOTH);
    }
    let centres = tape.slice_rows(context, 0..b);
    let own = with_samples(tape, centres, &around.points[..around.own]);
    let out = match slack {
        None => tape.chamfer(surface, all, Direction::FORWARD),
        Some(slack) => tape.distance_beyond(surface, all, slack),
    };
    let back = tape.chamfer(surface, own, Direction::BACKWARD);
    tape.add(out, back)
}

fn with_samples(tape: &mut Tape, points: Var, samples: &[[f32; 3]]) -> Var {
    if samples.is_empty() {
        return points;
    }
    let samples = tape.constant(Tensor::from_points(samples));
    tape.concat_rows([samples, points])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsp::{BspConfig, SurfaceMap};
    use crate::geometry::{Shape, fibonacci_sphere};
    use crate::random::Random;

    fn sphere(n: usize) -> Vec<[f32; 3]> {
        fibonacci_sphere(n).into_iter().map(|p| p.map(|x| 0.5 * x)).collect()
    }

    #[test]
    fn normals_point_outward_and_samples_lie_on_the_shape() {
        let cloud = sphere(120);
        let shape = FirstShape::find(&cloud, None, &Config::default()).unwrap().unwrap();
        for (p, n) in cloud.iter().zip(&shape.normals) {
            let cos: f32 = (0..3).map(|d| 2.0 * p[d] * n[d]).sum();
            assert!(cos > 0.95, "{p:?} {n:?}");
        }
        let samples = Samples::of(&shape.mesh, &cloud, 500, 0).unwrap();
        assert_eq!(samples.points.len(), 500);
        for p in &samples.points {
            let radius = p.iter().map(|x| x * x).sum::<f32>().sqrt();
            assert!((radius - 0.5).abs() < 0.02, "radius {radius}");
        }
    }

    #[test]
    fn a_sphere_needs_no_shape() {
        let mut config = Config::default();
        config.start.shape = StartShape::Sphere;
        assert!(FirstShape::find(&sphere(50), None, &config).unwrap().is_none());
    }

    #[test]
    fn the_parts_of_a_large_cloud_share_the_samples() {
        let (cloud, _) = Shape::Torus { major: 0.34, minor: 0.14 }.sample(200, 1);
        let config = Config::default();
        let shape = FirstShape::find(&cloud, None, &config).unwrap().unwrap();
        let samples = Samples::of(&shape.mesh, &cloud, 600, 0).unwrap();
        let bsp = BspConfig { channels: 8, heads: 2, ..config.bsp };
        let mut rng = Random::new(0);
        let map = SurfaceMap::new(config.parameterization, bsp, &cloud, &mut rng).unwrap();
        let blocks = map.blocks(&cloud, Some(&shape.normals), 60);
        assert!(blocks.len() > 2);
        let around: Vec<BlockSamples> = blocks.iter().map(|b| samples.around(b)).collect();
        // Every sample is one block's own.
        let mut own: Vec<_> = around.iter().flat_map(|a| a.points[..a.own].to_vec()).collect();
        let mut all = samples.points.clone();
        own.sort_by(|a, b| a.partial_cmp(b).unwrap());
        all.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(own, all);
        assert!(around.iter().all(|a| a.own < a.points.len() && a.points.len() < 600));
        let whole = samples.around(&map.blocks(&cloud, None, 1000)[0]);
        assert_eq!((whole.own, whole.points.len()), (600, 600));
    }
}
