//! What kind of sampling points are: of a surface, of curves, of a volume, of parts far apart.

use super::uneven::{AnisotropicSpacing, uneven};
use crate::geometry::{KdTree, Normalizer, Position, PrincipalAxes, median};
use nalgebra::Vector3;

/// The fewest points that are judged.
const MIN_POINTS: usize = 20;
/// The usual distance of neighbours is the median, over the points, of the mean distance to this many nearest points.
const REACHED: usize = 4;

/// Signs that input points are something else than a sampling of one surface; see [`Sampling::of`].
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Sampling {
    /// Most neighbourhoods extend alike in all directions: the points fill a volume.
    pub fills_volume: bool,
    /// Most neighbourhoods extend in one direction only: the points lie on curves.
    pub on_curves: bool,
    /// The sizes of the parts that lie apart by more than six times the usual distance of neighbours, those of at least
    /// a twentieth of the points, largest first.
    pub parts: Vec<usize>,
    /// If the points lie in slices across an axis, or on lines along one, that are more than five times as far apart as
    /// the points on them.
    pub uneven: Option<AnisotropicSpacing>,
}

/// Neighbours that make a small neighbourhood, by which curves are recognised.
const FEW_SHAPED: usize = 6;
/// Neighbours that make a large neighbourhood, by which curves and volumes are recognised.
const MORE_SHAPED: usize = 12;
/// On curves the median ratio of the second to the first extent of small neighbourhoods is below this.
const MAX_FEW_CURVE_EXTENT: f64 = 0.2;
/// The same of large ones, as curves bend.
const MAX_MORE_CURVE_EXTENT: f64 = 0.4;
/// In a volume the median ratio of the third to the first extent of large neighbourhoods is above this. Thin parts of
/// shapes come near it (`benches/accuracy.md`, constants).
const MIN_VOLUME_EXTENT: f64 = 0.5;
/// The fewest points for which curves and volumes are distinguished from surfaces; fewer look like any of them.
const MIN_POINTS_OF_A_KIND: usize = 100;
/// Parts lie apart by more than this many times the usual distance of neighbours.
const APART: f64 = 6.0;
/// The least share of the points that makes a part.
const MIN_PART_SHARE: f64 = 0.05;

impl Sampling {
    /// Looks at the neighbourhoods of points (n x 3, distinct, any frame); for fewer than 20 the result is the default.
    pub fn of<P: Position>(points: &[P]) -> Sampling {
        let n = points.len();
        let Ok(frame) = Normalizer::of(points) else { return Sampling::default() };
        if n < MIN_POINTS {
            return Sampling::default();
        }
        let unit = frame.forward(points);
        let k = (MORE_SHAPED + 1).min(n);
        let tree = KdTree::new(&unit);
        let near = tree.k_nearest(&unit, k);
        let at = |&i: &u32| Vector3::from(unit[i as usize].map(f64::from));
        let extents = |count: usize| -> Vec<[f64; 3]> {
            let of =
                |row: &[u32]| PrincipalAxes::of_points(row[..(count + 1).min(k)].iter().map(at)).1.extents();
            near.chunks_exact(k).map(of).collect()
        };
        let share = |extents: &[[f64; 3]], axis: usize| {
            median(extents.iter().map(|e| e[axis] / e[0].max(f64::MIN_POSITIVE)).collect())
        };
        let (few, more) = (extents(FEW_SHAPED), extents(MORE_SHAPED));
        let reach = median(
            near.chunks_exact(k)
                .map(|row| {
                    let own = at(&row[0]);
                    row[1..=REACHED].iter().map(|j| (at(j) - own).norm()).sum::<f64>() / REACHED as f64
                })
                .collect(),
        );
        Sampling {
            fills_volume: n >= MIN_POINTS_OF_A_KIND && share(&more, 2) > MIN_VOLUME_EXTENT,
            on_curves: n >= MIN_POINTS_OF_A_KIND
                && share(&few, 1) < MAX_FEW_CURVE_EXTENT
                && share(&more, 1) < MAX_MORE_CURVE_EXTENT,
            uneven: uneven(&unit, &near, k),
            parts: parts(&tree, &unit, (APART * reach) as f32),
        }
    }
}

/// The sizes of the large parts that lie apart by more than a distance, largest first.
fn parts(tree: &KdTree, unit: &[[f32; 3]], apart: f32) -> Vec<usize> {
    let mut part = vec![usize::MAX; unit.len()];
    let mut sizes = Vec::new();
    for first in 0..unit.len() {
        if part[first] != usize::MAX {
            continue;
        }
        part[first] = sizes.len();
        let (mut open, mut size) = (vec![first], 0);
        while let Some(i) = open.pop() {
            size += 1;
            for (j, _) in tree.within(unit[i], apart) {
                if part[j as usize] == usize::MAX {
                    part[j as usize] = sizes.len();
                    open.push(j as usize);
                }
            }
        }
        sizes.push(size);
    }
    sizes.retain(|&size| size as f64 >= MIN_PART_SHARE * unit.len() as f64);
    sizes.sort_unstable_by(|a, b| b.cmp(a));
    sizes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::AnalyticShape;
    use std::f32::consts::TAU;

    #[test]
    fn surfaces_curves_volumes_and_parts_are_told_apart() {
        for (name, shape) in AnalyticShape::gallery() {
            for n in [20, 150, 1000] {
                let seen = Sampling::of(&shape.sample(n, 1).0);
                assert!(!seen.fills_volume && !seen.on_curves, "{name} {n}: {seen:?}");
                assert_eq!(seen.uneven, None, "{name} {n}");
            }
        }
        // Rings of a tube.
        let ring = |i: usize| {
            let a = TAU * (i % 100) as f32 / 100.0;
            [a.cos(), a.sin(), 0.7 * (i / 100) as f32]
        };
        let rings: Vec<[f32; 3]> = (0..500).map(ring).collect();
        let seen = Sampling::of(&rings);
        assert!(seen.on_curves && !seen.fills_volume && seen.parts == [100; 5], "{seen:?}");
        assert!(seen.uneven.is_some());
        // A ball filled in a spiral whose steps have no period.
        let inside = |i: usize| {
            let (a, b, r) = (2.4 * i as f32, (1.3 * i as f32).sin(), ((i % 83) as f32 / 83.0).cbrt());
            let flat = (1.0 - b * b).sqrt();
            [r * flat * a.cos(), r * flat * a.sin(), r * b]
        };
        let seen = Sampling::of(&(0..900).map(inside).collect::<Vec<_>>());
        assert!(seen.fills_volume && !seen.on_curves && seen.parts.len() == 1, "{seen:?}");
        assert_eq!(Sampling::of(&rings[..19]), Sampling::default());
    }
}
