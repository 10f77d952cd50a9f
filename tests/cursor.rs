//! Cursors: the nodes of trees by their ids, against a walk of all triangles and against the tree's own boxes.

use crate::common::built::{self, Built, Part, build_with, on_each_structure, options, sized};
use crate::common::rng::Rng;
use crate::common::scenes;
use crate::common::sources::{Calls, meddled};
use crate::common::stored;
use glam::{DAffine3, DVec3};
use outcrop::base::error::Error;
use outcrop::base::ids::BlockId;
use outcrop::base::progress::Cancel;
use outcrop::build::{BuildOptions, Splits};
use outcrop::import::{Attributes, PartDesc, Sink};
use outcrop::math::Bounds;
use outcrop::query::{Cursor, CursorOptions, Found, NodeTriangle};
use outcrop::residency::{ModelBlocks, Residency};
use outcrop::scene::{Context, ContextOptions, Model};
use outcrop::simd::Isa;
use outcrop::store::ModelFile;
use outcrop::structure::nodes::{EMPTY_BOX, NO_NODE, NO_PART, NodeBox};
use outcrop::structure::{Below, Node, Rooted, Visit, open};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};

fn context(memory_budget: u64) -> Context {
    let options = ContextOptions { threads: 1, memory_budget, read_ahead: false, ..ContextOptions::default() };
    Context::new(options).expect("a context")
}

fn opened(built: &Built, memory_budget: u64) -> Model {
    Model::open(&context(memory_budget), &built.path).expect("a model")
}

fn node(cursor: &mut Cursor, id: u64) -> Node {
    match cursor.node(id).expect("a node") {
        Found::There(node) => *node,
        Found::Missing(block) => panic!("{block:?} is missing"),
    }
}

fn triangles(cursor: &mut Cursor, id: u64) -> Vec<NodeTriangle> {
    match cursor.triangles(id, true).expect("triangles") {
        Found::There(some) => some.to_vec(),
        Found::Missing(block) => panic!("{block:?} is missing"),
    }
}

fn union(a: &NodeBox, b: &NodeBox) -> NodeBox {
    std::array::from_fn(|i| if i < 3 { a[i].min(b[i]) } else { a[i].max(b[i]) })
}

fn holds(outer: &NodeBox, inner: &NodeBox) -> bool {
    union(outer, inner) == *outer
}

fn around(corners: &[DVec3; 3]) -> NodeBox {
    let points = corners.map(|c| [c.x, c.y, c.z, c.x, c.y, c.z]);
    points.iter().fold(EMPTY_BOX, |all, point| union(&all, point))
}

/// Two parts, with triangles that the builder may split; another far from zero; and a mesh in several places.
fn models() -> Vec<Built> {
    let round = scenes::bumpy_sphere(sized(90, 40), sized(180, 80), 4);
    let several =
        [Part::white(5, round), Part::white(6, scenes::boxes(400, 2)), Part::white(9, scenes::slivers().tris)];
    let splits = BuildOptions { threads: 1, splits: Splits::On, ..options() };
    let ball = scenes::sphere(30, 60);
    let shared = built::build(|builder| {
        let mesh = builder.shared_mesh(2).expect("a mesh");
        builder.triangles(mesh, 0, &ball, Attributes::NONE).expect("triangles");
        builder.triangles(mesh, 1, &scenes::boxes(40, 7), Attributes::NONE).expect("triangles");
        for z in [0.0, 50.0, -70.0] {
            let first = builder.part(PartDesc::default()).expect("a part");
            builder.part(PartDesc::default()).expect("a part");
            builder.instance(mesh, DAffine3::from_translation(DVec3::Z * z), first).expect("an instance");
        }
    });
    vec![
        build_with(splits, |builder| several.iter().for_each(|part| built::push(builder, part))).0,
        built::parts(&[Part::white(7, scenes::far_from_zero().tris)]),
        built::parts(&[Part::white(3, scenes::sphere(4, 8))]),
        shared,
    ]
}

/// All below a node.
struct Below64 {
    bounds: NodeBox,
    parts: BTreeSet<u32>,
    triangles: usize,
}

/// What a walk has found.
#[derive(Default)]
struct Walked {
    nodes: BTreeMap<u64, Node>,
    triangles: Vec<NodeTriangle>,
    /// The common part of all boxes on the way to each of the triangles.
    regions: Vec<NodeBox>,
    /// True if the builder may have divided triangles: a box then holds the pieces that are below.
    is_split: bool,
}

