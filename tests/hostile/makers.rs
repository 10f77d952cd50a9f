//! Makers of hostile model files: all checksums are right.

use crate::raw::{Raw, RawBlock};
use outcrop::store::{Header, MaterialRow, Options, PartRow, TreeRow, Writer};
use std::path::Path;

/// Kinds of sections.
const PARTS: u32 = 2;
/// Oriented slabs that are the whole cell.
const SLABS: u32 = 127 << 7 | 31 << 25;
const MEAN_COLOUR: u32 = 0xff00_0000;
/// Words before and behind the content of a block.
const FRAME: usize = 16 + 16;

/// A child of a node.
#[derive(Clone, Copy)]
pub enum Child {
    Node,
    Leaf,
    /// A node of another block.
    External(u32, u32),
}

/// A payload and the bytes of its trace form.
type Payload = (Vec<u8>, u32);

/// Numbers as planes of bytes.
fn planes(words: &[u32]) -> Vec<u8> {
    (0..4).flat_map(|byte| words.iter().map(move |word| word.to_le_bytes()[byte])).collect()
}

/// The table of nodes: each fills the cube from 0 to 255 / 128 and has the given children. Also returns the words.
fn nodes(nodes: &[&[Child]], leaves: u16) -> (Vec<u8>, usize) {
    let all: Vec<Child> = nodes.iter().flat_map(|children| children.iter().copied()).collect();
    let externals: Vec<[u32; 2]> = all
        .iter()
        .filter_map(|child| if let Child::External(block, node) = child { Some([*block, *node]) } else { None })
        .collect();
    let mut out = Vec::new();
    out.extend([nodes.len() as u16, externals.len() as u16, leaves].map(u16::to_le_bytes).concat());
    (0..3).for_each(|_| out.extend(planes(&vec![0; nodes.len()])));
    let grid = |children: &&[Child]| 0x0078_7878 | ((1u32 << children.len()) - 1) << 24;
    out.extend(planes(&nodes.iter().map(grid).collect::<Vec<_>>()));
    out.extend((0..6).flat_map(|row| vec![if row < 3 { 0 } else { 255u8 }; all.len()]));
    for children in nodes {
        let kinds = children.iter().enumerate().fold(0u16, |kinds, (slot, child)| {
            let kind = match child {
                Child::Node => 1,
                Child::Leaf => 2,
                Child::External(..) => 3,
            };
            kinds | kind << (2 * slot)
        });
        out.extend(kinds.to_le_bytes());
    }
    (0..2).for_each(|i| out.extend(planes(&externals.iter().map(|external| external[i]).collect::<Vec<_>>())));
    out.push(2);
    out.extend(0u32.to_le_bytes());
    for word in [0, MEAN_COLOUR, SLABS] {
        out.extend(planes(&vec![word; all.len()]));
    }
    (out, FRAME + 32 * nodes.len() + 3 * externals.len() + nodes.len() + 2 * all.len())
}

pub fn coarse(table: &[&[Child]]) -> Payload {
    let (nodes, words) = nodes(table, 0);
    ([&[2], &nodes[..], &[0, 0]].concat(), 4 * words as u32)
}

/// Nodes over the leaves of [`leaves`].
pub fn fine(table: &[&[Child]]) -> Payload {
    let count = table.iter().flat_map(|children| children.iter()).filter(|child| matches!(child, Child::Leaf)).count();
    let (nodes, words) = nodes(table, count as u16);
    ([&[2], &nodes[..], &17u16.to_le_bytes(), &vec![11; count]].concat(), 4 * words as u32)
}

