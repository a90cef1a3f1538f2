//! Candidates for the first shape: closed surfaces that the Gauss formula finds among the points, and which of several
//! surfaces fits the points best.

use super::{GaussField, USUAL_AREA, resolution_for_area};
use crate::error::{Error, ErrorKind};
use crate::geometry::{
    NarrowBandOptions, TetGrid, TriangleBvh, TriangleMesh, extract_mesh, nearest_points, sample_surface,
};
use rayon::prelude::*;

/// Cubes along each side of the grid that the Gauss formula's surface is taken from, for few points.
const GAUSS_RESOLUTION: usize = 48;
/// The most points that are few.
const FEW_POINTS: usize = 1024;
/// The same cubes for more points: sheets that are thin against the cubes come out in shreds (`benches/accuracy.md`,
/// constants).
const GAUSS_FINE_RESOLUTION: usize = 96;
/// Points for which these grids, and that of one thin plate, are fine enough on a surface of usual area: they lie 2.4
/// of the 64 cubes apart.
const POINTS_SERVED: f64 = 1200.0;
/// Cubes along each side of the lattice on which the search for a surface starts. Parts of the surface that are smaller
/// than such a cube, near no point and joined to no part that is, may be missed, and are not wanted.
pub(crate) const COARSE: usize = 16;
/// Samples of a surface over which its mean distance to the points is taken.
const MISFIT_SAMPLES: usize = 4096;
/// Weight of the distance from the points to the surface, where that from the surface to the points has weight 1;
/// weights of 2 to 8 choose about the same surfaces.
const MISFIT_OF_POINTS: f64 = 4.0;
/// Parts of a first shape below this share of the largest one's area are left out.
pub(super) const MIN_PART: f64 = 0.02;

/// The area of a surface that `n` points cover as densely as the usual grids can serve; on a smaller one they lie
/// closer to each other. For more than 1,200 points the usual area.
fn covered(n: usize) -> f64 {
    USUAL_AREA * (n as f64 / POINTS_SERVED).min(1.0)
}

/// Cubes along each side of the grid for the surface of `n` points: the `usual` ones, or more if it has little area.
pub(super) fn fine_enough(usual: usize, area: f64, n: usize) -> usize {
    resolution_for_area(usual, area, covered(n)).max(usual)
}

/// The surface that the parametric Gauss formula finds among `points` (n x 3, working frame), without its small parts;
/// taken from a grid of 48 cubes a side for up to 1,024 points, of 96 for more, and from a finer one if it has little
/// area for the number of points ([`resolution_for_area`]).
///
/// `radius`, `regularity` and `seed` are those of [`GaussField::fit`]; with `normals` (n x 3) it is the surface of
/// [`GaussField::of_normals`].
///
/// # Errors
/// [`NoSurface`](crate::ErrorKind::NoSurface) if the formula encloses nothing, and as [`GaussField::fit`].
pub fn gauss_shape(
    points: &[[f32; 3]],
    normals: Option<&[[f32; 3]]>,
    radius: f32,
    regularity: f64,
    seed: u64,
) -> Result<TriangleMesh, Error> {
    let gauss = match normals {
        Some(normals) => GaussField::of_normals(points, normals, radius, seed),
        None => GaussField::fit(points, radius, regularity, seed)?,
    };
    let surface = |resolution: usize| -> Result<TriangleMesh, Error> {
        let grid = TetGrid::working_frame(resolution)?;
        let options = NarrowBandOptions { coarse_resolution: COARSE, seeds: points, ..Default::default() };
        Ok(extract_mesh(&grid, &mut |x| Ok(gauss.value(x)), &options)?.keep_large(MIN_PART))
    };
    let usual = if points.len() <= FEW_POINTS { GAUSS_RESOLUTION } else { GAUSS_FINE_RESOLUTION };
    let found = surface(usual);
    let area = match &found {
        Ok(mesh) => mesh.topology().area,
        // What has no inside on the usual grid may be too thin for it.
        Err(e) if e.kind() == ErrorKind::NoSurface => 0.0,
        Err(_) => return found,
    };
    let resolution = fine_enough(usual, area, points.len());
    let found = if resolution == usual { found } else { surface(resolution).or(found) };
    found.map_err(|e| {
        if e.kind() != ErrorKind::NoSurface {
            return e;
        }
        Error::new(e.kind(), "the first guess of inside and outside encloses nothing")
            .caused_by(e)
            .advise("start from a sphere (start.shape = sphere)")
    })
}

