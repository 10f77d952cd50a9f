//! Checks a block in trace form: everything that a walk relies on, wherever the words come from.
//!
//! The file form is checked while it is decoded (`codec.rs`). References between blocks, which no block can check by
//! itself, are checked by `check_links`.

use super::codec::{Holds, Place};
use super::codec_nodes::{TWO_PARENTS, has_duplicates};
use super::layout::{
    Block, Child, EXTERNAL_WORDS, HEADER_WORDS, LONG_VOXEL, MAX_NODES, MAX_TRIANGLES, MAX_VERTICES, MAX_WORDS,
    NODE_WORDS, Node, PAD_WORDS, SHORT_VOXEL, WIDTH,
};
use super::leaf::{APART, MIXED, NEAR};
use crate::lod::{CURTAIN_WORDS, Coded, Curtain};

/// Checks the words of a geometry block at `place`. Fails with the fault.
pub fn validate(words: &[u32], place: Place) -> Result<(), String> {
    check_header(words)?;
    let block = Block::new(words);
    check_tables(&block, place)?;
    let leaves = check_leaves(&block)?;
    let has = [block.nodes() > 0, !leaves.is_empty()];
    let should = match place.holds {
        Holds::All => [true, true],
        Holds::Leaves => [false, true],
        Holds::Nodes | Holds::NodesOverLeaves => [true, false],
    };
    ensure(has == should, "the block has an unexpected kind")?;
    check_nodes(&block, &leaves, place.holds)
}

fn ensure(holds: bool, why: &str) -> Result<(), String> {
    if holds { Ok(()) } else { Err(why.to_string()) }
}

fn check_header(words: &[u32]) -> Result<(), String> {
    let least = HEADER_WORDS + PAD_WORDS;
    ensure((least..=MAX_WORDS).contains(&words.len()), "the size of the block is out of range")?;
    let block = Block::new(words);
    let externals_at = HEADER_WORDS + block.nodes() * NODE_WORDS;
    let parts_at = externals_at + EXTERNAL_WORDS * block.externals();
    let firsts_at = parts_at + block.parts();
    let tables = [words[2], words[3], words[4]] == [externals_at as u32, parts_at as u32, firsts_at as u32];
    ensure(tables, "the positions of the tables do not match the counts")?;
    ensure([SHORT_VOXEL, LONG_VOXEL].contains(&block.voxel_words()), "the voxels have an invalid size")?;
    let may_have_curtains = block.voxel_words() == LONG_VOXEL || block.words_of_curtains() == 0;
    ensure(may_have_curtains, "voxels without parts have curtains")?;
    ensure(block.first_leaf() + PAD_WORDS <= words.len(), "the tables do not fit into the block")?;
    ensure(words[words.len() - PAD_WORDS..].iter().all(|w| *w == 0), "the padding at the end is not zero")
}

fn check_tables(block: &Block, place: Place) -> Result<(), String> {
    for (to, child) in block.all_externals() {
        ensure(place.id < to && to < place.end, "an external reference refers to an invalid block")?;
        let is_node =
            child <= u32::from(u16::MAX) && matches!(Child::from_bits(child), Child::Node(index) if index < MAX_NODES);
        ensure(is_node, "an external reference does not refer to a node")?;
    }
    ensure(!has_duplicates(block.all_externals().map(|(to, child)| [to, child])), TWO_PARENTS)?;
    check_voxels(block)?;
    ensure(block.declared_transmitting() == block.transmitting(), "the marks of transmitting nodes are wrong")?;
    let ascending = (1..block.parts()).all(|i| block.part(i - 1) < block.part(i));
    ensure(ascending, "the parts are not in ascending order")
}

/// Checks that each child of each node has a voxel, and that voxels of six sides are numbered consecutively.
fn check_voxels(block: &Block) -> Result<(), String> {
    let (mut voxels, mut sides) = (0, 0);
    for i in 0..block.nodes() {
        ensure(
            block.words()[block.words()[4] as usize + i] as usize == voxels,
            "the position of the voxels of a node is wrong",
        )?;
        voxels += block.node(i).valid.count_ones() as usize;
    }
    ensure(voxels == block.voxels(), "the voxel counts are inconsistent")?;
    for i in 0..block.nodes() {
        for slot in (0..WIDTH).filter(|slot| block.node(i).valid >> slot & 1 == 1) {
            let normal = block.voxel(i, slot).words()[0] as u16;
            ensure(
                block.node(i).stored_normal(slot) == normal,
                "the normals of a node differ from those of its voxels",
            )?;
        }
    }
    for voxel in (0..voxels).map(|v| block.voxel_at(v)).filter(|voxel| Coded::has_sides(voxel[0])) {
        ensure(voxel[1] as usize == sides, "the number of a voxel with six samples is wrong")?;
        sides += 1;
    }
    ensure(sides == block.six_sided(), "the number of voxels with six samples is wrong")?;
    check_curtains(block)
}

