//! Which nodes share a block.
//!
//! First the **fine** units are cut off: the largest subtrees of at most [`FINE_WORDS`] words. Consecutive
//! ones, which are neighbours in space, fill blocks that hold all triangles and refer to no other block.
//! What is left above is nodes alone, and goes into **coarse** blocks, in rounds: each cuts off the largest
//! subtrees of at most [`COARSE_WORDS`] words, and the next round's input is what remains, until that fits
//! one block. Blocks are numbered from the last round to the first, fine ones behind all coarse ones, so
//! that a reference always points to a higher block. A tree that fits one block is that block.

use super::TreeInput;
use super::par::Par;
use super::refs::Ref;
use super::tree::{Inner, Sub};
use crate::structure::bvh::layout::{Child, HEADER_WORDS, MAX_WORDS, PAD_WORDS};

/// A subtree cut off: which one, over all rounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnitId(u32);

impl UnitId {
    /// Of none.
    pub const NONE: Self = Self(u32::MAX);
}

/// Words of a fine unit, at most. A node over eight of the largest leaves must fit.
///
/// It decides how much of a tree is coarse and read at opening (about 0.7 bytes a triangle), and how many
/// nodes a walk meets in a block.
pub const FINE_WORDS: u32 = 768;
/// Words of a coarse unit, at most: small beside a block, so that blocks fill well.
const COARSE_WORDS: u32 = MAX_WORDS as u32 / 8;

/// What goes into one block.
pub struct Plan {
    /// Subtrees, roots in order of their nodes.
    pub roots: Vec<Box<Inner>>,
    /// Local parts of its triangles, ascending.
    pub parts: Vec<u32>,
    /// For each unit referred to, in the order met by a preorder walk: block and child reference.
    pub externals: Vec<(u32, u32)>,
    words: u32,
    nodes: u32,
}

impl Plan {
    const EMPTY_WORDS: u32 = (HEADER_WORDS + PAD_WORDS) as u32;

    fn new() -> Self {
        let (roots, parts, externals) = (Vec::new(), Vec::new(), Vec::new());
        Self { roots, parts, externals, words: Self::EMPTY_WORDS, nodes: 0 }
    }
}

/// Where a unit went: round, block in the round, node in the block.
#[derive(Clone, Copy)]
struct Home {
    round: usize,
    block: usize,
    node: u32,
}

/// The blocks of a tree.
pub struct Packed {
    /// In their order.
    pub plans: Vec<Plan>,
    /// How many of them are coarse.
    pub coarse: usize,
    /// Child reference to the root in block 0.
    pub root: u32,
}

/// Packs a tree.
pub fn pack(mut root: Box<Inner>, input: TreeInput, refs: &[Ref], par: &Par) -> Packed {
    let mut homes: Vec<Home> = Vec::new();
    let mut rounds: Vec<Vec<Plan>> = Vec::new();
    loop {
        if let Some(parts) = parts_of_last(&root, input, refs) {
            let mut plan = Plan::new();
            plan.parts = parts;
            plan.roots.push(root);
            rounds.push(vec![plan]);
            break;
        }
        let mut units = Vec::new();
        let most = if rounds.is_empty() { FINE_WORDS } else { COARSE_WORDS };
        cut(&mut root, most, homes.len() as u32, &mut units);
        let parts = par.map(units.len(), |i| parts_of(&units[i], input, refs));
        rounds.push(fill(units, parts, rounds.len(), &mut homes));
    }
    // Final numbers: the last round first.
    let mut first = vec![0u32; rounds.len()];
    for r in (0..rounds.len() - 1).rev() {
        first[r] = first[r + 1] + rounds[r + 1].len() as u32;
    }
    let coarse = if rounds.len() == 1 { 1 } else { first[0] as usize };
    let mut plans: Vec<Plan> = rounds.into_iter().rev().flatten().collect();
    for plan in &mut plans {
        let mut met = Vec::new();
        plan.roots.iter().for_each(|root| units_met(root, &mut met));
        plan.externals = met
            .into_iter()
            .map(|UnitId(u)| {
                let home = homes[u as usize];
                let child = Child::Node(home.node as usize).to_bits();
                (first[home.round] + home.block as u32, u32::from(child))
            })
            .collect();
    }
    Packed { plans, coarse, root: u32::from(Child::Node(0).to_bits()) }
}

