//! Assignment of nodes to blocks.
//!
//! First the **fine** units are cut off ([`fine`]): the largest subtrees of at most [`FINE_WORDS`] words. Consecutive
//! units, which are neighbours in space, fill blocks that refer to no other block. Each of these blocks has a leaf
//! block for the leaves below its nodes. The rest of the tree consists of nodes only and goes into **coarse** blocks
//! ([`coarse`]), in rounds: each round cuts off the largest subtrees of at most [`COARSE_WORDS`] words, and the
//! remaining tree is the input of the next round, until it fits one block. Blocks are numbered from the last round to
//! the first, with the fine ones after all coarse ones, so that a reference always points to a higher block. A tree
//! that fits one block becomes that block ([`whole`]).

use super::refs::Ref;
use super::tree::{InnerNode, Sub};
use crate::structure::bake::TreeInput;
use crate::structure::bvh::layout::{Child, HEADER_WORDS, MAX_WORDS, PAD_WORDS};
use crate::structure::par::Par;

/// Number of a unit, which is a subtree that was cut off, counted over all rounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnitId(pub u32);

impl UnitId {
    /// No unit.
    pub const NONE: Self = Self(u32::MAX);
}

/// Greatest number of words of a fine unit. A node over eight of the largest leaves must fit.
///
/// It determines how much of a tree is coarse and read at opening (1.3 bytes per triangle, decoded, for a Mandelbulb of
/// 40 million), and how many nodes a walk visits in a block.
pub const FINE_WORDS: u32 = 1024;
/// Greatest number of words of a coarse unit: small compared with a block, so that blocks are well filled.
const COARSE_WORDS: u32 = MAX_WORDS as u32 / 8;

/// The content of one block, or of a block of nodes and its leaf block.
pub struct Plan {
    /// Subtrees, with roots in the order of their nodes.
    pub roots: Vec<Box<InnerNode>>,
    /// Local parts of the triangles, ascending.
    pub parts: Vec<u32>,
    /// Block and child reference of each unit that the subtrees refer to, in preorder.
    pub externals: Vec<(u32, u32)>,
    /// True if the leaves go into a block of their own.
    pub has_leaf_block: bool,
    /// Number of words of the block of nodes, and of the leaf block.
    words: [u32; 2],
    nodes: u32,
}

impl Plan {
    const EMPTY_WORDS: u32 = (HEADER_WORDS + PAD_WORDS) as u32;

    fn new() -> Self {
        let (roots, parts, externals) = (Vec::new(), Vec::new(), Vec::new());
        Self { roots, parts, externals, has_leaf_block: false, words: [Self::EMPTY_WORDS; 2], nodes: 0 }
    }
}

/// Position of a unit: block in its round, node in the block.
#[derive(Debug, Clone, Copy)]
pub struct Home {
    /// Counted from the first block of the round.
    pub block: u32,
    /// Index of its root.
    pub node: u32,
}

/// Returns the only block of a tree that fits one; fails with the tree if it does not.
pub fn whole(root: Box<InnerNode>, input: TreeInput, refs: &[Ref]) -> Result<Plan, Box<InnerNode>> {
    let words = (Plan::EMPTY_WORDS + root.words + root.curtain_words()) as usize;
    // Finding the parts of a large tree takes long, and the result is known.
    if words > MAX_WORDS {
        return Err(root);
    }
    let parts = parts_of(&root, input, refs);
    if words + parts.len() > MAX_WORDS {
        return Err(root);
    }
    Ok(Plan { roots: vec![root], parts, ..Plan::new() })
}

/// Cuts all fine units off some trees. Returns the plans of their blocks, and the position of each unit. A small tree
/// is one unit.
pub fn fine<'a>(
    trees: impl Iterator<Item = &'a mut Sub>,
    input: TreeInput,
    refs: &[Ref],
    par: &Par,
) -> (Vec<Plan>, Vec<Home>) {
    let mut units = Vec::new();
    trees.for_each(|tree| cut_child(tree, FINE_WORDS, 0, &mut units));
    let needs = par.map(units.len(), |i| Needs { parts: parts_of(&units[i], input, refs), ..Needs::of(&units[i]) });
    let mut homes = Vec::with_capacity(units.len());
    let mut plans = fill(units.into_iter().zip(needs), &mut homes);
    plans.iter_mut().for_each(|plan| plan.has_leaf_block = true);
    (plans, homes)
}

