//! Any signs on any small grid: the surface is closed and oriented, and both marching paths agree.
#![no_main]

use bijective_sdf::geometry::{BandTopology, Isosurface, TetGrid, TriangleMesh, edge_crossings, march};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some((&[x, y, z], bits)) = data.split_first_chunk() else { return };
    let grid = TetGrid::new([x, y, z].map(|r| 1 + usize::from(r) % 8), [-0.5; 3], 0.125);
    let positions: Vec<_> = (0..grid.vertex_count() as u32).map(|v| grid.position(v)).collect();
    let values: Vec<f32> = (0..positions.len())
        .map(|v| {
            let border = grid.is_border(grid.vertex_coords(v as u32));
            let byte = bits.get(v).copied().unwrap_or(255);
            if border { 1.0 } else { f32::from(byte) - 127.0 }
        })
        .collect();
    let inside: Vec<bool> = values.iter().map(|&v| v < 0.0).collect();
    let tets = grid.tets();
    let surface = march(&tets, |v| inside[v as usize]);
    let mut again = Isosurface::default();
    BandTopology::new(inside.len(), tets).march_into(&inside, &mut again);
    assert_eq!(surface, again);
    let verts = edge_crossings(&positions, &values, &surface.edges);
    let topology = TriangleMesh { verts, faces: surface.faces }.topology();
    assert!(topology.oriented && topology.closed == inside.contains(&true), "{topology}");
    assert_eq!((topology.degenerate_faces, topology.euler % 2), (0, 0), "{topology}");
});
