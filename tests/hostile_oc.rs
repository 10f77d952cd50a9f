//! A model file that is damaged, cut off, or wrong throughout with all its checksums right: an error,
//! or the answers of the intact file; never a crash, never other answers.

#[path = "hostile_oc/patches.rs"]
mod patches;

use glam::{DAffine3, DVec3};
use outcrop::base::ids::BlockId;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::Ray;
use outcrop::store::{Header, MemorySource, ModelFile, PartRow, PartSets, Source, TreeRow, Writer};
use outcrop::{Buffer, HitKind, Outputs, QueryOptions};
use outcrop::{
    Context, ContextOptions, Error, Frame, FrameOptions, FrameSettings, FrameState, Hit, Look, Model, Scene, SceneState,
};
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::SeqCst};
use std::time::Duration;

const NAME: &str = "model.oc";

/// A generator of repeatable numbers (splitmix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
    /// In [-1, 1).
    fn point(&mut self) -> DVec3 {
        DVec3::from_array([0; 3].map(|_| (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0))
    }
}

/// A folder in memory where there is one: thousands of files are synced.
fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap()
}

/// `count` triangles in three coloured parts, and a shared mesh of nine placed twice.
fn built(count: usize) -> Vec<u8> {
    built_of([count / 3; 3])
}

/// So many triangles in each of three coloured parts, and a shared mesh of nine placed twice.
fn built_of(counts: [usize; 3]) -> Vec<u8> {
    let dir = folder();
    let path = dir.path().join(NAME);
    let mut random = Random(1);
    let mut triangles = |count: usize, size: f64| -> Vec<[DVec3; 3]> {
        let mut triangle = || {
            let p = random.point();
            [p, p + random.point() * size, p + random.point() * size]
        };
        (0..count).map(|_| triangle()).collect()
    };
    let options = BuildOptions { threads: 1, ..BuildOptions::default() };
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).unwrap();
    let part = |builder: &mut Builder, id: u64, parent| {
        builder.part(PartDesc { id: Some(id), name: format!("part {id}"), parent, material: None }).unwrap()
    };
    let size = 2.0 / (counts.iter().sum::<usize>() as f64).sqrt();
    for (id, count) in (0..).zip(counts) {
        let key = part(&mut builder, 100 + id, None);
        let some = triangles(count, size);
        let colours = vec![[[id as f32 / 2.0, 0.5, 0.25]; 3]; some.len()];
        builder.triangles(MeshKey::DIRECT, key, &some, Attributes::colours(&colours)).unwrap();
    }
    let mesh = builder.shared_mesh(2).unwrap();
    builder.triangles(mesh, 0, &triangles(4, 1.0), Attributes::NONE).unwrap();
    builder.triangles(mesh, 1, &triangles(5, 1.0), Attributes::NONE).unwrap();
    for i in 0..2 {
        let first = part(&mut builder, 200 + 10 * i, Some(0));
        part(&mut builder, 201 + 10 * i, Some(0));
        let at = DAffine3::from_translation(DVec3::X * (2.0 + 2.0 * i as f64));
        builder.instance(mesh, at, first).unwrap();
    }
    builder.finish(&path).unwrap();
    std::fs::read(&path).unwrap()
}

/// No threads: all happens in this one, and a panic is a panic of the test.
fn context() -> Context {
    Context::new(ContextOptions { threads: 0, memory_budget: 1 << 30, ..ContextOptions::default() }).unwrap()
}

/// A scene with one instance, in which one part is hidden and another coloured.
fn open(context: &Context, bytes: &[u8]) -> outcrop::Result<Arc<SceneState>> {
    let model = Model::open_source(context, Arc::new(MemorySource::named(NAME, bytes)))?;
    let scene = Scene::new(context);
    scene.add_instance(&model, 7, DAffine3::IDENTITY)?;
    // Damaged tables may lack these parts.
    let looks = [
        (102, Look { visible: false, ..Look::default() }),
        (201, Look { colour: Some([1.0, 0.0, 0.0, 1.0]), ..Look::default() }),
    ];
    for (part, look) in looks {
        match scene.set_part_look(7, part, look) {
            Ok(()) | Err(Error::BadArgument(_)) => {}
            Err(why) => return Err(why),
        }
    }
    scene.commit()?;
    Ok(scene.state())
}

