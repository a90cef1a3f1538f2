//! The result: a field and what comes with it, in the input's frame.

use super::Config;
use super::far::{self, radius, share};
use super::final_shape::{FinalShape, zero_level_set};
use super::frame::WorkingFrame;
use crate::bsp::Coverage;
use crate::error::Error;
use crate::finish::Finish;
use crate::geometry::vec3::length;
use crate::geometry::{
    Bounds, CellSizes, KdTree, Normalizer, Position, TriangleMesh, WORKING_CUBE, extract_graded_mesh,
};
use crate::io::GridValues;
use rayon::prelude::*;

/// A signed distance field, the parameterized surface S and the input points that both come from.
///
/// All coordinates and distances are in the frame and units of the input points. Meshes, S and the input points have 64
/// bits, distances and gradients the type of the places where they are evaluated; points far from the origin, such as
/// those of maps, lose nothing, since the working frame is centred on the input points. [`offset`](Self::offset) gives
/// what to subtract from coordinates that are to be stored in 32 bits.
#[derive(Clone, Debug)]
pub struct Reconstruction {
    pub(super) config: Config,
    pub(super) frame: WorkingFrame,
    /// The input points, distinct and sorted, n x 3, input frame.
    pub(super) input: Vec<[f64; 3]>,
    pub(super) shape: FinalShape,
    /// The corrections to the shape, if [`Config::finish`] asks for it and the points allow it.
    pub(super) finish: Option<Finish>,
    /// S, working frame.
    pub(super) surface: Vec<[f32; 3]>,
    pub(super) coverage: Option<Coverage>,
    /// Whether the signs of `shape` and `finish` are flipped for the result, because the points were seen from inside.
    pub(super) turned: bool,
    pub(super) notices: Vec<String>,
}

/// The cells of a graded mesh between neighbouring points.
const CELLS_BETWEEN: f64 = 2.0;

/// How far a grid of distances reaches beyond the input points, as a share of their longest side.
const BEYOND: f64 = 0.08;

/// The step of central differences of the corrected distance, working frame.
const DIFFERENCE: f32 = 1e-3;

impl Reconstruction {
    /// Signed distances in the working frame, finished.
    fn working_sdf(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let Some(finish) = &self.finish else { return self.shape.sdf(points) };
        let (mut sdf, gradient) = self.shape.sdf_and_gradient(points);
        finish.apply(points, &mut sdf, &gradient);
        sdf
    }

    /// Signed distances at `points` (n x 3), negative inside, in the input's unit and of the points' width.
    ///
    /// Accurate near the surface. Farther from the middle of the input points than about their longest side, it gives
    /// way to the distance to the nearest of them, which is finite for every finite place and grows along every ray
    /// from the middle.
    /// NaN at a place that is NaN, as is the gradient there.
    pub fn sdf<P: Position>(&self, points: &[P]) -> Vec<P::Scalar> {
        let places: Vec<[f64; 3]> = points.iter().map(|&p| self.frame.forward_wide(p)).collect();
        self.distances(&places).into_iter().map(P::scalar).collect()
    }

    /// Signed distances at places of the working frame, in the input's unit.
    fn distances(&self, places: &[[f64; 3]]) -> Vec<f64> {
        let values = self.wide_sdf(places);
        if self.frame.is_plain() {
            let scale = self.frame.scale();
            return values.into_iter().map(|s| s * scale).collect();
        }
        let gradients = self.wide_gradient(places);
        values.into_iter().zip(gradients).map(|(s, gradient)| self.frame.distance(s, gradient)).collect()
    }

    /// Signed distances at places of the working frame, near and far.
    fn wide_sdf(&self, places: &[[f64; 3]]) -> Vec<f64> {
        let shares: Vec<f64> = places.iter().map(|x| share(radius(x))).collect();
        let near = |&i: &usize| shares[i] < 1.0;
        let rows: Vec<usize> = (0..places.len()).filter(near).collect();
        let inside: Vec<[f32; 3]> = rows.iter().map(|&i| places[i].map(|x| x as f32)).collect();
        // A place that is not a number is neither near nor far.
        let mut values = vec![f64::NAN; places.len()];
        for (&i, value) in rows.iter().zip(self.working_sdf(&inside)) {
            values[i] = f64::from(value);
        }
        if shares.iter().any(|&s| s > 0.0) {
            let points = self.frame.forward(&self.input);
            let tree = KdTree::new(&points);
            values.par_iter_mut().zip(places).zip(&shares).filter(|(_, s)| **s > 0.0).for_each(
                |((value, x), share)| {
                    let (distance, _) = far::distance(&tree, &points, *x);
                    // Written so that an infinite distance stays one.
                    *value = if *share < 1.0 { *value + share * (distance - *value) } else { distance };
                },
            );
        }
        if self.turned {
            values.iter_mut().for_each(|value| *value = -*value);
        }
        values
    }