/// Checks that the curtains of voxels follow one another, and that those of each voxel end.
fn check_curtains(block: &Block) -> Result<(), String> {
    let (words, first, all) = (block.words(), block.curtains_at(), block.words_of_curtains());
    let mut at = 0;
    let with_some = (0..block.voxels()).map(|v| block.voxel_at(v));
    for voxel in with_some.filter(|v| v.len() == LONG_VOXEL && Coded::has_curtains(v[2])) {
        ensure(voxel[3] as usize == at, "the position of the curtains of a voxel is wrong")?;
        at += 2;
        loop {
            at += CURTAIN_WORDS;
            ensure(at <= all, "the curtains of a voxel have no end")?;
            let head = words[first + at - CURTAIN_WORDS];
            ensure(Curtain::is_sound(head), "a curtain has unknown directions")?;
            if Curtain::is_last(head) {
                break;
            }
        }
    }
    ensure(at == all, "the number of words of curtains is wrong")
}

/// Checks the leaves. Returns the first word of each leaf, ascending.
fn check_leaves(block: &Block) -> Result<Vec<usize>, String> {
    let words = block.words();
    let end = words.len() - PAD_WORDS;
    let (mut at, mut triangles, mut starts) = (block.first_leaf(), 0, Vec::new());
    while at < end {
        ensure(at + 2 <= end, "a leaf does not fit into the block")?;
        let leaf = block.leaf(at);
        let counts = (1..=MAX_TRIANGLES).contains(&leaf.triangles) && (3..=MAX_VERTICES).contains(&leaf.vertices);
        ensure(counts && words[at + 1] >> 16 <= u32::from(MIXED | APART | NEAR), "a leaf has invalid counts or flags")?;
        ensure(leaf.first == triangles, "the triangles of the leaves are not numbered consecutively")?;
        let next = at + leaf.len();
        ensure(next <= end, "a leaf does not fit into the block")?;
        let all = 0..leaf.triangles;
        ensure(
            all.clone().all(|t| leaf.part_of(t) < block.parts()),
            "the part of a triangle is not in the table of parts",
        )?;
        let corner_ok = |c: usize| leaf.corners8(c)[..leaf.triangles].iter().all(|v| usize::from(*v) < leaf.vertices);
        ensure((0..3).all(corner_ok), "a corner is not among the vertices of its leaf")?;
        let axes = [0, 1, 2].map(|axis| leaf.coordinates(axis).to_array());
        ensure(axes.iter().all(|axis| axis[..leaf.vertices].iter().all(|x| x.is_finite())), "a vertex is not finite")?;
        let bits = axes.map(|axis| axis.map(f32::to_bits));
        ensure(leaf.form() == leaf.form_for(bits.each_ref()), "a leaf is not stored in the required form")?;
        triangles += leaf.triangles;
        starts.push(at);
        at = next;
    }
    ensure(triangles == block.triangles(), "the leaf counts are inconsistent")?;
    Ok(starts)
}

fn check_grid(node: &Node) -> Result<(), String> {
    let grid = node.exponent.iter().all(|e| (1..=254).contains(e)) && node.origin.iter().all(|o| o.is_finite());
    ensure(grid && node.valid != 0, "a node has an invalid grid or no children")?;
    let ordered = |slot: usize| (0..3).all(|a| node.planes[a][slot] <= node.planes[a + 3][slot]);
    ensure((0..WIDTH).filter(|s| node.valid >> s & 1 == 1).all(ordered), "a box of a node is inverted")
}

