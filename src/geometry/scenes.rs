//! Made-up scenes of known shape, for benchmarks of rooms and streets.

use super::shapes::box_sdf;
use super::vec3::{add, dot, length, sub, unit_vector};
use crate::random::Random;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;

/// The largest distance from a surface at which a ray has hit it, metres.
const HIT: f64 = 1e-4;
/// Points that are at most this far outside of another solid, metres, are where the two touch, and not on the surface.
const TOUCH: f64 = 1e-6;
/// Steps after which a ray that has neither hit nor left is given up.
const MAX_STEPS: usize = 512;
/// The largest slope of a terrain.
const MAX_SLOPE: f64 = 0.1;

/// Solids that together fill what is not free space. Metres; z points up.
#[derive(Clone, Debug, PartialEq)]
pub struct SyntheticScene {
    solids: Vec<Solid>,
}

/// A part of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Solid {
    /// What is outside of a box: floor, walls and ceiling, which are seen from inside.
    Outside {
        low: [f64; 3],
        high: [f64; 3],
    },
    Cuboid {
        low: [f64; 3],
        high: [f64; 3],
    },
    /// Upright, on the middle of its base.
    Cylinder {
        base: [f64; 3],
        radius: f64,
        height: f64,
    },
    Ball {
        centre: [f64; 3],
        radius: f64,
    },
    /// What is below a gently waved ground, z < [`ground`], over a rectangle of x and y, from which it is sampled; the
    /// ground goes on beyond.
    Terrain {
        low: [f64; 2],
        high: [f64; 2],
    },
}

/// A spinning laser scanner: rings of rays at even elevations, each at even steps around the z axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpinningScanner {
    /// Where the rays begin, metres.
    pub place: [f64; 3],
    /// Number of rings, at least 2.
    pub rings: usize,
    /// Elevation of the lowest and the highest ring, degrees above the horizon.
    pub elevations: [f64; 2],
    /// Rays of a ring.
    pub rays: usize,
    /// Rays that hit nothing up to this range give no point, metres.
    pub max_range: f64,
    /// Standard deviation of the measured range, metres.
    pub range_noise: f64,
}

/// The height of the ground of a terrain at x, y, and its slopes along x and y.
fn ground(x: f64, y: f64) -> (f64, [f64; 2]) {
    let (long, short) = (x / 11.0 + y / 17.0, x / 23.0 - y / 9.0);
    let height = 0.35 * long.sin() + 0.25 * short.sin();
    (
        height,
        [
            0.35 / 11.0 * long.cos() + 0.25 / 23.0 * short.cos(),
            0.35 / 17.0 * long.cos() - 0.25 / 9.0 * short.cos(),
        ],
    )
}

impl SyntheticScene {
    /// A room of 5 x 4 x 2.6 m with a table, a chair, a sofa, shelves and a lamp: plates of 2 to 4 cm, legs of 4 to 6.
    pub fn furnished_room() -> Self {
        let cuboid = |low: [f64; 3], high: [f64; 3]| Solid::Cuboid { low, high };
        let cylinder = |base: [f64; 3], radius, height| Solid::Cylinder { base, radius, height };
        let mut solids = vec![
            Solid::Outside { low: [0.0; 3], high: [5.0, 4.0, 2.6] },
            // The top of the table, the two parts of the sofa.
            cuboid([1.5, 1.5, 0.70], [3.1, 2.4, 0.74]),
            cuboid([3.9, 0.2, 0.0], [4.8, 2.2, 0.42]),
            cuboid([4.6, 0.2, 0.42], [4.8, 2.2, 0.85]),
            // The sides of the shelves.
            cuboid([0.05, 2.78, 0.0], [0.4, 2.8, 1.95]),
            cuboid([0.05, 3.9, 0.0], [0.4, 3.92, 1.95]),
            // Foot, pole and shade of the lamp.
            cylinder([4.4, 3.4, 0.0], 0.15, 0.03),
            cylinder([4.4, 3.4, 0.03], 0.02, 1.5),
            cylinder([4.4, 3.4, 1.5], 0.2, 0.25),
            // Seat and back of the chair.
            cuboid([2.0, 0.6, 0.44], [2.45, 1.05, 0.48]),
            cuboid([2.0, 0.56, 0.44], [2.45, 0.6, 0.95]),
        ];
        solids.extend([0.0, 0.43, 0.93, 1.43, 1.92].map(|z| cuboid([0.05, 2.8, z], [0.4, 3.9, z + 0.03])));
        for (x, y) in [(1.55, 1.55), (1.55, 2.3), (3.0, 1.55), (3.0, 2.3)] {
            solids.push(cuboid([x, y, 0.0], [x + 0.06, y + 0.06, 0.70]));
        }
        for (x, y) in [(2.0, 0.6), (2.0, 1.01), (2.41, 0.6), (2.41, 1.01)] {
            solids.push(cuboid([x, y, 0.0], [x + 0.04, y + 0.04, 0.44]));
        }
        Self { solids }
    }

