//! Blocks of `patch` trees, read by the page alone: every vertex lies in the boxes above it.

use super::model::patches;
use super::page::{numbers, section, table};
use super::patch_page::*;
use super::payloads::bits;
use glam::DVec3;
use outcrop::base::ids::BlockId;
use outcrop::math::octahedral;
use outcrop::store::{ModelFile, TreeRow};
use outcrop::structure::patch::codes;
use outcrop::structure::patch::layout::{
    self, Block, COMPUTED_WORDS, Child, FRAME_WORDS, GRID_WORDS, Grids, HEAD_WORDS, IS_COMPUTED, IS_RATIONAL,
    LONG_VOXEL, MAX_WORDS, MOST_GRIDS, MOST_LEVEL, MOST_PLACE, NODE_WORDS, SHORT_VOXEL,
};
use outcrop::structure::patch::net::{CORRECTION_WORDS, NET_WORDS, RATIONAL_WORDS};
use std::collections::{BTreeMap, BTreeSet};
/// The payload of a block.
fn payload(file: &ModelFile, id: u32) -> Vec<u8> {
    let (mut scratch, mut bytes) = (Vec::new(), Vec::new());
    file.read_block(BlockId(id), &mut scratch, &mut bytes).expect("a block");
    bytes
}

/// A tree that was read.
struct Read<'a> {
    page: &'a Page,
    blocks: BTreeMap<u32, NodesOf>,
    grids: BTreeMap<u32, Vec<GridOf>>,
    /// Difference between the id of a leaf block and that of its fine block.
    leaves_at: u32,
    /// Nodes by block and index, and frames by block and word, that were met.
    nodes: BTreeSet<(u32, u32)>,
    frames: BTreeSet<(u32, u32)>,
    /// Levels of quadtrees.
    levels: BTreeSet<u32>,
}

impl Read<'_> {
    /// Follows a node, `above` it being the boxes from the root on. Returns the set of the parts below.
    fn node(&mut self, block: u32, index: u32, above: &mut Vec<Planes>) -> u32 {
        assert!(self.nodes.insert((block, index)), "node {index} of block {block} has two references");
        let count = self.blocks[&block].nodes[index as usize].len();
        let mut all = 0;
        for slot in 0..count {
            let ChildAt { kind, number, planes, parts } = self.blocks[&block].nodes[index as usize][slot];
            above.push(planes);
            let found = match kind {
                0 => {
                    assert!(number > index);
                    self.node(block, number, above)
                }
                1 => self.frame(block, number, above),
                2 => {
                    assert!(number > block && self.blocks[&block].frames.is_empty());
                    self.node(number, 0, above)
                }
                kind => panic!("a reference of kind {kind}"),
            };
            above.pop();
            assert!(parts.is_none_or(|parts| parts == found), "parts {parts:?} above {found}");
            all |= found;
        }
        all
    }

    fn frame(&mut self, block: u32, word: u32, above: &[Planes]) -> u32 {
        assert!(self.frames.insert((block, word)), "frame {word} of block {block} has two references");
        let frames = &self.blocks[&block].frames;
        let number = frames.iter().position(|frame| frame.at == word as usize).expect("a frame");
        let (frame, grid) = (&frames[number], &self.grids[&(block + self.leaves_at)][number]);
        assert_eq!((frame.part, frame.face, frame.levels + 1), (grid.part, grid.face, grid.level));
        self.levels.insert(frame.levels);
        for p in &grid.vertices {
            let p = p.as_dvec3();
            assert!(above.iter().all(|planes| holds(planes, p)), "{p} in {above:?}");
        }
        let local: Vec<DVec3> = grid.vertices.iter().map(|p| frame.map * (p.as_dvec3() - frame.centre)).collect();
        let around = Around { codes: &self.page.codes, frame, local: &local, side: (1 << grid.level) + 1 };
        around.check((0, 0), &mut vec![[-1.0, -1.0, -1.0, 1.0, 1.0, 1.0]]);
        1 << (frame.part % 32)
    }
}

