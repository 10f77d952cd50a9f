//! Models that do not fit the memory budget are built in chunks: the same triangles, the same hits, the same bytes
//! at any number of threads, and nothing left behind.

use crate::common::brute::Tri;
use crate::common::built;
use crate::common::rays::RayMaker;
use crate::common::rng::Rng;
use crate::common::{scenes, stored};
use glam::{DAffine3, DVec3};
use outcrop::Error;
use outcrop::base::ids::BlockId;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, BuildReport, Builder, Splits};
use outcrop::import::collect::Collector;
use outcrop::import::generate::{GenerateOptions, generate_file};
use outcrop::import::{Attributes, MaterialDesc, MeshKey, PartDesc, ReadOptions, Sink, read_file};
use outcrop::query::{Hit, QueryOptions};
use outcrop::residency::{ModelBlocks, Residency};
use outcrop::scene::{Model, Scene};
use outcrop::store::{ModelFile, PartRow};
use outcrop::structure::bvh::{BvhDecoder, check_links};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// The least that there is: chunks of 40,960 triangles.
const TIGHT: u64 = 32 << 20;

struct Made {
    path: PathBuf,
    report: BuildReport,
    _folder: tempfile::TempDir,
}

fn options(memory_budget: u64, threads: usize) -> BuildOptions {
    BuildOptions { memory_budget, threads, ..BuildOptions::default() }
}

fn make(options: BuildOptions, fill: impl FnOnce(&mut Builder)) -> Made {
    let folder = tempfile::tempdir().unwrap();
    let temporaries = folder.path().join("temporaries");
    std::fs::create_dir(&temporaries).unwrap();
    let options = BuildOptions { temp_dir: Some(temporaries.clone()), ..options };
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).unwrap();
    fill(&mut builder);
    let path = folder.path().join("model.oc");
    let report = builder.finish(&path).unwrap();
    assert_eq!(std::fs::read_dir(&temporaries).unwrap().count(), 0);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    Made { path, report, _folder: folder }
}

fn push(tris: &[Tri]) -> impl FnOnce(&mut Builder) + '_ {
    move |builder| {
        let part = builder.part(PartDesc::default()).unwrap();
        tris.chunks(4096).for_each(|t| builder.triangles(MeshKey::DIRECT, part, t, Attributes::NONE).unwrap());
    }
}

/// Small triangles at the points that a function gives.
fn at_points(count: usize, size: f64, mut point: impl FnMut(usize) -> DVec3) -> Vec<Tri> {
    let mut rng = Rng::new(11);
    let mut near = |p: DVec3| p + rng.inside(DVec3::splat(-size), DVec3::splat(size));
    (0..count).map(|i| [(); 3].map(|()| near(point(i)))).collect()
}

fn hits(path: &Path, tris: &[Tri], rays: usize) -> Vec<Hit> {
    let context = built::context(2);
    let model = Model::open(&context, path).unwrap();
    let scene = Scene::new(&context);
    scene.add_instance(&model, 1, DAffine3::IDENTITY).unwrap();
    scene.commit().unwrap();
    let state = scene.state();
    let tree = &stored::trees(path)[0];
    let rays: Vec<_> = RayMaker::new(tris, 3).batch(rays).iter().map(|r| tree.place(r).0).collect();
    let mut hits = vec![Hit::default(); rays.len()];
    state.closest(&rays, QueryOptions::default(), &mut hits).unwrap();
    hits
}

/// What both files must agree about to the bit.
fn known(hit: &Hit) -> (u64, u64, u64, [u32; 3]) {
    (hit.t.to_bits(), hit.prim, hit.part, hit.normal.to_array().map(f32::to_bits))
}

