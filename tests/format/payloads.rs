//! Tables of the payloads of blocks.

use super::model::model;
use super::page::{check_constant, evaluate, number, size_of_type, table};
use outcrop::base::ids::BlockId;
use outcrop::lod::{self, CURTAIN_WORDS, Coded, Curtain};
use outcrop::store::TreeRow;
use outcrop::structure::bvh::codec::{Holds, Place, decode_geometry};
use outcrop::structure::bvh::layout::{Block, COARSE, FINE, LONG_VOXEL, MAX_VERTICES, PAD_WORDS, SHORT_VOXEL, WIDTH};
use outcrop::structure::bvh::leaf::{APART, LeafForm, MIXED, NEAR};
use outcrop::structure::streams::{decode_colours, decode_prims};
use std::collections::{BTreeMap, BTreeSet};

/// A payload, read row by row of the page's tables.
struct Payload<'a> {
    rest: &'a [u8],
    counts: BTreeMap<&'static str, usize>,
    rows: Vec<(&'static str, &'a [u8])>,
}

impl<'a> Payload<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes, counts: BTreeMap::new(), rows: Vec::new() }
    }

    fn count(&self, name: &str) -> usize {
        self.counts.get(name).copied().unwrap_or(0)
    }

    /// The bytes of the row that begins with `name`.
    fn row(&self, name: &str) -> &'a [u8] {
        self.rows.iter().find(|row| row.0.starts_with(name)).unwrap_or_else(|| panic!("no row {name}")).1
    }

    /// Reads the rows of a section's table. `kind`: that of the geometry block, or 0.
    fn read(&mut self, begin: &str, kind: u8) {
        for row in table(begin, "bytes | type | field | range") {
            let [size, kind_of, name, range] = row[..] else { unreachable!() };
            let is_left_out = name.starts_with("only with parts") && self.count("r") != LONG_VOXEL
                || name.starts_with("only in kind 2") && kind != 2;
            if is_left_out {
                continue;
            }
            // The size of one element is the number before its count.
            if !["u4", "bit", "varint", ""].contains(&kind_of) {
                let each = size.split(" x ").next().and_then(|each| each.parse::<usize>().ok()).unwrap_or(1);
                assert_eq!(size_of_type(kind_of), each, "{begin}: {name}");
            }
            let len = match (size, kind_of) {
                ("..", "varint") => self.varints(),
                ("..", _) => self.coordinates(),
                _ => evaluate(size, &self.counts),
            };
            let (bytes, rest) = self.rest.split_at_checked(len).unwrap_or_else(|| panic!("{begin}: {name}"));
            self.rest = rest;
            check_constant(name, range, bytes);
            self.learn(name, bytes);
            self.rows.push((name, bytes));
        }
    }

    /// Takes counts for the following rows from a row.
    fn learn(&mut self, name: &'static str, bytes: &[u8]) {
        let named = name.rsplit_once(" (").and_then(|(_, letter)| letter.strip_suffix(')'));
        if let Some(letter) = named.filter(|letter| letter.len() == 1) {
            let before = self.counts.insert(letter, number(bytes) as usize);
            // Kind 1 has the number of leaves twice.
            assert!(before.is_none_or(|before| before == number(bytes) as usize), "{name}");
        }
        let top_bytes = &bytes[bytes.len() - bytes.len() / 4..];
        let ones = |bytes: &[u8]| bytes.iter().map(|byte| byte.count_ones() as usize).sum::<usize>();
        if name.starts_with("exponents") {
            self.counts.insert("c", ones(top_bytes));
        } else if name.starts_with("word 0") {
            self.counts.insert("s", top_bytes.iter().filter(|byte| **byte & 1 != 0).count());
        } else if name.starts_with("only with parts: the local part") {
            self.counts.insert("m", top_bytes.iter().filter(|byte| **byte & 0x80 != 0).count());
            self.counts.insert("g", top_bytes.iter().filter(|byte| **byte & 0x40 != 0).count());
        } else if name.starts_with("for each leaf: bits 0 to 2") {
            let shapes = bytes.iter().map(|shape| usize::from(*shape));
            let triangles = |shape: usize| 1 + (shape & 7);
            assert_eq!(shapes.clone().map(triangles).sum::<usize>(), self.count("t"), "{name}");
            self.counts.insert("q", shapes.clone().map(|s| if s >> 7 == 1 { triangles(s) } else { 1 }).sum());
            self.counts.insert("w", shapes.map(|shape| 3 + (shape >> 3 & 15)).sum());
        } else if name.starts_with("for each vertex of each leaf") {
            self.counts.insert("k", ones(bytes));
            assert_eq!(self.count("w") - self.count("k"), self.count("v"), "{name}");
        }
    }

    fn varints(&self) -> usize {
        let mut ends = self.rest.iter().enumerate().filter(|(_, byte)| **byte < 0x80).map(|(at, _)| at + 1);
        self.count("i").checked_sub(1).map_or(0, |last| ends.nth(last).expect("an end"))
    }

    fn coordinates(&self) -> usize {
        let groups = self.count("v").div_ceil(16);
        let widths = self.rest[..groups].iter().map(|width| usize::from(*width));
        groups + widths.map(|width| 16 * width / 8).sum::<usize>()
    }
}

