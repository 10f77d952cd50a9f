//! Trees of an opened file.

use super::layout::INDEX;
use super::trace::TreeView;
use crate::residency::Snapshot;
use crate::simd::Isa;
use crate::store::{ModelFile, TreeRow};
use crate::structure::tree::Visit;

/// Where a tree begins, and where what is beside its triangles is.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    /// `None` for a tree with nothing in it.
    first_block: Option<u32>,
    /// What to add to a block's id for the id of the block with its primitive ids.
    prims_at: u32,
    /// The same for its colours; `None` if the model has none.
    colours_at: Option<u32>,
}

impl Start {
    /// Of a tree of `file`. Fails with the fault where its blocks are not those of such a tree.
    pub fn of(file: &ModelFile, row: &TreeRow) -> Result<Self, &'static str> {
        let is_empty = row.block_count == 0;
        if !(is_empty || row.root == u64::from(INDEX)) {
            return Err("the root of its tree does not exist");
        }
        let [_, lists, others @ ..] = row.class_blocks;
        if others != [0, 0] || !is_empty && lists == 0 {
            return Err("its tree has other blocks than index blocks and lists");
        }
        let header = file.header();
        Ok(Self {
            first_block: (!is_empty).then_some(row.first_block),
            prims_at: header.geometry_blocks,
            colours_at: header.has_colours.then_some(2 * header.geometry_blocks),
        })
    }

    /// The block of the root and the number that it has in there; none for a tree with nothing in it.
    pub fn root(&self) -> Option<(u32, u32)> {
        self.first_block.map(|block| (block, INDEX))
    }

    /// The tree in a snapshot.
    pub fn view<'a>(&self, snapshot: &'a Snapshot, max_coord: f32, isa: Isa, visit: Visit) -> TreeView<'a> {
        let Self { first_block, prims_at, colours_at } = *self;
        TreeView { snapshot, first_block, max_coord, prims_at, colours_at, isa, visit }
    }
}
