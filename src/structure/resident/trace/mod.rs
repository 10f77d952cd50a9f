//! Exact rays through the resident form: rays in, hits out. A walk never waits, because all of the tree is in memory.

mod leaf;
mod packet;
mod single;
mod stream;

use super::layout::Resident;
use crate::structure::filter::PartFilter;
use crate::structure::hit::TriHit;
use crate::structure::packet::PacketWalk;
use crate::structure::stream::Stream;
use crate::structure::tree::Blocks;
use crate::structure::walk::Walk;

/// A tree in both forms. The blocks name the primitive ids that decide between hits at equal distance.
#[derive(Debug, Clone, Copy)]
pub struct Both<'a> {
    /// The resident form.
    pub form: &'a Resident,
    /// The blocks.
    pub blocks: &'a Blocks<'a>,
}

impl Both<'_> {
    /// Finds the closest hit of an exact ray that has just begun, or any hit. Returns false if the ray has no result: a
    /// block that decides a tie is missing, or the tree is too deep. The walk is then as it was.
    pub fn single<const ANY: bool>(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> bool {
        single::run::<ANY>(*self, filter, walk)
    }

    /// Finds the closest or any hits of the rays of a packet, which are exact and have just begun. Returns the rays
    /// without a result, for the reasons of [`Both::single`].
    pub fn packet<const ANY: bool>(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> u32 {
        packet::run::<ANY>(*self, filter, walk)
    }

    /// Finds the closest or any hits of the first rays of `stream`, which are exact. Rays in [`Stream::unfinished`]
    /// have no result, for the reasons of [`Both::single`].
    pub fn stream<const ANY: bool>(&self, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) {
        stream::run::<ANY>(*self, filter, stream, hits);
    }

    /// True if `hit` is better than `best`: nearer, or as near with a lower primitive id. `None` if the id is missing.
    #[inline(always)]
    fn is_better(&self, hit: &TriHit, best: &TriHit) -> Option<bool> {
        if hit.t < best.t || !best.is_hit() {
            return Some(true);
        }
        if (hit.block, hit.tri) == (best.block, best.tri) {
            return Some(false);
        }
        self.tie(hit, best)
    }

    #[cold]
    #[inline(never)]
    fn tie(&self, hit: &TriHit, best: &TriHit) -> Option<bool> {
        self.blocks.precedes(hit, best).ok()
    }
}
