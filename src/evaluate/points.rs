//! From a ground truth and points to how near to it they are, and how well they cover it.

use super::compare::CompareOptions;
use super::sides::{GroundTruth, Side, frame_of, moved, naming};
use crate::error::Error;
use crate::geometry::{PointTree, distinct_places};

/// Points that are equal when rounded to multiples of this, in the frame of the comparison, are one place.
const PLACE: f64 = 1e-4;
/// Keeps the seeds of the samples apart from small numbers. A cloud is often drawn from its truth with a small seed, by
/// the same generator, and its points would be among the samples. The bytes are the ASCII of "points".
const OWN_SEEDS: u64 = 0x706f_696e_7473_0000;

/// How points lie to a ground truth; the result of [`evaluate_points`]. Distances in units of the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PointsReport {
    /// The number of points n.
    pub points: usize,
    /// Distinct places among them, rounded to 1e-4 of a unit.
    pub distinct: usize,
    /// The mean distance from a point to the nearest sample of the ground truth.
    pub to_gt: f64,
    /// The mean distance from a sample of the ground truth to the nearest point: how well the points cover it. It
    /// includes the gaps that as many points must leave, see `floor`.
    pub from_gt: f64,
    /// What n points drawn from the ground truth itself would have in `from_gt`; for a mesh, if asked for.
    pub floor: Option<f64>,
    /// Input units per unit of the frame (1 in [`Frame::AsIs`](super::Frame::AsIs)).
    pub scale: f64,
    /// Samples of the ground truth.
    pub gt_samples: usize,
}

