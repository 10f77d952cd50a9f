//! The bytes of a block: 32-bit words, little-endian, the same in the file and in memory.
//!
//! A **frame** is a square part of a surface with a local system of its own: an affine map whose x and y run along the
//! part's sides and whose z is across it. In this system all of the part lies between -1 and 1 along each axis. Below a
//! frame is a complete quadtree without references (Selgrad 2016, section 3.1): the children of node `n` of a level are
//! nodes `4 n` to `4 n + 3` of the next, and a word describes the boxes of the children (`codes.rs`). Each leaf of the
//! quadtree is four cells of the part's **grid**, eight triangles. Grids are in a block of their own, the **leaf
//! block** of the block with the frames: a picture of stand-ins needs none.
//!
//! Coarse blocks have nodes over other blocks, fine blocks nodes over frames. Walks begin at node 0 of a block.
//!
//! | words of a coarse or a fine block | |
//! |---|---|
//! | 0 | [`NODES`] |
//! | 1 | nodes (u16), frames (u16) |
//! | 2, 3 | first words of the voxels and of the frames |
//! | 4 to 15 | 0 |
//! | 16 .. | nodes, [`NODE_WORDS`] each: children after their parents |
//! | .. | voxels, one for each child that is no frame, in order |
//! | .. | frames |
//!
//! | words of a node | |
//! |---|---|
//! | 0 to 47 | boxes of up to eight children, then empty ones: low x of all, low y, low z, high x, high y, high z |
//! | | (f32) |
//! | 48 to 55 | references: see [`Child`] |
//! | 56 to 63 | first words of the children's voxels; 0 for frames |
//!
//! | words of a voxel | |
//! |---|---|
//! | 0 | oriented slabs of everything below in the child's box (`lod::OrientedSlabs`), with level 0 |
//! | 1 to 4 | the voxel (`lod::Coded`): a sample, whose second word is 0 beside samples of sides; the part; the |
//! | | summary of parts; it stops all rays |
//! | 5 to 16 | samples of its six sides, if it has them |
//!
//! | words of a frame | |
//! |---|---|
//! | 0 to 2 | centre of the system (f32), relative to the tree's origin |
//! | 3 to 11 | rows of the linear map to the system (f32) |
//! | 12 | the tree's local part |
//! | 13 | primitive id: the face |
//! | 14 | bits 0 to 3 levels of the quadtree below the root, bits 16 to 31 number of the grid in the leaf block |
//! | 15 | place in the square of the face: level (bits 0 to 3), column (bits 4 to 15) and row (bits 16 to 27) there; |
//! | | bit 28: x runs along the face's v, y along its u |
//! | 16 | corner of the face, if the face has other than four |
//! | 17, 18 | normals at the four corners, 16 bits each (`lod`): of (0, 0), (1, 0), (0, 1), (1, 1) |
//! | 19 | second word of the sample that stand-ins show: colour and cover |
//! | 20 .. | the words of the quadtree's inner nodes, level by level |
//!
//! | words of a leaf block | |
//! |---|---|
//! | 0 | [`GRIDS`] |
//! | 1 | grids |
//! | .. | first word of each grid |
//! | .. | grids |
//! | .. | nets of control points (`net.rs`), in the order in which computed grids refer to them |
//!
//! | words of a grid | |
//! |---|---|
//! | 0, 1 | part, primitive id |
//! | 2 | bits 0 to 3 level; bit 4: the grid is computed; bit 5: its net is rational |
//! | 3 | number of the first normal: of computed grids none is stored |
//! | .. | vertices of a stored grid (f32 x, y, z), rows along x |
//!
//! | further words of a computed grid | |
//! |---|---|
//! | 4 | first word of the net |
//! | 5 | place of the grid's square in the patch of the net: level (bits 0 to 3) and column (4 to 15) along u, row |
//! | | (16 to 27) and level (28 to 31) along v |
//! | 6 | bits 0 to 15: by how many levels the edges at v = 0, v = 1, u = 0 and u = 1 are coarser than the grid; their |
//! | | points take the places of the vertices between them. Bits 16 to 31: number of corrections |
//! | .. | corrections: number of the vertex, its coordinates |
//!
//! A grid of level n has 2^n cells along each side. Cell (i, j) has the corners (i, j), (i + 1, j), (i + 1, j + 1) and
//! (i, j + 1), and two triangles: the first three of these, and the first, the third and the fourth. The normals of a
//! leaf block are in a block of normals, a code (`math::octahedral`) for each vertex of each stored grid.

