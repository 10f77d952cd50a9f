//! Opened places of a tree that is placed in a common frame: children with their boxes, or placed triangles. Walks
//! through [pairs](super::pairs) of trees open them.

use super::place::{Place, Rooted};
use super::rows::{COLUMNS as LANES, Lanes as Row, Rows};
use super::tree::Tree;
use crate::base::ids::BlockId;
use crate::geom::{Eight, Lot, One};
use crate::math::bits;
use crate::simd::{Lanes, Mask, Op, Simd, dispatch};
use glam::{DAffine3, DMat3, DVec3};

/// Number of opened places that a cache keeps.
const KEPT: usize = 64;

/// A tree, placed in the common frame of a pair.
#[derive(Clone, Copy)]
pub struct PairSide<'a> {
    /// The tree.
    pub tree: Tree<'a>,
    /// The map from the tree's frame to the common frame.
    pub frame: &'a PairFrame,
}

/// A map from a tree's frame to a common frame, and a distance by which boxes grow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairFrame {
    map: DAffine3,
    /// True if the map only moves.
    is_shift: bool,
    grown: f64,
}

impl PairFrame {
    /// A map whose boxes grow by `grown`, which is not negative, on all sides.
    pub fn new(map: DAffine3, grown: f64) -> Self {
        Self { map, is_shift: map.matrix3 == DMat3::IDENTITY, grown }
    }

    /// Returns bounds of all placed corners in eight boxes: the low and the high planes, by axis.
    #[inline(always)]
    fn around(&self, bounds: &[[f32; LANES]; 6]) -> [[Row; 3]; 2] {
        let mut out = [[[0.0; LANES]; 3]; 2];
        let t = self.map.translation;
        if self.is_shift {
            // Rounding is monotonic.
            for axis in 0..3 {
                for i in 0..LANES {
                    out[0][axis][i] = f64::from(bounds[axis][i]) + t[axis];
                    out[1][axis][i] = f64::from(bounds[axis + 3][i]) + t[axis];
                }
            }
            return out;
        }
        let (mut middle, mut half) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        for axis in 0..3 {
            for i in 0..LANES {
                let (low, high) = (f64::from(bounds[axis][i]), f64::from(bounds[axis + 3][i]));
                (middle[axis][i], half[axis][i]) = ((low + high) * 0.5, (high - low) * 0.5);
            }
        }
        let m = &self.map.matrix3;
        for axis in 0..3 {
            let [x, y, z] = [m.x_axis[axis], m.y_axis[axis], m.z_axis[axis]];
            let [u, v, w] = [x.abs(), y.abs(), z.abs()];
            for i in 0..LANES {
                let reach = u * half[0][i] + v * half[1][i] + w * half[2][i];
                let size = u * middle[0][i].abs() + v * middle[1][i].abs() + w * middle[2][i].abs() + reach;
                // Of a few roundings of each term.
                let slack = (size + t[axis].abs()) * (8.0 * f64::EPSILON);
                let at = x * middle[0][i] + y * middle[1][i] + z * middle[2][i] + t[axis];
                out[0][axis][i] = at - reach - slack;
                out[1][axis][i] = at + reach + slack;
            }
        }
        out
    }
}

/// Boxes in single precision, rounded outward: low x, y, z, high x, y, z. Lanes without a box overlap nothing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Boxes([[f32; LANES]; 6]);

impl Default for Boxes {
    fn default() -> Self {
        let (high, low) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
        Self([high, high, high, low, low, low])
    }
}

impl Boxes {
    /// The boxes of a mask, grown.
    #[inline(always)]
    fn new([low, high]: &[[Row; 3]; 2], mask: u32, grown: f64) -> Self {
        let mut boxes = Self::default();
        for axis in 0..3 {
            for i in 0..LANES {
                let (least, greatest) = (below(low[axis][i] - grown), above(high[axis][i] + grown));
                let is_box = mask & 1 << i != 0;
                boxes.0[axis][i] = if is_box { least } else { f32::INFINITY };
                boxes.0[axis + 3][i] = if is_box { greatest } else { f32::NEG_INFINITY };
            }
        }
        boxes
    }

    /// The box with this index.
    #[inline(always)]
    pub fn get(&self, i: usize) -> [f32; 6] {
        let (row, i) = (&self.0, i % LANES);
        [row[0][i], row[1][i], row[2][i], row[3][i], row[4][i], row[5][i]]
    }

    /// The box around all.
    #[inline(always)]
    fn all(&self) -> [f32; 6] {
        let (low, high) = self.0.split_at(3);
        let mut all = [0.0; 6];
        for axis in 0..3 {
            all[axis] = low[axis].iter().fold(f32::INFINITY, |least, x| least.min(*x));
            all[axis + 3] = high[axis].iter().fold(f32::NEG_INFINITY, |most, x| most.max(*x));
        }
        all
    }

    /// Returns the boxes that overlap a box. All boxes are closed.
    #[inline(always)]
    pub fn overlaps<S: Simd>(&self, s: S, one: &[f32; 6]) -> u32 {
        let row = &self.0;
        let mut mask = s.load8(&row[0]).le(s.splat8(one[3])).and(s.splat8(one[0]).le(s.load8(&row[3])));
        for axis in 1..3 {
            mask = mask.and(s.load8(&row[axis]).le(s.splat8(one[axis + 3])));
            mask = mask.and(s.splat8(one[axis]).le(s.load8(&row[axis + 3])));
        }
        mask.bits()
    }
}

