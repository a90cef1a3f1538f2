//! How far the vertices of a part of a surface are from its boundary, along the surface.

use crate::geometry::vec3::{length, sub};
use crate::geometry::{Position, TriangleMesh};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// The signed distance of each of the v vertices of `mesh` to the boundary of the part that is `kept`, along the
/// surface; positive in that part.
///
/// In the kept part it is the length of the shortest way along edges (Dijkstra); the length of an edge is divided by
/// the mean `spacing` (v, in the unit of the vertices) of its ends, so that distances and `limit` are in spacings.
/// Distances up to `limit` are exact; larger ones may be too large, up to infinity, which they are where no boundary
/// can be reached. In the other part it is the shortest way along one edge, and minus infinity at vertices without a
/// kept neighbour. `share(v, w)`, between 0 and 1, says where on the edge from the kept vertex v to the vertex w the
/// boundary is.
pub(super) fn distances_to_boundary<P: Position>(
    mesh: &TriangleMesh<P>,
    spacing: &[f32],
    kept: &[bool],
    limit: f32,
    share: impl Fn(usize, usize) -> f32,
) -> Vec<f32> {
    let neighbours = Neighbours::of(mesh);
    let edge = |v: usize, w: usize| {
        let length = length(sub(mesh.verts[v].wide(), mesh.verts[w].wide()));
        (2.0 * length / (f64::from(spacing[v]) + f64::from(spacing[w]))) as f32
    };
    let start = |&kept: &bool| if kept { f32::INFINITY } else { f32::NEG_INFINITY };
    let mut to_boundary: Vec<f32> = kept.iter().map(start).collect();
    // Nearest first; distances in the kept part are not negative, so their bits are in the order of their values.
    let mut queue = BinaryHeap::new();
    for v in (0..kept.len()).filter(|&v| kept[v]) {
        for w in neighbours.of_vertex(v).iter().map(|&w| w as usize).filter(|&w| !kept[w]) {
            let (length, share) = (edge(v, w), share(v, w));
            to_boundary[v] = to_boundary[v].min(length * share);
            to_boundary[w] = to_boundary[w].max(-length * (1.0 - share));
        }
        if to_boundary[v] < f32::INFINITY {
            queue.push(Reverse((to_boundary[v].to_bits(), v as u32)));
        }
    }
    while let Some(Reverse((bits, v))) = queue.pop() {
        let (reached, v) = (f32::from_bits(bits), v as usize);
        if reached > limit {
            break;
        }
        if reached > to_boundary[v] {
            continue;
        }
        for &w in neighbours.of_vertex(v) {
            let through = reached + edge(v, w as usize);
            if through < to_boundary[w as usize] {
                to_boundary[w as usize] = through;
                queue.push(Reverse((through.to_bits(), w)));
            }
        }
    }
    to_boundary
}

/// The vertices that share an edge with each vertex, in one list; a neighbour is there once for each face it is in.
struct Neighbours {
    list: Vec<u32>,
    /// Where the part of each vertex starts in the list, and the end of the last (v + 1).
    starts: Vec<usize>,
}

impl Neighbours {
    fn of<P: Position>(mesh: &TriangleMesh<P>) -> Self {
        let edges =
            || mesh.faces.iter().flat_map(|&[a, b, c]| [[a, b], [b, a], [b, c], [c, b], [c, a], [a, c]]);
        let mut starts = vec![0; mesh.verts.len() + 1];
        edges().for_each(|[v, _]| starts[v as usize + 1] += 1);
        (0..mesh.verts.len()).for_each(|v| starts[v + 1] += starts[v]);
        let (mut next, mut list) = (starts.clone(), vec![0; starts[mesh.verts.len()]]);
        for [v, w] in edges() {
            list[next[v as usize]] = w;
            next[v as usize] += 1;
        }
        Self { list, starts }
    }

    fn of_vertex(&self, v: usize) -> &[u32] {
        &self.list[self.starts[v]..self.starts[v + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::vec3::distance;
    use crate::geometry::{AnalyticShape, NarrowBandOptions, TetGrid, extract_mesh};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// By relaxing all edges until nothing changes (Bellman and Ford).
        #[test]
        fn is_the_shortest_way_along_edges(seed: u64, cubes in 6usize..10, limit in 0.0f32..6.0) {
            let sphere = AnalyticShape::Sphere { radius: 0.4 };
            let mut eval = |x: &[[f32; 3]]| Ok(x.iter().map(|&p| sphere.sdf(p)).collect::<Vec<f32>>());
            let grid = TetGrid::working_frame(cubes).unwrap();
            let mesh = extract_mesh(&grid, &mut eval, &NarrowBandOptions::default()).unwrap();
            let v = mesh.verts.len();
            let hash = |i: usize, salt: u64| {
                (seed ^ salt).wrapping_add(i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40
            };
            let spacing: Vec<f32> = (0..v).map(|i| 0.02 + hash(i, 1) as f32 / (1u64 << 24) as f32).collect();
            let kept: Vec<bool> = (0..v).map(|i| hash(i, 2) % 9 != 0).collect();
            let share = |v: usize, w: usize| (hash(v * 977 + w, 3) % 1000) as f32 / 1000.0;
            let got = distances_to_boundary(&mesh, &spacing, &kept, limit, share);

            let mut want: Vec<f64> = kept.iter().map(|&k| if k { f64::INFINITY } else { 0.0 }).collect();
            let mut outside = vec![f64::NEG_INFINITY; v];
            let edges: Vec<[usize; 2]> = mesh.faces.iter().map(|f| f.map(|x| x as usize)).flat_map(|[a, b, c]| {
                [[a, b], [b, a], [b, c], [c, b], [c, a], [a, c]]
            }).collect();
            let length = |[a, b]: [usize; 2]| {
                distance(mesh.verts[a], mesh.verts[b]) * 2.0 / f64::from(spacing[a] + spacing[b])
            };
            let mut settled = false;
            while !settled {
                settled = true;
                for &[a, b] in edges.iter().filter(|[a, _]| kept[*a]) {
                    let part = if kept[b] { 1.0 } else { f64::from(share(a, b)) };
                    let through = want[b] + part * length([a, b]);
                    if through < want[a] {
                        (want[a], settled) = (through, false);
                    }
                }
            }
            for &[a, b] in edges.iter().filter(|&&[a, b]| kept[a] && !kept[b]) {
                outside[b] = outside[b].max(-(1.0 - f64::from(share(a, b))) * length([a, b]));
            }
            for ((got, kept), (want, outside)) in got.iter().zip(&kept).zip(want.iter().zip(outside)) {
                let (want, got) = (*want, *got);
                if !kept {
                    let same = f64::from(got) == outside || (f64::from(got) - outside).abs() < 1e-4;
                    prop_assert!(same, "{got} is not {outside}");
                } else if want <= f64::from(limit) {
                    prop_assert!((f64::from(got) - want).abs() <= 1e-5 * want.max(1.0), "{got} is not {want}");
                } else {
                    prop_assert!(f64::from(got) > f64::from(limit) * (1.0 - 1e-5), "{got} is not above {limit}");
                }
            }
        }
    }
}
