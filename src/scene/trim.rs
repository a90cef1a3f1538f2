//! A closed surface cut where no point supports it, along smooth lines.

use super::PointSupport;
use super::boundary::distances_to_boundary;
use crate::geometry::vec3::triangle_area;
use crate::geometry::{Position, TriangleMesh, connected};
use std::collections::HashMap;

/// The [`gap`](PointSupport::gap) beyond which a surface is cut away, unless another one is asked for.
pub const TRIM_FACTOR: f32 = 1.0;
/// How far what is left may reach beyond its outermost points, as a share of the factor.
const MAX_OVERHANG: f32 = 0.6;
/// A hole of less area than this many squares of the surface spacing is not cut: even random points leave such.
const MIN_HOLE: f64 = 4.0;
/// What is left in a piece of less area than this, as many squares of the surface spacing, is dropped: some
/// five points.
const MIN_PIECE: f64 = 5.0;
/// A cut stays this share of an edge's length away from both of its ends, so that no triangle loses its area. It is
/// more than the margin of the grid's crossings, as here triangles may be thin before they are cut.
const CUT_MARGIN: f32 = 1e-3;

/// A surface that was cut.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Trimmed<P = [f32; 3]> {
    /// What is left: the faces and vertices that are kept, in their order, and those along the cut.
    pub mesh: TriangleMesh<P>,
    /// The [`gap`](PointSupport::gap) of each vertex, v.
    pub gap: Vec<f32>,
    /// The share of the area that was cut away, 0 to 1.
    pub removed: f64,
}

/// Cuts off `mesh` what `support`, the support of its vertices (v), says is unsupported.
///
/// In three steps. What has a gap above `factor` is unsupported and cut, except patches of less than 4 squares of the
/// surface spacing, which are kept as holes in the sampling. What is left reaches beyond the outermost points by
/// `factor` surface spacings: so far that wide gaps between points are bridged. Then a strip of 0.4 `factor` surface
/// spacings (1 - MAX_OVERHANG), measured along the surface, is cut off along its boundary, so that it ends 0.6 `factor`
/// beyond the points. Last, pieces of less than 5 squares are dropped.
///
/// Faces that a limit runs through are cut along it, so that the boundary is a smooth line and not a saw. Where `mesh`
/// is a manifold the result is one, its boundary made of closed loops; the orientation stays. Without an unsupported
/// vertex the result is `mesh` itself, but for pieces that are dropped.
///
/// # Panics
/// If there is not one gap and one spacing a vertex, or a face names a vertex that is not there.
#[track_caller]
pub fn trim<P: Position>(mesh: &TriangleMesh<P>, support: &PointSupport, factor: f32) -> Trimmed<P> {
    let PointSupport { gap, surface_spacing: spacing } = support;
    let v = mesh.verts.len();
    assert!(gap.len() == v && spacing.len() == v, "trim: {} gaps, {v} vertices", gap.len());
    let mut squares = vertex_areas(mesh);
    squares.iter_mut().zip(spacing).for_each(|(area, &s)| *area /= f64::from(s) * f64::from(s));
    let mut kept: Vec<bool> = gap.iter().map(|&g| g <= factor).collect();
    turn_small_parts(mesh, &squares, &mut kept, false, MIN_HOLE);
    let inset = factor * (1.0 - MAX_OVERHANG);
    let to_boundary =
        distances_to_boundary(mesh, spacing, &kept, inset, |v, w| cut_share(gap[v], gap[w], factor));
    kept.iter_mut().zip(&to_boundary).for_each(|(kept, &d)| *kept = d > inset);
    turn_small_parts(mesh, &squares, &mut kept, true, MIN_PIECE);
    cut(mesh, gap, &kept, |v, w| cut_share(to_boundary[v], to_boundary[w], inset))
}

/// Turns every connected part of the vertices with `kept == side` (v) whose area is below `limit` to the other side.
/// `squares` is the area around each vertex (v), in the unit of the limit.
fn turn_small_parts<P: Position>(
    mesh: &TriangleMesh<P>,
    squares: &[f64],
    kept: &mut [bool],
    side: bool,
    limit: f64,
) {
    let parts = parts_of(mesh, kept);
    let mut size = vec![0.0; kept.len()];
    parts.iter().zip(squares).for_each(|(&part, area)| size[part as usize] += area);
    for (kept, part) in kept.iter_mut().zip(parts) {
        if *kept == side && size[part as usize] < limit {
            *kept = !side;
        }
    }
}

