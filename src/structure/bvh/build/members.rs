//! Builds a tree over boxes of members instead of triangles: binary splits by the surface area heuristic, up to eight
//! at a time, down to single members. Every member has a slot of a node. A block has a header, nodes and references to
//! other blocks as in `layout`, then the numbers of its members, one word each, and no voxels: cells of such a tree
//! never stand in.
//!
//! Nodes go to blocks in rounds, as in `cluster`: each round cuts off the largest subtrees of at most [`UNIT_WORDS`]
//! words, neighbours fill blocks, and what remains is the input of the next round.

use super::partition;
use super::quantise::quantise;
use super::refs::Ref;
use super::sah::{self, Extents};
use super::tree::DEEP;
use crate::base::error::{Error, Result};
use crate::base::memory::room;
use crate::math::Bounds;
use crate::structure::bvh::layout::{
    Child, EXTERNAL_WORDS, HEADER_WORDS, INDEX_MASK, LINE_WORDS, MAX_NODES, NODE_WORDS, Node, SHORT_VOXEL, WIDTH,
};
use crate::structure::par::Par;
use bytemuck::must_cast;

/// Greatest number of words of a subtree that is cut off.
const UNIT_WORDS: u32 = 2048;
/// Greatest number of words of a block: references in it have fourteen bits.
const BLOCK_WORDS: u32 = INDEX_MASK - HEADER_WORDS as u32;

/// A node that is not yet in a block.
#[derive(Clone, Copy)]
struct Wide {
    node: Node,
    /// Children in the order of the slots: inner nodes first.
    children: [Sub; WIDTH],
    /// Words of all that is below and not in a block yet, itself included.
    words: u32,
    /// Index of the node in its block.
    place: u32,
}

/// A child: its kind in the two highest bits, and a number.
#[derive(Clone, Copy)]
struct Sub(u32);

/// What a [`Sub`] refers to.
enum Kind {
    /// The index of an inner node.
    Node(u32),
    /// The number of a member.
    Member(u32),
    /// A node in a block: block and index there.
    Stored(u32, u32),
}

impl Sub {
    fn node(index: u32) -> Self {
        Self(index)
    }

    fn member(number: u32) -> Self {
        Self(1 << 31 | number)
    }

    fn stored(block: u32, index: u32) -> Self {
        Self(1 << 30 | (block * MAX_NODES as u32 + index))
    }

    fn kind(self) -> Kind {
        let number = self.0 & !(3 << 30);
        match self.0 >> 30 {
            0 => Kind::Node(number),
            1 => Kind::Stored(number / MAX_NODES as u32, number % MAX_NODES as u32),
            _ => Kind::Member(self.0 & !(1 << 31)),
        }
    }

    /// The index of an inner node that is in no block yet.
    fn inner(self) -> Option<u32> {
        if let Kind::Node(index) = self.kind() { Some(index) } else { None }
    }
}

/// Greatest number of nodes: the number of one has thirty bits.
const MOST_NODES: usize = 1 << 30;

/// Upper bound of the bytes for each member while a tree is built. A node has eight children, or two or more members
/// and no other child, so there are at most 4/7 nodes for each member.
pub const BYTES_EACH: usize = (size_of::<Wide>() + 4 * NODE_WORDS) * 4 / 7 + 8;

/// A range of boxes that becomes a node.
struct Task {
    first: usize,
    extents: Extents,
    len: usize,
    depth: u32,
    /// Node and slot that refer to it.
    parent: Option<(u32, usize)>,
}

