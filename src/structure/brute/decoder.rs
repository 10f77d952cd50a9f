//! The decoder of this structure's blocks, for residency.

use super::layout::{Block, Range, Row, check, triangle};
use crate::base::ids::BlockId;
use crate::lod::Coded;
use crate::residency::{BlockClass, Decoder};
use crate::store::{Header, TreeRow};
use crate::structure::Structure;
use crate::structure::open::ListedParts;
use crate::structure::streams::{self, Kind, Streams};

/// Decodes the blocks of the trees of structure `brute`, and the streams of a model.
#[derive(Debug, Clone)]
pub struct BruteDecoder {
    streams: Streams,
    /// Block ranges of the trees of this structure, ascending.
    trees: Vec<Range>,
}

impl BruteDecoder {
    /// A decoder for the trees of this structure among those of a model with this header.
    pub fn new(header: &Header, trees: &[TreeRow]) -> Self {
        let range =
            |t: &TreeRow| Range { lists: t.first_block + t.class_blocks[0], end: t.first_block + t.block_count };
        let own = trees.iter().filter(|tree| tree.structure == Structure::Brute as u32);
        Self { streams: Streams::of(header), trees: own.map(range).collect() }
    }

    fn tree_of(&self, id: u32) -> Option<Range> {
        self.trees.get(self.trees.partition_point(|t| t.end <= id)).copied()
    }
}

impl Decoder for BruteDecoder {
    fn decode(&self, id: BlockId, payload: &[u8], words: usize) -> Result<Vec<u32>, String> {
        match self.streams.kind(id) {
            Kind::Geometry => {
                let tree = self.tree_of(id.0).ok_or("the block belongs to no tree")?;
                let (file, rest) = payload.as_chunks();
                if file.len() != words {
                    return Err("the size differs from the size in the directory".into());
                }
                let words: Vec<u32> = file.iter().map(|&word| u32::from_le_bytes(word)).collect();
                if !rest.is_empty() {
                    return Err("the size is not a multiple of 4 bytes".into());
                }
                check(&words, id.0, tree)?;
                Ok(words)
            }
            kind => streams::decode(kind, payload, words),
        }
    }

    fn class(&self, id: BlockId) -> BlockClass {
        let is_read_ahead = self.streams.is_read_ahead(id);
        let is_coarse = self.tree_of(id.0).is_some_and(|tree| id.0 < tree.lists);
        BlockClass { is_coarse, is_read_ahead, ..BlockClass::default() }
    }
}

/// Returns the parts of a geometry block, in any order.
pub fn block_parts(id: BlockId, words: &[u32]) -> ListedParts {
    let (parts, below) = match Block::new(words) {
        Block::Index(rows) => {
            let part = |row| Coded::part(Row(row).voxel()[2]).0;
            (rows.iter().map(part).collect(), rows.iter().map(|row| BlockId(Row(row).below().0)).collect())
        }
        Block::List(triangles) => (triangles.iter().map(|words| triangle(words).part).collect(), Vec::new()),
    };
    ListedParts { parts, listed_by: id, below }
}

/// The blocks with triangles: see [`crate::structure::bvh::holders`].
pub fn holders(tree: &TreeRow) -> (u32, u32, u32) {
    (tree.first_block + tree.class_blocks[0], tree.block_count - tree.class_blocks[0], 0)
}