fn rays(count: usize) -> Vec<Ray> {
    let mut random = Random(2);
    let ray = |_| {
        let from = DVec3::new(1.5, 0.0, 0.0) + random.point().normalize() * 6.0;
        let to = DVec3::new(2.0, 0.0, 0.0) + random.point() * DVec3::new(3.0, 1.0, 1.0);
        Ray::new(from, (to - from).as_vec3())
    };
    (0..count).map(ray).collect()
}

fn hits(scene: &SceneState, rays: &[Ray]) -> outcrop::Result<Vec<Hit>> {
    let mut hits = vec![Hit::MISS; rays.len()];
    scene.closest(rays, QueryOptions::default(), &mut hits)?;
    Ok(hits)
}

/// Colours and primitive ids of a small picture, as bytes.
fn picture(context: &Context, scene: &Arc<SceneState>, model: &Model) -> Result<Vec<u8>, Arc<Error>> {
    let options = FrameOptions { width: 24, height: 16, outputs: Outputs::ALL, ..FrameOptions::default() };
    let frame = Frame::new(context, options)?;
    frame.request(scene, &model.views()[0], &FrameSettings::default())?;
    let status = frame.wait(Duration::from_secs(60));
    match (status.state, status.error) {
        (FrameState::Converged, _) => {}
        (_, Some(error)) => return Err(error),
        (state, None) => panic!("ended as {state:?} without an error"),
    }
    let bytes = |buffer| frame.map(buffer).map(|mapped| mapped.bytes().to_vec());
    Ok(Buffer::ALL.map(bytes).into_iter().collect::<outcrop::Result<Vec<_>>>()?.concat())
}

fn names_the_file(e: &Error) -> bool {
    match e {
        Error::Corrupt { file, .. } | Error::NewerFormat { file, .. } => file == Path::new(NAME),
        _ => false,
    }
}

/// The checks of a damaged file: `check` finds it, and whoever opens it gets an error or what was there.
struct Intact {
    context: Context,
    rays: Vec<Ray>,
    hits: Vec<Hit>,
}

impl Intact {
    fn new(bytes: &[u8]) -> Self {
        let context = context();
        let rays = rays(60);
        let hits = hits(&open(&context, bytes).unwrap(), &rays).unwrap();
        let seen = hits.iter().filter(|h| h.kind == HitKind::Exact).count();
        assert!(seen > 10, "{seen} hits test little");
        Self { context, rays, hits }
    }

    /// Whether it opened.
    fn judge(&self, bytes: &[u8], what: &str) -> bool {
        let checked = ModelFile::open(Arc::new(MemorySource::named(NAME, bytes)))
            .and_then(|file| file.check(&Progress::default(), &Cancel::new()));
        let e = checked.expect_err(what);
        assert!(names_the_file(&e), "{what}: {e}");
        match open(&self.context, bytes) {
            Err(e) => {
                assert!(names_the_file(&e), "{what}: {e}");
                false
            }
            Ok(scene) => {
                match hits(&scene, &self.rays) {
                    Ok(found) => assert_eq!(found, self.hits, "{what}"),
                    Err(e) => assert!(names_the_file(&e), "{what}: {e}"),
                }
                true
            }
        }
    }
}

#[test]
fn any_flipped_byte_of_a_small_model() {
    let good = built(60);
    let intact = Intact::new(&good);
    let mut opened = 0;
    for at in 0..good.len() {
        for flip in [1, 0x80, 0xff] {
            let mut bytes = good.clone();
            bytes[at] ^= flip;
            opened += usize::from(intact.judge(&bytes, &format!("byte {at} of {}, flipped by {flip:#x}", good.len())));
        }
    }
    // Blocks that are read only when asked for, and padding.
    assert!(opened > 0 && opened < good.len(), "{opened}");
    assert_eq!(intact.context.memory_used(), 0, "memory of what failed to open");
}