fn common(a: &NodeBox, b: &NodeBox) -> NodeBox {
    std::array::from_fn(|i| if i < 3 { a[i].max(b[i]) } else { a[i].min(b[i]) })
}

const ALL: NodeBox =
    [f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY, f64::INFINITY];

/// Walks the tree below a node, and compares each node with what is below.
fn descend(cursor: &mut Cursor, id: u64, region: &NodeBox, walked: &mut Walked) -> Below64 {
    let own = node(cursor, id);
    assert!(walked.nodes.insert(id, own).is_none(), "a node has one parent");
    let count = own.children as usize;
    let mut below = Below64 { bounds: EMPTY_BOX, parts: BTreeSet::new(), triangles: 0 };
    if count == 0 {
        let some = triangles(cursor, id);
        assert_eq!(own.triangles as usize, some.len());
        for triangle in &some {
            assert_eq!(triangle.tree, own.tree);
            below.bounds = union(&below.bounds, &around(&triangle.corners));
            below.parts.insert(triangle.part);
        }
        below.triangles = some.len();
        // Stored positions are exact in double precision, so that the box of a leaf is too.
        assert_eq!(own.bounds, below.bounds);
        assert_eq!(own.part, if below.parts.len() == 1 { some[0].part } else { NO_PART });
        walked.regions.extend(some.iter().map(|_| *region));
        walked.triangles.extend(some);
    } else {
        assert_eq!(own.triangles, 0);
        let mut boxes = EMPTY_BOX;
        for i in 0..count {
            let child = descend(cursor, own.child[i], &common(region, &own.child_bounds[i]), walked);
            assert!(walked.is_split || holds(&own.child_bounds[i], &child.bounds), "{own:?}: {:?}", child.bounds);
            assert_eq!(own.leaves >> i & 1 == 1, walked.nodes[&own.child[i]].children == 0);
            boxes = union(&boxes, &own.child_bounds[i]);
            below.bounds = union(&below.bounds, &child.bounds);
            below.triangles += child.triangles;
            below.parts.extend(child.parts);
        }
        assert_eq!(own.bounds, boxes);
        // The file says of each cell whether it has one part.
        assert_eq!(
            own.part,
            if below.parts.len() == 1 { below.parts.first().copied().expect("a part") } else { NO_PART }
        );
    }
    assert!(own.child[count..].iter().all(|id| *id == NO_NODE) && own.leaves >> count == 0);
    assert!(walked.is_split || holds(&own.bounds, &below.bounds));
    below
}

/// Each point of each triangle is in all boxes on the way to one of the leaves that have the triangle.
fn assert_regions_cover(walked: &Walked) {
    let mut regions: BTreeMap<u64, Vec<(&NodeTriangle, &NodeBox)>> = BTreeMap::new();
    for (triangle, region) in walked.triangles.iter().zip(&walked.regions) {
        regions.entry(triangle.prim).or_default().push((triangle, region));
    }
    let mut rng = Rng::new(5);
    for all in regions.values() {
        let [a, b, c] = all[0].0.corners;
        // Points between corners are rounded.
        let give = [a, b, c].map(|p| p.abs().max_element()).into_iter().fold(0.0, f64::max) * 2f64.powi(-50);
        let between = |u: f64, v: f64| a + (b - a) * u + (c - a) * v;
        let inner = (0..8).map(|_| (rng.unit(), rng.unit()));
        let inner = inner.map(|(u, v)| if u + v > 1.0 { between(1.0 - u, 1.0 - v) } else { between(u, v) });
        for point in [a, b, c].into_iter().chain(inner) {
            let is_inside =
                |region: &NodeBox| (0..3).all(|i| point[i] >= region[i] - give && point[i] <= region[i + 3] + give);
            assert!(all.iter().any(|(_, region)| is_inside(region)), "{point:?} {all:?}");
        }
    }
}

