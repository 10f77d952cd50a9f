//! The decoder of this structure's blocks, for residency.

use super::codec::{self, Holds, Place};
use super::codec_leaves::leaves_in_order;
use super::layout::{Block, COARSE, Child, FINE, INDEX_MASK, KIND_SHIFT, MAX_WORDS, NODE_WORDS, WIDTH};
use crate::base::ids::BlockId;
use crate::residency::{BlockClass, Decoder, Entries, MOST_NODES, Reference, Snapshot, Statements};
use crate::store::{Header, TreeRow};
use crate::structure::Structure;
use crate::structure::open::ListedParts;
use crate::structure::streams::{self, Kind, Streams};
use std::collections::HashSet;
use std::hash::{BuildHasher, RandomState};

/// Decodes the blocks of the trees of structure `bvh`, and the streams of a model.
#[derive(Debug, Clone)]
pub struct BvhDecoder {
    streams: Streams,
    /// Block ranges of the trees of this structure, ascending.
    trees: Vec<TreeBlocks>,
    /// Key of the hash by which two lists of leaf positions are compared. It is random for each decoder, so no file can
    /// be constructed in which two different lists compare equal.
    key: RandomState,
}

/// Block ranges of a tree.
#[derive(Debug, Clone, Copy)]
struct TreeBlocks {
    /// The first block.
    first: u32,
    /// One past the last coarse block.
    coarse_end: u32,
    /// One past the last fine block.
    fine_end: u32,
    /// One past the last leaf block.
    end: u32,
}

impl TreeBlocks {
    /// See [`leaves_at`].
    fn leaves_at(&self) -> u32 {
        self.fine_end - self.coarse_end
    }

    /// True if one block holds the whole tree.
    fn is_one(&self) -> bool {
        self.end - self.first == 1
    }
}

/// Difference between the id of a leaf block and the id of its fine block; 0 for a tree of one block.
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
    match tree.block_count {
        0 => (0, 0, 0),
        1 => (tree.first_block, 1, 0),
        _ => (tree.first_block + tree.class_blocks[COARSE], leaves_at(tree), leaves_at(tree)),
    }
}

impl BvhDecoder {
    /// Bytes of memory for each tree.
    pub const BYTES_A_TREE: usize = size_of::<TreeBlocks>();

    /// A decoder for the trees of this structure among those of a model with this header.
    pub fn new(header: &Header, trees: &[TreeRow]) -> Self {
        let own = || trees.iter().filter(|tree| tree.structure == Structure::Bvh as u32);
        let blocks = |t: &TreeRow| TreeBlocks {
            first: t.first_block,
            coarse_end: t.first_block + t.class_blocks[COARSE],
            fine_end: t.first_block + t.class_blocks[COARSE] + leaves_at(t),
            end: t.first_block + t.block_count,
        };
        // Opening pays for the rows that there are, and a filter would collect them into more.
        let mut rows = Vec::with_capacity(own().count());
        rows.extend(own().map(blocks));
        Self { streams: Streams::of(header), trees: rows, key: RandomState::new() }
    }

    /// Returns the tree that a geometry block belongs to.
    fn tree_of(&self, id: u32) -> Option<&TreeBlocks> {
        self.trees.get(self.trees.partition_point(|t| t.end <= id)).filter(|t| t.first <= id)
    }

    fn geometry(&self, id: u32, payload: &[u8]) -> Result<Vec<u32>, String> {
        let tree = self.tree_of(id).ok_or("the block belongs to no tree")?;
        let holds = match id {
            _ if tree.is_one() => Holds::All,
            id if id < tree.coarse_end => Holds::Nodes,
            id if id < tree.fine_end => Holds::NodesOverLeaves,
            _ => Holds::Leaves,
        };
        // A fine block refers to no other geometry block.
        let end = if holds == Holds::NodesOverLeaves { id + 1 } else { tree.fine_end };
        codec::decode_geometry(payload, Place { id, end, holds })
    }
}

impl Decoder for BvhDecoder {
    fn decode(&self, id: BlockId, payload: &[u8], words: usize) -> Result<Vec<u32>, String> {
        match self.streams.kind(id) {
            // Geometry takes the memory of a block of the greatest size at most.
            Kind::Geometry => self.geometry(id.0, payload),
            kind => streams::decode(kind, payload, words),
        }
    }

