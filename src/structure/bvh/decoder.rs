//! Hands residency the decoding of this structure's blocks.

use super::codec::{self, Place};
use super::layout::{Block, Child};
use crate::base::ids::BlockId;
use crate::residency::{Decoder, Snapshot};
use crate::store::TreeRow;

/// Decodes blocks of a model of structure `bvh`.
#[derive(Debug, Clone)]
pub struct BvhDecoder {
    /// Primitive ids follow the geometry blocks, then colours.
    geometry_blocks: u32,
    /// Of each tree, ascending.
    trees: Vec<TreeBlocks>,
}

/// Where the blocks of a tree end.
#[derive(Debug, Clone, Copy)]
struct TreeBlocks {
    /// One past its last coarse block.
    coarse_end: u32,
    /// One past its last block.
    end: u32,
    /// Its one block holds all of it.
    is_one: bool,
}

impl BvhDecoder {
    /// For a model of `geometry_blocks` geometry blocks, which `trees` divide among them.
    pub fn new(geometry_blocks: u32, trees: &[TreeRow]) -> Self {
        let blocks = |t: &TreeRow| TreeBlocks {
            coarse_end: t.first_block + t.coarse_blocks,
            end: t.first_block + t.block_count,
            is_one: t.block_count == 1,
        };
        Self { geometry_blocks, trees: trees.iter().map(blocks).collect() }
    }

    fn geometry(&self, id: u32, payload: &[u8]) -> Result<Vec<u32>, String> {
        let tree = self.trees.partition_point(|t| t.end <= id);
        let tree = self.trees.get(tree).ok_or("it belongs to no tree")?;
        let is_fine = id >= tree.coarse_end;
        // Behind a fine block is nothing that it could refer to.
        let end = if is_fine { id + 1 } else { tree.end };
        let words = codec::decode_geometry(payload, Place { id, end })?;
        if !is_fine && !tree.is_one && Block::new(&words).triangles() > 0 {
            return Err("it holds triangles, and is coarse".into());
        }
        Ok(words)
    }
}

impl Decoder for BvhDecoder {
    fn decode(&self, id: BlockId, payload: &[u8]) -> Result<Vec<u32>, String> {
        match id.0 / self.geometry_blocks.max(1) {
            0 => self.geometry(id.0, payload),
            1 => codec::decode_prims(payload),
            _ => codec::decode_colours(payload),
        }
    }

    fn links(&self, id: BlockId, words: &[u32], refer: &mut dyn FnMut(BlockId, u32)) -> u32 {
        if id.0 >= self.geometry_blocks {
            return 0;
        }
        let block = Block::new(words);
        for (to, child) in (0..block.externals()).map(|i| block.external(i)) {
            // What is no node was refused when the block was decoded.
            if let Some(Child::Node(node)) = Child::from_bits(child) {
                refer(BlockId(to), node as u32);
            }
        }
        block.nodes() as u32
    }

    fn is_coarse(&self, id: BlockId) -> bool {
        let tree = self.trees.partition_point(|t| t.end <= id.0);
        self.trees.get(tree).is_some_and(|tree| id.0 < tree.coarse_end)
    }

    fn is_promoted(&self, id: BlockId) -> bool {
        // Primitive ids are read only when asked for.
        id.0 / self.geometry_blocks.max(1) != 1
    }
}

/// Checks what no block can check alone: that references between blocks hit nodes that exist.
/// Blocks that are not in memory are passed over. Fails with the block and what is wrong.
pub fn check_links(snapshot: &Snapshot, geometry_blocks: u32) -> Result<(), (BlockId, String)> {
    for id in (0..geometry_blocks).map(BlockId) {
        let Some(block) = snapshot.block(id).map(Block::new) else { continue };
        for (to, child) in (0..block.externals()).map(|i| block.external(i)) {
            let Some(target) = snapshot.block(BlockId(to)).map(Block::new) else { continue };
            let exists = matches!(Child::from_bits(child), Some(Child::Node(n)) if n < target.nodes());
            if !exists {
                return Err((id, format!("it refers to a node that block {to} does not have")));
            }
        }
    }
    Ok(())
}
