//! On which side of a closed mesh a point is: winding numbers by signed crossings of a ray.
//!
//! The normal of the nearest face does not tell: where the nearest point is on an edge or a corner, one of the faces
//! there may look the other way, and whole wedges beyond sharp edges come out on the wrong side.

use super::{SurfaceHit, TriangleBvh};
use rayon::prelude::*;

/// The rays' direction (x/z, y/z): no plane or line of a grid or of a CAD part is likely to lie along it.
const SLOPE: [f64; 2] = [0.372_548_1, 0.618_742_7];
// The ray enters a box through its lower sides.
const _: () = assert!(SLOPE[0] > 0.0 && SLOPE[1] > 0.0);

impl TriangleBvh {
    /// How often the faces wind around `q`: 1 inside a closed mesh whose faces look outward, 0 outside; without meaning
    /// for an open one.
    ///
    /// Faces that a ray from `q` leaves through count +1, those it enters through -1. A ray is on one side of an edge
    /// exactly where it is on the other side of the same edge of the next face (Woop, Benthin, Wald 2013, "Watertight
    /// ray/triangle intersection"), so none slips between two faces.
    ///
    /// # Panics
    /// If `q` is not finite.
    #[track_caller]
    pub fn winding(&self, q: [f32; 3]) -> i32 {
        assert!(q.iter().all(|x| x.is_finite()), "TriangleBvh::winding: query {q:?} is not finite");
        let q = q.map(f64::from);
        let mut count = 0;
        self.visit(|min, max| meets_box(q, min, max), |corners| count += ray_crossing(q, corners));
        count
    }

    /// The signed distance of `q` from a closed mesh whose faces look outward, negative inside, and its gradient there:
    /// the unit vector away from the nearest point, outside, or towards it, inside; at distances up to 1e-4
    /// (working frame) the normal of the nearest face, as the direction to so near a point is rounding.
    ///
    /// # Panics
    /// If `q` is not finite.
    #[track_caller]
    pub(crate) fn signed_distance(&self, q: [f32; 3]) -> (f32, [f32; 3]) {
        self.signed(q, self.nearest(q))
    }

    /// [`signed_distance`](Self::signed_distance) at each of `queries` (m x 3): m distances and m gradients.
    pub(crate) fn signed_distances(&self, queries: &[[f32; 3]]) -> (Vec<f32>, Vec<[f32; 3]>) {
        let hits = self.nearest_all(queries);
        queries.par_iter().zip(hits).map(|(&q, hit)| self.signed(q, hit)).unzip()
    }

    fn signed(&self, q: [f32; 3], hit: SurfaceHit) -> (f32, [f32; 3]) {
        let side = if self.winding(q) > 0 { -1.0 } else { 1.0 };
        let distance = side * hit.dist_sq.sqrt() as f32;
        if distance.abs() <= 1e-4 {
            return (distance, self.face_normal(hit.face));
        }
        (distance, std::array::from_fn(|d| (q[d] - hit.point[d]) / distance))
    }
}

/// Whether the ray from `q` meets a box, or comes so close that rounding could make it.
fn meets_box(q: [f64; 3], min: [f64; 3], max: [f64; 3]) -> bool {
    // The part of the ray, by its z, that is above the box's bottom and between its sides.
    let (mut from, mut to) = ((min[2] - q[2]).max(0.0), max[2] - q[2]);
    for axis in 0..2 {
        from = from.max((min[axis] - q[axis]) / SLOPE[axis]);
        to = to.min((max[axis] - q[axis]) / SLOPE[axis]);
    }
    from <= to + 1e-9 * (1.0 + to.abs())
}

