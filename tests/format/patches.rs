//! Blocks of `patch` trees, read by the page alone: every vertex lies in the boxes above it.

use super::model::patches;
use super::page::{Field, check_constant, fields, number, numbers, section, table};
use super::payloads::bits;
use glam::{DMat3, DVec3, Vec3};
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

const BLOCKS: &str = "### Block payloads of structure `patch`";
const HEAD: &str = "#### Patch: head of a coarse or a fine block";
const NODE: &str = "#### Patch: node";
const REFERENCE: &str = "#### Patch: reference";
const VOXEL: &str = "#### Patch: voxel";
const FRAME: &str = "#### Patch: frame";
const TREE: &str = "#### Patch: word of a quadtree";
const LEAF: &str = "#### Patch: leaf block";
const GRID: &str = "#### Patch: grid";
const REST: &str = "#### Patch: rest of a computed grid";
const NET: &str = "#### Patch: net";

/// A table of offsets of the page.
struct Table {
    fields: Vec<Field>,
    size: usize,
}

impl Table {
    fn of(begin: &str) -> Self {
        let fields = fields(begin);
        let size = fields.iter().map(|field| field.size).sum();
        assert_eq!(numbers(section(begin).0).last(), Some(&(size as u64)), "{begin}: size in the heading");
        Self { fields, size }
    }

    /// The row at the start of some bytes.
    fn row<'a>(&'a self, bytes: &'a [u8]) -> Row<'a> {
        let bytes = &bytes[..self.size];
        self.fields.iter().for_each(|f| check_constant(f.name, f.range, &bytes[f.offset..f.offset + f.size]));
        Row { fields: &self.fields, bytes }
    }
}

/// A row of a table.
struct Row<'a> {
    fields: &'a [Field],
    bytes: &'a [u8],
}

impl Row<'_> {
    /// The bytes of the field that begins with `name`.
    fn bytes(&self, name: &str) -> &[u8] {
        let field = self.fields.iter().find(|f| f.name.starts_with(name)).unwrap_or_else(|| panic!("no field {name}"));
        &self.bytes[field.offset..field.offset + field.size]
    }

    fn number(&self, name: &str) -> usize {
        number(self.bytes(name)) as usize
    }

    fn words(&self, name: &str) -> Vec<u32> {
        words(self.bytes(name))
    }

    fn floats(&self, name: &str) -> Vec<f32> {
        self.words(name).into_iter().map(f32::from_bits).collect()
    }
}

fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(|word| number(word) as u32).collect()
}

/// Planes of a box: low x, y, z, high x, y, z.
type Planes = [f32; 6];

fn holds(planes: &Planes, p: DVec3) -> bool {
    (0..3).all(|axis| f64::from(planes[axis]) <= p[axis] && p[axis] <= f64::from(planes[axis + 3]))
}

/// The tables of the words of a quadtree.
struct Codes {
    /// First bit and number of bits of each row, with the field.
    bits: Vec<((u32, u32), &'static str)>,
    shifts: Vec<f32>,
    intervals: Vec<[f32; 2]>,
}

impl Codes {
    fn of_page() -> Self {
        let names = table(TREE, "bits | field").into_iter().map(|row| row[1]);
        let rows = table(TREE, "code | shift of a plane | interval along z, as shares");
        assert!(rows.iter().enumerate().all(|(code, row)| row[0] == code.to_string()));
        let float = |text: &str| text.parse::<f32>().expect("a number");
        let interval = |row: &Vec<&str>| row[2].split_once(" to ").map(|(low, high)| [float(low), float(high)]);
        Self {
            bits: bits(TREE).into_iter().zip(names).collect(),
            shifts: rows.iter().map(|row| float(row[1])).collect(),
            intervals: rows.iter().filter_map(interval).collect(),
        }
    }

