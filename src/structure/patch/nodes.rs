//! Nodes by their places: see [`crate::structure::nodes`].

use super::layout::{Block, Child, Grids, tri_of};
use super::rows::{At, LEAF, at, box_items, each_child, each_triangle};
use crate::math::Bounds;
use crate::structure::hit::Triangle;
use crate::structure::nodes::{NO_PART, Node, outward};
use crate::structure::place::Place;

/// See [`crate::structure::open::Nodes::node`].
pub fn node(words: &[u32], place: Place, (leaves_at, origin): (u32, &[f64; 3]), out: &mut Node) -> bool {
    match at(words, place.item) {
        Some(At::Leaf(grid, number, leaf)) => {
            let (mut count, mut bounds) = (0, Bounds::EMPTY);
            each_triangle((&grid, number, leaf), |_, triangle| {
                count += 1;
                bounds = triangle.vertices.into_iter().fold(bounds, Bounds::with);
            });
            out.leaf(count, grid.part(), outward(origin, bounds.min, bounds.max));
            true
        }
        Some(here) => {
            out.begin(0);
            let mut part = None;
            each_child(&here, place.block, leaves_at, |place, bounds, is_leaf, below| {
                let one = below.one().unwrap_or(NO_PART);
                part = Some(if part.is_none_or(|part| part == one) { one } else { NO_PART });
                out.push(place, is_leaf, &outward(origin, bounds.min, bounds.max));
            });
            out.part = part.unwrap_or(NO_PART);
            out.end();
            true
        }
        None => false,
    }
}

/// See [`crate::structure::open::Nodes::triangles`]. The numbers are those of grids, whose primitive id all have.
pub fn triangles(words: &[u32], place: Place, mut visit: impl FnMut(u32, Triangle)) -> bool {
    let Some(At::Leaf(grid, number, leaf)) = at(words, place.item) else { return false };
    each_triangle((&grid, number, leaf), |_, triangle| visit(number as u32, triangle));
    true
}

/// The items of a block.
pub fn items(words: &[u32]) -> Vec<u32> {
    let block = Block(words);
    if block.nodes() > 0 {
        let nodes = (0..block.nodes() as u32).chain(block.all_frames().flat_map(|(at, frame)| box_items(&frame, at)));
        return nodes.collect();
    }
    let grids = Grids(words);
    let leaves = |number: usize| {
        let levels = grids.grid(number).map_or(0, |grid| grid.level.max(1) - 1);
        (0..1usize << (2 * levels)).map(move |leaf| LEAF | tri_of(number, leaf, 0))
    };
    (0..grids.count()).flat_map(leaves).collect()
}

/// The parts of a geometry block and the blocks below it.
pub fn parts_and_blocks(words: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let block = Block(words);
    if block.nodes() == 0 {
        let grids = Grids(words);
        return ((0..grids.count()).filter_map(|number| Some(grids.grid(number)?.part())).collect(), Vec::new());
    }
    let (mut parts, mut below) = (Vec::new(), Vec::new());
    parts.extend(block.all_frames().map(|(_, frame)| frame.part()));
    for node in (0..block.nodes()).filter_map(|index| block.node(index)) {
        for (slot, child) in node.children() {
            parts.extend(block.voxel(&node, slot).map(|voxel| crate::lod::Coded::part(voxel.0[3]).0));
            if let Child::Block(id) = child {
                below.push(id);
            }
        }
    }
    (parts, below)
}
