//! What kind of sampling points are: of a surface, of curves, of a volume, of parts far apart.

use crate::geometry::vec3::{dot, sub};
use crate::geometry::{KdTree, Normalizer, Position, PrincipalAxes, median};
use nalgebra::Vector3;

/// The fewest points that are judged.
const MIN_POINTS: usize = 20;
/// The usual distance of neighbours is the median, over the points, of the mean distance to so many nearest points.
const REACHED: usize = 4;

/// What points are beside a sampling of one surface; see [`Sampling::of`].
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
    pub uneven: Option<Uneven>,
}

/// How unevenly points lie; see [`Sampling::uneven`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uneven {
    /// The gap between slices or lines, of the distance between neighbours on them.
    pub ratio: f64,
    /// Factors for the axes that make the points more even, as
    /// [`Hints::anisotropy`](crate::reconstruct::Hints::anisotropy) takes them.
    pub anisotropy: [f64; 3],
}

/// Neighbours that make a small neighbourhood, which curves are told by.
const FEW_SHAPED: usize = 6;
/// Neighbours that make a large neighbourhood, which curves and volumes are told by.
const MORE_SHAPED: usize = 12;
/// On curves the median ratio of the second to the first extent of small neighbourhoods is below this.
const MAX_FEW_CURVE_EXTENT: f64 = 0.2;
/// The same of large ones, as curves bend.
const MAX_MORE_CURVE_EXTENT: f64 = 0.4;
/// In a volume the median ratio of the third to the first extent of large neighbourhoods is above this. Thin parts of
/// shapes have up to 0.46.
const MIN_VOLUME_EXTENT: f64 = 0.5;
/// The fewest points of which curves and volumes are told from surfaces; fewer look like any of them.
const MIN_POINTS_OF_A_KIND: usize = 100;
/// Parts lie apart by more than this many times the usual distance of neighbours.
const APART: f64 = 6.0;
/// The least share of the points that makes a part.
const MIN_PART_SHARE: f64 = 0.05;

/// Slices or lines farther apart than this many times the distance between neighbours on them are uneven. Also the
/// factor (lines) or divisor (slices) that is proposed for their axis then, whatever the measured ratio.
const UNEVEN: f64 = 5.0;
/// Points lie in slices across an axis if the median cosine between it and the ways to near neighbours is below this.
const MAX_ACROSS: f64 = 0.15;
/// Points lie on lines along an axis if that cosine is above this.
const MIN_ALONG: f64 = 0.95;

impl Sampling {
    /// Looks at the neighbourhoods of points (n x 3, distinct, any frame); nothing can be told of fewer than 20.
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

/// Whether points (n x 3), each with its `k` nearest in a row of `near` (itself first), lie in slices or on lines that
/// are far apart.
fn uneven(unit: &[[f32; 3]], near: &[u32], k: usize) -> Option<Uneven> {
    let ways: Vec<([f64; 3], f64)> = near
        .chunks_exact(k)
        .map(|row| {
            let way = sub(unit[row[1] as usize], unit[row[0] as usize]).map(f64::from);
            let len = dot(way, way).sqrt();
            (way.map(|x| x.abs() / len.max(f64::MIN_POSITIVE)), len)
        })
        .collect();
    let along = median(ways.iter().map(|(_, len)| *len).collect());
    let cosines = [0, 1, 2].map(|a| median(ways.iter().map(|(way, _)| way[a]).collect()));
    // The median gap between levels of an axis, if gaps more than twice as wide as neighbours are apart make up most of
    // its length.
    let gap = |axis: usize| {
        let mut levels: Vec<f64> = unit.iter().map(|p| f64::from(p[axis])).collect();
        levels.sort_by(f64::total_cmp);
        let steps: Vec<f64> = levels.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 2.0 * along).collect();
        let length = levels[levels.len() - 1] - levels[0];
        (steps.len() > 1 && steps.iter().sum::<f64>() > 0.6 * length).then(|| median(steps) / along)
    };
    let far = |ratio: &f64| *ratio > UNEVEN;
    let slices = (0..3).filter(|&a| cosines[a] < MAX_ACROSS).find_map(|a| Some((a, gap(a).filter(far)?)));
    let mut anisotropy = [1.0; 3];
    if let Some(line) = (0..3).find(|&a| cosines[a] > MIN_ALONG) {
        let ratio = (0..3).filter(|&a| a != line).find_map(|a| gap(a).filter(far))?;
        anisotropy[line] = UNEVEN;
        return Some(Uneven { ratio, anisotropy });
    }
    let (axis, ratio) = slices?;
    anisotropy[axis] = 1.0 / UNEVEN;
    Some(Uneven { ratio, anisotropy })
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
    use crate::geometry::Shape;
    use std::f32::consts::TAU;

    #[test]
    fn surfaces_curves_volumes_and_parts_are_told_apart() {
        for (name, shape) in Shape::gallery() {
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
        let uneven = seen.uneven.unwrap();
        assert!((uneven.ratio - 0.7 / 0.0628).abs() < 0.2, "{uneven:?}");
        assert_eq!(uneven.anisotropy, [1.0, 1.0, 0.2]);
        // Closer together they are even enough.
        let close: Vec<[f32; 3]> = rings.iter().map(|p| [p[0], p[1], 0.3 * p[2]]).collect();
        assert_eq!(Sampling::of(&close).uneven, None);
        // Lines along y over hilly ground, measured as a ship does.
        let line = |i: usize| {
            let (x, y) = ((i / 100) as f32 + 0.02 * (7.0 * i as f32).sin(), 0.1 * (i % 100) as f32);
            [x, y, 0.4 * (0.6 * x).sin() * (0.5 * y).cos()]
        };
        let lines: Vec<[f32; 3]> = (0..1000).map(line).collect();
        let uneven = Sampling::of(&lines).uneven.unwrap();
        assert!(uneven.ratio > 7.0 && uneven.anisotropy == [1.0, 5.0, 1.0], "{uneven:?}");
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
