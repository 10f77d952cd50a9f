//! Opened places of a tree that is placed in a common frame: children with their boxes, or placed triangles. Walks
//! through [pairs](super::pairs) of trees open them.

use super::place::{Place, Rooted};
use super::rows::{COLUMNS, PartsBelow, Rows};
use super::tree::Tree;
use super::{Below, TriHit};
use crate::base::ids::BlockId;
use crate::geom::{Eight, Lot, One};
use crate::math::{Bounds, DBounds};
use crate::simd::{Lanes, Mask, Op, Simd, dispatch};
use glam::{DAffine3, DMat3, DVec3, Vec3};

/// Number of boxes that are tested at a time.
pub(super) const LANES: usize = COLUMNS;
/// Number of opened places that a cache keeps.
const KEPT: usize = 64;

/// A number of each of eight boxes or triangles.
type Row = [f64; LANES];

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

    /// Places a corner.
    #[inline(always)]
    pub fn corner(&self, v: Vec3) -> DVec3 {
        let v = v.as_dvec3();
        if self.is_shift { v + self.map.translation } else { self.map.matrix3 * v + self.map.translation }
    }

    /// Returns bounds of all placed corners in a box.
    #[inline]
    fn around(&self, b: &Bounds) -> DBounds {
        let local = DBounds { min: b.min.as_dvec3(), max: b.max.as_dvec3() };
        if self.is_shift {
            // Rounding is monotonic.
            return DBounds { min: local.min + self.map.translation, max: local.max + self.map.translation };
        }
        let m = &self.map.matrix3;
        let (middle, half) = ((local.min + local.max) * 0.5, (local.max - local.min) * 0.5);
        let reach = m.abs() * half;
        // Of a few roundings of each term.
        let slack = (m.abs() * (middle.abs() + half) + self.map.translation.abs()) * (8.0 * f64::EPSILON);
        let middle = *m * middle + self.map.translation;
        DBounds { min: middle - reach - slack, max: middle + reach + slack }
    }

    /// [`PairFrame::around`] of eight boxes: the low and the high planes, by axis.
    #[inline(always)]
    fn around_all(&self, bounds: &[[f32; LANES]; 6]) -> [[Row; 3]; 2] {
        let mut out = [[[0.0; LANES]; 3]; 2];
        let t = self.map.translation;
        if self.is_shift {
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
                let slack = (size + t[axis].abs()) * (8.0 * f64::EPSILON);
                let at = x * middle[0][i] + y * middle[1][i] + z * middle[2][i] + t[axis];
                out[0][axis][i] = at - reach - slack;
                out[1][axis][i] = at + reach + slack;
            }
        }
        out
    }

    /// [`PairFrame::corner`] of many corners, by axis, to the bit.
    #[inline(always)]
    fn corners<const N: usize>(&self, v: &[[f32; N]; 3]) -> [[f64; N]; 3] {
        let (m, t) = (&self.map.matrix3, self.map.translation);
        let mut out = [[0.0; N]; 3];
        for axis in 0..3 {
            let [x, y, z] = [m.x_axis[axis], m.y_axis[axis], m.z_axis[axis]];
            for i in 0..N {
                let v = [f64::from(v[0][i]), f64::from(v[1][i]), f64::from(v[2][i])];
                let turned = if self.is_shift { v[axis] } else { x * v[0] + y * v[1] + z * v[2] };
                out[axis][i] = turned + t[axis];
            }
        }
        out
    }
}

/// Boxes in single precision, rounded outward. Lanes without a box overlap nothing.
#[derive(Debug, Default, Clone)]
pub(super) struct Boxes {
    pub count: usize,
    pub rows: Vec<[[f32; LANES]; 6]>,
}

const NO_BOXES: [[f32; LANES]; 6] = {
    let (high, low) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
    [high, high, high, low, low, low]
};

impl Boxes {
    fn clear(&mut self) {
        self.count = 0;
        self.rows.clear();
    }

    fn push(&mut self, b: &DBounds, grown: f64) {
        let lane = self.count % LANES;
        if lane == 0 {
            self.rows.push(NO_BOXES);
        }
        let row = self.rows.last_mut().expect("a row was pushed");
        for axis in 0..3 {
            row[axis][lane] = below(b.min[axis] - grown);
            row[axis + 3][lane] = above(b.max[axis] + grown);
        }
        self.count += 1;
    }

