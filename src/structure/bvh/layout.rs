//! The trace form of a block: the bytes that rays read.
//!
//! A block is a slice of little-endian 32-bit words, at most [`MAX_WORDS`], decoded from the file
//! form and checked there once (`codec.rs`; `validate.rs` checks the words themselves); offsets inside it
//! count words.
//!
//! | words | what |
//! |---|---|
//! | 0 | nodes (u16), external references (u16) |
//! | 1 | triangles (u16), parts (u16) |
//! | 2, 3 | where the external references and the parts begin |
//! | 4 | where the nodes' first voxels begin |
//! | 5 | voxels (u16), those of six sides (u16) |
//! | 6 | words of a voxel: 2, or 4 with its parts |
//! | 7 | with 2: the local part of all voxels; else 0 |
//! | 8 to 15 | for each two nodes a bit: rays may pass a cell of theirs (`lod::stopped`), so that of others no voxel is looked at for that |
//! | 16 .. | nodes, [`NODE_WORDS`] each; node 0 first, children after their parents |
//! | .. | external references: block id, child reference inside it, where it hangs here: node (u16) and slot (u16) |
//! | .. | parts: local part of the tree, ascending |
//! | .. | for each node the number of its first voxel |
//! | .. | voxels (`lod::Coded`): one for each child of each node, in order; of those of six sides word 1 counts them |
//! | .. | the sides of those that have six, [`SIDES_WORDS`] each |
//! | .. | leaves, unless they are in a block of their own |
//! | last [`PAD_WORDS`] | zero, so that a vector load at the end of a leaf stays inside |
//!
//! The leaves below a fine block's nodes are in another block, its **leaf block**, which has no nodes: a picture of
//! stand-ins has no use for triangles. A reference to a leaf then counts words there. Which block that is the tree says
//! (`trace::TreeView::leaves_at`). A tree of one block has them in that.
//!
//! A **node** has up to eight children. Their boxes are stored in 8 bits a plane on a grid of the
//! node's own: `origin + q * 2^(exponent - 127)`, rounded outward, after Ylitie, Karras, Laine,
//! "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", HPG 2017 (the grid; the
//! rest of their node differs: explicit 16-bit references instead of a common base).
//!
//! What a **leaf** is `leaf.rs` says.

use super::leaf::Leaf;
use crate::lod::{
    self, Coded, LEVEL, Middle, OrientedSlabs, SIDES_WORDS, TRANSMITTING_LEVEL, VOXEL_WORDS, stopped, summary_bit,
};
use crate::math::Bounds;
use bytemuck::{Pod, Zeroable, must_cast_ref};
use glam::Vec3;

/// Words of a block, at most: 64 KB.
pub const MAX_WORDS: usize = 16384;
/// Words before the nodes, which begin with a cache line.
pub const HEADER_WORDS: usize = 16;
/// The first word of those that say which nodes rays may pass.
const TRANSMITTING_AT: usize = 8;
/// Those words.
pub type Transmitting = [u32; HEADER_WORDS - TRANSMITTING_AT];
const _: () = assert!(MAX_WORDS / NODE_WORDS <= 2 * 32 * (HEADER_WORDS - TRANSMITTING_AT), "a bit for each two nodes");

/// Word and bit of a node there.
#[inline(always)]
fn transmitting_at(node: usize) -> (usize, u32) {
    (node >> 6 & (HEADER_WORDS - TRANSMITTING_AT - 1), node as u32 >> 1 & 31)
}

/// Adds a node that rays may pass a cell of, if so.
#[inline(always)]
pub fn mark_transmitting(transmitting: &mut Transmitting, node: usize, may_transmit: bool) {
    let (word, bit) = transmitting_at(node);
    transmitting[word] |= u32::from(may_transmit) << bit;
}
/// Words of a reference to another block.
pub const EXTERNAL_WORDS: usize = 3;
/// Words of a voxel without its parts.
pub const SHORT_VOXEL: usize = 2;
/// Words of a voxel with its parts.
pub const LONG_VOXEL: usize = VOXEL_WORDS;
/// Words of a node.
pub const NODE_WORDS: usize = 32;
/// Words of a cache line; blocks begin with one.
pub const LINE_WORDS: usize = 16;
/// Zero words at the end of a block.
pub const PAD_WORDS: usize = 16;
/// Children of a node, at most.
pub const WIDTH: usize = 8;
/// Triangles of a leaf, at most.
pub const MAX_TRIANGLES: usize = 8;
/// Vertices of a leaf, at most.
pub const MAX_VERTICES: usize = 16;