/// A frame with the vertices of its grid in its system.
struct Around<'a> {
    codes: &'a Codes,
    frame: &'a FrameAt,
    local: &'a [DVec3],
    side: usize,
}

impl Around<'_> {
    /// Checks the leaves below a node of the quadtree, by level and number: `above` are the boxes from the root to it.
    fn check(&self, (level, number): (u32, usize), above: &mut Vec<Planes>) {
        if level == self.frame.levels {
            let bit = |place: u32| number >> place & 1;
            let [i, j] = [0, 1].map(|first| (0..level).map(|k| bit(2 * k + first) << k).sum::<usize>());
            for (column, row) in (0..9).map(|at| (2 * i + at % 3, 2 * j + at / 3)) {
                let p = self.local[row * self.side + column];
                assert!(above.iter().all(|planes| holds(planes, p)), "{p} in {above:?}");
            }
            return;
        }
        let before = ((1 << (2 * level)) - 1) / 3;
        let (word, node) = (self.frame.tree[before + number], above[above.len() - 1]);
        let boxes = self.codes.children(word, &node);
        let of_code = codes::children(word, &node);
        for (child, planes) in boxes.into_iter().enumerate() {
            assert_eq!(planes.map(f32::to_bits), codes::child(&of_code, child).map(f32::to_bits));
            above.push(planes);
            self.check((level + 1, 4 * number + child), above);
            above.pop();
        }
    }
}

/// The blocks of the model, as the page describes them.
#[test]
fn vertices_lie_in_the_boxes_above_them() {
    let (_, file) = patches();
    let page = Page::new();
    let (mut most, mut levels, mut turned, mut kinds) = (0, BTreeSet::new(), 0, [0, 0]);
    let trees: Vec<TreeRow> = file.trees().iter().filter(|tree| tree.structure == 4).copied().collect();
    for tree in &trees {
        let [coarse, fine, leaf, none] = tree.class_blocks;
        assert!(tree.root == 0 && coarse > 0 && fine > 0 && fine == leaf && none == 0, "{:?}", tree.class_blocks);
        most = most.max(fine);
        let first = tree.first_block;
        let mut read = Read {
            page: &page,
            blocks: BTreeMap::new(),
            grids: BTreeMap::new(),
            leaves_at: fine,
            nodes: BTreeSet::new(),
            frames: BTreeSet::new(),
            levels: BTreeSet::new(),
        };
        for id in first..first + coarse + fine {
            let block = page.nodes(&payload(&file, id));
            assert_eq!(block.frames.is_empty(), id < first + coarse, "block {id}");
            read.blocks.insert(id, block);
        }
        for id in first + coarse + fine..first + tree.block_count {
            read.grids.insert(id, page.grids(&payload(&file, id)));
        }
        read.node(first, 0, &mut Vec::new());
        // Everything was met.
        let nodes: usize = read.blocks.values().map(|block| block.nodes.len()).sum();
        let frames: usize = read.blocks.values().map(|block| block.frames.len()).sum();
        assert_eq!((read.nodes.len(), read.frames.len()), (nodes, frames));
        assert_eq!((tree.nodes, tree.leaves), (nodes as u64, frames as u64));
        assert_eq!(read.grids.values().map(Vec::len).sum::<usize>(), frames);
        levels.append(&mut read.levels);
        read.grids.values().flatten().for_each(|grid| kinds[usize::from(grid.is_computed)] += 1);
        blocks_beside(&file, &read, first, coarse + fine);
        turned += squares_of_faces(&read);
    }
    assert!(most > 1 && levels.len() > 1, "{most} fine blocks, {levels:?}");
    assert_eq!((trees.len(), turned), (3, 1));
    assert!(kinds.into_iter().all(|count| count > 0), "{kinds:?} stored and computed grids");
}

