//! Children and triangles of places. The item of a place has its kind in the two highest bits: a node by its index, a
//! frame by its first word, a box of a frame's quadtree by both, or the triangles of a leaf of a quadtree, by grid and
//! leaf in the leaf block.

use super::codes::{child, children};
use super::layout::{Block, Child, Frame, Grid, Grids, bounds_of, grid_of, tree_words, tri_of};
use super::leaf::CORNERS;
use super::trace::{Cell, TreeView, planes_of};
use crate::base::ids::BlockId;
use crate::lod::{Coded, summary_bit};
use crate::math::Bounds;
use crate::structure::cursor::Below;
use crate::structure::hit::{TriHit, Triangle};
use crate::structure::place::Place;
use crate::structure::rows::{COLUMNS, PartsBelow, Rows};
use glam::{DVec3, Vec3};

/// Kind of a frame's place.
const FRAME: u32 = 1 << 30;
/// Kind of the place of a box of a quadtree.
const BOX: u32 = 2 << 30;
/// Kind of the place of a leaf.
pub(super) const LEAF: u32 = 3 << 30;

/// A place, decoded.
pub(super) enum At<'a> {
    /// A node of a block.
    Node(Block<'a>, usize),
    /// A box of a frame's quadtree, by level and number; the frame's first word.
    Box(Frame<'a>, usize, u32, usize),
    /// A leaf's triangles: the grid, its number, and the leaf's.
    Leaf(Grid<'a>, usize, usize),
}

/// The place of an item in the words of its block; `None` if there is none.
pub(super) fn at(words: &[u32], item: u32) -> Option<At<'_>> {
    let number = item & !LEAF;
    Some(match item & LEAF {
        0 => {
            let block = Block(words);
            ((number as usize) < block.nodes()).then_some(At::Node(block, number as usize))?
        }
        LEAF => {
            let (grid, leaf) = (grid_of(number), (number >> 3 & 0x3ff) as usize);
            let found = Grids(words).grid(grid)?;
            let leaves = 1usize << (2 * (found.level.max(1) - 1));
            (leaf < leaves).then_some(At::Leaf(found, grid, leaf))?
        }
        kind => {
            let (at, cell) = if kind == FRAME { (number as usize, Some((0, 0))) } else { of_box(number) };
            let block = Block(words);
            let is_frame = block.nodes() > 0 && block.all_frames().any(|frame| frame.0 == at);
            let (frame, (level, number)) = (block.frame(at).filter(|_| is_frame)?, cell?);
            (level < frame.levels().max(1)).then_some(At::Box(frame, at, level, number))?
        }
    })
}

/// The frame's first word, and level and number of the box.
fn of_box(item: u32) -> (usize, Option<(u32, usize)>) {
    match Cell::of_box(item) {
        Cell::Frame(at, level, number) => (at, Some((level, number))),
        Cell::Child(..) => (0, None),
    }
}

/// The place of a node of a quadtree, and whether it is a leaf; leaves are in the leaf block.
fn below(block: u32, leaves_at: u32, (frame, at): (&Frame, usize), level: u32, number: usize) -> (Place, bool) {
    if level == frame.levels() {
        let item = LEAF | tri_of(frame.grid(), number, 0);
        return (Place { block: block + leaves_at, item }, true);
    }
    let item = if level == 0 { FRAME | at as u32 } else { BOX | Cell::Frame(at, level, number).box_item() };
    (Place { block, item }, false)
}

/// Calls `visit` with the children of a place that is no leaf: place, box, true if only triangles are below, and the
/// parts below.
pub(super) fn each_child(
    here: &At,
    block: u32,
    leaves_at: u32,
    mut visit: impl FnMut(Place, &Bounds, bool, PartsBelow),
) {
    match here {
        At::Node(words, index) => {
            let Some(node) = words.node(*index) else { return };
            for (slot, to) in node.children() {
                let (place, is_leaf, parts) = match to {
                    Child::None => continue,
                    Child::Node(index) => (Place { block, item: index as u32 }, false, parts_of(words, &node, slot)),
                    Child::Block(id) => (Place { block: id, item: 0 }, false, parts_of(words, &node, slot)),
                    Child::Frame(at) => {
                        let Some(frame) = words.frame(at) else { continue };
                        let (place, is_leaf) = below(block, leaves_at, (&frame, at), 0, 0);
                        (place, is_leaf, one_part(frame.part()))
                    }
                };
                visit(place, &node.bounds(slot), is_leaf, parts);
            }
        }
        At::Box(frame, at, level, number) => {
            let planes = planes_of(frame, *level, *number);
            let Some(word) = frame.tree.get(tree_words(*level) + number) else { return };
            let (boxes, back) = (children(*word, &planes), frame.back());
            for i in 0..4 {
                let bounds = bounds_of(&child(&boxes, i), &back, frame.centre());
                let (place, is_leaf) = below(block, leaves_at, (frame, *at), level + 1, 4 * number + i);
                visit(place, &bounds, is_leaf, one_part(frame.part()));
            }
        }
        At::Leaf(..) => {}
    }
}

/// The items of the boxes of a frame's quadtree that are no leaves.
pub(super) fn box_items(frame: &Frame, at: usize) -> Vec<u32> {
    let number = |level: u32, number: usize| below(0, 0, (frame, at), level, number).0.item;
    (0..frame.levels()).flat_map(|level| (0..1usize << (2 * level)).map(move |n| number(level, n))).collect()
}

fn one_part(part: u32) -> PartsBelow {
    PartsBelow { part, bits: summary_bit(part) }
}

fn parts_of(block: &Block, node: &super::layout::Node, slot: usize) -> PartsBelow {
    let Some(voxel) = block.voxel(node, slot) else { return PartsBelow::UNKNOWN };
    let (part, is_mixed) = Coded::part(voxel.0[3]);
    PartsBelow { part: if is_mixed { PartsBelow::SEVERAL } else { part }, bits: voxel.0[4] }
}

/// False for triangles between points that coincide, at poles and at edges that are coarser than the grid.
fn has_area([a, b, c]: &[Vec3; 3]) -> bool {
    let [a, b, c] = [a, b, c].map(|p| p.as_dvec3());
    (b - a).cross(c - a) != DVec3::ZERO
}

/// The nine vertices of a leaf, rows along x; zeros if the grid has no such leaf.
fn vertices_of(grid: &Grid, leaf: usize) -> [Vec3; 9] {
    let (i, j) = super::layout::of_morton(leaf);
    if 2 * i.max(j) + 2 >= grid.side {
        return [Vec3::ZERO; 9];
    }
    std::array::from_fn(|at| grid.vertex(2 * i + at % 3, 2 * j + at / 3))
}

/// The corners of a triangle of a leaf with these vertices.
fn corners_of(vertices: &[Vec3; 9], which: usize) -> [Vec3; 3] {
    CORNERS.each_ref().map(|corners| vertices[usize::from(corners[which])])
}

/// Calls `visit` with the triangles of a leaf: their items and corners. Triangles without area are none.
pub(super) fn each_triangle((grid, number, leaf): (&Grid, usize, usize), mut visit: impl FnMut(u32, Triangle)) {
    let all = vertices_of(grid, leaf);
    for which in 0..COLUMNS {
        let vertices = corners_of(&all, which);
        if has_area(&vertices) {
            visit(tri_of(number, leaf, which as u32), Triangle { vertices, part: grid.part() });
        }
    }
}

impl TreeView<'_> {
    /// Visits the children or triangles below a place. Fails with the block of the place if that is not in memory.
    pub fn expand(&self, place: Place, out: &mut Below) -> Result<(), BlockId> {
        let words = self.visited(place.block).ok_or(BlockId(place.block))?;
        match at(words, place.item) {
            Some(At::Leaf(grid, number, leaf)) => each_triangle((&grid, number, leaf), |tri, triangle| {
                (out.triangle)(&TriHit { block: place.block, tri, ..TriHit::none(0.0) }, &triangle);
            }),
            Some(here) => each_child(&here, place.block, self.leaves_at, |place, bounds, is_leaf, _| {
                (out.child)(place, bounds, is_leaf);
            }),
            None => {}
        }
        Ok(())
    }

    /// See [`crate::structure::Tree::triangles_of`].
    pub fn triangles_of(&self, block: BlockId, visit: &mut dyn FnMut(&TriHit, &Triangle)) -> Result<(), BlockId> {
        let grids = Grids(self.visited(block.0).ok_or(block)?);
        for number in 0..grids.count() {
            let Some(grid) = grids.grid(number) else { continue };
            for leaf in 0..1usize << (2 * (grid.level.max(1) - 1)) {
                each_triangle((&grid, number, leaf), |tri, triangle| {
                    visit(&TriHit { block: block.0, tri, ..TriHit::none(0.0) }, &triangle);
                });
            }
        }
        Ok(())
    }

    /// See [`crate::structure::Tree::rows`].
    pub fn rows(&self, place: Place, rows: &mut Rows) -> Result<(), BlockId> {
        (rows.mask, rows.is_leaf, rows.leaves) = (0, false, 0);
        rows.below = [PartsBelow::UNKNOWN; COLUMNS];
        let words = self.visited(place.block).ok_or(BlockId(place.block))?;
        match at(words, place.item) {
            Some(At::Leaf(grid, number, leaf)) => {
                (rows.mask, rows.is_leaf) = (0xff, true);
                rows.first = TriHit { block: place.block, tri: tri_of(number, leaf, 0), ..TriHit::none(0.0) };
                rows.parts = [grid.part(); COLUMNS];
                fill(&grid, leaf, rows);
            }
            Some(here) => each_child(&here, place.block, self.leaves_at, |place, b, is_leaf, parts| {
                let at = rows.mask.trailing_ones() as usize % COLUMNS;
                (rows.places[at], rows.below[at]) = (place, parts);
                rows.leaves |= u32::from(is_leaf) << at;
                let ends = [b.min, b.max];
                (0..6).for_each(|row| rows.bounds[row][at] = ends[row / 3][row % 3]);
                rows.mask |= 1 << at;
            }),
            None => {}
        }
        Ok(())
    }
}

/// Fills in the nine vertices of a leaf, and the corners of its eight triangles. Those of a triangle without area are
/// those of another one: walks over rows meet only triangles with an area, each with a hit on its own grid.
fn fill(grid: &Grid, leaf: usize, rows: &mut Rows) {
    let all = vertices_of(grid, leaf);
    for (at, vertex) in all.iter().enumerate() {
        (0..3).for_each(|axis| rows.vertices[axis][at] = vertex[axis]);
    }
    let is_whole = |which: &usize| has_area(&corners_of(&all, *which));
    let Some(first) = (0..COLUMNS).find(is_whole) else {
        rows.mask = 0;
        return;
    };
    for which in 0..COLUMNS {
        let from = if is_whole(&which) { which } else { first };
        (0..3).for_each(|corner| rows.corners[corner][which] = CORNERS[corner][from]);
    }
}
