//! Charts: around every point of Q, a piece of a curved surface through it, seen from its code on the sphere.
//!
//! Used with the option `bsp.charts`, which of the presets only `paper` has.
//!
//! They give Psi something to start from that fills the gaps between points: the patch of codes around a point's code
//! becomes a disc around the point, as large as its share of the surface, in the plane of its normal (that of the first
//! shape, or of its neighbours), tilted and bent as the neighbours lie. What Psi learns is added to it. The paper lets
//! Psi make positions from nothing.

use super::BspConfig;
use crate::autodiff::{At, Op, Tape, Var};
use crate::geometry::vec3::{dot, sub};
use crate::geometry::{PrincipalAxes, spread};
use crate::tensor::Tensor;
use nalgebra::{Matrix5, Vector3, Vector5};
use std::sync::Arc;

/// The number of neighbours that a chart is fitted to.
pub(super) const FITTED: usize = 12;
/// The neighbour whose distance is the measure of a point's share of the surface.
const SHARE_NEIGHBOUR: usize = 8;
/// Radius of a disc, in radii of a circle with the point's share of the surface: a little more, so that discs overlap.
const OVERLAP: f64 = 1.1;
/// Weight of flatness in the fit, where the weights of the neighbours are about 1.
const FLAT: f64 = 0.01;
/// The greatest height of a chart at its rim, in radii.
const MAX_RISE: f64 = 0.6;

/// s = q + x t_1 + y t_2 + h(x, y) n with (x, y) = scale (<p - u, e_1>, <p - u, e_2>) and
/// h = a x + b y + c x^2 + d x y + e y^2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Chart {
    /// q, working frame.
    origin: [f32; 3],
    /// u, the code of the point: unit length.
    code: [f32; 3],
    /// e_1 and e_2, which span the sphere's tangent plane at u.
    code_axes: [[f32; 3]; 2],
    /// t_1, t_2 and n, at right angles, of unit length.
    axes: [[f32; 3]; 3],
    /// Length in space of a unit of length on the sphere.
    scale: f32,
    /// a to e.
    height: [f32; 5],
}

impl Chart {
    /// h and its derivatives by x and y.
    fn height(&self, x: f32, y: f32) -> (f32, f32, f32) {
        let [a, b, c, d, e] = self.height;
        (a * x + b * y + c * x * x + d * x * y + e * y * y, a + 2.0 * c * x + d * y, b + d * x + 2.0 * e * y)
    }

    /// (x, y) of a code.
    fn local(&self, p: &[f32; 3]) -> (f32, f32) {
        let step = sub(*p, self.code);
        let [x, y] = self.code_axes.map(|axis| self.scale * dot(step, axis));
        (x, y)
    }

    /// Where a code p lies in space.
    fn place(&self, p: &[f32; 3]) -> [f32; 3] {
        let (x, y) = self.local(p);
        let (h, _, _) = self.height(x, y);
        let [t1, t2, n] = &self.axes;
        std::array::from_fn(|d| self.origin[d] + x * t1[d] + y * t2[d] + h * n[d])
    }

    /// The gradient at the code p from that at its place.
    fn pull(&self, p: &[f32; 3], ds: &[f32; 3]) -> [f32; 3] {
        let (x, y) = self.local(p);
        let (_, hx, hy) = self.height(x, y);
        let [t1, t2, n] = self.axes;
        let dh = dot(*ds, n);
        let (dx, dy) = (self.scale * (dot(*ds, t1) + hx * dh), self.scale * (dot(*ds, t2) + hy * dh));
        std::array::from_fn(|d| dx * self.code_axes[0][d] + dy * self.code_axes[1][d])
    }

    /// The radius of the disc that a patch becomes, working frame.
    pub(super) fn radius(&self, cap: f32) -> f32 {
        self.scale * cap
    }
}

/// The radius on the sphere of a patch of M out of m evenly spread codes.
pub(super) fn cap_radius(patch: usize, codes: usize) -> f32 {
    2.0 * (patch as f32 / codes.max(1) as f32).sqrt()
}