/// Checks that the frames of each face fill its squares without overlap. Returns 1 if all are turned over, 0 if none.
fn squares_of_faces(read: &Read) -> usize {
    let mut faces: BTreeMap<(u32, usize), BTreeSet<Square>> = BTreeMap::new();
    let frames: Vec<&FrameAt> = read.blocks.values().flat_map(|block| &block.frames).collect();
    for frame in &frames {
        assert!(faces.entry((frame.face, frame.square.corner)).or_default().insert(frame.square));
    }
    for (face, squares) in faces {
        let area = squares.iter().map(|square| 1 << (2 * (12 - square.level))).sum::<u64>();
        assert_eq!(area, 1 << 24, "{face:?}");
        let is_above = |of: &Square, up: usize| {
            squares.contains(&Square { level: of.level - up, u: of.u >> up, v: of.v >> up, ..*of })
        };
        assert!(!squares.iter().any(|square| (1..=square.level).any(|up| is_above(square, up))), "{face:?}");
    }
    let turned = frames.iter().filter(|frame| frame.is_turned).count();
    assert!(turned == 0 || turned == frames.len());
    usize::from(turned > 0)
}

/// Checks the blocks of primitive ids and of normals: those of leaf blocks have a normal for each vertex.
fn blocks_beside(file: &ModelFile, read: &Read, first: u32, nodes: u32) {
    let [ids_at, normals_at] = [file.header().geometry_blocks, file.header().normals_at().expect("normals")];
    for id in first..first + nodes {
        assert_eq!(payload(file, ids_at + id), [4, 0, 0, 0, 0], "block {id}");
        assert_eq!(payload(file, normals_at + id), [6, 1, 0, 0, 0, 0, 0, 0, 0], "block {id}");
    }
    for (id, grids) in &read.grids {
        assert_eq!(payload(file, ids_at + id), [4, 0, 0, 0, 0], "block {id}");
        let bytes = payload(file, normals_at + id);
        let codes = words(&bytes[5..]);
        let stored = grids.iter().filter(|grid| !grid.is_computed).map(|grid| grid.vertices.len()).sum::<usize>();
        if stored == 0 {
            assert_eq!(bytes, [6, 1, 0, 0, 0, 0, 0, 0, 0], "block {id}");
            continue;
        }
        assert_eq!((bytes[0], words(&bytes[1..5])[0] as usize, codes.len()), (6, stored, stored));
        for code in codes.into_iter().step_by(7) {
            let [x, y] = [code & 0xffff, code >> 16].map(|half| {
                assert!((1..=65_533).contains(&half));
                (f64::from(half) - 1.0) / 32_766.0 - 1.0
            });
            let z = 1.0 - x.abs() - y.abs();
            // The corners of the square are folded over to the lower half.
            let turn = |x: f64| x - (-z).max(0.0).copysign(x);
            let normal = DVec3::new(turn(x), turn(y), z).normalize();
            assert!(octahedral::decode(code).as_dvec3().distance(normal) < 1e-6, "{normal}");
        }
    }
}

