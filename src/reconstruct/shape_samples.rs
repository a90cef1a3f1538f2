//! Points on the first shape, which S is to cover in addition to the denoised points.

use crate::bsp::Neighbourhood;
use crate::error::Error;
use crate::geometry::{TriangleMesh, nearest_points, sample_surface};

/// Points on the first shape that S is to cover in its pretraining.
pub(super) struct ShapeSamples {
    /// m x 3, working frame.
    points: Vec<[f32; 3]>,
    /// The index of the denoised point nearest to each, m.
    owners: Vec<u32>,
    /// The number of denoised points.
    denoised_len: usize,
}

/// The samples that a block's part of S is to cover; none by default.
#[derive(Default)]
pub(super) struct BlockSamples {
    /// The samples whose nearest denoised point belongs to the block's context; those nearest to a centre come first.
    pub points: Vec<[f32; 3]>,
    /// The number of `points` whose nearest denoised point is a centre.
    pub own: usize,
}

impl ShapeSamples {
    /// `count` points drawn on a mesh with `seed`, for the `denoised` points (n x 3); both in the working frame.
    ///
    /// # Errors
    /// As [`sample_surface`].
    pub fn of(mesh: &TriangleMesh, denoised: &[[f32; 3]], count: usize, seed: u64) -> Result<Self, Error> {
        let points = sample_surface(mesh, count, seed)?.points;
        let owners = if points.is_empty() { Vec::new() } else { nearest_points(&points, denoised).0 };
        Ok(ShapeSamples { points, owners, denoised_len: denoised.len() })
    }

    /// The samples around the points of a block.
    pub fn around(&self, block: &Neighbourhood) -> BlockSamples {
        let mut role = vec![Role::Outside; self.denoised_len];
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

/// Whether a denoised point is a centre of a block, in its context, or neither.
#[derive(Clone, Copy, PartialEq)]
enum Role {
    Outside,
    Context,
    Centre,
}

#[cfg(test)]
mod tests {
    use super::super::Config;
    use super::super::first_shape::FirstShape;
    use super::*;
    use crate::bsp::{BspConfig, SurfaceMap};
    use crate::geometry::{AnalyticShape, fibonacci_sphere};
    use crate::random::Random;

    #[test]
    fn samples_lie_on_the_shape() {
        let denoised: Vec<[f32; 3]> = fibonacci_sphere(120).into_iter().map(|p| p.map(|x| 0.5 * x)).collect();
        let shape = FirstShape::find(&denoised, None, &Config::default()).unwrap().unwrap();
        let samples = ShapeSamples::of(&shape.mesh, &denoised, 500, 0).unwrap();
        assert_eq!(samples.points.len(), 500);
        for p in &samples.points {
            let radius = p.iter().map(|x| x * x).sum::<f32>().sqrt();
            assert!((radius - 0.5).abs() < 0.02, "radius {radius}");
        }
    }

    #[test]
    fn blocks_share_the_samples() {
        let (denoised, _) = AnalyticShape::Torus { major: 0.34, minor: 0.14 }.sample(200, 1);
        let config = Config::default();
        let shape = FirstShape::find(&denoised, None, &config).unwrap().unwrap();
        let samples = ShapeSamples::of(&shape.mesh, &denoised, 600, 0).unwrap();
        let bsp = BspConfig { channels: 8, heads: 2, ..config.bsp };
        let mut rng = Random::new(0);
        let map = SurfaceMap::new(config.parameterization, bsp, &denoised, &mut rng).unwrap();
        let blocks = map.blocks(&denoised, Some(&shape.normals), 60);
        assert!(blocks.len() > 2);
        let around: Vec<BlockSamples> = blocks.iter().map(|b| samples.around(b)).collect();
        // Every sample is one block's own.
        let mut own: Vec<_> = around.iter().flat_map(|a| a.points[..a.own].to_vec()).collect();
        let mut all = samples.points.clone();
        own.sort_by(|a, b| a.partial_cmp(b).unwrap());
        all.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(own, all);
        assert!(around.iter().all(|a| a.own < a.points.len() && a.points.len() < 600));
        let whole = samples.around(&map.blocks(&denoised, None, 1000)[0]);
        assert_eq!((whole.own, whole.points.len()), (600, 600));
    }
}