    /// A street along x, 30 m wide, of a `length` in metres: waved ground, houses on both sides, kerbs, parked cars on
    /// wheels, lamp posts, signs of 2 cm, trees. Every 25 m are built alike, at other heights of the ground.
    pub fn street(length: f64) -> Self {
        let mut solids = vec![Solid::Terrain { low: [0.0, -15.0], high: [length, 15.0] }];
        let height = |x: f64, y: f64| ground(x, y).0;
        let cuboid = |[x, y, z]: [f64; 3], [a, b, c]: [f64; 3]| Solid::Cuboid {
            low: [x - 0.5 * a, y - 0.5 * b, z],
            high: [x + 0.5 * a, y + 0.5 * b, z + c],
        };
        for i in 0..(length / 25.0).floor() as usize {
            let x = 25.0 * i as f64 + 12.5;
            for side in [-1.0, 1.0] {
                let at = |dx: f64, y: f64, z: f64| [x + dx, side * y, height(x + dx, side * y) + z];
                // A house with a chimney, half of it behind the edge of the street; the kerb, in pieces.
                let tall = 5.0 + ((i * 7 + usize::from(side > 0.0) * 3) % 5) as f64;
                solids.push(cuboid(at(-2.0, 12.0, -2.0), [16.0, 5.0, tall + 2.0]));
                solids.push(cuboid(at(2.0, 12.0, tall - 0.5), [0.7, 0.7, 1.7]));
                solids.extend(
                    [-10.0, -5.0, 0.0, 5.0, 10.0].map(|dx| cuboid(at(dx, 5.1, -0.5), [4.9, 0.2, 0.62])),
                );
                // A post with its lamp, a sign, a tree.
                let [px, py, pz] = at(9.0, 6.0, -0.3);
                solids.push(Solid::Cylinder { base: [px, py, pz], radius: 0.08, height: 5.3 });
                solids.push(cuboid([px, py - side * 0.6, pz + 5.25], [0.3, 1.4, 0.12]));
                let [sx, sy, sz] = at(-9.0, 5.8, -0.3);
                solids.push(Solid::Cylinder { base: [sx, sy, sz], radius: 0.03, height: 2.6 });
                solids.push(cuboid([sx - 0.04, sy, sz + 2.0], [0.02, 0.6, 0.6]));
                let [tx, ty, tz] = at(11.0, 8.5, -0.3);
                solids.push(Solid::Cylinder { base: [tx, ty, tz], radius: 0.18, height: 3.0 });
                solids.push(Solid::Ball { centre: [tx, ty, tz + 4.1], radius: 1.4 });
            }
            // A car on one side: body, cabin, and wheels as blocks, since cylinders are upright here.
            let side = if i % 2 == 0 { -1.0 } else { 1.0 };
            let (cx, cy) = (x - 1.0, side * 3.8);
            let floor = height(cx, cy) + 0.25;
            solids.push(cuboid([cx, cy, floor], [4.2, 1.7, 0.6]));
            solids.push(cuboid([cx - 0.2, cy, floor + 0.6], [2.2, 1.5, 0.55]));
            for (dx, dy) in [(-1.3, -0.75), (-1.3, 0.75), (1.3, -0.75), (1.3, 0.75)] {
                solids.push(cuboid([cx + dx, cy + dy, floor - 0.45], [0.6, 0.2, 0.6]));
            }
        }
        Self { solids }
    }

