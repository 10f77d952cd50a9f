//! The leaves of a block in file form: section "Leaves" of `src/store/FORMAT.md`.

use super::codec::{Checked, wrong};
use super::layout::{Block, HEADER_WORDS, MAX_TRIANGLES, MAX_VERTICES, MAX_WORDS, PAD_WORDS};
use super::leaf::{APART, LeafForm, MIXED, NEAR, ORDER, index_words, put_coordinates};
use crate::simd::Simd;
use crate::structure::bytes::{Reader, padded, piece, unzigzag, zigzag};
use std::borrow::Cow;
use std::collections::HashMap;
use std::hash::Hasher;

/// Decoded leaves.
pub(super) struct Leaves {
    pub triangles: usize,
    pub parts: Vec<u32>,
    /// The words of a leaf block: zeros in place of its header and its parts, the leaves, and zeros at the end.
    pub words: Vec<u32>,
    /// First word of each leaf, relative to the first leaf.
    pub starts: Vec<usize>,
}

impl Leaves {
    /// Position of the first leaf in `words`.
    pub fn begin(&self) -> usize {
        HEADER_WORDS + self.parts.len()
    }

    /// The words of the leaves.
    pub fn own(&self) -> &[u32] {
        &self.words[self.begin()..self.words.len() - PAD_WORDS]
    }
}

/// Encodes the leaves of a block.
pub(super) fn push_leaves(out: &mut Vec<u8>, block: &Block) {
    let leaves: Vec<usize> = leaves_in_order(block).into_iter().map(usize::from).collect();
    let (references, vertices) = share_vertices(block, &leaves);
    for count in [block.triangles(), block.parts(), leaves.len()] {
        out.extend((count as u16).to_le_bytes());
    }
    out.extend((vertices.len() as u32).to_le_bytes());
    (0..block.parts()).for_each(|i| out.extend(block.part(i).to_le_bytes()));
    let leaves = || leaves.iter().map(|&at| block.leaf(at));
    out.extend(
        leaves().map(|leaf| {
            Shape { triangles: leaf.triangles, vertices: leaf.vertices, is_mixed: leaf.is_mixed() }.to_bits()
        }),
    );
    let parts = leaves()
        .flat_map(|leaf| (0..if leaf.is_mixed() { leaf.triangles } else { 1 }).map(move |i| leaf.part_of(i) as u16));
    push_pairs(out, parts);
    let corners: Vec<u8> =
        leaves().flat_map(|leaf| (0..3).flat_map(move |c| &leaf.corners8(c)[..leaf.triangles])).copied().collect();
    out.extend(corners.chunks(2).map(|pair| pair[0] | pair.get(1).copied().unwrap_or(0) << 4));
    out.extend(
        references.chunks(8).map(|backs| backs.iter().rev().fold(0, |bits, back| bits << 1 | u8::from(*back > 0))),
    );
    push_pairs(out, references.iter().filter(|back| **back > 0).map(|back| back - 1));
    (0..3).for_each(|axis| push_coordinates(out, vertices.iter().map(|v| v[axis])));
}

/// Appends the low bytes of all numbers, then the high bytes.
fn push_pairs(out: &mut Vec<u8>, numbers: impl Iterator<Item = u16> + Clone) {
    out.extend(numbers.clone().map(|number| number as u8));
    out.extend(numbers.map(|number| (number >> 8) as u8));
}

/// Counts and flag of a leaf: one byte in the file form.
#[derive(Clone, Copy)]
struct Shape {
    triangles: usize,
    vertices: usize,
    is_mixed: bool,
}

impl Shape {
    fn to_bits(self) -> u8 {
        (self.triangles - 1) as u8 | ((self.vertices - 3) as u8) << 3 | u8::from(self.is_mixed) << 7
    }

    #[inline(always)]
    fn from_bits(bits: u8) -> Self {
        Self {
            triangles: 1 + usize::from(bits & 7),
            vertices: 3 + usize::from(bits >> 3 & 15),
            is_mixed: bits >> 7 == 1,
        }
    }

    /// Least and greatest number of words that the leaf may need.
    fn words(self) -> [usize; 2] {
        let Self { triangles, vertices, is_mixed } = self;
        let of = |flags: u16| LeafForm { triangles, vertices, flags: flags | if is_mixed { MIXED } else { 0 } }.words();
        [of(APART | NEAR), of(0)]
    }
}