use super::codes::Planes;
use super::net::{CORRECTION_WORDS, Computed, Net};
use crate::lod::{Coded, coded_normal, stored_normal};
use crate::math::Bounds;
use bytemuck::must_cast_ref;
use glam::{DMat3, DVec3, Mat3, Vec3};

/// First word of a block of nodes. Blocks with per-triangle numbers begin with smaller values.
pub const NODES: u32 = 8;
/// First word of a leaf block.
pub const GRIDS: u32 = 9;
/// Words before the nodes.
pub const HEAD_WORDS: usize = 16;
/// Words of a node.
pub const NODE_WORDS: usize = 64;
/// Most children of a node.
pub const WIDTH: usize = 8;
/// Words of a frame before those of its quadtree.
pub const FRAME_WORDS: usize = 20;
/// Words of a voxel with one sample.
pub const SHORT_VOXEL: usize = 5;
/// Words of a voxel with a sample for each side.
pub const LONG_VOXEL: usize = 17;
/// Words of a grid before its vertices.
pub const GRID_WORDS: usize = 4;
/// Words of a computed grid before its corrections.
pub const COMPUTED_WORDS: usize = 7;
/// Bit of a grid's third word: the grid is computed.
pub const IS_COMPUTED: u32 = 1 << 4;
/// Bit of a grid's third word: its net is rational.
pub const IS_RATIONAL: u32 = 1 << 5;
/// Greatest number of words of a block: 64 KB.
pub const MAX_WORDS: usize = 16384;
/// Greatest level of a grid.
pub const MOST_LEVEL: u32 = 5;
/// Greatest level of a frame's place in the square of its face.
pub const MOST_PLACE: u32 = 12;
/// Bits from 28 of the place of a frame that is turned over.
pub const TURNED: u32 = 1;
/// Greatest number of grids of a leaf block.
pub const MOST_GRIDS: usize = 1 << 10;

/// Classes of blocks, in the order of a tree's blocks in the file.
pub const COARSE: usize = 0;
/// See [`COARSE`].
pub const FINE: usize = 1;
/// See [`COARSE`].
pub const LEAF: usize = 2;
/// Number of classes.
pub const CLASSES: usize = 3;

/// A reference of a node, with its kind in the two highest bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Child {
    /// There is no child.
    None,
    /// A node of the block, by its index.
    Node(usize),
    /// A frame of the block, by its first word.
    Frame(usize),
    /// Node 0 of another block, by its id.
    Block(u32),
}

impl Child {
    const NUMBER: u32 = (1 << 30) - 1;

    /// Decodes a reference.
    #[inline(always)]
    pub fn from_bits(bits: u32) -> Self {
        let number = bits & Self::NUMBER;
        match bits >> 30 {
            0 if number == 0 => Self::None,
            0 => Self::Node(number as usize),
            1 => Self::Frame(number as usize),
            2 => Self::Block(number),
            _ => Self::None,
        }
    }

    /// Encodes the reference.
    pub fn to_bits(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Node(index) => index as u32,
            Self::Frame(word) => 1 << 30 | word as u32,
            Self::Block(id) => 2 << 30 | id,
        }
    }
}

/// Words of a quadtree with so many levels below its root: one for each inner node.
pub const fn tree_words(levels: u32) -> usize {
    ((1usize << (2 * levels)) - 1) / 3
}

/// A block of nodes that [`super::PatchDecoder`] has accepted.
#[derive(Debug, Clone, Copy)]
pub struct Block<'a>(pub &'a [u32]);

impl<'a> Block<'a> {
    /// Number of nodes; 0 for a leaf block.
    pub fn nodes(self) -> usize {
        if self.0.first() == Some(&NODES) { (self.0[1] & 0xffff) as usize } else { 0 }
    }

