//! Figures of a parameterization: how evenly its codes fill the sphere, and how well S fills the gaps between points.
//!
//! The distance from S to Q or to the true surface is no good measure of S: it falls as S collapses onto the points.
//! These measures show a collapse: of the codes (they lie in one spot), of the points (S is few distinct places), and
//! of the map (far codes in one place).

use crate::error::{Error, ErrorKind};
use crate::geometry::vec3::{distance_sq, length};
use crate::geometry::{KdTree, distinct_places, nearest_distances, nearest_points, usable};
use rayon::prelude::*;

/// Points of S that are equal when rounded to multiples of this, in the working frame, are one place.
const PLACE: f64 = 1e-4;
/// Two codes count as far apart from this distance on, in radii of the spherical cap that has each point's share of the
/// sphere.
const FAR_RADII: f64 = 5.0;
/// About the most points of S whose near pairs are counted; of a larger S every second, third, ... point is taken.
const MAX_LOOKED_AT: usize = 4096;

/// The codes of all points of Q and of their patches, and the number of codes of the sphere that patches are taken
/// from.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereCodes {
    /// U(Q): the codes of the points on the unit sphere, n x 3.
    pub points: Vec<[f32; 3]>,
    /// P: the codes of the patches on the unit sphere, (n M) x 3, patch by patch, nearest first.
    pub patches: Vec<[f32; 3]>,
    /// The numbers of these codes among all codes of the sphere, n M indices below `sphere`.
    pub index: Vec<u32>,
    /// The number of codes m on the sphere that patches are taken from.
    pub sphere: usize,
}

/// The points Q with the S that a parameterization makes of them, and its codes.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterizedSurface {
    /// The points Q, n x 3.
    pub points: Vec<[f32; 3]>,
    /// S, i x 3, in the frame of Q; with codes patch by patch, so that i = n M.
    pub surface: Vec<[f32; 3]>,
    /// The codes; none for maps other than [`Parameterization::Bsp`](super::Parameterization::Bsp).
    pub codes: Option<SphereCodes>,
}

/// How well S covers Q and, by its codes, the sphere. Lengths are in the frame of Q: for the figures
/// of a run that is the working frame, in which the longest side of the input is 1.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Coverage {
    /// Points n of Q.
    pub points: usize,
    /// Points i of S.
    pub surface: usize,
    /// Distinct places among the points of S, rounded to 1e-4. As many as Q has, or fewer, mean that S adds nothing.
    pub distinct: usize,
    /// The mean distance from a point of Q to the nearest of S.
    pub q_to_s: f64,
    /// The mean distance from a point of S to the nearest of Q; about 0 where S has collapsed onto the points.
    pub s_to_q: f64,
    /// The figures of the codes, if the parameterization has codes.
    pub codes: Option<CodeCoverage>,
}

/// How well the codes cover the sphere, and whether the map back to space keeps them apart.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct CodeCoverage {
    /// The length of the mean code of the points: 0 where they are spread evenly, 1 where all are in one spot.
    pub mean_code: f64,
    /// Codes m on the sphere.
    pub sphere: usize,
    /// How many of the sphere's codes are in at least one patch.
    pub used: usize,
    /// Pairs of points of S in one place. Two points of S are such a pair if they are closer to each other than the
    /// centre of the first one's patch is to the nearest other point of Q. Counted both ways, and in a large S from
    /// every second, third, ... point only.
    pub near_pairs: usize,
    /// How many of these pairs have codes that are far apart: by more than five times 2 / sqrt(n), the radius of a cap
    /// with an n-th of the sphere, which is what a patch has where the patches tile the sphere.
    pub folded_pairs: usize,
}

impl Coverage {
    /// The share of S that is distinct, 0 to 1: `distinct` over `surface`. S that repeats Q has 1 / M.
    pub fn distinct_share(&self) -> f64 {
        self.distinct as f64 / self.surface as f64
    }
}

impl CodeCoverage {
    /// The share of the sphere's codes that are in some patch, 0 to 1.
    ///
    /// It cannot exceed n M / m, which is 1 over [`BspConfig::code_density`](super::BspConfig::code_density): all of a
    /// sphere of n M codes, a seventeenth of one of 50,000 for 300 points. Codes that lie at random use about two
    /// thirds of n M.
    pub fn evenness(&self) -> f64 {
        self.used as f64 / self.sphere as f64
    }

