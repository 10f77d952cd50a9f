//! `src/store/FORMAT.md` against the code: its tables are parsed, and compared with the constants of the code and with
//! the bytes of a file that the library built.

/// The little-endian bytes of numbers of any types.
macro_rules! le {
    ($($number:expr),*) => { [$($number.to_le_bytes().to_vec()),*].concat() };
}

#[path = "format/model.rs"]
mod model;
#[path = "format/page.rs"]
mod page;
#[path = "format/patch_page.rs"]
mod patch_page;
#[path = "format/patches.rs"]
mod patches;
#[path = "format/payloads.rs"]
mod payloads;
#[path = "format/scene.rs"]
mod scene;

use model::{ends_of_sets, hash, model, sections, with_proxies};
use outcrop::lod;
use outcrop::store::contents::{self, KINDS, Kind, TABLE_LEN};
use outcrop::store::header::{
    ALIGN, BLOCK_SIZES, DEFAULT_BLOCK_SIZE, FOOTER_LEN, FOOTER_MAGIC, HEADER_LEN, MAGIC, VERSION,
};
use outcrop::store::{CLASSES, Codec, MemorySource, ModelFile, directory};
use page::{FORMAT, check_row, fields, numbers, range_of, section, table};
use std::sync::Arc;

fn le_f64s(all: &[f64]) -> Vec<u8> {
    all.iter().flat_map(|number| number.to_le_bytes()).collect()
}

fn le_f32s(all: &[f32]) -> Vec<u8> {
    all.iter().flat_map(|number| number.to_le_bytes()).collect()
}

#[test]
fn title_and_parts_of_the_file_are_those_of_the_code() {
    let title = FORMAT.lines().next().expect("a title");
    assert_eq!(title, format!("# The model file (.oc), format {}.{}", VERSION.0, VERSION.1));
    let parts = table("## 1. Rules", "part | begins at | bytes");
    let of = |name: &str| parts.iter().find(|row| row[0].starts_with(name)).unwrap_or_else(|| panic!("no {name}"));
    assert_eq!(of("header")[1..], ["0".to_string(), HEADER_LEN.to_string()]);
    assert_eq!(of("blocks")[1], HEADER_LEN.to_string());
    assert_eq!(of("section table")[1..], [format!("next multiple of {ALIGN}"), TABLE_LEN.to_string()]);
    assert_eq!(of("sections")[1], format!("next multiple of {ALIGN}"));
    assert_eq!(of("footer")[2], FOOTER_LEN.to_string());
}

/// The bytes in the cell of a magic number.
fn magic(begin: &str) -> Vec<u8> {
    let field = fields(begin).into_iter().next().expect("a field");
    let digits = field.name.split('`').nth(1).expect("a number in backquotes");
    digits.split(' ').map(|byte| u8::from_str_radix(byte, 16).expect("a byte")).collect()
}

