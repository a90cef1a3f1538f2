//! Which side of the surface is outside, where normals or the scanner's place are given: normals that contradict each
//! other, and normals that face the place from which the points were seen.

use crate::geometry::vec3::{distance, dot, sub, unit_vector, wide};
use crate::geometry::{KdTree, Normalizer, Position, PrincipalAxes, neighbour_spacing};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Neighbours whose normals are compared.
const COMPARED: usize = 6;
/// Normals of neighbours contradict each other if the cosine between them is below this.
const AGAINST: f64 = -0.5;
/// The largest cosine between a normal and the direction to a neighbour for both to lie on one side: on the other side
/// of a thin part normals do point the other way.
const BESIDE: f64 = 0.35;
/// Neighbours that lie about in the plane of the surface.
const PLANE: usize = 10;
/// The cosine between the plane's normal and the way to the origin below which a point is seen too much from the side
/// for the plane, which is not exact, to tell the side.
const GRAZING: f64 = 0.1;

/// Neighbour spacings beyond which two points that lie in one direction are not of one piece of the surface.
const APART: f64 = 4.0;

/// The share of n points (n x 3, any frame) whose normal (n x 3, any length) points against those of most of the near
/// neighbours whose direction is about perpendicular to both normals. Points without a normal, or without such a
/// neighbour, do not count.
///
/// # Panics
/// If there is not one normal a point.
#[track_caller]
pub fn contradicting<P: Position>(points: &[P], normals: &[[f32; 3]]) -> f64 {
    assert!(
        points.len() == normals.len(),
        "contradicting: {} points, {} normals",
        points.len(),
        normals.len()
    );
    let Ok(frame) = Normalizer::of(points) else { return 0.0 };
    let unit = frame.forward(points);
    let directions: Vec<Option<[f64; 3]>> = normals.iter().map(|n| unit_vector(n.map(f64::from))).collect();
    let k = (COMPARED + 1).min(unit.len());
    let near = KdTree::new(&unit).k_nearest(&unit, k);
    let judged = |(i, row): (usize, &[u32])| {
        let own = directions[i]?;
        let others = row.iter().filter_map(|&j| {
            let way = unit_vector(sub(unit[j as usize], unit[i]).map(f64::from))?;
            let other = directions[j as usize]?;
            (dot(own, way).abs() < BESIDE && dot(other, way).abs() < BESIDE).then(|| dot(own, other))
        });
        let cosines: Vec<f64> = others.collect();
        let against = cosines.iter().filter(|cos| **cos < AGAINST).count();
        (!cosines.is_empty()).then_some(2 * against > cosines.len())
    };
    let judged: Vec<bool> = near.chunks_exact(k).enumerate().filter_map(judged).collect();
    judged.iter().filter(|against| **against).count() as f64 / judged.len().max(1) as f64
}

/// Unit normals (n x 3) at points (n x 3, any frame) that face `origin`, from which they were seen: `normals` (n x 3,
/// any length), turned if they point away, or where there are none those of planes through the points around. Where the
/// surface is seen so much from the side that it is not certain which way it faces, it faces as the points around; zero
/// if that is not certain for any of them.
///
/// # Panics
/// If there is not one normal a point.
#[track_caller]
pub fn facing<P: Position>(points: &[P], normals: Option<&[[f32; 3]]>, origin: [f64; 3]) -> Vec<[f32; 3]> {
    let given = normals.map_or(points.len(), <[_]>::len);
    assert!(given == points.len(), "facing: {} points, {given} normals", points.len());
    let Ok(frame) = Normalizer::of(points) else { return vec![[0.0; 3]; points.len()] };
    let unit = frame.forward(points);
    let eye = frame.forward_wide(origin);
    let k = (PLANE + 1).min(unit.len());
    let near = KdTree::new(&unit).k_nearest(&unit, k);
    let around = |i: usize| &near[k * i..k * (i + 1)];
    let faced = |i: usize| {
        let own = normals.and_then(|normals| unit_vector(normals[i].map(f64::from)));
        let normal = own.unwrap_or_else(|| plane_normal(&unit, around(i)));
        let cos = unit_vector(sub(eye, unit[i].map(f64::from))).map_or(0.0, |way| dot(normal, way));
        (normal.map(|x| if cos < 0.0 { -x } else { x }), cos.abs() >= GRAZING)
    };
    let faced: Vec<([f64; 3], bool)> = (0..unit.len()).into_par_iter().map(faced).collect();
    let settled = |i: usize| {
        let (normal, sure) = faced[i];
        let others = around(i).iter().map(|&j| faced[j as usize]).filter(|(_, sure)| *sure);
        let along: f64 = others.map(|(other, _)| dot(normal, other)).sum();
        let sign = if sure {
            1.0
        } else if along == 0.0 {
            0.0
        } else {
            along.signum()
        };
        normal.map(|x| (sign * x) as f32)
    };
    (0..unit.len()).into_par_iter().map(settled).collect()
}

