//! The trace form of a block: the bytes that walks read.
//!
//! A block is a slice of little-endian 32-bit words, at most [`MAX_WORDS`]. It is decoded from the file form once and
//! checked at that time (`codec.rs`; `validate.rs` checks the words themselves). Offsets in a block count words.
//!
//! | words | content |
//! |---|---|
//! | 0 | nodes (u16), external references (u16) |
//! | 1 | triangles (u16), parts (u16) |
//! | 2, 3 | first words of the external references and of the parts |
//! | 4 | first word of the list of the nodes' first voxels |
//! | 5 | voxels (u16), voxels of six sides (u16) |
//! | 6 | words of a voxel: 2, or 4 with its parts (u16); words of the curtains (u16) |
//! | 7 | with 2: the local part of all voxels; else 0 |
//! | 8 to 15 | a bit for each pair of nodes: stand-ins of their children may transmit rays (`lod::stopped`) |
//! | 16 .. | nodes, [`NODE_WORDS`] each; node 0 first, children after their parents |
//! | .. | external references: block id, child reference there; node (u16) and slot (u16) here |
//! | .. | parts: local part of the tree, ascending |
//! | .. | for each node the number of its first voxel |
//! | .. | voxels (`lod::Coded`): one for each child of each node, in order |
//! | .. | the samples of the voxels of six sides, [`SIDES_WORDS`] each |
//! | .. | the curtains: for each voxel that has some its summary, that of the parts that they show, and the curtains |
//! | .. | leaves, unless they are in a block of their own |
//! | last [`PAD_WORDS`] | zero, so that a vector load at the end of a leaf stays inside |
//!
//! Word 1 of a voxel of six sides is its number among such voxels. For nodes without a bit in words 8 to 15 the
//! coverage test reads no voxels. The last word of a voxel with curtains is the position of its summary, counted from
//! the first word of all curtains.
//!
//! The leaves below the nodes of a fine block are in another block, its **leaf block**, which has no nodes: a picture
//! of stand-ins needs no triangles. A reference to a leaf then counts words in the leaf block. The tree determines the
//! id of that block (`trace::TreeView::leaves_at`). A tree of one block has its leaves in this block.
//!
//! A **node** has up to eight children. Their boxes have 8 bits a plane on a grid of the node's own,
//! `origin + q * 2^(exponent - 127)`, rounded outward. The grid follows Ylitie, Karras, Laine, "Efficient Incoherent
//! Ray Traversal on GPUs Through Compressed Wide BVHs", HPG 2017. The rest of the node differs: it has explicit 16-bit
//! references instead of a common base.
//!
//! In a tree over members (`members.rs`) the numbers of a block's members take the place of its parts, and there are no
//! leaves. Children that are nodes have the first slots, and only they have voxels; nodes above members without looks
//! have none, and no block has any if no member has a look.
//!
//! `leaf.rs` describes a **leaf**.

use super::leaf::Leaf;
pub use super::voxel::StoredVoxel;
use crate::lod::{self, FIELDS, LEVEL, Middle, OrientedSlabs, SIDES_WORDS, TRANSMITTING_LEVEL, VOXEL_WORDS, stopped};
use crate::math::Bounds;
use bytemuck::{Pod, Zeroable, must_cast_ref};
use glam::Vec3;

/// Greatest number of words of a block: 64 KB.
pub const MAX_WORDS: usize = 16384;
/// Words before the nodes. The nodes begin at a cache line.
pub const HEADER_WORDS: usize = 16;
/// First of the header words that mark nodes which may transmit rays.
const TRANSMITTING_AT: usize = 8;
/// The header words that mark nodes which may transmit rays.
pub type Transmitting = [u32; HEADER_WORDS - TRANSMITTING_AT];
const _: () = assert!(MAX_WORDS / NODE_WORDS <= 2 * 32 * (HEADER_WORDS - TRANSMITTING_AT), "a bit for each two nodes");

/// Word and bit of a node in [`Transmitting`].
#[inline(always)]
fn transmitting_at(node: usize) -> (usize, u32) {
    (node >> 6 & (HEADER_WORDS - TRANSMITTING_AT - 1), node as u32 >> 1 & 31)
}

