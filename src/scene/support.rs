//! How well the points of a cloud support each part of a surface.

use crate::error::Error;
use crate::geometry::vec3::{distance, dot};
use crate::geometry::{KdTree, Normalizer, Position, TriangleBvh, TriangleMesh, quantile, surface_spacing};
use rayon::prelude::*;

/// Nearest points over whose surface spacings the mean is taken, so that it does not jump from place to place.
const AVERAGED: usize = 8;
/// Nearest points among which one on the same side of the surface is looked for. On a sheet that was seen from both
/// sides about every second point is.
const SEARCHED: usize = 24;
/// The quantile of the surface spacings that caps them; what is much sparser is a scatter and no surface.
const DENSER_SHARE: f64 = 0.9;
/// The surface spacing at a point is at most this many times that quantile.
const MAX_EXCESS: f64 = 1.5;
/// Vertices that one thread works on at a time.
const CHUNK: usize = 256;

/// How well points support the v vertices of a surface: the larger the gap, the less.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointSupport {
    /// The distance from each vertex to the nearest point on the same side of the surface, over the surface spacing
    /// there (v): 0 at a point, without unit.
    /// Between the points of an evenly sampled surface it is at most about 0.7, between random ones rarely above 1.5.
    pub gap: Vec<f32>,
    /// The surface spacing of the points there (v), in their unit; [`point_support`] defines it.
    pub surface_spacing: Vec<f32>,
}

/// The gap and the surface spacing of `points` (n x 3) at each vertex of `mesh` (in the same frame), of 32 or 64 bits
/// each.
///
/// The gap is the distance to the nearest point on the same side of the surface, over the surface spacing. A point is
/// on the same side if the normal of the face nearest to it and that of the vertex are at most 90 degrees apart, so
/// that points on the front of a wall do not support its back, which a closed surface has wherever a scan saw one side
/// only. The nearest 24 points are looked at; if none of them is on the same side, the distance to the farthest of
/// them counts.
///
/// The surface spacing at a point is the side of the square that each of its neighbours would have if they lay evenly
/// on a disc: r sqrt(pi / k) with the distance r to its k-th nearest point, k = 24 (fewer if there are fewer points).
/// Where a scanner left lines that lie far from each other, it is about as large as the lines are apart. It is at most
/// one and a half times that which nine tenths of the points stay below: what is sparser is a scatter. At a vertex it
/// is the mean over the eight nearest points.
///
/// # Errors
/// [`ErrorKind::Data`](crate::ErrorKind::Data) if there are fewer than two distinct points or a coordinate of the
/// points is not finite.
///
/// # Panics
/// If a vertex is not finite, or a face names a vertex that is not there.
#[track_caller]
pub fn point_support<P: Position, Q: Position>(
    mesh: &TriangleMesh<P>,
    points: &[Q],
) -> Result<PointSupport, Error> {
    // In the working frame, where squares neither overflow nor vanish.
    let frame = Normalizer::of(points)?;
    let mesh = TriangleMesh { verts: frame.forward(&mesh.verts), faces: mesh.faces.clone() };
    let points = Oriented::by_nearest_face(frame.forward(points), &mesh)?;
    let verts = Oriented { normals: mesh.vertex_normals(), places: mesh.verts };
    Ok(support_in_frame(&verts, &points, frame.scale()))
}

/// Places and the unit normals of the surface there, n x 3 each; a normal of zero is on every side.
struct Oriented {
    places: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
}

impl Oriented {
    /// `places` with the normals of the faces of `mesh` nearest to them; zero if it has no faces.
    fn by_nearest_face(places: Vec<[f32; 3]>, mesh: &TriangleMesh) -> Result<Self, Error> {
        if mesh.faces.is_empty() {
            return Ok(Self { normals: vec![[0.0; 3]; places.len()], places });
        }
        Ok(Self { normals: TriangleBvh::new(mesh)?.normals_near(&places), places })
    }
}