/// Returns the plans of the coarse blocks, in order, of a tree from which the units `fine` were cut off. All references
/// count blocks from the first block of the tree.
pub fn coarse(mut root: Box<InnerNode>, fine: &[Home]) -> Vec<Plan> {
    // Plans of each round, and the number of its first unit.
    let mut rounds: Vec<(Vec<Plan>, usize)> = Vec::new();
    let mut homes = Vec::new();
    while (Plan::EMPTY_WORDS + root.words + root.curtain_words()) as usize > MAX_WORDS {
        let (mut units, first) = (Vec::new(), fine.len() + homes.len());
        cut(&mut root, COARSE_WORDS, first as u32, &mut units);
        let needs: Vec<Needs> = units.iter().map(|unit| Needs::of(unit)).collect();
        let plans = fill(units.into_iter().zip(needs), &mut homes);
        rounds.push((plans, first));
    }
    rounds.push((vec![Plan { roots: vec![root], ..Plan::new() }], fine.len() + homes.len()));
    // Final block numbers: the last round first, fine blocks last.
    let mut firsts = vec![(0usize, rounds.iter().map(|(plans, _)| plans.len() as u32).sum())];
    for (plans, first_unit) in &rounds {
        let before = firsts.last().map_or(0, |&(_, block)| block) - plans.len() as u32;
        firsts.push((*first_unit, before));
    }
    let place = |UnitId(u): UnitId| {
        let u = u as usize;
        let home = if u < fine.len() { fine[u] } else { homes[u - fine.len()] };
        let round = firsts.partition_point(|&(first, _)| first <= u) - 1;
        (firsts[round].1 + home.block, u32::from(Child::Node(home.node as usize).to_bits()))
    };
    let mut plans: Vec<Plan> = rounds.into_iter().rev().flat_map(|(plans, _)| plans).collect();
    for plan in &mut plans {
        let mut met = Vec::new();
        plan.roots.iter().for_each(|root| units_met(root, &mut met));
        plan.externals = met.into_iter().map(place).collect();
    }
    plans
}

#[allow(clippy::vec_box)] // units move between lists; their lists of children stay in place
/// Cuts off the largest subtrees of at most `most` words, in depth-first order.
fn cut(inner: &mut InnerNode, most: u32, first_id: u32, units: &mut Vec<Box<InnerNode>>) {
    inner.children.iter_mut().for_each(|(_, child)| cut_child(child, most, first_id, units));
    inner.measure();
}

#[allow(clippy::vec_box)] // as in `cut`
fn cut_child(child: &mut Sub, most: u32, first_id: u32, units: &mut Vec<Box<InnerNode>>) {
    let Sub::InnerNode(below) = child else { return };
    if below.words > most {
        return cut(below, most, first_id, units);
    }
    let id = UnitId(first_id + units.len() as u32);
    if let Sub::InnerNode(unit) = std::mem::replace(child, Sub::Placed(id)) {
        units.push(unit);
    }
}

/// Space that a unit needs in its block, and in its leaf block.
struct Needs {
    /// Local parts of its triangles, ascending.
    parts: Vec<u32>,
    /// Number of nodes.
    nodes: u32,
    /// Number of words of the nodes, and of the leaves.
    of_nodes: u32,
    of_leaves: u32,
}

impl Needs {
    /// Measures a unit, without its parts.
    fn of(unit: &InnerNode) -> Self {
        let of_leaves = unit.leaf_words();
        let of_nodes = unit.words - of_leaves + unit.curtain_words();
        Self { parts: Vec::new(), nodes: unit.nodes(), of_nodes, of_leaves }
    }
}

/// Fills blocks with consecutive units, given the needs of each. Appends the position of each unit to `homes`.
fn fill(units: impl Iterator<Item = (Box<InnerNode>, Needs)>, homes: &mut Vec<Home>) -> Vec<Plan> {
    let mut plans: Vec<Plan> = Vec::new();
    for (unit, Needs { parts, nodes, of_nodes, of_leaves }) in units {
        let fits = |p: &Plan| {
            let leaves = (p.words[1] + of_leaves) as usize + p.parts.len() + parts.len();
            (p.words[0] + of_nodes) as usize <= MAX_WORDS && leaves <= MAX_WORDS
        };
        if !plans.last().is_some_and(fits) {
            plans.push(Plan::new());
        }
        let block = plans.len() - 1;
        let plan = &mut plans[block];
        homes.push(Home { block: block as u32, node: plan.nodes });
        plan.nodes += nodes;
        plan.words[0] += of_nodes;
        plan.words[1] += of_leaves;
        if !parts.is_empty() {
            plan.parts.extend(parts);
            plan.parts.sort_unstable();
            plan.parts.dedup();
        }
        plan.roots.push(unit);
    }
    plans
}

/// Returns the local parts of the triangles below a node, ascending.
fn parts_of(inner: &InnerNode, input: TreeInput, refs: &[Ref]) -> Vec<u32> {
    fn gather(inner: &InnerNode, input: TreeInput, refs: &[Ref], out: &mut Vec<u32>) {
        for (_, child) in &inner.children {
            match child {
                Sub::InnerNode(below) => gather(below, input, refs, out),
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

/// Appends the units that a subtree refers to, in preorder.
fn units_met(inner: &InnerNode, out: &mut Vec<UnitId>) {
    for (_, child) in &inner.children {
        match child {
            Sub::InnerNode(below) => units_met(below, out),
            Sub::Placed(id) => out.push(*id),
            Sub::Leaf { .. } => {}
        }
    }
}
