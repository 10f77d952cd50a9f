//! The resident form of a tree: an array of nodes, and an array of words with leaves. Words are floats; those of a
//! leaf's head hold the bits of integers.
//!
//! A link is a 32-bit word. With [`LEAF`] it holds the first word of a leaf, in units of [`UNIT`] words, shifted left
//! by 3, and the number of triangles less 1 in the lowest three bits. Otherwise it is the index of a node.
//!
//! A leaf of `n` triangles:
//!
//! | words | content |
//! |---|---|
//! | 0 | block of the triangles |
//! | 1 | item of the first triangle in that block; the others follow in order |
//! | 2 | local part of all triangles; with [`MIXED`] the index of the first of `n` parts in [`Resident::parts`] |
//! | 3 .. | nine rows of `n` floats: x, y, z of the first corners, of the second corners, of the third corners |
//!
//! The array ends with zeros, so that eight floats can be read from the begin of each row.

use crate::structure::hit::TriHit;
use crate::structure::hit::Triangle;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Number of children of a node.
pub const WIDTH: usize = 8;
/// Greatest number of triangles of a leaf.
pub const MAX_TRIANGLES: usize = 8;
/// Bit of links to leaves.
pub const LEAF: u32 = 1 << 31;
/// A link to nothing. It looks like a link to a leaf.
pub const NOTHING: u32 = u32::MAX;
/// Words that the place of a leaf is a multiple of.
pub const UNIT: usize = 4;
/// Words of a leaf before its rows.
pub const HEAD: usize = 3;
/// Words of nine rows of [`MAX_TRIANGLES`], and so the words that can be read behind the head of each leaf.
pub const ROWS: usize = 9 * MAX_TRIANGLES;
/// Bit of word 2 of a leaf: the triangles belong to several parts.
pub const MIXED: u32 = 1 << 31;

/// A node: four cache lines.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Node {
    /// Planes of the eight children: least x, y, z, then greatest x, y, z.
    pub planes: [[f32; WIDTH]; 6],
    /// Links to the children. An unused slot holds [`NOTHING`] and an empty box, which no ray hits.
    pub child: [u32; WIDTH],
    /// Bit `i`: slot `i` holds a child.
    pub valid: u32,
    pad: [u32; WIDTH - 1],
}

impl Node {
    /// A node without children.
    pub const NONE: Self = Self {
        planes: [
            [f32::INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
        ],
        child: [NOTHING; WIDTH],
        valid: 0,
        pad: [0; WIDTH - 1],
    };
}

/// The resident form of a tree.
#[derive(Debug)]
pub struct Resident {
    /// The nodes; the root is the first.
    pub nodes: Vec<Node>,
    /// The leaves.
    pub leaves: Vec<f32>,
    /// Parts of the triangles of leaves with several parts.
    pub parts: Vec<u32>,
    /// Greatest magnitude of a coordinate of the tree.
    pub max_coord: f32,
}

/// A leaf.
#[derive(Debug, Clone, Copy)]
pub struct Leaf<'a> {
    /// Words of the head.
    pub head: &'a [f32; HEAD],
    /// The rows, and whatever follows them.
    pub rows: &'a [f32; ROWS],
    /// Number of triangles, 1 to [`MAX_TRIANGLES`].
    pub triangles: usize,
}

impl Resident {
    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        (self.nodes.capacity() * size_of::<Node>() + 4 * self.leaves.capacity() + 4 * self.parts.capacity()) as u64
    }

    /// True if the form is larger than the caches near a core, so that prefetching pays.
    pub fn is_large(&self) -> bool {
        self.leaves.len() > LARGE
    }

    /// Returns the leaf of a link with [`LEAF`] that is not [`NOTHING`].
    #[inline(always)]
    pub fn leaf(&self, link: u32) -> Leaf<'_> {
        let at = ((link & !LEAF) >> 3) as usize * UNIT;
        let words = self.leaves.get(at..at + HEAD + ROWS).and_then(|words| words.split_first_chunk::<HEAD>());
        match words.and_then(|(head, rows)| Some((head, rows.first_chunk::<ROWS>()?))) {
            Some((head, rows)) => Leaf { head, rows, triangles: (link & 7) as usize + 1 },
            None => unreachable!(),
        }
    }

    /// Local part of triangle `i` of a leaf.
    #[inline]
    pub fn part(&self, leaf: &Leaf, i: usize) -> u32 {
        match leaf.head[2].to_bits() {
            word if word & MIXED != 0 => self.parts[(word & !MIXED) as usize + i],
            part => part,
        }
    }

    /// Triangle `i` of a leaf.
    pub fn triangle(&self, leaf: &Leaf, i: usize) -> Triangle {
        let at = |row: usize| leaf.rows[row * leaf.triangles + i];
        let corner = |c: usize| Vec3::new(at(3 * c), at(3 * c + 1), at(3 * c + 2));
        Triangle { vertices: [corner(0), corner(1), corner(2)], part: self.part(leaf, i) }
    }
}

impl Leaf<'_> {
    /// The hit on triangle `i` at `t`, with the weights `u` and `v`.
    #[inline(always)]
    pub fn hit(&self, i: u32, t: f32, u: f32, v: f32) -> TriHit {
        TriHit { t, u, v, block: self.head[0].to_bits(), tri: self.head[1].to_bits() + i }
    }
}

/// Words of leaves above which walks prefetch.
const LARGE: usize = 8 << 20;
