//! Tests from triangles through a file to hits, against brute force with the scalar twin of the ray test.

use super::*;
use crate::base::ids::BlockId;
use crate::base::progress::{Cancel, Progress};
use crate::geom::watertight::{Shear, intersect_one};
use crate::import::{Attributes, MeshKey, PartDesc, Sink};
use crate::math::{PACKET, STREAM, first_rays};
use crate::residency::{ModelBlocks, Residency};
use crate::simd::Isa;
use crate::store::ModelFile;
use crate::structure::open::{self, StoredTree};
use crate::structure::{LocalRay, Outcome, PacketWalk, Stream, Tree, TriHit, Visit, Walk};
use glam::{DVec3, Vec3};
use std::sync::Arc;

mod by_tree;

/// A small generator of repeatable numbers (PCG, XSH-RR).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let x = (((self.0 >> 18) ^ self.0) >> 27) as u32;
        x.rotate_right((self.0 >> 59) as u32) as f32 / u32::MAX as f32
    }
    fn point(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }
}

fn soup(count: usize, size: f32, grid: f32) -> Vec<[Vec3; 3]> {
    let mut random = Random(7);
    let snap = |p: Vec3| if grid > 0.0 { (p * grid).round() / grid } else { p };
    (0..count)
        .map(|_| {
            let p = random.point();
            [p, p + random.point() * size, p + random.point() * size].map(snap)
        })
        .collect()
}

struct Opened {
    blocks: ModelBlocks,
    tree: StoredTree,
    _folder: tempfile::TempDir,
}

fn build(triangles: &[[Vec3; 3]], options: BuildOptions) -> (Opened, BuildReport, Vec<u8>) {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("model.oc");
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).expect("options");
    let parts: Vec<u32> =
        (0..5).map(|i| builder.part(PartDesc { id: Some(100 + i), ..PartDesc::default() }).expect("part")).collect();
    for (i, t) in triangles.iter().enumerate() {
        let part = parts[i / 7 % parts.len()];
        builder.triangles(MeshKey::DIRECT, part, &[t.map(|p| p.as_dvec3())], Attributes::NONE).expect("triangle");
    }
    let report = builder.finish(&path).expect("build");
    let bytes = std::fs::read(&path).expect("file");
    let file = Arc::new(ModelFile::open_path(&path).expect("open"));
    let opened = open::open(&file).expect("trees");
    let blocks = ModelBlocks::new(file, opened.decoder, &Residency::with_budget(1 << 30)).expect("a budget");
    (Opened { blocks, tree: opened.trees[0], _folder: folder }, report, bytes)
}

fn view<'a>(opened: &Opened, snapshot: &'a crate::residency::Snapshot, isa: Isa) -> Tree<'a> {
    opened.tree.view(snapshot, isa, Visit { stamp: 1, ..Visit::default() })
}

fn rays(count: usize) -> Vec<LocalRay> {
    let mut random = Random(99);
    (0..count)
        .map(|i| {
            let org = random.point() * 2.0;
            let mut dir = random.point() - org * 0.5;
            if i % 4 == 0 {
                // Along an axis.
                dir = [Vec3::X, Vec3::NEG_Y, Vec3::Z][i / 4 % 3];
            }
            LocalRay { org, dir, t_min: 0.0, t_max: f32::INFINITY, cone: crate::math::Cone::ZERO }
        })
        .collect()
}

/// Returns the least `(t, id)`; on the grid, ties are common.
fn brute_force(triangles: &[[Vec3; 3]], ray: &LocalRay) -> Option<(f32, u32)> {
    let shear = Shear::new(ray.dir);
    let hits = triangles.iter().enumerate().filter_map(|(i, t)| {
        let hit = intersect_one(ray.org, &shear, ray.t_min, ray.t_max, *t)?;
        Some((hit.t, i as u32))
    });
    hits.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
}

