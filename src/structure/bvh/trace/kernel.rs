//! Arguments of the kernels: the tree with its filter, the node that rays are at, and the values that the rays of a
//! packet share. All are copies of a few references, which become registers once the kernels are inlined.

use super::TreeView;
use super::packet_prepare::Common;
use crate::structure::bvh::layout::{Block, Node};
use crate::structure::filter::PartFilter;

/// A tree and its filter, for single rays.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    pub view: &'a TreeView<'a>,
    pub filter: Option<&'a PartFilter<'a>>,
}

/// A tree and its filter, for the rays of a packet.
#[derive(Clone, Copy)]
pub(super) struct Together<'a> {
    pub view: &'a TreeView<'a>,
    pub filter: Option<&'a PartFilter<'a>>,
    /// Values that the rays share.
    pub common: &'a Common,
    /// True if memory is prefetched, see `ahead.rs`.
    pub is_large: bool,
}

/// The node that rays are at.
#[derive(Clone, Copy)]
pub(super) struct Here<'a> {
    pub block: Block<'a>,
    /// Id of the block.
    pub id: u32,
    /// Index of the node in the block.
    pub index: usize,
}

impl<'a> Here<'a> {
    #[inline(always)]
    pub fn node(&self) -> &'a Node {
        self.block.node(self.index)
    }
}
