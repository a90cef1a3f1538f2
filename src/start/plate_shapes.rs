//! Candidates for the first shape from the surface of least bending: each with the normals of one rough surface.

use super::candidates::{COARSE, MIN_PART, fine_enough, those_found};
use super::{LeastBending, Ramp};
use crate::error::Error;
use crate::geometry::vec3::dot;
use crate::geometry::{
    CellSizes, NarrowBandOptions, TetGrid, TriangleBvh, TriangleMesh, WORKING_CUBE, extract_graded_mesh,
    extract_mesh, nearest_points, neighbour_spacing,
};
use rayon::prelude::*;

/// Distances to the nearest point, in its neighbour spacing, between which the thin plate hands over to the rough
/// surface.
const TRUST: Ramp = Ramp { from: 0.7, to: 1.2 };
/// The same for many points, where the plate is nearer to the truth beyond the rims of open surfaces, too.
/// Between the few points of thin sheets it is not (`benches/accuracy.md`).
const TRUST_OF_MANY: Ramp = Ramp { from: 1.5, to: 2.5 };
/// The fewest points that count as many.
const MANY_POINTS: usize = 4096;
/// Cubes along each side of the grid that the surface of one thin plate is taken from, if the rough one is not small:
/// blades and legs come out in shreds on a grid that does not depend on the area.
const PLATE_RESOLUTION: usize = 64;
/// Cells between neighbouring points where there are several plates: more bring nothing. A surface bends little from
/// one of many points to the next.
const CELLS_BETWEEN: f64 = 2.4;
/// The same for many points.
const CELLS_BETWEEN_MANY: f64 = 1.5;

/// For each closed surface of `rough`, in order, a surface of least bending through `points` (n x 3, working frame),
/// see [`LeastBending`]; those that cannot be extracted are left out. Far from the points the rough surface is kept, so
/// that sheets which leave the points end. The first guess of the normals is the rough surface's, or `normals` (n x 3)
/// where these are given, not zero and on the same side.
///
/// The surface of one plate is taken from a grid of 64 cubes a side, or a finer one where the rough one has little area
/// for the number of points ([`resolution_for_area`](super::resolution_for_area)); that of several from cells as fine
/// as the points.
///
/// # Errors
/// As [`LeastBending::fit_each`] and [`TriangleBvh::new`]; if no surface can be extracted, as the first of them:
/// [`NoSurface`](crate::ErrorKind::NoSurface) where nothing is enclosed.
///
/// # Panics
/// If there is no rough surface.
#[track_caller]
pub fn plate_shapes(
    points: &[[f32; 3]],
    normals: Option<&[[f32; 3]]>,
    rough: &[TriangleMesh],
) -> Result<Vec<TriangleMesh>, Error> {
    assert!(!rough.is_empty(), "plate_shapes: no rough surface");
    let trees: Vec<TriangleBvh> = rough.iter().map(TriangleBvh::new).collect::<Result<_, _>>()?;
    let guess = |tree: &TriangleBvh| {
        let mut guess = tree.normals_near(points);
        for (own, given) in guess.iter_mut().zip(normals.unwrap_or_default()) {
            if dot(*own, *given) > 0.0 {
                *own = *given;
            }
        }
        guess
    };
    let guesses: Vec<Vec<[f32; 3]>> = trees.iter().map(guess).collect();
    let plates = LeastBending::fit_each(points, &guesses)?;
    let spacing = neighbour_spacing(points);
    let many = points.len() >= MANY_POINTS;
    let trust = if many { TRUST_OF_MANY } else { TRUST };
    let cells_between = if many { CELLS_BETWEEN_MANY } else { CELLS_BETWEEN };
    let surface = |(plate, tree, rough): (&LeastBending, &TriangleBvh, &TriangleMesh)| {
        let mut eval = |x: &[[f32; 3]]| {
            let (nearest, dist_sq) = nearest_points(x, points);
            let mut values = plate.value(x, &nearest);
            values.par_iter_mut().enumerate().for_each(|(i, value)| {
                let far = dist_sq[i].sqrt() / spacing[nearest[i] as usize] as f32;
                let share = trust.rising(far);
                if value.is_nan() {
                    *value = tree.signed_distance(x[i]).0;
                } else if share > 0.0 {
                    *value = (1.0 - share) * *value + share * tree.signed_distance(x[i]).0;
                }
            });
            Ok(values)
        };
        let mesh = match plate {
            LeastBending::Whole(_) => {
                let resolution = fine_enough(PLATE_RESOLUTION, rough.topology().area, points.len());
                let grid = TetGrid::working_frame(resolution)?;
                let options =
                    NarrowBandOptions { coarse_resolution: COARSE, seeds: points, ..Default::default() };
                extract_mesh(&grid, &mut eval, &options)?
            }
            LeastBending::Local(_) => {
                let [low, side] = WORKING_CUBE;
                extract_graded_mesh([low; 3], side, &CellSizes::of_surface(points, cells_between), &mut eval)?
            }
        };
        Ok(mesh.keep_large(MIN_PART))
    };
    those_found((&plates, &trees, rough).into_par_iter().map(surface).collect())
}