/// Word `i` of `count` transposed words.
fn transposed(bytes: &[u8], i: usize) -> u32 {
    let count = bytes.len() / 4;
    u32::from_le_bytes([0, 1, 2, 3].map(|plane| bytes[plane * count + i]))
}

/// Checks the rows of nodes against the decoded block.
fn check_nodes(payload: &Payload, block: &Block) {
    let counts = ["n", "e", "c", "s", "r"].map(|name| payload.count(name));
    let found = [block.nodes(), block.externals(), block.voxels(), block.six_sided(), block.voxel_words()];
    assert_eq!(counts, found);
    let curtains = ["g", "h"].map(|name| payload.count(name));
    assert_eq!(2 * curtains[0] + CURTAIN_WORDS * curtains[1], block.words_of_curtains());
    let mut curtain = 0;
    let corners = ["x of the least corner", "y of the least", "z of the least"].map(|name| payload.row(name));
    let (exponents, boxes) = (payload.row("exponents"), payload.row("boxes"));
    let [first, slabs] = ["word 0", "oriented slabs"].map(|name| payload.row(name));
    let mut child = 0;
    for i in 0..block.nodes() {
        let node = block.node(i);
        assert_eq!(corners.map(|corner| transposed(corner, i)), node.origin.map(f32::to_bits));
        let [x, y, z] = node.exponent;
        assert_eq!(transposed(exponents, i).to_le_bytes(), [x, y, z, node.valid]);
        for slot in (0..WIDTH).filter(|slot| node.valid >> slot & 1 == 1) {
            let planes: [u8; 6] = std::array::from_fn(|row| boxes[row * block.voxels() + child]);
            assert_eq!(planes, node.planes.map(|row| row[slot]));
            assert_eq!(transposed(first, child), block.voxel(i, slot).words()[0]);
            // The decoder leaves the slabs as they are.
            assert_eq!(transposed(slabs, child), node.slabs[slot]);
            for words in block.voxel(i, slot).curtains() {
                for (word, found) in words.into_iter().enumerate() {
                    let row = payload.row(&format!("only with parts: word {word} of each curtain"));
                    assert_eq!(transposed(row, curtain), found);
                }
                curtain += 1;
            }
            child += 1;
        }
    }
    let externals = payload.row("external references: block id");
    for (i, (id, _)) in block.all_externals().enumerate() {
        assert_eq!(transposed(externals, i), id);
    }
}

/// Words of the leaves of a block, in their order.
fn leaf_words(block: &Block) -> Vec<u8> {
    let (mut at, mut all) = (block.first_leaf(), Vec::new());
    while at + PAD_WORDS < block.words().len() {
        all.push(block.leaf(at).len() as u8);
        at += block.leaf(at).len();
    }
    all
}