/// Classes of blocks, in the order in which a tree's blocks lie: nodes over other blocks (or all of a tree of one
/// block), nodes over leaves, leaves.
pub const COARSE: usize = 0;
/// See [`COARSE`].
pub const FINE: usize = 1;
/// See [`COARSE`].
pub const LEAF: usize = 2;

/// What a 16-bit child reference points at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Child {
    /// A node of the same block, by its index.
    Node(usize),
    /// A leaf by its first word: of the same block, or of the leaf block that goes with it.
    Leaf(usize),
    /// Something in another block, by the first word of the external reference.
    External(usize),
}

/// Where a reference's kind begins; see [`Child`].
pub(super) const KIND_SHIFT: u32 = 14;
/// The bits of a reference's index.
pub(super) const INDEX_MASK: u32 = (1 << KIND_SHIFT) - 1;

impl Child {
    /// From a reference's bits. Bits above the 16th are ignored.
    #[inline(always)]
    pub fn from_bits(bits: u32) -> Option<Self> {
        let index = (bits & INDEX_MASK) as usize;
        match bits >> KIND_SHIFT & 3 {
            0 => Some(Child::Node(index)),
            1 => Some(Child::Leaf(index)),
            2 => Some(Child::External(index)),
            _ => None,
        }
    }

    /// Whether a reference's bits are those of a leaf.
    #[inline(always)]
    pub fn is_leaf(bits: u32) -> bool {
        bits >> KIND_SHIFT & 3 == 1
    }

    /// As a reference's bits.
    pub fn to_bits(self) -> u16 {
        let (kind, index) = match self {
            Child::Node(i) => (0, i),
            Child::Leaf(i) => (1, i),
            Child::External(i) => (2, i),
        };
        debug_assert!(index <= INDEX_MASK as usize);
        (kind << KIND_SHIFT | index as u32 & INDEX_MASK) as u16
    }
}

/// An inner node: two cache lines.
///
/// Invariants, checked by `validate`: `origin` finite; exponents in 1..=254; in each valid slot
/// `low <= high` on each axis; references in range, to nodes only with a greater index.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct Node {
    /// Least corner of the grid.
    pub origin: [f32; 3],
    /// Biased exponent of the grid's step on each axis.
    pub exponent: [u8; 3],
    /// Bit `i`: slot `i` holds a child.
    pub valid: u8,
    /// Planes on the grid: low x, y, z, then high x, y, z, of the eight children.
    pub planes: [[u8; WIDTH]; 6],
    /// References to the children.
    pub child: [u16; WIDTH],
    /// The slabs of their voxels (`lod::OrientedSlabs`).
    pub slabs: [u32; WIDTH],
    /// The normals that these are across: the two bytes of the voxels', each with its highest bit turned, which makes a
    /// signed byte one that counts from -128.
    pub normal: [[u8; WIDTH]; 2],
}
const _: () = assert!(size_of::<Node>() == NODE_WORDS * 4);

impl Node {
    /// The grid's step on `axis`.
    #[inline(always)]
    pub fn step(&self, axis: usize) -> f32 {
        f32::from_bits(u32::from(self.exponent[axis]) << 23)
    }

    /// The origin's bits; and the exponents in the low bytes of a word.
    #[inline(always)]
    pub fn head(&self) -> &[u32; 4] {
        let words: &[u32; NODE_WORDS] = must_cast_ref(self);
        match words.first_chunk::<4>() {
            Some(head) => head,
            None => unreachable!(),
        }
    }

    /// The three exponents in the low bytes of a word.
    #[inline(always)]
    pub fn exponents(&self) -> u32 {
        u32::from_le_bytes([self.exponent[0], self.exponent[1], self.exponent[2], 0])
    }

    /// A plane of a child as walks see it, rounded once: `row` counts low x, y, z, high x, y, z.
    #[inline(always)]
    pub fn stored_plane(&self, row: usize, slot: usize) -> f32 {
        // A product with a power of two is exact: one rounding.
        f32::from(self.planes[row][slot & (WIDTH - 1)]) * self.step(row % 3) + self.origin[row % 3]
    }