    /// Whether the points were seen from within, as those of a room: then the distance is positive inside of the mesh
    /// and negative around it, and faces run counter-clockwise seen from within. So it is if given normals
    /// ([`Hints`](super::Hints)) point into the closed surface.
    pub fn is_turned(&self) -> bool {
        self.turned
    }

    /// The gradients of [`sdf`](Self::sdf) at `points` (n x 3): outward, of about unit length, without unit. Where the
    /// result is finished ([`Config::finish`]) they are differences over 2e-3 of the longest side, and so they are
    /// where the field gives way to the distance to the points.
    pub fn gradient<P: Position>(&self, points: &[P]) -> Vec<P> {
        let places: Vec<[f64; 3]> = points.iter().map(|&p| self.frame.forward_wide(p)).collect();
        let mut gradients = self.wide_gradient(&places);
        // Distance and place are scaled alike, so the slope is that of the working frame, unless axes were stretched.
        if !self.frame.is_plain() {
            gradients.iter_mut().for_each(|g| {
                let slope = self.frame.slope(*g);
                let len = length(slope).max(f64::MIN_POSITIVE);
                *g = slope.map(|x| x / len);
            });
        }
        gradients.into_iter().map(P::of_wide).collect()
    }

    /// The gradients of [`wide_sdf`](Self::wide_sdf).
    fn wide_gradient(&self, places: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let shares: Vec<f64> = places.iter().map(|x| share(radius(x))).collect();
        let mut gradients = vec![[f64::NAN; 3]; places.len()];
        let sign = if self.turned { -1.0 } else { 1.0 };
        let exact = |share: f64| share == 0.0 && self.finish.is_none();
        let rows = |wanted: &dyn Fn(f64) -> bool| -> Vec<usize> {
            (0..places.len()).filter(|&i| wanted(shares[i])).collect()
        };
        let near = rows(&exact);
        let inside: Vec<[f32; 3]> = near.iter().map(|&i| places[i].map(|x| x as f32)).collect();
        for (&i, gradient) in near.iter().zip(self.shape.gradient(&inside)) {
            gradients[i] = gradient.map(|x| sign * f64::from(x));
        }
        let between = rows(&|share| !exact(share) && share < 1.0);
        if !between.is_empty() {
            // Steps in 32 bits, as the field sees them.
            let beside = |axis: usize, step: f32| {
                let moved = |&i: &usize| {
                    let mut p = places[i].map(|x| x as f32);
                    p[axis] += step;
                    p.map(f64::from)
                };
                self.wide_sdf(&between.iter().map(moved).collect::<Vec<_>>())
            };
            let sides = [0, 1, 2].map(|axis| (beside(axis, DIFFERENCE), beside(axis, -DIFFERENCE)));
            for (row, &i) in between.iter().enumerate() {
                let slope = |axis: usize| {
                    (sides[axis].0[row] as f32 - sides[axis].1[row] as f32) / (2.0 * DIFFERENCE)
                };
                gradients[i] = [0, 1, 2].map(|axis| f64::from(slope(axis)));
            }
        }
        let beyond = rows(&|share| share == 1.0);
        if !beyond.is_empty() {
            let points = self.frame.forward(&self.input);
            let tree = KdTree::new(&points);
            for i in beyond {
                gradients[i] = far::distance(&tree, &points, places[i]).1.map(|x| sign * x);
            }
        }
        gradients
    }

    /// The zero level set as a closed mesh, from a grid of `resolution` cubes along each side of the cube around the
    /// input points. Parts below the share `min_component` of the largest part's area are left out.
    ///
    /// # Errors
    /// [`NoSurface`](crate::ErrorKind::NoSurface) if the field is nowhere negative on the grid,
    /// [`Config`](crate::ErrorKind::Config) for a resolution below 3 or beyond 32-bit vertex numbers,
    /// [`Diverged`](crate::ErrorKind::Diverged) if the field is not finite.
    pub fn mesh(&self, resolution: usize) -> Result<TriangleMesh<[f64; 3]>, Error> {
        let seeds = self.frame.forward(&self.input);
        let sdf = |x: &[[f32; 3]]| self.working_sdf(x);
        let mesh = zero_level_set(&sdf, &seeds, resolution, self.config.min_component)?;
        Ok(self.placed(mesh))
    }

    /// A mesh of the working frame in the input's.
    fn placed(&self, mesh: TriangleMesh) -> TriangleMesh<[f64; 3]> {
        let mut faces = mesh.faces;
        if self.turned {
            faces.iter_mut().for_each(|face| face.swap(1, 2));
        }
        TriangleMesh { verts: self.frame.place(&mesh.verts), faces }
    }

