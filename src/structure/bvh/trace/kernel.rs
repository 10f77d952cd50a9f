//! What the kernels are handed: the tree with its filter, the place in it, and for packets what the rays share. All of
//! them are copies of a few references, taken apart to registers once the kernels are inlined.

use super::TreeView;
use super::packet_prepare::Common;
use crate::structure::bvh::layout::{Block, Node};
use crate::structure::filter::PartFilter;

/// A tree as rays see it.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    pub view: &'a TreeView<'a>,
    pub filter: Option<&'a PartFilter<'a>>,
}

/// A tree as the rays of a packet see it.
#[derive(Clone, Copy)]
pub(super) struct Together<'a> {
    pub view: &'a TreeView<'a>,
    pub filter: Option<&'a PartFilter<'a>>,
    /// What the rays share.
    pub common: &'a Common,
    /// Memory is asked for ahead, see `ahead.rs`.
    pub is_large: bool,
}

/// A node that rays are at.
#[derive(Clone, Copy)]
pub(super) struct Here<'a> {
    pub block: Block<'a>,
    /// The block's id.
    pub id: u32,
    /// The node in the block.
    pub index: usize,
}

impl<'a> Here<'a> {
    #[inline(always)]
    pub fn node(&self) -> &'a Node {
        self.block.node(self.index)
    }
}
