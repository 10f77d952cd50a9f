//! The nodes of a block in file form: section "Nodes" of `src/store/FORMAT.md`.

use super::codec::{Checked, Place, wrong};
use super::layout::{
    Block, Child, EXTERNAL_WORDS, HEADER_WORDS, LONG_VOXEL, MAX_NODES, MAX_WORDS, NODE_WORDS, Node, PAD_WORDS,
    SHORT_VOXEL, Transmitting, WIDTH, mark_transmitting,
};
use crate::lod::{CURTAIN_WORDS, Coded, Curtain, SIDES_WORDS, stop_bits, summary_bit};
use crate::structure::bytes::{Reader, padded, piece, push_planes};

/// Bytes of a node's grid and valid bits.
const HEAD_BYTES: usize = 16;
/// The top bit of each byte.
const TOP_BITS: u64 = u64::from_le_bytes([0x80; 8]);
/// The bits of stop codes in the fourth bytes of the first words of eight voxels.
const STOP_CODES: u64 = u64::from_le_bytes([(stop_bits(63) >> 24) as u8; 8]);
/// Bytes of a child's box.
const BOX_BYTES: usize = 6;

/// Decoded nodes.
pub(super) struct Nodes {
    pub table: Vec<Node>,
    pub kinds: Vec<u16>,
    pub externals: Vec<[u32; 2]>,
    pub leaves: usize,
    /// Marks of the nodes with children that may transmit rays.
    pub transmitting: Transmitting,
    /// The header words about voxels, without their position, and the words of the voxels.
    pub voxels: ([u32; 3], Vec<u32>),
}

/// A node's grid and its valid bits.
fn head(node: &Node) -> [u32; 4] {
    let ([x, y, z], [i, j, k]) = (node.origin.map(f32::to_bits), node.exponent);
    [x, y, z, u32::from_le_bytes([i, j, k, node.valid])]
}

/// The slots that have a child.
fn slots(node: &Node) -> impl Iterator<Item = usize> + use<> {
    let valid = node.valid;
    (0..WIDTH).filter(move |slot| valid >> slot & 1 == 1)
}

/// Encodes the nodes of a block with `leaves` leaves.
pub(super) fn push_nodes(out: &mut Vec<u8>, block: &Block, leaves: usize) {
    for count in [block.nodes(), block.externals(), leaves] {
        out.extend((count as u16).to_le_bytes());
    }
    let nodes: Vec<&Node> = (0..block.nodes()).map(|i| block.node(i)).collect();
    (0..4).for_each(|word| push_planes(out, nodes.iter().map(|n| head(n)[word])));
    for row in 0..BOX_BYTES {
        out.extend(nodes.iter().flat_map(|n| slots(n).map(|slot| n.planes[row][slot])));
    }
    nodes.iter().for_each(|n| out.extend(kinds(n).to_le_bytes()));
    let externals: Vec<(u32, u32)> = block.all_externals().collect();
    push_planes(out, externals.iter().map(|external| external.0));
    push_planes(out, externals.iter().map(|external| external.1));
    push_voxels(out, block);
}

fn push_voxels<'a>(out: &mut Vec<u8>, block: &Block<'a>) {
    let is_long = block.voxel_words() == LONG_VOXEL;
    out.push(block.voxel_words() as u8);
    out.extend(block.words()[7].to_le_bytes());
    let voxels: Vec<&[u32]> = (0..block.voxels()).map(|i| block.voxel_at(i)).collect();
    let slabs_of = |node: &'a Node| slots(node).map(|slot| node.slabs[slot]);
    let slabs: Vec<u32> = (0..block.nodes()).flat_map(|i| slabs_of(block.node(i))).collect();
    let second = |v: &[u32]| if Coded::has_sides(v[0]) { 0 } else { v[1] };
    push_planes(out, voxels.iter().map(|v| v[0]));
    push_planes(out, voxels.iter().map(|v| second(v)));
    push_planes(out, slabs.iter().copied());
    if is_long {
        push_planes(out, voxels.iter().map(|v| v[2]));
        let mixed = block.all_voxels().filter(|v| v.part().1);
        mixed.for_each(|v| out.extend(v.summary().to_le_bytes()));
        push_curtains(out, block);
    }
    let (from, to) = (block.sides_at(), block.curtains_at());
    for word in 0..SIDES_WORDS {
        push_planes(out, block.words()[from..to].iter().skip(word).step_by(SIDES_WORDS).copied());
    }
}