    /// Number of frames.
    pub fn frames(self) -> usize {
        (self.0[1] >> 16) as usize
    }

    /// The node at `index`.
    #[inline(always)]
    pub fn node(self, index: usize) -> Option<Node<'a>> {
        let at = HEAD_WORDS + index * NODE_WORDS;
        self.0.get(at..at + NODE_WORDS).and_then(|words| words.first_chunk()).map(Node)
    }

    /// The frame that begins at a word.
    #[inline(always)]
    pub fn frame(self, at: usize) -> Option<Frame<'a>> {
        let words = self.0.get(at..)?;
        let head = words.first_chunk::<FRAME_WORDS>()?;
        let tree = words.get(FRAME_WORDS..FRAME_WORDS + tree_words(head[14] & 15))?;
        Some(Frame { head, tree })
    }

    /// The frames, in order, with their first words.
    pub fn all_frames(self) -> impl Iterator<Item = (usize, Frame<'a>)> {
        let mut at = self.0[3] as usize;
        (0..self.frames()).map_while(move |_| {
            let (here, frame) = (at, self.frame(at)?);
            at += frame.size();
            Some((here, frame))
        })
    }

    /// The frame with a number: that of the grid of this number in the leaf block.
    pub fn frame_of_grid(self, number: usize) -> Option<Frame<'a>> {
        self.all_frames().nth(number).map(|it| it.1)
    }

    /// The voxel of a child.
    #[inline]
    pub fn voxel(self, node: &Node, slot: usize) -> Option<Voxel<'a>> {
        let at = node.0[56 + (slot & 7)] as usize;
        if at == 0 { None } else { self.0.get(at..).and_then(Voxel::at) }
    }
}

/// A node.
#[derive(Debug, Clone, Copy)]
pub struct Node<'a>(pub &'a [u32; NODE_WORDS]);

impl Node<'_> {
    /// The rows of planes: low x, y, z, high x, y, z.
    #[inline(always)]
    pub fn rows(&self) -> &[[f32; WIDTH]; 6] {
        let rows: &[[f32; WIDTH]; WIDTH] = must_cast_ref(self.0);
        match rows.first_chunk() {
            Some(rows) => rows,
            None => unreachable!(),
        }
    }

    /// The box of a child.
    #[inline(always)]
    pub fn bounds(&self, slot: usize) -> Bounds {
        let at = |row: usize| f32::from_bits(self.0[WIDTH * row + (slot & 7)]);
        Bounds { min: Vec3::new(at(0), at(1), at(2)), max: Vec3::new(at(3), at(4), at(5)) }
    }

    /// A child.
    #[inline(always)]
    pub fn child(&self, slot: usize) -> Child {
        Child::from_bits(self.0[48 + (slot & 7)])
    }

    /// The references of all children.
    #[inline(always)]
    pub fn references(&self) -> &[u32; WIDTH] {
        let rows: &[[u32; WIDTH]; WIDTH] = must_cast_ref(self.0);
        &rows[6]
    }

    /// The children with their slots.
    pub fn children(&self) -> impl Iterator<Item = (usize, Child)> + '_ {
        (0..WIDTH).map(|slot| (slot, self.child(slot))).filter(|it| it.1 != Child::None)
    }
}

/// A voxel.
#[derive(Debug, Clone, Copy)]
pub struct Voxel<'a>(pub &'a [u32]);

impl<'a> Voxel<'a> {
    /// The voxel at the start of some words.
    fn at(words: &'a [u32]) -> Option<Self> {
        let len = if Coded::has_sides(*words.get(1)?) { LONG_VOXEL } else { SHORT_VOXEL };
        words.get(..len).map(Self)
    }

    /// The samples of its sides, if it has them.
    pub fn sides(self) -> Option<&'a [u32]> {
        (self.0.len() == LONG_VOXEL).then(|| &self.0[SHORT_VOXEL..])
    }
}

/// A frame with its quadtree.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    /// The words before the quadtree.
    pub head: &'a [u32; FRAME_WORDS],
    /// The words of inner nodes.
    pub tree: &'a [u32],
}

