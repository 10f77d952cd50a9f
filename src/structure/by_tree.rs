//! The decoder of a file whose trees have several structures.

use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::base::memory::room;
use crate::residency::{BlockClass, Decoder, Statements};
use crate::store::{Header, TreeRow};

/// Passes each block on to the decoder of its tree's structure.
pub struct ByTree {
    geometry_blocks: u32,
    /// The trees, ascending.
    trees: Vec<Tree>,
    /// Decoders, each behind the number of its structure.
    decoders: Vec<(u32, Box<dyn Decoder>)>,
}

#[derive(Debug, Clone, Copy)]
struct Tree {
    /// One past the last geometry block.
    end: u32,
    structure: u32,
}

impl ByTree {
    /// Bytes of memory for each tree, those of `decoders` not included.
    pub const BYTES_A_TREE: usize = size_of::<Tree>();

    /// A decoder for a model with this header and these trees. `decoders`: one for each structure of the trees, behind
    /// the structure's number.
    pub fn new(header: &Header, trees: &[TreeRow], decoders: Vec<(u32, Box<dyn Decoder>)>) -> Result<Self> {
        let mut ends = room(trees.len(), "the trees of a model")?;
        ends.extend(trees.iter().map(|t| Tree { end: t.first_block + t.block_count, structure: t.structure }));
        Ok(Self { geometry_blocks: header.geometry_blocks, trees: ends, decoders })
    }

    /// The decoder of a block. That of a block of a stream is the decoder of its geometry block.
    fn of(&self, id: BlockId) -> Option<&dyn Decoder> {
        let geometry = id.0 % self.geometry_blocks.max(1);
        let tree = self.trees.get(self.trees.partition_point(|tree| tree.end <= geometry))?;
        let own = self.decoders.iter().find(|(structure, _)| *structure == tree.structure);
        own.map(|(_, decoder)| &**decoder)
    }
}

impl Decoder for ByTree {
    fn decode(&self, id: BlockId, payload: &[u8], words: usize) -> std::result::Result<Vec<u32>, String> {
        self.of(id).ok_or("the block belongs to no tree")?.decode(id, payload, words)
    }

    fn statements(&self, id: BlockId, words: &[u32]) -> Statements {
        self.of(id).map(|own| own.statements(id, words)).unwrap_or_default()
    }

    fn class(&self, id: BlockId) -> BlockClass {
        self.of(id).map(|own| own.class(id)).unwrap_or_default()
    }
}
