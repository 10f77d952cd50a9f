//! Nodes by their places: see [`crate::structure::nodes`]. The item of a place is a child reference, to a node or a
//! leaf of the place's own block.

use super::layout::{Block, Child, MAX_WORDS, PAD_WORDS, WIDTH};
use crate::structure::hit::Triangle;
use crate::structure::nodes::{CHILDREN, NO_PART, Node, NodeBox, START_WORDS, Starts, sum, sum_above, sum_below};
use crate::structure::place::Place;

const _: () = assert!(WIDTH == CHILDREN && MAX_WORDS <= START_WORDS);

/// The first words of a block's leaves, in order. In memory zeros may follow the last one.
fn starts<'a>(block: &Block<'a>) -> impl Iterator<Item = usize> + use<'a> {
    let (block, mut at, mut left) = (*block, block.first_leaf(), block.triangles());
    std::iter::from_fn(move || {
        if left == 0 || at + PAD_WORDS >= block.words().len() {
            return None;
        }
        let (leaf, start) = (block.leaf(at), at);
        at += leaf.len();
        left = left.checked_sub(leaf.triangles.max(1))?;
        Some(start)
    })
}

/// Decodes the item of a place.
#[inline(always)]
fn decoded(item: u32) -> Option<Child> {
    if item > u32::from(u16::MAX) { None } else { Child::from_bits(item) }
}

/// See [`crate::structure::open::Nodes::node`].
#[inline]
pub fn node(
    words: &[u32],
    place: Place,
    (leaves_at, origin): (u32, &[f64; 3]),
    known: &mut Starts,
    out: &mut Node,
) -> bool {
    let block = Block::new(words);
    match decoded(place.item) {
        Some(Child::Node(index)) if index < block.nodes() => {
            inner(&block, place.block, index, (leaves_at, origin), out);
            true
        }
        Some(Child::Leaf(at)) if known.has(place.block, at, || starts(&block)) => {
            out.of_triangles(triangles_of(&block, at).map(|(_, triangle)| triangle), origin);
            true
        }
        _ => false,
    }
}

#[inline(always)]
fn inner(block: &Block, id: u32, index: usize, (leaves_at, origin): (u32, &[f64; 3]), out: &mut Node) {
    let node = block.node(index);
    out.begin(0);
    let steps: [f64; 3] = std::array::from_fn(|axis| node.step(axis).into());
    // The origin of the node's grid: rounded down for low planes, up for high planes.
    let grid: NodeBox = std::array::from_fn(|row| match row {
        0..3 => sum_below(origin[row], node.origin[row].into()),
        _ => sum_above(origin[row - 3], node.origin[row - 3].into()),
    });
    for slot in (0..WIDTH).filter(|slot| node.valid >> slot & 1 == 1) {
        let child = u32::from(node.child[slot]);
        let place = match Child::from_bits(child) {
            Some(Child::External(at)) => {
                let (block, item) = block.external(at);
                Place { block, item }
            }
            Some(Child::Leaf(_)) => Place { block: id + leaves_at, item: child },
            _ => Place { block: id, item: child },
        };
        let mut is_exact = true;
        let mut bounds: NodeBox = std::array::from_fn(|row| {
            let (plane, exact) = sum(grid[row], f64::from(node.planes[row][slot]) * steps[row % 3]);
            is_exact &= exact;
            plane
        });
        if !is_exact {
            let outer = |row: usize| {
                let offset = f64::from(node.planes[row][slot]) * steps[row % 3];
                if row < 3 { sum_below(grid[row], offset) } else { sum_above(grid[row], offset) }
            };
            bounds = std::array::from_fn(outer);
        }
        out.push(place, Child::is_leaf(child), &bounds);
    }
    out.part = part_below(block, index, out.children as usize);
    out.end();
}

/// The part of all voxels of a node's children, if it is one.
#[inline(always)]
fn part_below(block: &Block, index: usize, children: usize) -> u32 {
    if children == 0 {
        return NO_PART;
    }
    let (part, is_mixed) = block.voxel_of(index, 0).part();
    let same = |i: usize| block.voxel_of(index, i).part() == (part, false);
    if is_mixed || !(1..children).all(same) { NO_PART } else { part }
}

fn triangles_of<'a>(block: &Block<'a>, at: usize) -> impl Iterator<Item = (u32, Triangle)> + use<'a> {
    let (block, leaf) = (*block, block.leaf(at));
    (0..leaf.triangles).map(move |i| {
        let part = block.part(leaf.part_of(i));
        ((leaf.first + i) as u32, Triangle { vertices: leaf.triangle(i), part })
    })
}

/// See [`crate::structure::open::Nodes::triangles`].
pub fn triangles(words: &[u32], place: Place, known: &mut Starts, mut visit: impl FnMut(u32, Triangle)) -> bool {
    let block = Block::new(words);
    match decoded(place.item) {
        Some(Child::Leaf(at)) if known.has(place.block, at, || starts(&block)) => {
            triangles_of(&block, at).for_each(|(number, triangle)| visit(number, triangle));
            true
        }
        _ => false,
    }
}

/// The items of all nodes and leaves of a block.
pub fn items(words: &[u32]) -> Vec<u32> {
    let block = Block::new(words);
    let nodes = (0..block.nodes()).map(Child::Node);
    nodes.chain(starts(&block).map(Child::Leaf)).map(|child| child.to_bits().into()).collect()
}
