//! Giving the field a shape to start from.

use super::{Field, FieldPass, FieldValues, GaussField};
use crate::error::{Error, ErrorKind};
use crate::geometry::{NarrowBandOptions, TetGrid, TriangleBvh, TriangleMesh, extract, sample_surface};
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

/// Cubes along each side of the grid that the Gauss formula's surface is taken from.
const GAUSS_RESOLUTION: usize = 48;
/// Parts of that surface below this share of the largest one's area are left out.
const GAUSS_MIN_PART: f64 = 0.02;

/// How [`start_from_gauss`] finds its shape and how the field learns it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaussStart {
    /// As in [`GaussField::fit`], in local point spacings.
    pub width: f32,
    /// As in [`GaussField::fit`].
    pub regularity: f64,
    /// Steps of the regression.
    pub steps: usize,
    /// Its learning rate.
    pub rate: f32,
}

/// Gives the field the shape that the parametric Gauss formula finds among `points` (n x 3, working frame).
///
/// Returns the mean of |g - d| at the end of the regression, d the distance to that shape.
///
/// # Errors
/// [`ErrorKind::NoSurface`] if the formula encloses nothing, and as [`GaussField::fit`] and [`fit_to_mesh`].
pub fn start_from_gauss(
    field: &mut Field,
    pass: &mut FieldPass,
    points: &[[f32; 3]],
    start: &GaussStart,
    seed: u64,
) -> Result<f32, Error> {
    let gauss = GaussField::fit(points, start.width, start.regularity, seed)?;
    let grid = TetGrid::working_frame(GAUSS_RESOLUTION)?;
    let mut eval = |x: &[[f32; 3]]| Ok(gauss.sdf(x));
    let options = NarrowBandOptions { seeds: points, ..Default::default() };
    let mesh = extract(&grid, &mut eval, &options).map_err(|e| {
        Error::new(e.kind(), "the first guess of inside and outside encloses nothing")
            .caused_by(e)
            .advise("start from a sphere (start.shape = sphere)")
    })?;
    fit_to_mesh(field, pass, &mesh.keep_large(GAUSS_MIN_PART), start.steps, start.rate, seed)
}

/// Fits the field to the signed distance of a closed mesh (working frame) by regression: the mean of |g - d| plus a
/// small multiple of the mean of |grad g - grad d|^2, over points near the mesh and in the box around it.
///
/// Returns the mean of |g - d| over the last batch, NaN for no steps.
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
        let FieldValues { sdf, gradient, .. } =
            pass.forward(field, &points[range.clone()], &Default::default());
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
        let d = FieldValues { sdf: d_sdf, gradient: d_gradient, offset: None };
        let gradients = pass.backward(field, &d);
        pass.release();
        adam.step(field.params_mut().values_mut(), &gradients, schedule.rate_at(step, steps));
    }
    Ok(mean)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gdo::{Activation, FieldConfig};
    use crate::geometry::Shape;

    #[test]
    fn the_field_takes_the_shape_of_a_torus() {
        let torus = Shape::Torus { major: 0.34, minor: 0.14 };
        let config = FieldConfig {
            width: 32,
            depth: 3,
            octaves: 2,
            frequency: 2.0,
            activation: Activation::Softplus { beta: 100.0 },
            skip: None,
            radius: 0.35,
        };
        let mut field = Field::new(config, &mut ChaCha8Rng::seed_from_u64(1));
        let start = GaussStart { width: 0.5, regularity: 0.05, steps: 150, rate: 3e-3 };
        let points = torus.sample(250, 2).0;
        let mean = start_from_gauss(&mut field, &mut FieldPass::new(), &points, &start, 0).unwrap();
        assert!(mean < 0.03, "mean distance {mean}");
        let probes = [[0.0; 3], [0.34, 0.0, 0.0], [0.0, -0.34, 0.02], [0.5, 0.5, 0.0]];
        let signs: Vec<bool> = field.sdf(&probes).iter().map(|&s| s < 0.0).collect();
        assert_eq!(signs, [false, true, true, false]);
    }
}