/// The boxes of all nodes below others, as walks of the crate see them, with their tree's origin.
fn own_boxes(path: &Path) -> BTreeMap<u64, (DVec3, Bounds)> {
    let file = Arc::new(ModelFile::open_path(path).expect("a model"));
    let opened = open::open(&file).expect("trees");
    let blocks = ModelBlocks::new(Arc::clone(&file), opened.decoder, &Residency::with_budget(u64::MAX)).expect("room");
    let ids: Vec<BlockId> = (0..file.header().geometry_blocks).map(BlockId).collect();
    let held = blocks.fetch(&ids, &Cancel::new()).expect("blocks");
    let snapshot = blocks.snapshot_with(&held).expect("room");
    let mut all = BTreeMap::new();
    for tree in &opened.trees {
        let view = tree.view(&snapshot, Isa::Baseline, Visit::default());
        let mut stack: Vec<_> = view.root().into_iter().collect();
        while let Some(place) = stack.pop() {
            let mut child = |place: outcrop::structure::Place, bounds: &Bounds, _| {
                all.insert(place.id(), (tree.origin, *bounds));
                stack.push(place);
            };
            view.expand(place, &mut Below { child: &mut child, triangle: &mut |_, _| {} }).expect("a block");
        }
    }
    all
}

/// The box of each node holds all triangles below, and is that of the tree itself, up to the roundings of single
/// precision. All triangles are there, and blocks list the nodes that descents find, each once.
fn nodes_are_those_of_the_tree() {
    for (i, built) in models().into_iter().enumerate() {
        let is_split = i == 0;
        let model = opened(&built, 0);
        let mut cursor = model.cursor(CursorOptions::default()).expect("a cursor");
        let mut walked = Walked { is_split, ..Walked::default() };
        let stored = stored::trees(&built.path);
        for (tree, stored) in stored.iter().enumerate() {
            let Some(root) = cursor.root(tree as u32).expect("a tree") else {
                assert!(stored.tris.is_empty());
                continue;
            };
            let before = walked.triangles.len();
            let below = descend(&mut cursor, root, &ALL, &mut walked);
            let found = &walked.triangles[before..];
            assert_eq!(below.triangles, found.len());
            let expected: BTreeMap<u64, (u32, [DVec3; 3])> = stored
                .tris
                .iter()
                .map(|(prim, part, corners)| (u64::from(*prim), (*part, corners.map(|c| c + stored.origin))))
                .collect();
            let found: BTreeMap<u64, (u32, [DVec3; 3])> = found.iter().map(|t| (t.prim, (t.part, t.corners))).collect();
            assert_eq!(found, expected);
        }
        assert_regions_cover(&walked);
        let all = walked.nodes;
        assert!(cursor.root(stored.len() as u32).is_err());
        let listed: Vec<u64> = (0..model.info().geometry_blocks)
            .flat_map(|block| match cursor.block_nodes(block).expect("nodes") {
                Found::There(ids) => ids,
                Found::Missing(block) => panic!("{block:?} is missing"),
            })
            .collect();
        assert_eq!(listed.len(), all.len());
        assert!(listed.iter().all(|id| all.contains_key(id)));

        let mut compared = 0;
        let own = own_boxes(&built.path);
        for parent in all.values() {
            for i in 0..parent.children as usize {
                let Some((origin, bounds)) = own.get(&parent.child[i]) else { continue };
                let ([low, high], mine) = ([bounds.min, bounds.max], parent.child_bounds[i]);
                let size = bounds.min.abs().max(bounds.max.abs()).max_element();
                let give = f64::from(size) * 2f64.powi(-21) + origin.abs().max_element() * 2f64.powi(-51);
                for axis in 0..3 {
                    let [low, high] = [low, high].map(|v| f64::from(v[axis]) + origin[axis]);
                    let off = [mine[axis] - low, high - mine[axis + 3]];
                    assert!(off.iter().all(|off| off.abs() <= give), "{off:?} {give}");
                }
                compared += 1;
            }
        }
        assert_eq!(compared, own.len());
    }
}

/// The places of trees are those of instances, and name their parts.
fn trees_are_in_their_places() {
    let built = models().pop().expect("the shared mesh");
    let model = opened(&built, 0);
    let cursor = model.cursor(CursorOptions::default()).expect("a cursor");
    let mut places: Vec<_> = cursor.places().collect();
    places.sort_by_key(|place| (place.tree, place.first_part));
    let firsts: Vec<(u32, f64)> = places.iter().map(|p| (p.first_part, p.model_from_tree.translation.z)).collect();
    let trees = places.iter().map(|p| p.tree).collect::<BTreeSet<_>>().len();
    let expected: Vec<(u32, f64)> = (0..trees).flat_map(|_| [(0, 0.0), (2, 50.0), (4, -70.0)]).collect();
    assert_eq!(firsts, expected);
    for place in places {
        assert_eq!(cursor.root(place.tree).expect("a tree"), Some(place.root));
    }
}

