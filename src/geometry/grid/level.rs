//! One level of the coarse-to-fine search: a lattice that is sampled where needed, and how it leads to the next.

use super::bricks::{Bricks, corner};
use super::tet_grid::{CUBE_TETS, TetGrid};
use super::{ActiveSet, FieldFn};
use crate::{Error, ErrorKind};

/// The cube has been sampled and tested.
const KNOWN: u8 = 1;
/// The corners of the cube differ in sign.
const MIXED: u8 = 2;
/// The vertex waits in the next batch.
const PENDING: u8 = 4;
/// The cube belongs to the dilated set.
const DILATED: u8 = 8;
/// The vertex is in the list being collected.
const LISTED: u8 = 16;

/// For each axis, the corners of a cube on its lower face.
const LOWER_FACE: [u8; 3] = [0b0101_0101, 0b0011_0011, 0b0000_1111];

/// Every `stride`-th vertex of the grid and the last one of each axis, sampled where needed.
///
/// A cube goes by the number of its lowest vertex within the level. Where the stride does not divide the resolution
/// the last cubes are shorter.
pub(super) struct Level<'g> {
    grid: &'g TetGrid,
    pub stride: usize,
    pub cubes: [u32; 3],
    pub bricks: Bricks,
    /// The cubes sampled so far, ascending.
    known: Vec<u32>,
    /// Those of them whose corners differ in sign, ascending.
    pub mixed: Vec<u32>,
    /// The level before this one, from which samples are taken over.
    pub coarser: Option<Box<Level<'g>>>,
}

impl<'g> Level<'g> {
    pub fn new(grid: &'g TetGrid, stride: usize) -> Self {
        let cubes = grid.resolution().map(|r| r.div_ceil(stride) as u32);
        let bricks = Bricks::new(cubes.map(|n| n + 1));
        Level { grid, stride, cubes, bricks, known: Vec::new(), mixed: Vec::new(), coarser: None }
    }

    fn id(&self, c: [u32; 3]) -> u32 {
        c[0] + (self.cubes[0] + 1) * (c[1] + (self.cubes[1] + 1) * c[2])
    }

    fn coords(&self, id: u32) -> [u32; 3] {
        let [nx, ny] = [self.cubes[0] + 1, self.cubes[1] + 1];
        [id % nx, id / nx % ny, id / nx / ny]
    }

    /// Lattice coordinates in the grid of a vertex of this level.
    fn fine(&self, c: [u32; 3]) -> [usize; 3] {
        let r = self.grid.resolution();
        std::array::from_fn(|a| (c[a] as usize * self.stride).min(r[a]))
    }

    /// The value that a coarser level has for a vertex: each has every second vertex and the last of each axis.
    fn inherited(&self, c: [u32; 3]) -> Option<f32> {
        let coarser = self.coarser.as_deref()?;
        let last = |a: usize| c[a] == self.cubes[a];
        if (0..3).any(|a| c[a] % 2 == 1 && !last(a)) {
            return None;
        }
        let there = std::array::from_fn(|a| if last(a) { coarser.cubes[a] } else { c[a] / 2 });
        let stored = coarser.bricks.slot(there).map(|slot| coarser.bricks.values[slot]);
        stored.filter(|value| !value.is_nan()).or_else(|| coarser.inherited(there))
    }

    pub fn all_cubes(&self) -> Vec<u32> {
        let [nx, ny, nz] = self.cubes;
        let rows = (0..nz).flat_map(|z| (0..ny).map(move |y| [0, y, z]));
        rows.flat_map(|row| (0..nx).map(move |x| self.id(row) + x)).collect()
    }

    /// The cube `step` away from `c`, if there is one.
    fn cube_at(&self, c: [u32; 3], step: [i64; 3]) -> Option<[u32; 3]> {
        let moved: [i64; 3] = std::array::from_fn(|a| i64::from(c[a]) + step[a]);
        let exists = (0..3).all(|a| (0..i64::from(self.cubes[a])).contains(&moved[a]));
        exists.then(|| moved.map(|i| i as u32))
    }

