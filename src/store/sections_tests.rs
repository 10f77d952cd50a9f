use super::super::opening::decode_rows;
use super::super::parts::{Parts, Reading};
use super::*;

fn part(name: &str, parent: Option<u32>) -> PartRow {
    PartRow {
        id: 1 << 40,
        name: name.into(),
        parent,
        material: 0,
        bounds: [0.0, 0.0, 0.0, 1.0, 2.0, 3.0],
        triangles: 5,
        flags: PartRow::CLOSED | PartRow::ORIENTED,
    }
}

const MATERIAL: MaterialRow = MaterialRow { colour: [0.0, 0.5, 1.0], opacity: 1.0, metalness: 0.25, roughness: 0.75 };
const INSTANCE: InstanceRow = InstanceRow {
    tree: 1,
    first_part: 1,
    world_from_mesh: [1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, -3.0, 1e7, 0.0, 0.0],
};
const TREE: TreeRow = TreeRow {
    first_block: 0,
    block_count: 2,
    class_blocks: [1, 1, 0, 0],
    root: u32::MAX,
    structure: 7,
    origin: [1e7, 2.0, 3.0],
    bounds: [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0],
    triangles: 10,
    references: 12,
    nodes: 3,
    leaves: 4,
    position_error: 1e-9,
    local_parts: 2,
    max_stack: 40,
};

struct Sample {
    header: Header,
    parts: Vec<PartRow>,
    materials: Vec<MaterialRow>,
    instances: Vec<InstanceRow>,
    trees: Vec<TreeRow>,
}

impl Sample {
    fn new() -> Self {
        let parts = vec![part("root", None), part("Schräube ∅3", Some(0)), part("", Some(1))];
        let trees =
            vec![TREE, TreeRow { first_block: 2, block_count: 1, class_blocks: [1, 0, 0, 0], structure: 9, ..TREE }];
        let header = Header { geometry_blocks: 3, ..Header::default() };
        Self { header, parts, materials: vec![MATERIAL], instances: vec![INSTANCE; 2], trees }
    }
    fn validate(&self) -> Checked<()> {
        let Self { header, parts, materials, instances, trees } = self;
        Tables { parts, materials, instances, trees }.validate(header)
    }
}

fn roundtrip<T: PlainRow + PartialEq + std::fmt::Debug>(rows: &[T]) {
    let bytes = encoded(rows);
    let count = rows.len() as u64;
    assert_eq!(decode_rows::<T>(&bytes, count).unwrap(), rows);
    for len in 0..bytes.len() {
        assert!(decode_rows::<T>(&bytes[..len], count).is_err(), "{len} of {} bytes", bytes.len());
    }
}

/// Reads parts, whose names come in pieces of `piece` bytes.
fn parts_of(bytes: &[u8], count: usize, piece: usize) -> Checked<Parts> {
    let (rows, names) = bytes.split_at(count * PartRow::LEN);
    let mut reading = Reading::new(count as u64, names.len() as u64, 1).unwrap();
    rows.chunks(PartRow::LEN).try_for_each(|row| reading.push_row(row))?;
    reading.end_rows(names.len() as u64)?;
    names.chunks(piece).for_each(|piece| reading.push_names(piece));
    Ok(reading.finish().unwrap()?.0)
}

#[test]
fn rows_come_back_and_sizes_are_exact() {
    let sample = Sample::new();
    roundtrip(&sample.materials);
    roundtrip(&sample.instances);
    roundtrip(&sample.trees);
    sample.validate().unwrap();
}

#[test]
fn parts_come_back_in_any_pieces() {
    let sample = Sample::new();
    let bytes = encoded(&sample.parts);
    for piece in [1, 2, 3, 5, 100] {
        let parts = parts_of(&bytes, 3, piece).unwrap();
        assert_eq!(parts.to_rows(), sample.parts);
        assert_eq!([0, 1, 2, 3].map(|i| parts.name_and_nul(i)), ["root\0", "Schräube ∅3\0", "\0", "\0"]);
    }
    for wrong in [&bytes[..bytes.len() - 1], &[&bytes[..], &[0]].concat()] {
        assert!(parts_of(wrong, 3, 7).is_err());
    }
}

#[test]
fn parts_are_found_by_their_ids() {
    for ids in [[3, 7, 7, 9], [9, 7, 3, 7], [0, 0, u64::MAX, 1], [5; 4]] {
        let rows = ids.map(|id| PartRow { id, ..part("", None) });
        let parts = parts_of(&encoded(&rows), 4, 1).unwrap();
        for id in (0..11).chain([u64::MAX]) {
            let first = ids.iter().position(|&other| other == id).map(|i| i as u32);
            assert_eq!(parts.index_of(id), first, "{id} in {ids:?}");
        }
    }
    assert_eq!(Parts::default().index_of(0), None);
}