/// The box of a frame's root in its own system.
pub const ROOT: Planes = [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0];

impl Frame<'_> {
    /// Words of the frame.
    pub fn size(&self) -> usize {
        FRAME_WORDS + self.tree.len()
    }

    /// Levels of the quadtree below the root.
    #[inline(always)]
    pub fn levels(&self) -> u32 {
        self.head[14] & 15
    }

    /// Number of the grid in the leaf block.
    #[inline(always)]
    pub fn grid(&self) -> usize {
        (self.head[14] >> 16) as usize
    }

    /// The tree's local part.
    #[inline(always)]
    pub fn part(&self) -> u32 {
        self.head[12]
    }

    /// Primitive id.
    pub fn face(&self) -> u32 {
        self.head[13]
    }

    /// Corner of the face, of its vertices in order, in whose quad the frame is; 0 if the face has four corners.
    pub fn corner(&self) -> u32 {
        self.head[16]
    }

    /// Place in the square of the face: level, column and row.
    pub fn place(&self) -> [u32; 3] {
        let word = self.head[15];
        [word & 15, word >> 4 & 0xfff, word >> 16 & 0xfff]
    }

    /// True if the frame's x is the face's v: the surface was turned over.
    pub fn is_turned(&self) -> bool {
        self.head[15] >> 28 == TURNED
    }

    /// The parameters in the face of those in the frame, from 0 to 1.
    pub fn in_face(&self, u: f32, v: f32) -> [f32; 2] {
        let [level, column, row] = self.place();
        let size = 1.0 / (1u32 << level) as f32;
        let at = [(column as f32 + u) * size, (row as f32 + v) * size];
        if self.is_turned() { [at[1], at[0]] } else { at }
    }

    /// Centre of the system.
    #[inline(always)]
    pub fn centre(&self) -> Vec3 {
        let at = |i: usize| f32::from_bits(self.head[i]);
        Vec3::new(at(0), at(1), at(2))
    }

    /// The linear map to the system.
    #[inline(always)]
    pub fn map(&self) -> Mat3 {
        let at = |i: usize| f32::from_bits(self.head[i]);
        Mat3::from_cols(
            Vec3::new(at(3), at(6), at(9)),
            Vec3::new(at(4), at(7), at(10)),
            Vec3::new(at(5), at(8), at(11)),
        )
    }

    /// The map from the system, without the centre.
    pub fn back(&self) -> DMat3 {
        self.map().as_dmat3().inverse()
    }

    /// The first word of the sample that a stand-in at these parameters of the frame shows, from 0 to 1.
    pub fn sample(&self, u: f32, v: f32) -> [u32; 2] {
        let of = |i: usize| stored_normal(self.head[17 + i / 2] >> (16 * (i % 2)) & 0xffff);
        let (low, high) = (of(0).lerp(of(1), u), of(2).lerp(of(3), u));
        let normal = low.lerp(high, v).normalize_or(of(0));
        [coded_normal(normal) | 0xff << 16, self.head[19]]
    }
}

/// Bounds of a box of a frame's system in the tree's frame, rounded outward. `back`: [`Frame::back`].
pub fn bounds_of(planes: &Planes, back: &DMat3, centre: Vec3) -> Bounds {
    let [x, y, z, u, v, w] = planes.map(f64::from);
    let (middle, half) = (DVec3::new(x + u, y + v, z + w) * 0.5, DVec3::new(u - x, v - y, w - z) * 0.5);
    let at = *back * middle + centre.as_dvec3();
    let reach = DMat3::from_cols(back.x_axis.abs(), back.y_axis.abs(), back.z_axis.abs()) * half;
    // Of a few roundings in double precision.
    let reach = reach * (1.0 + 1e-12) + at.abs() * 1e-14;
    let (low, high) = (at - reach, at + reach);
    let down = |x: f64| if f64::from(x as f32) > x { (x as f32).next_down() } else { x as f32 };
    let low = Vec3::new(down(low.x), down(low.y), down(low.z));
    let high = -Vec3::new(down(-high.x), down(-high.y), down(-high.z));
    Bounds { min: low, max: high }
}