/// +1 if the ray from `q` leaves through the triangle, -1 if it enters, 0 if it misses.
fn ray_crossing(q: [f64; 3], corners: [[f64; 3]; 3]) -> i32 {
    // Sheared so that the ray goes up from the origin.
    let [a, b, c] = corners.map(|p| {
        let z = p[2] - q[2];
        [p[0] - q[0] - SLOPE[0] * z, p[1] - q[1] - SLOPE[1] * z, z]
    });
    let area = |a: [f64; 3], b: [f64; 3]| a[0] * b[1] - a[1] * b[0];
    // Left of an edge or right of it; on it, one of the two by the order of its ends, so that the next face has the
    // other.
    let left = |a: [f64; 3], b: [f64; 3]| match area(a, b) {
        0.0 => a < b,
        area => area > 0.0,
    };
    let turn = match (left(a, b), left(b, c), left(c, a)) {
        (true, true, true) => 1,
        (false, false, false) => -1,
        _ => return 0,
    };
    let height = area(b, c) * a[2] + area(c, a) * b[2] + area(a, b) * c[2];
    if height * f64::from(turn) > 0.0 { turn } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{AnalyticShape, TetGrid, TriangleMesh, extract_mesh};
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// Its acute edge is on the y axis.
    fn wedge() -> TriangleMesh {
        TriangleMesh {
            verts: vec![
                [0.0, -0.5, 0.0],
                [0.0, 0.5, 0.0],
                [1.0, -0.5, 0.1],
                [1.0, 0.5, 0.1],
                [1.0, -0.5, -0.1],
                [1.0, 0.5, -0.1],
            ],
            faces: vec![
                [0, 2, 3],
                [0, 3, 1],
                [0, 1, 5],
                [0, 5, 4],
                [2, 4, 5],
                [2, 5, 3],
                [0, 4, 2],
                [1, 3, 5],
            ],
        }
    }

    /// Solid angles of all faces over the sphere's: the winding number by its definition.
    fn naive(mesh: &TriangleMesh, q: [f32; 3]) -> f64 {
        let angle = |face: &[u32; 3]| {
            let [a, b, c] = face.map(|v| {
                let d = [0, 1, 2].map(|k| f64::from(mesh.verts[v as usize][k]) - f64::from(q[k]));
                let len = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
                d.map(|x| x / len)
            });
            let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
            let det = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
                + a[2] * (b[0] * c[1] - b[1] * c[0]);
            2.0 * det.atan2(1.0 + dot(a, b) + dot(b, c) + dot(c, a))
        };
        mesh.faces.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
    }

    fn meshed(shape: AnalyticShape, resolution: usize) -> TriangleMesh {
        let grid = TetGrid::working_frame(resolution).unwrap();
        let mut eval = |x: &[[f32; 3]]| Ok(x.iter().map(|&p| shape.sdf(p)).collect::<Vec<f32>>());
        extract_mesh(&grid, &mut eval, &Default::default()).unwrap()
    }

    fn queries(n: usize, seed: u64) -> Vec<[f32; 3]> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..n).map(|_| std::array::from_fn(|_| rng.random_range(-0.6..0.6))).collect()
    }

    #[test]
    fn winds_as_the_solid_angles_say() {
        let torus = meshed(AnalyticShape::Torus { major: 0.34, minor: 0.14 }, 20);
        let mut inward = torus.clone();
        inward.faces.iter_mut().for_each(|f| f.swap(0, 1));
        // One shell within another, both facing outward: twice around what is within both.
        let mut nested = meshed(AnalyticShape::Sphere { radius: 0.5 }, 12);
        let inner = meshed(AnalyticShape::Sphere { radius: 0.3 }, 12);
        let first = nested.verts.len() as u32;
        nested.verts.extend(&inner.verts);
        nested.faces.extend(inner.faces.iter().map(|f| f.map(|v| v + first)));
        for mesh in [torus, inward, nested] {
            let tree = TriangleBvh::new(&mesh).unwrap();
            let queries = queries(400, 5);
            let counts: Vec<i32> = queries.iter().map(|&q| tree.winding(q)).collect();
            for (q, count) in queries.iter().zip(&counts) {
                let want = naive(&mesh, *q);
                assert!((f64::from(*count) - want).abs() < 1e-3, "{count} is not {want} at {q:?}");
            }
            assert!(counts.iter().any(|&c| c != 0) && counts.contains(&0));
        }
    }

    /// Beyond an acute edge the faces that meet in it disagree about the side.
    #[test]
    fn is_right_beyond_sharp_edges() {
        let wedge = wedge();
        assert!(wedge.topology().closed && wedge.topology().volume > 0.0);
        let tree = TriangleBvh::new(&wedge).unwrap();
        for z in [-0.3, -0.01, 0.0, 0.01, 0.3] {
            assert_eq!(tree.winding([-0.4, 0.1, z]), 0);
        }
        assert_eq!(tree.winding([0.9, 0.1, 0.0]), 1);
    }

    #[test]
    fn a_ray_exactly_through_a_corner_or_an_edge_counts_once() {
        // An octahedron with a corner, then the middle of an edge, then the middle of a face exactly on the ray.
        let corners = [
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [-1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, -1.0],
        ];
        let faces: Vec<[usize; 3]> = (0..8)
            .map(|side| {
                let [x, y, z] = [0, 1, 2].map(|axis| if side >> axis & 1 == 1 { axis + 3 } else { axis });
                if (side as u32).count_ones().is_multiple_of(2) { [x, y, z] } else { [x, z, y] }
            })
            .collect();
        let winding = |corners: [[f64; 3]; 6]| -> i32 {
            faces.iter().map(|face| ray_crossing([0.0; 3], face.map(|c| corners[c]))).sum()
        };
        assert_eq!(winding(corners), 1);
        for through in [&[2][..], &[0], &[4], &[0, 2], &[1, 5], &[3, 4], &[0, 1, 2], &[3, 4, 5]] {
            let middle =
                |axis: usize| through.iter().map(|&c| corners[c][axis]).sum::<f64>() / through.len() as f64;
            for height in [-4.0, 4.0] {
                let at = [SLOPE[0] * height, SLOPE[1] * height, height];
                let moved = corners.map(|c| [0, 1, 2].map(|k| c[k] - middle(k) + at[k]));
                assert_eq!(winding(moved), 0, "{through:?} {height}");
            }
        }
        // From inside, through a corner and through the middle of an edge.
        let mut lifted = corners;
        lifted[2] = [SLOPE[0] * 2.0, SLOPE[1] * 2.0, 2.0];
        assert_eq!(winding(lifted), 1);
        lifted[2] = [SLOPE[0] * 2.0 - 1.0, SLOPE[1] * 2.0, 2.0];
        assert_eq!(winding(lifted), 1);
    }

    #[test]
    fn a_surface_with_slivers_has_no_leaks() {
        // A plane of the grid nearly through its vertices leaves faces of hardly any area.
        let grid = TetGrid::working_frame(16).unwrap();
        let mut eval = |x: &[[f32; 3]]| {
            Ok(x.iter()
                .map(|p| p.iter().fold(0.0f32, |m, c| m.max(c.abs())) - 0.375 - 1e-6)
                .collect::<Vec<f32>>())
        };
        let mesh = extract_mesh(&grid, &mut eval, &Default::default()).unwrap();
        let tree = TriangleBvh::new(&mesh).unwrap();
        for q in queries(300, 8) {
            let want = naive(&mesh, q);
            assert!((f64::from(tree.winding(q)) - want).abs() < 1e-3, "{want} at {q:?}");
        }
    }

    /// Where the nearest point is on an acute edge, one of the faces there looks away.
    #[test]
    fn distances_beyond_an_acute_edge_are_positive() {
        let tree = TriangleBvh::new(&wedge()).unwrap();
        for z in [-0.02f32, 0.02] {
            let want = 0.1f32.hypot(0.02);
            let (distance, gradient) = tree.signed_distance([-0.1, 0.1, z]);
            assert!((distance - want).abs() < 1e-5, "{distance}");
            assert!((gradient[0] + 0.1 / want).abs() < 1e-4 && (gradient[2] - z / want).abs() < 1e-4);
        }
        assert!(tree.signed_distance([0.9, 0.1, 0.0]).0 < 0.0);
        // Too close for the way to the surface to have a direction: the face's.
        let (distance, gradient) = tree.signed_distance([1.00005, 0.1, 0.0]);
        assert!((distance - 5e-5).abs() < 1e-6 && gradient == [1.0, 0.0, 0.0], "{distance} {gradient:?}");
    }
}
