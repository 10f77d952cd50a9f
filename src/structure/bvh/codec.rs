//! The file form of a geometry block: the trace form without everything that decoding can derive.
//!
//! `src/store/FORMAT.md` describes the bytes, in "Block payloads of structure `bvh`" and in the sections "Nodes" and
//! "Leaves" below it. `codec_nodes.rs` and `codec_leaves.rs` read and write these two tables. This file assembles the
//! trace form from them.
//!
//! Child references are not stored. Nodes, leaves and external references are numbered in the order of a preorder
//! traversal, so `link` can assign them again. Positions are kept to the bit.

use super::codec_leaves::{Leaves, leaves_in_order, push_leaves, read_leaves};
use super::codec_nodes::{Nodes, push_nodes, read_nodes};
use super::layout::{
    Block, Child, EXTERNAL_WORDS, HEADER_WORDS, MAX_TRIANGLES, MAX_VERTICES, MAX_WORDS, NODE_WORDS, Node, PAD_WORDS,
    WIDTH, leaf_block_head,
};
use super::leaf::{APART, LeafForm, MIXED};
use super::validate::validate;
use crate::simd::{Isa, Op, Simd, dispatch};
use crate::structure::bytes::{Reader, padded, piece};
use std::cmp::Ordering;

/// Values of a payload's first byte.
const ALL: u8 = 1;
const NODES: u8 = 2;
const LEAVES: u8 = 3;

/// Result of decoding, or the fault in a few words.
pub(super) type Checked<T> = Result<T, String>;

pub(super) fn wrong<T>(why: &str) -> Checked<T> {
    Err(why.to_string())
}

/// Encodes the trace form of a geometry block. `leaves` is the trace form of its leaf block, if it has one.
pub fn encode_geometry(words: &[u32], leaves: Option<&[u32]>) -> Vec<u8> {
    let block = Block::new(words);
    if block.nodes() == 0 {
        let mut out = vec![LEAVES];
        push_leaves(&mut out, &block);
        return out;
    }
    let holds_all = block.first_leaf() + PAD_WORDS < words.len();
    let mut out = vec![if holds_all { ALL } else { NODES }];
    let elsewhere = leaves.map(Block::new);
    let starts = leaves_in_order(elsewhere.as_ref().unwrap_or(&block));
    push_nodes(&mut out, &block, starts.len());
    if holds_all {
        push_leaves(&mut out, &block);
    } else {
        let begin = elsewhere.map_or(0, |block| block.first_leaf());
        out.extend((begin as u16).to_le_bytes());
        out.extend(elsewhere.iter().flat_map(|block| starts.iter().map(|&at| block.leaf(at.into()).len() as u8)));
    }
    out
}

/// Content of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Holds {
    /// Nodes and leaves: the one block of a tree.
    All,
    /// Nodes over other blocks.
    Nodes,
    /// Nodes over the leaves of a leaf block.
    NodesOverLeaves,
    /// Leaves.
    Leaves,
}

/// Id and kind of a block, and the range of its references.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// The block's own id.
    pub id: u32,
    /// One past the last block of its tree that has nodes.
    pub end: u32,
    /// The content that the block must have.
    pub holds: Holds,
}

/// References to leaves in the form that nodes store, in the order of the leaves, followed by zeros for a whole node.
type LeafReferences = Vec<u16>;

/// Decodes a geometry block and checks everything that a walk relies on.
pub fn decode_geometry(payload: &[u8], place: Place) -> Checked<Vec<u32>> {
    decode_with(Isa::best(), payload, place)
}

/// [`decode_geometry`] with a given instruction set. The result does not depend on it.
pub(super) fn decode_with(isa: Isa, payload: &[u8], place: Place) -> Checked<Vec<u32>> {
    dispatch(isa, Decode { payload, place })
}

/// Decoding, compiled for each instruction set. Most of it is plain loops that the compiler vectorises. Only the test
/// and the writing of steps in leaves use the instruction set's own operations.
struct Decode<'a> {
    payload: &'a [u8],
    place: Place,
}

impl Op for Decode<'_> {
    type Out = Checked<Vec<u32>>;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Self::Out {
        decode(s, self.payload, self.place)
    }
}