    /// The low half of a child's voxel's first word.
    #[inline(always)]
    pub fn stored_normal(&self, slot: usize) -> u16 {
        let slot = slot & (WIDTH - 1);
        u16::from_le_bytes([self.normal[0][slot], self.normal[1][slot]]) ^ 0x8080
    }

    /// Takes a child's slabs, and the low half of its voxel's first word.
    pub fn set_oriented_slabs(&mut self, slot: usize, slabs: u32, normal: u16) {
        self.slabs[slot] = slabs;
        [self.normal[0][slot], self.normal[1][slot]] = (normal ^ 0x8080).to_le_bytes();
    }

    /// How near to a child's content all of the region inside of its slabs is (`lod::limit`).
    #[inline(always)]
    pub fn level(&self, slot: usize) -> u32 {
        self.slabs[slot & (WIDTH - 1)] >> LEVEL.0
    }

    /// Takes that, of a child of which it is not known yet.
    pub fn set_level(&mut self, slot: usize, level: u32) {
        self.slabs[slot] |= level << LEVEL.0;
    }

    /// Rays may pass a child: walks look at its voxel for how many. They need not at those of greater levels.
    pub fn set_transmitting(&mut self, slot: usize) {
        let level = self.level(slot).min(TRANSMITTING_LEVEL);
        self.slabs[slot] = self.slabs[slot] & !(3 << LEVEL.0) | level << LEVEL.0;
    }

    /// Where in the box of a child its content is.
    #[inline(always)]
    pub fn stored_oriented_slabs(&self, slot: usize) -> OrientedSlabs<f32> {
        let word = self.slabs[slot & (WIDTH - 1)];
        lod::oriented_slabs(
            lod::fields(word),
            lod::normal_bytes(self.stored_normal(slot).into()),
            &self.stored_middle(slot),
        )
    }

    /// A child's box as its slabs see it.
    #[inline(always)]
    pub fn stored_middle(&self, slot: usize) -> Middle<f32> {
        let slot = slot & (WIDTH - 1);
        let at = |axis: usize| {
            let (low, high) = (self.planes[axis][slot], self.planes[axis + 3][slot]);
            f32::from(u16::from(low) + u16::from(high)) * (0.5 * self.step(axis)) + self.origin[axis]
        };
        let half = |axis: usize| {
            f32::from(self.planes[axis + 3][slot].wrapping_sub(self.planes[axis][slot])) * (0.5 * self.step(axis))
        };
        Middle { at: [at(0), at(1), at(2)], half: [half(0), half(1), half(2)] }
    }

    /// A child's box as walks see it. (The grid's planes are outside of the child, whose own are single-precision
    /// numbers: so are the rounded ones.)
    #[inline]
    pub fn stored_box(&self, slot: usize) -> Bounds {
        let at = |row: usize| self.stored_plane(row, slot);
        Bounds { min: Vec3::new(at(0), at(1), at(2)), max: Vec3::new(at(3), at(4), at(5)) }
    }

    /// The box of a child, rounded outward once more where the grid's sum is not exact.
    pub fn child_box(&self, slot: usize) -> Bounds {
        self.box_between(self.planes.map(|planes| planes[slot]))
    }

    /// The smallest box around those of all children; of none, there is nothing in it.
    pub fn children_box(&self) -> Bounds {
        if self.valid == 0 {
            return Bounds::EMPTY;
        }
        // What is larger on the grid is not smaller in space: one plane of each row decides.
        let outermost = |row: usize, is_high: bool| {
            let planes = self.planes[row]
                .iter()
                .enumerate()
                .filter(|(slot, _)| self.valid >> slot & 1 == 1)
                .map(|(_, plane)| *plane);
            if is_high { planes.fold(0, u8::max) } else { planes.fold(u8::MAX, u8::min) }
        };
        self.box_between(std::array::from_fn(|row| outermost(row, row >= 3)))
    }

    /// The box between planes on the grid: low ones, then high ones.
    fn box_between(&self, planes: [u8; 6]) -> Bounds {
        let at = |axis: usize, plane: usize| {
            let offset = f64::from(planes[plane]) * f64::from(self.step(axis));
            f64::from(self.origin[axis]) + offset
        };
        let low = |axis: usize| (at(axis, axis) as f32).next_down();
        let high = |axis: usize| (at(axis, axis + 3) as f32).next_up();
        Bounds { min: Vec3::new(low(0), low(1), low(2)), max: Vec3::new(high(0), high(1), high(2)) }
    }
}

