//! The model file from outside: what is written comes back; whatever is damaged, cut off, lied about
//! or cannot be read is an error, never a crash, never other data.

use outcrop::Error;
use outcrop::base::ids::BlockId;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::store::*;
use proptest::prelude::*;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::SeqCst};

#[cfg(unix)]
#[path = "store/ending_early.rs"]
mod ending_early;
#[path = "common/thread_memory.rs"]
mod thread_memory;

/// All that a model file holds.
#[derive(Debug, Clone, PartialEq)]
struct Model {
    header: Header,
    blocks: Vec<(Vec<u8>, u32)>,
    parts: Vec<PartRow>,
    materials: Vec<MaterialRow>,
    instances: Vec<InstanceRow>,
    trees: Vec<TreeRow>,
}

/// A folder in memory where there is one: to sync thousands of files to a disk takes minutes.
fn fast_dir() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap()
}

impl Model {
    fn bytes(&self) -> Vec<u8> {
        let dir = fast_dir();
        let path = dir.path().join("model.oc");
        let mut writer = Writer::create(&path).unwrap();
        for (i, (payload, decoded_len)) in self.blocks.iter().enumerate() {
            assert_eq!(writer.block(payload, *decoded_len).unwrap(), BlockId(i as u32));
        }
        let len = writer.finish(&self.header, &self.parts, &self.materials, &self.instances, &self.trees).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes.len() as u64, len);
        bytes
    }

    /// Reads everything there is, by every way there is.
    fn read(source: Arc<dyn Source>) -> outcrop::Result<Self> {
        let file = ModelFile::open(source)?;
        let (mut scratch, mut out, mut blocks) = (Vec::new(), Vec::new(), Vec::new());
        for id in (0..file.block_count()).map(BlockId) {
            file.read_block(id, &mut scratch, &mut out)?;
            blocks.push((out.clone(), file.decoded_len(id)));
        }
        let report = file.check(&Progress::default(), &Cancel::new())?;
        assert_eq!((report.bytes, report.blocks as usize), (file.file_len(), blocks.len()));
        Ok(Self {
            header: *file.header(),
            blocks,
            parts: file.parts().to_rows(),
            materials: file.materials().to_vec(),
            instances: file.instances().to_vec(),
            trees: file.trees().to_vec(),
        })
    }

    fn of_bytes(bytes: &[u8]) -> outcrop::Result<Self> {
        Self::read(Arc::new(MemorySource::named("model.oc", bytes)))
    }

    /// Two trees, one of them placed twice, with colours; blocks of both codecs.
    fn small() -> Self {
        let tree = |first_block, block_count, local_parts| TreeRow {
            first_block,
            block_count,
            class_blocks: [block_count, 0, 0, 0],
            root: 7,
            structure: 1,
            origin: [1e7, 0.0, -1.0],
            bounds: [-1.0, -2.0, -3.0, 1.0, 2.0, 3.0],
            triangles: 20,
            references: 25,
            nodes: 3,
            leaves: 5,
            position_error: 0.0,
            local_parts,
            max_stack: 30,
        };
        let part = |id, name: &str, parent| PartRow {
            id,
            name: name.into(),
            parent,
            material: 1,
            bounds: [0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
            triangles: 10,
            flags: 0,
        };
        let instance = |x, first_part| InstanceRow {
            tree: 1,
            first_part,
            world_from_mesh: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, x, 0.0, 0.0],
        };
        let material = |v| MaterialRow { colour: [v, 0.5, 0.25], opacity: 1.0, metalness: 0.0, roughness: 0.5 };
        let payload = |i: u8| if i.is_multiple_of(2) { vec![i; 60] } else { vec![i, 200, 3, 77] };
        Self {
            header: Header { geometry_blocks: 2, has_colours: true, triangles_in: 41, ..Header::default() },
            blocks: (0..6).map(|i| (payload(i), 100 + u32::from(i))).collect(),
            parts: vec![part(5, "plane", None), part(6, "bolt", Some(0)), part(u64::MAX, "Ø bolt", Some(0))],
            materials: vec![material(0.0), material(1.0)],
            instances: vec![instance(0.0, 1), instance(5.0, 2)],
            trees: vec![tree(0, 1, 3), tree(1, 1, 1)],
        }
    }
}

fn is_file_error(e: &Error) -> bool {
    match e {
        Error::Corrupt { file, .. } | Error::NewerFormat { file, .. } => file == Path::new("model.oc"),
        _ => false,
    }
}

