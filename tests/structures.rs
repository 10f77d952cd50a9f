//! What all structures have to have in common: the same answers of the same triangles, and packets and streams that
//! answer as single walks do, whatever is in memory.

use crate::common::asked::ask;
use crate::common::built::{self, Built, Part};
use crate::common::rays::{Ray32, RayMaker};
use crate::common::scenes::{self, Soup, on_five_models};
use crate::common::stored::{self, StoredTree};
use crate::common::trees::local;
use glam::{DVec3, Vec3};
use outcrop::base::error::Error;
use outcrop::base::ids::BlockId;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder, Structure};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::{Cone, PACKET, Ray, STREAM};
use outcrop::query::{Hit, HitKind, Policy, QueryOptions};
use outcrop::residency::{ModelBlocks, Residency};
use outcrop::scene::SceneState;
use outcrop::simd::Isa;
use outcrop::store::{FileSource, ModelFile};
use outcrop::structure::{Counters, Outcome, PacketWalk, Stream, Tree, TriHit, Visit, Walk, open};
use std::sync::Arc;

const RAYS: usize = 20_000;

/// In parts of so many triangles.
const PART: usize = 1000;

fn file(soup: &Soup, structure: Structure) -> Built {
    built::with(structure, || {
        let parts = soup.tris.chunks(PART).zip(1..).map(|(tris, id)| Part::white(id, tris.to_vec()));
        built::parts(&parts.collect::<Vec<_>>())
    })
}

fn rays(stored: &StoredTree, count: usize, seed: u64) -> (Vec<Ray32>, Vec<Ray>) {
    let corners = stored.corners();
    let rays = RayMaker::new(&corners, seed).batch(count);
    let placed = rays.iter().map(|ray| stored.place(ray).0).collect();
    (rays, placed)
}

fn state(file: &Built) -> Arc<SceneState> {
    built::scene(&built::context(2), file).0.state()
}

/// To the bit, rays alone, together, and any.
fn same_hits(soup: Soup) {
    let files = Structure::ALL.map(|structure| file(&soup, structure));
    let stored = files.each_ref().map(|file| stored::trees(&file.path).remove(0));
    assert!(stored.iter().all(|other| other.tris == stored[0].tris));
    let (_, rays) = rays(&stored[0], RAYS, 21);
    let states = files.each_ref().map(state);
    for coherent in [false, true] {
        let options = QueryOptions { coherent, ..QueryOptions::default() };
        let answers = states.each_ref().map(|state| ask(state, &rays, options));
        // Slivers met edge-on, beyond their own boxes (`structure::bvh::trace`).
        let most = if soup.name == "slivers" { RAYS / 1000 } else { 0 };
        for (state, hits) in states.iter().zip(&answers) {
            let differing: Vec<usize> = (0..rays.len()).filter(|&i| hits[i] != answers[0][i]).collect();
            let first = differing.first().map(|&i| (rays[i], hits[i], answers[0][i]));
            assert!(differing.len() <= most, "{}: {} differ, {first:?}", soup.name, differing.len());
            let is_met = |hit: &Hit| *hit != Hit::MISS && hit.prim != outcrop::query::NONE;
            let met = hits.iter().filter(|hit| is_met(hit)).count();
            assert!(met > RAYS / 8, "{}: {met} hits", soup.name);
            let mut any = vec![0; rays.len()];
            state.any(&rays, options, &mut any).expect("answers");
            assert!(hits.iter().zip(&any).all(|(hit, any)| is_met(hit) == (*any == 1)));
        }
    }
}
on_five_models!(same_hits);

/// A file's blocks, read as they are asked for.
struct Cold {
    file: Arc<ModelFile>,
    tree: open::StoredTree,
    blocks: ModelBlocks,
}

impl Cold {
    fn of(built: &Built) -> Self {
        let file =
            Arc::new(ModelFile::open(Arc::new(FileSource::open(&built.path).expect("a file"))).expect("a model"));
        let opened = open::open(&file).expect("trees");
        let blocks =
            ModelBlocks::new(Arc::clone(&file), opened.decoder, &Residency::with_budget(u64::MAX)).expect("any budget");
        Self { tree: opened.trees[0], file, blocks }
    }

    fn read(&self, block: BlockId) {
        self.blocks.fetch(&[block], &Cancel::new()).expect("a block");
    }

    fn read_all(&self) {
        let all: Vec<BlockId> = (0..self.file.block_count()).map(BlockId).collect();
        self.blocks.fetch(&all, &Cancel::new()).expect("all blocks");
    }

