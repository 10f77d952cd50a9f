//! The file form of a block: the trace form with everything left out that can be found again.
//!
//! | bytes | what |
//! |---|---|
//! | 1 | 1: geometry, 2: primitive ids, 3: colours |
//! | **geometry** | |
//! | 2 x 5 | u16: nodes, external references, triangles, parts, leaves |
//! | 4 | u32: distinct vertices |
//! | 64 x nodes | nodes without child references, byte by byte: byte 0 of all nodes, byte 1 of all, ... |
//! | 2 x nodes | u16 a node: kind of each child, 2 bits a slot (0 none, 1 node, 2 leaf, 3 external) |
//! | 8 x externals | u32 block id, u32 child reference |
//! | 4 x parts | u32 |
//! | 1 | u8: words of a voxel |
//! | 4 | u32: the part of all voxels, if those are short |
//! | 8 x voxels | both words of the first sample, byte by byte: byte 0 of all voxels, byte 1 of all, ...; the count of sides is zero |
//! | 4 x voxels | with long voxels: part and whether mixed, byte by byte |
//! | 4 x mixed | with long voxels: summaries of those that are mixed |
//! | 48 x .. | the sides of voxels that have six, byte by byte |
//! | 3 x leaves | u8: triangles, vertices, flags of each leaf: three runs |
//! | 2 x .. | u16: part of each leaf, of each triangle where mixed |
//! | 3 x triangles | u8: the corners of each leaf as in the trace form, without padding |
//! | .. | for each leaf's vertices a variable-length number: 0 a new one, else how many back |
//! | 4 x vertices x 3 | x, y, z: difference to the one before, as ordered integers, zigzag, in four byte planes |
//! | **primitive ids** | u32 count, then zigzag differences as variable-length numbers |
//! | **colours** | u32 count, then red, green, blue, alpha: four runs of u8 |
//!
//! Child references need no bytes: nodes, leaves and external references are numbered in the order in
//! which a preorder walk meets them. Positions are kept to the bit.

use super::bytes::{Reader, push_varint, unzigzag, zigzag};
use super::layout::{
    Block, Child, EXTERNAL_WORDS, HEADER_WORDS, LEAF_MIXED, LONG_VOXEL, MAX_TRIANGLES, MAX_VERTICES, MAX_WORDS, NODE_WORDS,
    Node, PAD_WORDS, SHORT_VOXEL,
    WIDTH, index_words, leaf_words,
};
use super::validate::validate;
use crate::lod::{Coded, SIDES_WORDS, summary_bit};
use std::collections::HashMap;
use std::hash::Hasher;

/// First byte of a payload.
const GEOMETRY: u8 = 1;
const PRIMS: u8 = 2;
const COLOURS: u8 = 3;

/// Bytes of a node before its child references.
const NODE_BYTES: usize = 64;

/// What is wrong with a payload, in a few words.
type Checked<T> = Result<T, String>;

fn wrong<T>(why: &str) -> Checked<T> {
    Err(why.to_string())
}

/// Encodes the trace form of a geometry block.
pub fn encode_geometry(words: &[u32]) -> Vec<u8> {
    let block = Block::new(words);
    let leaves = leaves_in_order(&block);
    let (indices, vertices) = share_vertices(&block, &leaves);
    let mut out = vec![GEOMETRY];
    for count in [block.nodes(), block.externals(), block.triangles(), block.parts(), leaves.len()] {
        out.extend((count as u16).to_le_bytes());
    }
    out.extend((vertices.len() as u32).to_le_bytes());
    let nodes: Vec<&Node> = (0..block.nodes()).map(|i| block.node(i)).collect();
    for byte in 0..NODE_BYTES {
        out.extend(nodes.iter().map(|n| bytemuck::bytes_of(*n)[byte]));
    }
    nodes.iter().for_each(|n| out.extend(kinds(n).to_le_bytes()));
    for (id, child) in (0..block.externals()).map(|i| block.external(i)) {
        out.extend(id.to_le_bytes());
        out.extend(child.to_le_bytes());
    }
    (0..block.parts()).for_each(|i| out.extend(block.part(i).to_le_bytes()));
    push_voxels(&mut out, &block);
    let leaf = |at: usize| block.leaf(at);
    out.extend(leaves.iter().map(|&at| leaf(at).triangles as u8));
    out.extend(leaves.iter().map(|&at| leaf(at).vertices as u8));
    out.extend(leaves.iter().map(|&at| u8::from(leaf(at).is_mixed())));
    for leaf in leaves.iter().map(|&at| leaf(at)) {
        let parts = if leaf.is_mixed() { leaf.triangles } else { 1 };
        (0..parts).for_each(|i| out.extend((leaf.part_of(i) as u16).to_le_bytes()));
    }
    for leaf in leaves.iter().map(|&at| leaf(at)) {
        (0..3).for_each(|c| out.extend(&leaf.corners8(c)[..leaf.triangles]));
    }
    out.extend(indices);
    for axis in 0..3 {
        push_coordinates(&mut out, vertices.iter().map(|v| v[axis]));
    }
    out
}