/// [`point_support`] in the working frame, whose unit is `scale` units of the input.
fn support_in_frame(verts: &Oriented, points: &Oriented, scale: f64) -> PointSupport {
    let spacing = capped(spacings(&points.places));
    let tree = KdTree::new(&points.places);
    let averaged = AVERAGED.min(points.places.len());
    let searched = SEARCHED.min(points.places.len());
    let same_side = |normal: &[f32; 3], i: u32| dot(*normal, points.normals[i as usize]) >= 0.0;
    let chunk = |(verts, normals): (&[[f32; 3]], &[[f32; 3]])| {
        let near = tree.k_nearest(verts, averaged);
        let one = |((vertex, normal), near): ((&[f32; 3], &[f32; 3]), &[u32])| {
            let spacing = near.iter().map(|&i| spacing[i as usize]).sum::<f64>() / averaged as f64;
            // Most vertices have such a point among the few nearest, and need no second search.
            let supporting = near.iter().copied().find(|&i| same_side(normal, i)).unwrap_or_else(|| {
                let more = tree.k_nearest(std::slice::from_ref(vertex), searched);
                more.iter().copied().find(|&i| same_side(normal, i)).unwrap_or(more[searched - 1])
            });
            let gap = distance(*vertex, points.places[supporting as usize]) / spacing;
            (gap as f32, (spacing * scale) as f32)
        };
        verts.iter().zip(normals).zip(near.chunks_exact(averaged)).map(one).collect::<Vec<_>>()
    };
    let each: Vec<Vec<(f32, f32)>> =
        verts.places.par_chunks(CHUNK).zip(verts.normals.par_chunks(CHUNK)).map(chunk).collect();
    let (gap, surface_spacing) = each.into_iter().flatten().unzip();
    PointSupport { gap, surface_spacing }
}

/// The number of the point nearest to each of `places` (m x 3, in the frame of `points`, n x 3): m; of several as near,
/// the first.
///
/// # Errors
/// As [`point_support`].
///
/// # Panics
/// If a place is not finite.
#[track_caller]
pub fn nearest_of<P: Position, Q: Position>(places: &[P], points: &[Q]) -> Result<Vec<u32>, Error> {
    let frame = Normalizer::of(points)?;
    let (places, points) = (frame.forward(places), frame.forward(points));
    let tree = KdTree::new(&points);
    Ok(places.par_iter().with_min_len(CHUNK).map(|&place| tree.nearest(place).0).collect())
}

/// The surface spacing at each point, above 0.
fn spacings(points: &[[f32; 3]]) -> Vec<f64> {
    let spacing = surface_spacing(points);
    // Points that more than k others share their place with have none of their own.
    let least = spacing.iter().copied().filter(|&s| s > 0.0).fold(f64::INFINITY, f64::min);
    spacing.into_iter().map(|s| if s > 0.0 { s } else { least }).collect()
}