/// Builds a tree over the members of `boxes`, at least two: their numbers, below 2^31, and their boxes, which are not
/// empty. The same input gives the same words, block by block; the root is node 0 of the last block. Fails with
/// `NoMemory`, and with `BadArgument` if there may be more than [`MOST_NODES`] nodes.
pub fn build(boxes: impl ExactSizeIterator<Item = (u32, Bounds)>) -> Result<Vec<Vec<u32>>> {
    let par = Par { threads: 1 };
    let most = boxes.len() * 4 / 7 + 1;
    if most > MOST_NODES {
        return Err(Error::bad_argument("there are too many placed trees for one tree over all"));
    }
    let mut refs: Vec<Ref> = room(boxes.len(), WHAT)?;
    refs.extend(boxes.map(|(number, b)| Ref::new(b, number)));
    let mut nodes: Vec<Wide> = room(most, WHAT)?;
    let extents = Extents::of(&refs, &par);
    let mut todo = vec![Task { first: 0, len: refs.len(), extents, depth: 1, parent: None }];
    while let Some(task) = todo.pop() {
        let index = nodes.len() as u32;
        if let Some((parent, slot)) = task.parent {
            nodes[parent as usize].children[slot] = Sub::node(index);
        }
        let mut ranges = split_up(&mut refs, &task, &par);
        // Inner nodes have the first slots. The sort keeps the order of space otherwise.
        ranges.sort_by_key(|r| r.1 == 1);
        let node = quantise(ranges.iter().map(|r| r.2.bounds()));
        let mut children = [Sub(0); WIDTH];
        for (slot, &(first, len, extents)) in ranges.iter().enumerate() {
            if len == 1 {
                children[slot] = Sub::member(refs[first].triangle() as u32);
            } else {
                todo.push(Task { first, len, extents, depth: task.depth + 1, parent: Some((index, slot)) });
            }
        }
        nodes.push(Wide { node, children, words: 0, place: 0 });
    }
    drop(refs);
    store(nodes)
}

/// What memory is for, in errors.
const WHAT: &str = "the tree over the placed trees of a scene";

/// Splits a range into up to eight, the one with the largest box first: first reference, number of references and
/// extents of each, in the order of space.
fn split_up(refs: &mut [Ref], task: &Task, par: &Par) -> Vec<(usize, usize, Extents)> {
    let mut ranges = Vec::with_capacity(WIDTH);
    ranges.push((task.first, task.len, task.extents));
    while ranges.len() < WIDTH {
        let area = |at: usize| ranges[at].2.bounds().half_area();
        let open = (0..ranges.len()).filter(|&at| ranges[at].1 > 1);
        // The first of the largest.
        let Some(at) = open.reduce(|a, b| if area(b) > area(a) { b } else { a }) else { break };
        let (first, len, extents) = ranges.swap_remove(at);
        let range = &mut refs[first..first + len];
        let split = if task.depth < DEEP { sah::find(range, &extents, par) } else { None };
        let sides = match &split {
            Some(split) => partition::by_split(range, split, par),
            None => partition::by_median(range, &extents, par),
        };
        ranges.push((first, sides.middle, sides.left));
        ranges.push((first + sides.middle, len - sides.middle, sides.right));
    }
    ranges.sort_by_key(|r| r.0);
    ranges
}

/// Puts all nodes into blocks.
fn store(mut nodes: Vec<Wide>) -> Result<Vec<Vec<u32>>> {
    let mut blocks = Vec::new();
    // Children come after their parents, so one pass from the end measures all.
    loop {
        for at in (0..nodes.len()).rev() {
            let below = each_child(&nodes[at]).map(|(_, sub)| match sub.kind() {
                Kind::Node(index) => nodes[index as usize].words,
                Kind::Member(_) => 1,
                Kind::Stored(..) => EXTERNAL_WORDS as u32,
            });
            nodes[at].words = NODE_WORDS as u32 + below.sum::<u32>();
        }
        if nodes[0].words <= BLOCK_WORDS {
            let mut block = Vec::new();
            put(&mut nodes, 0, &mut block);
            blocks.push(encode(&nodes, &block));
            return Ok(blocks);
        }
        cut_off(&mut nodes, &mut blocks);
        nodes = compact(nodes)?;
    }
}

fn each_child(wide: &Wide) -> impl Iterator<Item = (usize, Sub)> + '_ {
    let count = wide.node.valid.count_ones() as usize;
    wide.children.iter().copied().enumerate().take(count)
}

