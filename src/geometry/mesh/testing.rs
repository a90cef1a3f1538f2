//! Meshes that the tests of this room share.

use super::TriangleMesh;
use crate::geometry::{TetGrid, edge_crossings, march};

pub(super) fn tetrahedron(at: f32) -> TriangleMesh {
    let verts = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    TriangleMesh {
        verts: verts.map(|p| p.map(|x| x + at)).to_vec(),
        faces: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    }
}

pub(super) fn joined(parts: &[TriangleMesh]) -> TriangleMesh {
    let mut all = TriangleMesh::default();
    for part in parts {
        let first = all.verts.len() as u32;
        all.verts.extend(&part.verts);
        all.faces.extend(part.faces.iter().map(|f| f.map(|v| v + first)));
    }
    all
}

pub(super) fn level_set(resolution: usize, field: impl Fn([f64; 3]) -> f64) -> TriangleMesh {
    let grid = TetGrid::covering([-1.0; 3], [1.0; 3], resolution, 1).unwrap();
    let positions: Vec<_> = (0..grid.vertex_count() as u32).map(|v| grid.position(v)).collect();
    let values: Vec<_> = positions.iter().map(|p| field(p.map(f64::from)) as f32).collect();
    let surface = march(&grid.tets(), |v| values[v as usize] < 0.0);
    TriangleMesh { verts: edge_crossings(&positions, &values, &surface.edges), faces: surface.faces }
}