    /// The cubes that touch the vertex nearest to a point.
    pub fn cubes_around(&self, p: [f32; 3]) -> Vec<u32> {
        let cell = f64::from(self.grid.spacing()) * self.stride as f64;
        let nearest = std::array::from_fn(|a| {
            let at = (f64::from(p[a]) - f64::from(self.grid.origin()[a])) / cell;
            at.round().clamp(0.0, f64::from(self.cubes[a])) as u32
        });
        let steps = (0..8i64).map(|b| [-(b & 1), -(b >> 1 & 1), -(b >> 2 & 1)]);
        steps.filter_map(|s| self.cube_at(nearest, s)).map(|c| self.id(c)).collect()
    }

    /// Samples the corners of `cubes` that have no value yet, in one batch; takes what it can from the coarser levels.
    #[track_caller]
    pub fn fill(&mut self, cubes: &[u32], eval: &mut FieldFn<'_>) -> Result<(), Error> {
        let mut batch = Vec::new();
        for &id in cubes {
            let c = self.coords(id);
            for b in 0..8 {
                let v = corner(c, b);
                let slot = self.bricks.slot_or_new(v);
                if !self.bricks.values[slot].is_nan() || self.bricks.marks[slot] & PENDING != 0 {
                    continue;
                }
                if let Some(value) = self.inherited(v) {
                    self.bricks.values[slot] = value;
                } else {
                    self.bricks.marks[slot] |= PENDING;
                    batch.push(self.id(v));
                }
            }
        }
        if batch.is_empty() {
            return Ok(());
        }
        batch.sort_unstable();
        let positions: Vec<_> =
            batch.iter().map(|&id| self.grid.position_at(self.fine(self.coords(id)))).collect();
        let values = eval(&positions)?;
        assert!(
            values.len() == positions.len(),
            "the field gave {} values for {} positions",
            values.len(),
            positions.len()
        );
        let outside = 1e-3 * self.grid.spacing();
        for ((&id, &value), position) in batch.iter().zip(&values).zip(&positions) {
            let v = self.coords(id);
            let fine = self.fine(v);
            if !value.is_finite() {
                return Err(Error::new(
                    ErrorKind::Diverged,
                    format!("the field is {value} at position {position:?}"),
                )
                .at_element(format!("grid vertex {fine:?}"))
                .advise("check the field at this position"));
            }
            let slot = self.bricks.slot_or_new(v);
            self.bricks.values[slot] = if self.grid.is_border(fine) { value.max(outside) } else { value };
        }
        Ok(())
    }

    /// The corners of a sampled cube that are inside, as bits.
    fn signs(&self, c: [u32; 3]) -> u8 {
        let slots = self.bricks.corners(c);
        (0..8).fold(0, |m, b| m | u8::from(self.bricks.values[slots[b]] < 0.0) << b)
    }

    /// Samples `cubes` (ascending, distinct) and every cube that the surface leads to from them.
    #[track_caller]
    pub fn sample(&mut self, cubes: Vec<u32>, eval: &mut FieldFn<'_>) -> Result<(), Error> {
        let mut frontier = cubes;
        for &id in &frontier {
            let slot = self.bricks.slot_or_new(self.coords(id));
            self.bricks.marks[slot] |= KNOWN;
        }
        while !frontier.is_empty() {
            self.fill(&frontier, eval)?;
            let mut next = Vec::new();
            for &id in &frontier {
                let c = self.coords(id);
                let signs = self.signs(c);
                if signs == 0 || signs == 255 {
                    continue;
                }
                self.mixed.push(id);
                let slot = self.bricks.slot_or_new(c);
                self.bricks.marks[slot] |= MIXED;
                for (axis, &lower) in LOWER_FACE.iter().enumerate() {
                    for (face, step) in [(lower, -1), (!lower, 1)] {
                        if signs & face == 0 || signs & face == face {
                            continue;
                        }
                        let mut to = [0; 3];
                        to[axis] = step;
                        // A face on the grid's border is outside all over, so the neighbour exists.
                        let Some(there) = self.cube_at(c, to) else { continue };
                        let slot = self.bricks.slot_or_new(there);
                        if self.bricks.marks[slot] & KNOWN == 0 {
                            self.bricks.marks[slot] |= KNOWN;
                            next.push(self.id(there));
                        }
                    }
                }
            }
            next.sort_unstable();
            self.known.append(&mut frontier);
            frontier = next;
        }
        self.known.sort_unstable();
        self.mixed.sort_unstable();
        Ok(())
    }