/// Marks a node if `may_transmit`: a stand-in of one of its children may transmit rays.
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
/// Words of a cache line. Blocks begin at a cache line.
pub const LINE_WORDS: usize = 16;
/// Zero words at the end of a block.
pub const PAD_WORDS: usize = 16;
/// Number of nodes that no block exceeds.
pub const MAX_NODES: usize = MAX_WORDS / NODE_WORDS;
/// Greatest number of children of a node.
pub const WIDTH: usize = 8;
/// Greatest number of triangles of a leaf.
pub const MAX_TRIANGLES: usize = 8;
/// Greatest number of vertices of a leaf.
pub const MAX_VERTICES: usize = 16;

/// Classes of blocks, in the order of a tree's blocks in the file. Coarse blocks have nodes over other blocks, or hold
/// a tree of one block; fine blocks have nodes over leaves; leaf blocks have leaves.
pub const COARSE: usize = 0;
/// See [`COARSE`].
pub const FINE: usize = 1;
/// See [`COARSE`].
pub const LEAF: usize = 2;

/// Target of a 16-bit child reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Child {
    /// A node of the same block, by its index.
    Node(usize),
    /// A leaf by its first word, in the same block or in the corresponding leaf block.
    Leaf(usize),
    /// A node in another block, by the first word of the external reference.
    External(usize),
    /// A member, in trees over members instead of triangles, by the word that holds its number. Files have none.
    Member(usize),
}

/// First bit of a reference's kind; see [`Child`].
pub(super) const KIND_SHIFT: u32 = 14;
/// The bits of a reference's index.
pub(super) const INDEX_MASK: u32 = (1 << KIND_SHIFT) - 1;

impl Child {
    /// Decodes a reference. Bits above the 16th are ignored.
    #[inline(always)]
    pub fn from_bits(bits: u32) -> Self {
        let index = (bits & INDEX_MASK) as usize;
        match bits >> KIND_SHIFT & 3 {
            0 => Child::Node(index),
            1 => Child::Leaf(index),
            2 => Child::External(index),
            _ => Child::Member(index),
        }
    }

    /// True if a reference points at a leaf.
    #[inline(always)]
    pub fn is_leaf(bits: u32) -> bool {
        bits >> KIND_SHIFT & 3 == 1
    }

    /// True if a reference points at a leaf or a member: no node is below it.
    #[inline(always)]
    pub fn is_end(bits: u32) -> bool {
        bits >> KIND_SHIFT & 1 == 1
    }

    /// Encodes the reference.
    pub fn to_bits(self) -> u16 {
        let (kind, index) = match self {
            Child::Node(i) => (0, i),
            Child::Leaf(i) => (1, i),
            Child::External(i) => (2, i),
            Child::Member(i) => (3, i),
        };
        debug_assert!(index <= INDEX_MASK as usize);
        (kind << KIND_SHIFT | index as u32 & INDEX_MASK) as u16
    }
}

/// The slabs of a child that never stands in, in a tree over members: their lower plane is above their upper one, which
/// no content has.
const NEVER_STANDS_IN: u32 = (1 << FIELDS[0].1) - 1;

/// An inner node: two cache lines.
///
/// Invariants, checked by `validate`: `origin` is finite; exponents are in 1..=254; in each valid slot `low <= high` on
/// each axis; references are in range, and those to nodes have a greater index.
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
    /// The oriented slabs of the children's voxels (`lod::OrientedSlabs`).
    pub slabs: [u32; WIDTH],
    /// Axes of the first slabs: the two signed bytes of the voxels' normals, each with its highest bit inverted. Such a
    /// byte, read as unsigned, is the signed value plus 128.
    pub normal: [[u8; WIDTH]; 2],
}
const _: () = assert!(size_of::<Node>() == NODE_WORDS * 4);

impl Node {
    /// The grid's step on `axis`.
    #[inline(always)]
    pub fn step(&self, axis: usize) -> f32 {
        f32::from_bits(u32::from(self.exponent[axis]) << 23)
    }

    /// The origin's bits, and a word with the exponents in its low bytes.
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

    /// A plane of a child as walks use it, rounded once. `row` counts low x, y, z, high x, y, z.
    #[inline(always)]
    pub fn stored_plane(&self, row: usize, slot: usize) -> f32 {
        // A product with a power of two is exact, so only the sum rounds.
        f32::from(self.planes[row][slot & (WIDTH - 1)]) * self.step(row % 3) + self.origin[row % 3]
    }