#[test]
fn any_length_of_a_small_model() {
    let good = built(60);
    let intact = Intact::new(&good);
    for len in 0..good.len() {
        assert!(!intact.judge(&good[..len], &format!("cut off at {len}")));
    }
    assert!(!intact.judge(&[&good[..], &[0]].concat(), "a byte more"));
}

#[test]
fn samples_of_a_larger_model() {
    let good = built(30_000);
    let intact = Intact::new(&good);
    let mut random = Random(3);
    for _ in 0..300 {
        let (at, flip) = (random.below(good.len()), 1 << random.below(8));
        let mut bytes = good.clone();
        bytes[at] ^= flip;
        intact.judge(&bytes, &format!("byte {at} of {}, flipped by {flip:#x}", good.len()));
        let len = random.below(good.len());
        assert!(!intact.judge(&good[..len], &format!("cut off at {len}")));
    }
}

#[test]
fn a_damaged_model_gives_no_other_picture() {
    let good = built(60);
    let context = context();
    let model_of = |bytes: &[u8]| Model::open_source(&context, Arc::new(MemorySource::named(NAME, bytes)));
    let picture_of =
        |bytes: &[u8]| -> Result<Vec<u8>, Arc<Error>> { picture(&context, &open(&context, bytes)?, &model_of(bytes)?) };
    let expected = picture_of(&good).unwrap();
    assert!(expected.iter().any(|&b| b != expected[0]));
    for at in (0..good.len()).step_by(11) {
        let mut bytes = good.clone();
        bytes[at] ^= 0x10;
        match picture_of(&bytes) {
            Ok(found) => assert!(found == expected, "byte {at}: another picture"),
            Err(e) => assert!(names_the_file(&e), "byte {at}: {e}"),
        }
    }
}

/// All of a file, to be written again with something changed.
struct Content {
    header: Header,
    blocks: Vec<(Vec<u8>, u32)>,
    parts: Vec<PartRow>,
    trees: Vec<TreeRow>,
    /// The parts of each geometry block.
    lists: Vec<Vec<u32>>,
    file: ModelFile,
}

impl Content {
    fn of(bytes: &[u8]) -> Self {
        let file = ModelFile::open(Arc::new(MemorySource::named(NAME, bytes))).unwrap();
        let (mut scratch, mut payload) = (Vec::new(), Vec::new());
        let mut block = |id| {
            file.read_block(id, &mut scratch, &mut payload).unwrap();
            (payload.clone(), file.decoded_len(id))
        };
        let blocks = (0..file.block_count()).map(|id| block(BlockId(id))).collect();
        let sets = file.part_sets().unwrap();
        let lists = (0..sets.len()).map(|block| sets.of(block).collect()).collect();
        Self {
            header: *file.header(),
            blocks,
            parts: file.parts().to_rows(),
            trees: file.trees().to_vec(),
            lists,
            file,
        }
    }

    /// The file of it, all checksums right; `None` if the format has no such file.
    fn bytes(&self) -> Option<Vec<u8>> {
        let dir = folder();
        let path = dir.path().join(NAME);
        let mut writer = Writer::create(&path).unwrap();
        for (payload, decoded_len) in &self.blocks {
            writer.block(payload, *decoded_len).ok()?;
        }
        let mut sets = PartSets::default();
        self.lists.iter().for_each(|list| sets.push(list.iter().copied()).unwrap());
        writer.set_part_sets(sets);
        writer.finish(&self.header, &self.parts, self.file.materials(), self.file.instances(), &self.trees).ok()?;
        Some(std::fs::read(&path).unwrap())
    }
}