/// Leaves of one triangle each, with three vertices.
pub fn leaves(triangles: &[[[f32; 3]; 3]]) -> Payload {
    let count = triangles.len();
    let mut out = vec![3];
    out.extend([count as u16, 1, count as u16].map(u16::to_le_bytes).concat());
    out.extend([3 * count as u32, 0].map(u32::to_le_bytes).concat());
    // One triangle of three vertices; part 0, as two bytes.
    out.extend(vec![0; 3 * count]);
    let mut corners: Vec<u8> = (0..3 * count).map(|i| (i % 3) as u8).collect();
    corners.resize(corners.len().next_multiple_of(2), 0);
    out.extend(corners.chunks(2).map(|pair| pair[0] | pair[1] << 4));
    out.extend(vec![0; (3 * count).div_ceil(8)]);
    for axis in 0..3 {
        let mut before = 0u32;
        let mut steps: Vec<u32> = triangles
            .as_flattened()
            .iter()
            .map(|vertex| {
                let bits = vertex[axis].to_bits();
                let ordered = if bits >> 31 == 0 { bits | 1 << 31 } else { !bits };
                let step = ordered.wrapping_sub(std::mem::replace(&mut before, ordered)) as i32;
                (step << 1 ^ step >> 31) as u32
            })
            .collect();
        steps.resize(steps.len().next_multiple_of(16), 0);
        // Each number takes 32 bits.
        out.extend(vec![32; steps.len() / 16]);
        out.extend(steps.iter().flat_map(|step| step.to_le_bytes()));
    }
    (out, 4 * (FRAME + 1 + 11 * count) as u32)
}

pub fn prims(ids: &[u8]) -> Payload {
    // Each id is the one before plus one at most 63 greater.
    let steps = ids.iter().scan(0, |before, &id| Some((id - std::mem::replace(before, id)) << 1));
    ([&[4], &(ids.len() as u32).to_le_bytes()[..], &steps.collect::<Vec<u8>>()].concat(), 4 * ids.len() as u32)
}

/// A file with one tree of these blocks. `fine`: how many of them are fine; the last ones are as many leaf blocks.
pub fn file(path: &Path, blocks: &[Payload], fine: u32) {
    let count = blocks.len() as u32;
    let mut writer = Writer::create(path).unwrap();
    for (payload, decoded) in blocks {
        writer.block(payload, *decoded).unwrap();
    }
    for i in 0..count {
        let (payload, decoded) = prims(if i + 1 == count { &[0] } else { &[] });
        writer.block(&payload, decoded).unwrap();
    }
    let side = 255.0 / 128.0;
    let header = Header {
        geometry_blocks: count,
        bounds: [0.0, 0.0, 0.0, side, side, side],
        triangles_in: 1,
        triangles_kept: 1,
        options: Options { sample_bytes: 8, ..Options::default() },
        ..Header::default()
    };
    let part = PartRow {
        id: 1,
        name: "bomb".into(),
        parent: None,
        material: 0,
        bounds: header.bounds,
        triangles: 1,
        flags: 0,
    };
    let material = MaterialRow { colour: [0.5; 3], opacity: 1.0, metalness: 0.0, roughness: 0.6 };
    let tree = TreeRow {
        block_count: count,
        class_blocks: [count - 2 * fine, fine, fine, 0],
        bounds: header.bounds.map(|x| x as f32),
        triangles: 1,
        references: 1,
        nodes: u64::from(count - 1),
        leaves: 1,
        local_parts: 1,
        max_stack: 8 * (count + 1),
        ..TreeRow::EMPTY
    };
    writer.finish(&header, &[part], &[material], &[], &[tree]).unwrap();
}

/// A triangle that lies within every node.
pub const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.5], [1.9, 0.0, 0.5], [0.0, 1.9, 0.5]];

/// `levels` blocks of one node each, over a leaf; the children of each node are `children` of the level above the next.
pub fn levels(path: &Path, levels: u32, children: impl Fn(u32) -> Vec<Child>) {
    let mut blocks: Vec<Payload> = (0..levels).map(|level| coarse(&[&children(level)])).collect();
    blocks.push(fine(&[&[Child::Leaf]]));
    blocks.push(leaves(&[TRIANGLE]));
    file(path, &blocks, 1);
}