    /// The cubes of the next finer level, which has `finer` cubes per axis, that may hold the surface.
    ///
    /// The surface is expected in and around cubes with a sign change and where the field comes close to zero
    /// compared with how much it changes across a cube. Of their children those are kept where the trilinear
    /// interpolant changes sign or, again, comes close to zero. The change across a cube is the largest in the
    /// neighbourhood, so that a field that bends at an extremum between the samples is not taken to be flat.
    pub fn children(&self, safety: f32, finer: [u32; 3]) -> Vec<u32> {
        let mut change = vec![0.0f32; self.bricks.values.len()];
        for &id in &self.known {
            let corners = self.bricks.corners(self.coords(id));
            change[corners[0]] = change_across(corners.map(|slot| self.bricks.values[slot]));
        }
        let resolution = self.grid.resolution();
        let mut out = Vec::new();
        for &id in &self.known {
            let c = self.coords(id);
            let values = self.bricks.corners(c).map(|slot| self.bricks.values[slot]);
            let (mut steepest, mut near_mixed) = (0.0f32, false);
            self.for_each_neighbour(c, |slot| {
                steepest = steepest.max(change[slot]);
                near_mixed |= self.bricks.marks[slot] & MIXED != 0;
            });
            let close = safety * 3f32.sqrt() * steepest;
            let least = values.iter().fold(f32::INFINITY, |m, v| m.min(v.abs()));
            if !near_mixed && least >= close {
                continue;
            }
            let shorter = (0..3).any(|a| (c[a] as usize + 1) * self.stride > resolution[a]);
            let halves = halved(values);
            for b in 0..8u32 {
                let child = corner(c.map(|i| 2 * i), b);
                if (0..3).any(|a| child[a] >= finer[a]) {
                    continue;
                }
                let first = ((b & 1) + 3 * (b >> 1 & 1) + 9 * (b >> 2 & 1)) as usize;
                let at = [0, 1, 3, 4, 9, 10, 12, 13].map(|step| halves[first + step]);
                let inside = at.iter().filter(|&&v| v < 0.0).count();
                let least = at.iter().fold(f32::INFINITY, |m, v| m.min(v.abs()));
                // The halves of a shorter cube are not at its middle, so there the prediction does not hold.
                if shorter || (inside != 0 && inside != 8) || least < 0.5 * close {
                    out.push(child[0] + (finer[0] + 1) * (child[1] + (finer[1] + 1) * child[2]));
                }
            }
        }
        out
    }

    /// Calls `visit` with the slot of each stored cube among the 27 around `c`, in a fixed order.
    fn for_each_neighbour(&self, c: [u32; 3], mut visit: impl FnMut(usize)) {
        let inner = c.iter().all(|i| (1..7).contains(&(i % 8)));
        let base = if inner { self.bricks.slot(c) } else { None };
        for n in 0..27 {
            let step = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
            if let Some(base) = base {
                visit((base as i64 + step[0] + 8 * step[1] + 64 * step[2]) as usize);
            } else if let Some(slot) = self.cube_at(c, step).and_then(|there| self.bricks.slot(there)) {
                visit(slot);
            }
        }
    }