/// Has the header of a block say which nodes rays may pass.
pub fn put_transmitting(words: &mut [u32]) {
    let transmitting = Block::new(words).transmitting();
    words[TRANSMITTING_AT..HEADER_WORDS].copy_from_slice(&transmitting);
}

/// The first words of a leaf block; those of its header behind them are zero, and its parts follow.
pub fn leaf_block_head(triangles: usize, parts: usize) -> [u32; 8] {
    let (first, end) = (HEADER_WORDS as u32, (HEADER_WORDS + parts) as u32);
    [0, triangles as u32 | (parts as u32) << 16, first, first, end, 0, SHORT_VOXEL as u32, 0]
}

/// One decoded block, borrowed from its slot.
#[derive(Debug, Clone, Copy)]
pub struct Block<'a> {
    words: &'a [u32],
}

impl<'a> Block<'a> {
    /// Over words that `validate` has accepted; or over none, as a place for some.
    #[inline(always)]
    pub fn new(words: &'a [u32]) -> Self {
        Self { words }
    }

    /// All words.
    pub fn words(&self) -> &'a [u32] {
        self.words
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        (self.words[0] & 0xffff) as usize
    }

    /// Number of external references.
    pub fn externals(&self) -> usize {
        (self.words[0] >> 16) as usize
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        (self.words[1] & 0xffff) as usize
    }

    /// Number of parts.
    pub fn parts(&self) -> usize {
        (self.words[1] >> 16) as usize
    }

    /// Whether rays may pass a cell of a node, or of the one beside it; where not, all stop all.
    #[inline(always)]
    pub fn may_transmit(&self, node: usize) -> bool {
        let (word, bit) = transmitting_at(node);
        self.words[TRANSMITTING_AT + word] >> bit & 1 == 1
    }

    /// What the header says of all nodes.
    pub fn declared_transmitting(&self) -> &[u32] {
        &self.words[TRANSMITTING_AT..HEADER_WORDS]
    }

    /// What it is to say, by the voxels.
    pub fn transmitting(&self) -> Transmitting {
        let (mut transmitting, mut first) = (Transmitting::default(), 0);
        for node in 0..self.nodes() {
            let end = first + self.node(node).valid.count_ones() as usize;
            mark_transmitting(&mut transmitting, node, (first..end).any(|i| stopped(self.voxel_at(i)[0]) > 0));
            first = end;
        }
        transmitting
    }

    /// Where the leaves begin.
    pub fn first_leaf(&self) -> usize {
        self.sides_at() + self.six_sided() * SIDES_WORDS
    }

    /// Number of voxels.
    pub fn voxels(&self) -> usize {
        (self.words[5] & 0xffff) as usize
    }

    /// Number of voxels of six sides.
    pub fn six_sided(&self) -> usize {
        (self.words[5] >> 16) as usize
    }

    /// Words of a voxel.
    #[inline]
    pub fn voxel_words(&self) -> usize {
        self.words[6] as usize
    }

    /// Where the voxels begin.
    #[inline]
    pub(super) fn voxels_at(&self) -> usize {
        self.words[4] as usize + self.nodes()
    }

    /// Where the voxels' sides begin.
    #[inline]
    pub(super) fn sides_at(&self) -> usize {
        self.voxels_at() + self.voxels() * self.voxel_words()
    }

    /// Words of voxel `index`.
    #[inline]
    pub fn voxel_at(&self, index: usize) -> &'a [u32] {
        let at = self.voxels_at() + index * self.voxel_words();
        &self.words[at..at + self.voxel_words()]
    }

    /// The voxel of the child in `slot` of node `index`.
    #[inline]
    pub fn voxel(&self, index: usize, slot: usize) -> StoredVoxel<'a> {
        let first = self.words[self.words[4] as usize + index] as usize;
        let before = u32::from(self.node(index).valid) & ((1 << slot) - 1);
        StoredVoxel { words: self.voxel_at(first + before.count_ones() as usize), block: *self }
    }

    /// A node by its index.
    #[inline(always)]
    pub fn node(&self, index: usize) -> &'a Node {
        let start = HEADER_WORDS + index * NODE_WORDS;
        match self.words[start..start + NODE_WORDS].first_chunk::<NODE_WORDS>() {
            Some(words) => must_cast_ref(words),
            None => unreachable!(),
        }
    }

    /// An external reference by its first word: block id and child reference inside it.
    #[inline(always)]
    pub fn external(&self, at: usize) -> (u32, u32) {
        (self.words[at], self.words[at + 1])
    }

    /// All external references, in their order.
    pub fn all_externals(&self) -> impl Iterator<Item = (u32, u32)> + use<'a> {
        let (block, first) = (*self, self.words[2] as usize);
        (0..self.externals()).map(move |i| block.external(first + i * EXTERNAL_WORDS))
    }

    /// The number of the external reference that begins at a word, if one does.
    pub fn number_of_external(&self, at: usize) -> Option<usize> {
        let from = at.checked_sub(self.words[2] as usize)?;
        let number = from / EXTERNAL_WORDS;
        (from % EXTERNAL_WORDS == 0 && number < self.externals()).then_some(number)
    }

    /// Node and slot that an external reference hangs in.
    #[inline]
    pub fn place_of_external(&self, at: usize) -> (usize, usize) {
        let word = self.words[at + 2];
        ((word & 0xffff) as usize, (word >> 16) as usize)
    }

    /// The tree's local part at `index` of the block's parts.
    #[inline(always)]
    pub fn part(&self, index: usize) -> u32 {
        self.words[self.words[3] as usize + index]
    }

    /// A leaf by its first word.
    #[inline(always)]
    pub fn leaf(&self, at: usize) -> Leaf<'a> {
        Leaf::at(&self.words[at..])
    }
}