#[test]
fn a_model_comes_back() {
    let model = Model::small();
    assert_eq!(Model::of_bytes(&model.bytes()).unwrap(), model);
    assert_eq!(model.bytes(), model.bytes());
}

#[test]
fn any_flipped_byte_is_an_error() {
    let good = Model::small().bytes();
    for at in 0..good.len() {
        for flip in [1, 0x80, 0xff] {
            let mut bytes = good.clone();
            bytes[at] ^= flip;
            let e = Model::of_bytes(&bytes).expect_err(&format!("byte {at} flipped by {flip:#x}"));
            assert!(is_file_error(&e), "byte {at}: {e:?}");
        }
    }
}

#[test]
fn any_other_length_is_an_error() {
    let good = Model::small().bytes();
    for len in 0..good.len() {
        let e = Model::of_bytes(&good[..len]).expect_err(&format!("cut off at {len}"));
        assert!(is_file_error(&e), "{len}: {e:?}");
    }
    for more in [1, 2, 63, 64, 65, 5000] {
        for fill in [0, 0xff] {
            let longer = [good.clone(), vec![fill; more]].concat();
            assert!(is_file_error(&Model::of_bytes(&longer).unwrap_err()));
        }
    }
    assert!(is_file_error(&Model::of_bytes(&[good.clone(), good.clone()].concat()).unwrap_err()));
}

/// A source with a fault; counts its calls.
struct Faulty {
    bytes: Vec<u8>,
    len: u64,
    fail_at: u32,
    calls: AtomicU32,
}

impl Faulty {
    fn new(bytes: &[u8], len: u64, fail_at: u32) -> Arc<Self> {
        Arc::new(Self { bytes: bytes.to_vec(), len, fail_at, calls: AtomicU32::new(0) })
    }
}

impl Source for Faulty {
    fn len(&self) -> u64 {
        self.len
    }
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        if self.calls.fetch_add(1, SeqCst) == self.fail_at {
            return Err(io::Error::other("the disk is on fire"));
        }
        let from = usize::try_from(offset).ok().and_then(|at| self.bytes.get(at..)?.get(..buf.len()));
        buf.copy_from_slice(from.ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    }
    fn name(&self) -> &Path {
        Path::new("model.oc")
    }
}

#[test]
fn a_source_that_fails_at_any_call_is_an_error_that_says_so() {
    let bytes = Model::small().bytes();
    for fail_at in 0.. {
        let source = Faulty::new(&bytes, bytes.len() as u64, fail_at);
        match Model::read(source.clone()) {
            Ok(model) => {
                assert_eq!(model, Model::small());
                assert!(fail_at > 10 && source.calls.load(SeqCst) == fail_at);
                return;
            }
            Err(Error::Io { path, source, .. }) => {
                assert_eq!(path, Path::new("model.oc"));
                assert!(source.to_string().contains("on fire"));
            }
            Err(e) => panic!("call {fail_at}: {e}"),
        }
    }
}

#[test]
fn a_source_that_lies_about_its_length_is_found_out() {
    let bytes = Model::small().bytes();
    let len = bytes.len() as u64;
    for lie in [0, 1, 8, 255, 256, len - 1, len + 1, 2 * len, u64::from(u32::MAX), 1 << 62, u64::MAX] {
        let e = Model::read(Faulty::new(&bytes, lie, u32::MAX)).unwrap_err();
        assert!(is_file_error(&e), "{lie}: {e}");
    }
}

#[test]
fn a_source_that_ends_early_is_found_out() {
    let bytes = Model::small().bytes();
    for have in 0..bytes.len() {
        let e = Model::read(Faulty::new(&bytes[..have], bytes.len() as u64, u32::MAX)).unwrap_err();
        assert!(is_file_error(&e), "{have}: {e}");
    }
}

#[test]
fn a_file_replaced_after_opening_is_noticed() {
    let dir = fast_dir();
    let path = dir.path().join("model.oc");
    let bytes = Model::small().bytes();
    std::fs::write(&path, &bytes).unwrap();
    let file = ModelFile::open_path(&path).unwrap();
    let mut other = Model::small();
    other.blocks[2].0[5] = 99;
    std::fs::write(&path, other.bytes()).unwrap();
    let (mut scratch, mut out) = (Vec::new(), Vec::new());
    let e = file.read_block(BlockId(2), &mut scratch, &mut out).unwrap_err();
    assert!(matches!(e, Error::Corrupt { block: Some(2), .. }), "{e}");
    assert!(file.check(&Progress::default(), &Cancel::new()).is_err());
    std::fs::write(&path, &bytes[..300]).unwrap();
    assert!(matches!(file.read_block(BlockId(5), &mut scratch, &mut out), Err(Error::Corrupt { .. })));
}

