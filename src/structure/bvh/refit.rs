//! Moves members of a tree over members: the boxes above each one are fitted anew, in copies of the blocks that change.
//! Cells above them, and cells with new boxes, stop standing in until the tree is built anew: what they would show is
//! not there any more.

use super::build::quantise::set_box;
use super::layout::{Block, Child as Reference, HEADER_WORDS, MAX_NODES, NODE_WORDS, Node, WIDTH};
use super::members::{Child, Members, child_of};
use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::base::memory::make_room;
use crate::math::{Bounds, bits};
use crate::residency::Slot;
use bytemuck::must_cast_ref;
use std::collections::BTreeMap;

/// The memory of a search through the tree, for messages.
const WHAT: &str = "the tree over placed trees";

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
    /// The tree after some moves, also of members that stay where they are but look different; `None` if a member is
    /// not where its move says. Blocks without changes are shared.
    pub fn moved(&self, moves: &[Move]) -> Option<Self> {
        let mut refit = Refit { tree: self, changed: BTreeMap::new() };
        for it in moves {
            let path = refit.path_to(it)?;
            refit.fit(&path, it.to);
        }
        Some(refit.done())
    }
}

impl Members {
    /// The tree in which no cell above a member of those that `is_own` accepts stands in. Blocks without changes are
    /// shared. Takes time in proportion to all members. Fails with `NoMemory`.
    pub fn without_cells_above(&self, is_own: impl Fn(u32) -> bool) -> Result<Self> {
        let mut refit = Refit { tree: self, changed: BTreeMap::new() };
        // Each node after the one above it, with the index of that one and the slot there.
        let mut nodes: Vec<(u32, usize, usize)> = vec![(self.root(), 0, 0)];
        // For each node, the slots of children with such members below.
        let mut own: Vec<u8> = Vec::new();
        let mut at = 0;
        while let Some(&(number, ..)) = nodes.get(at) {
            let (id, node) = (number / MAX_NODES as u32, number as usize % MAX_NODES);
            let block = Block::new(self.block(id));
            let (stored, mut slots) = (block.node(node), 0);
            make_room(&mut nodes, WIDTH, WHAT)?;
            for slot in bits(stored.valid.into()) {
                match child_of(block, id, stored.child[slot]) {
                    Some(Child::Node(below)) => nodes.push((below, at, slot)),
                    Some(Child::Member(member)) => slots |= u8::from(is_own(member)) << slot,
                    None => {}
                }
            }
            make_room(&mut own, 1, WHAT)?;
            own.push(slots);
            at += 1;
        }
        for at in (1..nodes.len()).rev() {
            let (_, above, slot) = nodes[at];
            own[above] |= u8::from(own[at] != 0) << slot;
        }
        for (&(number, ..), slots) in nodes.iter().zip(own).filter(|it| it.1 != 0) {
            let (block, node) = (number / MAX_NODES as u32, number as usize % MAX_NODES);
            let mut new = *Block::new(refit.words(block)).node(node);
            let stand = bits(slots.into()).filter(|slot| !new.never_stands_in(*slot)).collect::<Vec<_>>();
            if !stand.is_empty() {
                stand.into_iter().for_each(|slot| new.keep_from_standing_in(slot));
                refit.put(block, node, &new);
            }
        }
        Ok(refit.done())
    }
}

/// Blocks that change.
struct Refit<'a> {
    tree: &'a Members,
    changed: BTreeMap<u32, Vec<u32>>,
}

impl Refit<'_> {
    /// The tree with the changed blocks.
    fn done(self) -> Members {
        let changed = self.changed.into_iter().map(|(id, words)| (BlockId(id), Slot::new(&words)));
        self.tree.with_blocks(changed.collect())
    }

    /// Replaces a node.
    fn put(&mut self, block: u32, node: usize, new: &Node) {
        let tree = self.tree;
        let words = self.changed.entry(block).or_insert_with(|| tree.block(block).to_vec());
        let first = HEADER_WORDS + node * NODE_WORDS;
        words[first..first + NODE_WORDS].copy_from_slice(must_cast_ref::<Node, [u32; NODE_WORDS]>(new));
    }

    fn words(&self, block: u32) -> &[u32] {
        match self.changed.get(&block) {
            Some(words) => words,
            None => self.tree.block(block),
        }
    }

    /// The slots from the root to a member.
    fn path_to(&self, it: &Move) -> Option<Vec<At>> {
        // Nodes still to be searched: their depths, their numbers, and the slots of their parents.
        let (mut path, mut todo): (Vec<At>, _) = (Vec::new(), vec![(0, self.tree.root(), 0)]);
        while let Some((depth, number, slot_above)) = todo.pop() {
            path.truncate(depth);
            if let Some(parent) = path.last_mut() {
                parent.slot = slot_above;
            }
            let (block, node) = (number / MAX_NODES as u32, number as usize % MAX_NODES);
            let words = Block::new(self.words(block));
            let stored = words.node(node);
            path.push(At { block, node, slot: 0 });
            for slot in bits(stored.valid.into()).filter(|slot| stored.child_box(*slot).contains(&it.from)) {
                match child_of(words, block, stored.child[slot]) {
                    Some(Child::Node(below)) => todo.push((depth + 1, below, slot)),
                    Some(Child::Member(member)) if member == it.member => {
                        path[depth].slot = slot;
                        return Some(path);
                    }
                    Some(Child::Member(_)) | None => {}
                }
            }
        }
        None
    }

    /// Gives the slot at the end of a path a box, and the slots above it boxes around their nodes'. The cells above it
    /// do not stand in any more.
    fn fit(&mut self, path: &[At], to: Bounds) {
        let mut to = Some(to);
        for at in path.iter().rev() {
            let before = *Block::new(self.words(at.block)).node(at.node);
            let mut node = before;
            if let Some(to) = to {
                set_box(&mut node, at.slot, to);
            }
            let is_member = Reference::is_end(node.child[at.slot].into());
            // If a cell does not stand in, neither do those above it.
            let is_known = !is_member && before.never_stands_in(at.slot);
            node.keep_from_standing_in(at.slot);
            if (node.origin, node.exponent) != (before.origin, before.exponent) {
                // Slabs are counted in steps of the boxes, which are all new.
                (0..WIDTH).for_each(|slot| node.keep_from_standing_in(slot));
            }
            let is_moved = (node.planes, node.origin, node.exponent) != (before.planes, before.origin, before.exponent);
            if !is_moved && is_known {
                return;
            }
            if is_moved || !before.never_stands_in(at.slot) {
                self.put(at.block, at.node, &node);
            }
            to = is_moved.then(|| node.children_box());
        }
    }
}