#[inline(always)]
fn decode<S: Simd>(s: S, payload: &[u8], place: Place) -> Checked<Vec<u32>> {
    let mut reader = Reader::new(payload);
    let kind = match place.holds {
        Holds::All => ALL,
        Holds::Nodes | Holds::NodesOverLeaves => NODES,
        Holds::Leaves => LEAVES,
    };
    if reader.u8()? != kind {
        return wrong("the block has an unexpected kind");
    }
    let words = match place.holds {
        Holds::All => {
            let (nodes, leaves) = (read_nodes(&mut reader, place)?, read_leaves(s, &mut reader)?);
            if leaves.starts.len() != nodes.leaves {
                return wrong("the leaf counts are inconsistent");
            }
            let at = nodes_end(&nodes) + leaves.parts.len();
            if at + leaves.own().len() + PAD_WORDS > MAX_WORDS {
                return wrong("the block is too large");
            }
            let references = leaf_references(leaves.starts.iter().map(|start| at + start));
            trace_form(nodes, &references, Some(leaves))?
        }
        Holds::Leaves => leaf_block(read_leaves(s, &mut reader)?),
        Holds::Nodes | Holds::NodesOverLeaves => {
            let nodes = read_nodes(&mut reader, place)?;
            if place.holds == Holds::Nodes && nodes.leaves > 0 {
                return wrong("a coarse block has leaves");
            }
            let references = read_starts(&mut reader, nodes.leaves)?;
            trace_form(nodes, &references, None)?
        }
    };
    reader.end()?;
    debug_assert_eq!(validate(&words, place), Ok(()));
    Ok(words)
}

/// Number of words of a block's header, nodes, external references and voxels.
fn nodes_end(nodes: &Nodes) -> usize {
    HEADER_WORDS + nodes.table.len() * NODE_WORDS + nodes.externals.len() * EXTERNAL_WORDS + nodes.voxels.1.len()
}

/// Sizes of the smallest leaf, with one triangle, and of the largest, with eight triangles over sixteen vertices in
/// several parts.
const LEAST_LEAF: usize = LeafForm { triangles: 1, vertices: 3, flags: APART }.words();
const LARGEST_LEAF: usize = LeafForm { triangles: MAX_TRIANGLES, vertices: MAX_VERTICES, flags: MIXED }.words();

/// References to leaves that begin at these words.
fn leaf_references(starts: impl ExactSizeIterator<Item = usize>) -> LeafReferences {
    padded(starts.map(|at| Child::Leaf(at).to_bits()), WIDTH)
}

/// Reads the sizes of the leaves in a leaf block, and returns references to them.
#[inline(always)]
fn read_starts(reader: &mut Reader, leaves: usize) -> Checked<LeafReferences> {
    let begin = usize::from(reader.u16()?);
    if begin < HEADER_WORDS && leaves > 0 {
        return wrong("the first leaf has an invalid position");
    }
    let sizes = reader.take(leaves)?;
    if !sizes.iter().fold(true, |all, words| all & (LEAST_LEAF..=LARGEST_LEAF).contains(&usize::from(*words))) {
        return wrong("a leaf has an invalid size");
    }
    let end = begin + sizes.iter().map(|words| usize::from(*words)).sum::<usize>();
    if end + PAD_WORDS > MAX_WORDS {
        return wrong("the leaves do not fit into a block");
    }
    let mut at = begin;
    Ok(leaf_references(sizes.iter().map(|words| {
        at += usize::from(*words);
        at - usize::from(*words)
    })))
}

/// Completes a block of leaves.
#[inline(always)]
fn leaf_block(leaves: Leaves) -> Vec<u32> {
    let begin = leaves.begin();
    let Leaves { triangles, parts, mut words, .. } = leaves;
    words[..8].copy_from_slice(&leaf_block_head(triangles, parts.len()));
    words[HEADER_WORDS..begin].copy_from_slice(&parts);
    words
}