#[test]
fn header_and_footer() {
    let (bytes, file) = model();
    let (h, len) = (file.header(), bytes.len());
    let table_at = len - TABLE_LEN - FOOTER_LEN;
    let is_split = h.options.spatial_splits;
    let header = [
        ("magic", MAGIC.to_vec()),
        ("major version", le!(VERSION.0)),
        ("minor version", le!(VERSION.1)),
        ("bytes of the header", le!(HEADER_LEN as u32)),
        ("bytes of the file", le!(len as u64)),
        ("offset of the section table", le!(table_at as u64)),
        ("checksum of the section table", hash(&bytes[table_at..table_at + TABLE_LEN])),
        ("rows of the section table", le!(KINDS.len() as u32)),
        ("blocks", le!(h.geometry_blocks * 4)),
        ("structure", le!(1u32)),
        ("block size", le!(h.block_size)),
        ("flags: bit 0 colour blocks, bit 1 triangles were split", le!(1 | u32::from(is_split) << 1 | 4)),
        ("up axis", le!(3u32)),
        ("metres per unit", le!(0.5f64)),
        ("bounds", le_f64s(&h.bounds)),
        ("triangles of the input", le!(h.triangles_in)),
        ("triangles kept", le!(h.triangles_kept)),
        ("triangles dropped: a vertex", le!(1u64)),
        ("triangles dropped: no area", le!(1u64)),
        ("triangles dropped: too far", le!(1u64)),
        ("geometry blocks", le!(h.geometry_blocks)),
        ("option: maximum number of triangles", le!(h.options.leaf_triangles)),
        ("option: memory budget", le!(0u64)),
        ("option: bytes of a sample", le!(lod::SAMPLE_BYTES as u32)),
        ("reserved", vec![0; 68]),
        ("checksum", hash(&bytes[..HEADER_LEN - 8])),
    ];
    let begin = "## 2. Header";
    check_row(begin, &bytes[..HEADER_LEN], &header);
    assert_eq!(magic(begin), MAGIC);
    assert_eq!(range_of(begin, "major version"), VERSION.0.to_string());
    assert_eq!(range_of(begin, "minor version"), VERSION.1.to_string());
    let behind = TABLE_LEN + FOOTER_LEN;
    assert_eq!(range_of(begin, "offset of the section table"), format!("bytes of the file - {behind}"));
    let sizes = numbers(&range_of(begin, "block size").replace(',', ""));
    assert_eq!(sizes, [*BLOCK_SIZES.start(), *BLOCK_SIZES.end(), DEFAULT_BLOCK_SIZE].map(u64::from));
    assert_eq!(range_of(begin, "option: bytes of a sample"), format!("{} with structure `bvh`", lod::SAMPLE_BYTES));
    assert!(range_of("### Trees", "structure").starts_with("1 `bvh`"));
    assert_eq!(fields(begin).last().map(|f| f.name), Some(&*format!("checksum of bytes 0 to {}", HEADER_LEN - 9)));

    let footer = &bytes[len - FOOTER_LEN..];
    let expected = [
        ("magic", FOOTER_MAGIC.to_vec()),
        ("bytes of the file", le!(len as u64)),
        ("checksum of all 256 bytes of the header", hash(&bytes[..HEADER_LEN])),
        ("checksum of bytes 0 to 23", hash(&footer[..FOOTER_LEN - 8])),
    ];
    check_row("## 7. Footer", footer, &expected);
    assert_eq!(magic("## 7. Footer"), FOOTER_MAGIC);
}

#[test]
fn section_table() {
    let (bytes, file) = model();
    let (begin, table_at) = ("## 6. Section table", bytes.len() - TABLE_LEN - FOOTER_LEN);
    for (i, (kind, offset, len, count)) in sections(&file).into_iter().enumerate() {
        let row = &bytes[table_at + i * contents::ROW_LEN..][..contents::ROW_LEN];
        let expected = [
            ("kind", le!(kind as u32)),
            ("bytes of a row", le!(kind.row_len() as u32)),
            ("rows", le!(count)),
            ("offset", le!(offset as u64)),
            ("bytes, without padding", le!(len as u64)),
            ("checksum", hash(&bytes[offset..offset + len])),
        ];
        check_row(begin, row, &expected);
    }
    assert_eq!(numbers(section(begin).0), [6, KINDS.len() as u64, contents::ROW_LEN as u64]);
    assert_eq!(numbers(range_of(begin, "kind")), KINDS.map(|kind| kind as u64));
    assert_eq!(numbers(range_of(begin, "bytes of a row")), KINDS.map(|kind| kind.row_len() as u64));
}

