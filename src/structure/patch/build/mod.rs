//! Builds the blocks of a tree from tiles of grids: `frame` finds the system of a tile and its quadtree, `nodes` makes
//! the tree over frames or blocks, `blocks` encodes.

mod blocks;
mod cell;
mod frame;
mod grid;
mod nodes;

pub use blocks::{Plan, Plans, Upper, encode};
pub use cell::Cell;
pub use frame::{BuiltFrame, Tile, build};
#[cfg(test)]
pub use grid::words_of;

/// Number of stack entries that a walk needs at most in a tree with `depth` levels of nodes.
pub fn max_stack(depth: u32) -> u32 {
    super::layout::WIDTH as u32 * depth
}
