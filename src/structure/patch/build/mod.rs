//! Builds the blocks of a tree from tiles of grids: `frame` finds the system of a tile and its quadtree, `nodes` makes
//! the tree over frames or blocks, `pack` finds groups of neighbours, `plans` which frames share a block, `blocks`
//! encodes.

mod blocks;
mod cell;
mod frame;
mod grid;
mod nodes;
mod pack;
mod plans;

pub use blocks::{Upper, encode};
pub use cell::Cell;
pub use frame::{BuiltFrame, Tile, build};
#[cfg(test)]
pub use grid::words_of;
pub use pack::{Item, pack};
pub use plans::{AT_A_TIME, Plan, Plans, expected};

/// Number of stack entries that a walk needs at most in a tree with `depth` levels of nodes.
pub fn max_stack(depth: u32) -> u32 {
    super::layout::WIDTH as u32 * depth
}