/// Encodes the curtains of a block.
fn push_curtains(out: &mut Vec<u8>, block: &Block) {
    let curtains: Vec<_> = block.all_voxels().flat_map(|v| v.curtains()).collect();
    out.extend((curtains.len() as u16).to_le_bytes());
    let shown: Vec<u32> = block.all_voxels().filter_map(|v| v.shown()).collect();
    push_planes(out, shown.iter().copied());
    for word in 0..CURTAIN_WORDS {
        push_planes(out, curtains.iter().map(|curtain| curtain[word]));
    }
}

/// Reads the curtains of a block with voxels of parts `parts`. Returns their words, with the summaries of the voxels
/// left out as zeros, and the position of each voxel's.
fn read_curtains(reader: &mut Reader, parts: &[u32]) -> Checked<(Vec<u32>, Vec<u32>)> {
    let count = usize::from(reader.u16()?);
    let with_some = parts.iter().filter(|word| Coded::has_curtains(**word)).count();
    let shown = reader.words(with_some, 0)?;
    let (first, second, third) = (reader.words(count, 0)?, reader.words(count, 0)?, reader.words(count, 0)?);
    let (mut words, mut positions, mut next) = (Vec::new(), Vec::with_capacity(with_some), 0);
    for shown in shown {
        positions.push(words.len() as u32);
        words.extend([0, shown]);
        loop {
            let Some(head) = first.get(next) else { return wrong("the curtains of a voxel have no end") };
            if !Curtain::is_sound(*head) {
                return wrong("a curtain has unknown directions");
            }
            words.extend([*head, second[next], third[next]]);
            next += 1;
            if Curtain::is_last(*head) {
                break;
            }
        }
    }
    if next != count || words.len() > MAX_WORDS {
        return wrong("the number of curtains is wrong");
    }
    Ok((words, positions))
}

/// Kinds of a node's children, 2 bits a slot.
fn kinds(node: &Node) -> u16 {
    slots(node).fold(0, |bits, slot| {
        let kind = match Child::from_bits(u32::from(node.child[slot])) {
            Child::Node(_) => 1,
            Child::Leaf(_) => 2,
            _ => 3,
        };
        bits | kind << (2 * slot)
    })
}

/// Reads the nodes of a block, and checks them. The targets of their references are not yet assigned.
#[inline(always)]
pub(super) fn read_nodes(reader: &mut Reader, place: Place) -> Checked<Nodes> {
    let mut count = || reader.u16().map(usize::from);
    let (nodes, externals, leaves) = (count()?, count()?, count()?);
    if HEADER_WORDS + nodes * NODE_WORDS + EXTERNAL_WORDS * externals + PAD_WORDS > MAX_WORDS || nodes == 0 {
        return wrong("the block has no nodes, or the counts are too large for a block");
    }
    // The last byte plane holds the valid bits.
    let valid = &reader.ahead(HEAD_BYTES * nodes)?[(HEAD_BYTES - 1) * nodes..];
    let (x, y, z, rest) =
        (reader.words(nodes, 0)?, reader.words(nodes, 0)?, reader.words(nodes, 0)?, reader.words(nodes, 0)?);
    let count = valid.iter().map(|valid| valid.count_ones() as usize).sum();
    // At least `WIDTH` more bytes follow the boxes, so a window at the last child stays inside.
    let boxes = reader.ahead(BOX_BYTES * count + WIDTH)?;
    reader.take(BOX_BYTES * count)?;
    let kinds: Vec<u16> = reader.take(2 * nodes)?.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    let externals = read_externals(reader, externals, place)?;
    let voxels = read_voxels(reader, valid, count)?;
    let (table, transmitting) = table([&x, &y, &z, &rest], boxes, &voxels)?;
    Ok(Nodes { table, kinds, externals, leaves, transmitting, voxels: (voxels.header, voxels.words) })
}

