//! The looks of proxies: which proxy a stand-in shows, and what a ray sees of it.
//!
//! A proxy replaces the look of a cell's voxel only. The part, the boxes, the slabs, the share of rays that the cell
//! stops and the bounds of errors stay those of the voxel. So does the colour of cells of one part without colours of
//! its own: it is the part's.

use super::TreeView;
use super::hit::{StandIn, TriHit};
use super::stand_in::place_of;
use crate::base::ids::BlockId;
use crate::lod::{Look, Looks};
use crate::math::bits;
use crate::structure::bvh::layout::{Block, Child};
use crate::structure::cell::Cells;
use glam::DVec3;

impl<'a> TreeView<'a> {
    /// Replaces the samples of the cells that `rays` hit by those of their proxies, where they have one.
    pub(super) fn look_at_proxies<const N: usize>(
        &self,
        rays: u32,
        hit: impl Fn(usize) -> TriHit,
        dir: impl Fn(usize) -> DVec3,
        out: &mut Cells<N>,
    ) {
        for i in bits(rays) {
            let hit = hit(i);
            if let Some(looks) = hit.stand_in().and_then(|cell| self.looks(hit.block, cell)) {
                out.set_look(i, &Look::Proxy(looks), dir(i).as_vec3());
            }
        }
    }

    /// Returns the looks of the proxy that a cell of a block shows: that of the subtree in the cell, or of the last one
    /// on the way to it.
    fn looks(&self, id: u32, cell: StandIn) -> Option<&'a Looks> {
        let (node, slot) = place_of(cell);
        let block = Block::new(self.snapshot.block(BlockId(id))?);
        let (block, node) = match Child::from_bits(u32::from(block.node(node).child[slot])) {
            Child::Node(below) => (id, below),
            Child::External(at) => {
                let (block, child) = block.external(at);
                let Child::Node(below) = Child::from_bits(child) else { return None };
                (block, below)
            }
            _ => (id, node),
        };
        self.proxies?.of(block, node).map(|proxy| &proxy.looks)
    }
}
