//! Points on scan lines made even: points of scanners that spin or sweep lie far closer along their lines than the
//! lines lie to each other; they are replaced by means over cells about as large as the lines are apart.
//!
//! Between such lines a surface through all points has nothing to hold on to but the noise along them: it tears and
//! turns over. The means determine it.

use super::spacing::{AREA_NEIGHBOURS, area_spacing};
use super::vec3::length;
use rayon::prelude::*;

/// A surface that points fill crosses this many of the 5 x 5 x 5 cells around a point of it (25 if it is flat and
/// parallel to them); a few lines cross fewer.
const FILLED: usize = 20;
/// Points lie on lines where the cells that they fill are larger than this many times their area spacing; on
/// surfaces that are sampled at random they are smaller (`benches/accuracy.md`, constants).
const LINED: f64 = 2.0;
/// Lines that are farther apart than this many times the area spacing are no surface.
const MAX_LINED: f64 = 16.0;
/// The least share of points on such lines for which points are made even. On a thin leg points lie on a line, too.
const SHARE: f64 = 0.3;
/// Means are taken over cells of this many times the side at which the cells around a point are filled.
const MERGED: f64 = 0.8;
/// Cells of the smallest size from the origin to the farthest point at most, so that cell numbers, moved to be
/// positive, fit 21 bits.
const MAX_CELLS: f64 = (1 << 19) as f64;

/// Points on scan lines made even.
#[derive(Clone, Debug)]
pub(crate) struct EvenPoints {
    /// Means of groups of points, m x 3.
    pub points: Vec<[f32; 3]>,
    /// The group of each of the n points, n.
    group_of: Vec<u32>,
}

impl EvenPoints {
    /// The mean direction of each group (m x 3), from those of all points (n x 3); of unit length, or that of one of
    /// its points where they cancel.
    ///
    /// # Panics
    /// If there is not one direction for each of the n points.
    #[track_caller]
    pub fn directions(&self, of_points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        assert!(of_points.len() == self.group_of.len(), "{} of {}", of_points.len(), self.group_of.len());
        let mut sums = vec![[0.0f64; 3]; self.points.len()];
        let mut any = vec![[0.0f32; 3]; self.points.len()];
        for (direction, &group) in of_points.iter().zip(&self.group_of) {
            any[group as usize] = *direction;
            sums[group as usize].iter_mut().zip(direction).for_each(|(sum, x)| *sum += f64::from(*x));
        }
        let unit = |(sum, any): (&[f64; 3], &[f32; 3])| {
            let length = length(*sum);
            if length > 1e-6 { sum.map(|x| (x / length) as f32) } else { *any }
        };
        sums.iter().zip(&any).map(unit).collect()
    }
}

/// Points on scan lines (n x 3) as means over cells of 0.8 times the side at which points fill the cells
/// around them as a surface does; `None` if fewer than three tenths of the points are on lines that lie far from each
/// other.
pub(crate) fn evened(points: &[[f32; 3]]) -> Option<EvenPoints> {
    if points.len() <= AREA_NEIGHBOURS {
        return None;
    }
    let filled = lined_cells(points, &area_spacing(points))?;
    // Points that stay on their own first, then cells of each size, so that the result is in a fixed order.
    let number = |(i, step): (usize, &Option<i32>)| match step {
        Some(step) => (*step, key(cell(points[i], MERGED * side(*step))), i as u32),
        None => (i32::MIN, i as u64, i as u32),
    };
    let mut numbers: Vec<(i32, u64, u32)> = filled.iter().enumerate().map(number).collect();
    numbers.sort_unstable();
    let mut group_of = vec![0; points.len()];
    let mean = |(group, of): (usize, &[(i32, u64, u32)])| {
        let sum = of.iter().fold([0.0; 3], |sum: [f64; 3], &(_, _, i)| {
            group_of[i as usize] = group as u32;
            std::array::from_fn(|k| sum[k] + f64::from(points[i as usize][k]))
        });
        sum.map(|x| (x / of.len() as f64) as f32)
    };
    let means = numbers.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).enumerate().map(mean).collect();
    Some(EvenPoints { points: means, group_of })
}