/// Puts the largest subtrees of at most [`UNIT_WORDS`] words into blocks, neighbours together.
fn cut_off(nodes: &mut [Wide], blocks: &mut Vec<Vec<u32>>) {
    let (mut block, mut words) = (Vec::new(), 0);
    let mut todo = vec![0u32];
    let mut roots: Vec<(u32, usize, u32)> = Vec::new();
    let mut flush = |nodes: &mut [Wide], block: &mut Vec<u32>, roots: &mut Vec<(u32, usize, u32)>| {
        let id = blocks.len() as u32;
        blocks.push(encode(nodes, block));
        for (parent, slot, index) in roots.drain(..) {
            nodes[parent as usize].children[slot] = Sub::stored(id, index);
        }
        block.clear();
    };
    while let Some(at) = todo.pop() {
        let inner: Vec<(usize, u32)> =
            each_child(&nodes[at as usize]).filter_map(|(slot, sub)| Some((slot, sub.inner()?))).collect();
        for &(slot, child) in &inner {
            let of_child = nodes[child as usize].words;
            if of_child > UNIT_WORDS {
                continue;
            }
            if words + of_child > BLOCK_WORDS {
                flush(nodes, &mut block, &mut roots);
                words = 0;
            }
            roots.push((at, slot, block.len() as u32));
            put(nodes, child, &mut block);
            words += of_child;
        }
        // The last is visited next.
        todo.extend(inner.iter().rev().map(|it| it.1).filter(|&child| nodes[child as usize].words > UNIT_WORDS));
    }
    if !block.is_empty() {
        flush(nodes, &mut block, &mut roots);
    }
}

/// Appends a node and all that is below it and in no block, parents first.
fn put(nodes: &mut [Wide], root: u32, block: &mut Vec<u32>) {
    let mut todo = vec![root];
    while let Some(at) = todo.pop() {
        nodes[at as usize].place = block.len() as u32;
        block.push(at);
        let below = each_child(&nodes[at as usize]);
        let inner = below.filter_map(|(_, sub)| sub.inner());
        let first = todo.len();
        todo.extend(inner);
        // The last is visited next.
        todo[first..].reverse();
    }
}

/// Drops the nodes that are in blocks.
fn compact(mut nodes: Vec<Wide>) -> Result<Vec<Wide>> {
    let mut order = Vec::new();
    put(&mut nodes, 0, &mut order);
    let mut left: Vec<Wide> = room(order.len(), WHAT)?;
    for &old in &order {
        let mut wide = nodes[old as usize];
        for child in &mut wide.children {
            if let Some(index) = child.inner() {
                *child = Sub::node(nodes[index as usize].place);
            }
        }
        left.push(wide);
    }
    Ok(left)
}

/// Encodes a block of nodes, given by their indices.
fn encode(nodes: &[Wide], block: &[u32]) -> Vec<u32> {
    let subs = || block.iter().flat_map(|&at| each_child(&nodes[at as usize]).map(|(_, sub)| sub));
    let externals = subs().filter(|sub| matches!(sub.kind(), Kind::Stored(..))).count();
    let externals_at = HEADER_WORDS + block.len() * NODE_WORDS;
    let members_at = externals_at + externals * EXTERNAL_WORDS;
    let (mut references, mut members) = (Vec::with_capacity(externals * EXTERNAL_WORDS), Vec::new());
    let mut words = vec![0; HEADER_WORDS];
    for (number, &at) in block.iter().enumerate() {
        let mut node = nodes[at as usize].node;
        for (slot, sub) in each_child(&nodes[at as usize]) {
            let child = match sub.kind() {
                Kind::Node(index) => Child::Node(nodes[index as usize].place as usize),
                Kind::Stored(to, index) => {
                    let child = u32::from(Child::Node(index as usize).to_bits());
                    references.extend([to, child, number as u32 | (slot as u32) << 16]);
                    Child::External(externals_at + references.len() - EXTERNAL_WORDS)
                }
                Kind::Member(member) => {
                    members.push(member);
                    Child::Member(members_at + members.len() - 1)
                }
            };
            node.child[slot] = child.to_bits();
        }
        words.extend(must_cast::<Node, [u32; NODE_WORDS]>(node));
    }
    words.extend(&references);
    words.extend(&members);
    let end = words.len() as u32;
    words[0] = block.len() as u32 | (externals as u32) << 16;
    (words[2], words[3], words[4], words[6]) = (externals_at as u32, members_at as u32, end, SHORT_VOXEL as u32);
    words.resize(words.len().next_multiple_of(LINE_WORDS), 0);
    words
}