#[cfg(test)]
mod tests {
    use super::super::gauss_shapes;
    use super::*;
    use crate::geometry::{AnalyticShape, fibonacci_sphere, sample_surface};

    /// More points come out no worse, on both sides of the limit of one plate and of the Gauss formula's sources, up to
    /// what the grid of 64 cubes is off by itself, which all of up to 1,200 points share.
    #[test]
    fn more_points_make_a_better_shape() {
        let torus = AnalyticShape::Torus { major: 0.34, minor: 0.14 };
        let off = |n: usize| {
            let points = torus.sample(n, 3).0;
            let rough = gauss_shapes(&points, None, &[0.5], 0.05, 0).unwrap();
            let plate = plate_shapes(&points, None, &rough).unwrap().remove(0);
            let samples = sample_surface(&plate, 4000, 1).unwrap().points;
            samples.iter().map(|&x| f64::from(torus.sdf(x).abs())).sum::<f64>() / 4000.0
        };
        let each = [250, 500, 1000, 2000].map(off);
        assert!(each.is_sorted_by(|a, b| *b < 1.1 * a), "{each:?}");
        assert!(each[0] < 1e-3 && each[3] < 0.6 * each[0], "{each:?}");
    }

    /// One half of the torus has four times as many points a square as the other. The genus of the surface between
    /// points counts the false handles; with the same weight for all dipoles there are many of them.
    #[test]
    fn density_that_jumps_makes_no_handles() {
        let all = AnalyticShape::Torus { major: 0.34, minor: 0.14 }.sample(2400, 3).0;
        let kept = (0..all.len()).filter(|&i| all[i][0] > 0.0 || i % 4 == 0);
        let points: Vec<[f32; 3]> = kept.map(|i| all[i]).collect();
        let rough = gauss_shapes(&points, None, &[0.5], 0.05, 0).unwrap();
        let plates = plate_shapes(&points, None, &rough).unwrap();
        let genus = [&rough[0], &plates[0]].map(|mesh| mesh.topology().genus);
        assert_eq!(genus, [Some(1); 2]);
    }

    /// 0.01 thick, half a cube of the usual grids.
    #[test]
    fn a_blade_comes_out_whole() {
        let blade = AnalyticShape::RoundedBox { half: [0.5, 0.05, 0.005], round: 0.002 };
        let points = blade.sample(600, 1).0;
        let rough = gauss_shapes(&points, None, &[0.5], 0.05, 0).unwrap();
        let plates = plate_shapes(&points, None, &rough).unwrap();
        for (mesh, limit) in [(&rough[0], 0.003), (&plates[0], 0.002)] {
            let topology = mesh.topology();
            let off = TriangleBvh::new(mesh).unwrap().nearest_all(&points);
            let mean = off.iter().map(|hit| hit.dist_sq.sqrt()).sum::<f64>() / points.len() as f64;
            assert!(topology.components == 1 && mean < limit, "{} {mean}", topology.components);
        }
    }

    /// A dome without a floor: the plate alone would go on outward for ever.
    #[test]
    fn the_plate_rules_near_the_points_and_the_rough_surface_elsewhere() {
        let dome: Vec<[f32; 3]> =
            fibonacci_sphere(240).into_iter().filter(|p| p[2] > 0.2).map(|p| p.map(|x| 0.45 * x)).collect();
        let rough = gauss_shapes(&dome, None, &[0.5, 1.0], 0.05, 0).unwrap();
        let plates = plate_shapes(&dome, None, &rough).unwrap();
        assert_eq!(plates.len(), 2);
        for (plate, rough) in plates.iter().zip(&rough) {
            let tree = TriangleBvh::new(rough).unwrap();
            let (_, dist_sq) = nearest_points(&plate.verts, &dome);
            let spacing = neighbour_spacing(&dome).into_iter().fold(0.0, f64::max) as f32;
            let (mut near, mut far) = (0, 0);
            for (v, d) in plate.verts.iter().zip(&dist_sq) {
                // The sphere, where the points are; the rough surface, to a cube, where none is.
                let radius = v.iter().map(|x| x * x).sum::<f32>().sqrt();
                if d.sqrt() < 0.4 * spacing && v[2] > 0.15 {
                    near += 1;
                    assert!((radius - 0.45).abs() < 0.01, "{v:?}");
                } else if d.sqrt() > TRUST.to * spacing {
                    far += 1;
                    assert!(tree.nearest(*v).dist_sq.sqrt() < 0.01, "{v:?}");
                }
            }
            assert!(near > 200 && far > 200, "{near} {far}");
        }
    }
}