/// Makes nodes from grids, valid bits and the boxes of children, without child references. Also returns the marks of
/// nodes that may transmit rays.
#[inline(always)]
fn table([x, y, z, rest]: [&[u32]; 4], boxes: &[u8], voxels: &Voxels) -> Checked<(Vec<Node>, Transmitting)> {
    let count = (boxes.len() - WIDTH) / BOX_BYTES;
    let (low, high) = boxes[..BOX_BYTES * count].split_at(BOX_BYTES * count / 2);
    if low.iter().zip(high).fold(false, |any, (low, high)| any | (low > high)) {
        return wrong("a box of a node is inverted");
    }
    let (mut next, mut grids_ok, mut transmitting) = (0, true, Transmitting::default());
    let mut table = Vec::with_capacity(rest.len());
    for (((x, y), z), rest) in x.iter().zip(y).zip(z).zip(rest) {
        let [i, j, k, valid] = rest.to_le_bytes();
        let (origin, exponent) = ([f32::from_bits(*x), f32::from_bits(*y), f32::from_bits(*z)], [i, j, k]);
        grids_ok &= exponent.iter().fold(true, |all, e| all & (1..=254).contains(e));
        grids_ok &= origin.iter().fold(valid != 0, |all, o| all & o.is_finite());
        let way = &WAYS[usize::from(valid)];
        let spread = |from: &[u8], row: usize| way.spread(piece(from, row * count + next));
        // The boxes of empty slots are inverted, so no ray hits them.
        let (mut planes, mut normal) = ([[0; WIDTH]; BOX_BYTES], [[0; WIDTH]; 2]);
        for (row, plane) in planes.iter_mut().enumerate() {
            let empty = if row < 3 { !way.valid } else { 0 };
            *plane = (spread(boxes, row) | empty).to_le_bytes();
        }
        for (row, bytes) in normal.iter_mut().enumerate() {
            *bytes = (spread(voxels.first_planes, row) ^ way.valid & TOP_BITS).to_le_bytes();
        }
        mark_transmitting(&mut transmitting, table.len(), spread(voxels.first_planes, 3) & STOP_CODES != 0);
        let (mut slabs, from) = ([0; WIDTH], piece::<u32, WIDTH>(&voxels.slabs, next));
        let mut child = 0;
        for (slot, slabs) in slabs.iter_mut().enumerate() {
            let is_there = valid >> slot & 1;
            *slabs = from[child] & u32::from(is_there).wrapping_neg();
            child += usize::from(is_there);
        }
        next += valid.count_ones() as usize;
        table.push(Node { origin, exponent, valid, planes, child: [0; WIDTH], slabs, normal });
    }
    if grids_ok { Ok((table, transmitting)) } else { wrong("a node has an invalid grid or no children") }
}

fn read_externals(reader: &mut Reader, count: usize, place: Place) -> Checked<Vec<[u32; 2]>> {
    let (ids, children) = (reader.words(count, 0)?, reader.words(count, 0)?);
    let externals: Vec<[u32; 2]> = ids.into_iter().zip(children).map(|(id, child)| [id, child]).collect();
    for &[id, child] in &externals {
        // References lead to later blocks only, so a chain of references never returns.
        if id <= place.id || id >= place.end {
            return wrong("an external reference refers to an invalid block");
        }
        let is_node = matches!(Child::from_bits(child), Child::Node(index) if index < MAX_NODES);
        if !is_node || child > u32::from(u16::MAX) {
            return wrong("an external reference does not refer to a node");
        }
    }
    if has_duplicates(externals.iter().copied()) {
        return wrong(TWO_PARENTS);
    }
    Ok(externals)
}

/// The fault of two references to one node of another block.
pub(super) const TWO_PARENTS: &str = "two external references refer to one node";

/// True if two references of a block have one target. (References between blocks are checked by the residency too, but
/// a block must be sound by itself.)
pub(super) fn has_duplicates(externals: impl Iterator<Item = [u32; 2]>) -> bool {
    let mut targets: Vec<u64> = externals.map(|[id, child]| u64::from(id) << 32 | u64::from(child)).collect();
    targets.sort_unstable();
    targets.windows(2).any(|pair| pair[0] == pair[1])
}

/// Decoded voxels.
struct Voxels<'a> {
    /// The header words about voxels.
    header: [u32; 3],
    /// All words between the parts and the leaves.
    words: Vec<u32>,
    /// Slabs of each child, followed by zeros.
    slabs: Vec<u32>,
    /// The byte planes of the first words of all children, followed by other bytes. Planes 0 and 1 are normals; plane 3
    /// holds flags and stop codes.
    first_planes: &'a [u8],
}