/// Calls `f` with all blocks in memory.
fn with_blocks<T>(file: &Arc<ModelFile>, f: impl FnOnce(&ModelBlocks) -> T) -> T {
    let decoder = Box::new(BvhDecoder::new(file.header(), file.trees()));
    let residency = Residency::with_budget(u64::MAX);
    let blocks = ModelBlocks::new(Arc::clone(file), decoder, &residency).unwrap();
    let all: Vec<BlockId> = (0..file.block_count()).map(BlockId).collect();
    let _held = blocks.fetch(&all, &Cancel::new()).unwrap();
    f(&blocks)
}

/// Opens, checks, and says which triangles are there.
fn check(made: &Made) -> Vec<stored::StoredTree> {
    let file = Arc::new(ModelFile::open_path(&made.path).unwrap());
    file.check(&Progress::default(), &Cancel::new()).unwrap();
    with_blocks(&file, |blocks| check_links(&blocks.snapshot(), file.trees()).unwrap());
    stored::trees(&made.path)
}

/// Built whole and in chunks: the same triangles and hits.
fn alike(what: &str, tris: &[Tri], splits: Splits) -> (Made, Made) {
    alike_by(5000, what, tris, splits)
}

fn alike_by(rays: usize, what: &str, tris: &[Tri], splits: Splits) -> (Made, Made) {
    let of = |budget| make(BuildOptions { splits, ..options(budget, 2) }, push(tris));
    let (whole, chunked) = (of(0), of(TIGHT));
    assert_eq!(whole.report.chunks, whole.report.trees, "{what}");
    assert!(chunked.report.chunks > 2, "{what}: {} chunks", chunked.report.chunks);
    let [a, b] = [&whole.report, &chunked.report];
    assert_eq!(
        (a.triangles_kept, a.degenerate, a.out_of_range, a.position_error, a.spatial_splits),
        (b.triangles_kept, b.degenerate, b.out_of_range, b.position_error, b.spatial_splits),
        "{what}"
    );
    let [a, b] = [check(&whole), check(&chunked)];
    assert_eq!(a.len(), b.len(), "{what}");
    let are_alike = a.iter().zip(&b).all(|(a, b)| a.tris == b.tris && a.origin == b.origin);
    assert!(are_alike, "{what}: other triangles");
    let corners = a[0].corners();
    let [a, b] = [&whole, &chunked].map(|made| hits(&made.path, &corners, rays));
    for (a, b) in a.iter().zip(&b) {
        assert_eq!(known(a), known(b), "{what}");
    }
    (whole, chunked)
}

#[test]
fn the_same_bytes_at_any_number_of_threads() {
    let tris = scenes::bumpy_sphere(300, 400, 1);
    for splits in [Splits::Off, Splits::On] {
        let bytes = [1, 2, 3].map(|threads| {
            let made = make(BuildOptions { splits, ..options(TIGHT, threads) }, push(&tris));
            assert!(made.report.chunks > 3, "{:?}", made.report);
            std::fs::read(&made.path).unwrap()
        });
        assert!(bytes[0] == bytes[1] && bytes[0] == bytes[2]);
    }
}

#[test]
fn a_surface_is_the_same_in_chunks() {
    let tris = scenes::bumpy_sphere(400, 500, 1);
    let (whole, chunked) = alike("a sphere", &tris, Splits::Off);
    // Far from 48 a triangle.
    let temporary = chunked.report.bytes_temporary as f64 / tris.len() as f64;
    println!("{temporary:.1} bytes of temporaries a triangle, {} chunks", chunked.report.chunks);
    assert!(temporary < 36.0 && whole.report.bytes_temporary == 0, "{temporary}");
}

#[test]
fn far_from_zero_and_in_double_precision() {
    let tris: Vec<Tri> = scenes::bumpy_sphere(300, 400, 2).iter().map(|t| t.map(|p| p * 3.3 + 1e7)).collect();
    let (_, chunked) = alike("far from zero", &tris, Splits::Off);
    assert!(chunked.report.position_error > 0.0);
}