/// Returns the first words of the leaves of a block, in their order in the block.
pub(super) fn leaves_in_order(block: &Block) -> Vec<u16> {
    let mut leaves = Vec::with_capacity(block.triangles());
    let mut at = block.first_leaf();
    while at + PAD_WORDS < block.words().len() {
        leaves.push(at as u16);
        at += block.leaf(at).len();
    }
    leaves
}

/// Finds the distinct vertices of a block. Returns for each vertex of each leaf its distance back in the list of
/// distinct vertices, or 0 if it is new, and the bits of the distinct vertices. A block has fewer vertices than words,
/// so 16 bits hold a distance.
fn share_vertices(block: &Block, leaves: &[usize]) -> (Vec<u16>, Vec<[u32; 3]>) {
    let mut references = Vec::new();
    let mut vertices: Vec<[u32; 3]> = Vec::new();
    let corners = leaves.iter().map(|&at| block.leaf(at).vertices).sum();
    let mut known = HashMap::with_capacity_and_hasher(corners, BuildVertexHasher::default());
    for leaf in leaves.iter().map(|&at| block.leaf(at)) {
        let axes = [0, 1, 2].map(|a| leaf.coordinates(a).to_array());
        for v in 0..leaf.vertices {
            let vertex = axes.map(|a| a[v].to_bits());
            let key = (u64::from(vertex[0]) << 32 | u64::from(vertex[1]), vertex[2]);
            let index = *known.entry(key).or_insert(vertices.len());
            references.push((vertices.len() - index) as u16);
            if index == vertices.len() {
                vertices.push(vertex);
            }
        }
    }
    (references, vertices)
}

type BuildVertexHasher = std::hash::BuildHasherDefault<VertexHasher>;

/// A weak hash that suffices for the vertices of one block, in a tenth of the time of a general hash.
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
        // The factor is an odd number near 2^64 divided by the golden ratio. The table uses bits from both ends of the
        // hash.
        let product = u128::from(self.0 ^ x ^ 0x2545_F491_4F6C_DD1D) * 0x9E37_79B9_7F4A_7C15;
        self.0 = product as u64 ^ (product >> 64) as u64;
    }

    fn finish(&self) -> u64 {
        self.0
    }
}

