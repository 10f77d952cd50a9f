//! The decoder of this structure's blocks, for residency, and the check of their words.

use super::layout::{
    Block, COARSE, Child, FINE, Frame, GRIDS, Grids, HEAD_WORDS, IS_COMPUTED, IS_RATIONAL, MAX_WORDS, MOST_GRIDS,
    MOST_LEVEL, MOST_PLACE, NODE_WORDS, NODES, Voxel, WIDTH,
};
use super::net::{self, Computed, NET_WORDS, RATIONAL_WORDS};
use super::nodes::parts_and_blocks;
use crate::base::ids::BlockId;
use crate::lod::{Coded, LEVEL, stopped, summary_bit};
use crate::math::Bounds;
use crate::residency::{BlockClass, Decoder, Entries, MOST_NODES, Reference, Statements};
use crate::store::{Header, TreeRow};
use crate::structure::Structure;
use crate::structure::open::ListedParts;
use crate::structure::streams::{self, Kind, Streams};
use std::collections::HashMap;
use std::hash::{BuildHasher, RandomState};

const _: () = assert!(MAX_WORDS / NODE_WORDS <= MOST_NODES);

/// Decodes the blocks of trees of structure `patch`.
#[derive(Debug, Clone)]
pub struct PatchDecoder {
    streams: Streams,
    /// Block ranges of the trees, ascending.
    trees: Vec<TreeBlocks>,
    /// Key of the hash by which a block's frames and its leaf block's grids are compared (`shapes_of_grids`): random,
    /// so that no file can be constructed in which they compare equal and differ.
    key: RandomState,
}

/// Block ranges of a tree.
#[derive(Debug, Clone, Copy)]
pub struct TreeBlocks {
    first: u32,
    coarse_end: u32,
    fine_end: u32,
    end: u32,
}

impl TreeBlocks {
    fn of(row: &TreeRow) -> Self {
        let coarse_end = row.first_block + row.class_blocks[COARSE];
        let fine_end = coarse_end + row.class_blocks[FINE];
        Self { first: row.first_block, coarse_end, fine_end, end: row.first_block + row.block_count }
    }

    fn leaves_at(&self) -> u32 {
        self.fine_end - self.coarse_end
    }
}

/// Difference between the id of a leaf block and that of its block of frames.
pub fn leaves_at(tree: &TreeRow) -> u32 {
    tree.class_blocks[FINE]
}

/// Number of blocks of a tree that other blocks may refer to: those with nodes, but for the first.
pub fn entered_blocks(tree: &TreeRow) -> u32 {
    tree.class_blocks[COARSE].saturating_add(leaves_at(tree)).saturating_sub(1)
}

/// The blocks whose lists name the parts of blocks with triangles: the first, their number, and the difference between
/// the ids of both.
pub fn holders(tree: &TreeRow) -> (u32, u32, u32) {
    (tree.first_block + tree.class_blocks[COARSE], leaves_at(tree), leaves_at(tree))
}

/// Returns the parts of a geometry block, in any order. A fine block lists the parts of its leaf block.
pub fn block_parts(tree: &TreeRow, id: BlockId, words: &[u32]) -> ListedParts {
    let blocks = TreeBlocks::of(tree);
    let (parts, below) = parts_and_blocks(words);
    let listed_by = if id.0 >= blocks.fine_end { BlockId(id.0 - blocks.leaves_at()) } else { id };
    ListedParts { parts, listed_by, below: below.into_iter().map(BlockId).collect() }
}

impl PatchDecoder {
    /// Bytes of memory for each tree.
    pub const BYTES_A_TREE: usize = size_of::<TreeBlocks>();

    /// A decoder for the trees of this structure among those of a model with this header.
    pub fn new(header: &Header, trees: &[TreeRow]) -> Self {
        let own = trees.iter().filter(|tree| tree.structure == Structure::Patch as u32);
        Self { streams: Streams::of(header), trees: own.map(TreeBlocks::of).collect(), key: RandomState::new() }
    }

    fn tree_of(&self, id: u32) -> Option<TreeBlocks> {
        self.trees.get(self.trees.partition_point(|t| t.end <= id)).copied().filter(|tree| tree.first <= id)
    }
}

impl Decoder for PatchDecoder {
    fn decode(&self, id: BlockId, payload: &[u8], words: usize) -> Result<Vec<u32>, String> {
        match self.streams.kind(id) {
            Kind::Geometry => {
                let tree = self.tree_of(id.0).ok_or("the block belongs to no tree")?;
                let (file, rest) = payload.as_chunks();
                if file.len() != words || words > MAX_WORDS {
                    return Err("the size differs from the size in the directory".into());
                }
                if !rest.is_empty() {
                    return Err("the size is not a multiple of 4 bytes".into());
                }
                let words: Vec<u32> = file.iter().map(|&word| u32::from_le_bytes(word)).collect();
                validate(&words, id.0, tree)?;
                Ok(words)
            }
            kind => streams::decode(kind, payload, words),
        }
    }