/// Opens and traces what may be anything but must not crash or hang; whether it opened.
fn survives(context: &Context, rays: &[Ray], bytes: &[u8], what: &str) -> bool {
    let scene = match open(context, bytes) {
        Ok(scene) => scene,
        Err(e) => {
            assert!(names_the_file(&e) || matches!(e, Error::BadArgument(_)), "{what}: {e}");
            return false;
        }
    };
    for coherent in [false, true] {
        let mut hits = vec![Hit::MISS; rays.len()];
        if let Err(e) = scene.closest(rays, QueryOptions { coherent, ..QueryOptions::default() }, &mut hits) {
            assert!(names_the_file(&e), "{what}: {e}");
        }
        assert!(hits.iter().all(|h| !h.t.is_nan()), "{what}: NaN");
    }
    // Colours too, and all that only pictures ask for.
    if what.len().is_multiple_of(4) {
        let model = Model::open_source(context, Arc::new(MemorySource::named(NAME, bytes))).unwrap();
        if let Err(e) = picture(context, &scene, &model) {
            assert!(names_the_file(&e) || matches!(*e, Error::BadArgument(_)), "{what}: {e}");
        }
    }
    true
}

#[test]
fn payloads_that_are_wrong_under_right_checksums() {
    let mut content = Content::of(&built(60));
    let (context, rays) = (context(), rays(16));
    assert!(survives(&context, &rays, &content.bytes().unwrap(), "intact"));
    let mut opened = 0;
    for block in 0..content.blocks.len() {
        let payload = content.blocks[block].0.clone();
        for (at, &byte) in payload.iter().enumerate() {
            for value in [0, 1, 0x7f, 0xff, byte.wrapping_add(1), byte ^ 0x40] {
                content.blocks[block].0[at] = value;
                let what = format!("block {block}, byte {at} = {value:#x}");
                opened += usize::from(survives(&context, &rays, &content.bytes().unwrap(), &what));
            }
            content.blocks[block].0[at] = byte;
        }
        for len in 1..payload.len() {
            content.blocks[block].0.truncate(len);
            let what = format!("block {block}, {len} bytes");
            let in_geometry = (block as u32) < content.header.geometry_blocks;
            let opens = survives(&context, &rays, &content.bytes().unwrap(), &what);
            assert!(!(opens && in_geometry), "{what}");
            content.blocks[block].0.clone_from(&payload);
        }
    }
    assert!(opened > 100, "{opened}");
}

/// References from block to block are checked where both are known.
#[test]
fn payloads_of_many_blocks_that_are_wrong_under_right_checksums() {
    let mut content = Content::of(&built(4000));
    let geometry = content.header.geometry_blocks as usize;
    assert!(geometry > 4, "{geometry} blocks test little");
    let (context, rays, mut random) = (context(), rays(16), Random(4));
    for _ in 0..1500 {
        let block = random.below(geometry);
        let payload = content.blocks[block].0.clone();
        // The top, which refers to the others, lies in a small block.
        let within = if random.below(2) == 0 { payload.len() } else { payload.len().min(400) };
        let at = random.below(within);
        content.blocks[block].0[at] ^= 1 << random.below(8);
        survives(&context, &rays, &content.bytes().unwrap(), &format!("block {block}, byte {at}"));
        content.blocks[block].0 = payload;
    }
}