/// Maps the bits of a float to an integer with the same order. Negative floats are mirrored.
fn ordered(bits: u32) -> u32 {
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

fn unordered(value: u32) -> u32 {
    if value >> 31 == 1 { value & !(1 << 31) } else { !value }
}

/// Number of coordinates that are packed with the same number of bits. With 16 of them a group fills whole bytes.
const GROUP: usize = 16;
/// Greatest number of bytes of a group, and the bytes that are read beyond its last number.
const WINDOW: usize = 4 * GROUP + 8;

fn push_coordinates(out: &mut Vec<u8>, bits: impl Iterator<Item = u32>) {
    let mut before = 0u32;
    let mut coded: Vec<u32> = bits
        .map(|b| {
            let now = ordered(b);
            let difference = now.wrapping_sub(before) as i32;
            before = now;
            zigzag(difference)
        })
        .collect();
    coded.resize(coded.len().next_multiple_of(GROUP), 0);
    let width = |group: &[u32]| u32::BITS - group.iter().fold(0, |all, number| all | number).leading_zeros();
    out.extend(coded.chunks(GROUP).map(|group| width(group) as u8));
    for group in coded.chunks(GROUP) {
        let (mut bits, mut count) = (0u64, 0);
        for number in group {
            bits |= u64::from(*number) << count;
            count += width(group);
            while count >= 8 {
                out.push(bits as u8);
                (bits, count) = (bits >> 8, count - 8);
            }
        }
    }
}

/// Reads the bits of the coordinates of `count` vertices. A zero follows each vertex, so that a vertex is one load of
/// four words.
#[inline(always)]
fn read_vertices(reader: &mut Reader, count: usize) -> Checked<Vec<[u32; 4]>> {
    let mut vertices = vec![[0; 4]; count.next_multiple_of(GROUP)];
    for axis in 0..3 {
        read_steps(reader, axis, &mut vertices)?;
    }
    if vertices[count..].as_flattened().iter().any(|step| *step != 0) {
        return wrong("unexpected coordinates behind the last vertex");
    }
    vertices.truncate(count);
    let (mut sum, mut infinite) = ([0, 0, 0, ordered(0)], [0; 4]);
    for vertex in &mut vertices {
        // The loop handles four lanes at once.
        for i in 0..4 {
            sum[i] = unzigzag(vertex[i]).wrapping_add(sum[i] as i32) as u32;
            vertex[i] = unordered(sum[i]);
            infinite[i] |= u32::from(vertex[i] & EXPONENT == EXPONENT);
        }
    }
    if infinite == [0; 4] { Ok(vertices) } else { wrong("a vertex is not finite") }
}

/// Reads the differences that [`push_coordinates`] wrote, without summing them.
#[inline(always)]
fn read_steps(reader: &mut Reader, axis: usize, to: &mut [[u32; 4]]) -> Checked<()> {
    let widths = reader.take(to.len() / GROUP)?;
    if widths.iter().fold(0, |most, width| most.max(*width)) > 32 {
        return wrong("a coordinate has too many bits");
    }
    let bytes = widths.iter().map(|width| GROUP / 8 * usize::from(*width)).sum();
    let window = reader.ahead(bytes + WINDOW);
    let own = reader.take(bytes)?;
    let packed = window.map_or_else(|_| Cow::Owned(padded(own.iter().copied(), WINDOW)), Cow::Borrowed);
    let mut at = 0;
    for (group, &width) in to.chunks_exact_mut(GROUP).zip(widths) {
        unpack(piece(&packed, at), width.into(), axis, group);
        at += GROUP / 8 * usize::from(width);
    }
    Ok(())
}

/// Unpacks the numbers of a group, `width` bits each, at most 32.
#[inline(always)]
fn unpack(packed: &[u8; WINDOW], width: usize, axis: usize, group: &mut [[u32; 4]]) {
    let (mask, mut bit) = ((1u64 << width) - 1, 0);
    let from = |bit: usize| u64::from_le_bytes(*piece(packed, (bit / 8) & (4 * GROUP - 1))) >> (bit % 8);
    if 2 * width + 7 > 64 {
        for number in group {
            number[axis] = (from(bit) & mask) as u32;
            bit += width;
        }
        return;
    }
    // One load of 64 bits holds two numbers.
    for pair in group.chunks_exact_mut(2) {
        let both = from(bit);
        (pair[0][axis], pair[1][axis]) = ((both & mask) as u32, (both >> width & mask) as u32);
        bit += 2 * width;
    }
}

/// Exponent bits of a float. All of them are set if the float is infinite or not a number.
const EXPONENT: u32 = 0x7f80_0000;

struct Counts {
    triangles: usize,
    parts: usize,
    leaves: usize,
    vertices: usize,
}

/// Reads and checks the leaves of a block.
#[inline(always)]
pub(super) fn read_leaves<S: Simd>(s: S, reader: &mut Reader) -> Checked<Leaves> {
    let mut count = || reader.u16().map(usize::from);
    let (triangles, parts, leaves) = (count()?, count()?, count()?);
    let counts = Counts { triangles, parts, leaves, vertices: reader.u32()? as usize };
    let parts: Vec<u32> = (0..parts).map(|_| reader.u32()).collect::<Checked<_>>()?;
    if leaves == 0 {
        return wrong("the block has no leaves");
    }
    if !parts.is_sorted_by(|a, b| a < b) {
        return wrong("the parts are not in ascending order");
    }
    let (words, starts) = read_triangles(s, reader, &counts)?;
    Ok(Leaves { triangles, parts, words, starts })
}

/// Returns [`Leaves::words`] and [`Leaves::starts`].
///
/// The sizes of leaves vary, and branches on them would be mispredicted. The function therefore first gathers the
/// vertices of all leaves in one loop. Then it copies each leaf in pieces of the greatest possible size, in the order
/// of the block: each piece overwrites the excess of the previous one.
#[inline(always)]
fn read_triangles<S: Simd>(s: S, reader: &mut Reader, counts: &Counts) -> Checked<(Vec<u32>, Vec<usize>)> {
    let shapes = reader.take(counts.leaves)?;
    let leaves = || shapes.iter().map(|bits| Shape::from_bits(*bits));
    let sum: usize = leaves().map(|leaf| leaf.triangles).sum();
    if sum != counts.triangles || leaves().any(|leaf| leaf.vertices > MAX_VERTICES) {
        return wrong("the leaf counts are inconsistent");
    }
    let begin = HEADER_WORDS + counts.parts;
    let [least, most] = leaves().map(Shape::words).fold([begin; 2], |[a, b], [least, most]| [a + least, b + most]);
    if least + PAD_WORDS > MAX_WORDS {
        return wrong("the block is too large");
    }
    // One part for each leaf, or one for each triangle of a mixed leaf.
    let all_parts = leaves().map(|leaf| if leaf.is_mixed { leaf.triangles } else { 1 }).sum();
    let parts = padded(read_pairs(reader, all_parts)?, MAX_TRIANGLES);
    if usize::from(parts.iter().fold(0, |most, p| most.max(*p))) >= counts.parts {
        return wrong("the part of a triangle is not in the table of parts");
    }
    let corners = padded(reader.take((3 * sum).div_ceil(2))?.iter().map(|pair| [pair & 15, pair >> 4]), CORNERS / 2);
    let corners = corners.as_flattened();
    if corners[3 * sum] != 0 {
        return wrong("an unexpected corner behind the last triangle");
    }
    let axes = read_all_vertices(reader, leaves().map(|leaf| leaf.vertices).sum(), counts.vertices)?;

    let (mut words, mut starts) = (vec![0; most + PAD_WORDS], Vec::with_capacity(counts.leaves));
    let (mut at, mut first, mut first_part, mut first_vertex, mut wrong_corners) = (begin, 0, 0, 0, 0);
    for Shape { triangles: t, vertices: v, is_mixed } in leaves() {
        starts.push(at - begin);
        let axes = axes.each_ref().map(|axis| piece(axis, first_vertex));
        let corners = own_corners(piece(corners, 3 * first), t);
        wrong_corners |= at_least(corners, v as u8);
        let form = LeafForm::of(s, (t, v), is_mixed, v == 3 * t && corners == IN_ORDER[t], axes);
        let own = piece(&parts, first_part);
        put(
            &mut words,
            at,
            &[t as u32 | (v as u32) << 8 | (first as u32) << 16, u32::from(own[0]) | u32::from(form.flags) << 16],
        );
        at += 2;
        first_part += 1;
        if is_mixed {
            put(&mut words, at, &pairs(own, t));
            at += t.div_ceil(2);
            first_part += t - 1;
        }
        if form.flags & APART == 0 {
            let [a, b, c] = corners;
            // The bytes have the same order in memory as in the file.
            put(
                &mut words,
                at,
                &[a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32, c as u32, (c >> 32) as u32].map(u32::to_le),
            );
            at += index_words(t);
        }
        at += put_coordinates(s, &mut words[at..], form, axes);
        (first, first_vertex) = (first + t, first_vertex + v);
    }
    if wrong_corners != 0 {
        return wrong("a corner is not among the vertices of its leaf");
    }
    if at + PAD_WORDS > MAX_WORDS {
        return wrong("the block is too large");
    }
    words.truncate(at + PAD_WORDS);
    words[at..].fill(0);
    Ok((words, starts))
}

/// For each number of triangles, their corners if each has vertices of its own, in order. Entries for more triangles
/// than the vertices of a leaf allow match no leaf.
const IN_ORDER: [[u64; CORNERS / 8]; MAX_TRIANGLES + 1] = {
    let mut all = [[u64::MAX; CORNERS / 8]; MAX_TRIANGLES + 1];
    let mut t = 1;
    while 3 * t <= MAX_VERTICES {
        all[t] = [0; CORNERS / 8];
        let mut at = 0;
        while at < 3 * t {
            all[t][at / 8] |= (ORDER[at / t][at % t] as u64) << (8 * (at % 8));
            at += 1;
        }
        t += 1;
    }
    all
};

/// Greatest number of bytes of a leaf's corners.
const CORNERS: usize = 3 * MAX_TRIANGLES;

#[inline(always)]
fn put<const N: usize>(words: &mut [u32], at: usize, piece: &[u32; N]) {
    words[at..at + N].copy_from_slice(piece);
}

/// Packs the first `count` parts, two in a word, and fills the rest with zeros.
fn pairs(parts: &[u16; MAX_TRIANGLES], count: usize) -> [u32; MAX_TRIANGLES / 2] {
    std::array::from_fn(|pair| {
        let part = |i: usize| if i < count { u32::from(parts[i]) } else { 0 };
        part(2 * pair) | part(2 * pair + 1) << 16
    })
}

/// The corners of `triangles` triangles, followed by zeros; the first corner in the lowest byte.
#[inline(always)]
fn own_corners(bytes: &[u8; CORNERS], triangles: usize) -> [u64; CORNERS / 8] {
    let ([a, b, c], word) = (OWN_CORNERS[triangles], |at: usize| u64::from_le_bytes(*piece(bytes, at)));
    // No loop: a loop would write the words to memory in smaller pieces than the later reads, which stalls.
    [word(0) & a, word(8) & b, word(16) & c]
}

/// For each number of triangles, a mask of the bytes that their corners occupy.
const OWN_CORNERS: [[u64; CORNERS / 8]; MAX_TRIANGLES + 1] = {
    let mut own = [[0; CORNERS / 8]; MAX_TRIANGLES + 1];
    let mut at = 0;
    while at < CORNERS * (MAX_TRIANGLES + 1) {
        let (triangles, byte) = (at / CORNERS, at % CORNERS);
        if byte < 3 * triangles {
            own[triangles][byte / 8] |= 0xff << (8 * (byte % 8));
        }
        at += 1;
    }
    own
};

/// Returns a value other than zero if one of the bytes is at least `limit`, which is at most 128.
#[inline(always)]
fn at_least(bytes: [u64; CORNERS / 8], limit: u8) -> u64 {
    let each = u64::from_le_bytes([1; 8]);
    let (low, top) = (each * 0x7f, each << 7);
    // The top bit of each byte is set if the sum of its low bits and `128 - limit` reaches 128, or if it is set
    // already.
    bytes.iter().fold(0, |wrong, b| wrong | (((b & low) + each * u64::from(128 - limit)) | b) & top)
}

/// Reads the numbers that [`push_pairs`] wrote.
fn read_pairs<'a>(reader: &mut Reader<'a>, count: usize) -> Checked<impl ExactSizeIterator<Item = u16> + use<'a>> {
    let (low, high) = (reader.take(count)?, reader.take(count)?);
    Ok(low.iter().zip(high).map(|(low, high)| u16::from_le_bytes([*low, *high])))
}