/// Checks that nodes refer only to later nodes and that nothing has two parents. A walk then ends, and visits each leaf
/// once.
fn check_nodes(block: &Block, leaves: &[usize], holds: Holds) -> Result<(), String> {
    let mut met_nodes = vec![false; block.nodes()];
    let mut met_leaves = vec![false; leaves.len()];
    let mut met_externals = vec![false; block.externals()];
    let mut met_elsewhere = Vec::new();
    for i in 0..block.nodes() {
        let node = block.node(i);
        check_grid(node)?;
        for slot in (0..WIDTH).filter(|s| node.valid >> s & 1 == 1) {
            let met = match Child::from_bits(node.child[slot].into()) {
                // The existence of this leaf cannot be checked without the leaf block.
                Child::Leaf(at) if holds == Holds::NodesOverLeaves => {
                    met_elsewhere.push(at);
                    continue;
                }
                Child::Node(n) if n > i => met_nodes.get_mut(n),
                Child::Leaf(at) => leaves.binary_search(&at).ok().map(|l| &mut met_leaves[l]),
                Child::External(at) => {
                    let number = block.number_of_external(at).ok_or("a node has an invalid child reference")?;
                    ensure(block.place_of_external(at) == (i, slot), "an external reference has a wrong node or slot")?;
                    met_externals.get_mut(number)
                }
                _ => None,
            };
            let met = met.ok_or("a node has an invalid child reference")?;
            ensure(!std::mem::replace(met, true), "a child is referenced twice")?;
        }
    }
    met_elsewhere.sort_unstable();
    ensure(met_elsewhere.is_sorted_by(|a, b| a < b), "a child is referenced twice")?;
    // Nodes without a parent in this block are allowed: other blocks may refer to them.
    if holds == Holds::Leaves {
        return Ok(());
    }
    let all = met_leaves.iter().chain(&met_externals).all(|m| *m);
    ensure(all, "a leaf or an external reference is never used")
}

#[cfg(test)]
mod tests {
    use super::super::layout::leaf_block_head;
    use super::super::leaf::{LeafForm, put_coordinates};
    use super::*;
    use crate::simd::Portable;

    const PLACE: Place = Place { id: 3, end: 9, holds: Holds::All };

    /// A node over one leaf of one triangle and one external reference.
    fn sound() -> Vec<u32> {
        let mut node: Node = bytemuck::Zeroable::zeroed();
        node.exponent = [127; 3];
        node.valid = 0b11;
        let leaf_at = HEADER_WORDS + NODE_WORDS + EXTERNAL_WORDS + 1 + 1 + 2 * SHORT_VOXEL;
        node.child[0] = Child::Leaf(leaf_at).to_bits();
        node.child[1] = Child::External(HEADER_WORDS + NODE_WORDS).to_bits();
        node.set_oriented_slabs(0, 0, 0x1234);
        node.set_oriented_slabs(1, 0, 0);
        let mut words = vec![1 | 1 << 16, 1 | 1 << 16, 48, 51, 52, 2, SHORT_VOXEL as u32, 7];
        words.resize(HEADER_WORDS, 0);
        words.extend(bytemuck::must_cast::<Node, [u32; NODE_WORDS]>(node));
        words.extend([5, 0, 1 << 16, 7]);
        words.extend([0, 0x00ff_1234, 0x8080_8080, 0x0080_0000, 0xff00_0000]);
        // The corners are not in order, so they are stored.
        words.extend([1 | 3 << 8, 0, 0x0001_0200]);
        words.extend([0f32, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0].map(f32::to_bits));
        words.extend([0; PAD_WORDS]);
        words
    }

    #[test]
    fn a_sound_block_is_accepted_at_its_place_only() {
        validate(&sound(), PLACE).unwrap();
        assert!(validate(&sound(), Place { id: 5, ..PLACE }).is_err());
        assert!(validate(&sound(), Place { end: 5, ..PLACE }).is_err());
    }