#[test]
fn check_counts_damaged_blocks_and_can_be_cancelled() {
    let mut bytes = Model::small().bytes();
    bytes[256] ^= 1;
    bytes[256 + 64] ^= 1;
    let file = ModelFile::open(Arc::new(MemorySource::named("model.oc", bytes))).unwrap();
    let progress = Progress::default();
    let e = file.check(&progress, &Cancel::new()).unwrap_err();
    assert!(matches!(e, Error::Corrupt { block: Some(0), .. }) && e.to_string().contains("1 more"), "{e}");
    let cancel = Cancel::new();
    cancel.cancel();
    assert!(matches!(file.check(&progress, &cancel), Err(Error::Cancelled)));
}

#[test]
fn a_block_that_is_not_there_is_the_callers_error() {
    let file = ModelFile::open(Arc::new(MemorySource::new(Model::small().bytes()))).unwrap();
    let e = file.read_block(BlockId(6), &mut Vec::new(), &mut Vec::new()).unwrap_err();
    assert!(matches!(e, Error::BadArgument(_)));
    assert_eq!(file.decoded_len(BlockId(6)), 0);
}

// ---------------------------------------------------------------------------------------------
// Valid checksums over wrong content: decoding itself is tested. The offsets are FORMAT.md's.

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    bytes[at..at + value.len()].copy_from_slice(value);
}

fn hash(bytes: &[u8]) -> [u8; 8] {
    xxhash_rust::xxh3::xxh3_64(bytes).to_le_bytes()
}

/// Makes all checksums right again, as far as the places that they cover are inside of the file.
fn reseal(bytes: &mut [u8]) {
    let end = bytes.len();
    let table = end - 312;
    for row in (table..end - 32).step_by(40) {
        let from = usize::try_from(u64_at(bytes, row + 16)).unwrap_or(end);
        let len = usize::try_from(u64_at(bytes, row + 24)).unwrap_or(end);
        if let Some(section) = bytes.get(from..).and_then(|b| b.get(..len)) {
            let sum = hash(section);
            put(bytes, row + 32, &sum);
        }
    }
    put(bytes, 32, &hash(&bytes[table..end - 32]));
    put(bytes, 248, &hash(&bytes[..248]));
    put(bytes, end - 16, &hash(&bytes[..256]));
    put(bytes, end - 8, &hash(&bytes[end - 32..end - 8]));
}

#[test]
fn resealing_an_intact_file_changes_nothing() {
    let good = Model::small().bytes();
    let mut bytes = good.clone();
    reseal(&mut bytes);
    assert_eq!(bytes, good);
}

/// A reader written from FORMAT.md alone finds what was written.
#[test]
fn fields_are_where_the_format_says() {
    let model = Model::small();
    let bytes = model.bytes();
    let u32_at = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let u64_at = |at: usize| u64_at(&bytes, at);
    let f64_at = |at: usize| f64::from_bits(u64_at(at));
    assert_eq!(bytes[..16], *b"\x8fOCR\r\n\x1a\n\0\0\x0d\0\0\x01\0\0");
    assert_eq!([u64_at(16), u64_at(24)], [bytes.len() as u64, bytes.len() as u64 - 312]);
    assert_eq!([40, 44, 48, 52, 56, 60].map(u32_at), [7, 6, 1, 65536, 1, 0]);
    assert_eq!([u64_at(120), u64_at(128)], [41, 0]);
    assert_eq!(u32_at(160), 2);
    let table = bytes.len() - 312;
    let section = |kind: usize| u64_at(table + 40 * (kind - 1) + 16) as usize;
    for (kind, row, rows) in [(1, 32, 6), (2, 80, 3), (3, 24, 2), (4, 104, 2), (5, 128, 2)] {
        let at = table + 40 * (kind - 1);
        assert_eq!([u32_at(at), u32_at(at + 4)], [kind as u32, row]);
        assert_eq!(u64_at(at + 8), rows);
        assert_eq!(section(kind) % 64, 0);
    }
    let (directory, parts, trees) = (section(1), section(2), section(5));
    assert_eq!([u64_at(directory), u64_at(directory + 32)], [256, 320]);
    assert_eq!([u32_at(directory + 40), u32_at(directory + 44), u32_at(directory + 48)], [4, 4, 101]);
    assert_eq!([bytes[directory + 20], bytes[directory + 52]], [1, 0]);
    assert_eq!([u32_at(parts + 64), u32_at(parts + 144), u32_at(parts + 72)], [u32::MAX, 0, 5]);
    assert_eq!(&bytes[parts + 240..parts + 256], "planeboltØ bolt".as_bytes());
    assert_eq!(f64_at(section(4) + 104 + 80), 5.0);
    assert_eq!(
        [u32_at(trees + 112), u32_at(trees + 128), u32_at(trees + 132), u32_at(trees + 232), u32_at(trees + 236)],
        [1, 1, 1, 1, 30]
    );
    assert_eq!([f64_at(trees + 16), f64_at(trees + 32)], [1e7, -1.0]);
}