#[test]
fn tables_of_patches_are_those_of_the_code() {
    let sizes = [HEAD, NODE, VOXEL, FRAME, GRID, REST, NET].map(|begin| Table::of(begin).size / 4);
    let of_grid = [GRID_WORDS, COMPUTED_WORDS - GRID_WORDS, NET_WORDS];
    assert_eq!(sizes, [[HEAD_WORDS, NODE_WORDS, SHORT_VOXEL, FRAME_WORDS].as_slice(), &of_grid].concat()[..]);
    assert!(section(NET).1.contains("\nA rational net has 128 bytes more"));
    assert_eq!((4 * (RATIONAL_WORDS - NET_WORDS), CORRECTION_WORDS), (128, 4));
    assert_eq!(4 * (LONG_VOXEL - SHORT_VOXEL), 48);
    assert!(section(VOXEL).1.contains("\nWith bit 24 in word 0, 48 bytes follow"));
    assert!(section(BLOCKS).1.replace(',', "").contains(&format!("at most {MAX_WORDS}.")));
    let range = |begin: &str, name: &str| super::page::range_of(begin, name);
    assert_eq!(range(HEAD, "kind"), layout::NODES.to_string());
    assert_eq!(numbers(range(HEAD, "word at which the voxels")), [HEAD_WORDS as u64, NODE_WORDS as u64]);
    assert_eq!(numbers(range(FRAME, "levels"))[1], u64::from(MOST_LEVEL) - 1);
    assert_eq!(numbers(range(FRAME, "place"))[0], u64::from(MOST_PLACE));
    assert_eq!(numbers(range(GRID, "level"))[..2], [1, u64::from(MOST_LEVEL)]);
    assert_eq!((IS_COMPUTED >> 4, (IS_COMPUTED | IS_RATIONAL) >> 4), (1, 3));
    assert_eq!(numbers(range(REST, "place"))[1], u64::from(MOST_PLACE));
    let leaf = table(LEAF, "bytes | type | field | range");
    assert_eq!(leaf[0][3], layout::GRIDS.to_string());
    assert_eq!(numbers(&leaf[1][3].replace(',', "")), [1, MOST_GRIDS as u64]);
    assert_eq!(range("### Trees", "root"), "0 in `patch`");
    assert!(range("### Trees", "structure").contains("4 `patch`"));
    assert!(section(TREE).1.contains("The shares of the four planes of an axis\nare 0, 0.5, 0.5 and 1,"));
    // References.
    let of = bits(REFERENCE);
    let kinds = table(REFERENCE, "kind | child | number");
    for (row, child) in kinds.iter().zip([Child::Node(5), Child::Frame(5), Child::Block(5)]) {
        let kind: u32 = row[0].parse().expect("a kind");
        assert_eq!(child.to_bits(), 5 << of[0].0 | kind << of[1].0, "{}", row[1]);
    }
    assert_eq!(kinds.len(), 3);
}

/// Any words of quadtrees have the boxes of the page.
#[test]
fn words_of_quadtrees() {
    let codes = Codes::of_page();
    assert_eq!((codes.shifts.len(), codes.intervals.len(), codes.bits.len()), (8, 4, 12));
    let node: Planes = [-0.93, -0.71, -1.0, 0.87, 1.0, 0.31];
    for i in 0..4000u32 {
        let word = i.wrapping_mul(0x9e37_79b9) ^ i << 20;
        let of_code = codes::children(word, &node);
        for (child, planes) in codes.children(word, &node).into_iter().enumerate() {
            assert_eq!(planes.map(f32::to_bits), codes::child(&of_code, child).map(f32::to_bits), "{word:#x}");
        }
    }
}

/// The readers of the code find the frames and the grids where the page has them.
#[test]
fn frames_and_grids_are_those_of_the_code() {
    let (_, file) = patches();
    let page = Page::new();
    let tree = file.trees().iter().find(|tree| tree.structure == 4).expect("a tree");
    let [coarse, fine, ..] = tree.class_blocks;
    let id = tree.first_block + coarse;
    let (bytes, below) = (payload(&file, id), payload(&file, id + fine));
    let (of_page, of_code) = (page.nodes(&bytes), words(&bytes));
    let frames: Vec<_> = Block(&of_code).all_frames().collect();
    assert_eq!(frames.len(), of_page.frames.len());
    for (frame, (at, other)) in of_page.frames.iter().zip(frames) {
        assert_eq!((frame.at, &frame.tree[..]), (at, other.tree));
        assert_eq!((frame.part, frame.face, frame.levels), (other.part(), other.face(), other.levels()));
        assert_eq!((frame.centre, frame.map), (other.centre().as_dvec3(), other.map().as_dmat3()));
    }
    let grid_words = words(&below);
    let grids = Grids(&grid_words);
    for (number, grid) in page.grids(&below).iter().enumerate() {
        let other = grids.grid(number).expect("a grid");
        assert_eq!((grid.part, grid.face, grid.level), (other.part(), other.face(), other.level));
        let vertex = |k: usize| other.vertex(k % other.side, k / other.side);
        assert!(grid.vertices.iter().enumerate().all(|(k, p)| *p == vertex(k)));
    }
}
