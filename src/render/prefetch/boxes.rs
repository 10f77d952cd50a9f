//! Which blocks lie below the cells that meet a box.

use super::Lacking;
use crate::math::DBounds;
use crate::scene::SceneState;
use crate::scene::walk::SceneView;
use crate::structure::bvh::layout::{Block, Child, WIDTH};
use std::collections::HashSet;

/// The way down to what is missing; goes on from there in the next pass.
pub(super) struct InBox {
    bounds: DBounds,
    /// Nothing below cells of at most this length is looked for.
    cell: f64,
    /// Whether the roots were put to the places.
    is_begun: bool,
    /// To be visited in this pass.
    todo: Vec<Place>,
    /// Whose blocks are missing.
    waiting: Vec<Place>,
    /// Leaf blocks that were asked for, each with its placed tree.
    leaf_blocks: HashSet<(u32, u32)>,
}

/// A node in some block, and the length of its cell in the world.
#[derive(Clone, Copy)]
struct Place {
    placed: u32,
    block: u32,
    child: u32,
    length: f32,
}

/// Nodes visited at a time.
const PIECE: usize = 4096;

impl InBox {
    pub fn new(bounds: DBounds, cell: f64) -> Self {
        Self { bounds, cell, is_begun: false, todo: Vec::new(), waiting: Vec::new(), leaf_blocks: HashSet::new() }
    }

    pub fn begin(&mut self, scene: &SceneState) {
        if self.is_begun {
            return self.todo.append(&mut self.waiting);
        }
        self.is_begun = true;
        for (i, placed) in scene.placement.placed.iter().enumerate() {
            let length = longest(&placed.bounds);
            if self.bounds.overlaps(&placed.bounds) && length > self.cell {
                let (block, child) = scene.models[placed.model as usize].root(placed.tree);
                if child != crate::structure::bvh::trace::TreeView::EMPTY {
                    self.todo.push(Place { placed: i as u32, block, child, length: length as f32 });
                }
            }
        }
    }

    /// Whether there is more to visit in this pass.
    pub fn step(&mut self, view: &SceneView, lacking: &mut Lacking) -> bool {
        for _ in 0..PIECE {
            let Some(place) = self.todo.pop() else { return false };
            let id = crate::base::ids::BlockId(place.block);
            match view.tree(place.placed).snapshot.visit(id, view.stamp) {
                Some(words) => self.visit(view, Block::new(words), place),
                None => {
                    lacking.add(view.need(place.placed, id), place.length);
                    self.waiting.push(place);
                }
            }
        }
        true
    }

    fn visit(&mut self, view: &SceneView, block: Block, place: Place) {
        let Some(Child::Node(index)) = Child::from_bits(place.child) else { return };
        // Behind leaves is nothing: their block is asked for, once, by the first node over any of them.
        let leaf_block = place.block + view.tree(place.placed).leaves_at;
        let is_here = view.tree(place.placed).snapshot.block(crate::base::ids::BlockId(leaf_block)).is_some();
        let placed = &view.scene.placement.placed[place.placed as usize];
        let node = block.node(index);
        for slot in (0..WIDTH).filter(|slot| node.valid >> slot & 1 == 1) {
            let cell = placed.world_bounds(&node.child_box(slot));
            let length = longest(&cell);
            if length <= self.cell || !self.bounds.overlaps(&cell) {
                continue;
            }
            let child = u32::from(node.child[slot]);
            let (block, child) = match Child::from_bits(child) {
                Some(Child::Node(_)) => (place.block, child),
                Some(Child::External(at)) => block.external(at),
                Some(Child::Leaf(_)) if !is_here && self.leaf_blocks.insert((place.placed, leaf_block)) => (leaf_block, child),
                _ => continue,
            };
            self.todo.push(Place { block, child, length: length as f32, ..place });
        }
    }
}

fn longest(b: &DBounds) -> f64 {
    b.extent().max_element()
}
