//! Tests of the codec: random blocks survive a round trip, and damaged payloads are refused or decode to a sound block.

use super::codec::{self, Checked, Holds, Place, decode_with, encode_geometry};
use super::layout::{
    Child, EXTERNAL_WORDS, HEADER_WORDS, LONG_VOXEL, MAX_NODES, MAX_TRIANGLES, MAX_VERTICES, MAX_WORDS, NODE_WORDS,
    Node, PAD_WORDS, SHORT_VOXEL, WIDTH, leaf_block_head, put_transmitting,
};
use super::leaf::{APART, LeafForm, NEAR};
use super::validate::validate;
use crate::lod::{SIDES_WORDS, stop_bits};
use crate::simd::{Isa, Portable};
use proptest::prelude::*;

/// Generator of repeatable numbers (splitmix64).
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n as u64) as usize
    }
    fn word(&mut self) -> u32 {
        self.below(1 << 32) as u32
    }
}

/// Returns the words of `count` leaves in their required form, the number of triangles, and the first word of each
/// leaf. Half of the leaves have vertices on a small grid, some of them shared. The triangles of the other half have
/// vertices of their own, so near each other that steps from the first vertex fit 24 bits, or just do not.
fn leaves(random: &mut Random, count: usize, parts: usize) -> (Vec<u32>, usize, Vec<usize>) {
    let (mut words, mut triangles, mut starts) = (Vec::new(), 0, Vec::new());
    for _ in 0..count {
        let is_apart = random.below(2) == 0;
        let t = 1 + random.below(if is_apart { MAX_VERTICES / 3 } else { MAX_TRIANGLES });
        let v = if is_apart { 3 * t } else { 3 + random.below(MAX_VERTICES - 2) };
        let (is_mixed, begin) = (random.below(3) == 0, words.len());
        starts.push(begin);
        let mut part = || random.below(parts) as u32;
        let own: Vec<u32> = (0..if is_mixed { t } else { 1 }).map(|_| part()).collect();
        let in_order = |at: usize| 3 * (at % t) as u8 + (at / t) as u8;
        let mut corners: Vec<u8> =
            (0..3 * t).map(|at| if is_apart { in_order(at) } else { random.below(v) as u8 }).collect();
        if is_apart && random.below(8) == 0 {
            corners.swap(0, 3 * t - 1);
        }
        let mut axes = [[0; MAX_VERTICES]; 3];
        for axis in &mut axes {
            let first = random.below(9) as f32 * 0.3 - 1.0;
            let step = [-(1 << 23) - 1, -(1 << 23), -1, 0, 3, (1 << 23) - 1, 1 << 23];
            // The outer steps, which do not fit, occur in few leaves only.
            let outer = usize::from(random.below(8) > 0);
            let mut steps = || step[outer + random.below(step.len() - 2 * outer)];
            *axis = std::array::from_fn(|i| first.to_bits().wrapping_add_signed(if i == 0 { 0 } else { steps() }));
            if !is_apart {
                *axis = std::array::from_fn(|_| (random.below(9) as f32 * 0.3 - 1.0).to_bits());
            }
        }
        let form = LeafForm::of(
            Portable::new(),
            (t, v),
            is_mixed,
            (0..3 * t).all(|at| corners[at] == in_order(at)),
            axes.each_ref(),
        );
        words.push(t as u32 | (v as u32) << 8 | (triangles as u32) << 16);
        words.push(own[0] | u32::from(form.flags) << 16);
        if is_mixed {
            words.extend(own.chunks(2).map(|pair| pair[0] | pair.get(1).copied().unwrap_or(0) << 16));
        }
        if form.flags & APART == 0 {
            corners.resize(corners.len().next_multiple_of(4), 0);
            words.extend(corners.chunks_exact(4).map(|c| u32::from_ne_bytes([c[0], c[1], c[2], c[3]])));
        }
        if form.flags & NEAR == 0 {
            axes.iter().for_each(|axis| words.extend(&axis[..v]));
        } else {
            words.extend(axes.map(|axis| axis[0]));
            let steps = axes.iter().flat_map(|axis| axis[1..v].iter().map(|bits| bits.wrapping_sub(axis[0])));
            let mut bytes: Vec<u8> = steps.flat_map(|step| step.to_le_bytes().into_iter().take(3)).collect();
            bytes.resize(bytes.len().next_multiple_of(4), 0);
            words.extend(bytes.chunks_exact(4).map(|b| u32::from_ne_bytes([b[0], b[1], b[2], b[3]])));
        }
        assert_eq!(words.len() - begin, form.words());
        triangles += t;
    }
    (words, triangles, starts)
}