    /// The signed distance of `p` to the nearest surface, metres, negative in solids. In free space it is exact, but
    /// over a terrain, where it is at most half a percent too small for its slope; where solids overlap it is an upper
    /// bound of a negative number.
    pub fn sdf(&self, p: [f64; 3]) -> f64 {
        self.solids.iter().map(|solid| solid.sdf(p)).fold(f64::INFINITY, f64::min)
    }

    /// Points spread evenly at random over all surfaces that border free space, `density` a square metre on average,
    /// and the unit normals there, which point into free space; n x 3 each. Unseen sides, such as the lower side of a
    /// sofa's seat on its frame, are on the surface unless they touch another solid.
    ///
    /// # Panics
    /// If the density is not finite or negative.
    #[track_caller]
    pub fn sample(&self, density: f64, seed: u64) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
        assert!(density.is_finite() && density >= 0.0, "{density} points a square metre");
        let (mut points, mut normals) = (Vec::new(), Vec::new());
        for (i, solid) in self.solids.iter().enumerate() {
            let mut random = Random::new(seed);
            random.set_stream(i as u64);
            let wanted = solid.area() * density;
            let count = wanted.floor() as usize + usize::from(uniform(&mut random) < wanted.fract());
            for _ in 0..count {
                let Some((p, n)) = solid.draw(&mut random) else { continue };
                let mut others = self.solids.iter().enumerate().filter(|(j, _)| *j != i);
                if others.all(|(_, other)| other.sdf(p) > TOUCH) {
                    points.push(p);
                    normals.push(n);
                }
            }
        }
        (points, normals)
    }

    /// The points that a `scanner` measures, n x 3: where each ray first meets a surface, off by the noise along the
    /// ray.
    ///
    /// # Panics
    /// If there are fewer than two rings.
    #[track_caller]
    pub fn scan(&self, scanner: &SpinningScanner, seed: u64) -> Vec<[f64; 3]> {
        assert!(scanner.rings > 1, "{} rings", scanner.rings);
        let mut random = Random::new(seed);
        let mut points = Vec::new();
        let [lowest, highest] = scanner.elevations;
        for ring in 0..scanner.rings {
            let elevation = lowest + (highest - lowest) * ring as f64 / (scanner.rings - 1) as f64;
            let (up, flat) = elevation.to_radians().sin_cos();
            for ray in 0..scanner.rays {
                let (y, x) = (2.0 * PI * ray as f64 / scanner.rays as f64).sin_cos();
                let way = [flat * x, flat * y, up];
                if let Some(range) = self.range(scanner.place, way, scanner.max_range) {
                    let noise: f64 = StandardNormal.sample(random.source());
                    let range = range + scanner.range_noise * noise;
                    points.push(add(scanner.place, way.map(|w| w * range)));
                }
            }
        }
        points
    }

    /// How far from `from` a ray along the unit vector `way` meets a surface, up to `max_range`; by sphere tracing
    /// (Hart 1996): no surface is nearer than the distance, so the ray may go on by it.
    fn range(&self, from: [f64; 3], way: [f64; 3], max_range: f64) -> Option<f64> {
        let mut range = 0.0;
        for _ in 0..MAX_STEPS {
            let distance = self.sdf(add(from, way.map(|w| w * range)));
            if distance < HIT {
                return Some(range);
            }
            range += distance;
            if range > max_range {
                return None;
            }
        }
        None
    }
}

fn uniform(random: &mut Random) -> f64 {
    random.source().random::<f64>()
}

/// A number below `weights.len()`, each as often as its weight says.
fn weighted<const N: usize>(random: &mut Random, weights: [f64; N]) -> usize {
    let mut left = uniform(random) * weights.iter().sum::<f64>();
    weights
        .iter()
        .position(|w| {
            left -= w;
            left < 0.0
        })
        .unwrap_or(N - 1)
}

/// The signed distance of `p` to a box given by two corners.
fn cuboid_sdf(p: [f64; 3], low: [f64; 3], high: [f64; 3]) -> f64 {
    let middle = add(low, high).map(|x| 0.5 * x);
    box_sdf(sub(p, middle), sub(high, low).map(|x| 0.5 * x))
}