fn push_voxels(out: &mut Vec<u8>, block: &Block) {
    let is_long = block.voxel_words() == LONG_VOXEL;
    out.push(block.voxel_words() as u8);
    out.extend(block.words()[7].to_le_bytes());
    let voxels: Vec<&[u32]> = (0..block.voxels()).map(|i| block.voxel_at(i)).collect();
    let first = |v: &[u32]| if Coded::has_sides(v[0]) { v[0] & !0xffff } else { v[0] };
    push_planes(out, voxels.iter().map(|v| first(v)));
    push_planes(out, voxels.iter().map(|v| v[1]));
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
fn push_planes(out: &mut Vec<u8>, words: impl Iterator<Item = u32> + Clone) {
    (0..4).for_each(|byte| out.extend(words.clone().map(|w| (w >> (8 * byte)) as u8)));
}

fn read_planes(reader: &mut Reader, count: usize) -> Checked<Vec<u32>> {
    let planes = reader.take(4 * count)?;
    let byte = |p: usize, i: usize| u32::from(planes[p * count + i]) << (8 * p);
    Ok((0..count).map(|i| (0..4).fold(0, |word, p| word | byte(p, i))).collect())
}

/// Voxels of a block: the words of the header that tell of them, and all after the parts and before the leaves.
fn read_voxels(reader: &mut Reader, nodes: &[Node], nodes_end: usize) -> Checked<([u32; 4], Vec<u32>)> {
    let size = usize::from(reader.u8()?);
    if ![SHORT_VOXEL, LONG_VOXEL].contains(&size) {
        return wrong("its voxels have an impossible size");
    }
    let part = reader.u32()?;
    let count = nodes.iter().map(|n| n.valid.count_ones() as usize).sum();
    let (mut firsts, colours) = (read_planes(reader, count)?, read_planes(reader, count)?);
    let parts = if size == LONG_VOXEL { read_planes(reader, count)? } else { Vec::new() };
    let mut summaries = Vec::with_capacity(parts.len());
    for &word in &parts {
        let (part, is_mixed) = Coded::part(word);
        summaries.push(if is_mixed { reader.u32()? } else { summary_bit(part) });
    }
    let mut six_sided = 0;
    for first in firsts.iter_mut().filter(|first| Coded::has_sides(**first)) {
        if *first & 0xffff != 0 || six_sided > 0xffff {
            return wrong("a voxel's sides are counted");
        }
        *first |= six_sided;
        six_sided += 1;
    }
    let sides = (0..SIDES_WORDS).map(|_| read_planes(reader, six_sided as usize)).collect::<Checked<Vec<_>>>()?;
    let mut words = Vec::with_capacity(nodes.len() + count * size + six_sided as usize * SIDES_WORDS);
    let mut voxels = 0;
    for node in nodes {
        words.push(voxels);
        voxels += node.valid.count_ones();
    }
    for i in 0..count {
        words.extend([firsts[i], colours[i]]);
        if size == LONG_VOXEL {
            words.extend([parts[i], summaries[i]]);
        }
    }
    (0..six_sided as usize).for_each(|i| words.extend(sides.iter().map(|word| word[i])));
    Ok(([nodes_end as u32, voxels | six_sided << 16, size as u32, part], words))
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

/// Where the leaves of a block begin, in the order in which they lie.
fn leaves_in_order(block: &Block) -> Vec<usize> {
    let mut leaves = Vec::new();
    let mut at = block.first_leaf();
    while at + PAD_WORDS < block.words().len() {
        leaves.push(at);
        at += block.leaf(at).len();
    }
    leaves
}

/// Numbers the vertices of a block anew, once each: references of the leaves, and the vertices' bits.
fn share_vertices(block: &Block, leaves: &[usize]) -> (Vec<u8>, Vec<[u32; 3]>) {
    let mut references = Vec::new();
    let mut vertices: Vec<[u32; 3]> = Vec::new();
    let corners = leaves.iter().map(|&at| block.leaf(at).vertices).sum();
    let mut known = HashMap::with_capacity_and_hasher(corners, BuildVertexHasher::default());
    for leaf in leaves.iter().map(|&at| block.leaf(at)) {
        let axes = [0, 1, 2].map(|a| leaf.coordinates16(a));
        for v in 0..leaf.vertices {
            let vertex = axes.map(|a| a[v].to_bits());
            let key = (u64::from(vertex[0]) << 32 | u64::from(vertex[1]), vertex[2]);
            let index = *known.entry(key).or_insert(vertices.len());
            push_varint(&mut references, (vertices.len() - index) as u32);
            if index == vertices.len() {
                vertices.push(vertex);
            }
        }
    }
    (references, vertices)
}

type BuildVertexHasher = std::hash::BuildHasherDefault<VertexHasher>;

/// Enough for the vertices of one block, and a tenth of the time of a general hash.
#[derive(Default)]
struct VertexHasher(u64);

impl Hasher for VertexHasher {
    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&b| self.write_u64(u64::from(b)));
    }

    fn write_u32(&mut self, x: u32) {
        self.write_u64(u64::from(x));
    }

    fn write_u64(&mut self, x: u64) {
        // An odd number near 2^64 divided by the golden ratio; the table takes its bits from both ends.
        let product = u128::from(self.0 ^ x ^ 0x2545_F491_4F6C_DD1D) * 0x9E37_79B9_7F4A_7C15;
        self.0 = product as u64 ^ (product >> 64) as u64;
    }

    fn finish(&self) -> u64 {
        self.0
    }
}

