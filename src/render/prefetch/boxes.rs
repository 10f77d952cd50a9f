//! Search for missing blocks below the cells that overlap a box.

use super::Lacking;
use crate::base::ids::BlockId;
use crate::math::{Bounds, DBounds};
use crate::scene::SceneState;
use crate::scene::frame::{Scenes, Search};
use crate::scene::walk::SceneView;
use crate::structure::{Below, Place};
use std::collections::HashSet;

/// Traversal down to missing blocks. The next pass continues there.
pub(super) struct InBox {
    bounds: DBounds,
    /// Cells of at most this length (world units) are skipped, with the nodes below them.
    cell: f64,
    /// True once the search for placed trees has begun.
    is_begun: bool,
    /// The placed trees that are still to be visited.
    search: Search,
    /// Cells to visit in this pass.
    todo: Vec<Cell>,
    /// Visited cells with a missing block.
    waiting: Vec<Cell>,
    /// Leaf blocks that were requested, each with its model.
    leaf_blocks: HashSet<(u32, u32)>,
}

/// A cell of a placed tree.
#[derive(Clone, Copy)]
struct Cell {
    placed: u64,
    place: Place,
    /// Length in world units.
    length: f32,
    /// True if only triangles are below the cell.
    is_leaf: bool,
}

/// Number of cells visited per step.
const PIECE: usize = 4096;

impl InBox {
    pub fn new(bounds: DBounds, cell: f64) -> Self {
        let (search, todo, waiting, leaf_blocks) = (Search::default(), Vec::new(), Vec::new(), HashSet::new());
        Self { bounds, cell, is_begun: false, search, todo, waiting, leaf_blocks }
    }

    pub fn begin(&mut self, scene: &SceneState) {
        if self.is_begun {
            return self.todo.append(&mut self.waiting);
        }
        self.is_begun = true;
        self.search = Search::begin(scene, Scenes::All);
    }

    /// Queues the root of the next placed tree; false: there are no more.
    fn begin_next(&mut self, scene: &SceneState) -> bool {
        let Self { bounds, cell, search, todo, .. } = self;
        let is_near = |b: &DBounds| bounds.overlaps(b) && longest(b) > *cell;
        let Some(number) = search.next(scene, is_near) else { return false };
        let placed = scene.placed(number);
        if is_near(&placed.bounds) {
            let root = scene.models[placed.model as usize].trees()[placed.tree as usize].root();
            let length = longest(&placed.bounds) as f32;
            todo.extend(root.map(|place| Cell { placed: number, place, length, is_leaf: false }));
        }
        true
    }

    /// Visits up to [`PIECE`] cells and placed trees. Returns true if there is more to visit in this pass.
    pub fn step(&mut self, view: &SceneView, lacking: &mut Lacking) -> bool {
        for _ in 0..PIECE {
            let Some(cell) = self.todo.pop() else {
                if self.begin_next(view.scene) {
                    continue;
                }
                return false;
            };
            if !self.visit(view, cell) {
                lacking.add(view.need(cell.placed, BlockId(cell.place.block)), cell.length);
                self.waiting.push(cell);
            }
        }
        true
    }

    /// Visits a cell and queues the cells below it. Returns false if its block is missing.
    fn visit(&mut self, view: &SceneView, cell: Cell) -> bool {
        let Self { bounds, cell: least, todo, leaf_blocks, .. } = self;
        let tree = view.tree(cell.placed);
        if cell.is_leaf {
            return tree.snapshot().visit(BlockId(cell.place.block), view.stamp).is_some();
        }
        let placed = view.scene.placed(cell.placed);
        let mut child = |place: Place, local: &Bounds, is_leaf: bool| {
            let around = placed.world_bounds(local);
            let length = longest(&around);
            if length <= *least || !bounds.overlaps(&around) {
                return;
            }
            // No cells are below leaves. The first node above a missing leaf block requests the block, once.
            let is_here = is_leaf && tree.snapshot().block(BlockId(place.block)).is_some();
            if !is_leaf || !is_here && leaf_blocks.insert((placed.model, place.block)) {
                todo.push(Cell { place, length: length as f32, is_leaf, ..cell });
            }
        };
        tree.expand(cell.place, &mut Below { child: &mut child, triangle: &mut |_, _| {} }).is_ok()
    }
}

fn longest(b: &DBounds) -> f64 {
    b.extent().max_element()
}