fn leaf_block(seed: u64) -> Vec<u32> {
    let mut random = Random(seed);
    let (count, parts) = (1 + random.below(60), 1 + random.below(5));
    let (leaves, triangles, _) = leaves(&mut random, count, parts);
    let mut words = leaf_block_head(triangles, parts).to_vec();
    words.resize(HEADER_WORDS, 0);
    words.extend((0..parts).map(|part| 3 * part as u32));
    words.extend(leaves);
    words.resize(words.len() + PAD_WORDS, 0);
    words
}

fn next(count: &mut usize) -> usize {
    *count += 1;
    *count - 1
}

/// Appends nodes in preorder and returns the first. Leaves and external references have numbers as their index.
fn tree(
    random: &mut Random,
    nodes: &mut Vec<[Option<Child>; WIDTH]>,
    counts: &mut [usize; 2],
    may_refer: bool,
    depth: usize,
) -> usize {
    let own = nodes.len();
    nodes.push([None; WIDTH]);
    let must = random.below(WIDTH);
    for slot in 0..WIDTH {
        let child = match random.below(8) {
            0 | 1 if depth > 0 => Child::Node(tree(random, nodes, counts, may_refer, depth - 1)),
            2 if may_refer => Child::External(next(&mut counts[1])),
            3 if slot != must => continue,
            _ => Child::Leaf(next(&mut counts[0])),
        };
        nodes[own][slot] = Some(child);
    }
    own
}

const PLACE: Place = Place { id: 3, end: 9, holds: Holds::All };

