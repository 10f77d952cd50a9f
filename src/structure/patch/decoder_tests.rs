use super::*;
use crate::geom::surface::dice::BicubicPatch;
use crate::structure::nodes::Node;
use crate::structure::patch::build::{BuiltFrame, Plans, Tile, Upper, build, encode, words_of};
use crate::structure::patch::layout::FRAME_WORDS;
use crate::structure::patch::net::Net;
use crate::structure::patch::nodes;
use crate::structure::place::Place;
use bytemuck::Zeroable;
use glam::{DVec3, Vec3};

/// A coarse block, two fine ones and their leaf blocks.
const TREE: TreeBlocks = TreeBlocks { first: 3, coarse_end: 4, fine_end: 6, end: 8 };
const COARSE_ID: u32 = 3;
const FINE_ID: u32 = 4;
const LEAF_ID: u32 = 6;

/// A wavy tile.
fn frame(number: usize, level: u32) -> BuiltFrame {
    let side = (1 << level) + 1;
    let at = |k: usize| {
        let [u, v] = [k % side, k / side].map(|i| i as f32 / (side - 1) as f32);
        Vec3::new(u + 1.1 * number as f32, v, 0.1 * (3.0 * u + number as f32).sin() * (4.0 * v).cos())
    };
    let positions: Vec<Vec3> = (0..side * side).map(at).collect();
    let normals = vec![Vec3::Z; positions.len()];
    let part = number as u32 % 2;
    build(&Tile {
        level,
        positions,
        normals,
        part,
        colour: Vec3::ONE,
        face: 7,
        corner: 0,
        place: [2, 3, 1],
        is_turned: false,
        square: [0; 3],
        steps: [0; 4],
        patch: None,
    })
}

/// A tile of a saddle, rational or not: one of the squares of a level of its patch.
fn of_saddle(place: [[u32; 2]; 2], level: u32, is_rational: bool, steps: [u32; 4]) -> BuiltFrame {
    let weight = |i: usize| if is_rational { 1.0 + 0.25 * (i % 3) as f64 } else { 1.0 };
    let patch = BicubicPatch {
        points: std::array::from_fn(|i| {
            let (x, y) = ((i % 4) as f64 / 3.0, (i / 4) as f64 / 3.0);
            (DVec3::new(x, y + 30.0, x * y - 0.5 * x) * weight(i)).extend(weight(i))
        }),
        is_rational,
        place,
    };
    let words = words_of(&patch);
    let shape = steps.iter().enumerate().map(|(side, step)| step << (4 * side)).sum();
    let net = Net::at(&words, is_rational).unwrap();
    let computed = Computed { net, net_at: 0, place, steps: shape, corrections: &[] };
    let side = (1usize << level) + 1;
    let all = |at: usize| (at % side, at / side);
    let mut positions: Vec<Vec3> = (0..side * side).map(all).map(|(i, j)| computed.vertex(level, i, j)).collect();
    // A correction.
    positions[side + 1].z += 1e-3;
    build(&Tile {
        level,
        positions,
        normals: (0..side * side).map(all).map(|(i, j)| computed.normal(level, i, j)).collect(),
        part: 1,
        colour: Vec3::ONE,
        face: 8,
        corner: 0,
        place: [3, 1, 2],
        is_turned: false,
        square: [3, 1, 2],
        steps,
        patch: Some(patch),
    })
}

/// A coarse, a fine and a leaf block of a tree: ten stored frames, the first of which has a quadtree of two levels, and
/// three computed ones with two nets.
fn sound() -> [Vec<u32>; 3] {
    let block = |frames: std::ops::Range<usize>| {
        let mut plans = Plans::default();
        for number in frames {
            plans.push(frame(number, if number == 0 { 3 } else { 1 }));
        }
        for (place, is_rational) in [([[2, 1], [2, 3]], false), ([[3, 0], [3, 7]], true), ([[2, 2], [2, 3]], false)] {
            let frame = of_saddle(place, 2, is_rational, [0, 1, 2, 0]);
            assert_eq!((frame.grid[6], frame.net.is_some()), (1 << 16 | 2 << 8 | 1 << 4, true));
            plans.push(frame);
        }
        let ([fine, leaf], cell, _) = encode(plans.close().pop().unwrap());
        ([fine.payload, leaf.payload], cell)
    };
    let ([fine, leaf], first) = block(0..10);
    let (_, second) = block(20..21);
    let coarse = Upper::over(vec![first, second]).encode(0, TREE.first).payload;
    [coarse, fine, leaf].map(|payload| payload.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect())
}