    /// The boxes of the children of a node.
    fn children(&self, word: u32, node: &Planes) -> [Planes; 4] {
        let code = |name: &str| {
            let ((first, count), _) = self.bits.iter().find(|row| row.1 == name).expect("a row of the table");
            (word >> first & ((1 << count) - 1)) as usize
        };
        let at = |axis: usize, share: f32| node[axis] * (1.0 - share) + node[axis + 3] * share;
        let plane = |axis: usize, end: usize, half: usize| {
            let (letter, end_name, half_name) = (["x", "y"][axis], ["low", "high"][end], ["lower", "upper"][half]);
            let shift = self.shifts[code(&format!("{letter}: {end_name} plane of the {half_name} half"))];
            at(axis, ([[0.0, 0.5], [0.5, 1.0]][half][end] + shift).clamp(0.0, 1.0))
        };
        std::array::from_fn(|child| {
            let halves = [child % 2, child / 2];
            let z = self.intervals[code(&format!("z: interval of child {child}"))].map(|share| at(2, share));
            std::array::from_fn(|i| match i % 3 {
                2 => z[i / 3],
                axis => plane(axis, i / 3, halves[axis]),
            })
        })
    }
}

/// The page's tables, parsed once.
struct Page {
    head: Table,
    node: Table,
    voxel: Table,
    frame: Table,
    grid: Table,
    rest: Table,
    net: Table,
    codes: Codes,
    /// Bits of the number and of the kind of a reference.
    reference: Vec<(u32, u32)>,
}

/// A child of a node: kind, number, box, and the set of parts that its voxel states.
struct ChildAt {
    kind: u32,
    number: u32,
    planes: Planes,
    parts: Option<u32>,
}

/// A part of the square of a face: the corner of the face if it has several squares, and the part's place.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Square {
    corner: usize,
    level: usize,
    u: usize,
    v: usize,
}

struct FrameAt {
    at: usize,
    centre: DVec3,
    map: DMat3,
    part: u32,
    face: u32,
    square: Square,
    is_turned: bool,
    levels: u32,
    tree: Vec<u32>,
}

/// A coarse or a fine block.
struct NodesOf {
    nodes: Vec<Vec<ChildAt>>,
    frames: Vec<FrameAt>,
}

struct GridOf {
    part: u32,
    face: u32,
    level: u32,
    vertices: Vec<Vec3>,
    is_computed: bool,
}

impl Page {
    fn new() -> Self {
        Self {
            head: Table::of(HEAD),
            node: Table::of(NODE),
            voxel: Table::of(VOXEL),
            frame: Table::of(FRAME),
            grid: Table::of(GRID),
            rest: Table::of(REST),
            net: Table::of(NET),
            codes: Codes::of_page(),
            reference: bits(REFERENCE),
        }
    }

