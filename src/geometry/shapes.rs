//! Shapes with a known signed distance, for tests, demonstrations and benchmarks.

use super::vec3::{dot, length};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

/// Samples drawn from one random stream; fixed, so that the result does not depend on the thread count.
const CHUNK: usize = 512;

/// Half thickness of the shell that samples are drawn from, and the step of the central differences.
const SHELL: f64 = 0.01;
const STEP: f64 = 1e-5;

/// A closed surface given by a formula, centred at the origin.
///
/// Sizes are in the frame's units; the shapes of [`AnalyticShape::gallery`] have a longest side of about 1.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum AnalyticShape {
    /// A sphere.
    Sphere {
        /// Its radius.
        radius: f64,
    },
    /// A torus around the z axis (genus 1).
    Torus {
        /// Radius of the circle the tube follows.
        major: f64,
        /// Radius of the tube, less than `major`.
        minor: f64,
    },
    /// Two tori side by side along x that run into each other smoothly: a figure eight (genus 2).
    DoubleTorus {
        /// Radius of the circles the tubes follow.
        major: f64,
        /// Radius of the tubes.
        minor: f64,
        /// Width over which the two tubes blend; 0 leaves a crease.
        blend: f64,
    },
    /// Two tori linked like a chain: one around z, one around y, each through the other's hole (two parts, genus 1
    /// each).
    LinkedTori {
        /// Radius of the circles the tubes follow.
        major: f64,
        /// Radius of the tubes, less than half of `major` so that they stay apart.
        minor: f64,
    },
    /// Two spheres side by side along x (two parts if `distance > 2 radius`).
    TwoSpheres {
        /// Radius of both.
        radius: f64,
        /// Distance between the centres.
        distance: f64,
    },
    /// A box with rounded edges.
    RoundedBox {
        /// Half of each side, the rounding included.
        half: [f64; 3],
        /// Radius of the rounding, at most the least of `half`.
        round: f64,
    },
}

/// The signed distance of `p` to a box around the origin, given half of its sides.
pub(super) fn box_sdf(p: [f64; 3], half: [f64; 3]) -> f64 {
    let q: [f64; 3] = std::array::from_fn(|a| p[a].abs() - half[a]);
    length(q.map(|x| x.max(0.0))) + q[0].max(q[1]).max(q[2]).min(0.0)
}

impl AnalyticShape {
    /// One of each kind with its name, in a box of longest side about 1.
    pub fn gallery() -> [(&'static str, AnalyticShape); 6] {
        [
            ("sphere", AnalyticShape::Sphere { radius: 0.5 }),
            ("torus", AnalyticShape::Torus { major: 0.36, minor: 0.14 }),
            ("double-torus", AnalyticShape::DoubleTorus { major: 0.19, minor: 0.08, blend: 0.06 }),
            ("linked-tori", AnalyticShape::LinkedTori { major: 0.28, minor: 0.08 }),
            ("two-spheres", AnalyticShape::TwoSpheres { radius: 0.22, distance: 0.56 }),
            ("rounded-box", AnalyticShape::RoundedBox { half: [0.5, 0.35, 0.25], round: 0.08 }),
        ]
    }

    /// Euler characteristic `v - e + f` of any closed mesh of the surface: 2 per part, less 2 per handle.
    ///
    /// For sizes that keep the parts apart and the holes open, as the fields ask.
    pub fn euler_characteristic(&self) -> i64 {
        match *self {
            AnalyticShape::Sphere { .. } | AnalyticShape::RoundedBox { .. } => 2,
            AnalyticShape::Torus { .. } | AnalyticShape::LinkedTori { .. } => 0,
            AnalyticShape::DoubleTorus { .. } => -2,
            AnalyticShape::TwoSpheres { radius, distance } => 2 + 2 * i64::from(distance > 2.0 * radius),
        }
    }

    /// Signed distance from `p` to the surface, negative inside, in the frame's units.
    ///
    /// Exact, except where parts meet: within the blend of a double torus, and inside overlapping spheres, its size is
    /// at most the true distance.
    pub fn sdf(&self, p: [f32; 3]) -> f32 {
        self.eval(p.map(f64::from)) as f32
    }

    /// `count` random points on the surface (n x 3) and the outward unit normals there (n x 3).
    ///
    /// Uniform points in the box are kept if the surface is within 0.01 to first order, and moved onto it by Newton
    /// steps along the gradient. Both sides of the shell cancel in first order, so the density differs from uniform by
    /// the factor `1 + K * 0.01^2 / 3`, where `K` is the Gaussian curvature: below 0.3 % for features of size 0.1 and
    /// up. The same seed gives the same bytes for any thread count.
    pub fn sample(&self, count: usize, seed: u64) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
        let mut points = vec![[0.0; 3]; count];
        let mut normals = vec![[0.0; 3]; count];
        points.par_chunks_mut(CHUNK).zip(normals.par_chunks_mut(CHUNK)).enumerate().for_each(
            |(chunk, (points, normals))| {
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                rng.set_stream(chunk as u64);
                for (point, normal) in points.iter_mut().zip(normals) {
                    let (p, n) = self.sample_one(&mut rng);
                    *point = p.map(|x| x as f32);
                    *normal = n.map(|x| x as f32);
                }
            },
        );
        (points, normals)
    }

