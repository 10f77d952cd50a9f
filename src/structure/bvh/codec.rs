//! The file form of a block: the trace form with everything left out that can be found again.
//!
//! | bytes | what |
//! |---|---|
//! | 1 | what follows |
//! | **1: nodes and leaves** | all of 2, then all of 3 |
//! | **2: nodes** | |
//! | 2 x 3 | u16: nodes, external references, leaves |
//! | 64 x nodes | nodes without child references, byte by byte: byte 0 of all nodes, byte 1 of all, ... |
//! | 2 x nodes | u16 a node: kind of each child, 2 bits a slot (0 none, 1 node, 2 leaf, 3 external) |
//! | 8 x externals | u32 block id, u32 child reference |
//! | 1 | u8: words of a voxel |
//! | 4 | u32: the part of all voxels, if those are short |
//! | 12 x voxels | both words of the first sample and the slabs, byte by byte: byte 0 of all voxels, byte 1 of all, ...; the count of sides is zero |
//! | 4 x voxels | with long voxels: part and whether mixed, byte by byte |
//! | 4 x mixed | with long voxels: summaries of those that are mixed |
//! | 48 x .. | the sides of voxels that have six, byte by byte |
//! | 2, leaves | not in 1: u16: where the first leaf begins in its block; u8: words of each |
//! | **3: leaves** | |
//! | 2 x 3 | u16: triangles, parts, leaves |
//! | 4 | u32: distinct vertices |
//! | 4 x parts | u32 |
//! | 3 x leaves | u8: triangles, vertices, flags of each leaf: three runs |
//! | 2 x .. | u16: part of each leaf, of each triangle where mixed |
//! | 3 x triangles | u8: the corners of each leaf as in the trace form, without padding |
//! | .. | for each leaf's vertices a variable-length number: 0 a new one, else how many back |
//! | 4 x vertices x 3 | x, y, z: difference to the one before, as ordered integers, zigzag, in four byte planes |
//! | **4: primitive ids** | u32 count, then zigzag differences as variable-length numbers |
//! | **5: colours** | u32 count, then red, green, blue, alpha: four runs of u8 |
//!
//! Child references need no bytes: nodes, leaves and external references are numbered in the order in
//! which a preorder walk meets them. Positions are kept to the bit.

use super::bytes::Reader;
pub use super::codec_beside::{decode_colours, decode_prims, encode_colours, encode_prims};
use super::codec_leaves::{Leaves, leaves_in_order, push_leaves, read_leaves};
use super::layout::{
    Block, Child, EXTERNAL_WORDS, HEADER_WORDS, LONG_VOXEL, MAX_TRIANGLES, MAX_VERTICES, MAX_WORDS, NODE_WORDS, Node, PAD_WORDS,
    SHORT_VOXEL, WIDTH, leaf_block_head, leaf_words,
};
use super::validate::validate;
use crate::lod::{Coded, SIDES_WORDS, summary_bit};

/// First byte of a payload.
const ALL: u8 = 1;
const NODES: u8 = 2;
const LEAVES: u8 = 3;
pub(super) const PRIMS: u8 = 4;
pub(super) const COLOURS: u8 = 5;

/// Bytes of a node before its child references.
const NODE_BYTES: usize = 64;

/// What is wrong with a payload, in a few words.
pub(super) type Checked<T> = Result<T, String>;

pub(super) fn wrong<T>(why: &str) -> Checked<T> {
    Err(why.to_string())
}

/// Encodes the trace form of a geometry block. `leaves`: that of its leaf block, if it has one.
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

fn push_nodes(out: &mut Vec<u8>, block: &Block, leaves: usize) {
    for count in [block.nodes(), block.externals(), leaves] {
        out.extend((count as u16).to_le_bytes());
    }
    let nodes: Vec<&Node> = (0..block.nodes()).map(|i| block.node(i)).collect();
    for byte in 0..NODE_BYTES {
        out.extend(nodes.iter().map(|n| bytemuck::bytes_of(*n)[byte]));
    }
    nodes.iter().for_each(|n| out.extend(kinds(n).to_le_bytes()));
    for (id, child) in block.all_externals() {
        out.extend(id.to_le_bytes());
        out.extend(child.to_le_bytes());
    }
    push_voxels(out, block);
}