#[test]
fn splits_in_chunks() {
    let mut rng = Rng::new(4);
    let tris: Vec<Tri> = (0..150_000)
        .map(|_| {
            let (p, along) = (rng.inside(-DVec3::ONE, DVec3::ONE), rng.direction() * 0.2);
            [p, p + along, p + along + rng.direction() * 1e-3]
        })
        .collect();
    let (_, chunked) = alike("needles", &tris, Splits::Auto);
    assert!(chunked.report.spatial_splits && chunked.report.references > chunked.report.triangles_kept);
}

#[test]
fn odd_distributions() {
    let one = [DVec3::ZERO, DVec3::X, DVec3::new(0.3, 1.0, 0.2)];
    // Each ray that hits one hits all.
    alike_by(50, "all the same", &vec![one; 150_000], Splits::Off);
    let mut huge = at_points(150_000, 1e-4, |i| DVec3::new(1.0, 1.0, i as f64 * 1e-9));
    huge.push([DVec3::splat(-1e9), DVec3::new(1e9, 0.0, 0.0), DVec3::new(0.0, 1e9, 1.0)]);
    alike("one huge among tiny ones", &huge, Splits::Off);
    for spacing in [1.0, 1e-4] {
        alike("a line", &at_points(150_000, 1e-3, |i| DVec3::X * (i as f64 * spacing)), Splits::Off);
    }
    let mut far = at_points(150_000, 1e-12, |i| DVec3::X * 0.5f64.powi((i / 1000) as i32 % 40));
    alike("ever nearer to a point", &far, Splits::Off);
    far.extend([[DVec3::splat(1e30), DVec3::splat(2e30), DVec3::new(0.0, 1e30, 0.0)]; 3]);
    far.extend([[DVec3::NAN; 3]; 2]);
    far.extend([[DVec3::ONE; 3]; 4]);
    let made = make(options(TIGHT, 2), push(&far));
    check(&made);
    let r = made.report;
    assert_eq!((r.non_finite, r.triangles_kept + r.degenerate + r.out_of_range), (2, far.len() as u64 - 2));
}

/// Colour of each primitive that has one.
fn colours(path: &Path) -> BTreeMap<u32, u32> {
    let file = Arc::new(ModelFile::open_path(path).unwrap());
    let geometry = file.header().geometry_blocks;
    with_blocks(&file, |blocks| {
        let snapshot = blocks.snapshot();
        let words = |id: u32| snapshot.block(BlockId(id)).unwrap_or(&[]).to_vec();
        let pairs = |b: u32| words(geometry + b).into_iter().zip(words(2 * geometry + b).into_iter().skip(1));
        (0..geometry).flat_map(pairs).collect()
    })
}

#[test]
fn parts_colours_and_shared_meshes() {
    let (ball, boxes) = (scenes::bumpy_sphere(250, 300, 3), scenes::boxes(9000, 5));
    let fill = |builder: &mut Builder| {
        for i in 0..40 {
            let red = MaterialDesc { colour: [i as f32 / 40.0, 0.2, 0.1], ..MaterialDesc::default() };
            let material = Some(builder.material(red).unwrap());
            builder.part(PartDesc { id: Some(i * 7), material, ..PartDesc::default() }).unwrap();
        }
        let mesh = builder.shared_mesh(3).unwrap();
        let mut colour = 0.0f32;
        for (i, (ball, boxes)) in ball.chunks(1500).zip(boxes.chunks(1000)).enumerate() {
            colour = (colour + 0.013) % 1.0;
            let colours = vec![[[colour, 1.0 - colour, 0.5]; 3]; ball.len()];
            let attributes = if i % 4 > 0 { Attributes::colours(&colours) } else { Attributes::NONE };
            builder.triangles(mesh, i as u32 % 3, ball, attributes).unwrap();
            builder.triangles(MeshKey::DIRECT, i as u32 % 30, boxes, Attributes::NONE).unwrap();
        }
        for i in 0..2 {
            builder.instance(mesh, DAffine3::from_translation(DVec3::X * 30.0 * f64::from(i)), 30 + 3 * i).unwrap();
        }
    };
    let [whole, chunked] = [0, TIGHT].map(|budget| make(options(budget, 2), fill));
    assert!(chunked.report.chunks > whole.report.chunks, "{:?}", chunked.report);
    let [a, b] = [&whole, &chunked].map(|made| check(made).into_iter().map(|t| t.tris).collect::<Vec<_>>());
    assert!(a == b);
    let rows = |made: &Made| -> Vec<PartRow> { ModelFile::open_path(&made.path).unwrap().parts().to_rows() };
    assert_eq!(rows(&whole), rows(&chunked));
    let [a, b] = [&whole, &chunked].map(|made| colours(&made.path));
    assert!(a == b && a.len() as u64 == whole.report.triangles_kept);
}

