//! Memory asked for ahead: of leaves that walks of a stream wait at in any model, of all else in models that are larger
//! than what caches hold.

use super::TreeView;
use crate::base::ids::BlockId;
use crate::residency::Snapshot;
use crate::simd::prefetch;
use crate::structure::bvh::layout::{Block, Child, HEADER_WORDS, INDEX_MASK, KIND_SHIFT, NODE_WORDS};

/// Blocks, those with primitive ids among them, of a model for which all memory is asked for ahead: 32 MB of geometry.
/// (Measured before leaves had blocks of their own. Streams, bounce rays: 1.15 to 1.5 times as fast at 10 million
/// triangles; 1.0 at a million, 0.93 at 70 thousand.)
const LARGE: u32 = 1024;

/// The kind of references to nodes, see [`crate::structure::bvh::layout::Child`].
const NODE: u32 = 0;
/// That of references to other blocks.
const EXTERNAL: u32 = 2;

/// Whether asking ahead pays.
#[inline(always)]
pub(super) fn is_large(snapshot: &Snapshot) -> bool {
    snapshot.blocks() > LARGE
}

/// [`ask`], in a large tree.
#[inline(always)]
pub(super) fn ask_for(is_large: bool, block: Block, child: u32) {
    if is_large {
        ask(block, child);
    }
}

/// Asks for the memory of what will be visited, in its block; other work then hides how long it takes.
#[inline(always)]
pub(super) fn ask(block: Block, child: u32) {
    let index = (child & INDEX_MASK) as usize;
    let at = if child >> KIND_SHIFT == NODE { HEADER_WORDS + index * NODE_WORDS } else { index };
    if let Some(words) = block.words().get(at..at + 32) {
        prefetch(&words[0]);
        prefetch(&words[16]);
        prefetch(&words[31]);
    }
}

/// Follows a reference of `block`, number `id`, to another block that is in memory, or to leaves wherever they are, and
/// asks for the memory of what will be visited: several such waits then go on at once. Of others says where they are.
/// Last is whether what is visited is there, if it is a leaf.
#[inline(always)]
pub(super) fn follow(is_large: bool, view: &TreeView, block: Block, id: u32, child: u32) -> (u32, u32, bool) {
    if Child::is_leaf(child) {
        let leaves = view.home_of(id, child);
        let words = view.snapshot.block(BlockId(leaves));
        if let Some(words) = words {
            ask_for(is_large, Block::new(words), child);
        }
        return (leaves, child, words.is_some());
    }
    if child >> KIND_SHIFT != EXTERNAL {
        ask_for(is_large, block, child);
        return (id, child, true);
    }
    let (next, below) = block.external((child & INDEX_MASK) as usize);
    match view.snapshot.block(BlockId(next)) {
        Some(words) => {
            ask_for(is_large, Block::new(words), below);
            (next, below, true)
        }
        None => (id, child, true),
    }
}