fn push_voxels<'a>(out: &mut Vec<u8>, block: &Block<'a>) {
    let is_long = block.voxel_words() == LONG_VOXEL;
    out.push(block.voxel_words() as u8);
    out.extend(block.words()[7].to_le_bytes());
    let voxels: Vec<&[u32]> = (0..block.voxels()).map(|i| block.voxel_at(i)).collect();
    let children = |node: &'a Node| (0..WIDTH).filter(|slot| node.valid >> slot & 1 == 1).map(|slot| node.slabs[slot]);
    let slabs: Vec<u32> = (0..block.nodes()).flat_map(|i| children(block.node(i))).collect();
    let second = |v: &[u32]| if Coded::has_sides(v[0]) { 0 } else { v[1] };
    push_planes(out, voxels.iter().map(|v| v[0]));
    push_planes(out, voxels.iter().map(|v| second(v)));
    push_planes(out, slabs.iter().copied());
    if is_long {
        push_planes(out, voxels.iter().map(|v| v[2]));
        let mixed = voxels.iter().filter(|v| Coded::part(v[2]).1);
        mixed.for_each(|v| out.extend(v[3].to_le_bytes()));
    }
    let (from, to) = (block.sides_at(), block.first_leaf());
    for word in 0..SIDES_WORDS {
        push_planes(out, block.words()[from..to].iter().skip(word).step_by(SIDES_WORDS).copied());
    }
}

/// Words, byte by byte: the lowest of all, the next of all, and so on.
pub(super) fn push_planes(out: &mut Vec<u8>, words: impl Iterator<Item = u32> + Clone) {
    (0..4).for_each(|byte| out.extend(words.clone().map(|w| (w >> (8 * byte)) as u8)));
}

/// Undoes [`push_planes`].
pub(super) fn read_planes(reader: &mut Reader, count: usize) -> Checked<Vec<u32>> {
    let (a, b) = (reader.take(count)?, reader.take(count)?);
    let (c, d) = (reader.take(count)?, reader.take(count)?);
    // One after the other in all four: a loop that becomes vectors.
    let bytes = a.iter().zip(b).zip(c.iter().zip(d));
    Ok(bytes.map(|((a, b), (c, d))| u32::from_le_bytes([*a, *b, *c, *d])).collect())
}

/// Voxels of a block: the words of the header that tell of them, and all after the parts and before the leaves.
/// Nodes get their children's slabs.
fn read_voxels(reader: &mut Reader, nodes: &mut [Node]) -> Checked<([u32; 3], Vec<u32>)> {
    let size = usize::from(reader.u8()?);
    if ![SHORT_VOXEL, LONG_VOXEL].contains(&size) {
        return wrong("its voxels have an impossible size");
    }
    let part = reader.u32()?;
    let count = nodes.iter().map(|n| n.valid.count_ones() as usize).sum();
    let (firsts, mut seconds) = (read_planes(reader, count)?, read_planes(reader, count)?);
    let slabs = read_planes(reader, count)?;
    let parts = if size == LONG_VOXEL { read_planes(reader, count)? } else { Vec::new() };
    let mut summaries = Vec::with_capacity(parts.len());
    for &word in &parts {
        let (part, is_mixed) = Coded::part(word);
        summaries.push(if is_mixed { reader.u32()? } else { summary_bit(part) });
    }
    let mut six_sided = 0;
    for (_, second) in firsts.iter().zip(&mut seconds).filter(|(first, _)| Coded::has_sides(**first)) {
        if *second != 0 || six_sided > 0xffff {
            return wrong("a voxel's sides are counted");
        }
        *second = six_sided;
        six_sided += 1;
    }
    let sides = (0..SIDES_WORDS).map(|_| read_planes(reader, six_sided as usize)).collect::<Checked<Vec<_>>>()?;
    let mut words = Vec::with_capacity(nodes.len() + count * size + six_sided as usize * SIDES_WORDS);
    let mut voxels = 0;
    for node in nodes {
        words.push(voxels);
        let valid = node.valid;
        for slot in (0..WIDTH).filter(|slot| valid >> slot & 1 == 1) {
            node.set_slabs(slot, slabs[voxels as usize], firsts[voxels as usize] as u16);
            voxels += 1;
        }
    }
    for i in 0..count {
        words.extend([firsts[i], seconds[i]]);
        if size == LONG_VOXEL {
            words.extend([parts[i], summaries[i]]);
        }
    }
    (0..six_sided as usize).for_each(|i| words.extend(sides.iter().map(|word| word[i])));
    Ok(([voxels | six_sided << 16, size as u32, part], words))
}

/// Kinds of a node's children, 2 bits a slot.
fn kinds(node: &Node) -> u16 {
    (0..WIDTH).filter(|s| node.valid >> s & 1 == 1).fold(0, |bits, slot| {
        let kind = match Child::from_bits(u32::from(node.child[slot])) {
            Some(Child::Node(_)) => 1,
            Some(Child::Leaf(_)) => 2,
            _ => 3,
        };
        bits | kind << (2 * slot)
    })
}

/// What a block may be.
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

