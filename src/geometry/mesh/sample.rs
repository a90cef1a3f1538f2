//! Random points on a mesh.

use super::TriangleMesh;
use crate::error::{Error, ErrorKind};
use crate::geometry::vec3::{length, triangle_normal, wide};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

/// Samples drawn from one random stream; fixed, so that the result does not depend on the thread count.
const CHUNK: usize = 4096;

/// Points on a mesh, with where they came from. All four lists have one entry a sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceSamples {
    /// Positions, n x 3, in the mesh's frame.
    pub points: Vec<[f32; 3]>,
    /// Unit normals of the faces the points lie on, n x 3, outward for counter-clockwise faces.
    pub normals: Vec<[f32; 3]>,
    /// Index of the face each point lies on, n.
    pub faces: Vec<u32>,
    /// Weights of the face's three corners, n x 3, each at least 0 and together 1.
    pub barycentric: Vec<[f32; 3]>,
}

/// `count` independent points on `mesh`, uniform by area.
///
/// The face is drawn from the cumulative areas (f64), the place in it by the square-root map of two uniform numbers
/// (Turk 1990, "Generating random points in triangles"). The same mesh, count and seed give the same bytes for any
/// thread count, and a longer list starts with the shorter one.
///
/// # Errors
/// [`ErrorKind::Data`] if the mesh has no face, no area, a face that names a missing vertex, or a vertex in use that is
/// not finite (the face is named).
pub fn sample_surface(mesh: &TriangleMesh, count: usize, seed: u64) -> Result<SurfaceSamples, Error> {
    let cumulative = cumulative(mesh)?;
    let total = cumulative[cumulative.len() - 1];
    let mut out = SurfaceSamples {
        points: vec![[0.0; 3]; count],
        normals: vec![[0.0; 3]; count],
        faces: vec![0; count],
        barycentric: vec![[0.0; 3]; count],
    };
    let places = out.points.par_chunks_mut(CHUNK).zip(out.normals.par_chunks_mut(CHUNK));
    let origins = out.faces.par_chunks_mut(CHUNK).zip(out.barycentric.par_chunks_mut(CHUNK));
    places.zip(origins).enumerate().for_each(|(chunk, ((points, normals), (faces, weights)))| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(chunk as u64);
        for i in 0..points.len() {
            let [t, r, s] = [(); 3].map(|()| rng.random::<f64>());
            // The first face whose cumulative area exceeds the draw; faces without area are never that.
            let face = cumulative.partition_point(|&c| c <= t * total).min(cumulative.len() - 1);
            let [a, b, c] = mesh.faces[face].map(|v| mesh.verts[v as usize].map(f64::from));
            let r = r.sqrt();
            let w = [1.0 - r, r * (1.0 - s), r * s];
            points[i] = std::array::from_fn(|k| (w[0] * a[k] + w[1] * b[k] + w[2] * c[k]) as f32);
            let n = triangle_normal([a, b, c]);
            let len = length(n);
            normals[i] = n.map(|x| (x / len) as f32);
            faces[i] = face as u32;
            weights[i] = w.map(|x| x as f32);
        }
    });
    Ok(out)
}

/// Twice the areas of the faces, summed up to and including each, cut after the last face that has area.
fn cumulative(mesh: &TriangleMesh) -> Result<Vec<f64>, Error> {
    let bad = |face: usize, message: String| {
        Error::new(ErrorKind::Data, message).at_element(format!("face {face}")).advise("repair the mesh")
    };
    let verts = mesh.verts.len();
    let missing = |face: &[u32; 3]| face.iter().copied().find(|&v| v as usize >= verts);
    if let Some((f, v)) = mesh.faces.iter().enumerate().find_map(|(f, face)| Some((f, missing(face)?))) {
        return Err(bad(f, format!("vertex {v} of {verts} does not exist")));
    }
    let mut cumulative = cumulative_areas(&mesh.verts, &mesh.faces);
    if let Some(f) = cumulative.iter().position(|sum| !sum.is_finite()) {
        let corners = mesh.faces[f].map(|v| mesh.verts[v as usize]);
        return Err(bad(f, format!("corners {corners:?} are not finite")));
    }
    let total = cumulative.last().copied().unwrap_or(0.0);
    if total == 0.0 {
        return Err(Error::new(
            ErrorKind::Data,
            format!("a mesh of {} faces has no area to sample", mesh.faces.len()),
        )
        .advise("give a mesh with at least one proper triangle"));
    }
    cumulative.truncate(cumulative.partition_point(|&sum| sum < total) + 1);
    Ok(cumulative)
}