#[test]
fn tables_that_are_wrong_under_right_checksums() {
    let good = built(60);
    let (context, rays) = (context(), rays(16));
    type Change = fn(&mut Content);
    let changes: [(&str, Change); 23] = [
        ("root far away", |c| c.trees[0].root = u32::MAX),
        ("root of 17 bits", |c| c.trees[1].root = 1 << 16),
        ("next root", |c| c.trees[0].root += 1),
        ("root zero", |c| c.trees[1].root = 0),
        ("stack of nothing", |c| c.trees[0].max_stack = 0),
        ("stack of everything", |c| c.trees[0].max_stack = u32::MAX),
        ("no local parts", |c| c.trees[0].local_parts = 0),
        ("no local parts in the shared mesh", |c| c.trees[1].local_parts = 0),
        ("origin far away", |c| c.trees[0].origin = [f64::MAX; 3]),
        ("bounds too small", |c| c.trees[0].bounds = [0.0; 6]),
        ("bounds empty", |c| c.trees[1].bounds = outcrop::store::sections::EMPTY_BOUNDS_F32),
        ("bounds too large", |c| c.trees[0].bounds = [f32::MIN, f32::MIN, f32::MIN, f32::MAX, f32::MAX, f32::MAX]),
        ("error of everything", |c| c.trees[0].position_error = f64::MAX),
        ("triangles without number", |c| c.trees[0].triangles = u64::MAX / 2),
        ("nodes without number", |c| c.trees[0].nodes = u64::MAX / 2),
        ("part of everything", |c| c.parts[0].triangles = u64::MAX / 2),
        ("empty part", |c| c.parts[0].bounds = outcrop::store::sections::EMPTY_BOUNDS),
        ("model without bounds", |c| c.header.bounds = outcrop::store::sections::EMPTY_BOUNDS),
        ("model of everything", |c| c.header.bounds = [f64::MIN, f64::MIN, f64::MIN, f64::MAX, f64::MAX, f64::MAX]),
        ("another structure of the header", |c| c.header.structure = 2),
        ("another structure of a tree", |c| c.trees[1].structure = 2),
        ("decoded to less", |c| c.blocks[0].1 -= 4),
        ("decoded to nothing", |c| c.blocks.iter_mut().for_each(|b| b.1 = 0)),
    ];
    for (what, change) in changes {
        let mut content = Content::of(&good);
        change(&mut content);
        if let Some(bytes) = content.bytes() {
            // Lengths of all remainders: with pictures and without.
            for dots in ["", ".", "..", "..."] {
                survives(&context, &rays, &bytes, &format!("{what}{dots}"));
            }
        }
    }
    let mut content = Content::of(&good);
    let mut opened = 0;
    for root in (0..2000).chain((11..32).map(|bit| 1 << bit)) {
        content.trees[0].root = root;
        let opens = survives(&context, &rays, &content.bytes().unwrap(), &format!("root {root}"));
        opened += usize::from(opens && root < 2000);
    }
    let nodes = content.trees[0].nodes as usize;
    assert!((1..=nodes).contains(&opened), "{opened} roots are accepted, there are {nodes} nodes");
    for i in 0..Content::of(&good).blocks.len() {
        for j in 0..i {
            let mut content = Content::of(&good);
            content.blocks.swap(i, j);
            survives(&context, &rays, &content.bytes().unwrap(), &format!("blocks {i} and {j} changed places"));
        }
    }
}

#[test]
fn a_file_that_is_something_else() {
    let context = context();
    let texts: [&[u8]; 5] = [b"", b"\x8fOCR", b"ply\nformat ascii 1.0\n", b"PK\x03\x04", &[0; 4096]];
    for bytes in texts {
        let e = open(&context, bytes).map(|_| ()).unwrap_err();
        assert!(names_the_file(&e), "{e}");
    }
    let dir = folder();
    for path in [dir.path().to_path_buf(), dir.path().join("none")] {
        let e = Model::open(&context, &path).map(|_| ()).unwrap_err();
        assert!(matches!(&e, Error::Io { path: p, .. } if *p == path), "{e}");
    }
}

/// Fails at its call number `fail_at`, counted from 0, and at the next: a block is read twice before it is given up.
struct Failing {
    inner: MemorySource,
    calls: AtomicU32,
    fail_at: u32,
}

impl Source for Failing {
    fn len(&self) -> u64 {
        self.inner.len()
    }
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        if (self.fail_at..self.fail_at + 2).contains(&self.calls.fetch_add(1, SeqCst)) {
            return Err(io::Error::other("the disk is on fire"));
        }
        self.inner.read_at(offset, buf)
    }
    fn name(&self) -> &Path {
        Path::new(NAME)
    }
}