/// What a block is, and what its references may point at.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// The block's own id.
    pub id: u32,
    /// One past the last block of its tree that has nodes.
    pub end: u32,
    /// What it must be.
    pub holds: Holds,
}

/// Nodes as read.
struct Nodes {
    table: Vec<Node>,
    kinds: Vec<u16>,
    externals: Vec<[u32; 2]>,
    leaves: usize,
    /// Header words of the voxels, but for where they begin, and the voxels.
    voxels: ([u32; 3], Vec<u32>),
}

/// Decodes a geometry block and checks all that a walk relies on.
pub fn decode_geometry(payload: &[u8], place: Place) -> Checked<Vec<u32>> {
    let mut reader = Reader::new(payload);
    let kind = match place.holds {
        Holds::All => ALL,
        Holds::Nodes | Holds::NodesOverLeaves => NODES,
        Holds::Leaves => LEAVES,
    };
    if reader.u8()? != kind {
        return wrong("not the kind of block that it should be");
    }
    let words = match place.holds {
        Holds::All => {
            let (nodes, leaves) = (read_nodes(&mut reader, place)?, read_leaves(&mut reader)?);
            if leaves.starts.len() != nodes.leaves {
                return wrong("its leaves do not add up");
            }
            let at = nodes_end(&nodes) + leaves.parts.len();
            let starts: Vec<usize> = leaves.starts.iter().map(|start| at + start).collect();
            trace_form(nodes, &starts, Some(leaves))?
        }
        Holds::Leaves => leaf_block(read_leaves(&mut reader)?),
        Holds::Nodes | Holds::NodesOverLeaves => {
            let nodes = read_nodes(&mut reader, place)?;
            let starts = read_starts(&mut reader, nodes.leaves)?;
            if place.holds == Holds::Nodes && !starts.is_empty() {
                return wrong("it holds leaves, and is coarse");
            }
            trace_form(nodes, &starts, None)?
        }
    };
    reader.end()?;
    debug_assert_eq!(validate(&words, place), Ok(()));
    Ok(words)
}

/// Words of nodes' part of a block, without the parts.
fn nodes_end(nodes: &Nodes) -> usize {
    HEADER_WORDS + nodes.table.len() * NODE_WORDS + nodes.externals.len() * EXTERNAL_WORDS + nodes.voxels.1.len()
}

/// Words of leaves: one triangle, and eight over sixteen vertices in several parts.
const LEAST_LEAF: usize = leaf_words(1, 3, false);
const LARGEST_LEAF: usize = leaf_words(MAX_TRIANGLES, MAX_VERTICES, true);

/// Where the leaves of a leaf block begin.
fn read_starts(reader: &mut Reader, leaves: usize) -> Checked<Vec<usize>> {
    let mut at = usize::from(reader.u16()?);
    let mut starts = Vec::with_capacity(leaves);
    if at < HEADER_WORDS && leaves > 0 {
        return wrong("its leaves begin where none can");
    }
    for &words in reader.take(leaves)? {
        if !(LEAST_LEAF..=LARGEST_LEAF).contains(&usize::from(words)) {
            return wrong("a leaf has a size that none has");
        }
        starts.push(at);
        at += usize::from(words);
    }
    if at + PAD_WORDS > MAX_WORDS { wrong("its leaves do not fit a block") } else { Ok(starts) }
}

/// A block of leaves.
fn leaf_block(leaves: Leaves) -> Vec<u32> {
    let begin = leaves.begin();
    let Leaves { triangles, parts, mut words, .. } = leaves;
    words[..8].copy_from_slice(&leaf_block_head(triangles, parts.len()));
    words[HEADER_WORDS..begin].copy_from_slice(&parts);
    words
}

/// A block of nodes whose leaves begin at the places given, and of these if they are in it.
fn trace_form(nodes: Nodes, starts: &[usize], leaves: Option<Leaves>) -> Checked<Vec<u32>> {
    let parts: &[u32] = leaves.as_ref().map_or(&[], |leaves| &leaves.parts);
    let triangles = leaves.as_ref().map_or(0, |leaves| leaves.triangles);
    let own = leaves.as_ref().map_or(&[][..], Leaves::own);
    // Before references are made, which have room for no more.
    let size = nodes_end(&nodes) + parts.len() + own.len() + PAD_WORDS;
    if size > MAX_WORDS {
        return wrong("it is larger than a block may be");
    }
    let Nodes { mut table, kinds, externals, voxels: (voxel_header, voxel_words), .. } = nodes;
    let places = link(&mut table, &kinds, starts, externals.len())?;
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
    words.resize(HEADER_WORDS, 0);
    words.extend_from_slice(bytemuck::cast_slice(&table));
    words.extend(externals.iter().zip(places).flat_map(|(&[id, child], place)| [id, child, place]));
    words.extend_from_slice(parts);
    words.extend_from_slice(&voxel_words);
    words.extend_from_slice(own);
    words.resize(size, 0);
    Ok(words)
}