/// A sound file: one reference from level to level.
pub fn chain(path: &Path, count: u32) {
    levels(path, count, |level| vec![Child::External(level + 1, 0)]);
}

/// Changes a file.
pub fn edit(path: &Path, change: impl FnOnce(&mut Raw)) {
    let mut raw = Raw::of(&std::fs::read(path).unwrap());
    change(&mut raw);
    raw.write(path);
}

/// One LZ4 block of `len` bytes that begin with `head` and go on with zeros.
pub fn zeros_after(head: &[u8], len: usize) -> Vec<u8> {
    fn length(out: &mut Vec<u8>, mut rest: usize) {
        while rest >= 255 {
            out.push(255);
            rest -= 255;
        }
        out.push(rest as u8);
    }
    let literals = [head, &[0]].concat();
    let mut out = vec![(literals.len().min(15) as u8) << 4 | 15];
    if literals.len() >= 15 {
        length(&mut out, literals.len() - 15);
    }
    out.extend(&literals);
    out.extend(1u16.to_le_bytes());
    length(&mut out, len - literals.len() - 12 - 4 - 15);
    out.push(12 << 4);
    out.extend([0; 12]);
    out
}

/// A root block whose payload has `len` bytes: zeros behind the true content.
pub fn large_root(path: &Path, block_size: u32, len: usize) {
    chain(path, 1);
    edit(path, |raw| {
        raw.header[52..56].copy_from_slice(&block_size.to_le_bytes());
        let (payload, decoded_len) = coarse(&[&[Child::External(1, 0)]]);
        let stored = zeros_after(&payload, len);
        raw.blocks[0] = RawBlock { stored, payload_len: len as u32, decoded_len, codec: 1 };
    });
}

/// A block of primitive ids that states `count` ids of zero.
pub fn many_ids(path: &Path, block_size: u32, count: u32, decoded_len: u32) {
    chain(path, 1);
    edit(path, |raw| {
        raw.header[52..56].copy_from_slice(&block_size.to_le_bytes());
        let head = [&[4][..], &count.to_le_bytes()].concat();
        let payload_len = count + 5;
        let stored = zeros_after(&head, payload_len as usize);
        *raw.blocks.last_mut().unwrap() = RawBlock { stored, payload_len, decoded_len, codec: 1 };
    });
}

/// `count` parts with names of `name_len` bytes.
pub fn many_parts(path: &Path, count: u32, name_len: u32) {
    chain(path, 1);
    edit(path, |raw| {
        let parts = raw.section(PARTS);
        let (row, name) = parts.bytes.split_at(80);
        let (row, name) = (row.to_vec(), name.to_vec());
        parts.bytes = row.clone();
        for i in 1..count {
            let mut row = row.clone();
            row[..8].copy_from_slice(&u64::from(i + 10).to_le_bytes());
            row[8..16].fill(0);
            row[72..76].copy_from_slice(&name_len.to_le_bytes());
            parts.bytes.extend(row);
        }
        parts.bytes.extend(name);
        parts.bytes.resize(parts.bytes.len() + (name_len * (count - 1)) as usize, b'n');
        parts.count = count.into();
    });
}

/// A part with a name of `len` bytes, none of which is on the disk.
pub fn huge_name(path: &Path, len: u32) {
    chain(path, 1);
    edit(path, |raw| {
        let parts = raw.section(PARTS);
        parts.bytes.truncate(80);
        parts.bytes[72..76].copy_from_slice(&len.to_le_bytes());
        parts.zeros = len.into();
    });
}

/// A part with this name.
pub fn named(path: &Path, name: &[u8]) {
    chain(path, 1);
    edit(path, |raw| {
        let parts = raw.section(PARTS);
        parts.bytes.truncate(80);
        parts.bytes[72..76].copy_from_slice(&(name.len() as u32).to_le_bytes());
        parts.bytes.extend(name);
    });
}
