//! Distances, normal consistency and F-scores between two surfaces.

use crate::geometry::{PointTree, TriangleBvh};

/// Points with or without unit normals.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a> {
    /// Positions, n x 3.
    pub points: &'a [[f32; 3]],
    /// Unit normals, n x 3; their sign does not matter.
    pub normals: Option<&'a [[f32; 3]]>,
}

impl<'a> Samples<'a> {
    /// Samples from positions (n x 3) and, if known, unit normals (n x 3).
    ///
    /// # Panics
    /// If there are no points or if the two lists differ in length.
    #[track_caller]
    pub fn new(points: &'a [[f32; 3]], normals: Option<&'a [[f32; 3]]>) -> Self {
        assert!(!points.is_empty(), "Samples::new: no points");
        if let Some(n) = normals {
            assert!(n.len() == points.len(), "Samples::new: {} points, {} normals", points.len(), n.len());
        }
        Samples { points, normals }
    }
}

/// What is measured from one set of samples to the other surface. Distances in the frame's units.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Directed {
    /// Mean distance.
    pub mean: f64,
    /// Mean squared distance.
    pub mean_sq: f64,
    /// Largest distance.
    pub max: f64,
    /// Mean `|n . n'|` between a sample's normal and that at its nearest neighbour, if both sides have normals.
    pub normal: Option<f64>,
    /// Mean `|n_x n'_x| + |n_y n'_y| + |n_z n'_z|`, see [`Metrics::nc_ntps`].
    pub normal_ntps: Option<f64>,
    /// Fraction of the samples nearer than half, once and twice the threshold.
    pub within: [f64; 3],
}

/// Precision, recall and their harmonic mean at one threshold, each from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct FScore {
    /// The threshold, in the frame's units.
    pub tau: f64,
    /// Fraction of the prediction nearer than `tau` to the ground truth.
    pub precision: f64,
    /// Fraction of the ground truth nearer than `tau` to the prediction.
    pub recall: f64,
    /// `2 precision recall / (precision + recall)`, 0 if both are 0.
    pub f: f64,
}

/// The comparison of a prediction with a ground truth, in both directions.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Metrics {
    /// From the prediction to the ground truth (accuracy).
    pub to_gt: Directed,
    /// From the ground truth to the prediction (completeness).
    pub to_pred: Directed,
    /// The threshold of the F-score, in the frame's units.
    pub tau: f64,
}

impl Metrics {
    /// Mean distance from the prediction to the ground truth.
    pub fn acc(&self) -> f64 {
        self.to_gt.mean
    }

    /// Mean distance from the ground truth to the prediction.
    pub fn comp(&self) -> f64 {
        self.to_pred.mean
    }

    /// `(acc + comp) / 2`. Tables of the literature print 10 times this, in a unit-cube frame.
    pub fn cd_l1(&self) -> f64 {
        0.5 * (self.to_gt.mean + self.to_pred.mean)
    }

    /// Half the sum of the two mean squared distances. Tables of the literature print 100 times this.
    pub fn cd_l2(&self) -> f64 {
        0.5 * (self.to_gt.mean_sq + self.to_pred.mean_sq)
    }

    /// Hausdorff distance: the largest distance in either direction.
    pub fn hd(&self) -> f64 {
        self.to_gt.max.max(self.to_pred.max)
    }

    /// Normal consistency: the mean of `|n . n'|` over both directions, halved. 1 is best; random normals score 0.5.
    pub fn nc(&self) -> Option<f64> {
        Some(0.5 * (self.to_gt.normal? + self.to_pred.normal?))
    }

    /// Normal consistency as some published code computes it, with the absolute value of each product of components
    /// before the sum. Random normals score 0.75. Only for comparison with tables made that way.
    pub fn nc_ntps(&self) -> Option<f64> {
        Some(0.5 * (self.to_gt.normal_ntps? + self.to_pred.normal_ntps?))
    }

    /// The F-score at the threshold.
    pub fn fscore(&self) -> FScore {
        self.fscores()[1]
    }

    /// The F-scores at half, once and twice the threshold.
    pub fn fscores(&self) -> [FScore; 3] {
        std::array::from_fn(|i| {
            let (precision, recall) = (self.to_gt.within[i], self.to_pred.within[i]);
            let sum = precision + recall;
            let f = if sum > 0.0 { 2.0 * precision * recall / sum } else { 0.0 };
            FScore { tau: taus(self.tau)[i], precision, recall, f }
        })
    }
}