/// The greatest number in single precision that is not above `x`, or one or two before it. Without branches.
#[inline(always)]
fn below(x: f64) -> f32 {
    let near = (x as f32).min(f32::MAX);
    let less = near - (near.abs() * f32::EPSILON + f32::MIN_POSITIVE);
    if f64::from(near) > x { less } else { near }
}

/// The least number in single precision that is not below `x`, or one or two behind it.
#[inline(always)]
fn above(x: f64) -> f32 {
    -below(-x)
}

/// An opened place: its children, or its triangles, placed.
#[derive(Debug, Default, Clone)]
pub struct Opened {
    place: Option<Place>,
    /// The children or triangles in the tree.
    pub rows: Rows,
    pub(super) boxes: Boxes,
    /// Triangles: the box around all.
    pub(super) all: [f32; 6],
    /// Triangles: their corners in the common frame.
    pub triangles: Vec<[DVec3; 3]>,
    /// The triangles as one lot, and one by one, for the filter; empty until they are needed.
    pub(super) lot: Vec<Lot>,
    pub(super) ones: Vec<One>,
    /// Triangles: corners, and low and high ends of boxes, by lanes.
    at: Eight,
    ends: [[Row; 3]; 2],
}

impl Opened {
    /// Forgets its place.
    pub(super) fn clear(&mut self) {
        self.place = None;
    }

    /// Opens a place, unless it is open. `parts`: the parts below the children are needed. Fails with the place's block
    /// if that is not in memory.
    pub(super) fn open(&mut self, side: &PairSide, place: Place, parts: bool) -> Result<(), BlockId> {
        if self.place == Some(place) {
            return Ok(());
        }
        self.place = None;
        dispatch(side.tree.isa(), Open { opened: self, side, place, parts })?;
        self.place = Some(place);
        Ok(())
    }

    /// True if all triangles are of one part.
    #[inline(always)]
    pub(super) fn is_of_one_part(&self) -> bool {
        let parts = &self.rows.parts[..self.triangles.len()];
        parts.iter().all(|part| *part == parts[0])
    }

    /// Prepares the triangles for the filter, as those that are compared with a lot.
    #[inline(always)]
    pub(super) fn prepare_ones(&mut self) {
        if self.ones.is_empty() {
            self.ones.extend(self.triangles.iter().map(One::new));
        }
    }

    /// Prepares the triangles for the filter, as a lot.
    #[inline(always)]
    pub(super) fn prepare_lot(&mut self) {
        if self.lot.is_empty() {
            self.lot.push(Lot::of_lanes(&self.triangles, &self.at, &self.ends));
        }
    }
}

/// Reads a place and puts it in the common frame.
struct Open<'a> {
    opened: &'a mut Opened,
    side: &'a PairSide<'a>,
    place: Place,
    parts: bool,
}

impl Op for Open<'_> {
    type Out = Result<(), BlockId>;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Result<(), BlockId> {
        let Self { opened, side: PairSide { tree, frame }, place, parts } = self;
        let Opened { rows, boxes, all, triangles, lot, ones, at, ends, .. } = opened;
        tree.rows(place, parts, rows)?;
        triangles.clear();
        if !rows.is_leaf {
            *boxes = Boxes::new(&frame.around(&rows.bounds), rows.mask, frame.grown);
            return Ok(());
        }
        lot.clear();
        ones.clear();
        *at = rows.placed(&frame.map, frame.is_shift);
        let [low, high] = &mut *ends;
        for axis in 0..3 {
            for i in 0..LANES {
                let [a, b, c] = [at[0][axis][i], at[1][axis][i], at[2][axis][i]];
                let (least, greatest) = (if a < b { a } else { b }, if a > b { a } else { b });
                low[axis][i] = if least < c { least } else { c };
                high[axis][i] = if greatest > c { greatest } else { c };
            }
        }
        *boxes = Boxes::new(ends, rows.mask, frame.grown);
        *all = boxes.all();
        let corner = |c: usize, i: usize| DVec3::new(at[c][0][i], at[c][1][i], at[c][2][i]);
        triangles.extend(bits(rows.mask).map(|i| [corner(0, i), corner(1, i), corner(2, i)]));
        Ok(())
    }
}

/// Opened places of a tree. Each has one slot where it may be.
pub(super) struct Cache(Vec<Opened>);

impl Default for Cache {
    fn default() -> Self {
        Self(vec![Opened::default(); KEPT])
    }
}

impl Cache {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.0.iter_mut().for_each(Opened::clear);
    }

    /// Opens a place, see [`Opened::open`].
    #[inline]
    pub fn open(&mut self, side: &PairSide, place: Place, parts: bool) -> Result<&mut Opened, BlockId> {
        let mixed = place.block.wrapping_mul(0x9e37_79b9) ^ place.item.wrapping_mul(0x85eb_ca6b);
        let opened = &mut self.0[(mixed >> 16) as usize % KEPT];
        opened.open(side, place, parts)?;
        Ok(opened)
    }
}