fn agrees_with_brute_force(triangles: &[[Vec3; 3]], options: BuildOptions) -> BuildReport {
    let (opened, report, _) = build(triangles, options);
    let kept: Vec<BlockId> = (0..opened.blocks.file().block_count()).map(BlockId).collect();
    opened.blocks.fetch(&kept, &Cancel::new()).expect("fetch");
    let snapshot = opened.blocks.snapshot();
    open::check_links(opened.blocks.file(), &snapshot).expect("links");
    for isa in Isa::ALL.into_iter().filter(|i| i.is_available()) {
        let view = view(&opened, &snapshot, isa);
        let mut walk = Walk::new();
        let mut hits = 0;
        for ray in rays(500) {
            walk.begin(&view, &ray);
            assert_eq!(view.closest(None, &mut walk), Outcome::Done);
            let best = walk.best();
            let found = best.is_hit().then(|| (best.t, view.prim(&best).expect("resident").expect("an id")));
            assert_eq!(found, brute_force(triangles, &ray), "{ray:?} {}", isa.name());
            hits += usize::from(best.is_hit());
            walk.begin(&view, &ray);
            assert_eq!(view.any(None, &mut walk), Outcome::Done);
            assert_eq!(walk.best().is_hit(), best.is_hit());
        }
        packets_agree(&view);
        streams_agree(&view);
        assert!(hits > 50 || triangles.len() < 50, "{hits} hits test little");
    }
    report
}

/// Packets of coherent rays, of diverging rays, and of few rays: each ray gets the same bits as a single ray.
fn packets_agree(view: &Tree) {
    let mut random = Random(5);
    let mut walk = PacketWalk::of_queries();
    let all = rays(PACKET * 20);
    for n in 0..60 {
        let eye = random.point() * 1.5;
        let to = random.point() * 0.3 - eye;
        let spread = [0.001, 0.05, 0.5][n % 3];
        let rays: [LocalRay; PACKET] = std::array::from_fn(|i| match n / 20 {
            0 => LocalRay { org: eye, dir: to + random.point() * spread, ..all[i] },
            1 => LocalRay { org: eye + random.point() * spread, dir: to, ..all[i] },
            _ => all[(n - 40) * PACKET + i],
        });
        let active = [first_rays(PACKET), 0x0310_0f31, 0x8000, 0][n % 4];
        let mut alone = Walk::new();
        let expected = rays.map(|ray| {
            alone.begin(view, &ray);
            assert_eq!(view.closest(None, &mut alone), Outcome::Done);
            alone.best()
        });
        walk.begin(view, &rays, active);
        assert_eq!(view.closest_together(None, &mut walk), Outcome::Done);
        for i in (0..PACKET).filter(|i| active >> i & 1 == 1) {
            assert_eq!(seen(view, &walk.best(i)), seen(view, &expected[i]), "packet {n}, ray {i}");
        }
        walk.begin(view, &rays, active);
        assert_eq!(view.any_together(None, &mut walk), Outcome::Done);
        for i in (0..PACKET).filter(|i| active >> i & 1 == 1) {
            assert_eq!(walk.best(i).is_hit(), expected[i].is_hit(), "packet {n}, ray {i}");
        }
    }
}

/// Returns the bits and the primitive id of a hit. The rest of a hit, such as the reference that was hit among several
/// to one triangle, depends on the order of traversal.
fn seen(view: &Tree, hit: &TriHit) -> ([u32; 3], Option<u32>) {
    (
        [hit.t, hit.u, hit.v].map(f32::to_bits),
        hit.is_hit().then(|| view.prim(hit).expect("all blocks are here").expect("an id")),
    )
}

/// Streams of all lengths: each ray gets the same bits as a single ray.
fn streams_agree(view: &Tree) {
    let (mut stream, mut alone) = (Stream::of_queries(), Walk::new());
    let all = rays(STREAM);
    for count in [0, 1, 15, 16, 17, 63, 64, 200, STREAM] {
        all[..count].iter().enumerate().for_each(|(i, ray)| stream.set(i, ray));
        let mut hits = vec![TriHit::none(0.0); count];
        view.closest_each(None, &mut stream, &mut hits);
        assert_eq!(stream.unfinished(), &[] as &[u32]);
        let mut any = hits.clone();
        view.any_each(None, &mut stream, &mut any);
        for i in 0..count {
            alone.begin(view, &all[i]);
            assert_eq!(view.closest(None, &mut alone), Outcome::Done);
            assert_eq!(seen(view, &hits[i]), seen(view, &alone.best()), "{count} rays, ray {i}");
            assert_eq!(any[i].is_hit(), hits[i].is_hit(), "{count} rays, ray {i}");
        }
    }
}

