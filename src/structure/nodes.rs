//! Nodes of trees for programs that walk them by themselves. A node is found by its place alone, in the words of its
//! block. A place from outside may be any number, so it is checked at each step.
//!
//! The boxes are in double precision, in the coordinates of the tree's mesh, and rounded outward. The box of a child
//! holds the triangles below it; of triangles that the build divided, the pieces below.

#[cfg(any(test, feature = "brute"))]
use super::hit::Triangle;
use super::place::Place;
use crate::base::error::Result;
use crate::base::memory::zeroed;
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

/// Greatest number of children of a node.
pub const CHILDREN: usize = 8;
/// Id of no node.
pub const NO_NODE: u64 = u64::MAX;
/// Index of no part.
pub const NO_PART: u32 = u32::MAX;

/// Least x, y, z and greatest x, y, z.
pub type NodeBox = [f64; 6];

/// The box of nothing.
pub const EMPTY_BOX: NodeBox =
    [f64::INFINITY, f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];

/// A node of a tree: a leaf, or the node's children.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Node {
    /// 0. It fills the struct.
    pub reserved: u32,
    /// Index of the tree.
    pub tree: u32,
    /// Number of children; 0 for a leaf.
    pub children: u32,
    /// Number of triangles of a leaf; 0 for other nodes.
    pub triangles: u32,
    /// Bit `i`: child `i` is a leaf.
    pub leaves: u32,
    /// The tree's local part of all triangles below; [`NO_PART`] if there are several, or if the file does not say.
    pub part: u32,
    /// Box around the children's boxes, or around all corners of a leaf.
    pub bounds: NodeBox,
    /// Ids of the children; [`NO_NODE`] behind the last.
    pub child: [u64; CHILDREN],
    /// Boxes of the children; zeros behind the last.
    pub child_bounds: [NodeBox; CHILDREN],
}

impl Place {
    /// The id of a node: a number that holds for the file.
    #[inline(always)]
    pub fn id(self) -> u64 {
        u64::from(self.block) << 32 | u64::from(self.item)
    }

    /// The place with this id, which may be any number.
    #[inline(always)]
    pub fn of_id(id: u64) -> Self {
        Self { block: (id >> 32) as u32, item: id as u32 }
    }
}

impl Node {
    /// Begins a node without children.
    #[inline(always)]
    pub(super) fn begin(&mut self, triangles: u32) {
        (self.children, self.triangles, self.leaves, self.part) = (0, triangles, 0, NO_PART);
        self.bounds = EMPTY_BOX;
    }

    /// Adds a child and its box.
    #[inline(always)]
    pub(super) fn push(&mut self, place: Place, is_leaf: bool, bounds: &NodeBox) {
        let i = self.children as usize & (CHILDREN - 1);
        self.child[i] = place.id();
        self.leaves |= u32::from(is_leaf) << i;
        self.child_bounds[i] = *bounds;
        self.grow(bounds);
        self.children += 1;
    }

    /// Ends a node: clears the places of children that it does not have.
    #[inline(always)]
    pub(super) fn end(&mut self) {
        for i in self.children as usize..CHILDREN {
            (self.child[i], self.child_bounds[i]) = (NO_NODE, [0.0; 6]);
        }
    }

    /// Makes a leaf of triangles.
    #[cfg(any(test, feature = "brute"))]
    pub(super) fn of_triangles(&mut self, triangles: impl Iterator<Item = Triangle>, origin: &[f64; 3]) {
        let (mut count, mut part, mut all) = (0, NO_PART, crate::math::Bounds::EMPTY);
        for triangle in triangles {
            part = if count == 0 || part == triangle.part { triangle.part } else { NO_PART };
            count += 1;
            all = triangle.vertices.into_iter().fold(all, |all, corner| all.with(corner));
        }
        self.leaf(count, part, outward(origin, all.min, all.max));
    }

    /// Makes a leaf.
    #[inline(always)]
    pub(super) fn leaf(&mut self, triangles: u32, part: u32, bounds: NodeBox) {
        self.begin(triangles);
        (self.part, self.bounds) = (part, bounds);
        self.end();
    }

    #[inline(always)]
    fn grow(&mut self, bounds: &NodeBox) {
        for axis in 0..3 {
            // No coordinate is NaN: a comparison is one instruction.
            let (low, high) = (self.bounds[axis], self.bounds[axis + 3]);
            self.bounds[axis] = if bounds[axis] < low { bounds[axis] } else { low };
            self.bounds[axis + 3] = if bounds[axis + 3] > high { bounds[axis + 3] } else { high };
        }
    }
}

/// The sum, and true if it is exact: the error term of Knuth's two-sum is then zero. (It may be exact without that.)
#[inline(always)]
pub(super) fn sum(a: f64, b: f64) -> (f64, bool) {
    let sum = a + b;
    (sum, (sum - a == b) & (sum - b == a))
}

/// The sum, rounded down.
#[inline]
pub(super) fn sum_below(a: f64, b: f64) -> f64 {
    let (sum, is_exact) = sum(a, b);
    if is_exact { sum } else { sum.next_down() }
}

/// The sum, rounded up.
#[inline]
pub(super) fn sum_above(a: f64, b: f64) -> f64 {
    let (sum, is_exact) = sum(a, b);
    if is_exact { sum } else { sum.next_up() }
}