/// The share of n points (n x 3, any frame) that lie behind or before others as seen from `origin`: whose nearest other
/// point by direction is farther from them than the surface around explains, more than four neighbour spacings. Of what
/// was seen from there only points at edges are; of the points of a closed surface many.
pub fn behind_others<P: Position>(points: &[P], origin: [f64; 3]) -> f64 {
    let Ok(frame) = Normalizer::of(points) else { return 0.0 };
    let unit = frame.forward(points);
    let eye = frame.forward_wide(origin);
    let way = |p: &[f32; 3]| unit_vector(sub(wide(*p), eye)).map_or([0.0; 3], |way| way.map(|x| x as f32));
    let ways: Vec<[f32; 3]> = unit.iter().map(way).collect();
    let k = 2.min(unit.len());
    let near = KdTree::new(&ways).k_nearest(&ways, k);
    let spacings = neighbour_spacing(&unit);
    let apart = |(i, row): (usize, &[u32])| {
        let other = row.iter().find(|&&j| j as usize != i).map_or(i, |&j| j as usize);
        distance(unit[i], unit[other]) > APART * spacings[i].max(spacings[other])
    };
    let behind = near.chunks_exact(k.max(1)).enumerate().filter(|&row| apart(row)).count();
    behind as f64 / unit.len().max(1) as f64
}

/// The unit normal of the plane through some points, of either sign.
fn plane_normal(points: &[[f32; 3]], rows: &[u32]) -> [f64; 3] {
    let (_, axes) =
        PrincipalAxes::of_points(rows.iter().map(|&i| Vector3::from(points[i as usize].map(f64::from))));
    axes.normal().into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{AnalyticShape, fibonacci_sphere};

    #[test]
    fn turned_normals_contradict_their_neighbours() {
        for (name, shape) in AnalyticShape::gallery() {
            let (points, mut normals) = shape.sample(600, 2);
            let share = contradicting(&points, &normals);
            assert!(share < 0.02, "{name}: {share}");
            let inward: Vec<[f32; 3]> = normals.iter().map(|n| n.map(|x| -3.0 * x)).collect();
            assert_eq!(contradicting(&points, &inward), share, "{name}");
            // One in ten.
            for n in normals.iter_mut().step_by(10) {
                *n = n.map(|x| -x);
            }
            let share = contradicting(&points, &normals);
            assert!((0.05..0.16).contains(&share), "{name}: {share}");
        }
        assert_eq!(contradicting::<[f32; 3]>(&[], &[]), 0.0);
        assert_eq!(contradicting(&[[0.0f32; 3], [1.0; 3]], &[[0.0; 3], [f32::NAN; 3]]), 0.0);
    }

    #[test]
    fn normals_face_the_origin() {
        let sphere = fibonacci_sphere(400);
        // From within, far away from where the numbers begin.
        let moved: Vec<[f64; 3]> =
            sphere.iter().map(|p| [0, 1, 2].map(|a| 5e6 + 10.0 * f64::from(p[a]))).collect();
        for (n, p) in facing(&moved, None, [5e6; 3]).iter().zip(&sphere) {
            assert!(dot(*n, *p) < -0.98, "{n:?} at {p:?}");
        }
        // From afar, and a little more than can be seen from there: the rim faces as the points next to it.
        let seen: Vec<[f32; 3]> = sphere.iter().copied().filter(|p| p[2] > -0.09).collect();
        let inward: Vec<[f32; 3]> = seen.iter().map(|p| p.map(|x| -x)).collect();
        for normals in [None, Some(&inward[..])] {
            for (n, p) in facing(&seen, normals, [0.0, 0.0, 1e9]).iter().zip(&seen) {
                assert!(dot(*n, *p) > 0.9, "{n:?} at {p:?}");
            }
        }
        // A wall seen from its edge: nothing is certain.
        let wall: Vec<[f32; 3]> = (0..100).map(|i| [(i % 10) as f32, (i / 10) as f32, 0.0]).collect();
        assert_eq!(facing(&wall, None, [-50.0, 4.0, 0.0]), [[0.0; 3]; 100]);
        assert_eq!(facing(&[[1.0f32; 3]; 3], None, [0.0; 3]), [[0.0; 3]; 3]);
    }
}