    fn statements(&self, id: BlockId, words: &[u32]) -> Statements {
        let Some(tree) = self.tree_of(id.0).filter(|_| self.streams.kind(id) == Kind::Geometry) else {
            return Statements::default();
        };
        if id.0 >= tree.fine_end {
            let agreed = Reference::Agreed(id, self.key.hash_one(shapes_of_grids(Grids(words))));
            return Statements { references: vec![agreed], ..Statements::default() };
        }
        let block = Block(words);
        let mut references: Vec<Reference> =
            parts_and_blocks(words).1.into_iter().map(|to| Reference::To(BlockId(to), 0)).collect();
        if id.0 >= tree.coarse_end {
            let shape = |frame: Frame| [frame.part(), frame.face(), frame.levels() + 1];
            let shapes: Vec<[u32; 3]> = block.all_frames().map(|(_, frame)| shape(frame)).collect();
            references.push(Reference::Agreed(BlockId(id.0 + tree.leaves_at()), self.key.hash_one(shapes)));
        }
        let mut entries = Entries::default();
        entries[0] = 1;
        Statements { nodes: block.nodes() as u32, entries, references }
    }

    fn class(&self, id: BlockId) -> BlockClass {
        let is_read_ahead = self.streams.is_read_ahead(id);
        let Some(tree) = self.tree_of(id.0) else { return BlockClass { is_read_ahead, ..BlockClass::default() } };
        let is_fine = (tree.coarse_end..tree.fine_end).contains(&id.0);
        BlockClass {
            is_coarse: id.0 < tree.coarse_end,
            below: is_fine.then(|| BlockId(id.0 + tree.leaves_at())),
            is_read_ahead,
            is_entered: id.0 < tree.fine_end && id.0 > tree.first,
        }
    }
}

/// Part, primitive id and level of each grid. Those of the frames above are the same.
fn shapes_of_grids(grids: Grids) -> Vec<[u32; 3]> {
    (0..grids.count())
        .filter_map(|number| grids.grid(number))
        .map(|grid| [grid.part(), grid.face(), grid.level])
        .collect()
}

fn ensure(holds: bool, why: &str) -> Result<(), String> {
    if holds { Ok(()) } else { Err(why.to_string()) }
}

/// Checks the words of a geometry block of a tree. Fails with the fault.
pub fn validate(words: &[u32], id: u32, tree: TreeBlocks) -> Result<(), String> {
    ensure(words.len() >= 2, "unexpected end of data")?;
    if id >= tree.fine_end {
        return check_grids(words);
    }
    ensure(words.len() >= HEAD_WORDS && words[0] == NODES, "the block has an unexpected kind")?;
    ensure(words[4..HEAD_WORDS].iter().all(|word| *word == 0), "words of the head that must be zero are not")?;
    let (block, nodes) = (Block(words), (words[1] & 0xffff) as usize);
    let voxels_at = HEAD_WORDS + nodes * NODE_WORDS;
    ensure(nodes > 0 && words[2] as usize == voxels_at, "the position of the voxels is wrong")?;
    let frames_at = words[3] as usize;
    ensure(voxels_at <= frames_at && frames_at <= words.len(), "the position of the frames is wrong")?;
    ensure(id < tree.coarse_end || block.frames() > 0, "a fine block has no frames")?;
    ensure(id >= tree.coarse_end || block.frames() == 0, "a coarse block has frames")?;
    let mut met = Met { voxel: voxels_at, nodes: vec![false; nodes], frames: Vec::new() };
    (0..nodes).try_for_each(|index| check_node(block, index, (id, tree), &mut met))?;
    ensure(met.voxel == frames_at, "the number of voxels is wrong")?;
    ensure(met.nodes[1..].iter().all(|met| *met), "a node has no parent")?;
    check_frames(block, &met.frames)
}

/// References that were met.
struct Met {
    /// First word of the next voxel.
    voxel: usize,
    nodes: Vec<bool>,
    frames: Vec<usize>,
}

fn check_node(block: Block, index: usize, (id, tree): (u32, TreeBlocks), met: &mut Met) -> Result<(), String> {
    let node = block.node(index).ok_or("a node does not fit into the block")?;
    let count = node.children().count();
    ensure(count > 0 && (0..count).all(|slot| node.child(slot) != Child::None), "a node has no children or gaps")?;
    for slot in 0..WIDTH {
        let (bounds, child) = (node.bounds(slot), node.child(slot));
        if child == Child::None {
            let is_zero = node.0[48 + slot] == 0 && node.0[56 + slot] == 0;
            // A box that no ray meets.
            ensure(is_zero && bounds == Bounds::EMPTY, "an unused slot is not empty")?;
            continue;
        }
        let is_sound = bounds.min.is_finite() && bounds.max.is_finite() && bounds.min.cmple(bounds.max).all();
        ensure(is_sound, "a box is not finite or is inverted")?;
        let has_voxel = match child {
            Child::Node(below) => {
                let is_new = below > index && met.nodes.get(below) == Some(&false);
                ensure(is_new, "a node has an invalid child reference")?;
                met.nodes[below] = true;
                true
            }
            Child::Frame(at) => {
                met.frames.push(at);
                false
            }
            Child::Block(to) => {
                let may = id < tree.coarse_end && id < to && to < tree.fine_end;
                ensure(may, "a node refers to an invalid block")?;
                true
            }
            Child::None => false,
        };
        ensure(
            node.0[56 + slot] as usize == if has_voxel { met.voxel } else { 0 },
            "the position of a voxel is wrong",
        )?;
        if has_voxel {
            let voxel = block.voxel(&node, slot).ok_or("a voxel does not fit into the block")?;
            check_voxel(voxel)?;
            met.voxel += voxel.0.len();
        }
    }
    Ok(())
}