/// Checks the rows of leaves against the decoded block. Returns the flags of all leaves.
fn check_leaves(payload: &Payload, block: &Block) -> BTreeSet<u16> {
    assert_eq!(["t", "p"].map(|name| payload.count(name)), [block.triangles(), block.parts()]);
    let shapes = payload.row("for each leaf: bits 0 to 2");
    assert_eq!(shapes.len(), payload.count("l"));
    let (mut at, mut all) = (block.first_leaf(), BTreeSet::new());
    for shape in shapes {
        let leaf = block.leaf(at);
        let mixed = u8::from(leaf.is_mixed()) << 7;
        assert_eq!(*shape, (leaf.triangles - 1) as u8 | ((leaf.vertices - 3) as u8) << 3 | mixed);
        all.insert(leaf.form().flags);
        at += leaf.len();
    }
    assert_eq!(at + PAD_WORDS, block.words().len());
    let parts = payload.row("parts: local").chunks_exact(4);
    assert!(parts.enumerate().all(|(i, part)| number(part) == u64::from(block.part(i))));
    all
}

/// Place of a geometry block, by the classes of its tree, and the kind of its payload.
fn place_of(tree: &TreeRow, id: u32) -> (Place, u8) {
    let coarse_end = tree.first_block + tree.class_blocks[COARSE];
    let fine_end = coarse_end + tree.class_blocks[FINE];
    let (holds, end, kind) = match id {
        _ if tree.block_count == 1 => (Holds::All, fine_end, 1),
        _ if id < coarse_end => (Holds::Nodes, fine_end, 2),
        _ if id < fine_end => (Holds::NodesOverLeaves, id + 1, 2),
        _ => (Holds::Leaves, fine_end, 3),
    };
    (Place { id, end, holds }, kind)
}

