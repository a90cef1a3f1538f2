//! From a ground truth and a predicted mesh to a report.

use super::metrics::{Metrics, Samples, compare_samples, compare_surfaces};
use crate::error::{Error, ErrorKind};
use crate::geometry::{Normalizer, TriangleBvh, TriangleMesh, sample_surface};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

/// What the prediction is held against.
#[derive(Clone, Copy, Debug)]
pub enum GroundTruth<'a> {
    /// A mesh, which is sampled.
    Mesh(&'a TriangleMesh),
    /// Points on the surface, used as they are (a random subset if there are more than asked for).
    Cloud {
        /// Positions, n x 3.
        points: &'a [[f32; 3]],
        /// Unit normals, n x 3.
        normals: Option<&'a [[f32; 3]]>,
    },
}

/// The frame that distances and thresholds are measured in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Frame {
    /// The frame of the files.
    AsIs,
    /// The ground truth's bounding box is scaled so that its longest side is 1, and the prediction with it, so that
    /// numbers and thresholds mean the same for every shape.
    #[default]
    GroundTruthUnit,
}

/// How to compare.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Samples of each surface; 100,000 is usual for shapes, 1,000,000 for scenes.
    pub samples: usize,
    /// Seed of the samples.
    pub seed: u64,
    /// Threshold of the F-score, in units of `frame`.
    pub tau: f64,
    /// The frame of the numbers.
    pub frame: Frame,
    /// Also measure from samples to triangles, without a sampling floor (mesh ground truth only).
    pub surface: bool,
    /// Also compare the ground truth with a second sample of itself (mesh ground truth only).
    pub floor: bool,
}

impl Options {
    /// 100,000 samples, threshold 0.01 in the ground truth's unit frame, with the sampling floor.
    pub fn shape() -> Self {
        Options {
            samples: 100_000,
            seed: 0,
            tau: 0.01,
            frame: Frame::GroundTruthUnit,
            surface: false,
            floor: true,
        }
    }

    /// As [`shape`](Self::shape) with 1,000,000 samples.
    pub fn scene() -> Self {
        Options { samples: 1_000_000, ..Self::shape() }
    }
}

impl Default for Options {
    fn default() -> Self {
        Self::shape()
    }
}