/// Words of a node.
fn node_at(index: usize) -> usize {
    HEAD_WORDS + NODE_WORDS * index
}

/// A slot of node 0 whose child is of a kind.
fn slot(words: &[u32], is_it: fn(Child) -> bool) -> usize {
    let node = Block(words).node(0).unwrap();
    node.children().find(|it| is_it(it.1)).unwrap().0
}

/// Words to be replaced, and the fault.
type Damage = (Vec<(usize, u32)>, &'static str);

fn each_is_found(good: &[u32], id: u32, damages: Vec<Damage>) {
    assert_eq!(validate(good, id, TREE), Ok(()));
    for (edits, why) in damages {
        let mut words = good.to_vec();
        edits.into_iter().for_each(|(at, word)| words[at] = word);
        assert_ne!(words, good, "{why}");
        assert!(validate(&words, id, TREE).is_err(), "{why}");
    }
    for length in 0..good.len() {
        assert!(validate(&good[..length], id, TREE).is_err(), "cut to {length} words");
    }
    assert!(validate(&[good, &[0]].concat(), id, TREE).is_err(), "a word more");
}

/// Damages of the head, of node 0 and of its first voxel that blocks of both classes of nodes have.
fn of_nodes(words: &[u32], slot: usize) -> Vec<Damage> {
    let (node, nodes, nan) = (node_at(0), words[1] & 0xffff, f32::NAN.to_bits());
    let (reference, voxel) = (node + 48 + slot, words[node + 56 + slot] as usize);
    let children = Block(words).node(0).unwrap().children().count();
    let mut all: Vec<Damage> = vec![
        (vec![(0, 0)], "no kind"),
        (vec![(0, GRIDS)], "the kind of a leaf block"),
        (vec![(1, words[1] - nodes)], "no nodes"),
        (vec![(1, words[1] + 1)], "a node more"),
        (vec![(1, words[1] + 1), (2, words[2] + NODE_WORDS as u32)], "a node more, and voxels behind it"),
        (vec![(1, words[1] | 0xffff)], "many nodes"),
        (vec![(1, words[1] | 0xffff << 16)], "many frames"),
        (vec![(1, words[1] + (1 << 16))], "a frame more"),
        (vec![(2, words[2] + 1)], "voxels a word later"),
        (vec![(2, u32::MAX)], "voxels nowhere"),
        (vec![(3, words[3] - 1)], "frames a word before"),
        (vec![(3, 0)], "frames before the voxels"),
        (vec![(3, u32::MAX)], "frames nowhere"),
        (vec![(node + slot, nan)], "a low plane of NaN"),
        (vec![(node + slot, f32::NEG_INFINITY.to_bits())], "an infinite low plane"),
        (vec![(node + 40 + slot, f32::INFINITY.to_bits())], "an infinite high plane"),
        (vec![(node + 40 + slot, (-1e9f32).to_bits())], "an inverted box"),
        (vec![(reference, 0)], "no reference, but a voxel"),
        (vec![(reference, 3 << 30 | 1)], "a reference of no kind"),
        (vec![(reference, nodes)], "a reference to a node that does not exist"),
        (vec![(reference, (1 << 30) - 1)], "a reference to a node beyond all"),
        (vec![(reference, Child::Frame(node).to_bits())], "a reference to a frame where a node is"),
        (vec![(node + 48, 0)], "a gap between children"),
        (vec![(node + 56 + slot, 0)], "no voxel"),
        (vec![(node + 56 + slot, voxel as u32 + 1)], "a voxel a word later"),
        (vec![(node + 56 + slot, u32::MAX)], "a voxel nowhere"),
        (vec![(voxel, words[voxel] | 1 << LEVEL.0)], "a voxel with a level"),
        (vec![(voxel + 1, words[voxel + 1] | 9 << 26)], "a voxel with a stop code"),
        (vec![(voxel + 1, words[voxel + 1] ^ 1 << 24)], "a voxel with, or without, samples of sides"),
        (vec![(voxel + 3, words[voxel + 3] | 1 << 30)], "a voxel with curtains"),
        (vec![(voxel + 3, 5), (voxel + 4, 1 << 6)], "a voxel of one part with the summary of another"),
    ];
    all.extend((4..HEAD_WORDS).map(|at| (vec![(at, 1)], "a word of the head that is not zero")));
    // The last slot of node 0 is used in fine blocks.
    let index = if children < WIDTH { 0 } else { 1 };
    let unused = node_at(index) + WIDTH - 1;
    assert_eq!(words[unused + 48], 0);
    all.extend([
        (vec![(unused, nan)], "NaN in an unused slot"),
        (vec![(unused, 0), (unused + 24, 0)], "a flat box in an unused slot"),
        (vec![(unused + 24, 0)], "a plane in an unused slot"),
        (vec![(unused + 48, 3 << 30)], "a reference of no kind in an unused slot"),
        (vec![(unused + 56, voxel as u32)], "a voxel in an unused slot"),
    ]);
    all
}

#[test]
fn each_damage_of_coarse_blocks_is_found() {
    let [coarse, ..] = sound();
    let at = |slot: usize| node_at(0) + 48 + slot;
    let to = |id: u32| Child::Block(id).to_bits();
    let mut all = of_nodes(&coarse, slot(&coarse, |child| matches!(child, Child::Block(_))));
    all.extend([
        (vec![(at(0), to(COARSE_ID))], "a reference to the block itself"),
        (vec![(at(0), to(COARSE_ID - 1))], "a reference to a block before"),
        (vec![(at(0), to(LEAF_ID))], "a reference to a leaf block"),
        (vec![(at(0), to((1 << 30) - 1))], "a reference to a block beyond all"),
    ]);
    each_is_found(&coarse, COARSE_ID, all);
}

#[test]
fn each_damage_of_fine_blocks_is_found() {
    let [_, fine, _] = sound();
    let (node, nan) = (node_at(0), f32::NAN.to_bits());
    let of_node = slot(&fine, |child| matches!(child, Child::Node(_)));
    let of_frame = slot(&fine, |child| matches!(child, Child::Frame(_)));
    let second = (of_frame + 1..WIDTH).find(|slot| Block(&fine).node(0).unwrap().child(*slot) != Child::None).unwrap();
    let (first, other) = (node + 48 + of_frame, node + 48 + second);
    let frame = fine[3] as usize;
    let tree = frame + FRAME_WORDS + 5;
    let mut all = of_nodes(&fine, of_node);
    all.extend([
        (vec![(1, fine[1] - (1 << 16))], "a frame less"),
        (vec![(1, fine[1] & 0xffff)], "no frames"),
        (vec![(3, fine[3] + 1)], "frames a word later"),
        (vec![(node + 48 + of_node, Child::Block(FINE_ID + 1).to_bits())], "a reference to another block"),
        (vec![(first, fine[first] + 1)], "a reference to the second word of a frame"),
        (vec![(first, Child::Frame(fine.len()).to_bits())], "a reference to a frame behind the last"),
        (vec![(first, fine[node + 48 + of_node])], "two references to a node"),
        (vec![(first, fine[other])], "two references to a frame"),
        (vec![(node + 56 + of_frame, fine[node + 56 + of_node])], "a frame with a voxel"),
        (vec![(frame + 14, fine[frame + 14] ^ 1)], "another number of levels"),
        (vec![(frame + 14, fine[frame + 14] | 15)], "a quadtree beyond the block"),
        (vec![(frame + 14, fine[frame + 14] | 1 << 4)], "reserved bits"),
        (vec![(frame + 14, fine[frame + 14] | 1 << 15)], "reserved bits"),
        (vec![(frame + 14, fine[frame + 14] | 1 << 16)], "another grid"),
        (vec![(tree + 14, fine[tree + 14] - (1 << 16))], "the same grid twice"),
        (vec![(frame + 15, 13 | 3 << 4 | 1 << 16)], "a place below the finest"),
        (vec![(frame + 15, 2 | 4 << 4 | 1 << 16)], "a column beyond the face"),
        (vec![(frame + 15, 2 | 3 << 4 | 4 << 16)], "a row beyond the face"),
        (vec![(frame + 15, fine[frame + 15] | 1 << 31)], "the highest bit of a place"),
        (vec![(frame + 15, fine[frame + 15] | 1 << 29)], "the lowest bit of a place that has no meaning"),
        (vec![(frame + 3, 0), (frame + 4, 0), (frame + 5, 0)], "a map without a first row"),
        ((0..3).map(|i| (frame + 6 + i, fine[frame + 3 + i])).collect(), "a map with the same row twice"),
        ((3..12).map(|i| (frame + i, 1f32.to_bits())).collect(), "a map with equal rows"),
    ]);
    for at in 0..12 {
        all.push((vec![(frame + at, nan)], "a frame with NaN"));
        all.push((vec![(tree + at, f32::INFINITY.to_bits())], "a frame with infinity"));
    }
    each_is_found(&fine, FINE_ID, all);
}

#[test]
fn each_damage_of_leaf_blocks_is_found() {
    let [.., leaf] = sound();
    let (count, nan) = (leaf[1] as usize, f32::NAN.to_bits());
    let [first, second] = [2, 3].map(|at| leaf[at] as usize);
    let mut all = vec![
        (vec![(0, 0)], "no kind"),
        (vec![(0, NODES)], "the kind of nodes"),
        (vec![(1, 0)], "no grids"),
        (vec![(1, leaf[1] - 1)], "a grid less"),
        (vec![(1, leaf[1] + 1)], "a grid more"),
        (vec![(1, MOST_GRIDS as u32 + 1)], "more grids than a block may have"),
        (vec![(1, u32::MAX)], "many grids"),
        (vec![(2, leaf[3])], "a position of another grid"),
        (vec![(2, 0)], "a grid in the head"),
        (vec![(2, u32::MAX)], "a grid nowhere"),
        (vec![(1 + count, leaf[1 + count] + 1)], "the last grid a word later"),
        (vec![(first + 2, 0)], "a grid of level 0"),
        (vec![(first + 2, MOST_LEVEL + 1)], "a grid with too high a level"),
        (vec![(first + 2, u32::MAX)], "a grid without a level"),
        (vec![(first + 2, 2)], "a coarser grid"),
        (vec![(second + 2, 4)], "a finer grid"),
        (vec![(first + 3, 1)], "normals that begin later"),
        (vec![(second + 3, 0)], "the same normals twice"),
        (vec![(first + 4, nan)], "a vertex of NaN"),
    ];
    let [smooth, rational, last] = [10, 11, 12].map(|number| leaf[2 + number] as usize);
    let net = leaf[smooth + 4] as usize;
    assert_eq!((leaf[rational + 4] as usize, leaf[last + 4] as usize), (net + NET_WORDS, net));
    assert_eq!(leaf.len(), net + NET_WORDS + RATIONAL_WORDS);
    all.extend([
        (vec![(first + 2, leaf[first + 2] | IS_RATIONAL)], "a stored grid that is rational"),
        (vec![(first + 2, leaf[first + 2] | IS_COMPUTED)], "a stored grid as a computed one"),
        (vec![(first + 2, leaf[first + 2] | 1 << 6)], "a kind that does not exist"),
        (vec![(smooth + 2, 2)], "a computed grid as a stored one"),
        (vec![(smooth + 2, 2 | IS_COMPUTED | IS_RATIONAL)], "a net with weights that it does not have"),
        (vec![(rational + 2, 2 | IS_COMPUTED)], "a net without its weights"),
        (vec![(last + 2, 2 | IS_COMPUTED | IS_RATIONAL)], "two kinds of one net"),
        (vec![(smooth + 3, leaf[smooth + 3] + 1)], "normals of a computed grid"),
        (vec![(smooth + 4, net as u32 + 1)], "a net a word later"),
        (vec![(smooth + 4, leaf[rational + 4])], "nets that do not begin with the first"),
        (vec![(rational + 4, net as u32)], "a net of another kind"),
        (vec![(last + 4, u32::MAX)], "a net nowhere"),
        (vec![(smooth + 5, 13 | 13 << 28)], "a place below the finest"),
        (vec![(smooth + 5, 2 | 4 << 4 | 2 << 28)], "a column beyond the patch"),
        (vec![(smooth + 5, 2 | 4 << 16 | 2 << 28)], "a row beyond the patch"),
        (vec![(smooth + 5, leaf[smooth + 5] & 0x0fff_ffff)], "no level along v, but a row"),
        (vec![(smooth + 6, leaf[smooth + 6] | 3)], "an edge that is coarser than the grid"),
        (vec![(smooth + 6, leaf[smooth + 6] | 8 << 12)], "the last edge coarser than the grid"),
        (vec![(smooth + 6, leaf[smooth + 6] + (1 << 16))], "a correction more"),
        (vec![(smooth + 6, leaf[smooth + 6] - (1 << 16))], "a correction less"),
        (vec![(smooth + 7, 25)], "a correction of a vertex that does not exist"),
        (vec![(smooth + 8, nan)], "a correction of NaN"),
        (vec![(net + 1, f64::NAN.to_bits().wrapping_shr(32) as u32)], "a control point of NaN"),
        (vec![(net + 95, 0x7ff0_0000)], "an infinite control point"),
        (vec![(net + 95, 0x7fe0_0000)], "a control point that is too far for single precision"),
        (vec![(net + NET_WORDS + 97, 0), (net + NET_WORDS + 96, 0)], "a weight of 0"),
        (vec![(net + NET_WORDS + 97, 0xbff0_0000)], "a weight below 0"),
    ]);
    let end = smooth - 1;
    all.extend([second - 1, second + 4, end].map(|at| (vec![(at, f32::INFINITY.to_bits())], "an infinite vertex")));
    each_is_found(&leaf, LEAF_ID, all);
}

/// Voxels with samples of sides have no use for the second word of their mean.
#[test]
fn second_words_of_voxels_with_sides_are_zero() {
    let [coarse, fine, _] = sound();
    let mut met = 0;
    for (good, id) in [(coarse, COARSE_ID), (fine, FINE_ID)] {
        let block = Block(&good);
        for node in (0..block.nodes()).map(|index| block.node(index).unwrap()) {
            let voxels = node.children().filter(|it| block.voxel(&node, it.0).is_some_and(|v| v.sides().is_some()));
            for (slot, _) in voxels {
                let mut words = good.clone();
                words[node.0[56 + slot] as usize + 2] = 1;
                assert!(validate(&words, id, TREE).is_err());
                met += 1;
            }
        }
    }
    assert!(met > 0);
}

#[test]
fn blocks_are_accepted_in_their_class_only() {
    let blocks = sound();
    for (class, words) in blocks.iter().enumerate() {
        for (other, id) in [COARSE_ID, FINE_ID, LEAF_ID].into_iter().enumerate() {
            assert_eq!(validate(words, id, TREE).is_ok(), class == other, "class {class} in place of {other}");
        }
    }
}

/// All that reads a block finds its way through any words that pass.
fn read_all(words: &[u32], id: u32) {
    let _ = nodes::parts_and_blocks(words);
    let mut out = Node::zeroed();
    // Items that exist, and others.
    let others = (0..32).flat_map(|bit| [1 << bit, u32::MAX << bit]);
    for item in nodes::items(words).into_iter().chain(others) {
        let place = Place { block: id, item };
        nodes::node(words, place, (TREE.leaves_at(), &[0.0; 3]), &mut out);
        nodes::triangles(words, place, |_, _| {});
    }
    for number in [0, 1, MOST_GRIDS, usize::MAX] {
        let Some(grid) = Grids(words).grid(number) else { continue };
        let is_there = |tri: u32| grid.triangle(tri).is_some() == grid.corners(tri).is_some();
        assert!((0..1 << 13).step_by(61).all(is_there));
    }
}

/// Every word takes every bit and some extreme values: no check panics, and no reader of words that pass.
#[test]
fn any_words_that_pass_can_be_read() {
    let extremes = [0, 1, u32::MAX, f32::NAN.to_bits(), f32::MAX.to_bits(), f32::MIN.to_bits(), 1, 0x8000_0000];
    for (good, id) in sound().into_iter().zip([COARSE_ID, FINE_ID, LEAF_ID]) {
        let (mut words, mut passed, mut refused) = (good.clone(), 0, 0);
        // Vertices of grids are alike.
        let step = if id == LEAF_ID { 3 } else { 1 };
        for at in (0..8.min(good.len())).chain((8..good.len()).step_by(step)) {
            let flips = (0..32).map(|bit| good[at] ^ 1 << bit);
            for (i, word) in extremes.into_iter().chain(flips).enumerate() {
                words[at] = word;
                if validate(&words, id, TREE).is_err() {
                    refused += 1;
                    continue;
                }
                passed += 1;
                // Reading is slow; low bits of numbers change little.
                if i < extremes.len() || i.is_multiple_of(5) {
                    read_all(&words, id);
                }
            }
            words[at] = good[at];
        }
        assert!(passed > 1000 && refused > 1000, "block {id}: {passed}, {refused}");
    }
}
