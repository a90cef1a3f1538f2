//! Changes of a mesh: parts and faces that are kept, vertices that are dropped.

use super::TriangleMesh;
use crate::geometry::Position;

impl<P: Position> TriangleMesh<P> {
    /// The components with at least `share` of the largest one's area, in the same order of faces and vertices.
    ///
    /// # Panics
    ///
    /// If a face names a vertex that is not there.
    #[track_caller]
    pub fn keep_large(&self, share: f64) -> Self {
        let parts = self.split_components();
        let largest = parts.iter().map(|p| p.area).fold(0.0, f64::max);
        let kept = parts.into_iter().filter(|p| p.area >= share * largest);
        let mut faces: Vec<u32> = kept.flat_map(|p| p.faces).collect();
        faces.sort_unstable();
        self.select_faces(&faces)
    }

    /// The mesh of the given faces and the vertices they use, both in the given and in the old order respectively.
    ///
    /// # Panics
    ///
    /// If there is no such face, or a face names a vertex that is not there.
    #[track_caller]
    pub fn select_faces(&self, faces: &[u32]) -> Self {
        for &i in faces {
            assert!((i as usize) < self.faces.len(), "select_faces: face {i} of {}", self.faces.len());
        }
        let faces = faces.iter().map(|&i| self.faces[i as usize]).collect();
        let mut part = TriangleMesh { verts: self.verts.clone(), faces };
        part.remove_unused_verts();
        part
    }

    /// Drops the vertices that no face uses, keeps the order of the others, and returns how many were dropped.
    ///
    /// # Panics
    ///
    /// If a face names a vertex that is not there.
    #[track_caller]
    pub fn remove_unused_verts(&mut self) -> usize {
        self.check_faces("remove_unused_verts");
        let mut moved = vec![u32::MAX; self.verts.len()];
        for &v in self.faces.iter().flatten() {
            moved[v as usize] = 0;
        }
        let before = self.verts.len();
        let mut kept = 0;
        for (v, to) in moved.iter_mut().enumerate() {
            if *to == 0 {
                *to = kept as u32;
                self.verts[kept] = self.verts[v];
                kept += 1;
            }
        }
        self.verts.truncate(kept);
        for v in self.faces.iter_mut().flatten() {
            *v = moved[*v as usize];
        }
        before - kept
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{joined, tetrahedron};

    #[test]
    fn parts_are_split_measured_and_selected() {
        let mut cavity = tetrahedron(5.0);
        cavity.faces.iter_mut().for_each(|f| f.swap(0, 1));
        let mut all = joined(&[tetrahedron(0.0), cavity.clone()]);
        all.verts.insert(0, [9.0; 3]);
        all.faces.iter_mut().flatten().for_each(|v| *v += 1);
        all.faces.swap(1, 6);
        let parts = all.split_components();
        assert_eq!(parts.len(), 2);
        assert_eq!(parts[0].faces, [0, 2, 3, 6]);
        assert!((parts[0].volume - 1.0 / 6.0).abs() < 1e-6 && (parts[1].volume + 1.0 / 6.0).abs() < 1e-6);
        let second = all.select_faces(&parts[1].faces);
        assert_eq!(second.verts, cavity.verts);
        assert_eq!(second.topology().faces, 4);
        assert_eq!(all.remove_unused_verts(), 1);
        assert_eq!(all.verts.len(), 8);
        assert_eq!(all.topology().unused_verts, 0);
    }
}
