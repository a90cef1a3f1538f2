//! The regression of the field to the signed distance of the first shape.

use super::USUAL_AREA;
use crate::error::Error;
use crate::field::{Field, FieldPass};
use crate::geometry::{TriangleBvh, TriangleMesh, sample_surface};
use crate::tensor::Tensor;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use std::sync::OnceLock;

/// Points in the pool that steps go through batch by batch.
const POOL: usize = 20_480;
/// Points in a step; divides the pool.
const BATCH: usize = 2048;
/// Standard deviations of the points from a surface of usual area, near and farther.
const SPREADS: [f32; 2] = [0.015, 0.08];
/// The least factor of these deviations, that of the smallest surfaces.
const MIN_SPREAD: f64 = 0.25;
/// Half the side of the cube that the points far from the mesh are drawn from (working frame; the input reaches to
/// 0.5).
const BOX: f32 = 0.6;
/// Weight of |grad g - n|^2, where |g - d| has weight 1.
const NORMAL_WEIGHT: f32 = 0.01;

/// The regression of a field to the signed distance of a closed mesh, step by step.
///
/// 20,480 points are drawn near the mesh, nearer to one of small area, and in the cube around it; a step takes the next
/// 2,048 of them, round and round. A batch's distances are computed when a step first needs them. Nothing else changes
/// from step to step, so the same mesh and seed give the same steps again.
#[derive(Clone, Debug)]
pub struct ShapeFit {
    tree: TriangleBvh,
    points: Vec<[f32; 3]>,
    /// The distances and gradients that the field is to have at each batch of points; set when a step first needs them.
    targets: Vec<OnceLock<Targets>>,
}

/// Signed distances and their gradients at a batch of points.
#[derive(Clone, Debug)]
struct Targets {
    distances: Vec<f32>,
    normals: Vec<[f32; 3]>,
}

/// The loss of a step of [`ShapeFit`] and its gradients.
#[derive(Clone, Debug)]
pub struct ShapeFitStep {
    /// The mean of |g - d| plus 0.01 times the mean of |grad g - grad d|^2, d the distance to the mesh.
    pub loss: f32,
    /// The loss's gradient for each parameter of the field.
    pub gradients: Vec<Option<Tensor>>,
}

impl ShapeFit {
    /// The regression to the closed `mesh` (working frame), whose triangles face outward.
    ///
    /// Of the points two fifths are displaced from the mesh by a standard deviation of 0.015, two fifths by 0.08, times
    /// sqrt(area / 2.2) if its area is below 2.2, but a quarter at least; a fifth is drawn from the cube from -0.6 to
    /// 0.6.
    ///
    /// # Errors
    /// As [`sample_surface`] and [`TriangleBvh::new`] for an empty mesh.
    pub fn new(mesh: &TriangleMesh, seed: u64) -> Result<Self, Error> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let surface = sample_surface(mesh, POOL, seed)?;
        let tree = TriangleBvh::new(mesh)?;
        // The smaller the surface, the thinner its parts.
        let scale = (mesh.topology().area / USUAL_AREA).sqrt().clamp(MIN_SPREAD, 1.0) as f32;
        let mut place = |(i, p): (usize, &[f32; 3])| -> [f32; 3] {
            // Two fifths close by, two fifths farther, one fifth anywhere.
            let spread = scale * SPREADS[i % 2];
            std::array::from_fn(|d| {
                if i % 5 == 4 {
                    rng.random_range(-BOX..BOX)
                } else {
                    let z: f32 = StandardNormal.sample(&mut rng);
                    p[d] + spread * z
                }
            })
        };
        let points = surface.points.iter().enumerate().map(&mut place).collect();
        Ok(ShapeFit { tree, points, targets: vec![OnceLock::new(); POOL / BATCH] })
    }

    /// The loss of step `step` (from 0) and its gradients.
    pub fn step(&self, field: &Field, pass: &mut FieldPass, step: usize) -> ShapeFitStep {
        let batch = step % self.targets.len();
        let points = &self.points[batch * BATCH..][..BATCH];
        let targets = self.targets[batch].get_or_init(|| Targets::at(points, &self.tree));

        let cols = field.value_cols();
        let mut values = vec![0.0; BATCH * cols];
        pass.forward(field, points, &mut values);
        let n = BATCH as f32;
        let mut seeds = vec![0.0; values.len()];
        let (mut off, mut bent) = (0.0f64, 0.0f64);
        let wanted = targets.distances.iter().zip(&targets.normals);
        for ((out, value), (d, normal)) in
            seeds.chunks_exact_mut(cols).zip(values.chunks_exact(cols)).zip(wanted)
        {
            off += f64::from((value[0] - d).abs());
            out[0] = (value[0] - d).signum() / n;
            for ((out, g), t) in out[1..4].iter_mut().zip(&value[1..4]).zip(normal) {
                bent += f64::from((g - t) * (g - t));
                *out = 2.0 * NORMAL_WEIGHT * (g - t) / n;
            }
        }
        let gradients = field.params().split(&pass.backward(&seeds)).into_iter().map(Some).collect();
        pass.release();
        ShapeFitStep { loss: ((off + f64::from(NORMAL_WEIGHT) * bent) / f64::from(n)) as f32, gradients }
    }
}