/// Compares samples of a prediction with samples of a ground truth by nearest neighbours among the samples.
///
/// Two independent sets of `n` samples of one surface of area `A` are about `sqrt(A / n) / 2` apart, so a perfect
/// prediction does not score 0; [`compare_surfaces`] has no such floor. `tau` is the threshold of the F-score
/// (distances strictly below it count), in the units of the points. Sums are f64 in index order.
///
/// # Panics
/// If a point is not finite or if `tau` is not positive.
#[track_caller]
pub fn compare_samples(pred: Samples<'_>, gt: Samples<'_>, tau: f64) -> Metrics {
    let tree = |s: Samples<'_>| PointTree::new(s.points);
    let (pred_tree, gt_tree) = rayon::join(|| tree(pred), || tree(gt));
    let to = |from: Samples<'_>, to: Samples<'_>, from_tree: &PointTree, to_tree: &PointTree| {
        let (index, dist_sq) = to_tree.nearest(from_tree);
        let dist_sq = dist_sq.iter().map(|&d| f64::from(d));
        let normals = from.normals.zip(to.normals);
        directed(dist_sq, normals.map(|(a, b)| a.iter().zip(index.iter().map(|&i| b[i as usize]))), tau)
    };
    Metrics { to_gt: to(pred, gt, &pred_tree, &gt_tree), to_pred: to(gt, pred, &gt_tree, &pred_tree), tau }
}