#[test]
fn characters_nul_in_names_are_left_out() {
    let parts = parts_of(&encoded(&[part("a\0b", None), part("\0", None), part("c", None)]), 3, 2).unwrap();
    assert_eq!([0, 1, 2].map(|i| parts.get(i).unwrap().name), ["ab", "", "c"]);
}

#[test]
fn names_must_be_utf8() {
    let mut bytes = encoded(&[part("ab", None)]);
    *bytes.last_mut().unwrap() = 0xff;
    assert!(parts_of(&bytes, 1, 9).is_err());
    // Two names that are valid only as one.
    let halves = encoded(&[part("x", None), part("y", None)]);
    let mut halves = halves[..halves.len() - 2].to_vec();
    halves.extend("ä".as_bytes());
    assert!(parts_of(&halves, 2, 9).is_err());
}

#[test]
fn every_documented_range_is_checked() {
    type Damage = (&'static str, fn(&mut Sample));
    let damage: [Damage; 28] = [
        ("own parent", |s| s.parts[1].parent = Some(1)),
        ("later parent", |s| s.parts[1].parent = Some(2)),
        ("no such parent", |s| s.parts[1].parent = Some(9)),
        ("no such material", |s| s.parts[2].material = 1),
        ("NaN bounds", |s| s.parts[0].bounds[4] = f64::NAN),
        ("turned bounds", |s| s.parts[0].bounds[0] = 1.5),
        ("half empty bounds", |s| s.parts[0].bounds[..3].fill(f64::INFINITY)),
        ("colour", |s| s.materials[0].colour[1] = 1.5),
        ("NaN roughness", |s| s.materials[0].roughness = f32::NAN),
        ("instance of tree 0", |s| s.instances[0].tree = 0),
        ("no such tree", |s| s.instances[0].tree = 2),
        ("parts past the end", |s| s.instances[0].first_part = 2),
        ("parts far past the end", |s| s.instances[0].first_part = u32::MAX),
        ("flat transform", |s| s.instances[0].world_from_mesh[4] = 0.0),
        ("infinite transform", |s| s.instances[0].world_from_mesh[9] = f64::INFINITY),
        ("vanishing transform", |s| s.instances[0].world_from_mesh.iter_mut().for_each(|v| *v *= 1e-150)),
        ("exploding transform", |s| s.instances[0].world_from_mesh.iter_mut().for_each(|v| *v *= 1e150)),
        ("overlapping trees", |s| s.trees[1].first_block = 1),
        ("blocks of no tree", |s| s.trees[1].block_count = 0),
        ("more blocks than exist", |s| s.trees[1].block_count = u32::MAX),
        ("class counts with a wrong sum", |s| s.trees[0].class_blocks = [1, 2, 0, 0]),
        ("no coarse block", |s| s.trees[0].class_blocks = [0, 2, 0, 0]),
        ("class counts with a sum beyond 32 bits", |s| s.trees[0].class_blocks = [3, u32::MAX, 0, 0]),
        ("more local parts than parts", |s| s.trees[0].local_parts = 4),
        ("structure 0", |s| s.trees[1].structure = 0),
        ("sums beyond 64 bits", |s| s.trees[1].references = u64::MAX),
        ("NaN origin", |s| s.trees[0].origin[0] = f64::NAN),
        ("negative error", |s| s.trees[0].position_error = -1.0),
    ];
    for (what, damage) in damage {
        let mut sample = Sample::new();
        damage(&mut sample);
        assert!(sample.validate().is_err(), "{what}");
    }
}

#[test]
fn an_empty_model_and_empty_bounds_are_fine() {
    Tables::default().validate(&Header::default()).unwrap();
    let mut sample = Sample::new();
    sample.parts[1].bounds = EMPTY_BOUNDS;
    sample.trees[0].bounds = EMPTY_BOUNDS_F32;
    sample.validate().unwrap();
}

#[test]
fn any_material_can_be_clamped() {
    let wild = MaterialRow { colour: [f32::NAN, -1.0, 7.0], opacity: f32::INFINITY, metalness: -0.0, roughness: 0.5 };
    let tame = wild.clamped();
    assert_eq!(tame.numbers(), [0.0, 0.0, 1.0, 1.0, 0.0, 0.5]);
    assert!(tame.numbers().iter().all(|v| (0.0..=1.0).contains(v)));
}
