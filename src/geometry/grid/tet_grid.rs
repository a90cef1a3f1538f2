//! The lattice of vertices that the field is sampled on, with every cube cut into six tetrahedra.

use crate::{Error, ErrorKind};

/// The orders in which a path from corner 0 of a cube to corner 7 can walk the three axes, even ones first.
const AXIS_ORDERS: [[u8; 3]; 6] = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [1, 0, 2], [2, 1, 0]];

/// Corners of the six tetrahedra of a cube; bit `a` of a corner number is its step along axis `a`.
///
/// Each tetrahedron is a path from corner 0 to corner 7 that walks the axes in one of the six orders. The odd orders
/// give mirrored tetrahedra, so there the two middle corners are swapped to orient all six positively.
pub(super) const CUBE_TETS: [[u8; 4]; 6] = cube_tets();

const fn cube_tets() -> [[u8; 4]; 6] {
    let mut tets = [[0; 4]; 6];
    let mut i = 0;
    while i < 6 {
        let order = AXIS_ORDERS[i];
        let one = 1 << order[0];
        let two = one | 1 << order[1];
        tets[i] = if i < 3 { [0, one, two, 7] } else { [0, two, one, 7] };
        i += 1;
    }
    tets
}

/// Lowest coordinate and side of the cube that holds all points of the working frame (they reach to 0.5) and some room
/// around it.
pub(crate) const WORKING_CUBE: [f32; 2] = [-0.58, 1.16];

/// A box-shaped lattice of cubes, each cut into six tetrahedra around its main diagonal.
///
/// The cut is the same in every cube (Kuhn 1960; Freudenthal 1942), so the triangles on a face that two cubes share
/// are the same from both sides and the tetrahedra fill the box without gaps. Along an axis with `r` cubes there are
/// `r + 1` vertices. Vertices are numbered with x running fastest, then y, then z, and numbers fit `u32`. The
/// position of a vertex is `origin + index * spacing` on each axis, computed in `f32` in one place, so two ways to
/// reach a vertex give the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TetGrid {
    resolution: [usize; 3],
    origin: [f32; 3],
    spacing: f32,
}

impl TetGrid {
    /// A lattice of `resolution` cubes per axis of side `spacing`, whose lowest vertex is at `origin`.
    ///
    /// # Panics
    ///
    /// If an axis has no cubes, the vertices cannot be numbered with `u32`, the origin is not finite, or the spacing
    /// is not finite and positive.
    #[track_caller]
    pub fn new(resolution: [usize; 3], origin: [f32; 3], spacing: f32) -> Self {
        assert!(resolution.iter().all(|&r| r > 0), "TetGrid::new: no cubes along an axis of {resolution:?}");
        assert!(
            numbers_fit(resolution),
            "TetGrid::new: {resolution:?} cubes have more vertices than u32 counts"
        );
        assert!(origin.iter().all(|x| x.is_finite()), "TetGrid::new: origin {origin:?} is not finite");
        assert!(spacing.is_finite() && spacing > 0.0, "TetGrid::new: spacing {spacing} is not positive");
        TetGrid { resolution, origin, spacing }
    }

    /// The lattice with `resolution` cubes along the longest side of the box from `min` to `max`, centred on the box.
    ///
    /// `padding` cubes at both ends of each axis lie outside the box and count towards `resolution`, so the longest
    /// axis has exactly `resolution` cubes; the other axes have as many as cover the box, plus the padding.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Data`] if the box is not finite, turned inside out or a single point; [`ErrorKind::Config`] if
    /// the padding leaves no cube for the box or the vertices cannot be numbered with `u32`.
    pub fn covering(min: [f32; 3], max: [f32; 3], resolution: usize, padding: usize) -> Result<Self, Error> {
        let finite = min.iter().chain(&max).all(|x| x.is_finite());
        let side: [f64; 3] = std::array::from_fn(|a| f64::from(max[a]) - f64::from(min[a]));
        let longest = side[0].max(side[1]).max(side[2]);
        if !finite || side.iter().any(|&s| s < 0.0) || longest <= 0.0 {
            let message = format!("the box from {min:?} to {max:?} cannot hold a grid");
            return Err(Error::new(ErrorKind::Data, message)
                .advise("give at least two different points with finite coordinates"));
        }
        let margin = padding.saturating_mul(2);
        if resolution <= margin {
            let message = format!("{resolution} cubes leave none inside a padding of {padding} at both ends");
            return Err(Error::new(ErrorKind::Config, message)
                .at_element("grid resolution")
                .advise(format!("use a resolution above {margin}")));
        }
        let inner = (resolution - margin) as f64;
        let spacing = longest / inner;
        // The small allowance keeps equal sides at equal counts when the division rounds up.
        let cubes = side.map(|s| ((s / spacing - 1e-9).ceil().max(1.0) as usize).saturating_add(margin));
        if !numbers_fit(cubes) {
            let message = format!("{cubes:?} cubes have more vertices than u32 can number");
            return Err(Error::new(ErrorKind::Config, message)
                .at_element("grid resolution")
                .advise("use a resolution below 1600"));
        }
        let origin = std::array::from_fn(|a| {
            let centre = 0.5 * (f64::from(max[a]) + f64::from(min[a]));
            (centre - 0.5 * spacing * cubes[a] as f64) as f32
        });
        if !((spacing as f32).is_finite() && spacing as f32 > 0.0 && origin.iter().all(|x| x.is_finite())) {
            let message = format!("the box from {min:?} to {max:?} is out of the range of f32");
            return Err(Error::new(ErrorKind::Data, message).advise("scale the points to about unit size"));
        }
        Ok(TetGrid::new(cubes, origin, spacing as f32))
    }