/// A leaf block that [`super::PatchDecoder`] has accepted.
#[derive(Debug, Clone, Copy)]
pub struct Grids<'a>(pub &'a [u32]);

impl<'a> Grids<'a> {
    /// Number of grids; 0 for other blocks.
    pub fn count(self) -> usize {
        if self.0.first() == Some(&GRIDS) { self.0[1] as usize } else { 0 }
    }

    /// The grid with this number.
    #[inline(always)]
    pub fn grid(self, number: usize) -> Option<Grid<'a>> {
        if number >= self.count() {
            return None;
        }
        let words = self.0.get(*self.0.get(2 + number)? as usize..)?;
        let head = words.first_chunk::<GRID_WORDS>()?;
        let level = (head[2] & 15).min(MOST_LEVEL);
        let side = (1 << level) + 1;
        if head[2] & IS_COMPUTED == 0 {
            let vertices = words.get(GRID_WORDS..GRID_WORDS + 3 * side * side)?;
            return Some(Grid { head, level, side, vertices, computed: None });
        }
        let [net_at, place, shape] = *words.get(GRID_WORDS..)?.first_chunk()?;
        let end = COMPUTED_WORDS + CORRECTION_WORDS * (shape >> 16) as usize;
        let computed = Computed {
            net: Net::at(self.0.get(net_at as usize..)?, head[2] & IS_RATIONAL != 0)?,
            net_at,
            place: [[place & 15, place >> 4 & 0xfff], [place >> 28, place >> 16 & 0xfff]],
            steps: shape & 0xffff,
            corrections: words.get(COMPUTED_WORDS..end)?.as_chunks().0,
        };
        Some(Grid { head, level, side, vertices: &[], computed: Some(computed) })
    }
}

/// A grid of vertices.
#[derive(Debug, Clone, Copy)]
pub struct Grid<'a> {
    /// Part, primitive id, level and kind, number of the first normal.
    pub head: &'a [u32; GRID_WORDS],
    /// It has 2^level cells along each side.
    pub level: u32,
    /// Vertices along a side.
    pub side: usize,
    /// The coordinates of the vertices of a stored grid.
    pub vertices: &'a [u32],
    /// How the vertices of another grid are computed.
    pub computed: Option<Computed<'a>>,
}

impl Grid<'_> {
    /// Words of the grid.
    pub fn size(&self) -> usize {
        match self.computed {
            None => GRID_WORDS + self.vertices.len(),
            Some(it) => COMPUTED_WORDS + it.corrections.as_flattened().len(),
        }
    }

    /// A vertex, by column and row.
    #[inline(always)]
    pub fn vertex(&self, i: usize, j: usize) -> Vec3 {
        if let Some(computed) = &self.computed {
            return computed.vertex(self.level, i, j);
        }
        let at = 3 * (j * self.side + i);
        let of = |axis: usize| f32::from_bits(self.vertices[at + axis]);
        Vec3::new(of(0), of(1), of(2))
    }

    /// The local part.
    pub fn part(&self) -> u32 {
        self.head[0]
    }

    /// Primitive id.
    pub fn face(&self) -> u32 {
        self.head[1]
    }

    /// Numbers, in the grid, of the corners of a triangle of [`tri_of`].
    #[inline(always)]
    pub fn corners(&self, tri: u32) -> Option<[usize; 3]> {
        let (leaf, which) = ((tri >> 3 & 0x3ff) as usize, (tri & 7) as usize);
        let (i, j) = of_morton(leaf);
        // Two triangles of each of four cells.
        let (i, j) = (2 * i + (which >> 1 & 1), 2 * j + (which >> 2));
        if i + 1 >= self.side || j + 1 >= self.side {
            return None;
        }
        let at = |i: usize, j: usize| j * self.side + i;
        Some(match which & 1 {
            0 => [at(i, j), at(i + 1, j), at(i + 1, j + 1)],
            _ => [at(i, j), at(i + 1, j + 1), at(i, j + 1)],
        })
    }

    /// Where a vertex is in the grid's square, from 0 to 1 along both sides.
    pub fn parameters(&self, i: usize, j: usize) -> [f32; 2] {
        let [i, j] = self.computed.map_or([i, j], |it| it.index(self.level, i, j));
        let cells = (self.side - 1) as f32;
        [i as f32 / cells, j as f32 / cells]
    }

    /// Where a point of a triangle of [`tri_of`] is in the grid's square, by the weights of its second and third
    /// corner.
    pub fn at(&self, tri: u32, [second, third]: [f32; 2]) -> Option<[f32; 2]> {
        let [a, b, c] = self.corners(tri)?.map(|at| self.parameters(at % self.side, at / self.side));
        Some([0, 1].map(|axis| a[axis] + second * (b[axis] - a[axis]) + third * (c[axis] - a[axis])))
    }

    /// The corners of a triangle of [`tri_of`].
    #[inline(always)]
    pub fn triangle(&self, tri: u32) -> Option<[Vec3; 3]> {
        let corners = self.corners(tri)?;
        Some(corners.map(|at| self.vertex(at % self.side, at / self.side)))
    }
}

