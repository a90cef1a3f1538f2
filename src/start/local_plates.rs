//! The surface of least bending for any number of points: thin plates through overlapping groups of points, blended.
//!
//! One plate through n points costs O(n^3). Around a place only the points nearby matter. So the points are covered by
//! overlapping balls, each around one of the points and as large as its hundred nearest; every ball gets the plate
//! through its own points ([`System`]); and the plates are blended by weights that fall smoothly to 0 at the balls'
//! surfaces (a partition of unity, as Ohtake et al. 2003, "Multi-level partition of unity implicits"). The cost is O(n)
//! systems of fixed size.
//!
//! Each ball looks for the normals that bend its own plate least. One set of normals for all, at each point the mean of
//! what the balls around it find, comes out the same (`benches/accuracy.md`).

use super::forecast::{Forecast, covariances, forecasts};
use super::plate::{System, ThinPlate, directions};
use crate::error::Error;
use crate::geometry::vec3::distance;
use crate::geometry::{KdTree, neighbour_spacing};
use rayon::prelude::*;

/// Points of a ball, its centre among them.
const GROUP: usize = 100;
/// A point within this share of a ball's radius from its centre needs no ball of its own.
const COVERED: f64 = 0.7;
/// The radius of a ball over the distance to its farthest point, so that this point's weight is not quite 0.
const MARGIN: f64 = 1.0001;
/// A place is near a point if it is within this many neighbour spacings of the point.
const REACH: f64 = 2.5;
/// Places evaluated at a time by one thread.
const CHUNK: usize = 256;

/// A ball around a point, in the frame of the points.
#[derive(Clone, Debug)]
struct Ball {
    centre: [f32; 3],
    radius: f64,
    /// The points that are in it, ascending by their distance from the centre.
    members: Vec<u32>,
}

impl Ball {
    /// The weight of the ball's plate at x: Wendland's function for three dimensions, twice differentiable, 1 at the
    /// centre and 0 from the radius on.
    fn weight(&self, x: [f32; 3]) -> f64 {
        let share = distance(x, self.centre) / self.radius;
        if share >= 1.0 { 0.0 } else { (1.0 - share).powi(4) * (4.0 * share + 1.0) }
    }

    /// The ball without its points.
    fn bare(&self) -> Self {
        Ball { members: Vec::new(), ..*self }
    }

    /// A place in the ball's own frame, where its radius is 1.
    fn local(&self, x: [f32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|k| (f64::from(x[k]) - f64::from(self.centre[k])) / self.radius)
    }

    /// Its points in its own frame.
    fn places(&self, points: &[[f32; 3]]) -> Vec<[f64; 3]> {
        self.members.iter().map(|&i| self.local(points[i as usize])).collect()
    }

    /// The unit directions of those of `all` (n x 3) that belong to its points, one after the other (3 values each).
    fn own(&self, all: &[[f32; 3]]) -> Vec<f64> {
        directions(&self.members.iter().map(|&i| all[i as usize]).collect::<Vec<_>>())
    }
}

/// A function that is 0 at given points, has about unit gradient there, and bends little; known near the points only.
#[derive(Clone, Debug)]
pub(crate) struct LocalPlates {
    /// The balls without their points, and the plate of each in the ball's own frame.
    plates: Vec<(Ball, ThinPlate)>,
    near: Near,
}

/// The balls that a place near a point can be in: for point i, `balls[first[i]..first[i + 1]]`, ascending.
#[derive(Clone, Debug)]
struct Near {
    first: Vec<usize>,
    balls: Vec<u32>,
}

impl LocalPlates {
    /// The functions for `points` (n x 3, distinct, working frame) from each of several guesses of the normals (each
    /// n x 3, outward, need not be exact; zero is no direction), in their order. The gradients at the points end near
    /// the guess, where the plates bend least.
    ///
    /// # Errors
    /// [`ErrorKind::Data`] if the points of a ball determine no plate.
    ///
    /// # Panics
    /// If there are no points, or a guess does not have one normal a point.
    #[track_caller]
    pub fn fit_each<N: AsRef<[[f32; 3]]> + Sync>(
        points: &[[f32; 3]],
        guesses: &[N],
    ) -> Result<Vec<Self>, Error> {
        for normals in guesses {
            check_normals(points, normals.as_ref());
        }
        let balls = cover(points, GROUP);
        let plates = |ball: &Ball| -> Result<Vec<ThinPlate>, Error> {
            let places = ball.places(points);
            let system = System::determined(&places)?;
            let plate =
                |guess: &N| system.interpolant(&places, &system.least_bending(ball.own(guess.as_ref())));
            Ok(guesses.iter().map(plate).collect())
        };
        let mut of_balls: Vec<_> = balls.par_iter().map(plates).collect::<Result<Vec<_>, Error>>()?;
        let near = Near::of(&balls, points);
        let one = |_: &N| {
            let plates = of_balls.iter_mut().map(|plates| plates.remove(0));
            LocalPlates { plates: balls.iter().map(Ball::bare).zip(plates).collect(), near: near.clone() }
        };
        Ok(guesses.iter().map(one).collect())
    }