    /// The grid of `resolution` cubes along each side of the cube from -0.58 to 0.58, which holds all points of the
    /// working frame (it reaches to 0.5) and some room around it.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Config`] for a resolution below 3 or beyond 32-bit vertex numbers.
    pub fn working_frame(resolution: usize) -> Result<Self, Error> {
        let [low, side] = WORKING_CUBE;
        Self::covering([low; 3], [low + side; 3], resolution, 1)
    }

    /// Cubes along each axis.
    pub fn resolution(&self) -> [usize; 3] {
        self.resolution
    }

    /// Position of the lowest vertex.
    pub fn origin(&self) -> [f32; 3] {
        self.origin
    }

    /// Side of a cube, in the units of the positions.
    pub fn spacing(&self) -> f32 {
        self.spacing
    }

    /// Number of vertices v.
    pub fn vertex_count(&self) -> usize {
        self.resolution.iter().map(|r| r + 1).product()
    }

    /// Number of cubes; there are six tetrahedra in each.
    pub fn cube_count(&self) -> usize {
        self.resolution.iter().product()
    }

    /// The number of the vertex at lattice coordinates `coords`.
    ///
    /// # Panics
    ///
    /// If the coordinates are outside the lattice.
    #[track_caller]
    pub fn vertex_index(&self, coords: [usize; 3]) -> u32 {
        let r = self.resolution;
        assert!((0..3).all(|a| coords[a] <= r[a]), "vertex_index: {coords:?} in a grid of {r:?} cubes");
        (coords[0] + (r[0] + 1) * (coords[1] + (r[1] + 1) * coords[2])) as u32
    }

    /// The lattice coordinates of a vertex.
    ///
    /// # Panics
    ///
    /// If there is no such vertex.
    #[track_caller]
    pub fn vertex_coords(&self, index: u32) -> [usize; 3] {
        let [rx, ry, rz] = self.resolution;
        let i = index as usize;
        let coords = [i % (rx + 1), i / (rx + 1) % (ry + 1), i / (rx + 1) / (ry + 1)];
        assert!(
            coords[2] <= rz,
            "vertex_coords: vertex {index} in a grid of {} vertices",
            self.vertex_count()
        );
        coords
    }

    /// The position of a vertex given by its number.
    ///
    /// # Panics
    ///
    /// If there is no such vertex.
    #[track_caller]
    pub fn position(&self, index: u32) -> [f32; 3] {
        self.position_at(self.vertex_coords(index))
    }

    /// The position of lattice coordinates `coords`: `origin + coords * spacing`.
    pub fn position_at(&self, coords: [usize; 3]) -> [f32; 3] {
        std::array::from_fn(|a| self.origin[a] + coords[a] as f32 * self.spacing)
    }

    /// Whether the vertex at `coords` lies on the border of the lattice.
    pub fn is_border(&self, coords: [usize; 3]) -> bool {
        (0..3).any(|a| coords[a] == 0 || coords[a] >= self.resolution[a])
    }

    /// Vertex numbers of the six tetrahedra of the cube whose lowest corner is at `cube`, 6 x 4.
    ///
    /// All are positively oriented: `det(v1 - v0, v2 - v0, v3 - v0) > 0`. The first vertex is always the cube's
    /// lowest corner and the last its highest.
    ///
    /// # Panics
    ///
    /// If there is no such cube.
    #[track_caller]
    pub fn cube_tets(&self, cube: [usize; 3]) -> [[u32; 4]; 6] {
        let r = self.resolution;
        assert!((0..3).all(|a| cube[a] < r[a]), "cube_tets: cube {cube:?} in a grid of {r:?} cubes");
        let lowest = self.vertex_index(cube);
        let step = [1, r[0] + 1, (r[0] + 1) * (r[1] + 1)];
        CUBE_TETS.map(|tet| {
            tet.map(|corner| {
                lowest + (0..3).map(|a| (usize::from(corner) >> a & 1) * step[a]).sum::<usize>() as u32
            })
        })
    }