impl Solid {
    fn sdf(&self, p: [f64; 3]) -> f64 {
        match *self {
            Solid::Outside { low, high } => -cuboid_sdf(p, low, high),
            Solid::Cuboid { low, high } => cuboid_sdf(p, low, high),
            Solid::Cylinder { base, radius, height } => {
                let aside = (p[0] - base[0]).hypot(p[1] - base[1]) - radius;
                let above = (p[2] - base[2] - 0.5 * height).abs() - 0.5 * height;
                aside.max(0.0).hypot(above.max(0.0)) + aside.max(above).min(0.0)
            }
            Solid::Ball { centre, radius } => length(sub(p, centre)) - radius,
            Solid::Terrain { .. } => (p[2] - ground(p[0], p[1]).0) / MAX_SLOPE.hypot(1.0),
        }
    }

    /// The area of its surface, square metres; for a terrain at most 1 + [`MAX_SLOPE`]^2 / 2 times as much, of which
    /// [`draw`](Self::draw) rejects what is too much.
    fn area(&self) -> f64 {
        match *self {
            Solid::Outside { low, high } | Solid::Cuboid { low, high } => {
                let [a, b, c] = sub(high, low);
                2.0 * (a * b + b * c + c * a)
            }
            Solid::Cylinder { radius, height, .. } => 2.0 * PI * radius * (radius + height),
            Solid::Ball { radius, .. } => 4.0 * PI * radius * radius,
            Solid::Terrain { low, high } => (high[0] - low[0]) * (high[1] - low[1]) * MAX_SLOPE.hypot(1.0),
        }
    }