/// Opens, reads and checks; what is accepted must be a model that can be written and read again.
fn error_or_consistent(bytes: &[u8]) -> bool {
    let (read, took) = thread_memory::peak(|| Model::of_bytes(bytes));
    // Payloads of the test models expand by less than their block size, 64 KB.
    assert!(took < (1 << 20) + 16 * bytes.len() as u64, "{took} bytes of memory for {} bytes", bytes.len());
    match read {
        Ok(model) => {
            assert_eq!(Model::of_bytes(&model.bytes()).unwrap(), model);
            true
        }
        Err(e) => {
            assert!(is_file_error(&e), "{e:?}");
            false
        }
    }
}

#[test]
fn any_byte_of_the_tables_may_have_any_of_these_values() {
    let good = Model::small().bytes();
    let directory = u64_at(&good, good.len() - 312 + 16) as usize;
    let mut accepted = 0;
    for at in (8..256).chain(directory..good.len()) {
        for value in [0, 1, 0x7f, 0x80, 0xf8, 0xff, good[at].wrapping_add(1), good[at].wrapping_sub(1)] {
            let mut bytes = good.clone();
            bytes[at] = value;
            reseal(&mut bytes);
            accepted += u32::from(error_or_consistent(&bytes));
        }
    }
    // Ids, names and numbers may be anything; the rest is not accepted.
    assert!(accepted > 1000, "{accepted}");
}

#[test]
fn whole_fields_may_have_extreme_values() {
    let good = Model::small().bytes();
    let directory = u64_at(&good, good.len() - 312 + 16) as usize;
    let extremes =
        [0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x1_0000_0000, 1 << 62, 1 << 63, u64::MAX - 63, u64::MAX];
    let floats = [f64::NAN, f64::INFINITY, -f64::INFINITY, f64::MAX, f64::MIN_POSITIVE / 2.0, -0.0];
    for at in (8..248).chain(directory..good.len() - 40).step_by(4) {
        for value in extremes.into_iter().chain(floats.map(f64::to_bits)) {
            for width in [4, 8] {
                let mut bytes = good.clone();
                put(&mut bytes, at, &value.to_le_bytes()[..width]);
                reseal(&mut bytes);
                error_or_consistent(&bytes);
            }
        }
    }
}

#[test]
fn bytes_that_belong_to_nobody_are_refused() {
    let good = Model::small().bytes();
    let table = good.len() - 312;
    let section = |i: usize| u64_at(&good, table + 40 * i + 16) as usize;
    // (where 64 zeros are put in, the first section that moves)
    for (at, moved) in [(section(0), 0), (section(1), 1), (section(4), 4), (section(6), 6), (table, 7)] {
        let mut bytes = good.clone();
        bytes.splice(at..at, [0; 64]);
        let table = table + 64;
        for row in moved..7 {
            let offset = u64_at(&bytes, table + 40 * row + 16) + 64;
            put(&mut bytes, table + 40 * row + 16, &offset.to_le_bytes());
        }
        let len = (bytes.len() as u64).to_le_bytes();
        put(&mut bytes, 16, &len);
        put(&mut bytes, 24, &(table as u64).to_le_bytes());
        put(&mut bytes, table + 288, &len);
        reseal(&mut bytes);
        let e = Model::of_bytes(&bytes).expect_err(&format!("64 bytes at {at}"));
        assert!(is_file_error(&e) && !e.to_string().contains("checksum"), "{at}: {e}");
    }
}

fn unit() -> impl Strategy<Value = f32> {
    (0u8..=255).prop_map(|v| f32::from(v) / 255.0)
}