/// The surface spacing at each of n points (n), in their unit: the area spacing, or about the line distance, the side
/// of the cells that points on lines fill together, where that is larger.
pub(crate) fn surface_spacing(points: &[[f32; 3]]) -> Vec<f64> {
    let mut spacing = area_spacing(points);
    if let Some(filled) = lined_cells(points, &spacing) {
        let of = |step: Option<i32>| step.map_or(0.0, side);
        spacing.iter_mut().zip(filled).for_each(|(spacing, step)| *spacing = spacing.max(of(step)));
    }
    spacing
}

/// The steps (see [`side`]) of [`filled_cells`] of points on scan lines; `None` for others.
fn lined_cells(points: &[[f32; 3]], area_spacing: &[f64]) -> Option<Vec<Option<i32>>> {
    let filled = filled_cells(points, area_spacing);
    let lined =
        |(step, spacing): &(&Option<i32>, &f64)| step.is_some_and(|step| side(step) > LINED * **spacing);
    let count = filled.iter().zip(area_spacing).filter(lined).count();
    (count as f64 >= SHARE * points.len() as f64).then_some(filled)
}

/// The side of cells of a step, 2^(step / 2), in the unit of the points.
fn side(step: i32) -> f64 {
    (0.5 * f64::from(step)).exp2()
}

fn cell(point: [f32; 3], side: f64) -> [i64; 3] {
    point.map(|x| (f64::from(x) / side).floor() as i64)
}

/// A number for a cell, ascending along z first.
fn key(cell: [i64; 3]) -> u64 {
    cell.into_iter().fold(0, |key, x| key << 21 | (x + (1 << 20)) as u64)
}

/// For each point the step (see [`side`]) of the smallest cells that it and the points around it fill as a surface
/// does; none where that takes cells of more than 16 times the area spacing.
fn filled_cells(points: &[[f32; 3]], area_spacing: &[f64]) -> Vec<Option<i32>> {
    let step_of = |length: f64| (2.0 * length.log2()).floor() as i32;
    let extent = points.iter().flatten().fold(0.0f64, |m, x| m.max(f64::from(x.abs())));
    let finest = step_of(extent / MAX_CELLS) + 1;
    // Smaller cells than about the area spacing are never filled.
    let first: Vec<i32> =
        area_spacing.iter().map(|&s| step_of(0.7 * s.max(f64::MIN_POSITIVE)).max(finest)).collect();
    let last: Vec<i32> =
        area_spacing.iter().map(|&s| step_of(MAX_LINED * s.max(f64::MIN_POSITIVE))).collect();
    let mut found = vec![None; points.len()];
    let (Some(&from), Some(&to)) = (first.iter().min(), last.iter().max()) else { return found };
    for step in from..=to {
        let open = |i: usize| found[i].is_none() && (first[i]..=last[i]).contains(&step);
        let asking: Vec<usize> = (0..points.len()).filter(|&i| open(i)).collect();
        if asking.is_empty() {
            continue;
        }
        let side = side(step);
        let mut occupied: Vec<u64> = points.par_iter().map(|&p| key(cell(p, side))).collect();
        occupied.par_sort_unstable();
        occupied.dedup();
        let filled = |&i: &usize| around(&occupied, cell(points[i], side)) >= FILLED;
        let filled: Vec<bool> = asking.par_iter().map(filled).collect();
        asking.iter().zip(filled).filter(|(_, filled)| *filled).for_each(|(&i, _)| found[i] = Some(step));
    }
    found
}