/// A model of many blocks, and its nodes as a cursor with all memory finds them.
fn large() -> (Built, BTreeMap<u64, Node>) {
    let tris = scenes::bumpy_sphere(150, 300, 6);
    let (low, high) = tris.split_at(tris.len() / 3);
    let built = built::parts(&[Part::white(5, low.to_vec()), Part::white(6, high.to_vec())]);
    let model = opened(&built, 0);
    let mut cursor = model.cursor(CursorOptions::default()).expect("a cursor");
    let root = cursor.root(0).expect("a tree").expect("a root");
    let mut walked = Walked { is_split: true, ..Walked::default() };
    descend(&mut cursor, root, &ALL, &mut walked);
    (built, walked.nodes)
}

/// Least number of bytes that a cursor accepts.
fn least(model: &Model) -> u64 {
    match model.cursor(CursorOptions { bytes: 1, ..CursorOptions::default() }).err() {
        Some(Error::BadArgument(why)) => {
            why.rsplit(' ').next().and_then(|word| word.parse().ok()).expect("a number of bytes")
        }
        other => panic!("{other:?}"),
    }
}

/// Any order, any number of threads, in memory and in a budget that does not hold the model: the same nodes.
fn nodes_in_any_order_are_the_same() {
    let (built, all) = large();
    let ids: Vec<u64> = all.keys().copied().collect();
    for (threads, budget) in [(1, 0), (2, 0), (8, 0), (1, 5 << 20), (4, 6 << 20)] {
        let model = opened(&built, budget);
        let least = least(&model);
        std::thread::scope(|scope| {
            for thread in 0..threads {
                let (model, ids, all) = (&model, &ids, &all);
                scope.spawn(move || {
                    let options = CursorOptions { bytes: least, ..CursorOptions::default() };
                    let mut cursor = model.cursor(options).expect("a cursor");
                    let mut rng = Rng::new(40 + thread);
                    // Where each node may be read anew there are fewer.
                    for _ in 0..if budget == 0 { 20_000 } else { 400 } {
                        let id = ids[rng.below(ids.len())];
                        assert_eq!(node(&mut cursor, id), all[&id]);
                    }
                });
            }
        });
        if budget > 0 {
            let memory = model.memory();
            assert!(memory.resident < memory.geometry, "{memory:?}");
        }
    }
}

/// Numbers that are ids of no node are refused, whatever they are.
fn foreign_ids_are_refused() {
    let (built, all) = large();
    let model = opened(&built, 0);
    let mut cursor = model.cursor(CursorOptions::default()).expect("a cursor");
    let blocks = u64::from(model.info().geometry_blocks);
    let mut rng = Rng::new(3);
    let mut tried: Vec<u64> = vec![u64::MAX, u64::MAX - 1, f64::NAN.to_bits(), f64::INFINITY.to_bits(), 1 << 63];
    for block in [blocks, blocks + 1, 2 * blocks - 1, 2 * blocks, u64::from(u32::MAX)] {
        tried.extend([0, 1, 6, 7, 8, 1 << 14, 0xffff].map(|item| block << 32 | item));
    }
    for _ in 0..4000 {
        let id = *all.keys().nth(rng.below(all.len())).expect("a node");
        // Other items of the same block: neighbours, all kinds of references, and bits that no item has.
        let bit = 1 << rng.below(32);
        tried.extend([id ^ bit, id + 1, id.wrapping_sub(1), id & !0xffff_ffff | rng.below(1 << 16) as u64]);
        tried.push((rng.below(2 * blocks as usize) as u64) << 32 | id & 0xffff_ffff);
    }
    let mut refused = 0;
    for id in tried {
        match (cursor.node(id), all.get(&id)) {
            (Ok(Found::There(node)), Some(expected)) => assert_eq!(node, expected),
            (Err(Error::BadArgument(why)), None) => {
                refused += 1;
                assert!(why.contains(&format!("{id:#x}")), "{why}");
                assert!(matches!(cursor.triangles(id, true), Err(Error::BadArgument(_))));
            }
            (found, expected) => panic!("{id:#x}: {found:?}, expected {expected:?}"),
        }
    }
    assert!(refused > 5000);
    let root = cursor.root(0).expect("a tree").expect("a root");
    assert!(matches!(cursor.triangles(root, false), Err(Error::BadArgument(why)) if why.contains("leaf")));
    for block in [blocks as u32, u32::MAX] {
        assert!(matches!(cursor.block_nodes(block), Err(Error::BadArgument(why)) if why.contains("does not exist")));
    }
    // The cursor is as good as before.
    assert_eq!(node(&mut cursor, root), all[&root]);
}