#[test]
fn too_small_a_budget_names_the_least() {
    for memory_budget in [1, TIGHT - 1] {
        match Builder::new(options(memory_budget, 1), Arc::new(Progress::default()), Cancel::new()).map(|_| ()) {
            Err(Error::OverBudget { need, have, .. }) => assert_eq!((need, have), (TIGHT, memory_budget)),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn temporaries_that_cannot_be_written() {
    let folder = tempfile::tempdir().unwrap();
    let nowhere = folder.path().join("nowhere");
    let options = BuildOptions { temp_dir: Some(nowhere.clone()), ..options(TIGHT, 1) };
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).unwrap();
    let part = builder.part(PartDesc::default()).unwrap();
    let tris = scenes::bumpy_sphere(300, 300, 1);
    match builder.triangles(MeshKey::DIRECT, part, &tris, Attributes::NONE) {
        Err(Error::Io { path, .. }) => assert_eq!(path, nowhere),
        other => panic!("{other:?}"),
    }
}

#[test]
fn cancelled_at_any_moment() {
    let tris = scenes::bumpy_sphere(300, 400, 1);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.oc");
    let build = |after: Option<std::time::Duration>| {
        let options = BuildOptions { temp_dir: Some(folder.path().into()), ..options(TIGHT, 2) };
        let cancel = Cancel::new();
        let mut builder = Builder::new(options, Arc::new(Progress::default()), cancel.clone()).unwrap();
        push(&tris)(&mut builder);
        std::thread::scope(|scope| {
            let began = Instant::now();
            let path = &path;
            let build = scope.spawn(move || builder.finish(path).map(|_| began.elapsed()));
            if let Some(after) = after {
                std::thread::sleep(after);
                cancel.cancel();
            }
            build.join().unwrap()
        })
    };
    let whole = build(None).unwrap();
    let mut cancelled = 0;
    for step in 0..24 {
        std::fs::write(&path, "old").unwrap();
        match build(Some(whole * step / 24)) {
            Err(Error::Cancelled) => {
                cancelled += 1;
                assert_eq!(std::fs::read(&path).unwrap(), b"old");
            }
            Ok(_) => drop(ModelFile::open_path(&path).unwrap()),
            Err(e) => panic!("{e}"),
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
    assert!(cancelled > 3, "{cancelled}");
}

#[test]
fn vertices_that_do_not_fit_are_read_from_a_temporary() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bulb.ply");
    let bulb = GenerateOptions { triangles: 60_000, seed: 0, ..Default::default() };
    generate_file("mandelbulb", &bulb, &Cancel::new(), &path, &mut |_| ()).unwrap();
    let read = |memory| {
        let options = ReadOptions { temp_dir: Some(folder.path().into()), memory, ..Default::default() };
        let mut all = Collector::new();
        read_file(&path, &options, &mut all).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        all
    };
    let (kept, spilled) = (read(0), read(100_000));
    assert!(kept.received > 50_000 && kept.direct() == spilled.direct());
    let nowhere = ReadOptions { temp_dir: Some(folder.path().join("nowhere")), memory: 100_000, ..Default::default() };
    assert!(matches!(read_file(&path, &nowhere, &mut Collector::new()), Err(Error::Io { .. })));
}
