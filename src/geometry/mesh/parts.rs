//! The connected parts of a mesh.

use super::TriangleMesh;
use super::measure::Measure;
use crate::geometry::Position;

/// One connected part of a mesh; the parts are connected through shared vertices.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct MeshComponent {
    /// Indices of its faces, ascending.
    pub faces: Vec<u32>,
    /// Enclosed volume; negative for a cavity, meaningful for closed components.
    pub volume: f64,
    /// Sum of the areas of its faces.
    pub area: f64,
}

impl<P: Position> TriangleMesh<P> {
    /// The connected parts, in the order of their first faces.
    ///
    /// # Panics
    ///
    /// If a face names a vertex that is not there.
    #[track_caller]
    pub fn split_components(&self) -> Vec<MeshComponent> {
        self.check_faces("split_components");
        let roots = self.roots();
        let mut number = vec![u32::MAX; self.verts.len()];
        let mut parts: Vec<MeshComponent> = Vec::new();
        let measure = Measure::of(self);
        for (i, &face) in (0..).zip(&self.faces) {
            let slot = &mut number[roots[face[0] as usize] as usize];
            if *slot == u32::MAX {
                *slot = parts.len() as u32;
                parts.push(MeshComponent { faces: Vec::new(), volume: 0.0, area: 0.0 });
            }
            let part = &mut parts[*slot as usize];
            let (volume, area) = measure.volume_and_area(face);
            part.faces.push(i);
            part.volume += volume;
            part.area += area;
        }
        parts
    }

    /// For each vertex the first vertex of its component.
    pub(super) fn roots(&self) -> Vec<u32> {
        let edges = self.faces.iter().flat_map(|&[a, b, c]| [[a, b], [a, c]]);
        connected(self.verts.len(), edges)
    }
}

/// For each of v vertices the smallest one that is connected with it by edges (union-find with halved paths).
pub(crate) fn connected(verts: usize, edges: impl IntoIterator<Item = [u32; 2]>) -> Vec<u32> {
    let mut up: Vec<u32> = (0..verts as u32).collect();
    let find = |up: &mut [u32], mut v: u32| {
        while up[v as usize] != v {
            up[v as usize] = up[up[v as usize] as usize];
            v = up[v as usize];
        }
        v
    };
    for [a, b] in edges {
        let (p, q) = (find(&mut up, a), find(&mut up, b));
        up[p.max(q) as usize] = p.min(q);
    }
    // Every link leads to a smaller number, so one ascending pass flattens the trees.
    for v in 0..up.len() {
        up[v] = up[up[v] as usize];
    }
    up
}