    /// A random point of its surface with the normal that points out of the solid.
    fn draw(&self, random: &mut Random) -> Option<([f64; 3], [f64; 3])> {
        match *self {
            Solid::Outside { low, high } => {
                let (p, n) = Solid::Cuboid { low, high }.draw(random)?;
                Some((p, n.map(|x| -x)))
            }
            Solid::Cuboid { low, high } => {
                let [a, b, c] = sub(high, low);
                let axis = weighted(random, [b * c, c * a, a * b]);
                let mut p = std::array::from_fn(|d| low[d] + (high[d] - low[d]) * uniform(random));
                let upper = uniform(random) < 0.5;
                p[axis] = if upper { high[axis] } else { low[axis] };
                let mut n = [0.0; 3];
                n[axis] = if upper { 1.0 } else { -1.0 };
                Some((p, n))
            }
            Solid::Cylinder { base, radius, height } => {
                let (y, x) = (2.0 * PI * uniform(random)).sin_cos();
                let part = weighted(random, [2.0 * height, radius, radius]);
                let (r, z) = match part {
                    0 => (radius, height * uniform(random)),
                    cap => (radius * uniform(random).sqrt(), if cap == 1 { 0.0 } else { height }),
                };
                let n = [[x, y, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, 1.0]][part];
                Some((add(base, [r * x, r * y, z]), n))
            }
            Solid::Ball { centre, radius } => {
                let n: [f64; 3] = std::array::from_fn(|_| StandardNormal.sample(random.source()));
                let n = unit_vector(n)?;
                Some((add(centre, n.map(|x| x * radius)), n))
            }
            Solid::Terrain { low, high } => {
                let [x, y] = std::array::from_fn(|d| low[d] + (high[d] - low[d]) * uniform(random));
                let (z, [a, b]) = ground(x, y);
                let n = [-a, -b, 1.0];
                let steep = length(n) / MAX_SLOPE.hypot(1.0);
                (uniform(random) < steep).then(|| ([x, y, z], n.map(|x| x / dot(n, n).sqrt())))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn scenes() -> [SyntheticScene; 2] {
        [SyntheticScene::furnished_room(), SyntheticScene::street(50.0)]
    }

    #[test]
    fn samples_lie_on_the_surface_with_free_space_before_them() {
        for scene in scenes() {
            let (points, normals) = scene.sample(5.0, 1);
            assert!(points.len() > 500, "{}", points.len());
            for (&p, n) in points.iter().zip(normals) {
                assert!(scene.sdf(p).abs() < 1e-9, "{p:?}");
                assert!((length(n) - 1.0).abs() < 1e-9, "{n:?}");
                let step = |s: f64| scene.sdf(add(p, n.map(|x| s * x)));
                assert!(step(1e-3) > 0.0 || step(1e-5) > 0.0, "{p:?} {n:?}");
                assert!(step(-1e-3) < 0.0, "{p:?} {n:?}");
            }
        }
    }

    #[test]
    fn density_and_areas_are_those_asked_for() {
        let scene = SyntheticScene {
            solids: vec![
                Solid::Ball { centre: [0.0, 0.0, 9.0], radius: 1.0 },
                Solid::Cylinder { base: [5.0, 0.0, 9.0], radius: 0.5, height: 2.0 },
                Solid::Cuboid { low: [-6.0, 0.0, 9.0], high: [-4.0, 0.1, 10.0] },
                Solid::Terrain { low: [0.0, 10.0], high: [20.0, 20.0] },
            ],
        };
        let (points, _) = scene.sample(400.0, 7);
        let share =
            |in_part: &dyn Fn(&[f64; 3]) -> bool| points.iter().filter(|p| in_part(p)).count() as f64 / 400.0;
        let ball = share(&|p| length(sub(*p, [0.0, 0.0, 9.0])) < 1.1);
        let cap = share(&|p| p[2] == 11.0);
        let plate = share(&|p| p[0] < -3.9 && p[1] == 0.1);
        // Riemann sum of the area element of the terrain.
        let cells =
            (0..200).flat_map(|i| (0..100).map(move |j| (0.1 * f64::from(i), 10.0 + 0.1 * f64::from(j))));
        let terrain: f64 = cells
            .map(|(x, y)| {
                let [a, b] = ground(x, y).1;
                0.01 * (1.0 + a * a + b * b).sqrt()
            })
            .sum();
        for (got, want) in
            [(ball, 4.0 * PI), (cap, 0.25 * PI), (plate, 2.0), (share(&|p| p[1] >= 10.0), terrain)]
        {
            let deviation = (want / 400.0).sqrt();
            assert!((got - want).abs() < 4.0 * deviation, "{got} for {want}");
        }
    }

    #[test]
    fn no_point_of_a_scan_is_behind_another_surface() {
        for (scene, place) in scenes().into_iter().zip([[2.5, 3.0, 1.2], [25.0, 0.0, 2.0]]) {
            let scanner = SpinningScanner {
                place,
                rings: 16,
                elevations: [-30.0, 20.0],
                rays: 90,
                max_range: 40.0,
                range_noise: 0.0,
            };
            let points = scene.scan(&scanner, 3);
            assert!(points.len() > 700, "{}", points.len());
            for &p in &points {
                assert!(scene.sdf(p).abs() < 1.01 * HIT && length(sub(p, place)) <= 40.0, "{p:?}");
                // Plain steps of 5 mm along the ray meet no surface before.
                let way = sub(p, place);
                let steps = (length(way) / 0.005) as usize;
                assert!(
                    (0..steps)
                        .all(|s| scene.sdf(add(place, way.map(|w| w * s as f64 / steps as f64))) > -1e-3)
                );
            }
            let noisy = scene.scan(&SpinningScanner { range_noise: 0.02, ..scanner }, 3);
            let off: f64 = noisy.iter().zip(&points).map(|(a, b)| length(sub(*a, *b)).powi(2)).sum();
            let deviation = (off / points.len() as f64).sqrt();
            assert!((deviation - 0.02).abs() < 0.003, "{deviation}");
        }
    }

    proptest! {
        /// No step along a line is longer than the change of the distance: what sphere tracing rests on.
        #[test]
        fn distances_change_no_faster_than_places(p in prop::array::uniform3(-4.0f64..8.0), d in prop::array::uniform3(-1.0f64..1.0)) {
            for scene in scenes() {
                let change = scene.sdf(add(p, d)) - scene.sdf(p);
                prop_assert!(change.abs() <= length(d) * (1.0 + 1e-9) + 1e-12, "{change} over {}", length(d));
            }
        }
    }
}