    fn sample_one(&self, rng: &mut ChaCha8Rng) -> ([f64; 3], [f64; 3]) {
        let half = self.half_size().map(|h| h + 2.0 * SHELL);
        loop {
            let mut p = half.map(|h| h * (2.0 * rng.random::<f64>() - 1.0));
            let mut value = self.eval(p);
            if value.abs() > SHELL {
                continue;
            }
            let mut g = self.gradient(p);
            if value * value > SHELL * SHELL * dot(g, g) {
                continue;
            }
            for _ in 0..8 {
                let step = value / dot(g, g);
                p = std::array::from_fn(|a| p[a] - step * g[a]);
                value = self.eval(p);
                g = self.gradient(p);
            }
            let len = length(g);
            // A point at a crease may not settle; another draw does.
            if value.abs() < 1e-9 && len > 0.5 {
                return (p, g.map(|x| x / len));
            }
        }
    }

    fn eval(&self, p: [f64; 3]) -> f64 {
        let [x, y, z] = p;
        let torus = |x: f64, y: f64, z: f64, major: f64, minor: f64| (x.hypot(y) - major).hypot(z) - minor;
        match *self {
            AnalyticShape::Sphere { radius } => length(p) - radius,
            AnalyticShape::Torus { major, minor } => torus(x, y, z, major, minor),
            AnalyticShape::DoubleTorus { major, minor, blend } => {
                let shift = major + 0.5 * minor;
                let a = torus(x + shift, y, z, major, minor);
                let b = torus(x - shift, y, z, major, minor);
                // Quadratic smooth minimum: equal to the minimum where the two differ by more than the blend.
                let h = (blend - (a - b).abs()).max(0.0);
                a.min(b) - if h > 0.0 { h * h / (4.0 * blend) } else { 0.0 }
            }
            AnalyticShape::LinkedTori { major, minor } => {
                let shift = 0.5 * major;
                torus(x + shift, y, z, major, minor).min(torus(x - shift, z, y, major, minor))
            }
            AnalyticShape::TwoSpheres { radius, distance } => {
                let x = x.abs() - 0.5 * distance;
                length([x, y, z]) - radius
            }
            AnalyticShape::RoundedBox { half, round } => box_sdf(p, half.map(|h| h - round)) - round,
        }
    }