/// Twice the areas of the faces (f x 3) of a mesh with vertices v x 3, summed up to and including each, f.
///
/// # Panics
/// If a face names a vertex that is not there.
#[track_caller]
pub(crate) fn cumulative_areas(verts: &[[f32; 3]], faces: &[[u32; 3]]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut add = |face: &[u32; 3]| {
        let normal = triangle_normal(face.map(|v| wide(verts[v as usize])));
        sum += length(normal);
        sum
    };
    faces.iter().map(&mut add).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fan of triangles of very different areas, with faces that have none between and after them.
    fn fan() -> TriangleMesh {
        let mut verts = vec![[0.0, 0.0, 0.0]];
        let mut faces = Vec::new();
        for i in 0..10u32 {
            let r = 0.1 * (1.0 + i as f32);
            let z = i as f32;
            verts.extend([[r, 0.0, z], [0.0, r, z], [0.0, 0.0, z]]);
            faces.push([3 * i + 1, 3 * i + 2, 3 * i + 3]);
            faces.push([3 * i + 1, 3 * i + 2, 3 * i + 2]);
        }
        TriangleMesh { verts, faces }
    }

    #[test]
    fn faces_are_hit_in_proportion_to_their_area() {
        let mesh = fan();
        let n = 50_000;
        let s = sample_surface(&mesh, n, 3).unwrap();
        let mut hits = [0f64; 20];
        for &f in &s.faces {
            hits[f as usize] += 1.0;
        }
        let total: f64 = (1..=10).map(|i| f64::from(i * i)).sum();
        let mut chi_sq = 0.0;
        for i in 0..10 {
            let expected = n as f64 * ((i + 1) * (i + 1)) as f64 / total;
            chi_sq += (hits[2 * i] - expected).powi(2) / expected;
            assert_eq!(hits[2 * i + 1], 0.0);
        }
        // 9 degrees of freedom: above 27.9 once in a thousand seeds.
        assert!(chi_sq < 27.9, "chi-square {chi_sq}");
    }

    #[test]
    fn places_in_a_face_are_uniform() {
        let mesh = TriangleMesh {
            verts: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            faces: vec![[0, 1, 2]],
        };
        let n = 40_000;
        let s = sample_surface(&mesh, n, 5).unwrap();
        // The four congruent quarters of the triangle.
        let mut quarter = [0f64; 4];
        for p in &s.points {
            let q = if p[0] > 0.5 {
                0
            } else if p[1] > 0.5 {
                1
            } else if p[0] + p[1] < 0.5 {
                2
            } else {
                3
            };
            quarter[q] += 1.0;
        }
        let expected = n as f64 / 4.0;
        let chi_sq: f64 = quarter.iter().map(|h| (h - expected).powi(2) / expected).sum();
        assert!(chi_sq < 16.3, "chi-square {chi_sq}");
        assert!(s.normals.iter().all(|&n| n == [0.0, 0.0, 1.0]));
    }

    #[test]
    fn weights_give_back_the_point() {
        let mesh = fan();
        let s = sample_surface(&mesh, 1000, 1).unwrap();
        for i in 0..1000 {
            let w = s.barycentric[i];
            assert!(w.iter().all(|&w| w >= 0.0) && (w.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            let corners = mesh.faces[s.faces[i] as usize].map(|v| mesh.verts[v as usize]);
            for (a, got) in s.points[i].iter().enumerate() {
                let x: f32 = (0..3).map(|k| w[k] * corners[k][a]).sum();
                assert!((x - got).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn seed_decides_and_threads_do_not() {
        let mesh = fan();
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| sample_surface(&mesh, 10_000, 9).unwrap())
        };
        let all = run(1);
        assert_eq!(all, run(3));
        assert_ne!(all, sample_surface(&mesh, 10_000, 10).unwrap());
        for n in 0..12 {
            assert_eq!(sample_surface(&mesh, n, 9).unwrap().points, all.points[..n]);
        }
    }

    #[test]
    fn unusable_meshes_are_data_errors() {
        let mut flat = fan();
        flat.faces.retain(|f| f[1] == f[2]);
        let mut missing = fan();
        missing.faces[3] = [0, 1, 99];
        let mut nan = fan();
        nan.verts[1] = [f32::NAN; 3];
        for (mesh, element) in
            [(TriangleMesh::default(), None), (flat, None), (missing, Some("face 3")), (nan, Some("face 0"))]
        {
            let e = sample_surface(&mesh, 10, 0).unwrap_err();
            assert_eq!((e.kind(), e.element()), (ErrorKind::Data, element));
        }
    }
}