/// Assembles a block of nodes with references to leaves, and with the leaves themselves if they are in this block.
#[inline(always)]
fn trace_form(nodes: Nodes, references: &[u16], leaves: Option<Leaves>) -> Checked<Vec<u32>> {
    let parts: &[u32] = leaves.as_ref().map_or(&[], |leaves| &leaves.parts);
    let triangles = leaves.as_ref().map_or(0, |leaves| leaves.triangles);
    let own = leaves.as_ref().map_or(&[][..], Leaves::own);
    // This check comes before references are made, which cannot express greater positions.
    let size = nodes_end(&nodes) + parts.len() + own.len() + PAD_WORDS;
    if size > MAX_WORDS {
        return wrong("the block is too large");
    }
    let Nodes { mut table, kinds, externals, transmitting, voxels: (voxel_header, voxel_words), .. } = nodes;
    let places = link(&mut table, &kinds, references, externals.len())?;
    let externals_at = HEADER_WORDS + table.len() * NODE_WORDS;
    let parts_at = externals_at + EXTERNAL_WORDS * externals.len();
    let mut words = Vec::with_capacity(size);
    words.extend([
        table.len() as u32 | (externals.len() as u32) << 16,
        triangles as u32 | (parts.len() as u32) << 16,
        externals_at as u32,
        parts_at as u32,
        (parts_at + parts.len()) as u32,
    ]);
    words.extend(voxel_header);
    words.extend(transmitting);
    words.extend_from_slice(bytemuck::cast_slice(&table));
    words.extend(externals.iter().zip(places).flat_map(|(&[id, child], place)| [id, child, place]));
    words.extend_from_slice(parts);
    words.extend_from_slice(&voxel_words);
    words.extend_from_slice(own);
    words.resize(size, 0);
    Ok(words)
}

/// Numbers the children of all nodes in the order of a preorder walk. Returns node and slot of each external reference
/// (see `layout.rs`).
#[inline(always)]
fn link(nodes: &mut [Node], kinds: &[u16], leaves: &[u16], externals: usize) -> Checked<Vec<u32>> {
    if !nodes
        .iter()
        .zip(kinds)
        .fold(true, |all, (node, kinds)| all & (in_pairs(node.valid) == (kinds | kinds >> 1) & 0x5555))
    {
        return wrong("the children of a node do not match its boxes");
    }
    let mut places = Vec::with_capacity(externals);
    let externals_at = HEADER_WORDS + nodes.len() * NODE_WORDS;
    let (mut next_node, mut next_leaf) = (0, 0);
    // Stack of nodes, each with the kinds of its children that are still to be numbered.
    let mut open: Vec<(usize, u16)> = Vec::new();
    while next_node < nodes.len() {
        // The next node without a parent: a further root.
        open.push((next_node, kinds[next_node]));
        next_node += 1;
        while let Some((node, kinds_left)) = open.pop() {
            // All leaves before the first other child are numbered at once, without a branch for each.
            let others = kinds_left & 0x5555;
            let before = others.wrapping_sub(1) & !others;
            let Some(window) = leaves.get(next_leaf..next_leaf + WIDTH) else { return wrong(MORE_CHILDREN) };
            next_leaf += refer_to_leaves(&mut nodes[node].child, kinds_left & before, window);
            if others == 0 {
                continue;
            }
            let slot = others.trailing_zeros() as usize / 2;
            let is_external = kinds_left >> (2 * slot) & 3 == 3;
            open.push((node, kinds_left & !before & !(3 << (2 * slot))));
            let child = if is_external && places.len() < externals {
                places.push(node as u32 | (slot as u32) << 16);
                Child::External(externals_at + (places.len() - 1) * EXTERNAL_WORDS)
            } else if !is_external && next_node < nodes.len() {
                open.push((next_node, kinds[next_node]));
                next_node += 1;
                Child::Node(next_node - 1)
            } else {
                return wrong(MORE_CHILDREN);
            };
            nodes[node].child[slot] = child.to_bits();
        }
    }
    match next_leaf.cmp(&(leaves.len() - WIDTH)) {
        Ordering::Greater => wrong(MORE_CHILDREN),
        Ordering::Equal if places.len() == externals => Ok(places),
        _ => wrong("a leaf or an external reference is never used"),
    }
}

const MORE_CHILDREN: &str = "a node has an invalid child reference";

/// Assigns the next of `leaves` to the slots of kind 2. Returns the number of these slots.
#[inline(always)]
fn refer_to_leaves(child: &mut [u16; WIDTH], kinds: u16, leaves: &[u16]) -> usize {
    let leaves: &[u16; WIDTH] = piece(leaves, 0);
    let mut next = 0;
    for (slot, child) in child.iter_mut().enumerate() {
        let is_leaf = kinds >> (2 * slot + 1) & 1;
        *child |= leaves[next & (WIDTH - 1)] & is_leaf.wrapping_neg();
        next += usize::from(is_leaf);
    }
    next
}

/// Moves each bit to the lower bit of a pair.
fn in_pairs(bits: u8) -> u16 {
    let bits = u16::from(bits);
    let bits = (bits | bits << 4) & 0x0f0f;
    let bits = (bits | bits << 2) & 0x3333;
    (bits | bits << 1) & 0x5555
}