    /// Reads a coarse or a fine block.
    fn nodes(&self, bytes: &[u8]) -> NodesOf {
        let head = self.head.row(bytes);
        let [count, frames] = ["nodes", "frames"].map(|name| head.number(name));
        let mut voxel_at = self.head.size / 4 + self.node.size / 4 * count;
        assert_eq!(head.number("word at which the voxels begin"), voxel_at);
        let mut nodes = Vec::new();
        for index in 0..count {
            let node = self.node.row(&bytes[self.head.size + index * self.node.size..]);
            let rows = ["low x", "low y", "low z", "high x", "high y", "high z"].map(|name| node.floats(name));
            let [references, voxels] = ["references", "word at which the child's"].map(|name| node.words(name));
            let used = references.iter().take_while(|word| **word != 0).count();
            assert!(used > 0);
            let mut children = Vec::new();
            for slot in 0..8 {
                let planes: Planes = std::array::from_fn(|row| rows[row][slot]);
                if slot >= used {
                    let empty = [f32::INFINITY, f32::NEG_INFINITY];
                    assert_eq!(planes, std::array::from_fn(|row| empty[row / 3]));
                    assert_eq!((references[slot], voxels[slot]), (0, 0));
                    continue;
                }
                let part_of = |(first, bits): (u32, u32)| references[slot] >> first & ((1 << bits) - 1);
                let [number, kind] = [0, 1].map(|row| part_of(self.reference[row]));
                let mut parts = None;
                if kind != 1 {
                    assert_eq!(voxels[slot] as usize, voxel_at);
                    let voxel = self.voxel.row(&bytes[4 * voxel_at..]);
                    assert_eq!(voxel.number("oriented slabs") >> 30, 0);
                    assert_eq!(voxel.number("word 0") >> 26, 0);
                    let has_sides = voxel.number("word 0") >> 24 & 1 == 1;
                    assert!(!has_sides || voxel.number("word 1") == 0);
                    voxel_at += self.voxel.size / 4 + if has_sides { 12 } else { 0 };
                    let (part, set) = (voxel.number("the local part"), voxel.number("the set of its parts"));
                    assert!(part >> 31 == 1 || set == 1 << (part % 32));
                    parts = Some(set as u32);
                }
                children.push(ChildAt { kind, number, planes, parts });
            }
            nodes.push(children);
        }
        let mut at = head.number("word at which the frames begin");
        assert_eq!(at, voxel_at);
        let mut all = Vec::new();
        for number in 0..frames {
            let row = self.frame.row(&bytes[4 * at..]);
            let (levels, m) = (row.number("levels") as u32, row.floats("rows of the map"));
            let tree_at = 4 * at + self.frame.size;
            let tree = words(&bytes[tree_at..tree_at + 4 * ((1 << (2 * levels)) - 1) / 3]);
            assert_eq!(row.number("number of its grid"), number);
            let place = row.number("place");
            let (level, column, line) = (place & 15, place >> 4 & 0xfff, place >> 16 & 0xfff);
            assert!(level <= 12 && column.max(line) < 1 << level && place >> 29 == 0);
            let is_turned = place >> 28 == 1;
            let (u, v) = if is_turned { (line, column) } else { (column, line) };
            let corner = row.number("corner");
            let of_row = |i: usize| Vec3::new(m[3 * i], m[3 * i + 1], m[3 * i + 2]).as_dvec3();
            let [part, face] = ["the tree's local part", "primitive id"].map(|name| row.number(name) as u32);
            let centre = Vec3::from_slice(&row.floats("centre")).as_dvec3();
            let map = DMat3::from_cols(of_row(0), of_row(1), of_row(2)).transpose();
            let size = self.frame.size / 4 + tree.len();
            let square = Square { corner, level, u, v };
            all.push(FrameAt { at, centre, map, part, face, square, is_turned, levels, tree });
            at += size;
        }
        assert_eq!(4 * at, bytes.len());
        NodesOf { nodes, frames: all }
    }

    /// Reads a leaf block.
    fn grids(&self, bytes: &[u8]) -> Vec<GridOf> {
        let kind = table(LEAF, "bytes | type | field | range")[0][3];
        assert_eq!(number(&bytes[..4]).to_string(), kind);
        let count = number(&bytes[4..8]) as usize;
        let (mut at, mut normal, mut all) = (2 + count, 0, Vec::new());
        let mut nets: BTreeMap<usize, bool> = BTreeMap::new();
        for first in words(&bytes[8..8 + 4 * count]) {
            assert_eq!(first as usize, at);
            let row = self.grid.row(&bytes[4 * at..]);
            assert_eq!(row.number("number of the first normal"), normal);
            let [part, face, kind] =
                ["the tree's local part", "primitive id", "level"].map(|name| row.number(name) as u32);
            let (level, is_computed, is_rational) = (kind & 15, kind >> 4 & 1 == 1, kind >> 5 == 1);
            let side = (1 << level) + 1;
            let from = 4 * at + self.grid.size;
            if is_computed {
                let rest = self.rest.row(&bytes[from..]);
                let net = rest.number("word at which its net begins");
                // Nets follow each other in the order of references.
                let last = nets.last_key_value().map(|(at, is_rational)| at + if *is_rational { 128 } else { 96 });
                assert!(nets.contains_key(&net) || last.is_none_or(|last| net == last));
                nets.insert(net, is_rational);
                let corrections = rest.number("corrections");
                let fixes = &bytes[from + self.rest.size..][..16 * corrections];
                let vertices = self.vertices(&rest, &bytes[4 * net..], level, is_rational, fixes);
                all.push(GridOf { part, face, level, vertices, is_computed });
                at += (self.grid.size + self.rest.size) / 4 + 4 * corrections;
                continue;
            }
            let count = side * side;
            let numbers: Vec<f32> = words(&bytes[from..from + 12 * count]).into_iter().map(f32::from_bits).collect();
            let vertices = numbers.chunks_exact(3).map(Vec3::from_slice).collect();
            all.push(GridOf { part, face, level, vertices, is_computed });
            normal += count;
            at += self.grid.size / 4 + 3 * count;
        }
        for (net, is_rational) in nets {
            assert_eq!(net, at);
            at += self.net.size / 4 + if is_rational { 32 } else { 0 };
        }
        assert_eq!(4 * at, bytes.len());
        all
    }

