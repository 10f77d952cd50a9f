//! The bytes of a block: 32-bit words, little-endian, the same in the file and in memory.
//!
//! | words of an index block | |
//! |---|---|
//! | 0 | [`INDEX`] |
//! | 1 | rows, 1 to [`ROWS`] |
//! | .. | rows, [`ROW_WORDS`] each |
//!
//! | words of a row | |
//! |---|---|
//! | 0 | id of the block below: an index block or a list, with a greater id than this block |
//! | 1 | kind of the block below: [`INDEX`] or [`LIST`] |
//! | 2 to 7 | box of everything below: low x, y, z, high x, y, z (f32) |
//! | 8 | oriented slabs of everything below in that box (`lod::OrientedSlabs`), with level 0 |
//! | 9 to 12 | the voxel (`lod::Coded`): a sample, the part, the summary of parts; it stops all rays |
//! | 13 to 24 | samples of its six sides; 0 if it has one sample |
//!
//! | words of a list | |
//! |---|---|
//! | 0 | [`LIST`] |
//! | 1 | triangles, 1 to [`TRIANGLES`] |
//! | .. | triangles by ascending primitive id: three corners (f32 x, y, z), the tree's local part |
//!
//! Block 0 of a tree is the index block over all others. A tree has at most two levels of index blocks.

use crate::lod::{
    Coded, LEVEL, Middle, OrientedSlabs, SIDES_WORDS, VOXEL_WORDS, fields, normal_bytes, oriented_slabs, stopped,
};
use crate::math::Bounds;
use crate::structure::hit::Triangle;
use glam::Vec3;

/// First word of an index block. Blocks with per-triangle numbers begin with smaller values.
pub const INDEX: u32 = 6;
/// First word of a list.
pub const LIST: u32 = 7;
/// Greatest number of rows of an index block.
pub const ROWS: usize = 64;
/// Greatest number of triangles of a list.
pub const TRIANGLES: usize = 64;
/// Words before rows and triangles.
pub const HEAD_WORDS: usize = 2;
/// Words of a row.
pub const ROW_WORDS: usize = 9 + VOXEL_WORDS + SIDES_WORDS;
/// Words of a triangle.
pub const TRIANGLE_WORDS: usize = 10;

/// Number of block classes.
pub const CLASSES: usize = 2;

/// A row of an index block.
#[derive(Debug, Clone, Copy)]
pub struct Row<'a>(pub &'a [u32; ROW_WORDS]);

impl<'a> Row<'a> {
    /// Id and kind of the block below.
    pub fn below(self) -> (u32, u32) {
        (self.0[0], self.0[1])
    }

    /// Box of everything below.
    pub fn bounds(self) -> Bounds {
        let at = |i: usize| f32::from_bits(self.0[i]);
        Bounds { min: Vec3::new(at(2), at(3), at(4)), max: Vec3::new(at(5), at(6), at(7)) }
    }

    /// Oriented slabs of everything below.
    pub fn slabs(self) -> OrientedSlabs<f32> {
        stored_oriented_slabs(self.0[8], self.voxel()[0], &self.bounds())
    }

    /// The voxel, without its sides.
    pub fn voxel(self) -> &'a [u32] {
        &self.0[9..9 + VOXEL_WORDS]
    }

    /// The samples of the voxel's sides, if it has them.
    pub fn sides(self) -> Option<&'a [u32]> {
        Coded::has_sides(self.voxel()[0]).then(|| &self.0[9 + VOXEL_WORDS..])
    }

    fn check(self) -> Result<(), &'static str> {
        let Bounds { min, max } = self.bounds();
        let fault = if !(min.is_finite() && max.is_finite() && min.cmple(max).all()) {
            "a box is not finite or is inverted"
        } else if self.0[8] >> LEVEL.0 != 0 || stopped(self.voxel()[0]) != 0 {
            "a voxel has a level or a stop code, which this structure does not use"
        } else if self.sides().is_none() && self.0[9 + VOXEL_WORDS..].iter().any(|&word| word != 0) {
            "a voxel with one sample has data for more samples"
        } else {
            return Ok(());
        };
        Err(fault)
    }
}

/// Decodes the slabs of a word in a box. `first` is the voxel's first word.
pub fn stored_oriented_slabs(word: u32, first: u32, bounds: &Bounds) -> OrientedSlabs<f32> {
    oriented_slabs(fields(word), normal_bytes(first), &Middle::of(bounds))
}

