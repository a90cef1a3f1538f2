//! From a ground truth and a predicted mesh to a report.

use super::metrics::{Metrics, compare_samples, compare_surfaces};
use super::sides::{Frame, GroundTruth, Side, frame_of, moved, naming};
use crate::error::{Error, ErrorKind};
use crate::geometry::{TriangleBvh, TriangleMesh};

/// How surfaces are sampled and compared.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct CompareOptions {
    /// Samples of each mesh. Default 100,000; 1,000,000 is usual for scenes.
    pub samples: usize,
    /// Samples of the ground truth, if not as many as of the prediction; of a cloud, at most so many points are used.
    pub gt_samples: Option<usize>,
    /// Samples of a scan, if not as many as of the prediction.
    pub scan_samples: Option<usize>,
    /// Use every point of a ground truth or scan that is a cloud, however many there are.
    pub whole_clouds: bool,
    /// Seed of the samples.
    pub seed: u64,
    /// Threshold of the F-score, in units of `frame`. Default 0.01.
    pub tau: f64,
    /// The frame of the numbers.
    pub frame: Frame,
    /// Also measure from samples to triangles, without a sampling floor (mesh ground truth only).
    pub surface: bool,
    /// Also compare the ground truth with a second sample of itself (mesh ground truth only).
    pub floor: bool,
}

impl CompareOptions {
    /// 100,000 samples, threshold 0.01 in the ground truth's unit frame, with the sampling floor.
    pub fn shape() -> Self {
        CompareOptions {
            samples: 100_000,
            gt_samples: None,
            scan_samples: None,
            whole_clouds: false,
            seed: 0,
            tau: 0.01,
            frame: Frame::GroundTruthUnit,
            surface: false,
            floor: true,
        }
    }

    pub(super) fn check(&self) -> Result<(), Error> {
        for (name, count) in [
            ("samples", Some(self.samples)),
            ("gt_samples", self.gt_samples),
            ("scan_samples", self.scan_samples),
        ] {
            if count == Some(0) {
                return Err(Error::new(ErrorKind::Config, "0 samples")
                    .at_element(format!("option {name}"))
                    .advise("ask for at least 1"));
            }
        }
        if !(self.tau > 0.0 && self.tau.is_finite()) {
            return Err(Error::new(ErrorKind::Config, format!("threshold {} is not positive", self.tau))
                .at_element("option tau"));
        }
        Ok(())
    }

    /// Samples of the ground truth.
    pub(super) fn of_gt(&self) -> usize {
        self.gt_samples.unwrap_or(self.samples)
    }

    /// The seed of one set of samples: 0 ground truth, 1 prediction, 2 floor or scan. `seed` is multiplied by 3, so
    /// that neighbouring seeds share none of them.
    pub(super) fn seed_of(&self, i: u64) -> u64 {
        self.seed.wrapping_mul(3).wrapping_add(i)
    }

    /// The most points of a cloud that are used, of which `count` are asked for.
    pub(super) fn most(&self, count: usize) -> usize {
        if self.whole_clouds { usize::MAX } else { count }
    }
}

impl Default for CompareOptions {
    fn default() -> Self {
        Self::shape()
    }
}

/// The result of [`evaluate`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Report {
    /// Sample-to-sample metrics, in units of the frame.
    pub metrics: Metrics,
    /// Sample-to-triangle metrics, if asked for and if the ground truth is a mesh.
    pub surface: Option<Metrics>,
    /// What a perfect prediction would score in `metrics`, if asked for and if the ground truth is a mesh.
    pub floor: Option<Metrics>,
    /// The prediction against the scan in place of the ground truth, if there was one ([`evaluate_with_scan`]).
    pub scan: Option<Metrics>,
    /// Input units per unit of the frame (1 in [`Frame::AsIs`]).
    pub scale: f64,
    /// Samples of the ground truth.
    pub gt_samples: usize,
    /// Samples of the prediction.
    pub pred_samples: usize,
}

/// Compares `pred` with the ground truth; both must be in the same frame and are not aligned.
///
/// Ground truth, prediction and floor are sampled with three different seeds made from `options.seed`. The result is
/// the same for any thread count.
///
/// # Errors
/// [`ErrorKind::NoSurface`] if the prediction has no face, [`ErrorKind::Data`] if either surface is unusable (which one
/// is said), as where it is farther than 1e18 units of the frame from the origin, [`ErrorKind::Config`] if a number of
/// samples is 0 or the threshold is not positive.
///
/// # Panics
/// If a cloud has normals, but not one a point.
#[track_caller]
pub fn evaluate(gt: GroundTruth<'_>, pred: &TriangleMesh, options: &CompareOptions) -> Result<Report, Error> {
    evaluate_with_scan(gt, pred, None, options)
}