/// Floats of one sign order like integers; the other half mirrored.
fn ordered(bits: u32) -> u32 {
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

fn unordered(value: u32) -> u32 {
    if value >> 31 == 1 { value & !(1 << 31) } else { !value }
}

fn push_coordinates(out: &mut Vec<u8>, bits: impl Iterator<Item = u32>) {
    let mut before = 0u32;
    let coded: Vec<u32> = bits
        .map(|b| {
            let now = ordered(b);
            let difference = now.wrapping_sub(before) as i32;
            before = now;
            zigzag(difference)
        })
        .collect();
    for plane in 0..4 {
        out.extend(coded.iter().map(|c| (c >> (8 * plane)) as u8));
    }
}

fn read_coordinates(reader: &mut Reader, count: usize) -> Checked<Vec<u32>> {
    let planes = reader.take(4 * count)?;
    let mut before = 0u32;
    let value = |i: usize| {
        let coded = (0..4).fold(0, |c, p| c | u32::from(planes[p * count + i]) << (8 * p));
        before = before.wrapping_add(unzigzag(coded) as u32);
        unordered(before)
    };
    Ok((0..count).map(value).collect())
}

/// What a block's references may point at.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// The block's own id.
    pub id: u32,
    /// One past the last geometry block of its tree.
    pub end: u32,
}

struct Counts {
    triangles: usize,
    parts: usize,
    leaves: usize,
    vertices: usize,
}

