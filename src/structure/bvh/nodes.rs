//! Nodes by their places: see [`crate::structure::nodes`]. The item of a place is a child reference, to a node or a
//! leaf of the place's own block.

use super::layout::{Block, Child, MAX_TRIANGLES, MAX_WORDS, PAD_WORDS, WIDTH};
use crate::structure::hit::Triangle;
use crate::structure::nodes::{
    CHILDREN, NO_PART, Node, NodeBox, START_WORDS, Starts, outward, sum_above, sum_below, sums_are_exact,
};
use crate::structure::place::Place;
use glam::Vec3;

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
    if item > u32::from(u16::MAX) { None } else { Some(Child::from_bits(item)) }
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
        Some(Child::Leaf(at)) if is_leaf(&block, place.block, at, known) => {
            leaf_at(&block, at, origin, out);
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
    let exact =
        |axis: usize| grid[axis] == grid[axis + 3] && sums_are_exact(grid[axis], i32::from(node.exponent[axis]) - 127);
    let boxes = if exact(0) && exact(1) && exact(2) {
        // In rows, so that the compiler uses vectors.
        std::array::from_fn(|row| {
            let (from, step) = (grid[row], steps[row % 3]);
            node.planes[row].map(|plane| from + f64::from(plane) * step)
        })
    } else {
        rounded_boxes(node, &grid, &steps)
    };
    for slot in (0..WIDTH).filter(|slot| node.valid >> slot & 1 == 1) {
        let child = u32::from(node.child[slot]);
        let place = match Child::from_bits(child) {
            Child::External(at) => {
                let (block, item) = block.external(at);
                Place { block, item }
            }
            Child::Leaf(_) => Place { block: id + leaves_at, item: child },
            _ => Place { block: id, item: child },
        };
        let bounds: NodeBox = std::array::from_fn(|row| boxes[row][slot]);
        out.push(place, Child::is_leaf(child), &bounds);
    }
    out.part = part_below(block, index, out.children as usize);
    out.end();
}

/// The planes of all boxes, rounded outward.
#[cold]
fn rounded_boxes(node: &super::layout::Node, grid: &NodeBox, steps: &[f64; 3]) -> [[f64; WIDTH]; 6] {
    std::array::from_fn(|row| {
        node.planes[row].map(|plane| {
            let offset = f64::from(plane) * steps[row % 3];
            if row < 3 { sum_below(grid[row], offset) } else { sum_above(grid[row], offset) }
        })
    })
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

/// True if a leaf begins at word `at` of a block.
#[inline(always)]
fn is_leaf(block: &Block, id: u32, at: usize, known: &mut Starts) -> bool {
    let next = |at: usize| {
        let is_inside = at + PAD_WORDS < block.words().len() && at >= block.first_leaf();
        let leaf = is_inside.then(|| block.leaf(at)).filter(|leaf| leaf.triangles > 0)?;
        Some(at + leaf.len())
    };
    known.has(id, at, || starts(block), next)
}

/// Makes a leaf of the one that begins at word `at`.
#[inline]
fn leaf_at(block: &Block, at: usize, origin: &[f64; 3], out: &mut Node) {
    let leaf = block.leaf(at);
    let first = leaf.part_of(0);
    let is_one = !leaf.is_mixed() || (1..leaf.triangles).all(|i| leaf.part_of(i) == first);
    let part = if is_one { block.part(first) } else { NO_PART };
    let mut bounds = [[f32::INFINITY, f32::NEG_INFINITY]; 3];
    for (axis, [low, high]) in bounds.iter_mut().enumerate() {
        for &x in &leaf.coordinates(axis).to_array()[..leaf.vertices] {
            (*low, *high) = (if x < *low { x } else { *low }, if x > *high { x } else { *high });
        }
    }
    let [min, max] = [0, 1].map(|end| Vec3::from(bounds.map(|axis| axis[end])));
    out.leaf(leaf.triangles as u32, part, outward(origin, min, max));
}

/// See [`crate::structure::open::Nodes::triangles`].
pub fn triangles(words: &[u32], place: Place, known: &mut Starts, mut visit: impl FnMut(u32, Triangle)) -> bool {
    let block = Block::new(words);
    match decoded(place.item) {
        Some(Child::Leaf(at)) if is_leaf(&block, place.block, at, known) => {
            let leaf = block.leaf(at);
            let axes = [0, 1, 2].map(|axis| leaf.coordinates(axis));
            let corners = [0, 1, 2].map(|corner| leaf.corners8(corner));
            for i in 0..leaf.triangles {
                let corner = |c: usize| {
                    let v = usize::from(corners[c][i & (MAX_TRIANGLES - 1)]);
                    Vec3::new(axes[0].get(v), axes[1].get(v), axes[2].get(v))
                };
                let vertices = [corner(0), corner(1), corner(2)];
                visit((leaf.first + i) as u32, Triangle { vertices, part: block.part(leaf.part_of(i)) });
            }
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