fn read_nodes(reader: &mut Reader, place: Place) -> Checked<Nodes> {
    let mut count = || reader.u16().map(usize::from);
    let (nodes, externals, leaves) = (count()?, count()?, count()?);
    if HEADER_WORDS + nodes * NODE_WORDS + EXTERNAL_WORDS * externals + PAD_WORDS > MAX_WORDS || nodes == 0 {
        return wrong("its counts do not fit a block");
    }
    let mut table = read_table(reader, nodes)?;
    let kinds: Vec<u16> = (0..nodes).map(|_| reader.u16()).collect::<Checked<_>>()?;
    let externals = read_externals(reader, externals, place)?;
    let voxels = read_voxels(reader, &mut table)?;
    Ok(Nodes { table, kinds, externals, leaves, voxels })
}

fn read_table(reader: &mut Reader, nodes: usize) -> Checked<Vec<Node>> {
    let bytes = reader.take(NODE_BYTES * nodes)?;
    let mut table: Vec<Node> = vec![bytemuck::Zeroable::zeroed(); nodes];
    for (b, column) in bytes.chunks_exact(nodes).enumerate() {
        let raw: &mut [u8] = bytemuck::must_cast_slice_mut(&mut table);
        for (node, byte) in raw.chunks_exact_mut(size_of::<Node>()).zip(column) {
            node[b] = *byte;
        }
    }
    for node in &table {
        let grid_ok = node.exponent.iter().all(|e| (1..=254).contains(e));
        if !grid_ok || !node.origin.iter().all(|o| o.is_finite()) || node.valid == 0 {
            return wrong("a node's grid is impossible");
        }
        let ordered = |slot: usize| (0..3).all(|a| node.planes[a][slot] <= node.planes[a + 3][slot]);
        if !(0..WIDTH).filter(|s| node.valid >> s & 1 == 1).all(ordered) {
            return wrong("a node's box is inside out");
        }
    }
    Ok(table)
}

fn read_externals(reader: &mut Reader, count: usize, place: Place) -> Checked<Vec<[u32; 2]>> {
    let mut words = Vec::with_capacity(count);
    for _ in 0..count {
        let (id, child) = (reader.u32()?, reader.u32()?);
        // Always to a later block: no chain of references comes back.
        if id <= place.id || id >= place.end {
            return wrong("it refers to a block that it cannot refer to");
        }
        if !matches!(Child::from_bits(child), Some(Child::Node(_))) || child > u32::from(u16::MAX) {
            return wrong("it refers to something that is not a node");
        }
        words.push([id, child]);
    }
    Ok(words)
}

/// Numbers the children of all nodes in the order in which a preorder walk meets them; returns where each external
/// reference hangs (see `layout.rs`).
fn link(nodes: &mut [Node], kinds: &[u16], leaves: &[usize], externals: usize) -> Checked<Vec<u32>> {
    let mut places = Vec::with_capacity(externals);
    let externals_at = HEADER_WORDS + nodes.len() * NODE_WORDS;
    let (mut next_node, mut next_leaf, mut next_external) = (0, 0, 0);
    // (node, next slot)
    let mut open: Vec<(usize, usize)> = Vec::new();
    while next_node < nodes.len() {
        // A further root.
        open.push((next_node, 0));
        next_node += 1;
        while let Some((node, slot)) = open.pop() {
            if slot == WIDTH {
                continue;
            }
            open.push((node, slot + 1));
            let kind = kinds[node] >> (2 * slot) & 3;
            if (kind != 0) != (nodes[node].valid >> slot & 1 == 1) {
                return wrong("a node's children and their boxes disagree");
            }
            let child = match kind {
                1 if next_node < nodes.len() => {
                    open.push((next_node, 0));
                    next_node += 1;
                    Child::Node(next_node - 1)
                }
                2 if next_leaf < leaves.len() => {
                    next_leaf += 1;
                    Child::Leaf(leaves[next_leaf - 1])
                }
                3 if next_external < externals => {
                    next_external += 1;
                    places.push(node as u32 | (slot as u32) << 16);
                    Child::External(externals_at + (next_external - 1) * EXTERNAL_WORDS)
                }
                0 => continue,
                _ => return wrong("a node has more children than there are"),
            };
            nodes[node].child[slot] = child.to_bits();
        }
    }
    let all = next_leaf == leaves.len() && next_external == externals;
    if all { Ok(places) } else { wrong("something in it is never referred to") }
}
