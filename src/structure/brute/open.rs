//! Starts of the trees of an opened file.

use super::layout::INDEX;
use super::trace::TreeView;
use crate::residency::Snapshot;
use crate::simd::Isa;
use crate::store::{ModelFile, TreeRow};
use crate::structure::tree::Visit;

/// Root of a tree, and the offsets of its blocks with per-triangle numbers.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    /// The tree's first block; `None` for an empty tree.
    first_block: Option<u32>,
    /// Difference between the id of the block with primitive ids and the id of its block of triangles.
    prims_at: u32,
    /// The same difference for colours; `None` if the model has none.
    colours_at: Option<u32>,
    /// The same difference for normals; `None` if the model has none.
    normals_at: Option<u32>,
}

impl Start {
    /// Returns the start of a tree of `file`. Fails with the fault if its blocks do not form a tree of this structure.
    pub fn of(file: &ModelFile, row: &TreeRow) -> Result<Self, &'static str> {
        let is_empty = row.block_count == 0;
        if !(is_empty || row.root == INDEX) {
            return Err("the root of the tree does not exist");
        }
        let [_, lists, others @ ..] = row.class_blocks;
        if others != [0, 0] || !is_empty && lists == 0 {
            return Err("the tree has no list or has blocks that are neither index blocks nor lists");
        }
        let header = file.header();
        Ok(Self {
            first_block: (!is_empty).then_some(row.first_block),
            prims_at: header.geometry_blocks,
            colours_at: header.colours_at(),
            normals_at: header.normals_at(),
        })
    }

    /// The block of the root and the root's number in it; `None` for an empty tree.
    pub fn root(&self) -> Option<(u32, u32)> {
        self.first_block.map(|block| (block, INDEX))
    }

    /// The tree in a snapshot.
    pub fn view<'a>(&self, snapshot: &'a Snapshot, max_coord: f32, isa: Isa, visit: Visit<'a>) -> TreeView<'a> {
        let Self { first_block, prims_at, colours_at, normals_at } = *self;
        TreeView { snapshot, first_block, max_coord, prims_at, colours_at, normals_at, isa, visit }
    }
}