    /// The low half of the first word of a child's voxel: its normal.
    #[inline(always)]
    pub fn stored_normal(&self, slot: usize) -> u16 {
        let slot = slot & (WIDTH - 1);
        u16::from_le_bytes([self.normal[0][slot], self.normal[1][slot]]) ^ 0x8080
    }

    /// Stores a child's oriented slabs, and the low half of the first word of its voxel.
    pub fn set_oriented_slabs(&mut self, slot: usize, slabs: u32, normal: u16) {
        self.slabs[slot] = slabs;
        [self.normal[0][slot], self.normal[1][slot]] = (normal ^ 0x8080).to_le_bytes();
    }

    /// Level of the bound on the distance from the region inside of a child's slabs to its content (`lod::limit`).
    #[inline(always)]
    pub fn level(&self, slot: usize) -> u32 {
        self.slabs[slot & (WIDTH - 1)] >> LEVEL.0
    }

    /// Stores the level of a child that has none yet.
    pub fn set_level(&mut self, slot: usize, level: u32) {
        self.slabs[slot] |= level << LEVEL.0;
    }

    /// Sets the level of a child to 0: its cell then counts with all of its area where it may stand in.
    pub fn clear_level(&mut self, slot: usize) {
        self.slabs[slot] &= !(3 << LEVEL.0);
    }

    /// Makes a child unable to stand in.
    pub fn keep_from_standing_in(&mut self, slot: usize) {
        self.set_oriented_slabs(slot, NEVER_STANDS_IN, 0);
    }

    /// True if a child never stands in. (Not the children of a file's nodes: all their slabs have content.)
    #[inline(always)]
    pub fn never_stands_in(&self, slot: usize) -> bool {
        self.slabs[slot & (WIDTH - 1)] == NEVER_STANDS_IN
    }

    /// Marks a child that may transmit rays: its level becomes at most [`TRANSMITTING_LEVEL`]. For children of greater
    /// levels walks need not read the voxel's stop code.
    pub fn set_transmitting(&mut self, slot: usize) {
        let level = self.level(slot).min(TRANSMITTING_LEVEL);
        self.slabs[slot] = self.slabs[slot] & !(3 << LEVEL.0) | level << LEVEL.0;
    }

    /// The oriented slabs that bound the content of a child.
    #[inline(always)]
    pub fn stored_oriented_slabs(&self, slot: usize) -> OrientedSlabs<f32> {
        let word = self.slabs[slot & (WIDTH - 1)];
        lod::oriented_slabs(
            lod::fields(word),
            lod::normal_bytes(self.stored_normal(slot).into()),
            &self.stored_middle(slot),
        )
    }

    /// A child's box in the form that its slabs need.
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

    /// A child's box as walks use it. The exact planes on the grid are outside of the child. The child's own planes are
    /// single-precision numbers, so the rounded planes are outside of it too.
    #[inline]
    pub fn stored_box(&self, slot: usize) -> Bounds {
        let at = |row: usize| self.stored_plane(row, slot);
        Bounds { min: Vec3::new(at(0), at(1), at(2)), max: Vec3::new(at(3), at(4), at(5)) }
    }

    /// The box of a child, rounded outward once more in case the sum on the grid is not exact.
    pub fn child_box(&self, slot: usize) -> Bounds {
        self.box_between(self.planes.map(|planes| planes[slot]))
    }

