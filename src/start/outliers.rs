//! Strays: input points that belong to no surface, far from all others and far off the plane of their neighbours.

use crate::geometry::{KdTree, Normalizer, Position, PrincipalAxes, median, ranked};
use nalgebra::Vector3;

/// A point's *reach* is the mean distance to this many of its nearest points.
const REACHED: usize = 4;
/// Neighbours from which the usual reach around a point, and the plane of the surface there, are estimated.
const AROUND: usize = 8;
/// Which of the sorted reaches of the neighbours counts as usual around a point (0 is the least): a low one, as some of
/// the neighbours may be strays themselves.
const USUAL_RANK: usize = 2;

/// From where on a point is a stray. Both must hold: the ends of thin parts reach as far, but along them.
#[derive(Clone, Copy, Debug)]
struct Limits {
    /// How far a stray reaches to its neighbours, over the usual reach of all points and of those around it.
    farther: f64,
    /// The distance of a stray from the plane of its neighbours, over the usual reach.
    off_plane: f64,
}

/// For [`Suspicion::Low`].
const STRAY: Limits = Limits { farther: 2.6, off_plane: 2.5 };
/// For [`Suspicion::High`], with less care for the surface.
const LIKELY: Limits = Limits { farther: 2.0, off_plane: 2.0 };
/// A point is *odd* if its reach is at least this many times the median.
const ODD_FACTOR: f64 = 2.0;
/// Up to this many odd points among the nearest of another may be strays and are left out of the plane; if there are
/// more, they are a sparse part of the surface and stay in.
const MAX_ODD: usize = 2;
/// Nearest points among which those of the plane are chosen: [`AROUND`], and some more in place of odd ones.
const PLANE_NEIGHBOURS: usize = 12;
/// A point whose reach is this many times the usual one is a stray wherever it lies.
const MIN_LOST_FACTOR: f64 = 10.0;
/// The largest share of strays: points with more are not taken for a surface with strays.
const MAX_SHARE: f64 = 0.1;
/// The fewest points that are judged.
const MIN_POINTS: usize = 20;
/// The most searches, each without the strays of those before: one far away hides nearer ones.
const MAX_ROUNDS: usize = 8;

/// How readily a point is taken for a stray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Suspicion {
    /// Only where hardly a point of a surface would be.
    #[default]
    Low,
    /// Also where now and then an end of a thin part, or a point in a sparse part of the surface, is one.
    High,
}

/// The numbers of the points (n x 3, distinct, any frame) that belong to no surface, ascending; none for fewer than 20
/// points, nor if they would be more than a tenth of all.
///
/// A stray is a point whose mean distance to its 4 nearest points is a multiple of what is usual both for all points
/// and around it, and that lies as far off the plane of its 8 nearest points; or one farther away than any part would
/// be. A stray near the surface is none, as it does little harm.
///
/// ```
/// use bijective_sdf::start::{Suspicion, find_outliers};
/// use bijective_sdf::geometry::AnalyticShape;
///
/// let mut points = AnalyticShape::Sphere { radius: 1.0 }.sample(200, 1).0;
/// points.insert(50, [1.5, 1.5, 0.5]);
/// assert_eq!(find_outliers(&points, Suspicion::Low), [50]);
/// ```
pub fn find_outliers<P: Position>(points: &[P], suspicion: Suspicion) -> Vec<u32> {
    let n = points.len();
    let mut kept: Vec<u32> = (0..n as u32).collect();
    for _ in 0..MAX_ROUNDS {
        if kept.len() < MIN_POINTS {
            break;
        }
        let rest: Vec<P> = kept.iter().map(|&i| points[i as usize]).collect();
        let stray = strays(&rest, suspicion);
        if !stray.contains(&true) {
            break;
        }
        let mut stray = stray.into_iter();
        kept.retain(|_| !stray.next().unwrap_or(false));
    }
    if n - kept.len() > (MAX_SHARE * n as f64) as usize {
        return Vec::new();
    }
    let mut kept = kept.into_iter().peekable();
    (0..n as u32).filter(|i| kept.next_if_eq(i).is_none()).collect()
}