/// The chart of one point, `q` with its `code`; `near` are its neighbours' places with their codes, itself not among
/// them, nearest first; the normal, if it is known, of either sign; `cap` the radius of a patch on the sphere. The axes
/// on the sphere are turned, or mirrored and turned, so that directions to neighbours match those to their codes best.
pub(super) fn chart(
    q: [f32; 3],
    code: [f32; 3],
    near: &[([f32; 3], [f32; 3])],
    normal: Option<[f32; 3]>,
    cap: f32,
) -> Chart {
    let wide = |p: [f32; 3]| Vector3::from(p.map(f64::from));
    let (origin, centre) = (wide(q), wide(code));
    let steps: Vec<Vector3<f64>> = near.iter().map(|(p, _)| wide(*p) - origin).collect();
    let mean = steps.iter().map(Vector3::norm).sum::<f64>() / steps.len().max(1) as f64;
    let unit = if mean > 0.0 { mean } else { 1.0 };
    let weight = |step: &Vector3<f64>| (-0.5 * (step / unit).norm_squared()).exp();
    let normal = normal
        .and_then(|n| wide(n).try_normalize(1e-9))
        .unwrap_or_else(|| PrincipalAxes::of_spread(spread(steps.iter().map(|d| (*d, weight(d))))).normal());
    let (t1, t2) = span(normal);
    let (mut e1, mut e2) = span(centre);

    // The turn (or mirrored turn) of the tangent plane that brings neighbours and their codes into line best.
    let (mut turned, mut mirrored) = ([0.0f64; 2], [0.0f64; 2]);
    for (step, (_, code)) in steps.iter().zip(near) {
        let on_sphere = wide(*code) - centre;
        let (x, y) = (step.dot(&t1), step.dot(&t2));
        let (v, w) = (on_sphere.dot(&e1), on_sphere.dot(&e2));
        let weight = weight(step) / (1e-12 + on_sphere.norm() * step.norm());
        // z conj(c) and z c, of z = x + iy in space and c = v + iw on the sphere.
        turned = [turned[0] + weight * (x * v + y * w), turned[1] + weight * (y * v - x * w)];
        mirrored = [mirrored[0] + weight * (x * v - y * w), mirrored[1] + weight * (y * v + x * w)];
    }
    let size = |z: [f64; 2]| z[0].hypot(z[1]);
    let turn = if size(mirrored) > size(turned) {
        e2 = -e2;
        mirrored
    } else {
        turned
    };
    if size(turn) > 0.0 {
        let (cos, sin) = (turn[0] / size(turn), turn[1] / size(turn));
        // The axes turn so that the new (x, y) of a code is its old one, turned by the angle of `turn`.
        (e1, e2) = (e1 * cos - e2 * sin, e1 * sin + e2 * cos);
    }

    // Neighbours on the same sheet are ordered by more than their distance.
    let share = steps.iter().take(SHARE_NEIGHBOUR).map(Vector3::norm).fold(0.0, f64::max);
    let radius = OVERLAP * share / (steps.len().clamp(1, SHARE_NEIGHBOUR) as f64).sqrt();
    let height = fit(&steps, [t1, t2, normal], unit, weight, radius);
    let narrow = |v: Vector3<f64>| [v.x as f32, v.y as f32, v.z as f32];
    Chart {
        origin: q,
        code,
        code_axes: [narrow(e1), narrow(e2)],
        axes: [narrow(t1), narrow(t2), narrow(normal)],
        scale: (radius / f64::from(cap)) as f32,
        height,
    }
}

