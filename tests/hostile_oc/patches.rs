//! Files of surfaces (structure `patch`) that are wrong under right checksums: an error or an answer, and an end.

use super::{Content, NAME, Random, context, folder, names_the_file, picture};
use crate::common::shapes;
use glam::{DAffine3, DVec3, Vec3};
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder, Structure, SurfaceLeaves};
use outcrop::import::surfaces::{CageMesh, Dicing};
use outcrop::import::{MeshKey, PartDesc, Sink};
use outcrop::math::{Cone, DBounds, Ray};
use outcrop::query::{CursorOptions, Found, NearestOptions, NearestPoint};
use outcrop::render::{Prefetch, PrefetchState};
use outcrop::store::{MemorySource, TreeRow};
use outcrop::structure::nodes::NO_NODE;
use outcrop::{Context, Error, Hit, HitKind, Look, Model, QueryOptions, Scene};
use std::sync::Arc;
use std::time::Duration;

/// A cube with creases, each face a part of its own, diced to a level.
fn built(level: u32) -> Content {
    built_of(SurfaceLeaves::Boxes, level)
}

fn built_of(surface_leaves: SurfaceLeaves, level: u32) -> Content {
    let dir = folder();
    let path = dir.path().join(NAME);
    let (structure, dicing) = (Structure::Patch, Some(Dicing::Level(level)));
    let options = BuildOptions { threads: 1, structure, surface_leaves, dicing, ..BuildOptions::default() };
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).unwrap();
    let shape = shapes::own().into_iter().find(|shape| shape.name == "cube_creases").unwrap();
    let part = |id| PartDesc { id: Some(100 + id), ..PartDesc::default() };
    let parts: Vec<u32> = (0..shape.sizes.len() as u64).map(|id| builder.part(part(id)).unwrap()).collect();
    let mesh = CageMesh { desc: shape.desc(), positions: &shape.points, parts: &parts, displacement: None };
    builder.cage(MeshKey::DIRECT, &mesh).unwrap();
    builder.finish(&path).unwrap();
    Content::of(&std::fs::read(&path).unwrap())
}

/// The tree of the surface. The one before it, of triangles, is empty.
fn tree(content: &mut Content) -> &mut TreeRow {
    content.trees.iter_mut().find(|tree| tree.structure == Structure::Patch as u32).unwrap()
}

/// Rays through the middle, every second one with a footprint, from small to larger than the model.
fn rays() -> Vec<Ray> {
    let mut random = Random(5);
    let ray = |i: i32| {
        let from = random.point().normalize() * 5.0;
        let dir = (random.point() * 0.5 - from).as_vec3();
        let cone = if i % 2 == 0 { Cone::ZERO } else { Cone { a: 0.01 * (1 << (i / 2)) as f32, b: 1e-3 } };
        Ray { cone, ..Ray::new(from, if i % 5 == 4 { dir.round() } else { dir }) }
    };
    (0..20).map(ray).filter(|ray| ray.dir != Vec3::ZERO).collect()
}

/// The outcome of everything that a caller may ask of the file; the model has opened.
type Asked = outcrop::Result<Vec<Hit>>;

/// Asks for everything. Panics if a call fails with another error than that of the file.
fn asked(context: &Context, bytes: &[u8], what: &str) -> Asked {
    let fine = |error: &Error| assert!(names_the_file(error), "{what}: {error}");
    let model = Model::open_source(context, Arc::new(MemorySource::named(NAME, bytes)))?;
    let scene = Scene::new(context);
    scene.add_instance(&model, 7, DAffine3::IDENTITY)?;
    scene.set_part_look(7, 102, Look { visible: false, ..Look::default() })?;
    scene.commit()?;
    let (state, rays) = (scene.state(), rays());
    let all = DBounds { min: DVec3::splat(-9.0), max: DVec3::splat(9.0) };
    let prefetch = Prefetch::of_box(&state, &all, 0.05)?.wait(Duration::from_secs(60));
    assert!(matches!(prefetch.state, PrefetchState::Done | PrefetchState::Failed), "{what}: {prefetch:?}");
    prefetch.error.iter().for_each(|error| fine(error));
    let mut hits = vec![Hit::MISS; rays.len()];
    let mut traced = Ok(());
    for coherent in [false, true] {
        let options = QueryOptions { coherent, ..QueryOptions::default() };
        traced = state.closest(&rays, options, &mut hits);
        traced.iter().for_each(|()| assert!(hits.iter().all(|hit| !hit.t.is_nan()), "{what}: NaN"));
        traced.as_ref().err().into_iter().for_each(fine);
        state.any(&rays, options, &mut vec![0; rays.len()]).err().iter().for_each(fine);
    }
    state.overlap_box(&all).err().iter().for_each(fine);
    let mut nearest = vec![NearestPoint::MISS; 2];
    let points = [DVec3::new(0.2, 3.0, 0.1), DVec3::ZERO];
    state.nearest(&points, &NearestOptions::default(), &mut nearest).err().iter().for_each(fine);
    nodes(&model).err().iter().for_each(fine);
    // All that only pictures ask for.
    if what.len().is_multiple_of(8) {
        picture(context, &state, &model).err().iter().for_each(|error| fine(error));
    }
    model.load(&Cancel::new()).err().iter().for_each(fine);
    model.check(&Cancel::new()).err().iter().for_each(fine);
    traced.map(|()| hits)
}

