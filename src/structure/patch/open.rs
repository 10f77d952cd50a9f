//! Starts of the trees of an opened file.

use super::decoder::leaves_at;
use super::trace::TreeView;
use crate::residency::Snapshot;
use crate::simd::Isa;
use crate::store::{ModelFile, TreeRow};
use crate::structure::tree::Visit;

/// Root of a tree, and the offsets between its blocks.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    /// The tree's first block; `None` for an empty tree.
    first_block: Option<u32>,
    /// See [`TreeView::leaves_at`].
    leaves_at: u32,
    /// See [`TreeView::normals_at`].
    normals_at: Option<u32>,
}

impl Start {
    /// Returns the start of a tree of `file`. Fails with the fault if the numbers of blocks contradict each other.
    pub fn of(file: &ModelFile, row: &TreeRow) -> Result<Self, &'static str> {
        let is_empty = row.block_count == 0;
        if row.root != 0 {
            return Err("the root of the tree does not exist");
        }
        let [coarse, fine, leaves, none] = row.class_blocks;
        if fine != leaves || none > 0 || !is_empty && (coarse == 0 || fine == 0) {
            return Err("the numbers of fine and leaf blocks of the tree are inconsistent");
        }
        Ok(Self {
            first_block: (!is_empty).then_some(row.first_block),
            leaves_at: leaves_at(row),
            normals_at: file.header().normals_at(),
        })
    }

    /// See [`TreeView::leaves_at`].
    pub fn leaves_at(&self) -> u32 {
        self.leaves_at
    }

    /// The block of the root and the root's number in it; `None` for an empty tree.
    pub fn root(&self) -> Option<(u32, u32)> {
        self.first_block.map(|block| (block, 0))
    }

    /// The tree in a snapshot.
    pub fn view<'a>(&self, snapshot: &'a Snapshot, max_coord: f32, isa: Isa, visit: Visit<'a>) -> TreeView<'a> {
        let Self { first_block, leaves_at, normals_at } = *self;
        TreeView { snapshot, first_block, max_coord, leaves_at, colours_at: None, normals_at, isa, visit }
    }
}