#[test]
fn payloads_have_the_rows_of_their_tables() {
    let (_, file) = model();
    let (mut scratch, mut bytes) = (Vec::new(), Vec::new());
    let geometry = file.header().geometry_blocks;
    let mut is_smooth = false;
    let (mut kinds, mut flags, mut most) = (BTreeSet::new(), BTreeSet::new(), BTreeMap::<&str, usize>::new());
    for id in 0..geometry {
        let tree = *file.trees().iter().rfind(|tree| tree.first_block <= id && tree.block_count > 0).expect("a tree");
        let (place, kind) = place_of(&tree, id);
        let mut read = |id: u32, out: &mut Vec<u8>| file.read_block(BlockId(id), &mut scratch, out).expect("a block");
        read(id, &mut bytes);
        let words = decode_geometry(&bytes, place).expect("a block");
        let block = Block::new(&words);
        assert_eq!((bytes[0], file.decoded_len(BlockId(id)) as usize), (kind, 4 * words.len()));
        let mut payload = Payload::new(&bytes[1..]);
        if kind != 3 {
            payload.read("#### Nodes", kind);
            check_nodes(&payload, &block);
        }
        if kind != 2 {
            payload.read("#### Leaves", kind);
            flags.extend(check_leaves(&payload, &block));
        }
        assert!(payload.rest.is_empty(), "block {id} has bytes behind the last row");
        if place.holds == Holds::NodesOverLeaves {
            let leaf_block = id + tree.class_blocks[FINE];
            let mut other = Vec::new();
            read(leaf_block, &mut other);
            let words = decode_geometry(&other, place_of(&tree, leaf_block).0).expect("a leaf block");
            let block = Block::new(&words);
            assert_eq!(number(payload.row("only in kind 2: the word")) as usize, block.first_leaf());
            assert_eq!(payload.row("only in kind 2: words"), leaf_words(&block));
        }
        let triangles = block.triangles();
        let mut beside = Vec::new();
        read(geometry + id, &mut beside);
        let mut prims = Payload::new(&beside);
        prims.read("#### Primitive ids", 0);
        assert_eq!((prims.count("i"), prims.rest.len()), (triangles, 0));
        assert_eq!(decode_prims(&beside, triangles).map(|all| all.len()), Ok(triangles));
        read(2 * geometry + id, &mut beside);
        let mut colours = Payload::new(&beside);
        colours.read("#### Colours", 0);
        let each = usize::from(colours.row("colours of a triangle")[0]);
        assert_eq!((colours.count("c"), colours.rest.len()), (each * triangles, 0));
        let decoded = decode_colours(&beside, 1 + each * triangles).expect("colours");
        assert_eq!(decoded[0] as usize, each);
        for (corner, row) in colours.row("sRGB").chunks_exact(4 * triangles.max(1)).enumerate() {
            let first = row.iter().step_by(triangles).copied();
            assert_eq!(first.collect::<Vec<_>>(), decoded[1 + corner].to_le_bytes());
        }
        let normals_at = file.header().normals_at().expect("normals");
        read(normals_at + id, &mut beside);
        let mut normals = Payload::new(&beside);
        normals.read("#### Normals", 0);
        assert_eq!(
            (4 * normals.count("n"), normals.rest.len()),
            (file.decoded_len(BlockId(normals_at + id)) as usize, 0)
        );
        is_smooth |= normals.count("n") > 1;
        kinds.insert((kind, payload.count("r")));
        for name in ["e", "s", "m", "g", "h", "k", "q"] {
            let count = most.entry(name).or_default();
            *count = payload.count(name).max(*count);
        }
    }
    assert!(is_smooth);
    let page = table("### Block payloads of structure `bvh`", "kind | content");
    assert_eq!(page.iter().map(|row| row[0]).collect::<Vec<_>>(), ["1", "2", "3"]);
    // Each row of the tables has been read with something in it.
    let expected = BTreeSet::from([(1, SHORT_VOXEL), (1, LONG_VOXEL), (2, LONG_VOXEL), (3, 0)]);
    assert!(kinds.is_superset(&expected), "{kinds:?}");
    assert!(most.values().all(|count| *count > 0), "{most:?}");
    assert!(flags.contains(&0) && flags.iter().any(|flags| flags & APART != 0), "{flags:?}");
}

#[test]
fn words_of_leaves() {
    let forms = table("#### Leaves", "form | condition | words of corners | words of coordinates");
    assert_eq!(forms.iter().map(|row| row[0]).collect::<Vec<_>>(), ["shared", "apart", "near"]);
    for (row, flags) in forms.iter().zip([0, APART, APART | NEAR]) {
        let vertices_of = |triangles| if flags == 0 { 3..=MAX_VERTICES } else { 3 * triangles..=3 * triangles };
        for (triangles, is_mixed) in (1..=8).flat_map(|triangles| [(triangles, false), (triangles, true)]) {
            for vertices in vertices_of(triangles).filter(|vertices| *vertices <= MAX_VERTICES) {
                let counts = BTreeMap::from([("t", triangles), ("v", vertices)]);
                let own = evaluate(row[2], &counts) + evaluate(row[3], &counts);
                let parts = if is_mixed { triangles.div_ceil(2) } else { 0 };
                let form = LeafForm { triangles, vertices, flags: flags | if is_mixed { MIXED } else { 0 } };
                assert_eq!(2 + parts + own, form.words(), "{}: {form:?}", row[0]);
            }
        }
    }
}

/// The first bit and the number of bits of each row of a table of bits. The rows fill a word.
pub fn bits(begin: &str) -> Vec<(u32, u32)> {
    let mut end = 0;
    let rows = table(begin, "bits | field").into_iter().map(|row| {
        let (first, last) = row[0].split_once(" to ").expect("first and last bit");
        let [first, last]: [u32; 2] = [first, last].map(|bit| bit.parse().expect("a bit"));
        assert_eq!(std::mem::replace(&mut end, last + 1), first, "{begin}: {}", row[1]);
        (first, last + 1 - first)
    });
    let rows = rows.collect();
    assert_eq!(end, 32, "{begin}");
    rows
}