#[test]
fn hits_equal_those_of_brute_force() {
    for (count, size, grid) in [(1, 1.0, 0.0), (9, 1.0, 0.0), (3000, 0.1, 0.0), (3000, 0.5, 4.0), (20_000, 0.02, 0.0)] {
        let triangles = soup(count, size, grid);
        for structure in Structure::ALL {
            let report = agrees_with_brute_force(&triangles, BuildOptions { structure, ..BuildOptions::default() });
            assert_eq!(report.triangles_kept + report.degenerate, count as u64);
        }
    }
}

#[test]
fn splits_change_no_hit() {
    // Long thin triangles in all directions, for which splits are made.
    let mut random = Random(3);
    let triangles: Vec<[Vec3; 3]> = (0..3000)
        .map(|_| {
            let (p, along) = (random.point(), random.point());
            [p, p + along, p + along + random.point() * 0.01]
        })
        .collect();
    let options = BuildOptions { splits: Splits::On, ..BuildOptions::default() };
    let report = agrees_with_brute_force(&triangles, options);
    assert!(report.references > report.triangles_kept, "{report:?}");
}

#[test]
fn the_file_does_not_depend_on_threads() {
    let triangles = soup(30_000, 0.05, 0.0);
    for structure in Structure::ALL {
        let file = |threads, splits| {
            build(&triangles, BuildOptions { threads, splits, structure, ..BuildOptions::default() }).2
        };
        assert!(file(1, Splits::Off) == file(2, Splits::Off));
        assert!(file(1, Splits::On) == file(3, Splits::On));
    }
}

#[test]
fn a_missing_block_is_an_outcome_and_the_walk_goes_on_where_it_stopped() {
    Structure::ALL.into_iter().for_each(goes_on_where_it_stopped);
}

fn goes_on_where_it_stopped(structure: Structure) {
    let triangles = soup(20_000, 0.1, 0.0);
    let (opened, _, _) = build(&triangles, BuildOptions { structure, ..BuildOptions::default() });
    let mut stops = 0;
    let mut walk = Walk::new();
    for ray in rays(100) {
        // Each stop fetches one block, into a snapshot that was empty at first.
        let file = opened.blocks.file().clone();
        let decoder = open::open(&file).expect("trees").decoder;
        let fresh = ModelBlocks::new(file, decoder, &Residency::with_budget(1 << 30)).expect("a budget");
        let mut snapshot = fresh.snapshot();
        walk.begin(&view(&opened, &snapshot, Isa::best()), &ray);
        while let Outcome::Pending(block) = view(&opened, &snapshot, Isa::best()).closest(None, &mut walk) {
            stops += 1;
            assert!(snapshot.block(block).is_none());
            fresh.fetch(&[block], &Cancel::new()).expect("fetch");
            snapshot = fresh.snapshot();
        }
        let t = walk.best().is_hit().then(|| walk.best().t);
        assert_eq!(t, brute_force(&triangles, &ray).map(|h| h.0));
    }
    assert!(stops > 100, "{stops}");
}

#[test]
fn triangles_that_cannot_be_traced_are_dropped_and_counted() {
    let good = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let mut builder =
        Builder::new(BuildOptions::default(), Arc::new(Progress::default()), Cancel::new()).expect("options");
    let part = builder.part(PartDesc::default()).expect("part");
    let bad = [
        good,
        [DVec3::NAN, DVec3::X, DVec3::Y],
        [DVec3::INFINITY, DVec3::X, DVec3::Y],
        [DVec3::X, DVec3::X, DVec3::Y],
        [DVec3::ZERO, DVec3::X, DVec3::X * 2.0],
        good,
    ];
    builder.triangles(MeshKey::DIRECT, part, &bad, Attributes::NONE).expect("accepted");
    let folder = tempfile::tempdir().expect("folder");
    let report = builder.finish(&folder.path().join("m.oc")).expect("build");
    assert_eq!((report.triangles_in, report.triangles_kept), (6, 2));
    assert_eq!((report.non_finite, report.degenerate), (2, 2));
    let empty = Builder::new(BuildOptions::default(), Arc::new(Progress::default()), Cancel::new()).expect("options");
    let report = empty.finish(&folder.path().join("empty.oc")).expect("an empty model is a model");
    assert_eq!(report.triangles_kept, 0);
    ModelFile::open_path(folder.path().join("empty.oc")).expect("opens");
}