impl Targets {
    fn at(points: &[[f32; 3]], tree: &TriangleBvh) -> Self {
        let (distances, normals) = tree.signed_distances(points);
        Targets { distances, normals }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{FieldActivation, FieldConfig};
    use crate::geometry::AnalyticShape;
    use crate::optim::{Adam, AdamOptions};
    use crate::random::Random;
    use crate::start::gauss_shape;

    #[test]
    fn the_field_takes_the_shape_of_a_torus() {
        let torus = AnalyticShape::Torus { major: 0.34, minor: 0.14 };
        let config = FieldConfig {
            width: 32,
            depth: 3,
            octaves: 2,
            frequency: 2.0,
            activation: FieldActivation::Softplus { beta: 100.0 },
            skip: None,
            radius: 0.35,
        };
        let mut field = Field::new(config, &mut Random::new(1));
        let mesh = gauss_shape(&torus.sample(250, 2).0, None, 0.5, 0.05, 0).unwrap();
        let fit = ShapeFit::new(&mesh, 0).unwrap();
        let (mut pass, mut adam) =
            (FieldPass::default(), Adam::new(field.params().values(), AdamOptions::default()));
        let mut last = f32::NAN;
        for i in 0..150 {
            let step = fit.step(&field, &mut pass, i);
            adam.step(field.params_mut().values_mut(), &step.gradients, 3e-3);
            last = step.loss;
        }
        assert!(last < 0.04, "loss {last}");
        let probes = [[0.0; 3], [0.34, 0.0, 0.0], [0.0, -0.34, 0.02], [0.5, 0.5, 0.0]];
        let signs: Vec<bool> = field.sdf(&probes).iter().map(|&s| s < 0.0).collect();
        assert_eq!(signs, [false, true, true, false]);
    }

    #[test]
    fn a_step_does_not_depend_on_the_steps_before_it() {
        let mesh =
            gauss_shape(&AnalyticShape::Sphere { radius: 0.5 }.sample(60, 1).0, None, 0.5, 0.05, 0).unwrap();
        let config = FieldConfig {
            width: 8,
            depth: 2,
            octaves: 0,
            frequency: 1.0,
            activation: FieldActivation::Relu,
            skip: None,
            radius: 0.4,
        };
        let field = Field::new(config, &mut Random::new(1));
        let fit = ShapeFit::new(&mesh, 7).unwrap();
        let loss =
            |fit: &ShapeFit, step: usize| fit.step(&field, &mut FieldPass::default(), step).loss.to_bits();
        let all: Vec<u32> = (0..12).map(|i| loss(&fit, i)).collect();
        assert!(all[0] == all[10] && all[1] == all[11] && all[0] != all[1]);
        assert_eq!(loss(&mut ShapeFit::new(&mesh, 7).unwrap(), 6), all[6]);
        assert_ne!(loss(&mut ShapeFit::new(&mesh, 8).unwrap(), 6), all[6]);
    }

    #[test]
    fn points_lie_as_close_as_the_surface_is_small() {
        let near = |radius: f64| {
            let mesh =
                gauss_shape(&AnalyticShape::Sphere { radius }.sample(80, 1).0, None, 0.5, 0.05, 0).unwrap();
            let fit = ShapeFit::new(&mesh, 3).unwrap();
            let close = fit.points.iter().enumerate().filter(|(i, _)| i % 2 == 0 && i % 5 != 4);
            let off: Vec<f32> = close.map(|(_, x)| fit.tree.signed_distance(*x).0.abs()).collect();
            f64::from(off.iter().sum::<f32>()) / off.len() as f64
        };
        // Areas 3.1, 1.1 and 0.13: as it is, 0.72 times, and the least.
        let usual = near(0.5);
        assert!((usual / (0.015 * (2.0 / std::f64::consts::PI).sqrt()) - 1.0).abs() < 0.1, "{usual}");
        for (radius, share) in [(0.3, 0.72), (0.1, 0.25)] {
            let ratio = near(radius) / usual;
            assert!((ratio / share - 1.0).abs() < 0.15, "{ratio} at radius {radius}");
        }
    }

    #[test]
    fn targets_are_distances_with_the_sign_of_the_side() {
        // A cube of side 1 around the origin, two triangles a side, corner b at the bits of b.
        let corner = |b: u32| std::array::from_fn(|d| if b >> d & 1 == 1 { 0.5f32 } else { -0.5 });
        let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let mesh = TriangleMesh {
            verts: (0..8).map(corner).collect(),
            faces: sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        };
        assert!((mesh.topology().volume - 1.0).abs() < 1e-6);
        let tree = TriangleBvh::new(&mesh).unwrap();
        let Targets { distances, normals } =
            Targets::at(&[[0.75, 0.1, 0.0], [0.0, -0.3, 0.1], [0.8, 0.9, 0.0]], &tree);
        for (d, want) in distances.iter().zip([0.25, -0.2, 0.5]) {
            assert!((d - want).abs() < 1e-6, "{d}");
        }
        for (n, want) in normals.iter().zip([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.6, 0.8, 0.0]]) {
            assert!((0..3).all(|d| (n[d] - want[d]).abs() < 1e-5), "{n:?}");
        }
    }
}