    fn gradient(&self, p: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| {
            let (mut low, mut high) = (p, p);
            low[a] -= STEP;
            high[a] += STEP;
            (self.eval(high) - self.eval(low)) / (2.0 * STEP)
        })
    }

    /// Half the sides of a box around the surface.
    fn half_size(&self) -> [f64; 3] {
        match *self {
            AnalyticShape::Sphere { radius } => [radius; 3],
            AnalyticShape::Torus { major, minor } => [major + minor, major + minor, minor],
            AnalyticShape::DoubleTorus { major, minor, blend } => {
                [2.0 * major + 1.5 * minor + blend, major + minor + blend, minor + blend]
            }
            AnalyticShape::LinkedTori { major, minor } => [1.5 * major + minor, major + minor, major + minor],
            AnalyticShape::TwoSpheres { radius, distance } => [radius + 0.5 * distance, radius, radius],
            AnalyticShape::RoundedBox { half, .. } => half,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Bounds, KdTree};
    use std::f64::consts::PI;

    #[test]
    fn hand_checked_distances() {
        assert_eq!(AnalyticShape::Sphere { radius: 0.5 }.sdf([0.0, 0.0, 1.0]), 0.5);
        assert_eq!(AnalyticShape::Torus { major: 0.5, minor: 0.25 }.sdf([0.0; 3]), 0.25);
        assert_eq!(AnalyticShape::Torus { major: 0.5, minor: 0.25 }.sdf([0.5, 0.0, 0.0]), -0.25);
        let b = AnalyticShape::RoundedBox { half: [0.5, 0.25, 0.25], round: 0.125 };
        assert_eq!(b.sdf([1.0, 0.0, 0.0]), 0.5);
        assert_eq!(b.sdf([0.0; 3]), -0.25);
        assert_eq!(AnalyticShape::TwoSpheres { radius: 0.25, distance: 1.0 }.sdf([0.0; 3]), 0.25);
        // The middle of either hole is in the middle of the other tube: they are linked.
        for x in [-0.25, 0.25] {
            assert_eq!(AnalyticShape::LinkedTori { major: 0.5, minor: 0.125 }.sdf([x, 0.0, 0.0]), -0.125);
        }
    }

    #[test]
    fn samples_lie_on_the_surface_with_its_normals() {
        for (name, shape) in AnalyticShape::gallery() {
            let (points, normals) = shape.sample(2000, 7);
            let b = Bounds::of(&points).unwrap();
            assert!((0.9..1.05).contains(&b.longest()), "{name} is {} long", b.longest());
            for (p, n) in points.iter().zip(&normals) {
                assert!(shape.sdf(*p).abs() < 1e-6, "{name}: {}", shape.sdf(*p));
                assert!((n.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-5);
                // A short step along the normal changes the distance by its length.
                for t in [-0.02f32, 0.02] {
                    let q = std::array::from_fn(|a| p[a] + t * n[a]);
                    let tol = if matches!(shape, AnalyticShape::DoubleTorus { .. }) { 0.01 } else { 1e-5 };
                    assert!((shape.sdf(q) - t).abs() < tol, "{name}: {} for {t}", shape.sdf(q));
                }
            }
        }
    }

    #[test]
    fn distance_is_that_to_the_nearest_surface_point() {
        for (name, shape) in AnalyticShape::gallery() {
            let (points, _) = shape.sample(20_000, 1);
            let tree = KdTree::new(&points);
            let mut rng = ChaCha8Rng::seed_from_u64(2);
            for _ in 0..300 {
                let q = std::array::from_fn(|_| rng.random_range(-0.6f32..0.6));
                let near = tree.nearest(q).1.sqrt();
                let d = shape.sdf(q).abs();
                assert!(d <= near + 1e-5, "{name} at {q:?}: {d} but a point at {near}");
                let slack = if matches!(shape, AnalyticShape::DoubleTorus { .. }) { 0.035 } else { 0.02 };
                assert!(near < d + slack, "{name} at {q:?}: {d} but nothing nearer than {near}");
            }
        }
    }

    #[test]
    fn torus_samples_are_area_uniform() {
        let (major, minor) = (0.36, 0.14);
        let (points, _) = AnalyticShape::Torus { major, minor }.sample(20_000, 3);
        let outer = points.iter().filter(|p| f64::from(p[0].hypot(p[1])) > major).count() as f64;
        // The outer half holds 1/2 + minor / (pi major) of the area; three standard deviations are 0.0103.
        let want = 0.5 + minor / (PI * major);
        assert!((outer / 20_000.0 - want).abs() < 0.0103, "{} for {want}", outer / 20_000.0);
        let right = points.iter().filter(|p| p[0] > 0.0).count() as f64;
        assert!((right / 20_000.0 - 0.5).abs() < 0.0106);
    }

    #[test]
    fn seed_decides_and_threads_do_not() {
        let shape = AnalyticShape::gallery()[2].1;
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| shape.sample(2000, 9))
        };
        assert_eq!(run(1), run(3));
        assert_ne!(shape.sample(5, 1), shape.sample(5, 2));
    }

    #[test]
    fn euler_characteristics() {
        let all = AnalyticShape::gallery().map(|(_, s)| s.euler_characteristic());
        assert_eq!(all, [2, 0, -2, 0, 4, 2]);
        assert_eq!(AnalyticShape::TwoSpheres { radius: 0.3, distance: 0.2 }.euler_characteristic(), 2);
    }
}
