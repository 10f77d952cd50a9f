//! Builds a tree over boxes of members instead of triangles: binary splits by the surface area heuristic, up to eight
//! at a time, down to single members. Every member has a slot of a node. A block has a header, nodes and references to
//! other blocks as in `layout`, then the numbers of its members, one word each. If members are described
//! (`member_cells.rs`), the lists of voxels and of their sides follow, as in `layout`; only inner children have voxels.
//! Otherwise no cell ever stands in.
//!
//! Nodes go to blocks in rounds, as in `cluster`: each round cuts off the largest subtrees of at most [`UNIT_WORDS`]
//! words, neighbours fill blocks, and what remains is the input of the next round.

use super::member_cells::{self, MemberCells};
use super::partition;
use super::quantise::quantise;
use super::refs::Ref;
use super::sah::{self, Extents};
use super::tree::DEEP;
use crate::base::error::{Error, Result};
use crate::base::memory::room;
use crate::lod::{Coded, SIDES_WORDS, stopped};
use crate::math::Bounds;
use crate::structure::bvh::appearance::{Appearance, MemberLook};
use crate::structure::bvh::layout::{
    Child, EXTERNAL_WORDS, HEADER_WORDS, INDEX_MASK, LINE_WORDS, LONG_VOXEL, MAX_NODES, NODE_WORDS, Node, SHORT_VOXEL,
    Transmitting, WIDTH, mark_transmitting,
};
use crate::structure::par::Par;
use bytemuck::must_cast;

/// Greatest number of words of a subtree that is cut off.
const UNIT_WORDS: u32 = 2048;
/// Greatest number of words of a block: references in it have fourteen bits.
const BLOCK_WORDS: u32 = INDEX_MASK - HEADER_WORDS as u32;

/// A node that is not yet in a block.
#[derive(Clone, Copy)]
pub(super) struct Wide {
    pub(super) node: Node,
    /// Children in the order of the slots: inner nodes first.
    pub(super) children: [Sub; WIDTH],
    /// Words of all that is below and not in a block yet, itself included.
    words: u32,
    /// Index of the node in its block.
    place: u32,
    /// Index of the voxel of the first inner child, or [`Wide::NO_VOXELS`].
    pub(super) voxels: u32,
}

impl Wide {
    /// The children have no voxels.
    pub(super) const NO_VOXELS: u32 = u32::MAX;
}

/// A child: its kind in the two highest bits, and a number.
#[derive(Clone, Copy)]
pub(super) struct Sub(u32);

/// What a [`Sub`] refers to.
pub(super) enum Kind {
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

    pub(super) fn kind(self) -> Kind {
        let number = self.0 & !(3 << 30);
        match self.0 >> 30 {
            0 => Kind::Node(number),
            1 => Kind::Stored(number / MAX_NODES as u32, number % MAX_NODES as u32),
            _ => Kind::Member(self.0 & !(1 << 31)),
        }
    }

    /// The index of an inner node that is in no block yet.
    pub(super) fn inner(self) -> Option<u32> {
        if let Kind::Node(index) = self.kind() { Some(index) } else { None }
    }
}

/// Greatest number of nodes: the number of one has thirty bits.
const MOST_NODES: usize = 1 << 30;

/// Upper bound of the bytes for each member while a tree is built. A node has eight children, or two or more members
/// and no other child, so there are at most 4/7 nodes for each member.
pub const BYTES_EACH: usize = (size_of::<Wide>() + 4 * NODE_WORDS) * 4 / 7 + 8;

/// The same if members are described. A node has at most one voxel, that of its cell, here and in its block.
pub const BYTES_EACH_DESCRIBED: usize =
    BYTES_EACH + (2 * 4 * (LONG_VOXEL + SIDES_WORDS) + 4) * 4 / 7 + size_of::<Ref>();