    /// The cubes with a sign change and `rings` rings of cubes around them, ascending.
    pub fn dilated(&mut self, rings: usize) -> Vec<u32> {
        let mut all = Vec::new();
        let mut ring = self.mixed.clone();
        for &id in &ring {
            let slot = self.bricks.slot_or_new(self.coords(id));
            self.bricks.marks[slot] |= DILATED;
        }
        for _ in 0..rings {
            let mut next = Vec::new();
            for &id in &ring {
                let c = self.coords(id);
                for n in 0..27 {
                    let step = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
                    let Some(there) = self.cube_at(c, step) else { continue };
                    let slot = self.bricks.slot_or_new(there);
                    if self.bricks.marks[slot] & DILATED == 0 {
                        self.bricks.marks[slot] |= DILATED;
                        next.push(self.id(there));
                    }
                }
            }
            all.append(&mut ring);
            ring = next;
            if ring.is_empty() {
                break;
            }
        }
        all.append(&mut ring);
        all.sort_unstable();
        all
    }

    /// The corners and tetrahedra of `cubes` (ascending, all sampled) on the fine level; only the tetrahedra that the
    /// surface crosses, if `crossing`.
    pub fn collect(&mut self, cubes: &[u32], crossing: bool) -> ActiveSet {
        debug_assert_eq!(self.stride, 1, "only the fine level has the grid's vertices");
        let mut ids = Vec::new();
        for &id in cubes {
            let c = self.coords(id);
            for (b, slot) in (0..).zip(self.bricks.corners(c)) {
                if self.bricks.marks[slot] & LISTED == 0 {
                    self.bricks.marks[slot] |= LISTED;
                    ids.push(self.id(corner(c, b)));
                }
            }
        }
        ids.sort_unstable();
        let mut local = vec![0u32; self.bricks.values.len()];
        let mut set = ActiveSet::default();
        for (i, &id) in (0..).zip(&ids) {
            let c = self.coords(id);
            let slot = self.bricks.slot_or_new(c);
            local[slot] = i;
            set.positions.push(self.grid.position_at(self.fine(c)));
            set.values.push(self.bricks.values[slot]);
        }
        for &id in cubes {
            let c = self.coords(id);
            let slots = self.bricks.corners(c);
            let signs = self.signs(c);
            for tet in CUBE_TETS {
                let mask = tet.iter().fold(0, |m, &b| m | 1u8 << b);
                if !crossing || (signs & mask != 0 && signs & mask != mask) {
                    set.tets.push(tet.map(|b| local[slots[usize::from(b)]]));
                }
            }
        }
        set.ids = ids;
        set
    }
}

/// How much the field changes across a cube with these corner values: the steepest edge on each axis, taken together.
fn change_across(corners: [f32; 8]) -> f32 {
    let mut sum_sq = 0.0;
    for axis in 0..3 {
        let lower = (0..8).filter(|b| b >> axis & 1 == 0);
        let steepest = lower.map(|b| (corners[b | 1 << axis] - corners[b]).abs()).fold(0.0, f32::max);
        sum_sq += steepest * steepest;
    }
    sum_sq.sqrt()
}

/// The trilinear interpolant of a cube at its 3 x 3 x 3 half steps, x fastest.
fn halved(corners: [f32; 8]) -> [f32; 27] {
    let mut out = [0.0; 27];
    for b in 0..8 {
        out[2 * (b & 1) + 6 * (b >> 1 & 1) + 18 * (b >> 2 & 1)] = corners[b];
    }
    // Middles along x, then y, then z, each between values that are already there.
    for i in [1, 7, 19, 25] {
        out[i] = 0.5 * (out[i - 1] + out[i + 1]);
    }
    for i in [3, 4, 5, 21, 22, 23] {
        out[i] = 0.5 * (out[i - 3] + out[i + 3]);
    }
    for i in 9..18 {
        out[i] = 0.5 * (out[i - 9] + out[i + 9]);
    }
    out
}