/// The height over the tangent plane by weighted least squares, no steeper at the rim than [`MAX_RISE`].
fn fit(
    steps: &[Vector3<f64>],
    [t1, t2, n]: [Vector3<f64>; 3],
    unit: f64,
    weight: impl Fn(&Vector3<f64>) -> f64,
    radius: f64,
) -> [f32; 5] {
    let mut matrix = Matrix5::from_diagonal_element(FLAT);
    let mut right = Vector5::zeros();
    for step in steps {
        let (x, y, z) = (step.dot(&t1) / unit, step.dot(&t2) / unit, step.dot(&n) / unit);
        let row = Vector5::new(x, y, x * x, x * y, y * y);
        matrix += row * row.transpose() * weight(step);
        right += row * (z * weight(step));
    }
    // The diagonal makes it positive definite.
    let found = matrix.cholesky().map_or_else(Vector5::zeros, |factor| factor.solve(&right));
    let rim = radius / unit;
    let rise = (found[0].hypot(found[1])) + rim * (found[2].abs() + 0.5 * found[3].abs() + found[4].abs());
    let damped = found * (MAX_RISE / rise.max(MAX_RISE));
    [damped[0], damped[1], damped[2] / unit, damped[3] / unit, damped[4] / unit].map(|v| v as f32)
}

/// Two vectors that make a right-handed frame with the unit vector n.
fn span(n: Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let least = Vector3::ith(n.iamin(), 1.0);
    let t1 = n.cross(&least).normalize();
    (t1, n.cross(&t1))
}

/// The charts of all `points` (n x 3) with their codes (n x 3); `near` lists for each point k others from near to far
/// (n k), and possibly itself, which is left out.
pub(super) fn charts(
    points: &[[f32; 3]],
    codes: &[[f32; 3]],
    normals: Option<&[[f32; 3]]>,
    near: &[u32],
    config: &BspConfig,
) -> Vec<Chart> {
    let n = points.len();
    let k = near.len() / n.max(1);
    let cap = cap_radius(config.patch, config.codes(n));
    (0..n)
        .map(|i| {
            let others = near[i * k..(i + 1) * k].iter().map(|&j| j as usize).filter(|&j| j != i);
            let near: Vec<_> = others.map(|j| (points[j], codes[j])).collect();
            chart(points[i], codes[i], &near, normals.map(|m| m[i]), cap)
        })
        .collect()
}

/// The places of codes in the charts of their patches' centres.
struct Place {
    charts: Arc<[Chart]>,
    patch: usize,
}

impl Op<1> for Place {
    type Saved = ();
    fn forward(&self, [p]: [&Tensor; 1]) -> (Tensor, ()) {
        let mut s = p.uninit_like(p.dims());
        let rows = s.data_mut().as_chunks_mut::<3>().0.iter_mut().zip(p.data().as_chunks::<3>().0);
        for (r, (s, p)) in rows.enumerate() {
            *s = self.charts[r / self.patch].place(p);
        }
        (s, ())
    }
    fn vjp(&self, at: At<'_, 1, ()>, ds: &Tensor) -> [Option<Tensor>; 1] {
        let mut dp = ds.uninit_like(ds.dims());
        let inputs = at.x[0].data().as_chunks::<3>().0.iter().zip(ds.data().as_chunks::<3>().0);
        for (r, (dp, (p, ds))) in dp.data_mut().as_chunks_mut::<3>().0.iter_mut().zip(inputs).enumerate() {
            *dp = self.charts[r / self.patch].pull(p, ds);
        }
        [Some(dp)]
    }
}