/// True if `from + q * 2^step` is exact for all `q` from 0 to 255: all such numbers are multiples of a power of two,
/// and below 2^53 times that power.
#[inline(always)]
pub(super) fn sums_are_exact(from: f64, step: i32) -> bool {
    let bits = from.to_bits();
    let exponent = (bits >> 52 & 0x7ff) as i32;
    if from == 0.0 {
        return step > -1000;
    }
    if exponent == 0 {
        return false;
    }
    let lowest = exponent - 1075 + ((bits | 1 << 52).trailing_zeros() as i32).min(52);
    // `from` is below 2^(exponent - 1022), and `q * 2^step` below 2^(step + 8).
    (exponent - 1022).max(step + 8) + 1 - lowest.min(step) <= 53
}

/// A box in the coordinates of the mesh.
#[inline]
pub(super) fn outward(origin: &[f64; 3], min: Vec3, max: Vec3) -> NodeBox {
    std::array::from_fn(|i| match i {
        0..3 => sum_below(origin[i], min[i].into()),
        _ => sum_above(origin[i - 3], max[i - 3].into()),
    })
}

/// A triangle of a leaf.
#[derive(Debug, Clone, Copy)]
pub struct LeafTriangle {
    /// Its corners, in the coordinates of the mesh.
    pub corners: [DVec3; 3],
    /// The tree's local part.
    pub part: u32,
    /// Its index among the primitive ids of the block.
    pub number: u32,
}

/// Blocks whose starts are known at a time.
const BLOCKS: usize = 2048;
/// Words that a block may have for its starts to be known.
pub(super) const START_WORDS: usize = 1 << 14;
/// Words of a stretch of a block.
const STRETCH: usize = 128;
/// Marks a stretch in which no leaf begins.
const NONE: u8 = u8::MAX;
const _: () = assert!(STRETCH <= NONE as usize);

/// Where leaves begin in some blocks: what a cursor knows of blocks. Leaves have different lengths, so a number alone
/// does not show whether a leaf begins there.
pub struct Starts {
    /// Id of the block at each place, plus 1; 0 for none.
    blocks: Vec<u64>,
    /// For each stretch of the blocks, the place in it where the first leaf begins.
    firsts: Vec<[u8; START_WORDS / STRETCH]>,
}

impl Starts {
    /// Bytes of memory.
    pub const BYTES: u64 = (BLOCKS * (8 + START_WORDS / STRETCH)) as u64;

    /// Fails with `NoMemory`.
    pub fn new() -> Result<Self> {
        let what = "where leaves begin";
        Ok(Self { blocks: zeroed(BLOCKS, what)?, firsts: zeroed(BLOCKS, what)? })
    }

    /// True if a leaf begins at word `at` of block `id`. `all` returns the words where its leaves begin, `next` the
    /// word after the leaf that begins at a word; `None` if that is behind the last leaf.
    #[inline]
    pub(super) fn has<I: Iterator<Item = usize>>(
        &mut self,
        id: u32,
        at: usize,
        all: impl FnOnce() -> I,
        next: impl Fn(usize) -> Option<usize>,
    ) -> bool {
        let place = id as usize % BLOCKS;
        if self.blocks[place] != u64::from(id) + 1 {
            self.find(id, place, all());
        }
        let Some(&first) = self.firsts[place].get(at / STRETCH) else { return false };
        if first == NONE {
            return false;
        }
        let mut word = at / STRETCH * STRETCH + usize::from(first);
        while word < at {
            match next(word) {
                Some(after) => word = after,
                None => return false,
            }
        }
        word == at && next(at).is_some()
    }

    #[cold]
    fn find(&mut self, id: u32, place: usize, all: impl Iterator<Item = usize>) {
        let firsts = &mut self.firsts[place];
        *firsts = [NONE; START_WORDS / STRETCH];
        for at in all {
            if let Some(first) = firsts.get_mut(at / STRETCH) {
                *first = (*first).min((at % STRETCH) as u8);
            }
        }
        self.blocks[place] = u64::from(id) + 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Where all sums count as exact, each is.
        #[test]
        fn exact_sums_are_exact(from: f32, scale in -40i32..40, step in -60i32..60) {
            prop_assume!(from.is_finite());
            let from = f64::from(from) * 2f64.powi(scale);
            if sums_are_exact(from, step) {
                for q in 0..=255 {
                    prop_assert!(sum(from, f64::from(q) * 2f64.powi(step)).1);
                }
            }
        }

        /// The sums are bounds of the exact sum, which a wider format holds.
        #[test]
        fn sums_are_rounded_outward(a: f32, scale in -60i32..60, b: f32) {
            prop_assume!(a.is_finite() && b.is_finite());
            let (a, b) = (f64::from(a) * 2f64.powi(scale), f64::from(b));
            let (low, high) = (sum_below(a, b), sum_above(a, b));
            // Two-sum: the rounding error of a + b, exactly.
            let s = a + b;
            let other = s - a;
            let error = (a - (s - other)) + (b - other);
            prop_assert!(low < s || error >= 0.0 && low == s);
            prop_assert!(high > s || error <= 0.0 && high == s);
            prop_assert!(low >= s.next_down() && high <= s.next_up());
            if low == high {
                prop_assert_eq!(error, 0.0);
            }
        }
    }
}