    /// The function for one guess of the normals, as [`fit_each`](Self::fit_each), and the leave-one-out forecast at
    /// each point (n): that of the plate of the ball that the point weighs most in, without the point.
    ///
    /// # Errors
    /// As [`fit_each`](Self::fit_each).
    ///
    /// # Panics
    /// As [`fit_each`](Self::fit_each).
    #[track_caller]
    pub fn fit_with_forecasts(
        points: &[[f32; 3]],
        normals: &[[f32; 3]],
    ) -> Result<(Self, Vec<Forecast>), Error> {
        check_normals(points, normals);
        let balls = cover(points, GROUP);
        let plate = |ball: &Ball| -> Result<(ThinPlate, Vec<Forecast>), Error> {
            let places = ball.places(points);
            let system = System::determined(&places)?;
            let gradients = system.least_bending(ball.own(normals));
            let mut found = forecasts(&system, &covariances(&system), &gradients);
            for forecast in &mut found {
                // Into the frame of the points; slopes have no unit.
                forecast.error *= ball.radius;
                forecast.variance *= ball.radius * ball.radius;
            }
            Ok((system.interpolant(&places, &gradients), found))
        };
        let found: Vec<_> = balls.par_iter().map(plate).collect::<Result<Vec<_>, Error>>()?;
        let none = Forecast { error: f64::NAN, variance: f64::NAN, slope: f64::NAN };
        let mut best = vec![(0.0, none); points.len()];
        for (ball, (_, found)) in balls.iter().zip(&found) {
            for (&i, &forecast) in ball.members.iter().zip(found) {
                let weight = ball.weight(points[i as usize]);
                let (most, kept) = &mut best[i as usize];
                if weight > *most {
                    (*most, *kept) = (weight, forecast);
                }
            }
        }
        let plates = balls.iter().map(Ball::bare).zip(found.into_iter().map(|(plate, _)| plate)).collect();
        let plates = LocalPlates { plates, near: Near::of(&balls, points) };
        Ok((plates, best.into_iter().map(|(_, forecast)| forecast).collect()))
    }

    /// f at places `x` (m x 3): negative inside, and about the signed distance near the points. `nearest` (m) are the
    /// points nearest to each. NaN where no plate reaches: all within two and a half neighbour spacings of a point that
    /// is not alone do.
    ///
    /// # Panics
    /// If there is not one nearest point a place.
    #[track_caller]
    pub fn value(&self, x: &[[f32; 3]], nearest: &[u32]) -> Vec<f32> {
        assert!(x.len() == nearest.len(), "LocalPlates: {} places, {} nearest", x.len(), nearest.len());
        let mut out = vec![0.0; x.len()];
        let chunks = out.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK)).zip(nearest.par_chunks(CHUNK));
        chunks.for_each(|((out, x), nearest)| {
            for ((out, x), &i) in out.iter_mut().zip(x).zip(nearest) {
                *out = self.blended(*x, self.near.of_point(i)) as f32;
            }
        });
        out
    }

    /// The mean of the plates at x, by their weights; NaN if none reaches.
    fn blended(&self, x: [f32; 3], balls: &[u32]) -> f64 {
        let (mut sum, mut total) = (0.0, 0.0);
        for &b in balls {
            let (ball, plate) = &self.plates[b as usize];
            let weight = ball.weight(x);
            if weight > 0.0 {
                // Lengths in the ball's frame are over its radius.
                sum += weight * ball.radius * plate.value_at(ball.local(x));
                total += weight;
            }
        }
        // 0 / 0 where none reaches.
        sum / total
    }
}

#[track_caller]
fn check_normals(points: &[[f32; 3]], normals: &[[f32; 3]]) {
    let (n, m) = (points.len(), normals.len());
    assert!(n == m && n > 0, "LocalPlates: {n} points, {m} normals");
}

/// Balls of `size` points each (all, if there are fewer) that hold every point: the first point that lies well inside
/// of none becomes the centre of the next.
fn cover(points: &[[f32; 3]], size: usize) -> Vec<Ball> {
    let tree = KdTree::new(points);
    let size = size.min(points.len());
    let mut inside = vec![false; points.len()];
    let mut balls = Vec::new();
    for (i, &centre) in points.iter().enumerate() {
        if inside[i] {
            continue;
        }
        inside[i] = true;
        let members = tree.k_nearest(&[centre], size);
        let apart = |j: u32| distance(centre, points[j as usize]);
        let radius = MARGIN * apart(members[size - 1]);
        members.iter().filter(|&&j| apart(j) <= COVERED * radius).for_each(|&j| inside[j as usize] = true);
        balls.push(Ball { centre, radius, members });
    }
    balls
}