    #[test]
    fn each_damage_is_found() {
        let nan = f32::NAN.to_bits();
        let damages: [(usize, u32, &str); 31] = [
            (0, 0, "no nodes"),
            (0, 2 | 1 << 16, "two nodes"),
            (1, 2 | 1 << 16, "two triangles"),
            (1, 1 | 900 << 16, "parts past the end"),
            (2, 25, "wrong position of the external references"),
            (4, 33, "wrong position of the voxels"),
            (5, 3, "one voxel too many"),
            (5, 2 | 1 << 16, "a voxel with six samples in the counts only"),
            (6, 3, "an invalid voxel size"),
            (6, 2 | 5 << 16, "curtains of voxels without parts"),
            (9, 1, "a transmitting mark of a node that does not exist"),
            (15, 1 << 31, "the last transmitting mark, of a node that does not exist"),
            (8, 1, "a transmitting mark of a node that stops all rays"),
            (16, nan, "a grid origin of NaN"),
            (19, 0b11 << 24, "an exponent of 0"),
            (19, 0b1 << 24 | 0x7f_7f7f, "an external reference that no node uses"),
            (20, 1, "an inverted box"),
            (32, 0x4000 | 58 | 0x8030 << 16, "a reference to the second word of a leaf"),
            (32, 0x4000 | 57 | 0x8031 << 16, "a reference to the second word of an external reference"),
            (32, 0x4000 | 57 | 0x8033 << 16, "a reference behind the last external reference"),
            (32, 0x8030 | 0x8030 << 16, "the same reference twice"),
            (32, 0x4000 | 57, "a node that is its own child"),
            (44, 0x1235, "a normal that differs from the voxel"),
            (49, 1 << 16, "an external reference with too large a node number"),
            (50, 0, "an external reference with a wrong slot"),
            (53, 1 << 24, "a voxel with six samples that are missing"),
            (53, 0x04ff_1234, "a transmitting voxel without a mark in the header"),
            (57, 9 | 3 << 8, "too many triangles in a leaf"),
            (59, 0x0002_0100, "stored corners that are in order"),
            (59, 0x0003_0100, "a corner that has no vertex"),
            (60, nan, "a vertex of NaN"),
        ];
        for (at, word, what) in damages {
            let mut words = sound();
            assert_ne!(std::mem::replace(&mut words[at], word), word, "{what}");
            assert!(validate(&words, PLACE).is_err(), "{what}");
        }
        for length in 0..sound().len() {
            assert!(validate(&sound()[..length], PLACE).is_err(), "cut to {length} words");
        }
    }

    /// A leaf block with one leaf of `count` triangles that share no vertices. It is stored according to `flags`, as
    /// far as possible.
    fn leaf_block(count: usize, flags: u16, step: u32) -> Vec<u32> {
        let vertices = 3 * count;
        let mut words = leaf_block_head(count, 1).to_vec();
        words.resize(HEADER_WORDS, 0);
        words.extend([0, count as u32 | (vertices as u32) << 8, u32::from(flags) << 16]);
        if flags & APART == 0 {
            let mut corners: Vec<u8> = (0..3).flat_map(|c| (0..count).map(move |i| (3 * i + c) as u8)).collect();
            corners.resize(corners.len().next_multiple_of(4), 0);
            words.extend(corners.chunks_exact(4).map(|c| u32::from_ne_bytes([c[0], c[1], c[2], c[3]])));
        }
        let axis: [u32; MAX_VERTICES] = std::array::from_fn(|i| 1f32.to_bits() + i as u32 * step);
        let form = LeafForm { triangles: count, vertices, flags };
        let at = words.len();
        words.resize(at + 4 * MAX_VERTICES, 0);
        let own = put_coordinates(Portable::new(), &mut words[at..], form, [&axis; 3]);
        words.truncate(at + own);
        words.resize(words.len() + PAD_WORDS, 0);
        words
    }

    #[test]
    fn only_the_required_form_of_a_leaf_is_accepted() {
        let place = Place { holds: Holds::Leaves, ..PLACE };
        // Steps do not pay for one triangle. For two triangles they do if they fit 24 bits.
        for (count, step, right) in [(1, 1, APART), (2, 1, APART | NEAR), (2, 1 << 22, APART), (5, 1, APART | NEAR)] {
            // Steps that do not fit 24 bits cannot be written.
            for flags in [0, APART, APART | NEAR].into_iter().filter(|flags| flags & NEAR == 0 || step == 1) {
                let found = validate(&leaf_block(count, flags, step), place);
                if flags == right {
                    assert_eq!(found, Ok(()), "{count} triangles, {step}");
                } else {
                    assert_eq!(
                        found.unwrap_err(),
                        "a leaf is not stored in the required form",
                        "{count} triangles, {step}, {flags}"
                    );
                }
            }
        }
        // A leaf block has no nodes, so none of them can transmit rays.
        let mut words = leaf_block(1, APART, 1);
        words[8] = 1;
        assert!(validate(&words, place).is_err());
        // A leaf with shared vertices is neither apart nor near.
        for flags in [APART, NEAR, APART | NEAR] {
            let mut words = leaf_block(2, APART, 1 << 22);
            words[HEADER_WORDS + 1] = 2 | 5 << 8;
            words[HEADER_WORDS + 2] = u32::from(flags) << 16;
            assert!(validate(&words, place).is_err(), "{flags}");
        }
    }
}