/// The shapes that [`gauss_shape`] finds among `points` (n x 3, working frame) with several `radii` of the
/// dipoles (in neighbour spacings of the points), in their order, without those that it fails for.
///
/// No radius suits all points. A small one keeps sheets apart that lie close together, a large one closes what sparse
/// points leave open.
///
/// # Errors
/// As [`gauss_shape`], if that fails for every radius.
///
/// # Panics
/// If there is no radius.
#[track_caller]
pub fn gauss_shapes(
    points: &[[f32; 3]],
    normals: Option<&[[f32; 3]]>,
    radii: &[f32],
    regularity: f64,
    seed: u64,
) -> Result<Vec<TriangleMesh>, Error> {
    assert!(!radii.is_empty(), "gauss_shapes: no radius");
    let attempt = |&radius: &f32| gauss_shape(points, normals, radius, regularity, seed);
    those_found(radii.par_iter().map(attempt).collect())
}

/// The shapes among the attempts; if all attempts failed, the error of the first.
pub(super) fn those_found(
    mut attempts: Vec<Result<TriangleMesh, Error>>,
) -> Result<Vec<TriangleMesh>, Error> {
    match attempts.iter().all(Result::is_err) {
        true => Err(attempts.swap_remove(0).expect_err("all are errors")),
        false => Ok(attempts.into_iter().flatten().collect()),
    }
}

/// Which of several shapes has the least sum of four times the mean distance from `points` (n x 3, in the shapes'
/// frame) to it and the mean distance from samples of it, drawn with `seed`, to the points; the first of several as
/// good.
///
/// # Errors
/// As [`TriangleBvh::new`] and [`sample_surface`] for an empty shape.
///
/// # Panics
/// If there is no shape or no point.
#[track_caller]
pub fn best_fitting(shapes: &[TriangleMesh], points: &[[f32; 3]], seed: u64) -> Result<usize, Error> {
    assert!(
        !shapes.is_empty() && !points.is_empty(),
        "best_fitting: {} shapes, {} points",
        shapes.len(),
        points.len()
    );
    if shapes.len() == 1 {
        return Ok(0);
    }
    let misfits: Vec<Result<f64, Error>> =
        shapes.par_iter().map(|shape| misfit(shape, points, seed)).collect();
    let misfits: Vec<f64> = misfits.into_iter().collect::<Result<_, _>>()?;
    let best = (0..shapes.len()).min_by(|&a, &b| misfits[a].total_cmp(&misfits[b]));
    Ok(best.expect("there is a shape"))
}