#[test]
fn a_source_that_fails_at_any_call() {
    let good = built(60);
    let intact = Intact::new(&good);
    for fail_at in 0.. {
        let inner = MemorySource::named(NAME, good.as_slice());
        let source = Arc::new(Failing { inner, calls: AtomicU32::new(0), fail_at });
        let answer = || -> outcrop::Result<Vec<Hit>> {
            let model = Model::open_source(&intact.context, source.clone())?;
            let scene = Scene::new(&intact.context);
            scene.add_instance(&model, 7, DAffine3::IDENTITY)?;
            scene.set_part_look(7, 102, Look { visible: false, ..Look::default() })?;
            scene.commit()?;
            // What failed once is asked for again.
            let first = hits(&scene.state(), &intact.rays);
            if first.is_err() {
                assert_eq!(hits(&scene.state(), &intact.rays).unwrap(), intact.hits);
            }
            first
        };
        match answer() {
            Ok(found) => {
                assert!(found == intact.hits && fail_at > 5, "call {fail_at}");
                break;
            }
            Err(Error::Io { path, source, .. }) => {
                assert!(path == Path::new(NAME) && source.to_string().contains("on fire"));
            }
            Err(e) => panic!("call {fail_at}: {e}"),
        }
    }
    assert_eq!(intact.context.memory_used(), 0);
}

/// `Model::check`, with all blocks in memory and with few.
fn checked(bytes: &[u8]) -> [outcrop::Result<()>; 2] {
    [1 << 30, 9 << 18].map(|memory_budget| {
        let context = Context::new(ContextOptions { threads: 1, memory_budget, ..ContextOptions::default() }).unwrap();
        let model = Model::open_source(&context, Arc::new(MemorySource::named(NAME, bytes)))?;
        let outcome = model.check(&Cancel::new());
        let (held, all) = (model.memory().resident, model.memory().geometry);
        assert_eq!(held < all, memory_budget < 1 << 30, "{held} of {all} bytes in memory");
        outcome
    })
}

/// A list that lacks a part of its block, or has none above one that has a part: a query may then miss the part, or hit
/// it though it is hidden, but ends. A check names the block and the part.
#[test]
fn lists_of_parts_that_lack_parts_of_their_blocks() {
    let mut content = Content::of(&built_of([10_000, 19_990, 10]));
    let (context, rays) = (context(), rays(16));
    checked(&content.bytes().unwrap()).into_iter().for_each(|outcome| outcome.unwrap());
    let (mut own, mut below) = (0, 0);
    let step = content.lists.len() / 5;
    for block in (0..content.lists.len()).step_by(step).chain([1, 2]) {
        let list = content.lists[block].clone();
        for part in list.iter().copied().filter(|_| list.len() > 1) {
            content.lists[block].retain(|&other| other != part);
            let bytes = content.bytes().unwrap();
            for outcome in checked(&bytes) {
                let error = outcome.expect_err("a part is missing").to_string();
                let expected = format!("block {block}: its list of parts lacks local part {part}, which is in ");
                assert!(error.contains(&expected), "{error}");
                own += usize::from(error.contains("which is in the block") || error.contains("which is in its block"));
                below += usize::from(error.contains("which is in the list of block"));
            }
            assert!(survives(&context, &rays, &bytes, &format!("block {block} without part {part}")));
            content.lists[block].clone_from(&list);
        }
        // More parts than there are make a query read more.
        content.lists[block] = (0..3).collect();
        assert!(list.is_empty() || checked(&content.bytes().unwrap()).iter().all(Result::is_ok), "block {block}");
        content.lists[block] = list;
    }
    assert!(own > 0 && below > 0, "{own}, {below}");
    // A list above a block without one.
    let [coarse, fine, ..] = content.trees[0].class_blocks;
    let last = (coarse + fine) as usize - 1;
    content.lists[last].clear();
    for outcome in checked(&content.bytes().unwrap()) {
        let error = outcome.expect_err("a list above none").to_string();
        assert!(error.contains(&format!("but block {last} below it has none")), "{error}");
    }
}