fn check_voxel(voxel: Voxel) -> Result<(), String> {
    let words = voxel.0;
    let is_sound = words[0] >> LEVEL.0 == 0 && stopped(words[1]) == 0 && !Coded::has_curtains(words[3]);
    ensure(is_sound, "a voxel has a level, a stop code or curtains, which this structure does not use")?;
    ensure(voxel.sides().is_none() || words[2] == 0, "the second word of a voxel with six samples is not zero")?;
    let (part, is_mixed) = Coded::part(words[3]);
    ensure(is_mixed || words[4] == summary_bit(part), "the summary of a voxel of one part is not that of the part")
}

/// Checks that the frames follow each other up to the end of the block and that nodes refer to each of them once.
fn check_frames(block: Block, met: &[usize]) -> Result<(), String> {
    let mut firsts = Vec::with_capacity(block.frames());
    let mut end = block.0[3] as usize;
    for (number, (at, frame)) in block.all_frames().enumerate() {
        ensure(frame.levels() < MOST_LEVEL && frame.head[14] & 0xfff0 == 0, "a frame has an unknown shape")?;
        ensure(frame.grid() == number, "the grids of frames are not numbered consecutively")?;
        let [level, column, row] = frame.place();
        let is_place = level <= MOST_PLACE && column.max(row) >> level == 0 && frame.head[15] >> 29 == 0;
        ensure(is_place, "the place of a frame is not in the square of its face")?;
        let numbers = frame.head[..12].iter().map(|word| f32::from_bits(*word));
        ensure(numbers.into_iter().all(f32::is_finite), "a frame is not finite")?;
        let size = frame.map().as_dmat3().determinant();
        ensure(size.is_normal() && frame.back().is_finite(), "the map of a frame has no inverse")?;
        firsts.push(at);
        end = at + frame.size();
    }
    let words = block.0;
    ensure(firsts.len() == block.frames() && end == words.len(), "the frames do not fill the block")?;
    let mut met = met.to_vec();
    met.sort_unstable();
    ensure(met == firsts, "a frame is not referred to exactly once")
}

fn check_grids(words: &[u32]) -> Result<(), String> {
    let count = words[1] as usize;
    ensure(words[0] == GRIDS, "the block has an unexpected kind")?;
    ensure((1..=MOST_GRIDS).contains(&count) && 2 + count <= words.len(), "the number of grids is wrong")?;
    let (mut next, mut normal) = (2 + count, 0u32);
    let mut grids = Vec::with_capacity(count);
    for number in 0..count {
        ensure(words[2 + number] as usize == next, "the position of a grid is wrong")?;
        let shape = words.get(next + 2).copied().unwrap_or(0);
        ensure((1..=MOST_LEVEL).contains(&(shape & 15)) && shape >> 6 == 0, "a grid has an invalid level or kind")?;
        ensure(shape & (IS_COMPUTED | IS_RATIONAL) != IS_RATIONAL, "a grid that is not computed is rational")?;
        let grid = Grids(words).grid(number).ok_or("a grid does not fit into the block")?;
        ensure(grid.head[3] == normal, "the normals of grids do not follow each other")?;
        let is_finite = grid.vertices.iter().all(|word| f32::from_bits(*word).is_finite());
        ensure(is_finite, "a vertex is not finite")?;
        if let Some(computed) = grid.computed {
            net::check(&computed, grid.level)?;
            grids.push(computed);
        } else {
            normal += (grid.side * grid.side) as u32;
        }
        next += grid.size();
    }
    next = check_nets(&grids, next)?;
    ensure(next == words.len(), "the grids and nets do not fill the block")
}

/// Checks the nets of computed grids: they follow the grids, in the order of references. Returns the end of the last.
fn check_nets(grids: &[Computed], first: usize) -> Result<usize, String> {
    let (mut end, mut met) = (first, HashMap::new());
    for grid in grids {
        let kind = met.entry(grid.net_at).or_insert_with(|| {
            let is_next = grid.net_at as usize == end;
            end += if grid.net.is_rational() { RATIONAL_WORDS } else { NET_WORDS };
            is_next.then(|| grid.net.is_rational())
        });
        ensure(*kind == Some(grid.net.is_rational()), "the position of a net is wrong")?;
        grid.net.check()?;
    }
    Ok(end)
}

#[cfg(test)]
#[path = "decoder_tests.rs"]
mod tests;