/// Returns a block with nodes, and its leaf block unless it holds a whole tree; `None` if they are larger than blocks
/// may be.
fn block(seed: u64, holds: Holds) -> Option<(Vec<u32>, Option<Vec<u32>>)> {
    let mut random = Random(seed);
    let (mut nodes, mut counts) = (Vec::new(), [0, 0]);
    for _ in 0..1 + random.below(2) {
        tree(&mut random, &mut nodes, &mut counts, holds == Holds::All, 3);
    }
    let parts = 1 + random.below(5);
    let [leaf_count, externals] = counts;
    let (leaf_words, triangles, starts) = leaves(&mut random, leaf_count, parts);
    let externals_at = HEADER_WORDS + nodes.len() * NODE_WORDS;
    let parts_at = externals_at + externals * EXTERNAL_WORDS;
    let (own_triangles, own_parts) = if holds == Holds::All { (triangles, parts) } else { (0, 0) };
    let size = if random.below(2) == 0 { SHORT_VOXEL } else { LONG_VOXEL };
    let (mut firsts, mut voxels, mut sides, mut curtains) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for children in &nodes {
        firsts.push((voxels.len() / size) as u32);
        // Some nodes have voxels that transmit rays, others have none.
        let codes = if random.below(3) == 0 { stop_bits(63) } else { 0 };
        for _ in children.iter().flatten() {
            let has_sides = random.below(4) == 0;
            let first = random.word() & !(1 << 24 | stop_bits(63)) | u32::from(has_sides) << 24 | random.word() & codes;
            voxels.extend([first, if has_sides { (sides.len() / SIDES_WORDS) as u32 } else { random.word() }]);
            if has_sides {
                sides.extend((0..SIDES_WORDS).map(|_| random.word()));
            }
            if size == LONG_VOXEL {
                let (part, is_mixed) = (random.below(70) as u32, random.below(2) == 1);
                let [mut part, mut last] =
                    if is_mixed { [part | 1 << 31, random.word()] } else { [part, 1 << (part % 32)] };
                if random.below(3) == 0 {
                    let at = curtains.len() as u32;
                    curtains.extend([last, random.word()]);
                    let count = 1 + random.below(3);
                    for i in 1..=count {
                        let first = random.word() & !(3 << 30 | 1 << 13) | u32::from(i == count) << 31;
                        curtains.extend([first, random.word(), random.word()]);
                    }
                    (part, last) = (part | 1 << 30, at);
                }
                voxels.extend([part, last]);
            }
        }
    }
    let leaves_at = parts_at + own_parts + firsts.len() + voxels.len() + sides.len() + curtains.len();
    let begin = if holds == Holds::All { leaves_at } else { HEADER_WORDS + parts };
    if leaves_at.max(begin + leaf_words.len()) + PAD_WORDS > MAX_WORDS {
        return None;
    }
    let (mut table, mut places) = (Vec::new(), Vec::new());
    let mut slabs = 0;
    for (i, children) in nodes.iter().enumerate() {
        let mut node: Node = bytemuck::Zeroable::zeroed();
        node.origin = [0; 3].map(|_| random.below(100) as f32 - 50.0);
        node.exponent = [0; 3].map(|_| 1 + random.below(254) as u8);
        // The planes of empty slots, as the builder writes them.
        (0..3).for_each(|axis| node.planes[axis] = [255; WIDTH]);
        for (slot, child) in children.iter().enumerate().filter_map(|(slot, child)| Some((slot, (*child)?))) {
            node.valid |= 1 << slot;
            for axis in 0..3 {
                node.planes[axis][slot] = random.below(256) as u8;
                node.planes[axis + 3][slot] =
                    node.planes[axis][slot] + random.below(256 - usize::from(node.planes[axis][slot])) as u8;
            }
            node.set_oriented_slabs(slot, random.word(), voxels[slabs] as u16);
            slabs += size;
            node.child[slot] = match child {
                Child::Leaf(leaf) => Child::Leaf(begin + starts[leaf]),
                Child::External(number) => {
                    places.push([
                        4 + random.below(5) as u32,
                        // No two references lead to one node.
                        (MAX_NODES - 1 - number) as u32,
                        i as u32 | (slot as u32) << 16,
                    ]);
                    Child::External(externals_at + number * EXTERNAL_WORDS)
                }
                node => node,
            }
            .to_bits();
        }
        table.push(node);
    }
    // The order of the references' numbers is not the order of the nodes.
    places.sort_by_key(|place| {
        let (node, slot) = ((place[2] & 0xffff) as usize, (place[2] >> 16) as usize);
        if let Some(Child::External(number)) = nodes[node][slot] { number } else { usize::MAX }
    });
    let mut words =
        vec![nodes.len() as u32 | (externals as u32) << 16, own_triangles as u32 | (own_parts as u32) << 16];
    words.extend([externals_at as u32, parts_at as u32, (parts_at + own_parts) as u32]);
    words.extend([
        (voxels.len() / size) as u32 | ((sides.len() / SIDES_WORDS) as u32) << 16,
        size as u32 | (curtains.len() as u32) << 16,
        random.word(),
    ]);
    words.resize(HEADER_WORDS, 0);
    words.extend_from_slice(bytemuck::cast_slice(&table));
    words.extend(places.as_flattened());
    words.extend((0..own_parts).map(|part| 3 * part as u32));
    [firsts, voxels, sides, curtains].iter().for_each(|run| words.extend(run));
    put_transmitting(&mut words);
    if holds == Holds::All {
        words.extend(leaf_words);
        words.resize(words.len() + PAD_WORDS, 0);
        return Some((words, None));
    }
    words.resize(words.len() + PAD_WORDS, 0);
    let mut own = leaf_block_head(triangles, parts).to_vec();
    own.resize(HEADER_WORDS, 0);
    own.extend((0..parts).map(|part| 3 * part as u32));
    own.extend(leaf_words);
    own.resize(own.len() + PAD_WORDS, 0);
    Some((words, Some(own)))
}