    /// The share of the pairs of points of S in one place whose codes are far apart, 0 to 1: 0 for a map that is one to
    /// one, more where S lies folded upon itself. `None` if no two points of S are in one place.
    ///
    /// It means little where the codes have collapsed ([`mean_code`](Self::mean_code) near 1), as none are far apart
    /// then, nor up to 25 points, where nothing on the sphere is so far apart.
    pub fn folded(&self) -> Option<f64> {
        (self.near_pairs > 0).then(|| self.folded_pairs as f64 / self.near_pairs as f64)
    }
}

impl ParameterizedSurface {
    /// How well S covers Q, and the codes the sphere. The same for any number of threads.
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if Q or S is empty, or a coordinate of either, or of a code, is not finite or beyond 1e18.
    ///
    /// # Panics
    /// If there are codes, but not one a point, or not patches of one size for all points with one code and one index a
    /// point of S.
    #[track_caller]
    pub fn coverage(&self) -> Result<Coverage, Error> {
        let (n, i) = (self.points.len(), self.surface.len());
        check("the set of points Q", &self.points)?;
        check("the parameterized surface", &self.surface)?;
        let codes = match &self.codes {
            None => None,
            Some(codes) => {
                let fits = codes.points.len() == n && i.is_multiple_of(n) && codes.patches.len() == i;
                assert!(
                    fits && codes.index.len() == i,
                    "coverage: {n} points, {i} of S, {} codes, {} in patches, {} indices",
                    codes.points.len(),
                    codes.patches.len(),
                    codes.index.len()
                );
                check("the codes of the points", &codes.points)?;
                check("the codes of the patches", &codes.patches)?;
                let [near_pairs, folded_pairs] = near_pairs(&self.points, &self.surface, &codes.patches);
                Some(CodeCoverage {
                    mean_code: mean_code(&codes.points),
                    sphere: codes.sphere,
                    used: used(&codes.index),
                    near_pairs,
                    folded_pairs,
                })
            }
        };
        Ok(Coverage {
            points: n,
            surface: i,
            distinct: distinct_places(&self.surface, PLACE),
            q_to_s: mean_distance(&self.points, &self.surface),
            s_to_q: mean_distance(&self.surface, &self.points),
            codes,
        })
    }
}

/// The colour of a code, red, green and blue from 0 to 255: (code + 1) / 2, so that near codes look alike.
///
/// ```
/// use bijective_sdf::bsp::code_colour;
///
/// assert_eq!(code_colour([0.0, 1.0, -1.0]), [128, 255, 0]);
/// ```
pub fn code_colour(code: [f32; 3]) -> [u8; 3] {
    // The cast keeps to 0 to 255 and turns what is not a number into 0.
    code.map(|x| (127.5 * (x + 1.0)).round() as u8)
}

fn check(what: &str, points: &[[f32; 3]]) -> Result<(), Error> {
    if points.is_empty() {
        return Err(Error::new(ErrorKind::Data, format!("{what} is empty, so there is nothing to cover")));
    }
    match points.iter().position(|p| !usable(p)) {
        None => Ok(()),
        Some(i) => Err(Error::new(ErrorKind::Data, format!("{what}: {:?} is not usable", points[i]))
            .at_element(format!("point {i}"))
            .advise("coordinates must be finite and below 1e18")),
    }
}

/// The length of the mean of the codes (n x 3).
fn mean_code(codes: &[[f32; 3]]) -> f64 {
    let mut sum = [0.0f64; 3];
    for code in codes {
        sum.iter_mut().zip(code).for_each(|(sum, &x)| *sum += f64::from(x));
    }
    length(sum) / codes.len() as f64
}

/// How many different indices there are.
fn used(index: &[u32]) -> usize {
    let mut index = index.to_vec();
    index.sort_unstable();
    index.dedup();
    index.len()
}

/// The mean distance from each of `from` (n x 3) to the nearest of `to` (m x 3).
fn mean_distance(from: &[[f32; 3]], to: &[[f32; 3]]) -> f64 {
    let (_, dist_sq) = nearest_points(from, to);
    dist_sq.iter().map(|&d| f64::from(d).sqrt()).sum::<f64>() / from.len() as f64
}