/// A decoded block.
#[derive(Debug, Clone, Copy)]
pub enum Block<'a> {
    /// Rows of an index block.
    Index(&'a [[u32; ROW_WORDS]]),
    /// Triangles of a list.
    List(&'a [[u32; TRIANGLE_WORDS]]),
}

impl<'a> Block<'a> {
    /// A block over words that [`check`] has accepted. In memory zeros may follow, up to a whole cache line.
    pub fn new(words: &'a [u32]) -> Self {
        let (head, rest) = words.split_at(HEAD_WORDS);
        let count = head[1] as usize;
        if head[0] == INDEX {
            Block::Index(&rest.as_chunks().0[..count])
        } else {
            Block::List(&rest.as_chunks().0[..count])
        }
    }

    /// The row at `index` of an index block.
    pub fn row(self, index: usize) -> Option<Row<'a>> {
        if let Block::Index(rows) = self { rows.get(index).map(Row) } else { None }
    }

    /// The triangle at `index` of a list.
    pub fn triangle(self, index: usize) -> Option<Triangle> {
        if let Block::List(triangles) = self { triangles.get(index).map(triangle) } else { None }
    }
}

/// Decodes a triangle from its words.
pub fn triangle(words: &[u32; TRIANGLE_WORDS]) -> Triangle {
    let at = |i: usize| f32::from_bits(words[i]);
    let corner = |i: usize| Vec3::new(at(3 * i), at(3 * i + 1), at(3 * i + 2));
    Triangle { vertices: [corner(0), corner(1), corner(2)], part: words[9] }
}

/// Ids of the blocks of a tree: index blocks, then lists.
#[derive(Debug, Clone, Copy)]
pub struct Range {
    /// The first list.
    pub lists: u32,
    /// One past the last list.
    pub end: u32,
}

/// Checks the words of block `id` of a tree. Fails with the fault.
pub fn check(words: &[u32], id: u32, tree: Range) -> Result<(), String> {
    let is_index = id < tree.lists;
    let (kind, most, size) = if is_index { (INDEX, ROWS, ROW_WORDS) } else { (LIST, TRIANGLES, TRIANGLE_WORDS) };
    let (Some(&first), Some(&count)) = (words.first(), words.get(1)) else {
        return Err("unexpected end of data".into());
    };
    let count = count as usize;
    if first != kind {
        return Err("the block has an unexpected kind".into());
    }
    if !(1..=most).contains(&count) || words.len() != HEAD_WORDS + count * size {
        return Err("the counts are inconsistent".into());
    }
    match Block::new(words) {
        Block::Index(rows) => rows.iter().try_for_each(|row| {
            let (below, kind) = Row(row).below();
            let expected = if kind == INDEX { id + 1..tree.lists } else { tree.lists..tree.end };
            if !(kind == INDEX || kind == LIST) || !expected.contains(&below) {
                return Err("a row refers to an invalid block".to_string());
            }
            Row(row).check().map_err(str::to_string)
        }),
        Block::List(triangles) => {
            let is_finite = |t: &[u32; TRIANGLE_WORDS]| triangle(t).vertices.iter().all(|v| v.is_finite());
            if triangles.iter().all(is_finite) { Ok(()) } else { Err("a vertex is not finite".into()) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TREE: Range = Range { lists: 2, end: 4 };

    fn index(below: u32, kind: u32) -> Vec<u32> {
        let mut words = vec![INDEX, 1, below, kind];
        words.extend([0.0f32, 0.0, 0.0, 1.0, 1.0, 0.0].map(f32::to_bits));
        words.resize(HEAD_WORDS + ROW_WORDS, 0);
        words
    }

    fn list() -> Vec<u32> {
        let mut words = vec![LIST, 1];
        words.resize(HEAD_WORDS + TRIANGLE_WORDS, 0);
        words
    }

    #[test]
    fn blocks_are_accepted_where_they_belong() {
        for (words, id) in [(index(1, INDEX), 0), (index(3, LIST), 0), (index(2, LIST), 1), (list(), 2), (list(), 3)] {
            assert_eq!(check(&words, id, TREE), Ok(()));
        }
    }

    #[test]
    fn malformed_blocks_are_refused() {
        let changed = |mut words: Vec<u32>, at: usize, to: u32| {
            words[at] = to;
            words
        };
        let nan = f32::NAN.to_bits();
        let bad = [
            (Vec::new(), 0),
            (vec![INDEX], 0),
            (index(2, LIST), 2),
            (list(), 1),
            (index(0, INDEX), 0),
            (index(1, INDEX), 1),
            (index(2, INDEX), 0),
            (index(1, LIST), 0),
            (index(4, LIST), 0),
            (index(2, 0), 0),
            (changed(index(2, LIST), 1, 0), 0),
            (changed(index(2, LIST), 1, 2), 0),
            (changed(index(2, LIST), 4, nan), 0),
            (changed(index(2, LIST), 4, 2.0f32.to_bits()), 0),
            (changed(index(2, LIST), 10, 1 << LEVEL.0), 0),
            (changed(index(2, LIST), 11, crate::lod::stop_bits(9)), 0),
            (changed(index(2, LIST), 20, 1), 0),
            (changed(list(), 1, 65), 2),
            (changed(list(), 5, nan), 2),
            ([list(), vec![0]].concat(), 2),
        ];
        for (i, (words, id)) in bad.into_iter().enumerate() {
            assert!(check(&words, id, TREE).is_err(), "{i}");
        }
    }
}