/// Surface spacings no larger than 1.5 times that which nine tenths of the points stay below.
fn capped(mut spacing: Vec<f64>) -> Vec<f64> {
    let most = MAX_EXCESS * quantile(spacing.clone(), DENSER_SHARE);
    spacing.iter_mut().for_each(|s| *s = s.min(most));
    spacing
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{AnalyticShape, fibonacci_sphere};
    use crate::scene::testing::sheet;
    use proptest::prelude::*;

    /// The gaps at places of a surface whose normals are not known, so that every point is on the same side.
    fn gap_at(places: &[[f32; 3]], points: &[[f32; 3]]) -> Vec<f32> {
        point_support(&TriangleMesh { verts: places.to_vec(), faces: Vec::new() }, points).unwrap().gap
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// By sorting all distances.
        #[test]
        fn is_the_distance_over_the_mean_spacing(n in 2usize..60, seed: u64, scale in -20i32..20) {
            let unit = |p: &[f32; 3]| p.map(|x| x * 2f32.powi(scale));
            let points: Vec<_> = AnalyticShape::Sphere { radius: 0.5 }.sample(n, seed).0.iter().map(unit).collect();
            let places: Vec<_> = AnalyticShape::Sphere { radius: 0.7 }.sample(9, !seed).0.iter().map(unit).collect();
            let sorted = |p: &[f32; 3]| {
                let mut all: Vec<(f64, usize)> = points.iter().map(|q| distance(*p, *q)).zip(0..).collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0));
                all
            };
            let k = 24.min(n - 1);
            let spacing: Vec<f64> =
                points.iter().map(|p| sorted(p)[k].0 * (std::f64::consts::PI / k as f64).sqrt()).collect();
            let mut all = spacing.clone();
            all.sort_by(f64::total_cmp);
            let most = 1.5 * all[(0.9 * (n - 1) as f64).ceil() as usize];
            let normals = |n: usize, seed: u64| AnalyticShape::Sphere { radius: 1.0 }.sample(n, seed).1;
            let (front, sides) = (normals(9, seed ^ 1), normals(n, seed ^ 2));
            let got = support_in_frame(
                &Oriented { places: places.clone(), normals: front.clone() },
                &Oriented { places: points.clone(), normals: sides.clone() },
                1.0,
            );
            let nearest = nearest_of(&places, &points).unwrap();
            prop_assert!(places.iter().zip(nearest).all(|(p, i)| sorted(p)[0].1 == i as usize));
            for ((place, front), (got, wide)) in
                places.iter().zip(&front).zip(got.gap.iter().zip(&got.surface_spacing))
            {
                let near = sorted(place);
                let m = 8.min(n);
                let mean = near[..m].iter().map(|&(_, i)| spacing[i].min(most)).sum::<f64>() / m as f64;
                let searched = &near[..24.min(n)];
                let same_side = searched.iter().find(|&&(_, i)| dot(*front, sides[i]) >= 0.0);
                let want = same_side.unwrap_or(&searched[searched.len() - 1]).0 / mean;
                prop_assert!((f64::from(*got) - want).abs() < 1e-4 * want, "{got} is not {want}");
                prop_assert!((f64::from(*wide) - mean).abs() < 1e-4 * mean, "{wide} is not {mean}");
            }
        }
    }

    #[test]
    fn an_evenly_sampled_surface_is_supported_and_what_leaves_it_is_not() {
        let sphere = fibonacci_sphere(500);
        let between = gap_at(&fibonacci_sphere(3001), &sphere);
        assert!(between.iter().all(|&s| s < 1.0), "{between:?}");
        let off: Vec<_> = sphere.iter().map(|p| p.map(|x| 1.5 * x)).collect();
        // Half a radius off, over the side of a 500th of the sphere, 0.159.
        let far = gap_at(&off, &sphere);
        assert!(far.iter().all(|gap| (2.9..3.4).contains(gap)), "{far:?}");
    }

    /// A scatter beside a surface, each point of it far from all others, does not support the places among its points.
    #[test]
    fn a_scatter_is_no_surface() {
        let mut points = fibonacci_sphere(500);
        let scatter: Vec<[f32; 3]> =
            fibonacci_sphere(30).into_iter().map(|p| [p[0] + 3.0, p[1], p[2]]).collect();
        points.extend(&scatter);
        // Half of the distance between points of the scatter off its points.
        let among: Vec<[f32; 3]> = scatter.iter().map(|p| [p[0] + 0.3, p[1], p[2]]).collect();
        let gap = gap_at(&among, &points);
        assert!(gap.iter().filter(|&&gap| gap > 1.0).count() > 25, "{gap:?}");
    }

    /// Rings 0.05 apart, the points 0.004 apart along them: what lies between neighbouring rings is spoken for.
    #[test]
    fn between_the_lines_of_a_scanner_is_surface() {
        let ring = |r: f32, step: f32| {
            let n = (r * std::f32::consts::TAU / step) as usize;
            (0..n).map(move |i| {
                let (s, c) = (i as f32 / n as f32 * std::f32::consts::TAU).sin_cos();
                [r * c, r * s, 0.0]
            })
        };
        let points: Vec<[f32; 3]> = (4..14).flat_map(|i| ring(0.05 * i as f32, 0.004)).collect();
        let between: Vec<[f32; 3]> = (5..12).flat_map(|i| ring(0.05 * i as f32 + 0.025, 0.1)).collect();
        let gap = gap_at(&between, &points);
        assert!(gap.iter().all(|&gap| gap < 1.0), "{gap:?}");
        let beyond = gap_at(&ring(0.8, 0.1).collect::<Vec<_>>(), &points);
        assert!(beyond.iter().all(|&gap| gap > 1.5), "{beyond:?}");
    }

    /// Two sheets much closer to each other than the points, which lie on the upper one alone.
    #[test]
    fn points_on_the_front_do_not_support_the_back() {
        let (front, back) = (sheet(0.0, false), sheet(-0.01, true));
        let first = front.verts.len() as u32;
        let both = TriangleMesh {
            verts: [&front.verts[..], &back.verts].concat(),
            faces: front
                .faces
                .iter()
                .copied()
                .chain(back.faces.iter().map(|f| f.map(|v| v + first)))
                .collect(),
        };
        let points: Vec<[f32; 3]> =
            (0..400).map(|i| [0.05 * (i % 20) as f32, 0.05 * (i / 20) as f32, 0.0]).collect();
        let gap = point_support(&both, &points).unwrap().gap;
        let (upper, lower) = gap.split_at(front.verts.len());
        assert!(upper.iter().all(|&g| g < 1.0) && lower.iter().all(|&g| g > 2.0), "{gap:?}");
    }

    #[test]
    fn points_in_one_place_have_a_finite_spacing() {
        let mut points = fibonacci_sphere(40);
        points.extend([points[3]; 60]);
        assert!(gap_at(&fibonacci_sphere(50), &points).iter().all(|s| s.is_finite()));
        assert!(
            point_support(&TriangleMesh { verts: points.clone(), faces: Vec::new() }, &[[1.0; 3]]).is_err()
        );
        assert!(gap_at(&[], &points).is_empty());
    }
}