/// Walks over some nodes, to triangles too.
fn nodes(model: &Model) -> outcrop::Result<()> {
    let mut cursor = model.cursor(CursorOptions::default())?;
    let mut open: Vec<u64> = [cursor.root(0)?, cursor.root(1)?].into_iter().flatten().collect();
    for _ in 0..60 {
        let Some(id) = open.pop() else { break };
        let Found::There(node) = cursor.node(id)? else { continue };
        let (is_leaf, children) = (node.triangles > 0, node.child);
        open.extend(children.into_iter().filter(|child| *child != NO_NODE));
        if is_leaf {
            cursor.triangles(id, true)?;
        }
    }
    Ok(())
}

/// The words of a block, from its payload.
fn words(content: &Content, block: usize) -> Vec<u32> {
    content.blocks[block].0.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect()
}

fn put(content: &mut Content, block: usize, at: usize, word: u32) {
    content.blocks[block].0[4 * at..4 * at + 4].copy_from_slice(&word.to_le_bytes());
}

#[test]
fn words_of_patches_that_are_wrong_under_right_checksums() {
    let mut content = built(2);
    let context = context();
    let intact = asked(&context, &content.bytes().unwrap(), "intact").unwrap();
    for kind in [HitKind::Exact, HitKind::Lod] {
        assert!(intact.iter().filter(|hit| hit.kind == kind).count() > 2, "{kind:?}: {intact:?}");
    }
    let mut random = Random(6);
    let geometry = content.header.geometry_blocks as usize;
    let extremes =
        [0, 1, u32::MAX, f32::NAN.to_bits(), f32::INFINITY.to_bits(), f32::MAX.to_bits(), 0xff7f_ffff, 1 << 30];
    let (mut opened, mut other) = (0, 0);
    for _ in 0..1000 {
        let block = random.below(geometry);
        let all = words(&content, block);
        // Heads, nodes and first frames rather than the vertices.
        let within = if random.below(3) == 0 { all.len() } else { all.len().min(300) };
        let at = random.below(within);
        let word = match random.below(4) {
            0 => extremes[random.below(extremes.len())],
            1 => all[random.below(all.len())],
            2 => all[at].wrapping_add(1),
            _ => all[at] ^ 1 << random.below(32),
        };
        put(&mut content, block, at, word);
        let what = format!("block {block}, word {at} = {word:#x}");
        match asked(&context, &content.bytes().unwrap(), &what) {
            Ok(hits) => {
                opened += 1;
                other += usize::from(hits != intact);
            }
            Err(error) => assert!(names_the_file(&error), "{what}: {error}"),
        }
        put(&mut content, block, at, all[at]);
    }
    assert!(opened > 100 && other > 10 && opened < 900, "{opened} opened, {other} with other hits");
    assert_eq!(context.memory_used(), 0);
}

#[test]
fn payloads_of_patches_of_any_length() {
    let mut content = built(2);
    let context = context();
    let geometry = content.header.geometry_blocks as usize;
    for block in 0..content.blocks.len() {
        let (payload, decoded) = content.blocks[block].clone();
        for len in (1..payload.len()).step_by(if block < geometry { 97 } else { 41 }) {
            // With the size that the directory then has, and with that of before.
            for decoded in [decoded, len as u32] {
                content.blocks[block] = (payload[..len].to_vec(), decoded);
                let what = format!("block {block}, {len} bytes, {decoded}");
                let Some(bytes) = content.bytes() else { continue };
                match asked(&context, &bytes, &what) {
                    // Blocks of geometry are read in `asked`, so their error is that of some call.
                    Ok(_) => assert!(block >= geometry, "{what}"),
                    Err(error) => assert!(names_the_file(&error), "{what}: {error}"),
                }
            }
        }
        content.blocks[block] = (payload, decoded);
    }
}