impl Near {
    fn of(balls: &[Ball], points: &[[f32; 3]]) -> Self {
        let reach: Vec<f64> = neighbour_spacing(points).into_iter().map(|s| REACH * s).collect();
        let tree = KdTree::new(points);
        // The points whose reach overlaps the ball. The search goes to twice the radius only: a point with a reach
        // larger than the ball is an outlier among its neighbours.
        let around = |ball: &Ball| -> Vec<u32> {
            let apart = |i: u32| distance(points[i as usize], ball.centre);
            let found = tree.within(ball.centre, (2.0 * ball.radius) as f32).into_iter().map(|(i, _)| i);
            found.filter(|&i| apart(i) < ball.radius + reach[i as usize]).collect()
        };
        let around: Vec<Vec<u32>> = balls.par_iter().map(around).collect();
        let mut first = vec![0usize; points.len() + 1];
        around.iter().flatten().for_each(|&i| first[i as usize + 1] += 1);
        for i in 0..points.len() {
            first[i + 1] += first[i];
        }
        let mut balls = vec![0; first[points.len()]];
        let mut next = first.clone();
        for (b, points) in around.iter().enumerate() {
            for &i in points {
                balls[next[i as usize]] = b as u32;
                next[i as usize] += 1;
            }
        }
        Near { first, balls }
    }