/// The item of a triangle in a leaf block: number of the grid, of the quadtree's leaf, and of the triangle there.
#[inline(always)]
pub fn tri_of(grid: usize, leaf: usize, which: u32) -> u32 {
    (grid as u32) << 13 | (leaf as u32) << 3 | which
}

/// The grid in the item of a triangle.
#[inline(always)]
pub fn grid_of(tri: u32) -> usize {
    (tri >> 13) as usize
}

/// Column and row of a node, by its number on its level: bits of both in turn, the column's first.
#[inline(always)]
pub fn of_morton(number: usize) -> (usize, usize) {
    let even = |mut x: usize| {
        x &= 0x5555;
        x = (x | x >> 1) & 0x3333;
        x = (x | x >> 2) & 0x0f0f;
        (x | x >> 4) & 0x00ff
    };
    (even(number), even(number >> 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_round_trip() {
        for child in [Child::Node(1), Child::Node(255), Child::Frame(80), Child::Block(0), Child::Block(1 << 29)] {
            assert_eq!(Child::from_bits(child.to_bits()), child);
        }
        assert_eq!(Child::from_bits(0), Child::None);
        assert_eq!(Child::from_bits(3 << 30 | 5), Child::None);
    }

    #[test]
    fn numbers_of_nodes_are_their_columns_and_rows() {
        let mut met = std::collections::BTreeSet::new();
        for number in 0..1024 {
            let (i, j) = of_morton(number);
            assert!(i < 32 && j < 32 && met.insert((i, j)));
            // The children of a node have its column and row, doubled.
            assert_eq!(of_morton(number / 4), (i / 2, j / 2));
            assert_eq!((i % 2, j % 2), (number % 2, number / 2 % 2));
        }
    }

    #[test]
    fn trees_have_a_word_for_each_inner_node() {
        assert_eq!([0, 1, 2, 3, 4].map(tree_words), [0, 1, 5, 21, 85]);
    }

    /// The bounds of a box hold its corners, and not much more.
    #[test]
    fn bounds_hold_the_corners() {
        let map = Mat3::from_cols(Vec3::new(3.0, 0.2, -0.1), Vec3::new(0.4, 5.0, 0.3), Vec3::new(0.0, -0.7, 100.0));
        let (back, centre) = (map.as_dmat3().inverse(), Vec3::new(100.0, -7.0, 0.3));
        let planes = [-0.5, 0.1, -1.0, 0.25, 0.7, -0.9];
        let bounds = bounds_of(&planes, &back, centre);
        let mut all = crate::math::DBounds::EMPTY;
        for corner in 0..8 {
            let at: [f64; 3] = std::array::from_fn(|axis| f64::from(planes[axis + 3 * (corner >> axis & 1)]));
            all = all.with(back * DVec3::from(at) + centre.as_dvec3());
        }
        assert!(bounds.min.as_dvec3().cmple(all.min).all() && bounds.max.as_dvec3().cmpge(all.max).all());
        assert!((bounds.extent().as_dvec3() - all.extent()).max_element() < 2e-5);
    }
}
