//! A sparse lattice of samples, stored in bricks of 8 x 8 x 8 vertices.

/// Vertices in a brick.
const BRICK: usize = 512;
/// The mark of a brick that holds nothing yet.
const ABSENT: u32 = u32::MAX;

/// One value and one byte of marks per lattice vertex, stored only where something was written.
///
/// The table of bricks has one entry per 512 vertices; the bricks themselves follow the surface. A value of NaN means
/// that the vertex was not sampled.
pub(super) struct Bricks {
    table_dims: [u32; 3],
    table: Vec<u32>,
    pub values: Vec<f32>,
    pub marks: Vec<u8>,
}

impl Bricks {
    /// An empty lattice of `verts` vertices per axis.
    pub fn new(verts: [u32; 3]) -> Self {
        let table_dims = verts.map(|n| n.div_ceil(8));
        let len = table_dims.iter().map(|&n| n as usize).product();
        Bricks { table_dims, table: vec![ABSENT; len], values: Vec::new(), marks: Vec::new() }
    }

    fn brick(&self, c: [u32; 3]) -> usize {
        let [x, y, z] = c.map(|i| (i / 8) as usize);
        x + self.table_dims[0] as usize * (y + self.table_dims[1] as usize * z)
    }

    fn offset(c: [u32; 3]) -> usize {
        let [x, y, z] = c.map(|i| (i % 8) as usize);
        x + 8 * y + 64 * z
    }

    /// Where a vertex is stored, if its brick exists.
    pub fn slot(&self, c: [u32; 3]) -> Option<usize> {
        let brick = self.table[self.brick(c)];
        (brick != ABSENT).then(|| brick as usize * BRICK + Self::offset(c))
    }

    /// Where a vertex is stored, making room for it if needed. Making room moves no other slot.
    pub fn slot_or_new(&mut self, c: [u32; 3]) -> usize {
        let entry = self.brick(c);
        if self.table[entry] == ABSENT {
            self.table[entry] = (self.values.len() / BRICK) as u32;
            self.values.resize(self.values.len() + BRICK, f32::NAN);
            self.marks.resize(self.marks.len() + BRICK, 0);
        }
        self.table[entry] as usize * BRICK + Self::offset(c)
    }

    /// Slots of the eight corners of a cube of which every corner has been stored; bit `a` of a corner is its step
    /// along axis `a`.
    pub fn corners(&self, c: [u32; 3]) -> [usize; 8] {
        if c.iter().all(|i| i % 8 < 7) {
            let slot = self.slot(c).expect("the corners of a known cube are stored");
            return [0, 1, 8, 9, 64, 65, 72, 73].map(|step| slot + step);
        }
        std::array::from_fn(|b| {
            self.slot(corner(c, b as u32)).expect("the corners of a known cube are stored")
        })
    }
}

/// Corner `b` of the cube at `c`; bit `a` of `b` is its step along axis `a`.
pub(super) fn corner(c: [u32; 3], b: u32) -> [u32; 3] {
    [c[0] + (b & 1), c[1] + (b >> 1 & 1), c[2] + (b >> 2 & 1)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn agrees_with_a_map() {
        let mut bricks = Bricks::new([17, 9, 8]);
        let mut map = BTreeMap::new();
        let mut state = 1u32;
        for step in 0..400u16 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let c = [(state >> 8) % 17, (state >> 16) % 9, (state >> 24) % 8];
            let slot = bricks.slot_or_new(c);
            assert_eq!(bricks.slot(c), Some(slot));
            bricks.values[slot] = f32::from(step);
            map.insert(c, f32::from(step));
        }
        for (&c, &v) in &map {
            assert_eq!(bricks.values[bricks.slot(c).unwrap()], v);
        }
        assert_eq!(bricks.values.iter().filter(|v| !v.is_nan()).count(), map.len());
        for b in 0..8 {
            bricks.slot_or_new(corner([7, 7, 6], b));
        }
        let slots = bricks.corners([7, 7, 6]);
        assert!((0..8).all(|b| bricks.slot(corner([7, 7, 6], b as u32)) == Some(slots[b])));
    }
}