    fn of_point(&self, i: u32) -> &[u32] {
        &self.balls[self.first[i as usize]..self.first[i as usize + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorKind;
    use crate::geometry::{AnalyticShape, nearest_points};
    use proptest::prelude::*;

    const TORUS: AnalyticShape = AnalyticShape::Torus { major: 0.34, minor: 0.14 };

    fn fitted(n: usize, seed: u64) -> (Vec<[f32; 3]>, LocalPlates) {
        let (points, normals) = TORUS.sample(n, seed);
        let plates = LocalPlates::fit_each(&points, &[normals]).unwrap().remove(0);
        (points, plates)
    }

    /// Places within some neighbour spacings of points, and the nearest points of each.
    fn places(points: &[[f32; 3]], count: usize, off: f32) -> (Vec<[f32; 3]>, Vec<u32>) {
        let away = AnalyticShape::Sphere { radius: f64::from(off) }.sample(count, 9).0;
        let step = points.len() / count + 1;
        let x: Vec<[f32; 3]> =
            (0..count).map(|i| [0, 1, 2].map(|k| points[step * i % points.len()][k] + away[i][k])).collect();
        let (nearest, _) = nearest_points(&x, points);
        (x, nearest)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]

        /// All points are well inside of a ball; a ball holds its nearest points and is no smaller than they need.
        #[test]
        fn balls_cover_the_points(n in 1usize..400, size in 1usize..80, seed: u64) {
            let points = AnalyticShape::RoundedBox { half: [0.5, 0.3, 0.01], round: 0.005 }.sample(n, seed).0;
            let balls = cover(&points, size);
            for ball in &balls {
                let mut all: Vec<f64> = points.iter().map(|p| distance(*p, ball.centre)).collect();
                all.sort_by(f64::total_cmp);
                let size = size.min(n);
                prop_assert_eq!(ball.members.len(), size);
                let farthest = ball.members.iter().map(|&i| distance(points[i as usize], ball.centre));
                prop_assert_eq!(farthest.fold(0.0, f64::max), all[size - 1]);
            }
            for p in &points {
                let inside = |b: &&Ball| distance(*p, b.centre) <= COVERED * b.radius;
                prop_assert!(balls.iter().any(|b| inside(&b)));
            }
        }

        /// Asking every ball gives the same as asking those that are listed for the nearest point.
        #[test]
        fn no_ball_that_reaches_a_place_is_forgotten(n in 120usize..500, seed: u64, off in 0.0f32..0.05) {
            let (points, plates) = fitted(n, seed);
            let reach = REACH * neighbour_spacing(&points).into_iter().fold(f64::INFINITY, f64::min);
            let (x, nearest) = places(&points, 50, off.min(0.99 * reach as f32));
            let all: Vec<u32> = (0..plates.plates.len() as u32).collect();
            for (got, x) in plates.value(&x, &nearest).into_iter().zip(x) {
                prop_assert_eq!(got, plates.blended(x, &all) as f32);
            }
        }
    }

    #[test]
    fn is_near_the_distance_of_a_torus_whose_guessed_normals_are_off() {
        let (points, mut normals) = TORUS.sample(900, 3);
        for n in normals.iter_mut().step_by(9) {
            *n = [n[1], n[2], n[0]];
        }
        normals[7] = normals[7].map(|x| -x);
        let plates = LocalPlates::fit_each(&points, &[normals]).unwrap().remove(0);
        assert!(plates.plates.len() > 10);
        let (nearest, _) = nearest_points(&points, &points);
        let at_points = plates.value(&points, &nearest);
        assert!(at_points.iter().all(|f| f.abs() < 1e-4), "{at_points:?}");
        let (x, nearest) = places(&points, 300, 0.03);
        let worst = plates.value(&x, &nearest).into_iter().zip(&x).map(|(f, x)| (f - TORUS.sdf(*x)).abs());
        let worst = worst.fold(0.0, f32::max);
        assert!(worst < 0.01, "{worst}");
    }

    /// Along lines over the points, on which balls and nearest points change.
    #[test]
    fn the_blend_is_continuous() {
        let (points, plates) = fitted(600, 4);
        for line in 0..10 {
            let (from, to) = (points[7 * line], points[7 * line + 1]);
            let along = |i: usize| [0, 1, 2].map(|k| from[k] + i as f32 * 1e-4 * (to[k] - from[k]));
            let x: Vec<[f32; 3]> = (0..10_000).map(along).collect();
            let (nearest, dist_sq) = nearest_points(&x, &points);
            let spacing = neighbour_spacing(&points);
            let values = plates.value(&x, &nearest);
            let near = |i: usize| f64::from(dist_sq[i].sqrt()) < REACH * 0.5 * spacing[nearest[i] as usize];
            for i in (1..x.len()).filter(|&i| near(i) && near(i - 1)) {
                assert!((values[i] - values[i - 1]).abs() < 1e-3, "line {line}, {i}");
            }
        }
    }

    #[test]
    fn several_guesses_give_what_each_gives_alone() {
        let (points, normals) = TORUS.sample(250, 2);
        let inward: Vec<[f32; 3]> = normals.iter().map(|n| n.map(|x| -x)).collect();
        let both = LocalPlates::fit_each(&points, &[&normals, &inward]).unwrap();
        let (x, nearest) = places(&points, 40, 0.02);
        for (plates, normals) in both.iter().zip([&normals, &inward]) {
            let alone = LocalPlates::fit_each(&points, &[normals]).unwrap().remove(0);
            assert_eq!(plates.value(&x, &nearest), alone.value(&x, &nearest));
        }
    }

    /// For points of one ball, the forecasts and values are those of its plate.
    #[test]
    fn one_ball_is_one_plate() {
        let (points, normals) = TORUS.sample(90, 6);
        let (plates, found) = LocalPlates::fit_with_forecasts(&points, &normals).unwrap();
        let centres: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
        let system = System::new(&centres).unwrap();
        let gradients = system.least_bending(directions(&normals));
        let want = forecasts(&system, &covariances(&system), &gradients);
        for (got, want) in found.iter().zip(&want) {
            assert!((got.error - want.error).abs() < 2e-3, "{got:?} is not {want:?}");
            assert!((got.slope - want.slope).abs() < 0.1, "{got:?} is not {want:?}");
        }
        let whole = system.interpolant(&centres, &gradients);
        let (x, nearest) = places(&points, 40, 0.03);
        for (got, want) in plates.value(&x, &nearest).into_iter().zip(whole.value(&x)) {
            assert!((got - want).abs() < 2e-3, "{got} is not {want}");
        }
    }

    /// Of many balls, a point's forecast is what the plates without it have there.
    #[test]
    fn forecasts_come_from_the_other_points() {
        let (points, normals) = TORUS.sample(400, 8);
        let (_, found) = LocalPlates::fit_with_forecasts(&points, &normals).unwrap();
        let mut moved = points.clone();
        // A point off the surface is not foretold by the others, though their normals, which were found with it among
        // them, have turned to it.
        moved[17] = [0, 1, 2].map(|k| points[17][k] + 0.03 * normals[17][k]);
        let (_, off) = LocalPlates::fit_with_forecasts(&moved, &normals).unwrap();
        let (found, off) = (found[17], off[17]);
        assert!(found.error < 1e-3 && (0.015..0.035).contains(&off.error), "{found:?} {off:?}");
    }

    #[test]
    fn no_plate_reaches_far_places_and_points_in_one_place_an_error() {
        let (_, plates) = fitted(200, 1);
        assert!(plates.value(&[[5.0; 3]], &[0])[0].is_nan());
        let error = LocalPlates::fit_each(&[[0.25; 3]; 6], &[[[0.0, 0.0, 1.0]; 6]]).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Data);
    }
}