/// The parts of all that is left, if it fits one block.
fn parts_of_last(root: &Inner, input: TreeInput, refs: &[Ref]) -> Option<Vec<u32>> {
    let words = Plan::EMPTY_WORDS as usize + root.words as usize;
    // Of a large tree it would take long, and the answer is known.
    let parts = (words <= MAX_WORDS).then(|| parts_of(root, input, refs))?;
    (words + parts.len() <= MAX_WORDS).then_some(parts)
}

#[allow(clippy::vec_box)] // units move between lists; their children lists stay where they are
/// Cuts off the largest subtrees of at most `most` words, in depth-first order.
fn cut(inner: &mut Inner, most: u32, first_id: u32, units: &mut Vec<Box<Inner>>) {
    for (_, child) in &mut inner.children {
        let Sub::Inner(below) = child else { continue };
        if below.words > most {
            cut(below, most, first_id, units);
            continue;
        }
        let id = UnitId(first_id + units.len() as u32);
        if let Sub::Inner(unit) = std::mem::replace(child, Sub::Placed(id)) {
            units.push(unit);
        }
    }
    inner.measure();
}

#[allow(clippy::vec_box)] // as in `cut`
/// Fills blocks with consecutive units, given the parts of each.
fn fill(units: Vec<Box<Inner>>, parts: Vec<Vec<u32>>, round: usize, homes: &mut Vec<Home>) -> Vec<Plan> {
    let mut plans: Vec<Plan> = Vec::new();
    for (unit, parts) in units.into_iter().zip(parts) {
        let fits = |p: &Plan| {
            let together = p.words as usize + p.parts.len() + unit.words as usize + parts.len();
            together <= MAX_WORDS
        };
        if !plans.last().is_some_and(fits) {
            plans.push(Plan::new());
        }
        let block = plans.len() - 1;
        let plan = &mut plans[block];
        homes.push(Home { round, block, node: plan.nodes });
        plan.nodes += unit.nodes();
        plan.words += unit.words;
        plan.parts.extend(parts);
        plan.parts.sort_unstable();
        plan.parts.dedup();
        plan.roots.push(unit);
    }
    plans
}

/// Local parts of the triangles below, ascending.
fn parts_of(inner: &Inner, input: TreeInput, refs: &[Ref]) -> Vec<u32> {
    fn gather(inner: &Inner, input: TreeInput, refs: &[Ref], out: &mut Vec<u32>) {
        for (_, child) in &inner.children {
            match child {
                Sub::Inner(below) => gather(below, input, refs, out),
                Sub::Placed(_) => {}
                Sub::Leaf { first, count, .. } => {
                    for r in &refs[*first as usize..(*first + *count) as usize] {
                        let part = input.parts[r.triangle()];
                        // Neighbours mostly share their part: this keeps the list short.
                        if out.last() != Some(&part) {
                            out.push(part);
                        }
                    }
                }
            }
        }
    }
    let mut parts = Vec::new();
    gather(inner, input, refs, &mut parts);
    parts.sort_unstable();
    parts.dedup();
    parts
}

/// Units that a subtree refers to, in preorder.
fn units_met(inner: &Inner, out: &mut Vec<UnitId>) {
    for (_, child) in &inner.children {
        match child {
            Sub::Inner(below) => units_met(below, out),
            Sub::Placed(id) => out.push(*id),
            Sub::Leaf { .. } => {}
        }
    }
}