/// Decodes a geometry block and checks all that a walk relies on.
pub fn decode_geometry(payload: &[u8], place: Place) -> Checked<Vec<u32>> {
    let mut reader = Reader::new(payload);
    if reader.u8()? != GEOMETRY {
        return wrong("not a geometry block");
    }
    let mut count = || reader.u16().map(usize::from);
    let (nodes, externals, triangles, parts, leaves) = (count()?, count()?, count()?, count()?, count()?);
    let vertices = reader.u32()? as usize;
    let counts = Counts { triangles, parts, leaves, vertices };
    let externals_at = HEADER_WORDS + nodes * NODE_WORDS;
    let parts_at = externals_at + EXTERNAL_WORDS * externals;
    if parts_at + parts + PAD_WORDS > MAX_WORDS || nodes == 0 {
        return wrong("its counts do not fit a block");
    }
    let mut words = vec![
        nodes as u32 | (externals as u32) << 16,
        triangles as u32 | (parts as u32) << 16,
        externals_at as u32,
        parts_at as u32,
    ];
    let mut table = read_nodes(&mut reader, nodes)?;
    let kinds: Vec<u16> = (0..nodes).map(|_| reader.u16()).collect::<Checked<_>>()?;
    let links = read_externals(&mut reader, externals, place)?;
    let part_list: Vec<u32> = (0..parts).map(|_| reader.u32()).collect::<Checked<_>>()?;
    if !part_list.is_sorted_by(|a, b| a < b) {
        return wrong("its parts are not in order");
    }
    let (voxel_header, voxel_words) = read_voxels(&mut reader, &table, parts_at + parts)?;
    words.extend(voxel_header);
    let leaves_at = parts_at + parts + voxel_words.len();
    if leaves_at + PAD_WORDS > MAX_WORDS {
        return wrong("its counts do not fit a block");
    }
    let (leaf_words, starts) = read_leaves(&mut reader, &counts, leaves_at)?;
    reader.end()?;
    let places = link(&mut table, &kinds, &starts, externals)?;
    for node in &table {
        words.extend(bytemuck::must_cast::<Node, [u32; NODE_WORDS]>(*node));
    }
    words.extend(links.iter().zip(places).flat_map(|(&[id, child], place)| [id, child, place]));
    words.extend(part_list);
    words.extend(voxel_words);
    words.extend(leaf_words);
    words.extend([0; PAD_WORDS]);
    if words.len() > MAX_WORDS {
        return wrong("it is larger than a block may be");
    }
    debug_assert_eq!(validate(&words, place), Ok(()));
    Ok(words)
}