    /// The zero level set as a closed mesh, from cells that are everywhere about half as large as the points lie apart
    /// there: for many input points, and those that are dense in one place and sparse in another. Parts are left out as
    /// from [`mesh`](Self::mesh).
    ///
    /// # Errors
    /// [`NoSurface`](crate::ErrorKind::NoSurface) if the field is nowhere negative on the grid,
    /// [`Diverged`](crate::ErrorKind::Diverged) if it is not finite, [`Config`](crate::ErrorKind::Config) if there are
    /// too many points for it.
    pub fn graded_mesh(&self) -> Result<TriangleMesh<[f64; 3]>, Error> {
        let sizes = CellSizes::of_surface(&self.frame.forward(&self.input), CELLS_BETWEEN);
        let [low, side] = WORKING_CUBE;
        let mesh = extract_graded_mesh([low; 3], side, &sizes, &mut |x| Ok(self.working_sdf(x)))?;
        Ok(self.placed(mesh.keep_large(self.config.min_component)))
    }

    /// What to subtract from coordinates of this result so that 32 bits hold their detail: 0 for input points near
    /// the origin, else round numbers near its middle, see [`Bounds::offset`].
    pub fn offset(&self) -> [f64; 3] {
        Bounds::of(&self.input).map_or([0.0; 3], |bounds| bounds.offset())
    }

    /// Signed distances on a grid around the input points, `cubes` along its longest side and as many as needed along
    /// the others, which reaches beyond the points by 0.08 of their longest side everywhere.
    ///
    /// # Panics
    /// If there are no cubes.
    #[track_caller]
    pub fn grid(&self, cubes: usize) -> GridValues {
        assert!(cubes > 0, "grid: no cubes");
        // The cubes are those of the input's frame, also where that was stretched for the work. The input points are
        // not empty, finite and of some extent, so they have a frame and bounds.
        let outer = Normalizer::of(&self.input).unwrap_or(Normalizer::identity());
        let size = Bounds::of(&outer.forward(&self.input)).map_or([1.0; 3], |bounds| bounds.size());
        let spacing = (1.0 + 2.0 * BEYOND) / cubes as f64;
        let size = size.map(|side| ((side + 2.0 * BEYOND) / spacing - 1e-6).ceil() as usize + 1);
        let low = size.map(|n| -0.5 * spacing * (n - 1) as f64);
        let mut values = Vec::with_capacity(size.iter().product());
        // A slice at a time, as places take more memory than values.
        for k in 0..size[2] {
            let at = |a: usize, i: usize| low[a] + spacing * i as f64;
            let inner = |x: [f64; 3]| match self.frame.is_plain() {
                true => x,
                false => self.frame.forward_wide(outer.inverse_wide(x)),
            };
            let row = |j: usize| (0..size[0]).map(move |i| [at(0, i), at(1, j), at(2, k)]);
            let slice: Vec<[f64; 3]> = (0..size[1]).flat_map(row).map(inner).collect();
            values.extend(self.distances(&slice).into_iter().map(|s| s as f32));
        }
        GridValues { origin: outer.inverse_wide(low), spacing: spacing * outer.scale(), size, values }
    }

    /// The parameterized surface S, i x 3: the patches of all denoised points, mapped to space; empty without a
    /// parameterization, or where nothing was trained ([`Config::train_up_to`]).
    pub fn surface_points(&self) -> Vec<[f64; 3]> {
        self.frame.place(&self.surface)
    }

    /// How well S covers the denoised points Q, and its codes the sphere, in the working frame.
    ///
    /// `None` without a parameterization or a training ([`Config::train_up_to`]), and for a result that was loaded from
    /// a file, which does not hold the parameterization. A checkpoint does: resume it and finish.
    pub fn coverage(&self) -> Option<&Coverage> {
        self.coverage.as_ref()
    }

    /// The input points, n x 3, input frame: those that were given, without duplicates, ordered by their coordinates.
    pub fn input_points(&self) -> &[[f64; 3]] {
        &self.input
    }

    /// What a user should know of the file that it was loaded from, such as options that this version does not have;
    /// empty for one that was just made.
    pub fn notices(&self) -> &[String] {
        &self.notices
    }

