//! The surface of a field on a fine grid, from samples near the surface only.
//!
//! The field is first sampled on every vertex of a coarse lattice. Cubes that may hold the surface are halved, again
//! and again, down to the fine grid. On each level the surface is followed through the faces it crosses, into cubes
//! that nothing predicted, so what is found is always closed; the prediction only has to hit every component once.

use super::crossing::{along, crossing_share};
use super::level::Level;
use super::{ActiveSet, FieldFn, Isosurface, TetGrid, march};
use crate::geometry::TriangleMesh;
use crate::{Error, ErrorKind};

/// How to look for the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct NarrowBandOptions<'a> {
    /// About how many cubes the lattice that is sampled everywhere has along the grid's longest axis. A part of the
    /// surface that is thinner than its cubes can be missed. Default 32.
    pub coarse_resolution: usize,
    /// A cube without a sign change is still halved if its smallest |sdf| is below this many times the change of the
    /// field over one cube diagonal, measured in its neighbourhood. With 0 parts of the surface are lost now
    /// and then (`benches/accuracy.md`, constants). Default 0.3.
    pub safety: f32,
    /// Points near which the surface is expected (n x 3), such as the denoised points. The cubes around them are
    /// sampled on every level, so that parts thinner than the coarse cubes are not lost. Default none.
    pub seeds: &'a [[f32; 3]],
}

impl<'a> NarrowBandOptions<'a> {
    /// The default options with these `seeds` (n x 3).
    pub fn with_seeds(seeds: &'a [[f32; 3]]) -> Self {
        NarrowBandOptions { seeds, ..Default::default() }
    }
}

impl Default for NarrowBandOptions<'_> {
    fn default() -> Self {
        NarrowBandOptions { coarse_resolution: 32, safety: 0.3, seeds: &[] }
    }
}

/// The zero level set of a field on `grid`, sampled only near the surface.
///
/// The result is closed and consistently oriented for any field: the surface is followed wherever it leads, and
/// vertices on the grid's border count as outside, which caps what would run out of the grid. Each component that is
/// found is exactly the one that sampling every vertex would give; a component can be missed only if it is small
/// against the coarse cubes and near no seed. If none is missed, vertices and faces are in the same order, too.
///
/// `eval` is called with large batches: one for each level, then small ones where the surface left the predicted
/// cubes. No vertex is asked for twice. Working memory grows with the square of the resolution, but for a table of
/// one number per 512 vertices.
///
/// # Errors
///
/// [`ErrorKind::NoSurface`] if no sample is negative, [`ErrorKind::Diverged`] if a sample is not finite,
/// [`ErrorKind::Data`] if a seed is not finite, [`ErrorKind::Config`] if an option is out of range, and whatever
/// `eval` fails with.
///
/// # Panics
///
/// If `eval` returns another number of values than it was given positions.
#[track_caller]
pub fn extract_mesh(
    grid: &TetGrid,
    eval: &mut FieldFn<'_>,
    options: &NarrowBandOptions<'_>,
) -> Result<TriangleMesh, Error> {
    let mut level = find_surface(grid, eval, options)?;
    let cubes = std::mem::take(&mut level.mixed);
    let band = level.collect(&cubes, true);
    let Isosurface { edges, faces } = march(&band.tets, |v| band.values[v as usize] < 0.0);
    Ok(TriangleMesh { verts: edge_crossings(&band.positions, &band.values, &edges), faces })
}

/// The vertices and tetrahedra of all cubes with a sign change and of `rings` rings of cubes around them.
///
/// The same search as [`extract_mesh`].
///
/// # Errors
///
/// As [`extract_mesh`].
///
/// # Panics
///
/// If `eval` returns another number of values than it was given positions.
#[track_caller]
pub fn active_set(
    grid: &TetGrid,
    eval: &mut FieldFn<'_>,
    options: &NarrowBandOptions<'_>,
    rings: usize,
) -> Result<ActiveSet, Error> {
    let mut level = find_surface(grid, eval, options)?;
    let cubes = level.dilated(rings);
    level.fill(&cubes, eval)?;
    Ok(level.collect(&cubes, false))
}