/// Reads the voxels of nodes with `count` children in total. `valid` holds the valid bits of each node.
#[inline(always)]
fn read_voxels<'a>(reader: &mut Reader<'a>, valid: &[u8], count: usize) -> Checked<Voxels<'a>> {
    let size = usize::from(reader.u8()?);
    if ![SHORT_VOXEL, LONG_VOXEL].contains(&size) {
        return wrong("the voxels have an invalid size");
    }
    let part = reader.u32()?;
    // At least `WIDTH` more bytes follow the plane, so a window at the last child stays inside.
    let first_planes = reader.ahead(4 * count + WIDTH)?;
    let firsts = reader.words(count, 0)?;
    let mut seconds = reader.words(count, 0)?;
    let slabs = reader.words(count, WIDTH)?;
    let parts = if size == LONG_VOXEL { reader.words(count, 0)? } else { Vec::new() };
    let of_mixed = parts.iter().filter(|word| Coded::part(**word).1).count();
    let of_mixed = padded(reader.take(4 * of_mixed)?.chunks_exact(4).map(|b| u32::from_le_bytes(*piece(b, 0))), 1);
    let (mut curtains, at) = if size == LONG_VOXEL { read_curtains(reader, &parts)? } else { Default::default() };
    let (mut six_sided, mut counted) = (0, 0);
    for (first, second) in firsts.iter().zip(&mut seconds) {
        let has_sides = u32::from(Coded::has_sides(*first));
        counted |= *second * has_sides;
        *second |= six_sided * has_sides;
        six_sided += has_sides;
    }
    if counted != 0 {
        return wrong("the second word of a voxel with six samples is not zero");
    }
    let own_at = valid.len();
    let sides_at = own_at + count * size;
    let mut words = vec![0; sides_at + six_sided as usize * SIDES_WORDS];
    let mut before = 0;
    for (first, valid) in words.iter_mut().zip(valid) {
        *first = before;
        before += valid.count_ones();
    }
    let own = &mut words[own_at..sides_at];
    if size == LONG_VOXEL {
        let (mut next, mut at) = (0, at.iter());
        for (i, voxel) in own.as_chunks_mut::<LONG_VOXEL>().0.iter_mut().enumerate() {
            let (part, is_mixed) = Coded::part(parts[i]);
            // The summary is read in both cases, because a branch would be mispredicted.
            let own = of_mixed[next];
            let summary = if is_mixed { own } else { summary_bit(part) };
            next += usize::from(is_mixed);
            let own = if Coded::has_curtains(parts[i]) { at.next() } else { None };
            // The summary of a voxel with curtains is with these.
            let last = own.map_or(summary, |at| {
                curtains[*at as usize] = summary;
                *at
            });
            *voxel = [firsts[i], seconds[i], parts[i], last];
        }
    } else {
        for (i, voxel) in own.as_chunks_mut::<SHORT_VOXEL>().0.iter_mut().enumerate() {
            *voxel = [firsts[i], seconds[i]];
        }
    }
    for word in 0..SIDES_WORDS {
        let bits = reader.words(six_sided as usize, 0)?;
        for (side, bits) in words[sides_at..].as_chunks_mut::<SIDES_WORDS>().0.iter_mut().zip(&bits) {
            side[word] = *bits;
        }
    }
    let header = [count as u32 | six_sided << 16, size as u32 | (curtains.len() as u32) << 16, part];
    words.append(&mut curtains);
    Ok(Voxels { header, words, slabs, first_planes })
}

/// A permutation that moves the bytes of a node's children to their slots.
struct Ways {
    /// Masks for three steps: these slots take the byte of the slot four, two, one below.
    steps: [u64; 3],
    /// All bits of the slots that have a child.
    valid: u64,
}

impl Ways {
    const fn new(valid: usize) -> Self {
        let mut ways = Ways { steps: [0; 3], valid: 0 };
        let (mut slot, mut child) = (0, 0);
        while slot < WIDTH {
            if valid >> slot & 1 == 1 {
                // Children of later slots move at least as far, so no byte is overwritten.
                let far = slot - child;
                ways.valid |= 0xff << (8 * slot);
                let mut step = 0;
                while step < 3 {
                    if far >> (2 - step) & 1 == 1 {
                        let gone = far >> (2 - step) << (2 - step);
                        ways.steps[step] |= 0xff << (8 * (child + gone));
                    }
                    step += 1;
                }
                child += 1;
            }
            slot += 1;
        }
        ways
    }

    /// Moves the bytes of the children, which come in order and before other bytes, to their slots. Slots without a
    /// child get zero.
    #[inline(always)]
    fn spread(&self, bytes: &[u8; WIDTH]) -> u64 {
        let mut all = u64::from_le_bytes(*bytes);
        for (step, taken) in self.steps.iter().enumerate() {
            all = all & !taken | all << (32 >> step) & taken;
        }
        all & self.valid
    }
}

/// The permutation for each value of the valid bits.
static WAYS: [Ways; 256] = {
    let mut ways = [const { Ways::new(0) }; 256];
    let mut valid = 0;
    while valid < 256 {
        ways[valid] = Ways::new(valid);
        valid += 1;
    }
    ways
};