    /// Vertex numbers of all tetrahedra, t x 4, six per cube with the cubes numbered x fastest.
    ///
    /// This is for small grids: 96 bytes per cube.
    pub fn tets(&self) -> Vec<[u32; 4]> {
        let mut tets = Vec::with_capacity(6 * self.cube_count());
        for z in 0..self.resolution[2] {
            for y in 0..self.resolution[1] {
                for x in 0..self.resolution[0] {
                    tets.extend(self.cube_tets([x, y, z]));
                }
            }
        }
        tets
    }
}

/// Whether every vertex of a lattice of that many cubes has a number below `u32::MAX`, which stays free as a mark.
fn numbers_fit(cubes: [usize; 3]) -> bool {
    cubes
        .iter()
        .try_fold(1usize, |n, &r| n.checked_mul(r.checked_add(1)?))
        .is_some_and(|n| u32::try_from(n).is_ok_and(|n| n < u32::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    fn det(p: [[f32; 3]; 4]) -> f32 {
        let d = |i: usize| -> [f32; 3] { std::array::from_fn(|a| p[i][a] - p[0][a]) };
        let (a, b, c) = (d(1), d(2), d(3));
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    }

    #[test]
    fn tets_are_positive_and_fill_every_cube() {
        let grid = TetGrid::new([2, 3, 1], [0.0; 3], 1.0);
        let tets = grid.tets();
        assert_eq!(tets.len(), 6 * grid.cube_count());
        for tet in &tets {
            assert_eq!(det(tet.map(|v| grid.position(v))), 1.0);
        }
    }

    #[test]
    fn inner_faces_match_and_only_the_border_is_open() {
        for r in 1..4usize {
            let grid = TetGrid::new([r, r + 1, 2], [0.0; 3], 1.0);
            let mut uses = BTreeMap::new();
            for [a, b, c, d] in grid.tets() {
                for mut face in [[a, b, c], [a, b, d], [a, c, d], [b, c, d]] {
                    face.sort();
                    *uses.entry(face).or_insert(0) += 1;
                }
            }
            let open = uses.values().filter(|&&n| n == 1).count();
            assert!(uses.values().all(|&n| n <= 2));
            assert_eq!(open, 4 * (r * (r + 1) + 2 * r + 2 * (r + 1)));
        }
    }

    #[test]
    fn covering_keeps_the_box_inside_the_padding() {
        let grid = TetGrid::covering([-1.0, 0.0, 2.0], [1.0, 1.0, 2.1], 20, 2).unwrap();
        assert_eq!(grid.resolution(), [20, 12, 5]);
        assert_eq!(grid.spacing(), 0.125);
        assert_eq!(grid.position_at([2, 2, 2])[0], -1.0);
        let cube = TetGrid::covering([0.1; 3], [0.7; 3], 64, 3).unwrap();
        assert_eq!(cube.resolution(), [64; 3]);
        let kind = |min, max, r, pad| TetGrid::covering(min, max, r, pad).unwrap_err().kind();
        assert_eq!(kind([0.0; 3], [0.0; 3], 8, 1), ErrorKind::Data);
        assert_eq!(kind([0.0; 3], [f32::NAN; 3], 8, 1), ErrorKind::Data);
        assert_eq!(kind([0.0; 3], [-1.0, 1.0, 1.0], 8, 1), ErrorKind::Data);
        assert_eq!(kind([0.0; 3], [1e-45; 3], 8, 1), ErrorKind::Data);
        assert_eq!(kind([f32::MIN; 3], [f32::MAX; 3], 3, 1), ErrorKind::Data);
        assert_eq!(kind([0.0; 3], [1.0; 3], 4, 2), ErrorKind::Config);
        assert_eq!(kind([0.0; 3], [1.0; 3], 4, usize::MAX), ErrorKind::Config);
        assert_eq!(kind([0.0; 3], [1.0; 3], usize::MAX, 1), ErrorKind::Config);
    }

    proptest! {
        #[test]
        fn numbers_and_coordinates_agree(r in prop::array::uniform3(1usize..12), pick in 0.0f64..1.0) {
            let grid = TetGrid::new(r, [0.3, -0.1, 7.0], 0.37);
            let index = (pick * grid.vertex_count() as f64) as u32;
            let coords = grid.vertex_coords(index);
            prop_assert_eq!(grid.vertex_index(coords), index);
            prop_assert_eq!(grid.position(index), grid.position_at(coords));
        }
    }
}