/// Where the field is zero on each of e edges (e x 2, indices into v positions and values), by linear interpolation.
///
/// The share of the way along the edge is kept in [1e-4, 1 - 1e-4], so that crossings of different edges at one vertex
/// stay apart and no triangle collapses, as long as coordinates are small enough against the grid's spacing for `f32`
/// to tell them apart.
///
/// # Panics
///
/// If positions and values differ in number, or an edge names a vertex that is not there.
#[track_caller]
pub fn edge_crossings(positions: &[[f32; 3]], values: &[f32], edges: &[[u32; 2]]) -> Vec<[f32; 3]> {
    assert!(
        positions.len() == values.len(),
        "edge_crossings: {} positions but {} values",
        positions.len(),
        values.len()
    );
    let crossing = |&[a, b]: &[u32; 2]| {
        let (a, b) = (a as usize, b as usize);
        along(positions[a], positions[b], crossing_share(values[a], values[b]))
    };
    edges.iter().map(crossing).collect()
}

/// The fine level of the search, or an error if no vertex of it is inside.
#[track_caller]
fn find_surface<'g>(
    grid: &'g TetGrid,
    eval: &mut FieldFn<'_>,
    options: &NarrowBandOptions<'_>,
) -> Result<Level<'g>, Error> {
    let config = |option: &str, value: String, advice: &str| {
        let message = format!("{value} is out of range");
        Error::new(ErrorKind::Config, message).at_element(format!("option {option}")).advise(advice)
    };
    if options.coarse_resolution == 0 {
        return Err(config("coarse_resolution", "0".into(), "use 1 or more; 32 is usual"));
    }
    if !(options.safety >= 0.0 && options.safety.is_finite()) {
        return Err(config("safety", options.safety.to_string(), "use a number of at least 0; 0.3 is usual"));
    }
    if let Some(i) = options.seeds.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        return Err(Error::new(ErrorKind::Data, format!("{:?} is not finite", options.seeds[i]))
            .at_element(format!("seed {i}"))
            .advise("remove the point"));
    }
    let longest = grid.resolution().into_iter().max().unwrap_or(1);
    // Halve until the lattice is within a factor of the square root of two of the coarse resolution.
    let mut stride = 1;
    while longest as f64 / stride as f64 > options.coarse_resolution as f64 * std::f64::consts::SQRT_2 {
        stride *= 2;
    }
    let mut level = Level::new(grid, stride);
    level.sample(level.all_cubes(), eval)?;
    while level.stride > 1 {
        let mut finer = Level::new(grid, level.stride / 2);
        let mut cubes = level.children(options.safety, finer.cubes);
        cubes.extend(options.seeds.iter().flat_map(|&p| finer.cubes_around(p)));
        cubes.sort_unstable();
        cubes.dedup();
        finer.coarser = Some(Box::new(level));
        finer.sample(cubes, eval)?;
        level = finer;
    }
    if level.mixed.is_empty() {
        let samples = level.bricks.values.iter().filter(|v| !v.is_nan());
        let least = samples.fold(f32::INFINITY, |m, &v| m.min(v));
        return Err(Error::new(
            ErrorKind::NoSurface,
            format!("the field is nowhere negative inside the grid (least sample {least:e})"),
        )
        .advise("raise the resolution, pass the input points as seeds, or check the field's sign and the grid's box"));
    }
    Ok(level)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;
    use std::collections::BTreeSet;

    type Field = Box<dyn Fn([f32; 3]) -> f32>;

    /// Values and mesh of the field on every vertex of the grid.
    fn dense(grid: &TetGrid, field: &Field) -> (Vec<f32>, TriangleMesh) {
        let ids = 0..grid.vertex_count() as u32;
        let positions: Vec<_> = ids.clone().map(|v| grid.position(v)).collect();
        let raise = |v: u32, x: f32| {
            if grid.is_border(grid.vertex_coords(v)) { x.max(1e-3 * grid.spacing()) } else { x }
        };
        let values: Vec<f32> = ids.zip(&positions).map(|(v, &p)| raise(v, field(p))).collect();
        let surface = march(&grid.tets(), |v| values[v as usize] < 0.0);
        let verts = edge_crossings(&positions, &values, &surface.edges);
        (values, TriangleMesh { verts, faces: surface.faces })
    }

    /// Extracts and also checks that no position is sampled twice.
    fn sparse(grid: &TetGrid, field: &Field, options: NarrowBandOptions<'_>) -> Result<TriangleMesh, Error> {
        let mut asked = BTreeSet::new();
        let mut eval = |positions: &[[f32; 3]]| {
            assert!(positions.iter().all(|p| asked.insert(p.map(f32::to_bits))), "sampled twice");
            Ok(positions.iter().map(|&p| field(p)).collect())
        };
        extract_mesh(grid, &mut eval, &options)
    }

    fn triangles(mesh: &TriangleMesh) -> BTreeSet<[[u32; 3]; 3]> {
        mesh.faces.iter().map(|f| f.map(|v| mesh.verts[v as usize].map(f32::to_bits))).collect()
    }

    /// Blobs: `level` minus a sum of Gaussians, with centres in the unit cube and widths of `width` to twice that.
    fn blobs(width: f32) -> impl Strategy<Value = (Vec<[f32; 5]>, f32)> {
        let blob = (prop::array::uniform3(0.1f32..0.9), width..2.0 * width, 0.5f32..1.0)
            .prop_map(|([x, y, z], s, a)| [x, y, z, s, a]);
        (prop::collection::vec(blob, 1..7), 0.15f32..0.6)
    }

    fn blob_field((blobs, level): (Vec<[f32; 5]>, f32)) -> Field {
        Box::new(move |p| {
            let part = |b: &[f32; 5]| {
                let d_sq: f32 = (0..3).map(|a| (p[a] - b[a]).powi(2)).sum();
                b[4] * (-d_sq / (2.0 * b[3] * b[3])).exp()
            };
            level - blobs.iter().map(part).sum::<f32>()
        })
    }

    fn wave_field(waves: Vec<[f32; 4]>, level: f32) -> Field {
        Box::new(move |p| {
            let part = |w: &[f32; 4]| (w[0] * p[0] + w[1] * p[1] + w[2] * p[2] + w[3]).sin();
            level + waves.iter().map(part).sum::<f32>()
        })
    }

    fn unit_grid(resolution: usize) -> TetGrid {
        TetGrid::covering([0.0; 3], [1.0, 0.9, 0.7], resolution, 0).unwrap()
    }

    fn torus() -> Field {
        Box::new(|p| {
            let [x, y, z] = p.map(|x| x - 0.45);
            (x.hypot(y) - 0.28).hypot(z + 0.1) - 0.11
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 40, rng_seed: RngSeed::Fixed(7), failure_persistence: None, ..Default::default()
        })]
        /// Smooth against the coarse cubes: nothing is missed, and the meshes are the same to the bit.
        #[test]
        fn smooth_fields_give_the_dense_mesh(
            blobs in blobs(0.1),
            waves in prop::collection::vec(prop::array::uniform4(-9.0f32..9.0), 1..5),
            level in -1.0f32..1.0,
            resolution in 4usize..41,
            coarse in 12usize..33,
            wavy in any::<bool>(),
        ) {
            let grid = unit_grid(resolution);
            let field = if wavy { wave_field(waves, level) } else { blob_field(blobs) };
            let want = dense(&grid, &field).1;
            match sparse(&grid, &field, NarrowBandOptions { coarse_resolution: coarse, ..Default::default() }) {
                Ok(mesh) => prop_assert!(mesh == want, "{} and {} faces", mesh.faces.len(), want.faces.len()),
                Err(e) => {
                    prop_assert_eq!(e.kind(), ErrorKind::NoSurface);
                    prop_assert!(want.faces.is_empty());
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        /// Any field and any start: what is found is closed and consists of whole components of the dense mesh.
        #[test]
        fn rough_fields_give_whole_components(
            waves in prop::collection::vec(prop::array::uniform4(-60.0f32..60.0), 1..5),
            level in -2.0f32..2.0,
            resolution in 4usize..34,
            coarse in 1usize..9,
            safety in 0.0f32..1.0,
        ) {
            let grid = unit_grid(resolution);
            let field = wave_field(waves, level);
            let want = dense(&grid, &field).1;
            let options = NarrowBandOptions { coarse_resolution: coarse, safety, seeds: &[] };
            let Ok(mesh) = sparse(&grid, &field, options) else { return Ok(()) };
            let t = mesh.topology();
            prop_assert!(t.closed && t.oriented && t.volume > 0.0);
            prop_assert!(triangles(&mesh).is_subset(&triangles(&want)));
        }

        #[test]
        fn active_set_is_the_dilated_dense_one(
            blobs in blobs(0.1), resolution in 4usize..20, rings in 0usize..4,
        ) {
            let grid = unit_grid(resolution);
            let field = blob_field(blobs);
            let (values, mesh) = dense(&grid, &field);
            let mut eval = |p: &[[f32; 3]]| Ok(p.iter().map(|&p| field(p)).collect());
            let Ok(set) = active_set(&grid, &mut eval, &NarrowBandOptions::default(), rings) else {
                prop_assert!(mesh.faces.is_empty());
                return Ok(());
            };
            let cubes: Vec<_> = grid.tets().chunks(6).map(|tets| (tets[0][0], tets.to_vec())).collect();
            let corners = |tets: &[[u32; 4]]| tets.iter().flatten().copied().collect::<BTreeSet<_>>();
            let mixed = |tets: &[[u32; 4]]| {
                let inside = corners(tets).iter().filter(|&&v| values[v as usize] < 0.0).count();
                (1..8).contains(&inside)
            };
            let hits: Vec<_> =
                cubes.iter().filter(|c| mixed(&c.1)).map(|c| grid.vertex_coords(c.0)).collect();
            let near = |c: [usize; 3]| hits.iter().any(|h| (0..3).all(|a| h[a].abs_diff(c[a]) <= rings));
            let want: Vec<[u32; 4]> =
                cubes.iter().filter(|c| near(grid.vertex_coords(c.0))).flat_map(|c| c.1.clone()).collect();
            let tets: Vec<_> = set.tets.iter().map(|t| t.map(|v| set.ids[v as usize])).collect();
            prop_assert_eq!(&tets, &want);
            prop_assert_eq!(&set.ids, &corners(&want).into_iter().collect::<Vec<_>>());
            for (i, &id) in set.ids.iter().enumerate() {
                prop_assert_eq!(set.values[i], values[id as usize]);
                prop_assert_eq!(set.positions[i], grid.position(id));
            }
            let mut surface = Isosurface::default();
            let inside: Vec<_> = set.values.iter().map(|&v| v < 0.0).collect();
            set.topology().march_into(&inside, &mut surface);
            let verts = edge_crossings(&set.positions, &set.values, &surface.edges);
            prop_assert_eq!(TriangleMesh { verts, faces: surface.faces }, mesh);
        }
    }

    #[test]
    fn every_small_resolution() {
        let field = torus();
        for resolution in 1..13 {
            for coarse_resolution in [1, 4, 32] {
                let grid = unit_grid(resolution);
                let want = dense(&grid, &field).1;
                let options = NarrowBandOptions { coarse_resolution, ..Default::default() };
                match sparse(&grid, &field, options) {
                    Ok(mesh) => {
                        assert!(triangles(&mesh).is_subset(&triangles(&want)) && mesh.topology().closed)
                    }
                    Err(e) => assert_eq!(e.kind(), ErrorKind::NoSurface),
                }
            }
        }
    }

    #[test]
    fn a_fine_torus_needs_few_samples() {
        let grid = TetGrid::covering([0.0; 3], [1.0; 3], 96, 2).unwrap();
        let field = torus();
        let mut samples = 0;
        let mut eval = |p: &[[f32; 3]]| {
            samples += p.len();
            Ok(p.iter().map(|&p| field(p)).collect())
        };
        let mesh = extract_mesh(&grid, &mut eval, &NarrowBandOptions::default()).unwrap();
        assert_eq!(mesh, dense(&grid, &field).1);
        assert_eq!(mesh.topology().genus, Some(1));
        assert!(samples < grid.vertex_count() / 6, "{samples} of {} vertices", grid.vertex_count());
    }

    #[test]
    fn what_runs_out_of_the_grid_is_capped() {
        let grid = TetGrid::new([40, 40, 40], [0.0; 3], 0.025);
        let half: Field = Box::new(|p| p[0] - 0.5);
        let everywhere: Field = Box::new(|_| -1.0);
        for (field, volume) in [(half, 0.5), (everywhere, 1.0)] {
            let t = sparse(&grid, &field, NarrowBandOptions::default()).unwrap().topology();
            assert!(t.closed && t.oriented && t.genus == Some(0));
            assert!((t.volume - volume).abs() < 0.02, "{t}");
        }
    }

    #[test]
    fn seeds_find_what_falls_between_coarse_vertices() {
        let grid = TetGrid::new([128; 3], [0.0; 3], 1.0 / 128.0);
        // A big ball, and a dot that the field hides from the coarse lattice.
        let field: Field = Box::new(|p| {
            let ball = |c: [f32; 3], r: f32| (0..3).map(|a| (p[a] - c[a]).powi(2)).sum::<f32>().sqrt() - r;
            let dot = ball([0.861; 3], 0.012);
            ball([0.4; 3], 0.25).min(if dot < 0.004 { dot } else { 1.0 })
        });
        let lost = sparse(&grid, &field, NarrowBandOptions::default()).unwrap();
        assert_eq!(lost.topology().components, 1);
        let seeds = [[0.86, 0.86, 0.865], [-3.0; 3], [1.0; 3]];
        let found = sparse(&grid, &field, NarrowBandOptions { seeds: &seeds, ..Default::default() }).unwrap();
        assert_eq!(found.topology().components, 2);
        assert!(triangles(&lost).is_subset(&triangles(&found)));
    }

    #[test]
    fn failures_say_what_to_do() {
        let grid = unit_grid(40);
        let kind = |field: Field, options| sparse(&grid, &field, options).unwrap_err().kind();
        let usual = NarrowBandOptions::default();
        assert_eq!(kind(Box::new(|_| 1.0), usual), ErrorKind::NoSurface);
        assert_eq!(kind(Box::new(|p| if p[0] > 0.8 { f32::NAN } else { 1.0 }), usual), ErrorKind::Diverged);
        assert_eq!(kind(Box::new(|_| f32::NEG_INFINITY), usual), ErrorKind::Diverged);
        assert_eq!(kind(torus(), NarrowBandOptions { coarse_resolution: 0, ..usual }), ErrorKind::Config);
        assert_eq!(kind(torus(), NarrowBandOptions { safety: f32::NAN, ..usual }), ErrorKind::Config);
        let seeds = [[0.0; 3], [0.0, f32::INFINITY, 0.0]];
        let error = sparse(&grid, &torus(), NarrowBandOptions { seeds: &seeds, ..usual }).unwrap_err();
        assert_eq!((error.kind(), error.element()), (ErrorKind::Data, Some("seed 1")));
        let mut refuse = |_: &[[f32; 3]]| Err(Error::new(ErrorKind::Cancelled, "stop"));
        assert_eq!(extract_mesh(&grid, &mut refuse, &usual).unwrap_err().kind(), ErrorKind::Cancelled);
    }

    #[test]
    fn crossings_stay_off_the_vertices() {
        let positions = [[0.0; 3], [1.0, 2.0, -1.0], [0.0, 1.0, 0.0]];
        let values = [-1.0, 3.0, 0.0];
        assert_eq!(edge_crossings(&positions, &values, &[[0, 1]]), [[0.25, 0.5, -0.25]]);
        assert_eq!(edge_crossings(&positions, &values, &[[0, 2]]), [[0.0, 1.0 - 1e-4, 0.0]]);
        assert_eq!(edge_crossings(&positions, &[f32::MIN, f32::MAX, 0.0], &[[0, 1]]), [[0.5, 1.0, -0.5]]);
        assert!(edge_crossings(&[], &[], &[]).is_empty());
    }
}
