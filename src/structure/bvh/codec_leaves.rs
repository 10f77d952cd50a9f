//! The leaves of a block in the file form: see `codec.rs`, of which this is section 3.

use super::bytes::{Reader, push_varint, unzigzag, zigzag};
use super::codec::{Checked, push_planes, read_planes, wrong};
use super::layout::{Block, HEADER_WORDS, LEAF_MIXED, MAX_TRIANGLES, MAX_VERTICES, MAX_WORDS, PAD_WORDS, index_words, leaf_words};
use std::collections::HashMap;
use std::hash::Hasher;

/// Leaves as read.
pub(super) struct Leaves {
    pub triangles: usize,
    pub parts: Vec<u32>,
    /// Those of a leaf block: zeros in place of its header and its parts, the leaves, and the zeros behind them.
    pub words: Vec<u32>,
    /// Where each begins, from the first.
    pub starts: Vec<usize>,
}

impl Leaves {
    /// Where the first begins in `words`.
    pub fn begin(&self) -> usize {
        HEADER_WORDS + self.parts.len()
    }

    /// Their own words.
    pub fn own(&self) -> &[u32] {
        &self.words[self.begin()..self.words.len() - PAD_WORDS]
    }
}

/// Appends the leaves of a block.
pub(super) fn push_leaves(out: &mut Vec<u8>, block: &Block) {
    let leaves: Vec<usize> = leaves_in_order(block).into_iter().map(usize::from).collect();
    let (indices, vertices) = share_vertices(block, &leaves);
    for count in [block.triangles(), block.parts(), leaves.len()] {
        out.extend((count as u16).to_le_bytes());
    }
    out.extend((vertices.len() as u32).to_le_bytes());
    (0..block.parts()).for_each(|i| out.extend(block.part(i).to_le_bytes()));
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
        push_coordinates(out, vertices.iter().map(|v| v[axis]));
    }
}

/// Where the leaves of a block begin, in the order in which they lie.
pub(super) fn leaves_in_order(block: &Block) -> Vec<u16> {
    let mut leaves = Vec::with_capacity(block.triangles());
    let mut at = block.first_leaf();
    while at + PAD_WORDS < block.words().len() {
        leaves.push(at as u16);
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
    push_planes(out, coded.iter().copied());
}

/// The bits of all vertices' coordinates, and a zero behind each vertex. In loops that become vectors, but for the sums.
fn read_vertices(reader: &mut Reader, count: usize) -> Checked<Vec<[u32; 4]>> {
    let mut steps = [read_planes(reader, count)?, read_planes(reader, count)?, read_planes(reader, count)?];
    for steps in &mut steps {
        steps.iter_mut().for_each(|step| *step = unzigzag(*step) as u32);
    }
    let [x, y, z] = &steps;
    let mut vertices = Vec::with_capacity(count);
    let mut sum = [0u32, 0, 0, ordered(0)];
    vertices.extend(x.iter().zip(y).zip(z).map(|((x, y), z)| {
        for (sum, step) in sum.iter_mut().zip([x, y, z]) {
            *sum = sum.wrapping_add(*step);
        }
        sum
    }));
    let mut infinite = 0;
    for word in vertices.as_flattened_mut() {
        *word = unordered(*word);
        infinite |= u32::from(*word & EXPONENT == EXPONENT);
    }
    if infinite == 0 { Ok(vertices) } else { wrong("a vertex is not finite") }
}

/// Of a float: all bits of it are set where it is infinite or no number.
const EXPONENT: u32 = 0x7f80_0000;

struct Counts {
    triangles: usize,
    parts: usize,
    leaves: usize,
    vertices: usize,
}

/// Reads the leaves of a block, and checks them.
pub(super) fn read_leaves(reader: &mut Reader) -> Checked<Leaves> {
    let mut count = || reader.u16().map(usize::from);
    let (triangles, parts, leaves) = (count()?, count()?, count()?);
    let counts = Counts { triangles, parts, leaves, vertices: reader.u32()? as usize };
    let parts: Vec<u32> = (0..parts).map(|_| reader.u32()).collect::<Checked<_>>()?;
    if leaves == 0 {
        return wrong("it has no leaves");
    }
    if !parts.is_sorted_by(|a, b| a < b) {
        return wrong("its parts are not in order");
    }
    let (words, starts) = read_triangles(reader, &counts)?;
    Ok(Leaves { triangles, parts, words, starts })
}

/// [`Leaves::words`] and [`Leaves::starts`].
fn read_triangles(reader: &mut Reader, counts: &Counts) -> Checked<(Vec<u32>, Vec<usize>)> {
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
    let all_vertices = read_vertices(reader, counts.vertices)?;

    let sizes = || (0..n).map(|i| leaf_words(triangles[i].into(), vertices[i].into(), mixed[i] == 1));
    let begin = HEADER_WORDS + counts.parts;
    let end = begin + sizes().sum::<usize>();
    if end + PAD_WORDS > MAX_WORDS {
        return wrong("it is larger than a block may be");
    }
    let (mut words, mut starts) = (vec![0; end + PAD_WORDS], Vec::with_capacity(n));
    let (mut at, mut first, mut first_vertex) = (begin, 0, 0);
    for (i, size) in sizes().enumerate() {
        let (t, v, m) = (usize::from(triangles[i]), usize::from(vertices[i]), mixed[i] == 1);
        starts.push(at - begin);
        let leaf = &mut words[at..at + size];
        let (own, others) = parts.split_at(if m { t } else { 1 });
        parts = others;
        let flags = if m { u32::from(LEAF_MIXED) } else { 0 };
        leaf[0] = t as u32 | (v as u32) << 8 | (first as u32) << 16;
        leaf[1] = u32::from(own[0]) | flags << 16;
        let mut rest = &mut leaf[2..];
        if m {
            let (pairs, behind) = rest.split_at_mut(t.div_ceil(2));
            for (word, pair) in pairs.iter_mut().zip(own.chunks(2)) {
                *word = u32::from(pair[0]) | pair.get(1).map_or(0, |q| u32::from(*q)) << 16;
            }
            rest = behind;
        }
        let (indices, coordinates) = rest.split_at_mut(index_words(t));
        let corners = &corners[3 * first..3 * (first + t)];
        if corners.iter().fold(0, |most, c| most.max(*c)) >= v as u8 {
            return wrong("a corner is not among its leaf's vertices");
        }
        bytemuck::cast_slice_mut(indices)[..3 * t].copy_from_slice(corners);
        let (x, yz) = coordinates.split_at_mut(v);
        let (y, z) = yz.split_at_mut(v);
        let own = references[first_vertex..first_vertex + v].iter().map(|r| all_vertices[*r as usize]);
        for (((x, y), z), vertex) in x.iter_mut().zip(y).zip(z).zip(own) {
            [*x, *y, *z, _] = vertex;
        }
        (at, first, first_vertex) = (at + size, first + t, first_vertex + v);
    }
    Ok((words, starts))
}

/// Indices among the distinct vertices of all leaves' vertices.
fn read_references(reader: &mut Reader, total: usize, vertices: usize) -> Checked<Vec<u32>> {
    let (mut known, mut are_known) = (0u32, true);
    let mut references = Vec::with_capacity(total);
    reader.varints(total, |back| {
        are_known &= back <= known;
        // None back is a new one.
        references.push(known.wrapping_sub(back));
        known += u32::from(back == 0);
    })?;
    if !are_known {
        return wrong("a vertex reference reaches before the first");
    }
    if known as usize == vertices { Ok(references) } else { wrong("its vertices do not add up") }
}
