//! Starts of the trees of an opened file.

use super::decoder::leaves_at;
use super::layout::{Child, MAX_NODES};
use super::trace::TreeView;
use crate::residency::Snapshot;
use crate::simd::Isa;
use crate::store::{ModelFile, TreeRow};
use crate::structure::tree::Visit;

/// Root of a tree, and the offsets between its blocks.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    first_block: u32,
    /// See [`TreeView::leaves_at`].
    leaves_at: u32,
    root: u32,
    /// See [`TreeView::prims_at`].
    prims_at: u32,
    /// See [`TreeView::colours_at`].
    colours_at: Option<u32>,
    /// See [`TreeView::normals_at`].
    normals_at: Option<u32>,
}

impl Start {
    /// Start of a tree without blocks.
    pub const NONE: Self =
        Self { first_block: 0, leaves_at: 0, root: TreeView::EMPTY, prims_at: 0, colours_at: None, normals_at: None };

    /// Returns the start of a tree of `file`. Fails with the fault if the root is not a node or the numbers of blocks
    /// contradict each other. The root's existence is checked when its block is read.
    pub fn of(file: &ModelFile, row: &TreeRow) -> Result<Self, &'static str> {
        let is_child = row.root <= u32::from(u16::MAX);
        let is_node = is_child && matches!(Child::from_bits(row.root), Child::Node(index) if index < MAX_NODES);
        let is_empty = row.block_count == 0;
        if !(is_node || is_empty) {
            return Err("the root of the tree does not exist");
        }
        let [coarse, fine, leaves, none] = row.class_blocks;
        let is_one = coarse == row.block_count && coarse <= 1;
        if fine != leaves || none > 0 || fine == 0 && !is_one {
            return Err("the numbers of fine and leaf blocks of the tree are inconsistent");
        }
        let header = file.header();
        Ok(Self {
            first_block: row.first_block,
            leaves_at: leaves_at(row),
            root: if is_empty { TreeView::EMPTY } else { row.root },
            prims_at: header.geometry_blocks,
            colours_at: header.colours_at(),
            normals_at: header.normals_at(),
        })
    }

    /// See [`TreeView::leaves_at`].
    pub fn leaves_at(&self) -> u32 {
        self.leaves_at
    }

    /// The block of the root and the root's number in it; `None` for an empty tree.
    pub fn root(&self) -> Option<(u32, u32)> {
        (self.root != TreeView::EMPTY).then_some((self.first_block, self.root))
    }

    /// The tree in a snapshot.
    #[inline]
    pub fn view<'a>(&self, snapshot: &'a Snapshot, max_coord: f32, isa: Isa, visit: Visit<'a>) -> TreeView<'a> {
        let Visit { accept_missing, ties_by_place, stamp, shown, proxies, stop } = visit;
        TreeView {
            snapshot,
            root_block: self.first_block,
            root: self.root,
            max_coord,
            leaves_at: self.leaves_at,
            prims_at: self.prims_at,
            colours_at: self.colours_at,
            normals_at: self.normals_at,
            isa,
            accept_missing,
            ties_by_place,
            stamp,
            shown,
            has_members: false,
            proxies,
            stop,
        }
    }
}
