//! The tables of `patch` blocks on the page, and blocks as they describe them.

use super::page::{Field, check_constant, fields, number, numbers, section, table};
use super::payloads::bits;
use glam::{DMat3, DVec3, Vec3};
use std::collections::BTreeMap;

pub(super) const BLOCKS: &str = "### Block payloads of structure `patch`";
pub(super) const HEAD: &str = "#### Patch: head of a coarse or a fine block";
pub(super) const NODE: &str = "#### Patch: node";
pub(super) const REFERENCE: &str = "#### Patch: reference";
pub(super) const VOXEL: &str = "#### Patch: voxel";
pub(super) const FRAME: &str = "#### Patch: frame";
pub(super) const TREE: &str = "#### Patch: word of a quadtree";
pub(super) const LEAF: &str = "#### Patch: leaf block";
pub(super) const GRID: &str = "#### Patch: grid";
pub(super) const REST: &str = "#### Patch: rest of a computed grid";
pub(super) const NET: &str = "#### Patch: net";

/// A table of offsets of the page.
pub(super) struct Table {
    pub(super) fields: Vec<Field>,
    pub(super) size: usize,
}

impl Table {
    pub(super) fn of(begin: &str) -> Self {
        let fields = fields(begin);
        let size = fields.iter().map(|field| field.size).sum();
        assert_eq!(numbers(section(begin).0).last(), Some(&(size as u64)), "{begin}: size in the heading");
        Self { fields, size }
    }

    /// The row at the start of some bytes.
    pub(super) fn row<'a>(&'a self, bytes: &'a [u8]) -> Row<'a> {
        let bytes = &bytes[..self.size];
        self.fields.iter().for_each(|f| check_constant(f.name, f.range, &bytes[f.offset..f.offset + f.size]));
        Row { fields: &self.fields, bytes }
    }
}

/// A row of a table.
pub(super) struct Row<'a> {
    pub(super) fields: &'a [Field],
    pub(super) bytes: &'a [u8],
}

impl Row<'_> {
    /// The bytes of the field that begins with `name`.
    pub(super) fn bytes(&self, name: &str) -> &[u8] {
        let field = self.fields.iter().find(|f| f.name.starts_with(name)).unwrap_or_else(|| panic!("no field {name}"));
        &self.bytes[field.offset..field.offset + field.size]
    }

    pub(super) fn number(&self, name: &str) -> usize {
        number(self.bytes(name)) as usize
    }

    pub(super) fn words(&self, name: &str) -> Vec<u32> {
        words(self.bytes(name))
    }

    pub(super) fn floats(&self, name: &str) -> Vec<f32> {
        self.words(name).into_iter().map(f32::from_bits).collect()
    }
}

pub(super) fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(|word| number(word) as u32).collect()
}

/// Planes of a box: low x, y, z, high x, y, z.
pub(super) type Planes = [f32; 6];

pub(super) fn holds(planes: &Planes, p: DVec3) -> bool {
    (0..3).all(|axis| f64::from(planes[axis]) <= p[axis] && p[axis] <= f64::from(planes[axis + 3]))
}

/// The tables of the words of a quadtree.
pub(super) struct Codes {
    /// First bit and number of bits of each row, with the field.
    pub(super) bits: Vec<((u32, u32), &'static str)>,
    pub(super) shifts: Vec<f32>,
    pub(super) intervals: Vec<[f32; 2]>,
}

impl Codes {
    pub(super) fn of_page() -> Self {
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
    pub(super) fn children(&self, word: u32, node: &Planes) -> [Planes; 4] {
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
pub(super) struct Page {
    pub(super) head: Table,
    pub(super) node: Table,
    pub(super) voxel: Table,
    pub(super) frame: Table,
    pub(super) grid: Table,
    pub(super) rest: Table,
    pub(super) net: Table,
    pub(super) codes: Codes,
    /// Bits of the number and of the kind of a reference.
    pub(super) reference: Vec<(u32, u32)>,
}

/// A child of a node: kind, number, box, and the set of parts that its voxel states.
pub(super) struct ChildAt {
    pub(super) kind: u32,
    pub(super) number: u32,
    pub(super) planes: Planes,
    pub(super) parts: Option<u32>,
}

/// A part of the square of a face: the corner of the face if it has several squares, and the part's place.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Square {
    pub(super) corner: usize,
    pub(super) level: usize,
    pub(super) u: usize,
    pub(super) v: usize,
}

pub(super) struct FrameAt {
    pub(super) at: usize,
    pub(super) centre: DVec3,
    pub(super) map: DMat3,
    pub(super) part: u32,
    pub(super) face: u32,
    pub(super) square: Square,
    pub(super) is_turned: bool,
    pub(super) levels: u32,
    pub(super) tree: Vec<u32>,
}

/// A coarse or a fine block.
pub(super) struct NodesOf {
    pub(super) nodes: Vec<Vec<ChildAt>>,
    pub(super) frames: Vec<FrameAt>,
}

pub(super) struct GridOf {
    pub(super) part: u32,
    pub(super) face: u32,
    pub(super) level: u32,
    pub(super) vertices: Vec<Vec3>,
    pub(super) is_computed: bool,
}

impl Page {
    pub(super) fn new() -> Self {
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
    pub(super) fn nodes(&self, bytes: &[u8]) -> NodesOf {
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
    pub(super) fn grids(&self, bytes: &[u8]) -> Vec<GridOf> {
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
    pub(super) fn vertices(&self, rest: &Row, net: &[u8], level: u32, is_rational: bool, fixes: &[u8]) -> Vec<Vec3> {
        let row = self.net.row(net);
        let doubles = |bytes: &[u8]| -> Vec<f64> {
            bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().expect("8 bytes"))).collect()
        };
        let mut axes: Vec<Vec<f64>> = ["x of the control points", "y", "z"].map(|name| doubles(row.bytes(name))).into();
        if is_rational {
            axes.push(doubles(&net[self.net.size..self.net.size + 128]));
        }
        let (place, last) = (rest.number("place"), 1usize << level);
        let [of_u, of_v] = [[place & 15, place >> 4 & 0xfff], [place >> 28, place >> 16 & 0xfff]];
        assert!([of_u, of_v].iter().all(|[above, index]| *above <= 12 && *index < 1 << above));
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
                let at = |[above, first]: [usize; 2], index: usize| {
                    (first * last + index) as f64 / f64::from(1u32 << (above as u32 + level))
                };
                let (wu, wv) = (weights(at(of_u, i)), weights(at(of_v, j)));
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