/// Decodes with every instruction set and checks that the results are equal.
fn decode_geometry(payload: &[u8], place: Place) -> Checked<Vec<u32>> {
    let decoded = codec::decode_geometry(payload, place);
    for isa in Isa::ALL {
        assert_eq!(decode_with(isa, payload, place), decoded, "{}", isa.name());
    }
    decoded
}

/// Tests truncated payloads and payloads with random bytes changed: each is refused or decodes to a sound block.
fn damage(payload: &[u8], place: Place, seed: u64) {
    for length in (0..payload.len()).step_by(1 + payload.len() / 50) {
        assert!(decode_geometry(&payload[..length], place).is_err(), "cut to {length} of {}", payload.len());
    }
    let mut longer = payload.to_vec();
    longer.push(0);
    assert!(decode_geometry(&longer, place).is_err(), "a byte too many");
    let mut random = Random(seed);
    for _ in 0..100 {
        let mut bytes = payload.to_vec();
        for _ in 0..1 + random.below(3) {
            // Half of the changes hit the front, where the counts are.
            let from = if random.below(2) == 0 { bytes.len().min(12) } else { bytes.len() };
            let at = random.below(from);
            bytes[at] = if random.below(2) == 0 { random.below(256) as u8 } else { bytes[at] ^ 1 << random.below(8) };
        }
        if let Ok(words) = decode_geometry(&bytes, place) {
            validate(&words, place).unwrap();
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn leaf_blocks_round_trip(seed in any::<u64>()) {
        let words = leaf_block(seed);
        let place = Place { holds: Holds::Leaves, ..PLACE };
        prop_assume!(words.len() <= MAX_WORDS);
        prop_assert_eq!(validate(&words, place), Ok(()));
        let payload = encode_geometry(&words, None);
        prop_assert_eq!(decode_geometry(&payload, place), Ok(words));
        damage(&payload, place, seed);
    }

    #[test]
    fn blocks_with_nodes_round_trip(seed in any::<u64>(), is_fine in any::<bool>()) {
        let place = Place { holds: if is_fine { Holds::NodesOverLeaves } else { Holds::All }, ..PLACE };
        let made = block(seed, place.holds);
        prop_assume!(made.is_some());
        let (words, leaves) = made.expect("looked at");
        prop_assert_eq!(validate(&words, place), Ok(()));
        let payload = encode_geometry(&words, leaves.as_deref());
        prop_assert_eq!(decode_geometry(&payload, place), Ok(words));
        damage(&payload, place, seed);
    }
}

/// Four bits hold two more vertices than walks have room for. The lengths of all following data stay right.
#[test]
fn a_leaf_of_too_many_vertices_is_refused() {
    let mut words = leaf_block_head(2, 1).to_vec();
    words.resize(HEADER_WORDS + 1, 0);
    for (first, vertices) in [(0, 16), (1, 4)] {
        words.extend([1 | vertices << 8 | first << 16, 0, 0x0002_0100]);
        words.extend((0..3 * vertices).map(|i| (i as f32).to_bits()));
    }
    words.resize(words.len() + PAD_WORDS, 0);
    let place = Place { holds: Holds::Leaves, ..PLACE };
    let mut payload = encode_geometry(&words, None);
    assert_eq!(decode_geometry(&payload, place), Ok(words));
    let shapes = 1 + 3 * 2 + 4 + 4;
    payload[shapes] += 1 << 3;
    payload[shapes + 1] -= 1 << 3;
    assert!(decode_geometry(&payload, place).is_err());
}