    /// The options it was made with, adapted to the number of points.
    pub fn config(&self) -> &Config {
        &self.config
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{ball, quick, run, tiny};
    use super::*;
    use crate::geometry::AnalyticShape;
    use crate::reconstruct::{Finishing, Preset, Trainer};

    #[test]
    fn a_finished_result_is_nearer_to_the_points_and_to_the_ball() {
        let points = ball(120);
        let off = |finish: Finishing| {
            let result = run(&points, &Config { finish, ..quick() });
            let mean =
                |values: &[f32]| values.iter().map(|f| f.abs()).sum::<f32>() / (6.0 * values.len() as f32);
            // Other samples of the ball of radius 3.
            let between: Vec<[f32; 3]> = crate::geometry::AnalyticShape::Sphere { radius: 3.0 }
                .sample(200, 8)
                .0
                .iter()
                .map(|p| [p[0] + 10.0, p[1] - 4.0, p[2]])
                .collect();
            [mean(&result.sdf(&points)), mean(&result.sdf(&between))]
        };
        let (bare, finished) = (off(Finishing::None), off(Finishing::Points));
        assert!(finished[0] < 0.2 * bare[0] && finished[1] < 0.5 * bare[1], "{finished:?} for {bare:?}");
    }

    #[test]
    fn the_gradient_of_a_finished_result_is_that_of_its_distance() {
        let points = ball(80);
        let result = run(&points, &tiny());
        assert!(result.finish.is_some());
        let x: Vec<[f32; 3]> = points.iter().step_by(4).map(|p| [p[0] + 0.1, p[1], p[2] - 0.1]).collect();
        let step = 0.02;
        for (i, gradient) in result.gradient(&x).iter().enumerate() {
            let mut slope = [0.0f32; 3];
            for (k, slope) in slope.iter_mut().enumerate() {
                let beside = |by: f32| {
                    let mut x = x[i];
                    x[k] += by;
                    result.sdf(&[x])[0]
                };
                *slope = (beside(step) - beside(-step)) / (2.0 * step);
            }
            assert!((0..3).all(|k| (slope[k] - gradient[k]).abs() < 0.05), "{slope:?} {gradient:?}");
            let radial = [x[i][0] - 10.0, x[i][1] + 4.0, x[i][2]];
            assert!((0..3).map(|k| radial[k] * gradient[k]).sum::<f32>() > 0.0);
        }
    }

    #[test]
    fn a_graded_mesh_is_as_fine_as_the_points() {
        let torus = AnalyticShape::Torus { major: 0.34, minor: 0.14 };
        let mesh = |n: usize| {
            let result = run(&torus.sample(n, 3).0, &Config::preset(Preset::Start));
            let mesh = result.graded_mesh().unwrap();
            let topology = mesh.topology();
            assert!(topology.closed && topology.genus == Some(1), "{topology}");
            let off = mesh.verts.iter().map(|v| torus.sdf(v.map(|x| x as f32)).abs()).fold(0.0, f32::max);
            assert!(off < 0.03, "{off} of {n} points");
            mesh
        };
        let (few, many) = (mesh(400), mesh(1600));
        let ratio = many.verts.len() as f64 / few.verts.len() as f64;
        assert!((3.0..5.5).contains(&ratio), "{ratio}");
    }

    #[test]
    fn the_grid_has_the_distances_at_its_places() {
        let result = run(&ball(100), &Config::preset(Preset::Start));
        let grid = result.grid(16);
        assert_eq!((grid.size, grid.values.len()), ([17, 17, 17], 17 * 17 * 17));
        let value = |i: [usize; 3]| grid.values[(i[2] * 17 + i[1]) * 17 + i[0]];
        for i in [[0, 0, 0], [8, 8, 8], [16, 3, 5]] {
            let x: [f64; 3] = std::array::from_fn(|a| grid.origin[a] + grid.spacing * i[a] as f64);
            assert!((result.sdf(&[x])[0] - f64::from(value(i))).abs() < 1e-4, "{i:?}");
        }
        assert!(value([8, 8, 8]) < -2.5 && value([0, 8, 8]) > 0.2);
    }

    #[test]
    fn start_gives_the_first_shape_without_a_step() {
        let points = ball(100);
        let config = Config::preset(Preset::Start);
        let trainer = Trainer::new(&points, &config).unwrap();
        assert!(trainer.is_done() && trainer.total_steps() == 0);
        let result = trainer.finish();
        assert!(result.surface_points().is_empty() && result.coverage().is_none());
        let topology = result.mesh(48).unwrap().topology();
        assert!(topology.closed && topology.genus == Some(0), "{topology}");
        let volume = 4.0 / 3.0 * std::f64::consts::PI * 27.0;
        assert!((topology.volume / volume - 1.0).abs() < 0.01, "{topology}");
        assert!((result.sdf(&[[10.0f64, -4.0, 0.0]])[0] + 3.0).abs() < 0.1);
        // A sphere is no shape that was found.
        let sphere = Config::preset(Preset::Paper);
        let error = Config { stages: Vec::new(), ..sphere }.validate().unwrap_err();
        assert_eq!(error.element(), Some("option stages"));
    }
}