/// A build that spills, in this thread, so that the disk can fail at each of its writes, one after the other.
#[test]
fn a_disk_that_fails_at_any_write_leaves_the_old_file_and_nothing_else() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("model.oc");
    let triangles: Vec<_> = soup(150_000, 0.01, 0.0).iter().map(|t| t.map(Vec3::as_dvec3)).collect();
    let build = || {
        let temp_dir = Some(folder.path().to_path_buf());
        let options = BuildOptions { threads: 1, memory_budget: 32 << 20, temp_dir, ..BuildOptions::default() };
        let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new())?;
        let part = builder.part(PartDesc::default())?;
        triangles.chunks(4096).try_for_each(|t| builder.triangles(MeshKey::DIRECT, part, t, Attributes::NONE))?;
        builder.finish(&path)
    };
    let mut failures = 0;
    loop {
        std::fs::write(&path, "old").expect("old file");
        let (result, failed) = crate::base::faults::fail_at(failures, build);
        assert_eq!(std::fs::read_dir(folder.path()).expect("folder").count(), 1, "call {failures}");
        if !failed {
            assert!(result.expect("no fault").chunks > 2);
            break;
        }
        assert!(matches!(result, Err(crate::Error::Io { .. })), "call {failures}: {result:?}");
        assert_eq!(std::fs::read(&path).expect("old file"), b"old");
        failures += 1;
    }
    assert!(failures > 15, "{failures} writes test little");
    ModelFile::open_path(&path).expect("a model");
}

/// Each of very many shared meshes finds its own instances, in time that does not grow with all others.
#[test]
fn many_shared_meshes_have_their_own_parts() {
    const MESHES: usize = if cfg!(optimised) { 20_000 } else { 3000 };
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("model.oc");
    let options = BuildOptions { threads: 2, ..BuildOptions::default() };
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).expect("options");
    let size = |mesh: usize| DVec3::new(1.0 + (mesh % 5) as f64, 2.0, 0.0);
    let place = |mesh: usize| DVec3::new((mesh % 100) as f64 * 8.0, (mesh / 100) as f64 * 8.0, 0.0);
    let keys: Vec<MeshKey> = (0..MESHES).map(|_| builder.shared_mesh(1).expect("mesh")).collect();
    for (mesh, key) in keys.iter().enumerate() {
        let size = size(mesh);
        builder.triangles(*key, 0, &[[DVec3::ZERO, size.with_y(0.0), size]], Attributes::NONE).expect("triangle");
    }
    // In an order that is not that of the meshes.
    for mesh in (0..MESHES).map(|i| i * 7919 % MESHES) {
        let part = builder.part(PartDesc { id: Some(mesh as u64), ..PartDesc::default() }).expect("part");
        builder.instance(keys[mesh], glam::DAffine3::from_translation(place(mesh)), part).expect("instance");
    }
    let report = builder.finish(&path).expect("build");
    println!("{MESHES} meshes: {:?}", report.seconds);
    let file = ModelFile::open_path(&path).expect("open");
    assert_eq!((file.trees().len(), file.parts().len()), (MESHES + 1, MESHES));
    for part in (0..MESHES).filter_map(|i| file.parts().get(i)) {
        let [least, greatest] = [place(part.id as usize), place(part.id as usize) + size(part.id as usize)];
        let [a, b, c, d, e, f] = part.bounds;
        assert_eq!((part.triangles, DVec3::new(a, b, c), DVec3::new(d, e, f)), (1, least, greatest), "{}", part.id);
    }
}