/// A third of the area of the faces around each vertex.
fn vertex_areas<P: Position>(mesh: &TriangleMesh<P>) -> Vec<f64> {
    let mut areas = vec![0.0; mesh.verts.len()];
    for face in &mesh.faces {
        let third = triangle_area(face.map(|v| mesh.verts[v as usize]).map(P::wide)) / 3.0;
        face.iter().for_each(|&v| areas[v as usize] += third);
    }
    areas
}

/// For each vertex the smallest vertex that edges between vertices of its side lead to.
fn parts_of<P: Position>(mesh: &TriangleMesh<P>, kept: &[bool]) -> Vec<u32> {
    let edges = mesh.faces.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    connected(kept.len(), edges.filter(|[v, w]| kept[*v as usize] == kept[*w as usize]))
}

/// The part of the mesh on the side of the vertices that are kept. `share(v, w)` is where the edge from the kept
/// vertex v to the dropped vertex w is cut, above 0 and below 1.
fn cut<P: Position>(
    mesh: &TriangleMesh<P>,
    gap: &[f32],
    kept: &[bool],
    share: impl Fn(usize, usize) -> f32,
) -> Trimmed<P> {
    let mut out = TriangleMesh { verts: mesh.verts.clone(), faces: Vec::new() };
    let mut values = gap.to_vec();
    let mut crossings: HashMap<[u32; 2], u32> = HashMap::new();
    // The vertex between one that is kept and one that is not.
    let mut between = |v: u32, w: u32, out: &mut TriangleMesh<P>| {
        *crossings.entry([v, w]).or_insert_with(|| {
            let (i, j) = (v as usize, w as usize);
            let t = share(i, j);
            let (p, q) = (mesh.verts[i].wide(), mesh.verts[j].wide());
            out.verts.push(P::of_wide(std::array::from_fn(|k| p[k] + f64::from(t) * (q[k] - p[k]))));
            values.push(gap[i] + t * (gap[j] - gap[i]));
            out.verts.len() as u32 - 1
        })
    };
    let whole: f64 =
        mesh.faces.iter().map(|f| triangle_area(f.map(|v| mesh.verts[v as usize]).map(P::wide))).sum();
    for face in &mesh.faces {
        let inside = face.map(|v| kept[v as usize]);
        match inside.iter().filter(|&&k| k).count() {
            0 => {}
            3 => out.faces.push(*face),
            count => {
                // Turned so that the corner on its own side is the first.
                let alone = inside.iter().position(|&k| k == (count == 1)).expect("one corner is on its own");
                let [a, b, c] = [0, 1, 2].map(|k| face[(alone + k) % 3]);
                if count == 1 {
                    let (ab, ac) = (between(a, b, &mut out), between(a, c, &mut out));
                    out.faces.push([a, ab, ac]);
                } else {
                    let (ba, ca) = (between(b, a, &mut out), between(c, a, &mut out));
                    out.faces.extend([[ba, b, c], [ba, c, ca]]);
                }
            }
        }
    }
    let left: f64 =
        out.faces.iter().map(|f| triangle_area(f.map(|v| out.verts[v as usize]).map(P::wide))).sum();
    let mut used = vec![false; out.verts.len()];
    out.faces.iter().flatten().for_each(|&v| used[v as usize] = true);
    let gap = values.iter().zip(&used).filter(|(_, used)| **used).map(|(&s, _)| s).collect();
    out.remove_unused_verts();
    Trimmed { mesh: out, gap, removed: if whole > 0.0 { (1.0 - left / whole).clamp(0.0, 1.0) } else { 0.0 } }
}