/// Pairs of points of S in one place, and those of them whose codes are far apart; see [`CodeCoverage`].
fn near_pairs(points: &[[f32; 3]], surface: &[[f32; 3]], codes: &[[f32; 3]]) -> [usize; 2] {
    let n = points.len();
    if n < 2 {
        return [0; 2];
    }
    let patch = surface.len() / n;
    let nearest = nearest_distances(points);
    let far_sq = (2.0 * FAR_RADII / (n as f64).sqrt()).powi(2);
    let tree = KdTree::new(surface);
    let step = surface.len().div_ceil(MAX_LOOKED_AT);
    let of = |i: usize| {
        let near = tree.within(surface[i], nearest[i / patch] as f32).into_iter().map(|(j, _)| j as usize);
        let near: Vec<usize> = near.filter(|&j| j != i).collect();
        let folded = near.iter().filter(|&&j| distance_sq(codes[i], codes[j]) > far_sq).count();
        [near.len(), folded]
    };
    // Whole numbers, so their sum does not depend on the order.
    (0..surface.len())
        .into_par_iter()
        .step_by(step)
        .map(of)
        .reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fibonacci_sphere;
    use crate::ops::testing::normal;
    use proptest::prelude::*;

    /// Points on a sphere of radius 0.5 whose codes are its directions: S and the patches are those of the definition.
    fn spread(n: usize, patch: usize) -> ParameterizedSurface {
        let directions = fibonacci_sphere(n);
        let sphere = fibonacci_sphere(n * patch);
        let index = KdTree::new(&sphere).k_nearest(&directions, patch);
        let patches: Vec<[f32; 3]> = index.iter().map(|&c| sphere[c as usize]).collect();
        let half = |p: &[f32; 3]| p.map(|x| 0.5 * x);
        ParameterizedSurface {
            points: directions.iter().map(half).collect(),
            surface: patches.iter().map(half).collect(),
            codes: Some(SphereCodes { points: directions, patches, index, sphere: n * patch }),
        }
    }

    /// Unit rows, at random.
    fn directions(n: usize, seed: u64) -> Vec<[f32; 3]> {
        let mut rows = normal(&[n, 3], seed).to_points();
        for row in &mut rows {
            let length = row.iter().map(|x| x * x).sum::<f32>().sqrt();
            row.iter_mut().for_each(|x| *x /= length);
        }
        rows
    }

    /// Everything by looking at all pairs.
    fn twin(p: &ParameterizedSurface) -> Coverage {
        let d = |a: [f32; 3], b: [f32; 3]| (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
        let mean = |from: &[[f32; 3]], to: &[[f32; 3]]| {
            let nearest = |a: &[f32; 3]| to.iter().map(|b| d(*a, *b)).fold(f64::INFINITY, f64::min);
            from.iter().map(nearest).sum::<f64>() / from.len() as f64
        };
        let (n, i) = (p.points.len(), p.surface.len());
        let place = |s: &[f32; 3]| s.map(|x| (f64::from(x) / 1e-4).round_ties_even() as i64);
        let places: std::collections::BTreeSet<[i64; 3]> = p.surface.iter().map(place).collect();
        let codes = p.codes.as_ref().map(|codes| {
            let mut near = 0;
            let mut folded = 0;
            for a in 0..i {
                let of = a / (i / n);
                let others = (0..n).filter(|&b| b != of).map(|b| d(p.points[of], p.points[b]));
                let nearest = others.fold(f64::INFINITY, f64::min);
                for b in (0..i).filter(|&b| b != a && n > 1 && d(p.surface[a], p.surface[b]) <= nearest) {
                    near += 1;
                    folded += usize::from(d(codes.patches[a], codes.patches[b]) > 10.0 / (n as f64).sqrt());
                }
            }
            let sum = codes.points.iter().fold([0.0; 3], |s, c| [0, 1, 2].map(|k| s[k] + f64::from(c[k])));
            CodeCoverage {
                mean_code: sum.iter().map(|x| x * x).sum::<f64>().sqrt() / n as f64,
                sphere: codes.sphere,
                used: (0..codes.sphere as u32).filter(|c| codes.index.contains(c)).count(),
                near_pairs: near,
                folded_pairs: folded,
            }
        });
        Coverage {
            points: n,
            surface: i,
            distinct: places.len(),
            q_to_s: mean(&p.points, &p.surface),
            s_to_q: mean(&p.surface, &p.points),
            codes,
        }
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-6 * (1.0 + b.abs())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn small_sets_equal_the_twin(n in 1usize..40, patch in 1usize..6, crowded: bool, seed: u64) {
            let points = normal(&[n, 3], seed).to_points();
            let mut surface = normal(&[n * patch, 3], seed ^ 1).to_points();
            if crowded {
                // A few places, in each of which many points lie.
                surface.iter_mut().flatten().for_each(|x| *x = x.round());
            }
            let sphere = fibonacci_sphere(2 * n * patch);
            let index: Vec<u32> =
                (0..n * patch).map(|i| (i as u64 * 7 % (2 * n * patch) as u64) as u32 / 3).collect();
            let codes = SphereCodes {
                points: directions(n, seed ^ 2),
                patches: index.iter().map(|&i| sphere[i as usize]).collect(),
                index,
                sphere: sphere.len(),
            };
            for codes in [None, Some(codes)] {
                let p = ParameterizedSurface { points: points.clone(), surface: surface.clone(), codes };
                let (got, want) = (p.coverage().unwrap(), twin(&p));
                prop_assert_eq!((got.points, got.surface, got.distinct), (n, n * patch, want.distinct));
                prop_assert!(near(got.q_to_s, want.q_to_s) && near(got.s_to_q, want.s_to_q), "{:?} {:?}", got, want);
                if let (Some(got), Some(want)) = (got.codes, want.codes) {
                    prop_assert!(near(got.mean_code, want.mean_code), "{:?} {:?}", got, want);
                    prop_assert_eq!(CodeCoverage { mean_code: want.mean_code, ..got }, want);
                }
            }
        }
    }

    #[test]
    fn codes_that_are_spread_cover_the_sphere_and_their_map_is_one_to_one() {
        let p = spread(300, 10);
        let coverage = p.coverage().unwrap();
        let codes = coverage.codes.unwrap();
        assert!(codes.mean_code < 0.01 && codes.evenness() > 0.8, "{codes:?}");
        assert!(codes.near_pairs > 3000 && codes.folded() == Some(0.0), "{codes:?}");
        // No more places than codes in use.
        assert_eq!(coverage.distinct, codes.used);
        assert!(coverage.q_to_s < 0.5 * coverage.s_to_q && coverage.s_to_q < 0.1, "{coverage:?}");
    }

    #[test]
    fn codes_in_one_spot_are_seen() {
        let mut p = spread(300, 10);
        let codes = p.codes.as_mut().unwrap();
        let (first, patch): (Vec<u32>, Vec<[f32; 3]>) =
            (codes.index[..10].to_vec(), codes.patches[..10].to_vec());
        let spot = codes.points[0];
        codes.points.fill(spot);
        codes.index.chunks_mut(10).for_each(|c| c.copy_from_slice(&first));
        codes.patches.chunks_mut(10).for_each(|c| c.copy_from_slice(&patch));
        let found = p.coverage().unwrap().codes.unwrap();
        assert!((found.mean_code - 1.0).abs() < 1e-6, "{found:?}");
        assert_eq!((found.used, found.evenness()), (10, 10.0 / 3000.0));
    }

    #[test]
    fn a_surface_that_repeats_the_points_is_seen() {
        let mut p = spread(300, 10);
        let repeated: Vec<[f32; 3]> = p.points.iter().flat_map(|&q| [q; 10]).collect();
        p.surface = repeated;
        let coverage = p.coverage().unwrap();
        assert_eq!((coverage.distinct, coverage.distinct_share()), (300, 0.1));
        assert_eq!((coverage.q_to_s, coverage.s_to_q), (0.0, 0.0));
    }

    #[test]
    fn a_fold_is_seen() {
        // The lower half of S lies on the upper one, and so do codes that are far apart.
        let mut p = spread(300, 10);
        p.surface.iter_mut().for_each(|s| s[2] = s[2].abs());
        let codes = p.coverage().unwrap().codes.unwrap();
        let folded = codes.folded().unwrap();
        assert!((0.3..0.6).contains(&folded), "{codes:?}");
    }

    #[test]
    fn the_number_of_threads_changes_nothing() {
        // More than are looked at one by one.
        let p = spread(700, 10);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| p.coverage().unwrap())
        };
        assert_eq!(run(1), run(3));
        assert_eq!(run(1).codes.unwrap().folded(), Some(0.0));
    }

    #[test]
    fn what_cannot_be_measured_is_refused() {
        let good = spread(30, 3);
        let mut nan = good.clone();
        nan.surface[7][1] = f32::NAN;
        let error = nan.coverage().unwrap_err();
        assert!(error.kind() == ErrorKind::Data && error.to_string().contains("point 7"), "{error}");
        let mut nan = good.clone();
        nan.codes.as_mut().unwrap().points[2] = [f32::INFINITY; 3];
        assert!(nan.coverage().unwrap_err().to_string().contains("codes of the points"));
        let empty = ParameterizedSurface { surface: Vec::new(), codes: None, ..good };
        assert!(empty.coverage().unwrap_err().to_string().contains("empty"));
    }

    #[test]
    fn colours_keep_to_their_range() {
        assert_eq!(code_colour([-1.0, 0.2, 1.0]), [0, 153, 255]);
        assert_eq!(code_colour([-1.1, f32::NAN, 2.0]), [0, 0, 255]);
    }
}