/// Measures between a ground truth and each of several sets of points, such as a cloud and the parameterized surface
/// made of it: one report a set. All must be in the same frame and are not aligned.
///
/// Number of samples and frame are those of [`evaluate`](super::evaluate) with the same options, so its mean distances
/// can be held against these; the samples are others. The result is the same for any thread count.
///
/// # Errors
/// [`ErrorKind::Data`](crate::ErrorKind::Data) if the ground truth or a set of points is unusable (which one is said),
/// [`ErrorKind::Config`](crate::ErrorKind::Config) if a number of samples is 0 or the threshold is not positive.
///
/// # Panics
/// If a cloud has normals, but not one a point.
#[track_caller]
pub fn evaluate_points(
    gt: GroundTruth<'_>,
    sets: &[&[[f32; 3]]],
    options: &CompareOptions,
) -> Result<Vec<PointsReport>, Error> {
    options.check()?;
    let seed = |i: u64| options.seed_of(i) ^ OWN_SEEDS;
    let in_gt = naming("unusable ground truth");
    let frame = frame_of(gt, options.frame).map_err(&in_gt)?;
    let mesh = match gt {
        GroundTruth::Mesh(mesh) => Some(moved(mesh, &frame)),
        GroundTruth::Cloud { .. } => None,
    };
    let side = match (gt, &mesh) {
        (GroundTruth::Cloud { points, normals }, _) => {
            Side::of_cloud(points, normals, &frame, options.most(options.of_gt()), seed(0))
        }
        (GroundTruth::Mesh(whole), mesh) => {
            Side::of_mesh(mesh.as_ref().unwrap_or(whole), options.of_gt(), seed(0))
        }
    }
    .map_err(&in_gt)?;
    let gt_tree = PointTree::new(&side.points);
    let mean = |from: &PointTree, to: &PointTree| {
        let (_, dist_sq) = to.nearest(from);
        dist_sq.iter().map(|&d| f64::from(d).sqrt()).sum::<f64>() / dist_sq.len() as f64
    };
    let of = |points: &&[[f32; 3]]| {
        // All of them, however many.
        let set = Side::of_cloud(points, None, &frame, usize::MAX, 0).map_err(naming("unusable points"))?;
        let tree = PointTree::new(&set.points);
        let floor = match &mesh {
            Some(mesh) if options.floor => {
                let drawn = Side::of_mesh(mesh, points.len(), seed(2)).map_err(&in_gt)?;
                Some(mean(&gt_tree, &PointTree::new(&drawn.points)))
            }
            _ => None,
        };
        Ok(PointsReport {
            points: points.len(),
            distinct: distinct_places(&set.points, PLACE),
            to_gt: mean(&tree, &gt_tree),
            from_gt: mean(&gt_tree, &tree),
            floor,
            scale: frame.scale(),
            gt_samples: side.points.len(),
        })
    };
    sets.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Frame, compare_samples, metrics::Samples};
    use super::*;
    use crate::error::ErrorKind;
    use crate::geometry::{TriangleMesh, sample_surface};

    /// A square of the given side with a corner at the origin.
    fn square(side: f32) -> TriangleMesh {
        let verts = vec![[0.0; 3], [side, 0.0, 0.0], [side, side, 0.0], [0.0, side, 0.0]];
        TriangleMesh { verts, faces: vec![[0, 1, 2], [0, 2, 3]] }
    }

    #[test]
    fn distances_are_those_of_the_twin() {
        let mesh = square(4.0);
        let gt = sample_surface(&square(1.0), 700, OWN_SEEDS).unwrap().points;
        // The frame puts the middle of the square at the origin and makes its side 1.
        let gt: Vec<[f32; 3]> = gt.iter().map(|p| [p[0] - 0.5, p[1] - 0.5, p[2]]).collect();
        let options = CompareOptions { samples: 700, ..CompareOptions::shape() };
        for n in 1..=12 {
            let points: Vec<[f32; 3]> = sample_surface(&mesh, n, 9).unwrap().points;
            let raised: Vec<[f32; 3]> = points.iter().map(|p| [p[0], p[1], 0.5]).collect();
            let found = evaluate_points(GroundTruth::Mesh(&mesh), &[&points, &raised], &options).unwrap();
            for (report, points) in found.iter().zip([&points, &raised]) {
                let framed: Vec<[f64; 3]> = points
                    .iter()
                    .map(|p| [0, 1, 2].map(|d| f64::from(p[d]) / 4.0 - [0.5, 0.5, 0.0][d]))
                    .collect();
                let gt: Vec<[f64; 3]> = gt.iter().map(|p| p.map(f64::from)).collect();
                let mean = |from: &[[f64; 3]], to: &[[f64; 3]]| {
                    let d = |a: &[f64; 3], b: &[f64; 3]| {
                        (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
                    };
                    let nearest = |a| to.iter().map(|b| d(a, b)).fold(f64::INFINITY, f64::min);
                    from.iter().map(nearest).sum::<f64>() / from.len() as f64
                };
                assert!((report.to_gt - mean(&framed, &gt)).abs() < 1e-6, "{report:?}");
                assert!((report.from_gt - mean(&gt, &framed)).abs() < 1e-6, "{report:?}");
                assert_eq!((report.points, report.distinct, report.scale), (n, n, 4.0));
                assert_eq!(report.gt_samples, 700);
            }
            assert!(found[1].to_gt >= 0.125 && found[0].floor == found[1].floor);
        }
    }

    #[test]
    fn gaps_and_repetitions_show_in_the_coverage_alone() {
        let mesh = square(1.0);
        let options = CompareOptions { samples: 20_000, ..CompareOptions::shape() };
        let even = sample_surface(&mesh, 1000, 5).unwrap().points;
        let few: Vec<[f32; 3]> = even[..100].iter().flat_map(|&p| [p; 10]).collect();
        let gt = GroundTruth::Mesh(&mesh);
        let [even, few] = evaluate_points(gt, &[&even, &few], &options).unwrap()[..] else {
            panic!("two sets")
        };
        assert!((even.from_gt / even.floor.unwrap() - 1.0).abs() < 0.05, "{even:?}");
        assert!(few.from_gt > 2.5 * few.floor.unwrap() && few.distinct == 100, "{few:?}");
        assert!(few.to_gt < 1.2 * even.to_gt, "{few:?} {even:?}");
    }

    #[test]
    fn a_cloud_is_a_ground_truth_too_and_bad_points_are_told() {
        let mesh = square(2.0);
        let cloud = sample_surface(&mesh, 400, 1).unwrap().points;
        let points = sample_surface(&mesh, 50, 2).unwrap().points;
        let options = CompareOptions { frame: Frame::AsIs, ..CompareOptions::shape() };
        let gt = GroundTruth::Cloud { points: &cloud, normals: None };
        let report = evaluate_points(gt, &[&points], &options).unwrap()[0];
        let m = compare_samples(Samples::new(&points, None), Samples::new(&cloud, None), 0.01);
        assert_eq!((report.to_gt, report.from_gt), (m.acc(), m.comp()));
        assert!(report.floor.is_none() && report.gt_samples == 400 && report.scale == 1.0);
        let bad = [[0.0, f32::NAN, 0.0]];
        let error = evaluate_points(gt, &[&points, &bad], &options).unwrap_err();
        assert!(error.kind() == ErrorKind::Data && error.to_string().contains("unusable points"), "{error}");
        assert!(evaluate_points(gt, &[&[]], &options).is_err());
        let none = CompareOptions { samples: 0, ..options };
        assert_eq!(evaluate_points(gt, &[&points], &none).unwrap_err().kind(), ErrorKind::Config);
    }
}
