//! Moves members of a tree over members: the boxes above each one are fitted anew, in copies of the blocks that change.

use super::build::quantise::quantise;
use super::layout::{Block, Child, HEADER_WORDS, MAX_NODES, NODE_WORDS, Node};
use super::members::{Members, number_of};
use crate::base::ids::BlockId;
use crate::math::{Bounds, bits};
use crate::residency::Slot;
use bytemuck::must_cast_ref;
use std::collections::BTreeMap;

/// A member that moves.
#[derive(Debug, Clone, Copy)]
pub struct Move {
    /// Its number.
    pub member: u32,
    /// Its box in the tree.
    pub from: Bounds,
    /// Its new box.
    pub to: Bounds,
}

/// A slot of a node.
#[derive(Clone, Copy)]
struct At {
    block: u32,
    node: usize,
    slot: usize,
}

impl Members {
    /// The tree after some moves; `None` if a member is not where its move says. Blocks without changes are shared.
    pub fn moved(&self, moves: &[Move]) -> Option<Self> {
        let mut refit = Refit { tree: self, changed: BTreeMap::new() };
        for it in moves {
            let path = refit.path_to(it)?;
            refit.fit(&path, it.to);
        }
        let changed = refit.changed.into_iter().map(|(id, words)| (BlockId(id), Slot::new(&words)));
        Some(self.with_blocks(changed.collect()))
    }
}

/// Blocks that change.
struct Refit<'a> {
    tree: &'a Members,
    changed: BTreeMap<u32, Vec<u32>>,
}

impl Refit<'_> {
    fn words(&self, block: u32) -> &[u32] {
        match self.changed.get(&block) {
            Some(words) => words,
            None => self.tree.block(block),
        }
    }

    /// The slots from the root to a member.
    fn path_to(&self, it: &Move) -> Option<Vec<At>> {
        let (mut path, mut todo) = (Vec::new(), vec![(self.tree.root(), 0)]);
        while let Some((number, depth)) = todo.pop() {
            path.truncate(depth);
            let (block, node) = (number / MAX_NODES as u32, number as usize % MAX_NODES);
            let words = Block::new(self.words(block));
            let stored = words.node(node);
            path.push(At { block, node, slot: 0 });
            for slot in bits(stored.valid.into()) {
                if !stored.child_box(slot).contains(&it.from) {
                    continue;
                }
                let next = match Child::from_bits(stored.child[slot].into()) {
                    Child::Node(index) => number_of(block, index as u32),
                    Child::External(at) => {
                        let (to, child) = words.external(at);
                        let Child::Node(index) = Child::from_bits(child) else { continue };
                        number_of(to, index as u32)
                    }
                    Child::Member(at) if words.member(at) == it.member => {
                        path[depth].slot = slot;
                        self.set_slots(&mut path);
                        return Some(path);
                    }
                    Child::Member(_) | Child::Leaf(_) => continue,
                };
                todo.push((next, depth + 1));
            }
        }
        None
    }

    /// Sets the slots of all nodes of a path but the last.
    fn set_slots(&self, path: &mut [At]) {
        for i in 1..path.len() {
            let (to, parent) = (path[i], &mut path[i - 1]);
            let words = Block::new(self.words(parent.block));
            let stored = words.node(parent.node);
            let leads = |slot: &usize| match Child::from_bits(stored.child[*slot].into()) {
                Child::Node(index) => (parent.block, index) == (to.block, to.node),
                Child::External(at) => {
                    let (block, child) = words.external(at);
                    block == to.block && Child::from_bits(child) == Child::Node(to.node)
                }
                Child::Member(_) | Child::Leaf(_) => false,
            };
            parent.slot = bits(stored.valid.into()).find(leads).unwrap_or(0);
        }
    }

    /// Gives the slot at the end of a path a box, and the slots above it boxes around their nodes'.
    fn fit(&mut self, path: &[At], mut to: Bounds) {
        for at in path.iter().rev() {
            let before = *Block::new(self.words(at.block)).node(at.node);
            let mut node = before;
            set_box(&mut node, at.slot, to);
            if (node.planes, node.origin, node.exponent) == (before.planes, before.origin, before.exponent) {
                return;
            }
            let tree = self.tree;
            let words = self.changed.entry(at.block).or_insert_with(|| tree.block(at.block).to_vec());
            let first = HEADER_WORDS + at.node * NODE_WORDS;
            words[first..first + NODE_WORDS].copy_from_slice(must_cast_ref::<Node, [u32; NODE_WORDS]>(&node));
            to = node.children_box();
        }
    }
}

/// Gives a child of a node a box, on the grid that the node has if that is large enough.
fn set_box(node: &mut Node, slot: usize, to: Bounds) {
    let (mut low, mut high) = ([0.0; 3], [0.0; 3]);
    let mut fits = true;
    for axis in 0..3 {
        let (origin, step) = (f64::from(node.origin[axis]), f64::from(node.step(axis)));
        low[axis] = ((f64::from(to.min[axis]) - origin) / step).floor();
        high[axis] = ((f64::from(to.max[axis]) - origin) / step).ceil();
        // Differences of coordinates may be rounded: see `quantise`.
        low[axis] -= f64::from(u8::from(origin + low[axis] * step > f64::from(to.min[axis])));
        high[axis] += f64::from(u8::from(origin + high[axis] * step < f64::from(to.max[axis])));
        fits &= low[axis] >= 0.0 && high[axis] <= 255.0;
    }
    if fits {
        for axis in 0..3 {
            (node.planes[axis][slot], node.planes[axis + 3][slot]) = (low[axis] as u8, high[axis] as u8);
        }
        return;
    }
    let count = node.valid.count_ones() as usize;
    let boxes: Vec<Bounds> = (0..count).map(|i| if i == slot { to } else { node.child_box(i) }).collect();
    let Node { origin, exponent, planes, .. } = quantise(boxes.iter().copied());
    (node.origin, node.exponent, node.planes) = (origin, exponent, planes);
}