/// As [`evaluate`], and measures also between the prediction and the raw scan that it was made from.
///
/// Benchmarks of real scans print one-sided distances to the scan, which may have holes and noise, beside those to the
/// ground truth. The scan is in the frame of the ground truth and does not change that frame.
///
/// # Errors
/// As [`evaluate`].
///
/// # Panics
/// As [`evaluate`].
#[track_caller]
pub fn evaluate_with_scan(
    gt: GroundTruth<'_>,
    pred: &TriangleMesh,
    scan: Option<GroundTruth<'_>>,
    options: &CompareOptions,
) -> Result<Report, Error> {
    options.check()?;
    if pred.faces.is_empty() {
        return Err(Error::new(ErrorKind::NoSurface, "the prediction has no face"));
    }
    let (in_gt, in_pred) = (naming("unusable ground truth"), naming("unusable prediction"));

    let frame = frame_of(gt, options.frame).map_err(&in_gt)?;
    // The scan has the seed of the floor, with which it is never compared.
    let seed = |i: u64| options.seed_of(i);
    let gt_count = options.of_gt();
    let scan_count = options.scan_samples.unwrap_or(options.samples);

    let pred = moved(pred, &frame);
    let pred_side = Side::of_mesh(&pred, options.samples, seed(1)).map_err(&in_pred)?;
    let scan = match scan {
        None => None,
        Some(scan) => {
            let side = match scan {
                GroundTruth::Mesh(mesh) => Side::of_mesh(&moved(mesh, &frame), scan_count, seed(2)),
                GroundTruth::Cloud { points, normals } => {
                    Side::of_cloud(points, normals, &frame, options.most(scan_count), seed(2))
                }
            }
            .map_err(naming("unusable scan"))?;
            Some(compare_samples(pred_side.samples(), side.samples(), options.tau))
        }
    };
    let (gt_side, floor, surface) = match gt {
        GroundTruth::Mesh(mesh) => {
            let mesh = moved(mesh, &frame);
            let side = Side::of_mesh(&mesh, gt_count, seed(0)).map_err(&in_gt)?;
            let floor = if options.floor {
                let again = Side::of_mesh(&mesh, options.samples, seed(2)).map_err(&in_gt)?;
                Some(compare_samples(again.samples(), side.samples(), options.tau))
            } else {
                None
            };
            let surface = if options.surface {
                let gt_bvh = TriangleBvh::new(&mesh).map_err(&in_gt)?;
                let pred_bvh = TriangleBvh::new(&pred).map_err(&in_pred)?;
                let (a, b) = ((pred_side.samples(), &pred_bvh), (side.samples(), &gt_bvh));
                Some(compare_surfaces(a, b, options.tau))
            } else {
                None
            };
            (side, floor, surface)
        }
        GroundTruth::Cloud { points, normals } => {
            let most = options.most(gt_count);
            let side = Side::of_cloud(points, normals, &frame, most, seed(0)).map_err(&in_gt)?;
            (side, None, None)
        }
    };
    Ok(Report {
        metrics: compare_samples(pred_side.samples(), gt_side.samples(), options.tau),
        surface,
        floor,
        scan,
        scale: frame.scale(),
        gt_samples: gt_side.points.len(),
        pred_samples: pred_side.points.len(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::sample_surface;

    /// The surface of a box of the given sides with a corner at `at`, wound outwards.
    fn cuboid(at: [f32; 3], size: [f32; 3]) -> TriangleMesh {
        let verts = (0..8)
            .map(|i| std::array::from_fn(|a| at[a] + if i >> a & 1 == 1 { size[a] } else { 0.0 }))
            .collect();
        let quads: [[u32; 4]; 6] =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        TriangleMesh { verts, faces }
    }

    fn options(samples: usize) -> CompareOptions {
        CompareOptions { samples, surface: true, ..CompareOptions::shape() }
    }

    #[test]
    fn perfect_prediction_scores_the_floor() {
        let mesh = cuboid([3.0, 4.0, 5.0], [2.0, 1.0, 1.0]);
        let r = evaluate(GroundTruth::Mesh(&mesh), &mesh, &options(20_000)).unwrap();
        let floor = r.floor.unwrap();
        assert!((r.metrics.cd_l1() / floor.cd_l1() - 1.0).abs() < 0.02);
        // Area 2.5 in the unit frame: half the square root of area over samples.
        let expected = 0.5 * (2.5f64 / 20_000.0).sqrt();
        assert!((floor.cd_l1() / expected - 1.0).abs() < 0.05, "{} {expected}", floor.cd_l1());
        assert!(r.surface.unwrap().hd() < 1e-6);
        assert_eq!(r.scale, 2.0);
    }

    #[test]
    fn unit_frame_makes_numbers_independent_of_size_and_place() {
        let run = |s: f32, at: [f32; 3]| {
            let gt = cuboid(at, [4.0 * s, 2.0 * s, s]);
            let pred = cuboid(at, [4.0 * s, 2.0 * s, 1.25 * s]);
            evaluate(GroundTruth::Mesh(&gt), &pred, &options(5000)).unwrap()
        };
        let (small, large) = (run(1.0, [0.0; 3]), run(1024.0, [-2048.0; 3]));
        assert_eq!(large.metrics, small.metrics);
        assert_eq!(large.surface, small.surface);
        assert_eq!((large.scale, small.scale), (4096.0, 4.0));
        // A quarter of a quarter of the longest side.
        assert!((small.surface.unwrap().hd() - 0.0625).abs() < 1e-6);
        let as_is = CompareOptions { frame: Frame::AsIs, tau: 0.04, ..options(5000) };
        let gt = cuboid([0.0; 3], [4.0, 2.0, 1.0]);
        let raw = evaluate(GroundTruth::Mesh(&gt), &cuboid([0.0; 3], [4.0, 2.0, 1.25]), &as_is).unwrap();
        assert!((raw.metrics.cd_l1() - 4.0 * small.metrics.cd_l1()).abs() < 1e-5);
        assert_eq!(raw.metrics.fscore().f, small.metrics.fscore().f);
    }

    #[test]
    fn clouds_are_used_as_they_are_or_thinned() {
        let mesh = cuboid([0.0; 3], [1.0; 3]);
        let s = sample_surface(&mesh, 3000, 5).unwrap();
        let gt = GroundTruth::Cloud { points: &s.points, normals: Some(&s.normals) };
        let all = evaluate(gt, &mesh, &options(5000)).unwrap();
        assert_eq!((all.gt_samples, all.pred_samples), (3000, 5000));
        assert!(all.metrics.nc().unwrap() > 0.9 && all.floor.is_none() && all.surface.is_none());
        assert_eq!(evaluate(gt, &mesh, &options(1000)).unwrap().gt_samples, 1000);
    }

    #[test]
    fn counts_of_the_sides_are_independent() {
        let mesh = cuboid([0.0; 3], [1.0; 3]);
        let s = sample_surface(&mesh, 3000, 5).unwrap();
        let cloud = GroundTruth::Cloud { points: &s.points, normals: None };
        let count = |gt, o: CompareOptions| {
            let r = evaluate(gt, &mesh, &o).unwrap();
            (r.gt_samples, r.pred_samples)
        };
        let o = options(2000);
        assert_eq!(
            count(GroundTruth::Mesh(&mesh), CompareOptions { gt_samples: Some(700), ..o }),
            (700, 2000)
        );
        assert_eq!(count(cloud, o), (2000, 2000));
        assert_eq!(count(cloud, CompareOptions { gt_samples: Some(700), ..o }), (700, 2000));
        assert_eq!(count(cloud, CompareOptions { whole_clouds: true, ..o }), (3000, 2000));
        assert_eq!(count(cloud, CompareOptions { gt_samples: Some(9000), ..o }), (3000, 2000));
        // The floor is what a perfect prediction with its own number of samples would score.
        let o = CompareOptions { samples: 20_000, gt_samples: Some(500), ..o };
        let r = evaluate(GroundTruth::Mesh(&mesh), &mesh, &o).unwrap();
        assert!((r.metrics.cd_l1() / r.floor.unwrap().cd_l1() - 1.0).abs() < 0.05);
    }

    #[test]
    fn a_scan_is_measured_beside_the_ground_truth_in_its_frame() {
        // The scan is a cube, and the truth two of them in a row: a box twice as long as the unit frame.
        let mesh = cuboid([0.0; 3], [2.0, 1.0, 1.0]);
        let scan = cuboid([0.0; 3], [1.0, 1.0, 1.0]);
        let gt = GroundTruth::Mesh(&mesh);
        let o = CompareOptions { scan_samples: Some(4000), ..options(8000) };
        let r = evaluate_with_scan(gt, &mesh, Some(GroundTruth::Mesh(&scan)), &o).unwrap();
        let plain = evaluate(gt, &mesh, &o).unwrap();
        assert_eq!(plain, Report { scan: None, ..r.clone() });
        let direct = r.scan.unwrap();
        // From the far end to the scan it is half a unit; from the scan's inner wall to the box a quarter.
        assert!((direct.to_gt.max - 0.5).abs() < 0.03, "{}", direct.to_gt.max);
        assert!((direct.to_pred.max - 0.25).abs() < 0.03, "{}", direct.to_pred.max);
        let s = sample_surface(&scan, 3000, 5).unwrap();
        let cloud = GroundTruth::Cloud { points: &s.points, normals: None };
        let whole = CompareOptions { whole_clouds: true, ..o };
        let r = evaluate_with_scan(gt, &mesh, Some(cloud), &whole).unwrap();
        assert!((r.scan.unwrap().to_gt.max - 0.5).abs() < 0.03 && r.scan.unwrap().nc().is_none());
        let bad = GroundTruth::Cloud { points: &[], normals: None };
        let e = evaluate_with_scan(gt, &mesh, Some(bad), &o).unwrap_err();
        assert!(e.kind() == ErrorKind::Data && e.to_string().contains("scan"), "{e}");
    }

    #[test]
    fn normals_of_a_cloud_may_have_any_length() {
        let mesh = cuboid([0.0; 3], [1.0; 3]);
        let s = sample_surface(&mesh, 2000, 5).unwrap();
        let nc = |normals: &[[f32; 3]]| {
            let gt = GroundTruth::Cloud { points: &s.points, normals: Some(normals) };
            evaluate(gt, &mesh, &options(2000)).map(|r| r.metrics.nc().unwrap())
        };
        let long: Vec<_> = s.normals.iter().map(|n| n.map(|x| -7.5 * x)).collect();
        assert!((nc(&long).unwrap() - nc(&s.normals).unwrap()).abs() < 1e-6);
        assert_eq!(nc(&vec![[0.0; 3]; 2000]).unwrap(), 0.0);
        let mut bad = long;
        bad[7] = [f32::NAN, 0.0, 1.0];
        let e = nc(&bad).unwrap_err();
        let cause = std::error::Error::source(&e).unwrap().to_string();
        assert!(e.kind() == ErrorKind::Data && cause.contains("point 7"), "{e}: {cause}");
    }

    #[test]
    fn stray_vertices_do_not_change_the_frame() {
        let clean = cuboid([0.0; 3], [1.0, 1.0, 2.0]);
        let mut stray = clean.clone();
        stray.verts.push([50.0; 3]);
        let [a, b] = [&clean, &stray].map(|m| evaluate(GroundTruth::Mesh(m), &clean, &options(500)).unwrap());
        assert_eq!(a, b);
    }

    #[test]
    fn unusable_inputs_say_which_side() {
        let good = cuboid([0.0; 3], [1.0; 3]);
        let mut bad = good.clone();
        bad.verts[0] = [f32::NAN; 3];
        let mut missing = good.clone();
        missing.faces[2] = [0, 1, 99];
        let gt = GroundTruth::Mesh(&good);
        let empty = TriangleMesh::default();
        let o = options(10);
        assert_eq!(evaluate(gt, &empty, &o).unwrap_err().kind(), ErrorKind::NoSurface);
        for frame in [Frame::AsIs, Frame::GroundTruthUnit] {
            let o = CompareOptions { frame, ..o };
            let mut far = good.clone();
            far.verts.iter_mut().flatten().for_each(|x| *x *= 1e19);
            for mesh in [&bad, &missing, &far] {
                let e = evaluate(gt, mesh, &o).unwrap_err();
                assert!(e.kind() == ErrorKind::Data && e.to_string().contains("prediction"), "{e}");
            }
            let nan = [[0.0; 3], [1.0, 0.0, f32::NAN]];
            for gt in [
                GroundTruth::Mesh(&bad),
                GroundTruth::Mesh(&missing),
                GroundTruth::Mesh(&empty),
                GroundTruth::Cloud { points: &[], normals: None },
                GroundTruth::Cloud { points: &nan, normals: None },
            ] {
                let e = evaluate(gt, &good, &o).unwrap_err();
                assert!(e.kind() == ErrorKind::Data && e.to_string().contains("ground truth"), "{e}");
            }
        }
        for o in [
            CompareOptions { samples: 0, ..o },
            CompareOptions { gt_samples: Some(0), ..o },
            CompareOptions { scan_samples: Some(0), ..o },
            CompareOptions { tau: f64::NAN, ..o },
        ] {
            assert_eq!(evaluate(gt, &good, &o).unwrap_err().kind(), ErrorKind::Config);
        }
    }
}