#[test]
fn rows_of_patch_trees_that_are_wrong_under_right_checksums() {
    let context = context();
    type Change = fn(&mut TreeRow);
    // Whether a query may still answer.
    let changes: [(&str, bool, Change); 16] = [
        ("another root", false, |tree| tree.root = 1),
        ("a root far away", false, |tree| tree.root = u32::MAX),
        ("a coarse block more", false, |tree| tree.class_blocks = [2, 1, 0, 0]),
        ("no leaf blocks", false, |tree| tree.class_blocks = [1, 2, 0, 0]),
        ("no fine blocks", false, |tree| tree.class_blocks = [1, 0, 2, 0]),
        ("only coarse blocks", false, |tree| tree.class_blocks = [3, 0, 0, 0]),
        ("a class of no name", false, |tree| tree.class_blocks = [1, 1, 0, 1]),
        ("a bvh", false, |tree| tree.structure = 1),
        ("an unknown structure", false, |tree| tree.structure = 3),
        ("a stack of nothing", true, |tree| tree.max_stack = 0),
        ("a stack of everything", true, |tree| tree.max_stack = u32::MAX),
        ("no local parts", true, |tree| tree.local_parts = 0),
        ("an origin far away", true, |tree| tree.origin = [f64::MAX; 3]),
        ("bounds of nothing", true, |tree| tree.bounds = [0.0; 6]),
        ("bounds of everything", true, |tree| {
            tree.bounds = [f32::MIN, f32::MIN, f32::MIN, f32::MAX, f32::MAX, f32::MAX]
        }),
        ("an error of everything", true, |tree| tree.position_error = f64::MAX),
    ];
    for (what, may_answer, change) in changes {
        let mut content = built(2);
        let tree = tree(&mut content);
        assert_eq!(tree.class_blocks, [1, 1, 1, 0]);
        change(tree);
        let Some(bytes) = content.bytes() else { continue };
        match asked(&context, &bytes, what) {
            Ok(_) => assert!(may_answer, "{what}"),
            Err(error) => assert!(names_the_file(&error) || matches!(error, Error::BadArgument(_)), "{what}: {error}"),
        }
    }
    for i in 0..built(2).blocks.len() {
        for j in 0..i {
            let mut content = built(2);
            content.blocks.swap(i, j);
            let (what, in_geometry) = (format!("blocks {i} and {j} changed places"), j < 3);
            match asked(&context, &content.bytes().unwrap(), &what) {
                Ok(_) => assert!(!in_geometry, "{what}"),
                Err(error) => assert!(names_the_file(&error), "{what}: {error}"),
            }
        }
    }
}

/// The fault that a load of all blocks finds.
fn fault(content: &Content) -> String {
    let context = context();
    let model = Model::open_source(&context, Arc::new(MemorySource::named(NAME, content.bytes().unwrap())));
    let loaded = model.and_then(|model| model.load(&Cancel::new()).map(drop));
    loaded.err().map_or(String::new(), |error| error.to_string())
}

/// Leaf blocks are those of their fine blocks: each grid has the level, the part and the primitive id of its frame.
#[test]
fn leaf_blocks_of_other_frames_are_refused() {
    // A block is read twice before it is given up; the second time it is known as refused.
    const OTHER: &str = "its corresponding block are inconsistent";
    let mut content = built_of(SurfaceLeaves::Facets, 5);
    let [coarse, fine, leaf, _] = tree(&mut content).class_blocks.map(|count| count as usize);
    assert!(fine > 1, "{fine} fine blocks");
    assert_eq!(fault(&content), "");
    let leaves = coarse + fine..coarse + fine + leaf;
    for (i, j) in leaves.clone().flat_map(|i| (i + 1..leaves.end).map(move |j| (i, j))) {
        content.blocks.swap(i, j);
        let why = fault(&content);
        assert!(why.contains(OTHER), "leaf blocks {i} and {j} changed places: {why}");
        content.blocks.swap(i, j);
    }
    // A frame's part and primitive id, and those of a grid.
    let (frame, grid) = (words(&content, coarse)[3] as usize, words(&content, leaves.start)[2] as usize);
    for (block, at) in [(coarse, frame + 12), (coarse, frame + 13), (leaves.start, grid), (leaves.start, grid + 1)] {
        let good = words(&content, block)[at];
        put(&mut content, block, at, good ^ 1);
        let why = fault(&content);
        assert!(why.contains(OTHER), "block {block}, word {at}: {why}");
        put(&mut content, block, at, good);
    }
}