    /// The vertices of a computed grid.
    fn vertices(&self, rest: &Row, net: &[u8], level: u32, is_rational: bool, fixes: &[u8]) -> Vec<Vec3> {
        let row = self.net.row(net);
        let doubles = |bytes: &[u8]| -> Vec<f64> {
            bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().expect("8 bytes"))).collect()
        };
        let mut axes: Vec<Vec<f64>> = ["x of the control points", "y", "z"].map(|name| doubles(row.bytes(name))).into();
        if is_rational {
            axes.push(doubles(&net[self.net.size..self.net.size + 128]));
        }
        let (place, last) = (rest.number("place"), 1usize << level);
        let (above, column, line) = (place & 15, place >> 4 & 0xfff, place >> 16);
        assert!(above <= 12 && column.max(line) < 1 << above);
        let steps: Vec<usize> = (0..4).map(|side| 1 << (rest.number("steps") >> (4 * side) & 15)).collect();
        let weights = |t: f64| {
            let s = 1.0 - t;
            [(s * s) * s, 3.0 * ((s * s) * t), 3.0 * ((t * t) * s), (t * t) * t]
        };
        let nearest = |index: usize, step: usize| (index + step / 2) / step * step;
        let mut vertices: Vec<Vec3> = (0..(last + 1) * (last + 1))
            .map(|number| {
                let (mut i, mut j) = (number % (last + 1), number / (last + 1));
                let (column_at, row_at) = (i, j);
                for (side, is_on) in [row_at == 0, row_at == last, column_at == 0, column_at == last].iter().enumerate()
                {
                    let along = if side < 2 { &mut i } else { &mut j };
                    *along = if *is_on { nearest(*along, steps[side]) } else { *along };
                }
                let size = f64::from(1u32 << (above as u32 + level));
                let at = |first: usize, index: usize| (first * last + index) as f64 / size;
                let (wu, wv) = (weights(at(column, i)), weights(at(line, j)));
                let sum = |points: &[f64]| {
                    let of_column = |c: usize| {
                        points[c] * wv[0] + points[4 + c] * wv[1] + points[8 + c] * wv[2] + points[12 + c] * wv[3]
                    };
                    of_column(0) * wu[0] + of_column(1) * wu[1] + of_column(2) * wu[2] + of_column(3) * wu[3]
                };
                let over = if is_rational { 1.0 / sum(&axes[3]) } else { 1.0 };
                Vec3::from_array([0, 1, 2].map(|axis| (sum(&axes[axis]) * over) as f32))
            })
            .collect();
        for fix in fixes.chunks_exact(16) {
            let numbers = words(fix);
            vertices[numbers[0] as usize] = Vec3::from_array([1, 2, 3].map(|i| f32::from_bits(numbers[i])));
        }
        vertices
    }
}

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