    /// Sets the only row, of `count` boxes.
    #[inline(always)]
    fn set(&mut self, [low, high]: &[[Row; 3]; 2], count: usize, grown: f64) {
        let mut row = NO_BOXES;
        for axis in 0..3 {
            for i in 0..LANES {
                let (least, greatest) = (below(low[axis][i] - grown), above(high[axis][i] + grown));
                row[axis][i] = if i < count { least } else { f32::INFINITY };
                row[axis + 3][i] = if i < count { greatest } else { f32::NEG_INFINITY };
            }
        }
        self.count = count;
        self.rows.clear();
        self.rows.push(row);
    }

    /// The box with this index.
    #[inline(always)]
    pub fn get(&self, i: usize) -> [f32; 6] {
        let row = &self.rows[i / LANES];
        let lane = i % LANES;
        [row[0][lane], row[1][lane], row[2][lane], row[3][lane], row[4][lane], row[5][lane]]
    }

    /// The box around all.
    #[inline(always)]
    fn all(&self) -> [f32; 6] {
        let mut all =
            [f32::INFINITY, f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY];
        for row in &self.rows {
            let (low, high) = row.split_at(3);
            for axis in 0..3 {
                all[axis] = low[axis].iter().fold(all[axis], |least, x| least.min(*x));
                all[axis + 3] = high[axis].iter().fold(all[axis + 3], |most, x| most.max(*x));
            }
        }
        all
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

/// Returns the lanes of a row whose boxes overlap a box. All boxes are closed.
#[inline(always)]
pub(super) fn overlaps<S: Simd>(s: S, row: &[[f32; LANES]; 6], one: &[f32; 6]) -> u32 {
    let mut mask = s.load8(&row[0]).le(s.splat8(one[3])).and(s.splat8(one[0]).le(s.load8(&row[3])));
    for axis in 1..3 {
        mask = mask.and(s.load8(&row[axis]).le(s.splat8(one[axis + 3])));
        mask = mask.and(s.splat8(one[axis]).le(s.load8(&row[axis + 3])));
    }
    mask.bits()
}

/// The triangles of a leaf, placed.
#[derive(Debug, Default, Clone)]
pub struct PairLeaf {
    /// Where the triangles are in the tree.
    pub hits: Vec<TriHit>,
    /// Their parts, as parts of the tree.
    pub parts: Vec<u32>,
    /// Their corners in the common frame.
    pub triangles: Vec<[DVec3; 3]>,
    pub(super) boxes: Boxes,
    /// The box around all.
    pub(super) all: [f32; 6],
    /// The triangles, eight at a time, and one by one, for the filter; empty until they are needed.
    pub(super) lots: Vec<Lot>,
    pub(super) ones: Vec<One>,
    /// Corners, and low and high ends of boxes, by lanes, if the leaf came in rows.
    at: Eight,
    ends: [[Row; 3]; 2],
    is_in_rows: bool,
}

impl PairLeaf {
    fn clear(&mut self) {
        self.boxes.clear();
        self.hits.clear();
        self.parts.clear();
        self.triangles.clear();
        self.lots.clear();
        self.ones.clear();
        self.is_in_rows = false;
    }

    /// True if all triangles are of one part.
    #[inline(always)]
    pub(super) fn is_of_one_part(&self) -> bool {
        self.parts.iter().all(|part| *part == self.parts[0])
    }

    /// Prepares the triangles for the filter, as those that are compared with lots.
    #[inline(always)]
    pub(super) fn prepare_ones(&mut self) {
        if self.ones.is_empty() {
            self.ones.extend(self.triangles.iter().map(One::new));
        }
    }

    /// Prepares the triangles for the filter, as lots.
    #[inline(always)]
    pub(super) fn prepare_lots(&mut self) {
        if !self.lots.is_empty() {
            return;
        }
        if self.is_in_rows {
            self.lots.push(Lot::of_lanes(&self.triangles, &self.at, &self.ends));
        } else {
            self.lots.extend(self.triangles.chunks(LANES).map(Lot::new));
        }
    }
}

/// An opened place: its children, or its triangles.
#[derive(Debug, Default, Clone)]
pub(super) struct Opened {
    place: Option<Place>,
    /// The children, and true for leaves.
    pub children: Vec<(Place, bool)>,
    pub boxes: Boxes,
    /// The parts below each child.
    pub below: Vec<PartsBelow>,
    pub leaf: PairLeaf,
    rows: Rows,
}

impl Opened {
    /// Forgets its place.
    pub fn clear(&mut self) {
        self.place = None;
    }

    /// Opens a place, unless it is open. `parts`: the parts below the children are needed. Fails with the place's block
    /// if that is not in memory.
    pub fn open(&mut self, side: &PairSide, place: Place, parts: bool) -> Result<(), BlockId> {
        if self.place == Some(place) {
            return Ok(());
        }
        self.place = None;
        if side.tree.rows(place, parts, &mut self.rows)? {
            dispatch(side.tree.isa(), PlaceRows { opened: self, frame: side.frame, parts });
        } else {
            self.expand(side, place)?;
        }
        self.place = Some(place);
        Ok(())
    }

    /// Opens a place of a tree without rows.
    fn expand(&mut self, side: &PairSide, place: Place) -> Result<(), BlockId> {
        let Self { children, boxes, below, leaf, .. } = self;
        let (frame, grown) = (side.frame, side.frame.grown);
        children.clear();
        boxes.clear();
        below.clear();
        leaf.clear();
        let mut child = |place, bounds: &Bounds, is_leaf| {
            children.push((place, is_leaf));
            below.push(PartsBelow::UNKNOWN);
            boxes.push(&frame.around(bounds), grown);
        };
        let mut triangle = |hit: &TriHit, triangle: &super::Triangle| {
            let corners = triangle.vertices.map(|v| frame.corner(v));
            let [a, b, c] = corners;
            leaf.boxes.push(&DBounds { min: a.min(b).min(c), max: a.max(b).max(c) }, grown);
            leaf.hits.push(*hit);
            leaf.parts.push(triangle.part);
            leaf.triangles.push(corners);
        };
        side.tree.expand(place, &mut Below { child: &mut child, triangle: &mut triangle })?;
        leaf.all = leaf.boxes.all();
        Ok(())
    }
}

/// Places the rows of an opened place.
struct PlaceRows<'a> {
    opened: &'a mut Opened,
    frame: &'a PairFrame,
    parts: bool,
}

impl Op for PlaceRows<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { opened: Opened { children, boxes, below, leaf, rows, .. }, frame, parts } = self;
        let count = rows.count;
        children.clear();
        below.clear();
        if !rows.is_leaf {
            boxes.set(&frame.around_all(&rows.bounds), count, frame.grown);
            children.extend((0..count).map(|i| (rows.places[i], rows.leaves >> i & 1 == 1)));
            if parts {
                below.extend_from_slice(&rows.below[..count]);
            }
            return;
        }
        leaf.clear();
        let vertices = frame.corners(&rows.vertices);
        let at = &mut leaf.at;
        for corner in 0..3 {
            for axis in 0..3 {
                for i in 0..LANES {
                    at[corner][axis][i] = vertices[axis][usize::from(rows.corners[corner][i]) % 16];
                }
            }
        }
        let [low, high] = &mut leaf.ends;
        for axis in 0..3 {
            for i in 0..LANES {
                let [a, b, c] = [at[0][axis][i], at[1][axis][i], at[2][axis][i]];
                let (least, greatest) = (if a < b { a } else { b }, if a > b { a } else { b });
                low[axis][i] = if least < c { least } else { c };
                high[axis][i] = if greatest > c { greatest } else { c };
            }
        }
        leaf.boxes.set(&leaf.ends, count, frame.grown);
        leaf.all = leaf.boxes.all();
        leaf.is_in_rows = true;
        let at = &leaf.at;
        let corner = |c: usize, i: usize| DVec3::new(at[c][0][i], at[c][1][i], at[c][2][i]);
        leaf.triangles.extend((0..count).map(|i| [corner(0, i), corner(1, i), corner(2, i)]));
        leaf.parts.extend_from_slice(&rows.parts[..count]);
        leaf.hits.extend((0..count as u32).map(|i| TriHit { tri: rows.first.tri | i, ..rows.first }));
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