/// How badly a surface fits the points: weighted mean distances both ways.
fn misfit(mesh: &TriangleMesh, points: &[[f32; 3]], seed: u64) -> Result<f64, Error> {
    let mean =
        |dist_sq: &mut dyn Iterator<Item = f64>, n: usize| dist_sq.map(f64::sqrt).sum::<f64>() / n as f64;
    let hits = TriangleBvh::new(mesh)?.nearest_all(points);
    let surface = sample_surface(mesh, MISFIT_SAMPLES, seed)?.points;
    let (_, dist_sq) = nearest_points(&surface, points);
    let to_surface = mean(&mut hits.iter().map(|hit| hit.dist_sq), points.len());
    let to_points = mean(&mut dist_sq.iter().map(|&d| f64::from(d)), MISFIT_SAMPLES);
    Ok(MISFIT_OF_POINTS * to_surface + to_points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::AnalyticShape;

    #[test]
    fn the_best_shape_is_the_one_that_fits_the_points() {
        // Two plates close to each other: the wide dipoles melt them into one body.
        let plate = |z: f32| {
            let grid = (0..100).map(move |i| ((i % 10) as f32, (i / 10) as f32));
            grid.map(move |(x, y)| [0.1 * x - 0.45 + 0.01 * y, 0.1 * y - 0.45 + 0.013 * x, z])
        };
        let points: Vec<[f32; 3]> = plate(-0.1).chain(plate(0.1)).collect();
        let widths = [4.0, 0.5, 2.0];
        let each = gauss_shapes(&points, None, &widths, 0.01, 0).unwrap();
        assert!(each[1] == gauss_shape(&points, None, 0.5, 0.01, 0).unwrap());
        let best = best_fitting(&each, &points, 0).unwrap();
        let misfits = [0, 1, 2].map(|i| misfit(&each[i], &points, 0).unwrap());
        let least = (0..3).min_by(|&a, &b| misfits[a].total_cmp(&misfits[b])).unwrap();
        assert!(misfits[least] < 0.9 * misfits[0], "{misfits:?}");
        assert_eq!(best, least);
        assert_eq!(best_fitting(&each[2..], &points, 0).unwrap(), 0);
    }

    /// By the definition: every point against every triangle, every sample against every point.
    #[test]
    fn the_misfit_is_four_times_one_mean_distance_and_once_the_other() {
        let mesh =
            gauss_shape(&AnalyticShape::Sphere { radius: 0.4 }.sample(60, 1).0, None, 0.5, 0.05, 0).unwrap();
        let points = AnalyticShape::RoundedBox { half: [0.45, 0.3, 0.3], round: 0.05 }.sample(40, 2).0;
        let apart =
            |a: [f32; 3], b: [f32; 3]| (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
        let least = |each: &mut dyn Iterator<Item = f64>| each.fold(f64::INFINITY, f64::min);
        let to_surface = |p: &[f32; 3]| {
            let one = |face: &[u32; 3]| {
                let alone = TriangleMesh {
                    verts: face.iter().map(|&v| mesh.verts[v as usize]).collect(),
                    faces: vec![[0, 1, 2]],
                };
                TriangleBvh::new(&alone).unwrap().nearest(*p).dist_sq.sqrt()
            };
            least(&mut mesh.faces.iter().map(one))
        };
        let samples = sample_surface(&mesh, MISFIT_SAMPLES, 5).unwrap().points;
        let to_points = |s: &[f32; 3]| least(&mut points.iter().map(|p| apart(*s, *p)));
        let there = points.iter().map(to_surface).sum::<f64>() / points.len() as f64;
        let back = samples.iter().map(to_points).sum::<f64>() / samples.len() as f64;
        let (got, want) = (misfit(&mesh, &points, 5).unwrap(), 4.0 * there + back);
        assert!((got - want).abs() < 1e-5 * want, "{got} is not {want}");
    }

    #[test]
    fn grids_are_finer_only_where_points_are_dense() {
        let at = |n: usize, area: f64| fine_enough(64, area, n);
        // 300 points of most shapes keep the usual grid, those of a blade do not; nor do more points of a small shape.
        assert_eq!([at(300, 2.2), at(300, 0.56), at(1200, 2.2), at(5000, 2.2)], [64; 4]);
        assert!(at(300, 0.12) > 64 && at(1200, 0.56) > 64);
    }

    #[test]
    fn what_fails_is_left_out_unless_all_fail() {
        let mesh = |z: f32| TriangleMesh { verts: vec![[0.0, 0.0, z]], faces: vec![] };
        let error = |text: &'static str| Error::new(ErrorKind::NoSurface, text);
        let found = those_found(vec![Err(error("a")), Ok(mesh(1.0)), Err(error("b")), Ok(mesh(2.0))]);
        assert!(found.unwrap() == [mesh(1.0), mesh(2.0)]);
        let none = those_found(vec![Err(error("first")), Err(error("second"))]).unwrap_err();
        assert!(none.to_string().contains("first"), "{none}");
    }
}