/// Which points are strays among these.
fn strays<P: Position>(points: &[P], suspicion: Suspicion) -> Vec<bool> {
    let none = || vec![false; points.len()];
    let Ok(frame) = Normalizer::of(points) else { return none() };
    let unit = frame.forward(points);
    let k = (PLANE_NEIGHBOURS + 1).min(unit.len());
    let near = KdTree::new(&unit).k_nearest(&unit, k);
    // A point itself is among its nearest, first but for others at the same place.
    let all = |i: usize| near[i * k..(i + 1) * k].iter().filter(move |&&j| j as usize != i);
    let others = |i: usize| all(i).take(AROUND);
    let at = |i: usize| Vector3::from(unit[i].map(f64::from));
    let reach_of = |i: usize| {
        others(i).take(REACHED).map(|&j| (at(j as usize) - at(i)).norm()).sum::<f64>() / REACHED as f64
    };
    let reach: Vec<f64> = (0..unit.len()).map(reach_of).collect();
    let median = median(reach.clone());
    if median <= 0.0 {
        return none();
    }
    let limits = match suspicion {
        Suspicion::Low => STRAY,
        Suspicion::High => LIKELY,
    };
    let is_stray = |i: usize| {
        if reach[i] < limits.farther * median {
            return false;
        }
        let mut around: Vec<f64> = others(i).map(|&j| reach[j as usize]).collect();
        let usual = ranked(&mut around, USUAL_RANK).max(median);
        let farther = reach[i] / usual;
        if farther >= MIN_LOST_FACTOR || farther < limits.farther {
            return farther >= MIN_LOST_FACTOR;
        }
        let odd = |j: u32| reach[j as usize] >= ODD_FACTOR * median;
        let few = (1..=MAX_ODD).contains(&others(i).filter(|&&j| odd(j)).count());
        let plane = all(i).filter(|&&j| !(few && odd(j))).take(AROUND);
        off_plane(at(i), plane.map(|&j| at(j as usize))) >= limits.off_plane * usual
    };
    (0..unit.len()).map(is_stray).collect()
}

/// How far a point is off the plane through others that fits these best.
fn off_plane(x: Vector3<f64>, others: impl Iterator<Item = Vector3<f64>> + Clone) -> f64 {
    let (mean, axes) = PrincipalAxes::of_points(others);
    axes.normal().dot(&(x - mean)).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::AnalyticShape;

    const TORUS: AnalyticShape = AnalyticShape::Torus { major: 1.0, minor: 0.4 };

    fn with(points: &[[f32; 3]], strays: &[[f32; 3]]) -> Vec<[f32; 3]> {
        [points, strays].concat()
    }

    #[test]
    fn strays_are_found_whatever_hides_them() {
        let points = TORUS.sample(300, 1).0;
        let strays = [
            [0.72, 0.51, -1.0],
            [1.47, -1.84, 2.05],
            [0.0, 0.0, 0.9],
            [0.1, 0.0, -1.3],
            [2.2, 0.0, 0.1],
            [2.3, 0.4, 0.0],
            [-1.5, 1.5, 1.5],
            [-2.0, -2.0, 0.0],
            [0.0, 2.4, -0.3],
            [-1.2, 0.3, 1.2],
        ];
        let numbers: Vec<u32> = (300..310).collect();
        assert_eq!(find_outliers(&with(&points, &strays[..2]), Suspicion::Low), numbers[..2]);
        assert_eq!(find_outliers(&with(&points, &strays), Suspicion::Low), numbers);
        // One so far away that the extent of the others is negligible against its distance.
        let mut far = with(&points, &strays[..2]);
        far.insert(0, [1e6, 1e6, 0.0]);
        assert_eq!(find_outliers(&far, Suspicion::Low), [0, 301, 302]);
        // In large coordinates as at the origin.
        let moved: Vec<[f64; 3]> = with(&points, &strays)
            .iter()
            .map(|p| [f64::from(p[0]) + 450_123.4, f64::from(p[1]) + 5e6, f64::from(p[2])])
            .collect();
        assert_eq!(find_outliers(&moved, Suspicion::Low), numbers);
    }

    #[test]
    fn points_of_surfaces_are_none() {
        for (name, shape) in AnalyticShape::gallery() {
            for seed in 0..6 {
                for n in [60, 300, 1000] {
                    let found = find_outliers(&shape.sample(n, seed).0, Suspicion::Low);
                    assert!(found.is_empty(), "{name}, {n} points, seed {seed}: {found:?}");
                }
            }
        }
    }

    #[test]
    fn few_points_and_many_strays_are_left_alone() {
        let points = TORUS.sample(300, 1).0;
        // So far apart that each is a stray to the rest, and too many for that.
        let far = |i: usize| -> [f32; 3] {
            let (size, side) = (10f32.powi(2 + i as i32 / 6), [1.0, -1.0][i % 2]);
            let mut p = [0.0; 3];
            p[i / 2 % 3] = side * size;
            p
        };
        let few: Vec<[f32; 3]> = (0..6).map(far).collect();
        assert_eq!(find_outliers(&with(&points[..60], &few), Suspicion::Low), [60, 61, 62, 63, 64, 65]);
        assert!(find_outliers(&with(&points[..50], &few), Suspicion::Low).is_empty());
        assert!(find_outliers(&points[..19], Suspicion::High).is_empty());
        assert!(find_outliers(&[[0.0f32; 3]; 0], Suspicion::High).is_empty());
        assert!(find_outliers(&[[1.0f32; 3]; 40], Suspicion::High).is_empty());
    }
}