    /// Calls `go_on` until nothing is pending; returns how often something was.
    fn until_done(&self, mut go_on: impl FnMut(&Tree) -> Outcome) -> usize {
        let mut pending = 0;
        loop {
            let snapshot = self.blocks.snapshot();
            let visit = Visit { stamp: 1, ..Visit::default() };
            match go_on(&self.tree.view(&snapshot, Isa::best(), visit)) {
                Outcome::Done => return pending,
                Outcome::Pending(block) => self.read(block),
                Outcome::Member(_) => unreachable!("a tree of triangles has no members"),
            }
            pending += 1;
        }
    }
}

fn bits(hit: &TriHit) -> [u32; 5] {
    [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.block, hit.tri]
}

/// Rays alone, with all in memory: hits, whether there is any, and what the walks to the hits did.
fn alone(cold: &Cold, rays: &[Ray32]) -> (Vec<TriHit>, Vec<bool>, Counters) {
    let (mut walk, mut other) = (Walk::new(), Walk::new());
    let (mut hits, mut any) = (Vec::new(), Vec::new());
    for ray in rays {
        let done = cold.until_done(|tree| {
            walk.begin(tree, &local(ray));
            other.begin(tree, &local(ray));
            assert_eq!(tree.any(None, &mut other), Outcome::Done);
            tree.closest(None, &mut walk)
        });
        assert_eq!(done, 0);
        hits.push(walk.best());
        any.push(other.best().is_hit());
    }
    (hits, any, walk.counters)
}

/// Blocks come one by one: a packet is put down at each, and goes on.
fn packets_go_on_where_they_were_put_down() {
    let file = file(&Soup { name: "ball", tris: scenes::bumpy_sphere(60, 90, 5) }, built::structure());
    let stored = stored::trees(&file.path).remove(0);
    let (mut rays, _) = rays(&stored, 20 * PACKET, 3);
    rays.iter_mut().step_by(7).for_each(|ray| ray.cone = Cone { a: 0.0, b: 0.02 });
    let (warm, cold) = (Cold::of(&file), [Cold::of(&file), Cold::of(&file)]);
    warm.read_all();
    let mut pending = [0; 2];
    for (i, rays) in rays.chunks(PACKET).enumerate() {
        // Some lanes have no ray.
        let active = if i % 3 == 0 { 0x7fff_fff5 } else { u32::MAX };
        let (expected, any, counters) = alone(&warm, rays);
        let lanes: [_; PACKET] = std::array::from_fn(|i| local(&rays[i]));
        for is_any in [false, true] {
            let mut walk = PacketWalk::new();
            let cold = &cold[usize::from(is_any)];
            let mut has_begun = false;
            pending[usize::from(is_any)] += cold.until_done(|tree| {
                if !std::mem::replace(&mut has_begun, true) {
                    walk.begin(tree, &lanes, active);
                }
                if is_any { tree.any_together(None, &mut walk) } else { tree.closest_together(None, &mut walk) }
            });
            for lane in 0..PACKET {
                let (got, is_active) = (walk.best(lane), active >> lane & 1 == 1);
                assert_eq!(got.is_hit(), is_active && any[lane], "{i}, {lane}");
                assert!(
                    is_any || !is_active || bits(&got) == bits(&expected[lane]),
                    "{i}, {lane}: {got:?}, {:?}",
                    expected[lane]
                );
                assert_eq!(walk.found() >> lane & 1 == 1, got.is_hit());
            }
            // What was walked is not walked again: each index block is looked at once for each ray.
            if !built::is_bvh() && !is_any && active == u32::MAX {
                assert_eq!(walk.counters().nodes, counters.nodes, "{i}");
            }
        }
    }
    assert!(pending.iter().all(|&count| count > 5), "{pending:?}");
}

