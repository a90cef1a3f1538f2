//! Meshes that the tests of this room share.

use crate::geometry::TriangleMesh;

/// The square from 0 to 1 in x and y at height z, of 100 x 100 quads; its normals point up or, if `flipped`, down.
pub(super) fn sheet(z: f32, flipped: bool) -> TriangleMesh {
    const N: u32 = 100;
    let verts =
        (0..=N).flat_map(|i| (0..=N).map(move |j| [i as f32 / N as f32, j as f32 / N as f32, z])).collect();
    let quads = (0..N).flat_map(|i| (0..N).map(move |j| i * (N + 1) + j));
    let faces = quads.flat_map(|a| [[a, a + N + 1, a + N + 2], [a, a + N + 2, a + 1]]);
    let faces = if flipped { faces.map(|[a, b, c]| [a, c, b]).collect() } else { faces.collect() };
    TriangleMesh { verts, faces }
}