/// A range of boxes that becomes a node.
struct Task {
    first: usize,
    extents: Extents,
    len: usize,
    depth: u32,
    /// Node and slot that refer to it.
    parent: Option<(u32, usize)>,
}

/// Describes members by their numbers.
pub type LookOf<'f, 'a> = &'f mut dyn FnMut(u32) -> Option<MemberLook<'a>>;

/// Builds a tree over the members of `boxes`, at least two: their numbers, below 2^31, and their boxes, which are not
/// empty. The same input gives the same words, block by block; the root is node 0 of the last block. Fails with
/// `NoMemory`, and with `BadArgument` if there may be more than [`MOST_NODES`] nodes.
pub fn build(
    boxes: impl ExactSizeIterator<Item = (u32, Bounds)>,
    look_of: Option<LookOf>,
) -> Result<(Vec<Vec<u32>>, Option<Appearance>)> {
    let par = Par { threads: 1 };
    let most = boxes.len() * 4 / 7 + 1;
    if most > MOST_NODES {
        return Err(Error::bad_argument("there are too many placed trees for one tree over all"));
    }
    let mut refs: Vec<Ref> = room(boxes.len(), WHAT)?;
    refs.extend(boxes.map(|(number, b)| Ref::new(b, number)));
    let mut nodes = split_all(&mut refs, most, &par)?;
    let cells = match look_of {
        Some(look_of) => member_cells::add(&mut nodes, &refs, look_of)?,
        None => MemberCells::default(),
    };
    for child in nodes.iter_mut().flat_map(|wide| &mut wide.children) {
        if let Kind::Member(at) = child.kind() {
            *child = Sub::member(refs[at as usize].triangle() as u32);
        }
    }
    drop(refs);
    Ok((store(nodes, &cells)?, cells.appearance))
}

/// Returns the nodes over all references: each before those below it, the last child with all below it first. Members
/// are given as indices of references.
fn split_all(refs: &mut [Ref], most: usize, par: &Par) -> Result<Vec<Wide>> {
    let mut nodes: Vec<Wide> = room(most, WHAT)?;
    let extents = Extents::of(refs, par);
    let mut todo = vec![Task { first: 0, len: refs.len(), extents, depth: 1, parent: None }];
    while let Some(task) = todo.pop() {
        let index = nodes.len() as u32;
        if let Some((parent, slot)) = task.parent {
            nodes[parent as usize].children[slot] = Sub::node(index);
        }
        let mut ranges = split_up(refs, &task, par);
        // Inner nodes have the first slots. The sort keeps the order of space otherwise.
        ranges.sort_by_key(|r| r.1 == 1);
        let mut node = quantise(ranges.iter().map(|r| r.2.bounds()));
        (0..WIDTH).for_each(|slot| node.keep_from_standing_in(slot));
        let mut children = [Sub(0); WIDTH];
        for (slot, &(first, len, extents)) in ranges.iter().enumerate() {
            if len == 1 {
                children[slot] = Sub::member(first as u32);
            } else {
                todo.push(Task { first, len, extents, depth: task.depth + 1, parent: Some((index, slot)) });
            }
        }
        nodes.push(Wide { node, children, words: 0, place: 0, voxels: Wide::NO_VOXELS });
    }
    Ok(nodes)
}

/// What memory is for, in errors.
pub(super) const WHAT: &str = "the tree over the placed trees of a scene";

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
fn store(mut nodes: Vec<Wide>, cells: &MemberCells) -> Result<Vec<Vec<u32>>> {
    let mut blocks = Vec::new();
    // Children come after their parents, so one pass from the end measures all.
    loop {
        for at in (0..nodes.len()).rev() {
            let below = each_child(&nodes[at]).map(|(_, sub)| match sub.kind() {
                Kind::Node(index) => nodes[index as usize].words,
                Kind::Member(_) => 1,
                Kind::Stored(..) => EXTERNAL_WORDS as u32,
            });
            nodes[at].words = NODE_WORDS as u32 + below.sum::<u32>() + voxel_words(&nodes[at], cells);
        }
        if nodes[0].words <= BLOCK_WORDS {
            let mut block = Vec::new();
            put(&mut nodes, 0, &mut block);
            blocks.push(encode(&nodes, &block, cells));
            return Ok(blocks);
        }
        cut_off(&mut nodes, &mut blocks, cells);
        nodes = compact(nodes)?;
    }
}

