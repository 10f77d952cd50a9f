//! Hands residency the decoding of this structure's blocks.

use super::codec::{self, Place};
use super::layout::{Block, Child};
use crate::base::ids::BlockId;
use crate::residency::{Decoder, Snapshot};

/// Decodes blocks of a model of structure `bvh`.
#[derive(Debug, Clone)]
pub struct BvhDecoder {
    /// Number of geometry blocks: primitive ids follow them, then colours.
    pub geometry_blocks: u32,
    /// One past the last block of each tree, ascending.
    pub tree_ends: Vec<u32>,
}

impl Decoder for BvhDecoder {
    fn decode(&self, id: BlockId, payload: &[u8]) -> Result<Vec<u32>, String> {
        match id.0 / self.geometry_blocks.max(1) {
            0 => {
                let tree = self.tree_ends.partition_point(|&end| end <= id.0);
                let end = *self.tree_ends.get(tree).ok_or("it belongs to no tree")?;
                codec::decode_geometry(payload, Place { id: id.0, end })
            }
            1 => codec::decode_prims(payload),
            _ => codec::decode_colours(payload),
        }
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