/// A cursor takes what it may hold from the budget, keeps within it, and gives it back.
fn a_cursor_keeps_to_its_grant() {
    let (built, all) = large();
    let budget = 6 << 20;
    let model = opened(&built, budget);
    let used = || model.context().memory_used();
    let least = least(&model);
    let before = used();
    let mut cursor = model.cursor(CursorOptions { bytes: least, ..CursorOptions::default() }).expect("a cursor");
    assert!(used() <= budget);
    let root = cursor.root(0).expect("a tree").expect("a root");
    let mut again = Walked { is_split: true, ..Walked::default() };
    descend(&mut cursor, root, &ALL, &mut again);
    assert_eq!(again.nodes, all);
    assert!(used() <= budget);
    let with = used();
    drop(cursor);
    assert!(with - used() >= least && used() <= before);
    match model.cursor(CursorOptions { bytes: budget, ..CursorOptions::default() }).err() {
        Some(Error::OverBudget { need, have, .. }) => assert!(need > have && have == budget),
        other => panic!("{other:?}"),
    }
    assert!(model.cursor(CursorOptions { now: true, bytes: 1 }).is_ok());
}

/// A cursor that may not read says which block is missing, and reads nothing.
fn now_reads_nothing() {
    let (built, all) = large();
    let calls = Arc::new(Calls::default());
    let counted = Arc::clone(&calls);
    let source = meddled(&built.path, move |_, _| {
        counted.next();
        Ok(())
    });
    let model = Model::open_source(&context(5 << 20), source).expect("a model");
    let mut now = model.cursor(CursorOptions { now: true, bytes: 0 }).expect("a cursor");
    let mut reads = model.cursor(CursorOptions { now: false, bytes: least(&model) }).expect("a cursor");
    calls.arm();
    let mut missing = BTreeSet::new();
    let mut there = 0;
    for (id, expected) in &all {
        match now.node(*id).expect("an answer") {
            Found::There(node) => {
                assert_eq!(node, expected);
                there += 1;
            }
            Found::Missing(block) => {
                assert_eq!(u64::from(block.0), id >> 32);
                missing.insert(block);
            }
        }
    }
    let first = *missing.first().expect("the budget does not hold the model");
    assert!(there > 0 && calls.count() == 0);
    assert!(matches!(now.block_nodes(first.0), Ok(Found::Missing(block)) if block == first));
    let id = *all.keys().find(|id| **id >> 32 == u64::from(first.0)).expect("a node");
    assert!(matches!(now.triangles(id, true), Ok(Found::Missing(block)) if block == first));
    assert_eq!(calls.count(), 0);
    // A number of no node is refused only where the block is there: the other cannot be known.
    assert!(now.node(u64::MAX).is_err());
    assert_eq!(node(&mut reads, id), all[&id]);
    assert!(calls.count() > 0);
    assert!(matches!(now.node(id), Ok(Found::Missing(block)) if block == first), "cursors share nothing");
}

/// A block that cannot be read is an error, and the next call tries it again.
fn a_failing_disk_is_an_error() {
    let (built, all) = large();
    let fails = Arc::new(AtomicBool::new(false));
    let also = Arc::clone(&fails);
    let source = meddled(
        &built.path,
        move |_, _| {
            if also.load(SeqCst) { Err(std::io::Error::other("unplugged")) } else { Ok(()) }
        },
    );
    let model = Model::open_source(&context(5 << 20), source).expect("a model");
    let bytes = least(&model);
    let mut cursor = model.cursor(CursorOptions { now: false, bytes }).expect("a cursor");
    let mut now = model.cursor(CursorOptions { now: true, bytes: 0 }).expect("a cursor");
    let id = all.keys().copied().find(|id| matches!(now.node(*id), Ok(Found::Missing(_)))).expect("a missing node");
    fails.store(true, SeqCst);
    for _ in 0..2 {
        assert!(matches!(cursor.node(id), Err(Error::Io { .. })));
    }
    fails.store(false, SeqCst);
    assert_eq!(node(&mut cursor, id), all[&id]);
}
on_each_structure!(
    nodes_are_those_of_the_tree,
    trees_are_in_their_places,
    nodes_in_any_order_are_the_same,
    foreign_ids_are_refused,
    a_cursor_keeps_to_its_grant,
    now_reads_nothing,
    a_failing_disk_is_an_error,
);