    /// The smallest box around the boxes of all children; empty if there are none.
    pub fn children_box(&self) -> Bounds {
        if self.valid == 0 {
            return Bounds::EMPTY;
        }
        // A greater plane on the grid is not smaller in space, so one plane of each row decides.
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

    /// The box between planes on the grid: low planes, then high planes.
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

/// Writes into a block's header which nodes may transmit rays.
pub fn put_transmitting(words: &mut [u32]) {
    let transmitting = Block::new(words).transmitting();
    words[TRANSMITTING_AT..HEADER_WORDS].copy_from_slice(&transmitting);
}

/// The first words of a leaf block. The other words of its header are zero, and its parts follow.
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
    /// A block over words that `validate` has accepted. The slice may be empty, for a placeholder.
    #[inline(always)]
    pub fn new(words: &'a [u32]) -> Self {
        Self { words }
    }

    /// All words.
    #[inline(always)]
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

    /// True if a stand-in of the node's children, or of the other node of its pair, may transmit rays. If false, these
    /// stand-ins stop all rays.
    #[inline(always)]
    pub fn may_transmit(&self, node: usize) -> bool {
        let (word, bit) = transmitting_at(node);
        self.words[TRANSMITTING_AT + word] >> bit & 1 == 1
    }

    /// The marks of all nodes, as the header states them.
    pub fn declared_transmitting(&self) -> &[u32] {
        &self.words[TRANSMITTING_AT..HEADER_WORDS]
    }

    /// The marks of all nodes, computed from the voxels.
    pub fn transmitting(&self) -> Transmitting {
        let (mut transmitting, mut first) = (Transmitting::default(), 0);
        for node in 0..self.nodes() {
            let end = first + self.node(node).valid.count_ones() as usize;
            mark_transmitting(&mut transmitting, node, (first..end).any(|i| stopped(self.voxel_at(i)[0]) > 0));
            first = end;
        }
        transmitting
    }

    /// First word of the leaves.
    pub fn first_leaf(&self) -> usize {
        self.curtains_at() + self.words_of_curtains()
    }

    /// First word of the curtains.
    #[inline]
    pub(super) fn curtains_at(&self) -> usize {
        self.sides_at() + self.six_sided() * SIDES_WORDS
    }

    /// Words of all curtains.
    #[inline]
    pub fn words_of_curtains(&self) -> usize {
        (self.words[6] >> 16) as usize
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
        (self.words[6] & 0xffff) as usize
    }

    /// First word of the voxels.
    #[inline]
    pub(super) fn voxels_at(&self) -> usize {
        self.words[4] as usize + self.nodes()
    }

    /// First word of the samples of voxels of six sides.
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

    /// The voxels of all children, in order.
    pub fn all_voxels(&self) -> impl Iterator<Item = StoredVoxel<'a>> + use<'a> {
        let block = *self;
        (0..block.voxels()).map(move |i| StoredVoxel::new(block, i))
    }

    /// The voxel of the child in `slot` of node `index`.
    #[inline]
    pub fn voxel(&self, index: usize, slot: usize) -> StoredVoxel<'a> {
        let first = self.words[self.words[4] as usize + index] as usize;
        let before = u32::from(self.node(index).valid) & ((1 << slot) - 1);
        StoredVoxel::new(*self, first + before.count_ones() as usize)
    }

    /// The voxel of child `number` of node `index`: its number among the node's children, not its slot.
    #[inline]
    pub fn voxel_of(&self, index: usize, number: usize) -> StoredVoxel<'a> {
        StoredVoxel::new(*self, self.words[self.words[4] as usize + index] as usize + number)
    }

    /// The node at `index`.
    #[inline(always)]
    pub fn node(&self, index: usize) -> &'a Node {
        let start = HEADER_WORDS + index * NODE_WORDS;
        match self.words[start..start + NODE_WORDS].first_chunk::<NODE_WORDS>() {
            Some(words) => must_cast_ref(words),
            None => unreachable!(),
        }
    }

    /// The external reference that begins at word `at`: block id and child reference in that block.
    #[inline(always)]
    pub fn external(&self, at: usize) -> (u32, u32) {
        (self.words[at], self.words[at + 1])
    }

    /// All external references, in order.
    pub fn all_externals(&self) -> impl Iterator<Item = (u32, u32)> + use<'a> {
        let (block, first) = (*self, self.words[2] as usize);
        (0..self.externals()).map(move |i| block.external(first + i * EXTERNAL_WORDS))
    }

    /// Number of the external reference that begins at word `at`, if one does.
    pub fn number_of_external(&self, at: usize) -> Option<usize> {
        let from = at.checked_sub(self.words[2] as usize)?;
        let number = from / EXTERNAL_WORDS;
        (from % EXTERNAL_WORDS == 0 && number < self.externals()).then_some(number)
    }

    /// Node and slot of an external reference.
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

    /// The number of the member at word `at`.
    #[inline(always)]
    pub fn member(&self, at: usize) -> u32 {
        self.words[at]
    }

    /// The leaf that begins at word `at`.
    #[inline(always)]
    pub fn leaf(&self, at: usize) -> Leaf<'a> {
        Leaf::at(&self.words[at..])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One bit covers two nodes.
    #[test]
    fn transmitting_bit_covers_a_pair_of_nodes() {
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
        for child in [Child::Node(0), Child::Node(16383), Child::Leaf(4), Child::External(77), Child::Member(9)] {
            assert_eq!(Child::from_bits(u32::from(child.to_bits())), child);
        }
    }
}