fn read_nodes(reader: &mut Reader, nodes: usize) -> Checked<Vec<Node>> {
    let bytes = reader.take(NODE_BYTES * nodes)?;
    let mut table: Vec<Node> = vec![bytemuck::Zeroable::zeroed(); nodes];
    for (i, node) in table.iter_mut().enumerate() {
        let raw = bytemuck::bytes_of_mut(node);
        (0..NODE_BYTES).for_each(|b| raw[b] = bytes[b * nodes + i]);
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

/// The words of all leaves, and where each begins when the first begins at `at`.
fn read_leaves(reader: &mut Reader, counts: &Counts, at: usize) -> Checked<(Vec<u32>, Vec<usize>)> {
    let n = counts.leaves;
    let (triangles, vertices, mixed) = (reader.take(n)?, reader.take(n)?, reader.take(n)?);
    let sizes_ok = triangles.iter().all(|t| (1..=MAX_TRIANGLES).contains(&usize::from(*t)))
        && vertices.iter().all(|v| (3..=MAX_VERTICES).contains(&usize::from(*v)))
        && mixed.iter().all(|m| *m <= 1);
    let sum: usize = triangles.iter().map(|t| usize::from(*t)).sum();
    if !sizes_ok || sum != counts.triangles {
        return wrong("its leaves do not add up");
    }
    // Of each leaf one, or of a mixed one that of each triangle.
    let of_leaf = |(t, m): (&u8, &u8)| if *m == 1 { usize::from(*t) } else { 1 };
    let all_parts = reader.take(2 * triangles.iter().zip(mixed).map(of_leaf).sum::<usize>())?;
    let parts: Vec<u16> = all_parts.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    if parts.iter().any(|p| usize::from(*p) >= counts.parts) {
        return wrong("a triangle's part is not in its table");
    }
    let mut parts = &parts[..];
    let corners = reader.take(3 * sum)?;
    let total: usize = vertices.iter().map(|v| usize::from(*v)).sum();
    let references = read_references(reader, total, counts.vertices)?;
    let axes = [(); 3].map(|_| read_coordinates(reader, counts.vertices));
    let [x, y, z] = axes;
    let axes = [x?, y?, z?];
    if axes.iter().flatten().any(|b| !f32::from_bits(*b).is_finite()) {
        return wrong("a vertex is not finite");
    }

    let room = n * leaf_words(1, 0, false) + total * 3 + sum;
    let (mut words, mut starts) = (Vec::with_capacity(room), Vec::with_capacity(n));
    let (mut first, mut first_vertex) = (0, 0);
    for i in 0..n {
        let (t, v, m) = (usize::from(triangles[i]), usize::from(vertices[i]), mixed[i] == 1);
        starts.push(at + words.len());
        let corners = &corners[3 * first..3 * (first + t)];
        if corners.iter().any(|c| usize::from(*c) >= v) {
            return wrong("a corner is not among its leaf's vertices");
        }
        let end = words.len() + leaf_words(t, v, m);
        let flags = if m { u32::from(LEAF_MIXED) } else { 0 };
        words.push(t as u32 | (v as u32) << 8 | (first as u32) << 16);
        let (own, others) = parts.split_at(if m { t } else { 1 });
        parts = others;
        words.push(u32::from(own[0]) | flags << 16);
        if m {
            let pair = |p: &[u16]| u32::from(p[0]) | p.get(1).map_or(0, |q| u32::from(*q)) << 16;
            words.extend(own.chunks(2).map(pair));
        }
        let mut bytes = [0u8; 4 * index_words(MAX_TRIANGLES)];
        bytes[..3 * t].copy_from_slice(corners);
        let word = |b: &[u8]| u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        words.extend(bytes[..4 * index_words(t)].chunks_exact(4).map(word));
        for axis in &axes {
            words.extend(references[first_vertex..first_vertex + v].iter().map(|r| axis[*r]));
        }
        debug_assert_eq!(words.len(), end);
        first += t;
        first_vertex += v;
    }
    Ok((words, starts))
}

/// Indices among the distinct vertices of all leaves' vertices.
fn read_references(reader: &mut Reader, total: usize, vertices: usize) -> Checked<Vec<usize>> {
    let mut known = 0;
    let mut references = Vec::with_capacity(total);
    for _ in 0..total {
        let back = reader.varint()? as usize;
        if back > known {
            return wrong("a vertex reference reaches before the first");
        }
        if back == 0 {
            known += 1;
            references.push(known - 1);
        } else {
            references.push(known - back);
        }
    }
    if known == vertices { Ok(references) } else { wrong("its vertices do not add up") }
}

/// Numbers the children of all nodes in the order in which a preorder walk meets them; returns where each external
/// reference hangs (see `layout.rs`).
fn link(nodes: &mut [Node], kinds: &[u16], leaves: &[usize], externals: usize) -> Checked<Vec<u32>> {
    let mut places = Vec::with_capacity(externals);
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
                    Child::External(next_external - 1)
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

/// Encodes the primitive ids of a block.
pub fn encode_prims(prims: &[u32]) -> Vec<u8> {
    let mut out = vec![PRIMS];
    out.extend((prims.len() as u32).to_le_bytes());
    let mut before = 0u32;
    for &p in prims {
        push_varint(&mut out, zigzag(p.wrapping_sub(before) as i32));
        before = p;
    }
    out
}

/// Decodes the primitive ids of a block: one word each.
pub fn decode_prims(payload: &[u8]) -> Checked<Vec<u32>> {
    let mut reader = Reader::new(payload);
    if reader.u8()? != PRIMS {
        return wrong("not a block of primitive ids");
    }
    let count = reader.u32()? as usize;
    if count > reader.left() {
        return wrong("it has fewer ids than it says");
    }
    let mut before = 0u32;
    let mut next = || -> Checked<u32> {
        before = before.wrapping_add(unzigzag(reader.varint()?) as u32);
        Ok(before)
    };
    let prims = (0..count).map(|_| next()).collect::<Checked<Vec<u32>>>()?;
    reader.end()?;
    Ok(prims)
}

/// Encodes the colours of a block's triangles.
pub fn encode_colours(colours: &[[u8; 4]]) -> Vec<u8> {
    let mut out = vec![COLOURS];
    out.extend((colours.len() as u32).to_le_bytes());
    (0..4).for_each(|channel| out.extend(colours.iter().map(|c| c[channel])));
    out
}

/// Decodes the colours of a block's triangles: one word each, red in the lowest byte.
pub fn decode_colours(payload: &[u8]) -> Checked<Vec<u32>> {
    let mut reader = Reader::new(payload);
    if reader.u8()? != COLOURS {
        return wrong("not a block of colours");
    }
    let count = reader.u32()? as usize;
    if reader.left() != count.saturating_mul(4) {
        return wrong("its colours do not add up");
    }
    let runs = reader.take(4 * count)?;
    let colour = |i: usize| u32::from_le_bytes([0, 1, 2, 3].map(|c| runs[c * count + i]));
    Ok((0..count).map(colour).collect())
}