/// Compares samples of each surface with the triangles of the other: exact distances, without a sampling floor.
///
/// Normals are compared with that of the nearest triangle. `tau` as in [`compare_samples`].
///
/// # Panics
/// If a point is not finite or if `tau` is not positive.
#[track_caller]
pub fn compare_surfaces(
    pred: (Samples<'_>, &TriangleBvh),
    gt: (Samples<'_>, &TriangleBvh),
    tau: f64,
) -> Metrics {
    let to = |from: Samples<'_>, to: &TriangleBvh| {
        let hits = to.nearest_all(from.points);
        let dist_sq = hits.iter().map(|h| h.dist_sq);
        let normals = from.normals.map(|n| n.iter().zip(hits.iter().map(|h| to.face_normal(h.face))));
        directed(dist_sq, normals, tau)
    };
    Metrics { to_gt: to(pred.0, gt.1), to_pred: to(gt.0, pred.1), tau }
}

fn taus(tau: f64) -> [f64; 3] {
    [0.5 * tau, tau, 2.0 * tau]
}

#[track_caller]
fn directed<'a>(
    dist_sq: impl ExactSizeIterator<Item = f64>,
    normals: Option<impl Iterator<Item = (&'a [f32; 3], [f32; 3])>>,
    tau: f64,
) -> Directed {
    assert!(tau > 0.0, "threshold {tau} of the F-score must be positive");
    let n = dist_sq.len() as f64;
    let (mut sum, mut sum_sq, mut max) = (0.0, 0.0, 0.0f64);
    let mut within = [0u64; 3];
    for d_sq in dist_sq {
        let d = d_sq.sqrt();
        sum += d;
        sum_sq += d_sq;
        max = max.max(d);
        for (count, t) in within.iter_mut().zip(taus(tau)) {
            *count += u64::from(d < t);
        }
    }
    let normal = normals.map(|pairs| {
        let (mut whole, mut parts) = (0.0, 0.0);
        for (a, b) in pairs {
            let products: [f64; 3] = std::array::from_fn(|k| f64::from(a[k]) * f64::from(b[k]));
            whole += products.iter().sum::<f64>().abs();
            parts += products.iter().map(|p| p.abs()).sum::<f64>();
        }
        (whole / n, parts / n)
    });
    Directed {
        mean: sum / n,
        mean_sq: sum_sq / n,
        max,
        normal: normal.map(|x| x.0),
        normal_ntps: normal.map(|x| x.1),
        within: within.map(|c| c as f64 / n),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{TriangleMesh, sample_surface};
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    fn grid(n: usize, z: f32) -> Vec<[f32; 3]> {
        (0..n * n).map(|i| [(i / n) as f32 / n as f32, (i % n) as f32 / n as f32, z]).collect()
    }

    fn square(z: f32) -> TriangleMesh {
        TriangleMesh {
            verts: vec![[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, z], [0.0, 1.0, z]],
            faces: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    #[test]
    fn identical_sets_are_perfect() {
        let points = grid(12, 0.5);
        let normals = vec![[0.0, 0.6, 0.8]; points.len()];
        let s = Samples::new(&points, Some(&normals));
        let m = compare_samples(s, s, 0.01);
        assert_eq!((m.acc(), m.comp(), m.cd_l1(), m.cd_l2(), m.hd()), (0.0, 0.0, 0.0, 0.0, 0.0));
        assert!((m.nc().unwrap() - 1.0).abs() < 1e-7 && (m.nc_ntps().unwrap() - 1.0).abs() < 1e-7);
        assert_eq!(m.fscores().map(|f| f.f), [1.0; 3]);
    }

    #[test]
    fn parallel_planes_are_their_distance_apart() {
        let (a, b) = (grid(20, 0.0), grid(20, 0.015625));
        let m = compare_samples(Samples::new(&a, None), Samples::new(&b, None), 0.01);
        assert_eq!((m.acc(), m.comp(), m.cd_l1(), m.hd()), (0.015625, 0.015625, 0.015625, 0.015625));
        assert_eq!(m.cd_l2(), 0.015625 * 0.015625);
        assert_eq!(m.fscores().map(|f| f.f), [0.0, 0.0, 1.0]);
        assert_eq!(m.fscores().map(|f| f.tau), [0.005, 0.01, 0.02]);
        assert_eq!((m.nc(), m.nc_ntps()), (None, None));

        let (sa, sb) = (square(0.0), square(0.015625));
        let pa = sample_surface(&sa, 5000, 1).unwrap();
        let pb = sample_surface(&sb, 5000, 2).unwrap();
        let m = compare_surfaces(
            (Samples::new(&pa.points, Some(&pa.normals)), &TriangleBvh::new(&sa).unwrap()),
            (Samples::new(&pb.points, Some(&pb.normals)), &TriangleBvh::new(&sb).unwrap()),
            0.01,
        );
        assert!((m.cd_l1() - 0.015625).abs() < 1e-9 && (m.hd() - 0.015625).abs() < 1e-9);
        assert_eq!(m.nc(), Some(1.0));
    }

    type Point = [f64; 3];

    fn wide(p: [f32; 3]) -> Point {
        p.map(f64::from)
    }

    fn dot(a: Point, b: Point) -> f64 {
        a.iter().zip(b).map(|(x, y)| x * y).sum()
    }

    fn minus(a: Point, b: Point) -> Point {
        std::array::from_fn(|k| a[k] - b[k])
    }

    /// Twin of one direction: from the distance and the normal at the other side of each sample, every figure by its
    /// definition.
    fn naive(found: &[(f64, Option<(Point, Point)>)], tau: f64) -> Directed {
        let n = found.len() as f64;
        let mean = |f: &dyn Fn(f64) -> f64| found.iter().map(|x| f(x.0)).sum::<f64>() / n;
        let normals: Option<Vec<(Point, Point)>> = found.iter().map(|x| x.1).collect();
        let agree = |f: &dyn Fn(Point, Point) -> f64| {
            normals.as_ref().map(|all| all.iter().map(|&(a, b)| f(a, b)).sum::<f64>() / n)
        };
        Directed {
            mean: mean(&|d| d),
            mean_sq: mean(&|d| d * d),
            max: found.iter().map(|x| x.0).fold(0.0, f64::max),
            normal: agree(&|a, b| dot(a, b).abs()),
            normal_ntps: agree(&|a, b| (0..3).map(|k| (a[k] * b[k]).abs()).sum()),
            within: [0.5, 1.0, 2.0].map(|s| mean(&|d| if d < s * tau { 1.0 } else { 0.0 })),
        }
    }

    fn naive_samples(from: Samples<'_>, to: Samples<'_>, tau: f64) -> Directed {
        let found: Vec<_> = (0..from.points.len())
            .map(|i| {
                let dist = |j: usize| {
                    let d = minus(wide(from.points[i]), wide(to.points[j]));
                    dot(d, d).sqrt()
                };
                let best = (0..to.points.len()).min_by(|&a, &b| dist(a).total_cmp(&dist(b))).unwrap();
                let normals = from.normals.zip(to.normals).map(|(a, b)| (wide(a[i]), wide(b[best])));
                (dist(best), normals)
            })
            .collect();
        naive(&found, tau)
    }

    /// The distance to a triangle: to its plane if the foot is inside, else to the nearest edge.
    fn to_triangle(p: Point, [a, b, c]: [Point; 3]) -> (f64, Point) {
        let cross = |u: Point, v: Point| -> Point {
            std::array::from_fn(|k| u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3])
        };
        let n = cross(minus(b, a), minus(c, a));
        let length = dot(n, n).sqrt();
        let inside =
            [(a, b), (b, c), (c, a)].iter().all(|&(u, v)| dot(cross(minus(v, u), minus(p, u)), n) >= 0.0);
        let edge = |(u, v): (Point, Point)| {
            let (e, w) = (minus(v, u), minus(p, u));
            let t = (dot(e, w) / dot(e, e)).clamp(0.0, 1.0);
            let d = minus(w, e.map(|x| t * x));
            dot(d, d).sqrt()
        };
        let dist = if inside {
            dot(minus(p, a), n).abs() / length
        } else {
            [(a, b), (b, c), (c, a)].map(edge).into_iter().fold(f64::INFINITY, f64::min)
        };
        (dist, n.map(|x| x / length))
    }

    fn naive_surface(from: Samples<'_>, to: &TriangleMesh, tau: f64) -> Directed {
        let found: Vec<_> = from
            .points
            .iter()
            .enumerate()
            .map(|(i, &p)| {
                let to_face = |f: &[u32; 3]| to_triangle(wide(p), f.map(|v| wide(to.verts[v as usize])));
                let best = to.faces.iter().map(to_face).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
                (best.0, from.normals.map(|n| (wide(n[i]), best.1)))
            })
            .collect();
        naive(&found, tau)
    }

    #[track_caller]
    fn close(got: &Directed, want: &Directed) {
        let figures = |d: &Directed| {
            let normals = [d.normal.unwrap_or(-1.0), d.normal_ntps.unwrap_or(-1.0)];
            [[d.mean, d.mean_sq, d.max].as_slice(), &normals, &d.within].concat()
        };
        for (g, w) in figures(got).iter().zip(figures(want)) {
            assert!((g - w).abs() < 2e-6, "{got:?}\n{want:?}");
        }
    }

    fn random_points(rng: &mut ChaCha8Rng, n: usize) -> Vec<[f32; 3]> {
        (0..n).map(|_| std::array::from_fn(|_| rng.random_range(-1.0f32..1.0))).collect()
    }

    fn random_normals(rng: &mut ChaCha8Rng, n: usize) -> Vec<[f32; 3]> {
        (0..n)
            .map(|_| {
                let z = rng.random_range(-1.0f32..1.0);
                let t = rng.random_range(0.0f32..std::f32::consts::TAU);
                let r = (1.0 - z * z).sqrt();
                [r * t.cos(), r * t.sin(), z]
            })
            .collect()
    }

    #[test]
    fn every_metric_of_samples_equals_its_definition() {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        for n in 1..=12 {
            for m in [1, 2, 5, 12, 40] {
                let (a, b) = (random_points(&mut rng, n), random_points(&mut rng, m));
                let (na, nb) = (random_normals(&mut rng, n), random_normals(&mut rng, m));
                let (a, b) = (Samples::new(&a, Some(&na)), Samples::new(&b, Some(&nb)));
                let tau = rng.random_range(0.1..1.5);
                let got = compare_samples(a, b, tau);
                let want =
                    Metrics { to_gt: naive_samples(a, b, tau), to_pred: naive_samples(b, a, tau), tau };
                close(&got.to_gt, &want.to_gt);
                close(&got.to_pred, &want.to_pred);
                let (p, q) = (want.to_gt, want.to_pred);
                let halves = [
                    (got.cd_l1(), (p.mean + q.mean) / 2.0),
                    (got.cd_l2(), (p.mean_sq + q.mean_sq) / 2.0),
                    (got.hd(), if p.max > q.max { p.max } else { q.max }),
                    (got.nc().unwrap(), (p.normal.unwrap() + q.normal.unwrap()) / 2.0),
                    (got.nc_ntps().unwrap(), (p.normal_ntps.unwrap() + q.normal_ntps.unwrap()) / 2.0),
                    (got.acc(), p.mean),
                    (got.comp(), q.mean),
                ];
                assert!(halves.iter().all(|(g, w)| (g - w).abs() < 2e-6), "{halves:?}");
                for (i, f) in got.fscores().iter().enumerate() {
                    let (p, r) = (p.within[i], q.within[i]);
                    let harmonic = if p > 0.0 && r > 0.0 { 2.0 / (1.0 / p + 1.0 / r) } else { 0.0 };
                    assert_eq!((f.precision, f.recall), (p, r));
                    assert!((f.f - harmonic).abs() < 1e-12 && f.tau == tau * [0.5, 1.0, 2.0][i]);
                }
            }
        }
    }

    #[test]
    fn every_metric_of_surfaces_equals_its_definition() {
        let mut rng = ChaCha8Rng::seed_from_u64(12);
        for n in 1..=12 {
            let soup = |rng: &mut ChaCha8Rng| TriangleMesh {
                verts: random_points(rng, 3 * n),
                faces: (0..n as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect(),
            };
            let (a, b) = (soup(&mut rng), soup(&mut rng));
            let (pa, pb) = (sample_surface(&a, 30, 1).unwrap(), sample_surface(&b, 20, 2).unwrap());
            let (sa, sb) =
                (Samples::new(&pa.points, Some(&pa.normals)), Samples::new(&pb.points, Some(&pb.normals)));
            let (ta, tb) = (TriangleBvh::new(&a).unwrap(), TriangleBvh::new(&b).unwrap());
            let got = compare_surfaces((sa, &ta), (sb, &tb), 0.3);
            close(&got.to_gt, &naive_surface(sa, &b, 0.3));
            close(&got.to_pred, &naive_surface(sb, &a, 0.3));
        }
    }

    #[test]
    fn directions_are_not_mixed_up() {
        // The prediction covers a third of the ground truth: precise, not complete.
        let gt = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0]];
        let pred = [[0.0f32, 0.0, 0.0]];
        let m = compare_samples(Samples::new(&pred, None), Samples::new(&gt, None), 1.0);
        assert_eq!(m.acc(), 0.0);
        assert_eq!(m.comp(), 4.0 / 3.0);
        assert_eq!(m.cd_l2(), 0.5 * 10.0 / 3.0);
        assert_eq!(m.hd(), 3.0);
        let f = m.fscores();
        // Strictly below the threshold: the point at distance 1 counts at 2 only.
        assert_eq!(f.map(|f| f.precision), [1.0; 3]);
        assert_eq!(f.map(|f| f.recall), [1.0 / 3.0, 1.0 / 3.0, 2.0 / 3.0]);
        assert_eq!(m.fscore().f, 0.5);
    }

    #[test]
    fn random_normals_score_a_half_and_three_quarters() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut random = || random_normals(&mut rng, 20_000);
        let (points, na, nb) = (random(), random(), random());
        let m = compare_samples(Samples::new(&points, Some(&na)), Samples::new(&points, Some(&nb)), 0.01);
        assert!((m.nc().unwrap() - 0.5).abs() < 0.01, "{:?}", m.nc());
        assert!((m.nc_ntps().unwrap() - 0.75).abs() < 0.01, "{:?}", m.nc_ntps());
    }

    #[test]
    fn flipped_normals_count_as_equal() {
        let points = grid(3, 0.0);
        let (up, down) = (vec![[0.0, 0.6, 0.8]; 9], vec![[0.0, -0.6, -0.8]; 9]);
        let m = compare_samples(Samples::new(&points, Some(&up)), Samples::new(&points, Some(&down)), 0.1);
        assert!((m.nc().unwrap() - 1.0).abs() < 1e-7);
    }

    #[test]
    #[should_panic(expected = "2 points, 1 normals")]
    fn normals_must_match_points() {
        Samples::new(&[[0.0; 3]; 2], Some(&[[0.0, 0.0, 1.0]]));
    }
}