/// Rays that lack a block are unfinished; the others have their hits. What a stream held before does not matter.
fn streams_tell_what_they_lack() {
    let file = file(&Soup { name: "ball", tris: scenes::bumpy_sphere(60, 90, 5) }, built::structure());
    let stored = stored::trees(&file.path).remove(0);
    let (rays, _) = rays(&stored, STREAM, 4);
    let (warm, cold) = (Cold::of(&file), Cold::of(&file));
    warm.read_all();
    let (expected, any, _) = alone(&warm, &rays);
    let mut stream = Stream::new();
    let mut hits = vec![TriHit::none(0.0); rays.len()];
    let (mut some_left, mut block) = (0, 0);
    loop {
        let snapshot = cold.blocks.snapshot();
        let tree = cold.tree.view(&snapshot, Isa::best(), Visit { stamp: 1, ..Visit::default() });
        let mut left = 0;
        for is_any in [false, true] {
            rays.iter().enumerate().for_each(|(i, ray)| stream.set(i, &local(ray)));
            if is_any {
                tree.any_each(None, &mut stream, &mut hits);
            } else {
                tree.closest_each(None, &mut stream, &mut hits);
            }
            let unfinished = stream.unfinished();
            left += unfinished.len();
            for i in (0..rays.len()).filter(|&i| !unfinished.contains(&(i as u32))) {
                let is_right = if is_any { hits[i].is_hit() == any[i] } else { bits(&hits[i]) == bits(&expected[i]) };
                assert!(is_right, "{i}: {:?}, {:?}", hits[i], expected[i]);
            }
        }
        some_left += usize::from(left > 0 && left < 2 * rays.len());
        if left == 0 {
            break;
        }
        cold.read(BlockId(block));
        block += 1;
    }
    assert!(some_left > 5, "{some_left}");
}

/// Cells of a plane have no area seen from within it, and rays of no width cover none: still only triangles answer
/// them, alone, beside wide rays, and whether blocks are waited for or not.
fn rays_of_no_width_meet_triangles_only() {
    let state = state(&built::parts(&[Part::white(1, scenes::plane_grid(40, 0.0))]));
    let ray = |i: usize, width: f32| {
        let (y, height) = ((i % 39) as f64 + 0.37, [0.0, 1e-7, -1e-7, 1e-5, 3e-6][i % 5]);
        Ray { cone: Cone { a: width, b: 0.0 }, ..Ray::new(DVec3::new(-3.0, y, height), Vec3::X) }
    };
    let thin: Vec<Ray> = (0..400).map(|i| ray(i, 0.0)).collect();
    let expected: Vec<Hit> =
        thin.iter().map(|ray| ask(&state, std::slice::from_ref(ray), QueryOptions::default())[0]).collect();
    assert!(expected.iter().all(|hit| matches!(hit.kind, HitKind::Miss | HitKind::Exact)));
    for every in [2, 3, 20] {
        let mixed: Vec<Ray> =
            thin.iter().enumerate().map(|(i, thin)| if i % every == 0 { ray(i, 2.0) } else { *thin }).collect();
        for coherent in [false, true] {
            for policy in [Policy::Exact, Policy::Now] {
                let hits = ask(&state, &mixed, QueryOptions { coherent, policy, ..QueryOptions::default() });
                let differ = (0..400).find(|i| i % every != 0 && hits[*i] != expected[*i]);
                assert_eq!(differ.map(|i| (mixed[i], hits[i], expected[i])), None, "coherent: {coherent}, {policy:?}");
                assert!(hits.iter().any(|hit| hit.kind == HitKind::Lod), "wide rays meet cells");
            }
        }
    }
}

/// A mesh that is built in several chunks answers as one that is built in one.
fn chunks_are_joined() {
    let part = Part::white(1, scenes::bumpy_sphere(200, 380, 6));
    let build = |memory_budget| {
        let options = BuildOptions { threads: 1, memory_budget, ..built::options() };
        built::build_with(options, |builder| built::push(builder, &part))
    };
    let ((one, of_one), (several, of_several)) = (build(0), build(32 << 20));
    assert!(of_one.chunks == 1 && of_several.chunks > 2, "{} and {}", of_one.chunks, of_several.chunks);
    let (_, rays) = rays(&stored::trees(&one.path).remove(0), RAYS / 2, 8);
    let [one, several] = [&one, &several].map(|file| ask(&state(file), &rays, QueryOptions::default()));
    let differ = (0..rays.len()).find(|&i| one[i] != several[i]);
    assert_eq!(differ.map(|i| (rays[i], one[i], several[i])), None);
}

built::on_each_structure!(
    packets_go_on_where_they_were_put_down,
    streams_tell_what_they_lack,
    rays_of_no_width_meet_triangles_only,
    chunks_are_joined,
);

/// Far more lists than a tree of two levels has room for.
#[test]
fn a_brute_says_how_much_it_holds() {
    let folder = tempfile::tempdir().expect("a folder");
    let options = built::with(Structure::Brute, built::options);
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).expect("a builder");
    let part = builder.part(PartDesc::default()).expect("a part");
    builder.triangles(MeshKey::DIRECT, part, &scenes::plane_grid(370, 0.0), Attributes::NONE).expect("triangles");
    match builder.finish(&folder.path().join("model.oc")) {
        Err(Error::BadArgument(why)) => assert!(why.contains("4096 lists of 64"), "{why}"),
        other => panic!("{other:?}"),
    }
}