/// The voxel of a child, in its block.
#[derive(Debug, Clone, Copy)]
pub struct StoredVoxel<'a> {
    words: &'a [u32],
    block: Block<'a>,
}

impl StoredVoxel<'_> {
    /// Its words, but for those of its sides.
    #[inline]
    pub fn words(&self) -> &[u32] {
        self.words
    }

    /// Whether it has a sample for each side.
    #[inline]
    pub fn has_sides(&self) -> bool {
        Coded::has_sides(self.words[0])
    }

    /// Whether its one sample is of what faces along the axes.
    #[inline]
    pub fn is_along_axes(&self) -> bool {
        Coded::is_along_axes(self.words[0])
    }

    /// The words of its sides' samples, if it has them.
    #[inline]
    pub fn sides(&self) -> &[u32] {
        let at = self.block.sides_at() + self.words[1] as usize * SIDES_WORDS;
        &self.block.words[at..at + SIDES_WORDS]
    }

    /// Whether its colours count, and not those of its part.
    #[inline]
    pub fn has_colours(&self) -> bool {
        Coded::has_colours(self.words[0])
    }

    /// The tree's local part of which most is seen, and whether there are others.
    #[inline]
    pub fn part(&self) -> (u32, bool) {
        self.words.get(2).map_or((self.block.words[7], false), |word| Coded::part(*word))
    }

    /// How many of 4096 rays it stops; 0: it stops all.
    #[inline]
    pub fn stopped(&self) -> u32 {
        stopped(self.words[0])
    }

    /// The bits of all its parts, see [`summary_bit`].
    pub fn summary(&self) -> u32 {
        self.words.get(3).copied().unwrap_or_else(|| summary_bit(self.block.words[7]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bit for each two.
    #[test]
    fn who_may_be_passed_is_it_and_the_one_beside() {
        for node in 0..MAX_WORDS / NODE_WORDS {
            let mut transmitting = Transmitting::default();
            mark_transmitting(&mut transmitting, node, true);
            let words = [[0; TRANSMITTING_AT], transmitting].concat();
            let may_be = |other| Block::new(&words).may_transmit(other);
            assert!((0..MAX_WORDS / NODE_WORDS).all(|other| may_be(other) == (other / 2 == node / 2)), "{node}");
        }
    }

    #[test]
    fn child_references_round_trip() {
        for child in [Child::Node(0), Child::Node(16383), Child::Leaf(4), Child::External(77)] {
            assert_eq!(Child::from_bits(u32::from(child.to_bits())), Some(child));
        }
        assert_eq!(Child::from_bits(3 << 14), None);
    }
}