    fn statements(&self, id: BlockId, words: &[u32]) -> Statements {
        if self.streams.kind(id) != Kind::Geometry {
            return Statements::default();
        }
        let block = Block::new(words);
        let mut references: Vec<Reference> =
            nodes_elsewhere(&block).map(|(to, node)| Reference::To(to, node)).collect();
        if let Some(tree) = self.tree_of(id.0).filter(|tree| !tree.is_one() && id.0 >= tree.coarse_end) {
            let is_leaf_block = id.0 >= tree.fine_end;
            let leaf_block = if is_leaf_block { id.0 } else { id.0 + tree.leaves_at() };
            let starts = if is_leaf_block { leaves_in_order(&block) } else { leaves_named(&block) };
            references.push(Reference::Agreed(BlockId(leaf_block), self.key.hash_one(starts)));
        }
        Statements { nodes: block.nodes() as u32, entries: entries(&block), references }
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

/// The nodes of other blocks that a block refers to.
fn nodes_elsewhere(block: &Block) -> impl Iterator<Item = (BlockId, u32)> {
    // The decoder has already refused references to anything but nodes.
    block.all_externals().filter_map(|(to, child)| match Child::from_bits(child) {
        Child::Node(node) => Some((BlockId(to), node as u32)),
        _ => None,
    })
}

const _: () = assert!(MAX_WORDS / NODE_WORDS <= MOST_NODES);

/// The nodes of a block that have no parent in it.
fn entries(block: &Block) -> Entries {
    let mut entries: Entries = std::array::from_fn(|word| {
        let count = block.nodes().saturating_sub(64 * word).min(64) as u32;
        u64::MAX.checked_shr(64 - count).unwrap_or(0)
    });
    for child in (0..block.nodes()).flat_map(|i| block.node(i).child) {
        // Empty slots hold 0, and node 0 has no parent in its block.
        let is_node = child >> KIND_SHIFT == 0 && child != 0;
        entries[usize::from(child) / 64 % (MOST_NODES / 64)] &= !(u64::from(is_node) << (child % 64));
    }
    entries
}

/// Returns the positions at which the leaves of a leaf block begin, according to its fine block; ascending.
fn leaves_named(block: &Block) -> Vec<u16> {
    // One bit for each word at which a leaf may begin gives the order without sorting. No block refers to a leaf twice.
    let mut begins = [0u64; MAX_WORDS / 64];
    let mut count = 0;
    for child in (0..block.nodes()).flat_map(|i| block.node(i).child) {
        // Empty slots hold 0, which is not a leaf.
        let (is_leaf, at) = (Child::is_leaf(child.into()), (u32::from(child) & INDEX_MASK) as usize);
        begins[at / 64] |= u64::from(is_leaf) << (at % 64);
        count += usize::from(is_leaf);
    }
    let mut starts = Vec::with_capacity(count);
    for (i, mut bits) in begins.into_iter().enumerate() {
        while bits != 0 {
            starts.push((64 * i) as u16 + bits.trailing_zeros() as u16);
            bits &= bits - 1;
        }
    }
    starts
}

/// Returns the parts of a geometry block of `tree`, in any order. A fine block lists the parts of its leaf block.
pub fn block_parts(tree: &TreeRow, id: BlockId, words: &[u32]) -> ListedParts {
    let (block, leaves_at) = (Block::new(words), leaves_at(tree));
    let is_leaf_block = id.0 >= tree.first_block + tree.class_blocks[COARSE] + leaves_at && leaves_at > 0;
    let of_triangles = (0..block.parts()).map(|i| block.part(i));
    let slots = (0..block.nodes()).flat_map(|i| (0..WIDTH).map(move |slot| (i, slot)));
    let filled = slots.filter(|&(i, slot)| block.node(i).valid >> slot & 1 == 1);
    let of_stand_ins = filled.map(|(i, slot)| block.voxel(i, slot).part().0);
    ListedParts {
        parts: of_triangles.chain(of_stand_ins).collect(),
        listed_by: if is_leaf_block { BlockId(id.0 - leaves_at) } else { id },
        below: nodes_elsewhere(&block).map(|(to, _)| to).collect(),
    }
}

/// Checks the references that no block can check by itself: references between blocks must point at existing nodes
/// without other parents, and fine blocks must have the positions of the leaves of their leaf blocks. Skips blocks that
/// are not in memory. Fails with the block and the fault.
pub fn check_links(snapshot: &Snapshot, trees: &[TreeRow]) -> Result<(), (BlockId, String)> {
    let ids = |tree: &TreeRow| (tree.first_block..tree.first_block + tree.block_count).map(BlockId);
    let mut entered = HashSet::new();
    for (tree, id) in trees.iter().flat_map(|tree| ids(tree).map(move |id| (tree, id))) {
        let Some(block) = snapshot.block(id).map(Block::new) else { continue };
        for (to, node) in nodes_elsewhere(&block) {
            let Some(target) = snapshot.block(to).map(Block::new) else { continue };
            let word = entries(&target).get(node as usize / 64).copied().unwrap_or(0);
            if word >> (node % 64) & 1 == 0 || !entered.insert((to, node)) {
                let why = format!("the block refers to a node of block {} that does not exist or has a parent", to.0);
                return Err((id, why));
            }
        }
        let coarse_end = tree.first_block + tree.class_blocks[COARSE];
        let leaves = BlockId(id.0 + leaves_at(tree));
        if !(coarse_end..coarse_end + leaves_at(tree)).contains(&id.0) {
            continue;
        }
        let Some(target) = snapshot.block(leaves).map(Block::new) else { continue };
        let named = leaves_named(&block);
        let triangles = |starts: &[u16]| starts.iter().map(|&at| target.leaf(at.into()).triangles).sum::<usize>();
        // A block in memory is padded with zeros to a whole cache line. The list of its leaves may therefore have more
        // entries than the fine block names; the count of triangles excludes further leaves.
        if !leaves_in_order(&target).starts_with(&named) || triangles(&named) != target.triangles() {
            return Err((id, format!("the leaves do not match those of block {}", leaves.0)));
        }
    }
    Ok(())
}
