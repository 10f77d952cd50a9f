//! The nodes over items with boxes: halves by the surface area heuristic over the order along an axis, up to eight at a
//! time, down to single items.

use super::cell::Cell;
use crate::math::Bounds;
use crate::structure::patch::layout::{Child, HEAD_WORDS, NODE_WORDS, WIDTH};

/// Nodes of a block, parents first.
pub struct Nodes {
    nodes: Vec<Vec<Slot>>,
    /// The content of all.
    pub cell: Cell,
    /// Nodes on the longest path.
    pub depth: u32,
}

/// Most nodes over a number of items: each node has eight children, or two items or more and nothing else.
pub const fn most_nodes(items: usize) -> usize {
    items * 4 / 7 + 1
}

/// A child of a node.
struct Slot {
    to: To,
    cell: Cell,
}

/// What a child is.
#[derive(Clone, Copy)]
enum To {
    Node(usize),
    Item(usize),
}

impl Nodes {
    /// The nodes over some items, at least one.
    pub fn over(cells: &[Cell]) -> Self {
        let mut nodes = Vec::new();
        let (cell, depth) = add(&mut nodes, cells, &mut (0..cells.len()).collect::<Vec<_>>());
        Self { nodes, cell, depth }
    }

    /// Number of nodes.
    pub fn count(&self) -> usize {
        self.nodes.len()
    }

    /// Words of the nodes and of the voxels of children that are nodes.
    pub fn words_of_inner(&self) -> usize {
        let inner = self.nodes.iter().flatten().filter(|slot| matches!(slot.to, To::Node(_)));
        self.nodes.len() * NODE_WORDS + inner.map(|slot| slot.cell.words()).sum::<usize>()
    }

    /// Appends the nodes and then the voxels to the head of a block. `child` gives the reference of an item, and true
    /// if it has a voxel.
    pub fn put(&self, child: impl Fn(usize) -> (Child, bool), words: &mut Vec<u32>) {
        debug_assert_eq!(words.len(), HEAD_WORDS);
        let (mut voxels, voxels_at) = (Vec::new(), HEAD_WORDS + self.nodes.len() * NODE_WORDS);
        for slots in &self.nodes {
            let mut node = [0u32; NODE_WORDS];
            for slot in 0..WIDTH {
                let nothing = Bounds::EMPTY;
                let bounds = slots.get(slot).map_or(nothing, |it| it.cell.bounds);
                for axis in 0..3 {
                    node[WIDTH * axis + slot] = bounds.min[axis].to_bits();
                    node[WIDTH * (axis + 3) + slot] = bounds.max[axis].to_bits();
                }
            }
            for (slot, it) in slots.iter().enumerate() {
                let (reference, has_voxel) = match it.to {
                    To::Node(index) => (Child::Node(index), true),
                    To::Item(item) => child(item),
                };
                node[48 + slot] = reference.to_bits();
                if has_voxel {
                    node[56 + slot] = (voxels_at + voxels.len()) as u32;
                    it.cell.put(&mut voxels);
                }
            }
            words.extend(node);
        }
        words.extend(voxels);
    }
}

/// Adds the node over some items, and all nodes below it. Returns its content, and its nodes on the longest path.
fn add(nodes: &mut Vec<Vec<Slot>>, cells: &[Cell], items: &mut [usize]) -> (Cell, u32) {
    let index = nodes.len();
    nodes.push(Vec::new());
    let mut slots = Vec::with_capacity(WIDTH);
    let mut depth = 0;
    for range in eight(cells, items) {
        let some = &mut items[range];
        if let [item] = some {
            slots.push(Slot { to: To::Item(*item), cell: cells[*item].clone() });
            continue;
        }
        let to = To::Node(nodes.len());
        let (cell, below) = add(nodes, cells, some);
        depth = depth.max(below);
        slots.push(Slot { to, cell });
    }
    let cell = Cell::over(&slots.iter().map(|slot| &slot.cell).collect::<Vec<_>>());
    nodes[index] = slots;
    (cell, depth + 1)
}

/// Divides items into up to eight ranges, the one with the largest box first.
fn eight(cells: &[Cell], items: &mut [usize]) -> Vec<std::ops::Range<usize>> {
    let around = |items: &[usize]| items.iter().fold(Bounds::EMPTY, |all, item| all.union(cells[*item].bounds));
    let mut ranges = vec![(0..items.len(), around(items).half_area())];
    while ranges.len() < WIDTH {
        let open = (0..ranges.len()).filter(|at| ranges[*at].0.len() > 1);
        // The first of the largest.
        let Some(at) = open.reduce(|a, b| if ranges[b].1 > ranges[a].1 { b } else { a }) else { break };
        let (range, _) = ranges.remove(at);
        let middle = range.start + halve(cells, &mut items[range.clone()]);
        for (place, part) in [range.start..middle, middle..range.end].into_iter().enumerate() {
            let area = around(&items[part.clone()]).half_area();
            ranges.insert(at + place, (part, area));
        }
    }
    ranges.into_iter().map(|it| it.0).collect()
}

/// Sorts items so that the first part and the rest have the least areas times numbers, of all divisions along an axis.
/// Returns the number of the first part.
fn halve(cells: &[Cell], items: &mut [usize]) -> usize {
    let centre = |item: usize, axis: usize| {
        let b = &cells[item].bounds;
        b.min[axis] + b.max[axis]
    };
    let by_axis = |items: &mut [usize], axis: usize| {
        items.sort_unstable_by(|&a, &b| centre(a, axis).total_cmp(&centre(b, axis)).then(a.cmp(&b)));
    };
    let (mut best, mut found) = (f32::INFINITY, (0, items.len() / 2));
    let mut behind = vec![0.0; items.len()];
    for axis in 0..3 {
        by_axis(items, axis);
        let mut all = Bounds::EMPTY;
        for at in (1..items.len()).rev() {
            all = all.union(cells[items[at]].bounds);
            behind[at] = all.half_area() * (items.len() - at) as f32;
        }
        let mut all = Bounds::EMPTY;
        for at in 1..items.len() {
            all = all.union(cells[items[at - 1]].bounds);
            let cost = all.half_area() * at as f32 + behind[at];
            if cost < best {
                (best, found) = (cost, (axis, at));
            }
        }
    }
    by_axis(items, found.0);
    found.1
}