#[test]
fn bits_of_stand_ins() {
    let slabs = bits("#### Oriented slabs");
    assert_eq!(slabs, [&lod::FIELDS[..], &[lod::LEVEL]].concat());
    let mask = |(from, count): (u32, u32)| ((1u64 << (from + count)) - (1 << from)) as u32;
    let word0 = bits("#### Sample, word 0");
    assert_eq!(word0.len(), 6);
    assert_eq!((lod::normal_bytes(1 << word0[0].0), lod::normal_bytes(1 << word0[1].0)), ([1.0, 0.0], [0.0, 1.0]));
    assert_eq!(lod::normal_bytes(mask(word0[0]) | mask(word0[1])), [-1.0, -1.0]);
    assert!((lod::stored_likeness(mask(word0[2])) - 1.0).abs() < 1e-6);
    assert!(Coded::has_sides(mask(word0[3])) && !Coded::has_sides(!mask(word0[3])));
    assert!(Coded::has_colours(mask(word0[4])) && !Coded::has_colours(!mask(word0[4])));
    assert_eq!(lod::stop_bits(63), mask(word0[5]));
    let word1 = bits("#### Sample, word 1");
    assert_eq!(word1.len(), 4);
    for (channel, bits) in word1[..3].iter().enumerate() {
        let colour = lod::stored_colour(mask(*bits)).to_array();
        assert!((0..3).all(|i| (colour[i] - if i == channel { 1.0 } else { 0.0 }).abs() < 1e-6), "{colour:?}");
    }
    assert_eq!(lod::stored_colour(mask(word1[3])).to_array(), [0.0; 3]);
}

#[test]
fn bits_of_curtains() {
    let mask = |(from, count): (u32, u32)| ((1u64 << (from + count)) - (1 << from)) as u32;
    let words = [0, 1, 2].map(|word| bits(&format!("#### Curtain, word {word}")));
    assert!(Curtain::is_last(mask(words[0][3])) && !Curtain::is_last(!mask(words[0][3])));
    // Each direction has one bit, and all of them are those of the table.
    let (mut all, steps) = (0, [-1.0f32, 0.0, 1.0]);
    for (i, to) in (0..27).map(|i| (i, glam::Vec3::new(steps[i % 3], steps[i / 3 % 3], steps[i / 9]))) {
        if i != 13 {
            let near = to + glam::Vec3::new(0.2, -0.1, 0.15) * 0.9;
            assert!([to, near].iter().all(|to| lod::curtain_from(1 << i, *to) && !lod::curtain_from(!(1 << i), *to)));
        }
        all |= 1u32 << i;
    }
    assert_eq!(all, mask(words[0][0]));
    let likeness = |first: u32| lod::stored_likeness(Curtain::shown([first, 0, 0]).0[0]);
    assert!(
        (likeness(mask(words[0][1])) - 1.0).abs() < 0.01 && (likeness(!mask(words[0][1])) - 2.0 / 3.0).abs() < 0.01
    );
    for (channel, field) in words[1][..3].iter().enumerate() {
        let ([_, second], _) = Curtain::shown([0, mask(*field), 0]);
        let colour = lod::stored_colour(second).to_array();
        assert!((0..3).all(|i| (colour[i] - if i == channel { 1.0 } else { 0.0 }).abs() < 1e-6), "{colour:?}");
    }
    let normal = |second, third| lod::normal_bytes(Curtain::shown([0, second, third]).0[0]);
    let [(one, _), (two, _)] = [words[1][3], words[2][1]];
    assert_eq!((normal(1 << one, 0), normal(0, 1 << two)), ([1.0, 0.0], [0.0, 1.0]));
    assert_eq!(Curtain::shown([0, 0, u32::MAX]).1, mask(words[2][0]));
}