pub(super) fn each_child(wide: &Wide) -> impl Iterator<Item = (usize, Sub)> + '_ {
    let count = wide.node.valid.count_ones() as usize;
    wide.children.iter().copied().enumerate().take(count)
}

/// The voxels of a node's inner children; none if it has no voxels.
fn voxels_of<'a>(wide: &Wide, cells: &'a MemberCells) -> &'a [[u32; LONG_VOXEL]] {
    let inner = each_child(wide).filter(|(_, sub)| !matches!(sub.kind(), Kind::Member(_))).count();
    let first = wide.voxels as usize;
    if wide.voxels == Wide::NO_VOXELS { &[] } else { &cells.voxels[first..first + inner] }
}

/// Words of the voxels of a node's children in its block, with their sides and the number of the first.
fn voxel_words(wide: &Wide, cells: &MemberCells) -> u32 {
    if cells.voxels.is_empty() {
        return 0;
    }
    let words = |voxel: &[u32; LONG_VOXEL]| LONG_VOXEL + if Coded::has_sides(voxel[0]) { SIDES_WORDS } else { 0 };
    1 + voxels_of(wide, cells).iter().map(words).sum::<usize>() as u32
}

/// Puts the largest subtrees of at most [`UNIT_WORDS`] words into blocks, neighbours together.
fn cut_off(nodes: &mut [Wide], blocks: &mut Vec<Vec<u32>>, cells: &MemberCells) {
    let (mut block, mut words) = (Vec::new(), 0);
    let mut todo = vec![0u32];
    let mut roots: Vec<(u32, usize, u32)> = Vec::new();
    let mut flush = |nodes: &mut [Wide], block: &mut Vec<u32>, roots: &mut Vec<(u32, usize, u32)>| {
        let id = blocks.len() as u32;
        blocks.push(encode(nodes, block, cells));
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
fn encode(nodes: &[Wide], block: &[u32], cells: &MemberCells) -> Vec<u32> {
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
    if !cells.voxels.is_empty() {
        put_voxels(&mut words, block.iter().map(|&at| voxels_of(&nodes[at as usize], cells)), cells);
    }
    words.resize(words.len().next_multiple_of(LINE_WORDS), 0);
    words
}

/// Appends the voxels of a block's nodes, and enters them in its header.
fn put_voxels<'a>(words: &mut Vec<u32>, of_nodes: impl Iterator<Item = &'a [[u32; LONG_VOXEL]]>, cells: &MemberCells) {
    let (mut firsts, mut voxels, mut sides) = (Vec::new(), Vec::new(), Vec::new());
    let mut transmitting = Transmitting::default();
    for (index, of_node) in of_nodes.enumerate() {
        firsts.push((voxels.len() / LONG_VOXEL) as u32);
        for voxel in of_node {
            let mut voxel = *voxel;
            if Coded::has_sides(voxel[0]) {
                let of_voxel = cells.sides[voxel[1] as usize];
                voxel[1] = (sides.len() / SIDES_WORDS) as u32;
                sides.extend(of_voxel);
            }
            mark_transmitting(&mut transmitting, index, stopped(voxel[0]) > 0);
            voxels.extend(voxel);
        }
    }
    words[5] = (voxels.len() / LONG_VOXEL) as u32 | ((sides.len() / SIDES_WORDS) as u32) << 16;
    words[6] = LONG_VOXEL as u32;
    words[8..HEADER_WORDS].copy_from_slice(&transmitting);
    words.extend(firsts);
    words.extend(voxels);
    words.extend(sides);
}