/// The places in space, (b M) x 3, of the codes of b patches, (b M) x 3, each in the chart of its patch. Gradient:
/// smooth.
///
/// # Panics
/// If the shapes do not fit.
#[track_caller]
pub(super) fn place(tape: &mut Tape, patches: Var, charts: &Arc<[Chart]>, patch: usize) -> Var {
    let shape = tape.value(patches).shape();
    assert!(
        shape.cols() == 3 && shape.rows() == charts.len() * patch,
        "charts: codes {shape:?} for {} charts of {patch}",
        charts.len()
    );
    tape.apply(Place { charts: charts.clone(), patch }, [patches])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{KdTree, fibonacci_sphere};
    use crate::ops::testing::{check, normal};
    use proptest::prelude::*;

    /// Charts of points that are their own layout.
    fn of_sphere(n: usize, radius: f32) -> (Vec<[f32; 3]>, Vec<Chart>, f32) {
        let codes = fibonacci_sphere(n);
        let points: Vec<[f32; 3]> = codes.iter().map(|u| u.map(|x| radius * x)).collect();
        let config = BspConfig { code_density: 1.0, ..super::super::config::tests::small(None, false) };
        let near = KdTree::new(&points).k_nearest(&points, FITTED + 1);
        let cap = cap_radius(config.patch, config.codes(n));
        (codes.clone(), charts(&points, &codes, None, &near, &config), cap)
    }

    #[test]
    fn charts_of_a_sphere_stay_on_it_and_agree_with_each_other() {
        let (codes, charts, cap) = of_sphere(400, 0.5);
        for (i, chart) in charts.iter().enumerate() {
            assert_eq!(chart.place(&codes[i]), codes[i].map(|x| 0.5 * x));
            // What lies in a direction on the sphere lies there in space.
            for code in
                codes.iter().filter(|c| (0..3).map(|d| (c[d] - codes[i][d]).powi(2)).sum::<f32>() < 0.0225)
            {
                let place = chart.place(code);
                let off = (0..3).map(|d| (place[d] - 0.5 * code[d]).powi(2)).sum::<f32>().sqrt();
                assert!(off < 0.01, "{off}");
            }
            let radius = chart.radius(cap);
            let share = 0.5 * 2.0 / 400f32.sqrt();
            assert!((radius / share - 1.1).abs() < 0.2, "{radius} {share}");
        }
    }

    #[test]
    fn a_mirrored_layout_turns_the_charts_over() {
        let (codes, _, cap) = of_sphere(200, 0.5);
        let points: Vec<[f32; 3]> = codes.iter().map(|u| [-0.5 * u[0], 0.5 * u[1], 0.5 * u[2]]).collect();
        let config = super::super::config::tests::small(None, false);
        let near = KdTree::new(&points).k_nearest(&points, FITTED + 1);
        let charts = charts(&points, &codes, None, &near, &config);
        for (chart, code) in charts.iter().zip(&codes) {
            let aside = std::array::from_fn(|d| code[d] + 0.5 * cap * chart.code_axes[0][d]);
            let place = chart.place(&aside);
            let want = [-0.5 * aside[0], 0.5 * aside[1], 0.5 * aside[2]];
            let off = (0..3).map(|d| (place[d] - want[d]).powi(2)).sum::<f32>().sqrt();
            assert!(off < 0.03, "{off}");
        }
    }

    #[test]
    fn few_and_equal_neighbours_give_finite_charts() {
        for near in [vec![], vec![([0.0; 3], [0.0, 1.0, 0.0])], vec![([1.0, 0.0, 0.0], [1.0, 0.0, 0.0]); 3]] {
            let chart = chart([0.0; 3], [0.0, 0.0, 1.0], &near, None, 0.3);
            let place = chart.place(&[0.1, 0.2, 0.9]);
            assert!(place.iter().all(|x| x.is_finite()), "{near:?}: {chart:?}");
        }
    }

    #[test]
    fn a_chart_is_not_steeper_than_allowed() {
        // A neighbour straight above.
        let near = [([0.01, 0.0, 1.0], [0.0, 1.0, 0.0]), ([0.1, 0.1, 0.0], [1.0, 0.0, 0.0])];
        let chart = chart([0.0; 3], [0.0, 0.0, 1.0], &near, Some([0.0, 0.0, 1.0]), 0.3);
        let radius = chart.radius(0.3);
        for i in 0..16 {
            let (sin, cos) = (i as f32 * 0.4).sin_cos();
            assert!(chart.height(radius * cos, radius * sin).0.abs() <= 0.61 * radius);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn gradients(seed: u64, patch in 1usize..4) {
            let points = normal(&[14, 3], seed).to_points();
            let codes = fibonacci_sphere(14);
            let near = KdTree::new(&points).k_nearest(&points, FITTED);
            let config = super::super::config::tests::small(None, false);
            let charts: Arc<[Chart]> = charts(&points, &codes, None, &near, &config)[..5].into();
            let p = normal(&[5 * patch, 3], seed ^ 1);
            check(|t, x| place(t, x[0], &charts, patch), &[p], seed);
        }
    }
}