fn bounds() -> impl Strategy<Value = [f64; 6]> {
    prop_oneof![
        Just(outcrop::store::sections::EMPTY_BOUNDS),
        ([-1e9..1e9, -1.0..1.0, 0.0..0.0001], [0.0..1.0, 0.0..1e300, 0.0..f64::MIN_POSITIVE]).prop_map(|(a, d)| [
            a[0],
            a[1],
            a[2],
            a[0] + d[0],
            a[1] + d[1],
            a[2] + d[2]
        ]),
    ]
}

prop_compose! {
    fn any_parts()(
        rows in prop::collection::vec((any::<u64>(), ".*", any::<prop::sample::Index>(), bounds()), 0..12),
    ) -> Vec<PartRow> {
        rows.into_iter().enumerate().map(|(i, (id, name, parent, bounds))| PartRow {
            // Readers leave out characters NUL.
            id, name: name.replace('\0', ""), bounds, material: (id % 3) as u32, triangles: id >> 9, flags: [0, 1, 3][(id % 3) as usize],
            parent: (i > 0 && id % 2 == 0).then(|| parent.index(i.max(1)) as u32),
        }).collect()
    }
}

/// Any classes, the first of which has a block if any has.
fn classes(blocks: u32, seed: u64) -> [u32; 4] {
    let coarse = (seed as u32 % 4).clamp(blocks.min(1), blocks);
    let second = (seed >> 8) as u32 % (blocks - coarse + 1);
    [coarse, second, blocks - coarse - second, 0]
}

prop_compose! {
    fn any_trees()(rows in prop::collection::vec((0u32..4, any::<u64>(), any::<[f32; 3]>()), 1..4)) -> Vec<TreeRow> {
        let mut first_block = 0;
        rows.into_iter().map(|(block_count, n, p)| {
            let bounds = [0.0, -1.0, -2.0, f32::MAX, p[0].abs().min(1e30), p[1].abs().min(1.0)];
            let tree = TreeRow {
                first_block, block_count, class_blocks: classes(block_count, n), root: n as u32,
                structure: 1 + (n >> 40) as u32,
                origin: [f64::from(n as u32), 1e300, -0.5],
                bounds: bounds.map(|v| if v.is_nan() { 7.0 } else { v }),
                triangles: n >> 9, references: n >> 8, nodes: n >> 10, leaves: n >> 11, position_error: 1e-30,
                local_parts: 0, max_stack: n as u32,
            };
            first_block += block_count;
            tree
        }).collect()
    }
}

prop_compose! {
    fn any_model()(
        parts in any_parts(), trees in any_trees(), has_colours: bool, seed: u64,
        materials in prop::collection::vec([unit(), unit(), unit(), unit()], 3..5),
        payloads in prop::collection::vec(prop::collection::vec(0u8..6, 1..900), 36),
        moves in prop::collection::vec([-10.0..10.0f64, 1.0..2.0, -1e7..1e7], 0..5), bounds in bounds(),
    ) -> Model {
        let geometry_blocks = trees.iter().map(|t| t.block_count).sum();
        let header = Header {
            geometry_blocks, has_colours, bounds, triangles_in: seed, triangles_kept: seed / 2, up: (seed % 4) as u32,
            ..Header::default()
        };
        let count = header.block_count() as usize;
        let shared = trees.len() as u32 - 1;
        let instances = moves.into_iter().filter(|_| shared > 0).map(|[shear, scale, x]| InstanceRow {
            tree: 1 + seed as u32 % shared, first_part: 0,
            world_from_mesh: [scale, 0.0, 0.0, shear, 1.0, 0.0, 0.0, shear, -scale, x, 0.0, 0.0],
        }).collect();
        let material = |[a, b, c, d]: [f32; 4]| {
            MaterialRow { colour: [a, b, c], opacity: d, metalness: a, roughness: b }
        };
        let materials = materials.into_iter().map(material).collect();
        let blocks = payloads.into_iter().take(count).map(|p| { let n = p.len() as u32; (p, n * 3) }).collect();
        Model { header, blocks, parts, materials, instances, trees }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_model_comes_back(model in any_model()) {
        prop_assert_eq!(Model::of_bytes(&model.bytes()).unwrap(), model);
    }

    #[test]
    fn any_model_mutated_is_an_error_or_consistent(
        model in any_model(),
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<[u8; 4]>(), 1usize..=4), 1..4),
    ) {
        let mut bytes = model.bytes();
        let directory = u64_at(&bytes, bytes.len() - 312 + 16) as usize;
        for (at, value, len) in edits {
            let at = directory + at.index(bytes.len() - directory - len);
            put(&mut bytes, at, &value[..len]);
        }
        reseal(&mut bytes);
        error_or_consistent(&bytes);
    }
}