/// Where a value passes `limit` on the way from a vertex that is kept to one that is not, as a share of the edge; the
/// middle where it does not pass it, because one of the two is on its side by the size of its part.
///
/// Not the crossing of the grid's edges (`geometry::grid`): that one takes for granted that the ends differ in sign,
/// and would put such a point at one of them.
fn cut_share(kept: f32, dropped: f32, limit: f32) -> f32 {
    let t = (limit - kept) / (dropped - kept);
    if (0.0..=1.0).contains(&t) { t.clamp(CUT_MARGIN, 1.0 - CUT_MARGIN) } else { 0.5 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{AnalyticShape, NarrowBandOptions, TetGrid, extract_mesh};
    use crate::scene::point_support;
    use crate::scene::testing::sheet;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    fn meshed(shape: AnalyticShape) -> TriangleMesh {
        let grid = TetGrid::working_frame(24).unwrap();
        let mut eval = |x: &[[f32; 3]]| Ok(x.iter().map(|&p| shape.sdf(p)).collect::<Vec<f32>>());
        extract_mesh(&grid, &mut eval, &NarrowBandOptions::default()).unwrap()
    }

    /// Points as far apart as a 60th of the side of the frame, with these gaps.
    fn gaps(gap: Vec<f32>) -> PointSupport {
        PointSupport { surface_spacing: vec![1.0 / 60.0; gap.len()], gap }
    }

    /// Each vertex of the boundary has one edge in and one out, so that the boundary is made of closed loops; no edge
    /// is in three faces.
    fn assert_clean(mesh: &TriangleMesh) {
        let mut uses: BTreeMap<[u32; 2], i32> = BTreeMap::new();
        for &[a, b, c] in &mesh.faces {
            [[a, b], [b, c], [c, a]].into_iter().for_each(|edge| *uses.entry(edge).or_default() += 1);
        }
        assert!(uses.values().all(|&n| n == 1), "an edge is used twice in one direction");
        let (mut out, mut into) = (BTreeMap::new(), BTreeMap::new());
        for &[a, b] in uses.keys().filter(|[a, b]| !uses.contains_key(&[*b, *a])) {
            assert!(out.insert(a, b).is_none() && into.insert(b, a).is_none(), "two boundaries touch");
        }
        assert_eq!(out.len(), into.len());
        let topology = mesh.topology();
        assert!(topology.nonmanifold_edges == 0 && topology.oriented && topology.unused_verts == 0);
        assert_eq!(topology.degenerate_faces, 0);
    }

    /// The height over a plane stands for the gap: the cut is a circle, and the area below it is known.
    #[test]
    fn a_sphere_is_cut_along_a_circle() {
        let sphere = meshed(AnalyticShape::Sphere { radius: 0.4 });
        let height: Vec<f32> = sphere.verts.iter().map(|p| p[2] + 0.4).collect();
        let Trimmed { mesh, gap, removed } = trim(&sphere, &gaps(height), 0.5);
        assert_clean(&mesh);
        let topology = mesh.topology();
        // A disc.
        assert_eq!((topology.components, topology.euler, topology.boundary_loops), (1, 1, 1));
        // Of the height 0.8 of the sphere 0.5 is left less two fifths of half a spacing, and area is as height.
        assert!((removed - 0.375).abs() < 0.01, "{removed}");
        // The cubes are some twelve times as large as the rim that is cut off.
        assert!(gap.iter().all(|&g| g <= 0.5 + 2e-3));
        let onto = mesh.verts.iter().zip(&gap).map(|(p, g)| (p[2] + 0.4 - g).abs()).fold(0.0, f32::max);
        assert!(onto < 1e-6, "{onto}");
    }

    /// Points on a square lattice over the left half of a sheet: what is left bridges the lattice, and ends 0.6 of the
    /// factor beyond its last column.
    #[test]
    fn what_is_left_ends_near_the_outermost_points() {
        let sheet = sheet(0.0, false);
        let points: Vec<[f32; 3]> =
            (0..231).map(|i| [0.05 * (i / 21) as f32, 0.05 * (i % 21) as f32, 0.0]).collect();
        for factor in [0.8, 1.0, 1.5] {
            let support = point_support(&sheet, &points).unwrap();
            let spacing = support.surface_spacing[50 * 101 + 50];
            let trimmed = trim(&sheet, &support, factor).mesh;
            assert_clean(&trimmed);
            let right = trimmed.verts.iter().map(|p| p[0]).fold(0.0, f32::max);
            let overhang = (right - 0.5) / (spacing * factor);
            assert!((0.5..0.75).contains(&overhang), "{factor}: {overhang}");
            assert_eq!(trimmed.topology().boundary_loops, 1);
        }
    }

    #[test]
    fn nothing_beyond_the_factor_leaves_the_mesh_and_all_of_it_nothing() {
        let torus = meshed(AnalyticShape::Torus { major: 0.3, minor: 0.12 });
        let all = trim(&torus, &gaps(vec![1.0; torus.verts.len()]), 2.0);
        assert!(all.mesh == torus && all.removed == 0.0 && all.gap.len() == torus.verts.len());
        let none = trim(&torus, &gaps(vec![3.0; torus.verts.len()]), 2.0);
        assert!(none.mesh == TriangleMesh::default() && none.removed == 1.0 && none.gap.is_empty());
    }

    #[test]
    fn small_holes_are_kept_and_scraps_are_not() {
        let sphere = meshed(AnalyticShape::Sphere { radius: 0.4 });
        let near = |p: &[f32; 3], z: f32| p[0].hypot(p[1]) < 0.015 && p[2] * z > 0.0;
        let hole: Vec<f32> = sphere.verts.iter().map(|p| if near(p, 1.0) { 9.0 } else { 0.5 }).collect();
        assert!(hole.contains(&9.0));
        assert!(trim(&sphere, &gaps(hole), 2.0).mesh == sphere);
        let scrap: Vec<f32> =
            sphere.verts.iter().map(|p| if near(p, 1.0) || p[2] < 0.0 { 0.5 } else { 9.0 }).collect();
        let left = trim(&sphere, &gaps(scrap), 2.0).mesh;
        assert_clean(&left);
        assert_eq!((left.topology().components, left.topology().boundary_loops), (1, 1));
        assert!(left.verts.iter().all(|p| p[2] < 0.1));
    }

    #[test]
    fn a_mesh_far_away_is_cut_as_one_at_the_origin() {
        let at = [450_123.5, 5_411_234.75, 320.0];
        let moved = |p: &[f64; 3]| -> [f64; 3] { std::array::from_fn(|k| p[k] + at[k]) };
        let near = meshed(AnalyticShape::Sphere { radius: 0.4 }).wide();
        let far = TriangleMesh { verts: near.verts.iter().map(moved).collect(), faces: near.faces.clone() };
        let points: Vec<[f64; 3]> = near.verts.iter().copied().filter(|p| p[2] < 0.1).collect();
        let here = trim(&near, &point_support(&near, &points).unwrap(), 2.0);
        let points: Vec<[f64; 3]> = points.iter().map(moved).collect();
        let there = trim(&far, &point_support(&far, &points).unwrap(), 2.0);
        assert!(here.removed > 0.1 && (here.removed - there.removed).abs() < 1e-6);
        assert_eq!(here.mesh.faces, there.mesh.faces);
        for (p, q) in here.mesh.verts.iter().map(moved).zip(&there.mesh.verts) {
            assert!((0..3).all(|k| (p[k] - q[k]).abs() < 1e-6), "{p:?} {q:?}");
        }
        let topology = there.mesh.topology();
        assert!(topology.oriented && topology.degenerate_faces == 0 && topology.boundary_loops == 1);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// Waves in space as the gap: islands, isthmuses and holes of all sizes.
        #[test]
        fn what_is_left_of_a_manifold_is_one(
            waves in prop::collection::vec(prop::array::uniform4(-9.0f32..9.0), 1..5),
            factor in 0.2f32..1.8,
        ) {
            let sphere = meshed(AnalyticShape::Torus { major: 0.3, minor: 0.12 });
            let wave = |p: &[f32; 3], w: &[f32; 4]| (w[0] * p[0] + w[1] * p[1] + w[2] * p[2] + w[3]).sin();
            let at = |p: &[f32; 3]| 1.0 + waves.iter().map(|w| wave(p, w)).sum::<f32>() / waves.len() as f32;
            let gap: Vec<f32> = sphere.verts.iter().map(at).collect();
            let trimmed = trim(&sphere, &gaps(gap), factor);
            if !trimmed.mesh.faces.is_empty() {
                assert_clean(&trimmed.mesh);
                prop_assert_eq!(trimmed.gap.len(), trimmed.mesh.verts.len());
            }
        }
    }
}