/// Reads the coordinates of the vertices of all leaves, axis by axis. There are `total` vertices, `distinct` of them
/// distinct. Each axis has zeros at its end, so that a piece of sixteen can be read from any vertex.
#[inline(always)]
fn read_all_vertices(reader: &mut Reader, total: usize, distinct: usize) -> Checked<[Vec<u32>; 3]> {
    let are_known = reader.take(total.div_ceil(8))?;
    let old = are_known.iter().map(|bits| bits.count_ones() as usize).sum();
    let behind = are_known.get(total / 8).map_or(0, |bits| bits >> (total % 8));
    if old + distinct != total || behind != 0 {
        return wrong("the vertex counts are inconsistent");
    }
    let backs = padded(read_pairs(reader, old)?.map(|back| u32::from(back) + 1), 1);
    let vertices = read_vertices(reader, distinct)?;
    let are_known: Vec<[u8; 8]> = are_known.iter().map(|bits| bytes_of_bits(*bits)).collect();
    let (mut known, mut next, mut are_sound) = (0u32, 0, true);
    let mut axes = [0, 1, 2].map(|_| vec![0; total + MAX_VERTICES]);
    let [xs, ys, zs] = &mut axes;
    for (((x, y), z), is_known) in
        xs[..total].iter_mut().zip(ys.iter_mut()).zip(zs.iter_mut()).zip(are_known.as_flattened())
    {
        let is_known = u32::from(*is_known);
        let back = backs[next] & is_known.wrapping_neg();
        match vertices.get(known.wrapping_sub(back) as usize) {
            Some(vertex) => [*x, *y, *z, _] = *vertex,
            None => are_sound = false,
        }
        known += 1 - is_known;
        next += is_known as usize;
    }
    if !are_sound {
        return wrong("a vertex reference points before the first vertex");
    }
    Ok(axes)
}

/// Expands each bit to a byte of 0 or 1.
#[inline(always)]
fn bytes_of_bits(bits: u8) -> [u8; 8] {
    let each = u64::from_le_bytes([1; 8]);
    // Each byte gets a copy of `bits`, of which only the byte's own bit is kept. Adding 0x7f carries any lower bit to
    // the top bit; bit 7 is the top bit already.
    let own = (each * u64::from(bits)) & u64::from_le_bytes([1, 2, 4, 8, 16, 32, 64, 128]);
    let low = each * 0x7f;
    ((((own & low) + low) | own) >> 7 & each).to_le_bytes()
}