/// How many of the 5 x 5 x 5 cells around one are `occupied` (ascending).
fn around(occupied: &[u64], [x, y, z]: [i64; 3]) -> usize {
    let columns = (-2..=2).flat_map(|i| (-2..=2).map(move |j| [x + i, y + j]));
    let within = |[x, y]: [i64; 2]| {
        let first = occupied.partition_point(|&k| k < key([x, y, z - 2]));
        occupied[first..].iter().take_while(|&&k| k <= key([x, y, z + 2])).count()
    };
    columns.map(within).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::vec3::distance;
    use crate::geometry::{AnalyticShape, KdTree};
    use proptest::prelude::*;

    /// Rings on a plane as a spinning scanner leaves them, 0.05 apart, the points 0.002 apart along them.
    fn rings() -> Vec<[f32; 3]> {
        let ring = |r: f32| {
            let n = (r * std::f32::consts::TAU / 0.002) as usize;
            (0..n).map(move |i| {
                let (s, c) = (i as f32 / n as f32 * std::f32::consts::TAU).sin_cos();
                [r * c, r * s, 0.001 * (97.0 * s).sin()]
            })
        };
        (2..10).flat_map(|i| ring(0.05 * i as f32)).collect()
    }

    #[test]
    fn rings_become_even_and_stay_where_they_are() {
        let rings = rings();
        let lined = evened(&rings).unwrap();
        let even = lined.points.clone();
        assert!(even.len() < rings.len() / 4, "{} of {}", even.len(), rings.len());
        // No place of the rings loses its points, and what is new is among them.
        let far = |from: &[[f32; 3]], to: &[[f32; 3]]| {
            let tree = KdTree::new(to);
            from.iter().map(|&p| tree.nearest(p).1.sqrt()).fold(0.0, f32::max)
        };
        assert!(far(&rings, &even) < 0.05 && far(&even, &rings) < 0.02, "{}", far(&even, &rings));
        let spread = |points: &[[f32; 3]]| {
            let tree = KdTree::new(points);
            let nearest = |p: &[f32; 3]| distance(*p, points[tree.k_nearest(&[*p], 2)[1] as usize]);
            points.iter().map(nearest).sum::<f64>() / points.len() as f64
        };
        assert!(spread(&even) > 3.0 * spread(&rings) && spread(&rings) < 0.003, "{}", spread(&even));
        assert!(evened(&even).is_none_or(|again| again.points.len() > even.len() / 2));
        // Groups are where their points are.
        let out: Vec<[f32; 3]> = rings.iter().map(|p| [p[0], p[1], 0.0]).collect();
        for (direction, p) in lined.directions(&out).iter().zip(&even) {
            let length = p[0].hypot(p[1]);
            assert!((direction[0] * p[0] + direction[1] * p[1]) / length > 0.99, "{direction:?} {p:?}");
        }
    }

    #[test]
    fn what_is_sampled_at_random_stays() {
        let shapes = [
            AnalyticShape::Sphere { radius: 0.4 },
            AnalyticShape::Torus { major: 0.3, minor: 0.1 },
            AnalyticShape::RoundedBox { half: [0.5, 0.4, 0.02], round: 0.005 },
        ];
        for shape in shapes {
            for n in [20, 300, 5000] {
                assert!(evened(&shape.sample(n, 4).0).is_none(), "{shape:?} {n}");
            }
        }
        // A line alone is no surface; nor are points in one place.
        let line: Vec<[f32; 3]> = (0..900).map(|i| [0.001 * i as f32, 0.0, 0.0]).collect();
        assert!(evened(&line).is_none());
        assert!(evened(&[[0.25; 3]; 100]).is_none());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// By asking for every cell.
        #[test]
        fn cells_around_one_are_counted(
            cells in prop::collection::vec(prop::array::uniform3(-4i64..4), 0..200),
            at in prop::array::uniform3(-4i64..4),
        ) {
            let mut occupied: Vec<u64> = cells.iter().map(|&c| key(c)).collect();
            occupied.sort_unstable();
            occupied.dedup();
            let near = |c: &[i64; 3]| (0..3).all(|k| (c[k] - at[k]).abs() <= 2);
            let mut naive: Vec<[i64; 3]> = cells.into_iter().filter(near).collect();
            naive.sort_unstable();
            naive.dedup();
            prop_assert_eq!(around(&occupied, at), naive.len());
        }
    }
}