/// The result of [`evaluate`].
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Sample-to-sample metrics, in units of the frame.
    pub metrics: Metrics,
    /// Sample-to-triangle metrics, if asked for and if the ground truth is a mesh.
    pub surface: Option<Metrics>,
    /// What a perfect prediction would score in `metrics`, if asked for and if the ground truth is a mesh.
    pub floor: Option<Metrics>,
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
/// is said), [`ErrorKind::Config`] if the number of samples is 0 or the threshold is not positive.
pub fn evaluate(gt: GroundTruth<'_>, pred: &TriangleMesh, options: &Options) -> Result<Report, Error> {
    if options.samples == 0 {
        return Err(Error::new(ErrorKind::Config, "0 samples")
            .at_element("option samples")
            .advise("ask for at least 1"));
    }
    if !(options.tau > 0.0 && options.tau.is_finite()) {
        return Err(Error::new(ErrorKind::Config, format!("threshold {} is not positive", options.tau))
            .at_element("option tau"));
    }
    if pred.faces.is_empty() {
        return Err(Error::new(ErrorKind::NoSurface, "the prediction has no face"));
    }
    let in_gt = |e: Error| Error::new(e.kind(), "unusable ground truth").caused_by(e);
    let in_pred = |e: Error| Error::new(e.kind(), "unusable prediction").caused_by(e);

    let frame = match options.frame {
        Frame::AsIs => Normalizer::identity(),
        Frame::GroundTruthUnit => match gt {
            // Only vertices in use: a stray one would change the scale.
            GroundTruth::Mesh(mesh) => Normalizer::of(&corners(mesh).map_err(in_gt)?),
            GroundTruth::Cloud { points, .. } => Normalizer::of(points),
        }
        .map_err(in_gt)?,
    };
    let moved =
        |mesh: &TriangleMesh| TriangleMesh { verts: frame.forward(&mesh.verts), faces: mesh.faces.clone() };
    // Seeds two apart, so that the next seed of a caller does not share a stream with this one.
    let seed = |i: u64| options.seed.wrapping_mul(3).wrapping_add(i);

    let pred = moved(pred);
    let pred_samples = sample_surface(&pred, options.samples, seed(1)).map_err(in_pred)?;
    let pred_side = Samples::new(&pred_samples.points, Some(&pred_samples.normals));
    match gt {
        GroundTruth::Mesh(mesh) => {
            let mesh = moved(mesh);
            let samples = sample_surface(&mesh, options.samples, seed(0)).map_err(in_gt)?;
            let gt_side = Samples::new(&samples.points, Some(&samples.normals));
            let floor = if options.floor {
                let again = sample_surface(&mesh, options.samples, seed(2)).map_err(in_gt)?;
                let again = Samples::new(&again.points, Some(&again.normals));
                Some(compare_samples(again, gt_side, options.tau))
            } else {
                None
            };
            let surface = if options.surface {
                let gt_bvh = TriangleBvh::new(&mesh).map_err(in_gt)?;
                let pred_bvh = TriangleBvh::new(&pred).map_err(in_pred)?;
                Some(compare_surfaces((pred_side, &pred_bvh), (gt_side, &gt_bvh), options.tau))
            } else {
                None
            };
            Ok(Report {
                metrics: compare_samples(pred_side, gt_side, options.tau),
                surface,
                floor,
                scale: frame.scale(),
                gt_samples: options.samples,
                pred_samples: options.samples,
            })
        }
        GroundTruth::Cloud { points, normals } => {
            // Checked here in every frame, so that a bad point is an error and not a panic further down.
            crate::geometry::Bounds::of(points).map_err(in_gt)?;
            let (points, normals) = subset(&frame.forward(points), normals, options.samples, seed(0));
            let gt_side = Samples::new(&points, normals.as_deref());
            Ok(Report {
                metrics: compare_samples(pred_side, gt_side, options.tau),
                surface: None,
                floor: None,
                scale: frame.scale(),
                gt_samples: points.len(),
                pred_samples: options.samples,
            })
        }
    }
}

/// The corner positions of all faces, with repetition.
fn corners(mesh: &TriangleMesh) -> Result<Vec<[f32; 3]>, Error> {
    let corner = |(f, &v): (usize, &u32)| {
        mesh.verts.get(v as usize).copied().ok_or_else(|| {
            Error::new(ErrorKind::Data, format!("vertex {v} of {} does not exist", mesh.verts.len()))
                .at_element(format!("face {}", f / 3))
                .advise("repair the mesh")
        })
    };
    mesh.faces.as_flattened().iter().enumerate().map(corner).collect()
}

/// `count` of the points with their normals, drawn without repetition; all of them in order if there are no more.
fn subset(
    points: &[[f32; 3]],
    normals: Option<&[[f32; 3]]>,
    count: usize,
    seed: u64,
) -> (Vec<[f32; 3]>, Option<Vec<[f32; 3]>>) {
    let mut index: Vec<usize> = (0..points.len()).collect();
    if count < index.len() {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for i in 0..count {
            let j = rng.random_range(i..index.len());
            index.swap(i, j);
        }
        index.truncate(count);
    }
    let pick = |all: &[[f32; 3]]| index.iter().map(|&i| all[i]).collect();
    (pick(points), normals.map(pick))
}

#[cfg(test)]
mod tests {
    use super::*;

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

    fn options(samples: usize) -> Options {
        Options { samples, surface: true, ..Options::shape() }
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
        let as_is = Options { frame: Frame::AsIs, tau: 0.04, ..options(5000) };
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
        let (thin, normals) = subset(&s.points, Some(&s.normals), 1000, 1);
        let mut sorted = thin.clone();
        sorted.sort_by(|a, b| a.partial_cmp(b).unwrap());
        sorted.dedup();
        assert_eq!((sorted.len(), normals.unwrap().len()), (1000, 1000));
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
            let o = Options { frame, ..o };
            for mesh in [&bad, &missing] {
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
        for o in [Options { samples: 0, ..o }, Options { tau: f64::NAN, ..o }] {
            assert_eq!(evaluate(gt, &good, &o).unwrap_err().kind(), ErrorKind::Config);
        }
    }
}
