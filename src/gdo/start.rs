//! Giving the field a shape to start from.

use super::{Field, FieldPass};
use crate::error::{Error, ErrorKind};
use crate::geometry::{TriangleBvh, TriangleMesh, sample_surface};
use crate::optim::{Adam, AdamOptions, Schedule};
use crate::tensor::Tensor;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// Points whose distance to the mesh is taken once; steps go through them batch by batch.
const POOL: usize = 20_480;
/// Points in a step.
const BATCH: usize = 2048;
/// Weight of |grad g - n|^2 beside |g - d|.
const NORMAL_WEIGHT: f32 = 0.01;

/// Fits the field to the signed distance of a closed mesh (working frame) by regression: the mean of |g - d| plus a
/// small multiple of the mean of |grad g - grad d|^2, over points near the mesh and in the box around it.
///
/// Returns the mean of |g - d| over the last batch.
///
/// # Errors
/// As [`sample_surface`] and [`TriangleBvh::new`] for an empty mesh; [`ErrorKind::Diverged`] if the fit does not stay
/// finite.
pub fn fit_to_mesh(
    field: &mut Field,
    pass: &mut FieldPass,
    mesh: &TriangleMesh,
    steps: usize,
    rate: f32,
    seed: u64,
) -> Result<f32, Error> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let surface = sample_surface(mesh, POOL, seed)?;
    let tree = TriangleBvh::new(mesh)?;
    let mut place = |(i, p): (usize, &[f32; 3])| -> [f32; 3] {
        // Two fifths close by, two fifths farther, one fifth anywhere.
        let spread = [0.015f32, 0.08][i % 2];
        std::array::from_fn(|d| {
            if i % 5 == 4 {
                rng.random_range(-0.6..0.6)
            } else {
                let z: f32 = StandardNormal.sample(&mut rng);
                p[d] + spread * z
            }
        })
    };
    let points: Vec<[f32; 3]> = surface.points.iter().enumerate().map(&mut place).collect();
    let hits = tree.nearest_all(&points);
    let (distances, normals): (Vec<f32>, Vec<[f32; 3]>) = points
        .iter()
        .zip(&hits)
        .map(|(x, hit)| {
            let away: [f32; 3] = std::array::from_fn(|d| x[d] - hit.point[d]);
            let normal = tree.face_normal(hit.face);
            let side = (0..3).map(|d| away[d] * normal[d]).sum::<f32>();
            let distance = (hit.dist_sq as f32).sqrt() * side.signum();
            let direction = if distance.abs() > 1e-4 { away.map(|a| a / distance) } else { normal };
            (distance, direction)
        })
        .unzip();

    let mut adam = Adam::new(field.params().values(), AdamOptions::default());
    let schedule = Schedule { warmup: steps / 20, ..Schedule::constant(rate) };
    let mut mean = f32::NAN;
    for step in 0..steps {
        let first = step * BATCH % POOL;
        let range = first..(first + BATCH).min(POOL);
        let (sdf, gradient) = pass.forward(field, &points[range.clone()], &Default::default());
        let n = range.len() as f32;
        let mut d_sdf = Tensor::zeros(sdf.dims());
        let mut total = 0.0f64;
        for ((out, g), d) in d_sdf.data_mut().iter_mut().zip(sdf.data()).zip(&distances[range.clone()]) {
            total += f64::from((g - d).abs());
            *out = (g - d).signum() / n;
        }
        let mut d_gradient = Tensor::zeros(gradient.dims());
        let targets = normals[range].as_flattened();
        for ((out, g), t) in d_gradient.data_mut().iter_mut().zip(gradient.data()).zip(targets) {
            *out = 2.0 * NORMAL_WEIGHT * (g - t) / n;
        }
        mean = (total / f64::from(n)) as f32;
        if !mean.is_finite() {
            return Err(Error::new(ErrorKind::Diverged, "fitting the field to its start diverged")
                .advise("lower the learning rate of the start"));
        }
        let gradients = pass.backward(&d_sdf, &d_gradient);
        pass.release();
        adam.step(field.params_mut().values_mut(), &gradients, schedule.rate_at(step, steps));
    }
    Ok(mean)
}