/// Checks the rows of a section.
fn check_section(kind: Kind, begin: &str, expected: impl Fn(&ModelFile, usize) -> Vec<(&'static str, Vec<u8>)>) {
    check_section_of(model(), kind, begin, expected);
}

fn check_section_of(
    (bytes, file): (&[u8], ModelFile),
    kind: Kind,
    begin: &str,
    expected: impl Fn(&ModelFile, usize) -> Vec<(&'static str, Vec<u8>)>,
) {
    let all = sections(&file);
    let (_, offset, _, count) = all.into_iter().find(|section| section.0 == kind).expect("a section");
    let heading = numbers(section(begin).0);
    assert!(heading.ends_with(&[kind as u64, kind.row_len() as u64]), "{begin}: kind and size in the heading");
    assert!(count > 0, "{begin}: the model has no row to check");
    for i in 0..count as usize {
        let row = &bytes[offset + i * kind.row_len()..][..kind.row_len()];
        check_row(begin, row, &expected(&file, i));
    }
}

#[test]
fn directory_rows() {
    assert_eq!(Kind::Directory.row_len(), directory::ROW_LEN);
    let (bytes, _) = model();
    check_section(Kind::Directory, "## 4. Directory", |file, i| {
        let row = file.directory()[i];
        let before = i.checked_sub(1).map_or(HEADER_LEN as u64, |before| file.directory()[before].end());
        let begin = before.next_multiple_of(ALIGN);
        vec![
            ("offset", le!(begin)),
            ("stored bytes", le!(row.stored_len)),
            ("payload bytes", le!(row.payload_len)),
            ("bytes of the trace form", le!(row.decoded_len)),
            ("codec", vec![row.codec as u8]),
            ("reserved", vec![0; 3]),
            ("checksum", hash(&bytes[begin as usize..][..row.stored_len as usize])),
        ]
    });
}

#[test]
fn codecs_are_those_of_the_code() {
    let codecs = table("## 3. Blocks", "codec | stored form");
    for (i, row) in codecs.iter().enumerate() {
        assert_eq!((row[0].parse::<usize>(), Codec::from_u8(i as u8).is_some()), (Ok(i), true));
    }
    assert_eq!(Codec::from_u8(codecs.len() as u8), None);
}

#[test]
fn rows_of_tables() {
    check_section(Kind::Parts, "### Parts", |file, i| {
        let part = file.parts().get(i).expect("a part");
        vec![
            ("the caller's id", le!(part.id)),
            ("the part's own triangles", le!(part.triangles)),
            ("bounds", le_f64s(&part.bounds)),
            ("row of the parent", le!(part.parent.unwrap_or(0xffff_ffff))),
            ("row of the material", le!(part.material)),
            ("bytes of the name", le!(part.name.len() as u32)),
            ("flags: bit 0 closed", le!(part.flags)),
        ]
    });
    check_section(Kind::Materials, "### Materials", |file, i| {
        let material = file.materials()[i];
        vec![
            ("colour", le_f32s(&material.colour)),
            ("opacity", le!(material.opacity)),
            ("metalness", le!(material.metalness)),
            ("roughness", le!(material.roughness)),
        ]
    });
    check_section(Kind::Assembly, "### Assembly", |file, i| {
        let instance = file.instances()[i];
        vec![
            ("tree", le!(instance.tree)),
            ("row of the part", le!(instance.first_part)),
            ("world from mesh", le_f64s(&instance.world_from_mesh)),
        ]
    });
    check_section(Kind::Trees, "### Trees", |file, i| {
        let tree = file.trees()[i];
        let classes: [u32; CLASSES] = tree.class_blocks;
        vec![
            ("first geometry block", le!(tree.first_block)),
            ("geometry blocks", le!(tree.block_count)),
            ("root", le!(tree.root)),
            ("structure", le!(tree.structure)),
            ("origin", le_f64s(&tree.origin)),
            ("bounds", le_f32s(&tree.bounds)),
            ("triangles", le!(tree.triangles)),
            ("references", le!(tree.references)),
            ("inner nodes", le!(tree.nodes)),
            ("leaves", le!(tree.leaves)),
            ("greatest distance", le!(tree.position_error)),
            ("local parts", le!(tree.local_parts)),
            ("greatest stack size", le!(tree.max_stack)),
            ("geometry blocks of each class", classes.iter().flat_map(|blocks| blocks.to_le_bytes()).collect()),
        ]
    });
    check_section(Kind::PartSets, "### Parts of blocks", |file, i| {
        vec![("end of the block's list", le!(ends_of_sets(file)[i] as u32))]
    });
    check_section_of(with_proxies(), Kind::Proxies, "### Proxies", |file, i| {
        let row = file.proxies().rows()[i];
        vec![
            ("looks", row.looks.iter().flat_map(|look| look.to_le_bytes()).collect()),
            ("surface area", le!(row.area)),
            ("id: number of the run", le!(row.id)),
        ]
    });
}

/// The runs follow the rows, and say of each node what the reader says.
#[test]
fn runs_of_proxies() {
    let (bytes, file) = with_proxies();
    let (_, offset, len, count) =
        sections(&file).into_iter().find(|section| section.0 == Kind::Proxies).expect("proxies");
    let runs = &bytes[offset..offset + len][count as usize * Kind::Proxies.row_len()..];
    assert_eq!(runs.len(), 10 * file.proxies().runs().count());
    for (run, stored) in file.proxies().runs().zip(runs.chunks(10)) {
        let proxy = run.proxy.unwrap_or(0xffff_ffff);
        assert_eq!([le!(run.block), le!(run.node), le!(proxy)].concat(), stored);
        let shown = file.proxies().of(run.block, usize::from(run.node));
        assert_eq!(shown, run.proxy.map(|proxy| &file.proxies().rows()[proxy as usize]));
    }
}

/// Part of an error's text, and the bytes that cause it: where they are in the file, and what they are.
type Lie<'a> = (&'a str, Vec<(usize, Vec<u8>)>);

/// Proxies that lie under right checksums are refused, and the error names the section.
#[test]
fn proxies_that_lie_are_refused() {
    let (good, file) = with_proxies();
    let (_, offset, len, count) =
        sections(&file).into_iter().find(|section| section.0 == Kind::Proxies).expect("proxies");
    let (end, table) = (good.len(), good.len() - TABLE_LEN - FOOTER_LEN);
    let (entry, row) = (table + (KINDS.len() - 1) * contents::ROW_LEN, Kind::Proxies.row_len());
    let runs = offset + count as usize * row;
    let put = |bytes: &mut [u8], at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    let opened = |edits: &[(usize, Vec<u8>)]| {
        let mut bytes = good.to_vec();
        edits.iter().for_each(|(at, value)| put(&mut bytes, *at, value));
        let sum = hash(&bytes[offset..offset + len]);
        put(&mut bytes, entry + 32, &sum);
        let sum = hash(&bytes[table..table + TABLE_LEN]);
        put(&mut bytes, 32, &sum);
        let sum = hash(&bytes[..HEADER_LEN - 8]);
        put(&mut bytes, HEADER_LEN - 8, &sum);
        let sum = hash(&bytes[..HEADER_LEN]);
        put(&mut bytes, end - 16, &sum);
        let sum = hash(&bytes[end - FOOTER_LEN..end - 8]);
        put(&mut bytes, end - 8, &sum);
        ModelFile::open(Arc::new(MemorySource::named("model.oc", bytes))).map(drop)
    };
    assert!(opened(&[]).is_ok());
    let lies: [Lie; 10] = [
        ("proxy 1: the area is not finite and above 0", vec![(offset + row + 72, le!(0.0f32))]),
        ("proxy 0: the area is not finite and above 0", vec![(offset + 72, le!(f32::NAN))]),
        ("proxy 1: the ids do not ascend", vec![(offset + row + 76, le!(0u32))]),
        ("the id of the proxy is that of another run", vec![(runs - 4, le!(u32::MAX))]),
        ("run 0: the block does not exist", vec![(runs, le!(file.header().geometry_blocks))]),
        ("run 0: the proxy does not exist", vec![(runs + 6, le!(count as u32))]),
        ("run 0: the proxy does not exist, or its subtree begins later", vec![(runs + 6, le!(1u32))]),
        ("run 1: the nodes do not ascend", vec![(runs + 14, le!(0u16))]),
        ("", vec![(entry + 8, le!(count - 1))]),
        ("", vec![(entry + 8, le!(count + 1))]),
    ];
    for (why, edits) in lies {
        let found = opened(&edits).expect_err(why).to_string();
        assert!(found.contains("model.oc") && found.contains("section proxies: ") && found.contains(why), "{found}");
        assert!(!found.contains("checksum"), "{found}");
    }
}
