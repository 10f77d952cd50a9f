//! Every path gives the same hits to the bit: baseline, AVX2 and AVX-512, single rays, streams and packets (of rays
//! that go together and of rays that do not), in any order of rays, one thread and two.

use crate::common::built::{self, Part};
use crate::common::rays::{Ray32, RayKind, RayMaker};
use crate::common::scenes::{self, Soup, on_five_models};
use crate::common::stored;
use crate::common::trees::{self, TestTree};
use glam::{DVec3, Vec3};
use outcrop::math::PACKET;
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, QueryOptions};
use outcrop::scene::{Context, ContextOptions};
use outcrop::simd::Isa;
use outcrop::structure::Stream;
use outcrop::structure::bvh::trace::TreeView;
use outcrop::structure::{Outcome, PacketWalk, TriHit, Walk};

const RAYS: usize = 40_000;

type Bits = Option<[u32; 4]>;

/// Mixed kinds, then camera rays: packets that fall apart and packets that stay together.
fn rays(tree: &TestTree) -> Vec<Ray32> {
    let mut maker = RayMaker::new(&tree.stored, 11);
    let mut rays = maker.batch(RAYS / 2);
    rays.extend((rays.len()..RAYS).map(|_| maker.make(RayKind::Grid)));
    rays
}

fn singles(tree: &TestTree, rays: &[Ray32], isa: Isa) -> Vec<Bits> {
    let view = tree.view(&tree.snapshot, isa);
    let mut walk = Walk::new();
    rays.iter().map(|r| trees::bits(&view, &trees::closest(&view, r, &mut walk))).collect()
}

/// In two threads, each with every second packet.
fn packets(tree: &TestTree, rays: &[Ray32], isa: Isa) -> Vec<Bits> {
    let one = |odd: usize| {
        let view = tree.view(&tree.snapshot, isa);
        let mut walk = PacketWalk::of_queries();
        let mine = rays.chunks(PACKET).skip(odd).step_by(2);
        let bits = |hits: Vec<Option<TriHit>>| hits.iter().map(|h| trees::bits(&view, h)).collect();
        mine.map(|chunk| bits(trees::closest_together(&view, chunk, &mut walk))).collect::<Vec<Vec<Bits>>>()
    };
    let (even, odd) = std::thread::scope(|s| {
        let odd = s.spawn(|| one(1));
        (one(0), odd.join().expect("no panic"))
    });
    let chunks = rays.chunks(PACKET).enumerate();
    chunks.flat_map(|(i, _)| if i % 2 == 0 { &even[i / 2] } else { &odd[i / 2] }).copied().collect()
}

fn streams(tree: &TestTree, rays: &[Ray32], isa: Isa) -> Vec<Bits> {
    let view = tree.view(&tree.snapshot, isa);
    let hits = trees::closest_each(&view, rays, &mut Stream::of_queries());
    hits.iter().map(|hit| trees::bits(&view, &hit.expect("every block is there"))).collect()
}

/// With every third block missing, a stream answers like a single ray, or leaves the ray unfinished.
fn check_unfinished(tree: &TestTree, rays: &[Ray32], truth: &[Bits], isa: Isa) {
    let snapshot = tree.snapshot.filtered(|id| id.0 % 3 != 2);
    let (view, all) = (tree.view(&snapshot, isa), tree.view(&tree.snapshot, isa));
    let mut walk = Walk::new();
    let hits = trees::closest_each(&view, rays, &mut Stream::of_queries());
    let (mut unfinished, mut in_vain) = (0, 0);
    for ((ray, truth), hit) in rays.iter().zip(truth).zip(hits) {
        walk.begin(&view, &trees::local(ray));
        let alone = view.closest(None, &mut walk);
        unfinished += usize::from(hit.is_none());
        match hit {
            Some(hit) => assert_eq!(trees::bits(&all, &hit), *truth, "{}: {ray:?}", isa.name()),
            // A stream's distances are rounded down, so it may visit a little more.
            None => in_vain += usize::from(alone == Outcome::Done),
        }
    }
    assert_eq!(unfinished > 0, tree.blocks() > 2);
    assert!(in_vain * 100 <= unfinished, "{in_vain} of {unfinished}");
}

fn first_difference(rays: &[Ray32], a: &[Bits], b: &[Bits]) -> Option<String> {
    assert_eq!(a.len(), b.len());
    let i = a.iter().zip(b).position(|(a, b)| a != b)?;
    Some(format!("ray {i}, {:?}: {:?} and {:?}", rays[i], a[i], b[i]))
}

fn check(soup: Soup) {
    let tree = TestTree::around_middle(&soup.tris, 0.3);
    let rays = rays(&tree);
    let truth = singles(&tree, &rays, Isa::Baseline);
    assert!(truth.iter().flatten().count() > RAYS / 4);
    for isa in trees::isas() {
        let what = format!("{}, {}", soup.name, isa.name());
        assert_eq!(first_difference(&rays, &truth, &singles(&tree, &rays, isa)), None, "{what}, single");
        assert_eq!(first_difference(&rays, &truth, &packets(&tree, &rays, isa)), None, "{what}, packets");
        assert_eq!(first_difference(&rays, &truth, &streams(&tree, &rays, isa)), None, "{what}, streams");
        check_any(&tree, &rays, &truth, isa);
        check_unfinished(&tree, &rays, &truth, isa);
        // Other neighbours in the packets, other leftovers in the walks' memory.
        let turned: Vec<Ray32> = rays.iter().rev().skip(5).copied().collect();
        let turned_truth: Vec<Bits> = truth.iter().rev().skip(5).copied().collect();
        let got = packets(&tree, &turned, isa);
        assert_eq!(first_difference(&turned, &turned_truth, &got), None, "{what}, packets in another order");
    }
}

fn check_any(tree: &TestTree, rays: &[Ray32], truth: &[Bits], isa: Isa) {
    let view = tree.view(&tree.snapshot, isa);
    let (mut walk, mut packet) = (Walk::new(), PacketWalk::of_queries());
    let side_by_side = trees::any_each(&view, rays, &mut Stream::of_queries());
    let differ = side_by_side.iter().zip(truth).position(|(any, truth)| *any != truth.is_some());
    assert_eq!(differ, None, "{}, any in a stream", isa.name());
    for (rays, truth) in rays.chunks(PACKET).zip(truth.chunks(PACKET)) {
        let together = trees::any_together(&view, rays, &mut packet);
        for ((ray, truth), together) in rays.iter().zip(truth).zip(together) {
            assert_eq!(truth.is_some(), trees::any(&view, ray, &mut walk), "{}, any: {ray:?}", isa.name());
            assert_eq!(truth.is_some(), together, "{}, any in a packet: {ray:?}", isa.name());
        }
    }
}

/// Through the public API: any number of threads, any vectors, coherent or not.
#[test]
fn scenes_answer_alike_with_any_threads_and_vectors() {
    let file = built::parts(&[Part::white(1, scenes::doubles().tris), Part::white(2, scenes::bumpy_sphere(60, 90, 1))]);
    let tree = stored::trees(&file.path).swap_remove(0);
    let corners = tree.corners();
    let rays: Vec<Ray> = RayMaker::new(&corners, 12).batch(RAYS / 2).iter().map(|r| tree.place(r).0).collect();
    let mut truth: Option<Vec<Hit>> = None;
    let threads = [0, 1, 2].map(|n| (n, None));
    for (threads, isa) in threads.into_iter().chain(trees::isas().into_iter().map(|isa| (2, Some(isa)))) {
        let context = Context::new(ContextOptions { threads, isa, ..Default::default() }).expect("a context");
        let (scene, _) = built::scene(&context, &file);
        for coherent in [false, true] {
            let mut hits = vec![Hit::MISS; rays.len()];
            let options = QueryOptions { coherent, ..Default::default() };
            scene.state().closest(&rays, options, &mut hits).expect("hits");
            let truth = truth.get_or_insert_with(|| hits.clone());
            let differs = truth.iter().zip(&hits).position(|(a, b)| a != b);
            let what = |i: usize| (rays[i], truth[i], hits[i]);
            assert!(differs.is_none(), "{threads} threads, {isa:?}, coherent {coherent}: {:?}", differs.map(what));
        }
    }
}

on_five_models!(check);

/// Rays with a width that begin at neighbouring points, as shadow rays do: packets keep together, and few rays of them
/// come to most nodes. Stand-ins too are the same to the bit, for what is missing too.
#[test]
fn rays_of_neighbouring_points_see_the_same_stand_ins() {
    let tree = TestTree::around_middle(&scenes::bumpy_sphere(60, 90, 1), 0.0);
    let (all, holes) = (tree.snapshot.filtered(|_| true), tree.snapshot.filtered(|id| id.0 % 3 != 2));
    let mut maker = RayMaker::new(&tree.stored, 31);
    let rows: Vec<Ray32> = (0..16_384).map(|_| maker.make(RayKind::Grid)).collect();
    let mut walk = Walk::new();
    let exact = trees::shadows(&tree.view(&all, Isa::Baseline), &rows);
    let (mut lods, mut missing) = (0, 0);
    for width in [0.0, 0.02, 0.1, 0.5] {
        let rays: Vec<Ray32> =
            exact.iter().map(|ray| Ray32 { cone: Cone { a: width * tree.max_coord, b: width }, ..*ray }).collect();
        for (isa, (snapshot, accept_missing)) in
            trees::isas().into_iter().flat_map(|isa| [(&all, false), (&holes, true)].map(|it| (isa, it)))
        {
            let base = TreeView { accept_missing, ..tree.view(snapshot, Isa::Baseline) };
            let view = TreeView { isa, ..base };
            let (mut packet, mut stream) = (PacketWalk::of_queries(), Stream::of_queries());
            let side_by_side = trees::closest_each(&view, &rays, &mut stream);
            for (rays, beside) in rays.chunks(PACKET).zip(side_by_side.chunks(PACKET)) {
                let together = trees::closest_together(&view, rays, &mut packet);
                for ((ray, together), beside) in rays.iter().zip(together).zip(beside) {
                    let alone = trees::closest(&base, ray, &mut walk);
                    assert_eq!(together, alone, "{}, a packet, {ray:?}", isa.name());
                    assert_eq!(beside.unwrap_or(alone), alone, "{}, a stream, {ray:?}", isa.name());
                    let cell = alone.and_then(|hit| hit.stand_in());
                    lods += usize::from(cell.is_some_and(|cell| !cell.is_missing));
                    missing += usize::from(cell.is_some_and(|cell| cell.is_missing));
                }
            }
        }
    }
    assert!(lods > exact.len() && missing > exact.len() / 10, "{lods}, {missing} of {}", exact.len());
}

/// Rays of a camera in blocks of pixels, some of them odd: in order they go in packets, shuffled they go side by side.
#[test]
fn in_order_and_shuffled_rays_have_the_same_hits() {
    let file = built::parts(&[Part::white(1, scenes::doubles().tris), Part::white(2, scenes::bumpy_sphere(60, 90, 1))]);
    let tree = stored::trees(&file.path).swap_remove(0);
    let corners = tree.corners();
    let mut maker = RayMaker::new(&corners, 21);
    let rows: Vec<Ray> = (0..4096).map(|_| tree.place(&maker.make(RayKind::Grid)).0).collect();
    let blocks = (0..64).step_by(4).flat_map(|y| (0..64).step_by(8).map(move |x| (x, y)));
    let blocks: Vec<usize> = blocks.flat_map(|(x, y)| (0..PACKET).map(move |i| (y + i / 8) * 64 + x + i % 8)).collect();
    // The whole, and a part so small that a triangle has many pixels.
    let middle = rows[2080].dir;
    let close = |ray: &Ray| Ray { dir: middle + (ray.dir - middle) * 0.04, ..*ray };
    let mut rays: Vec<Ray> = blocks.iter().map(|&i| rows[i]).collect();
    rays.extend(blocks.iter().map(|&i| close(&rows[i])));
    // And at corners and edges, triangle by triangle.
    let eye = rows[0].origin;
    let at = |p: DVec3| Ray { dir: (tree.origin + p - eye).as_vec3(), ..rows[0] };
    let features = corners.iter().flat_map(|&[a, b, c]| [a, (a + b) * 0.5, b, (b + c) * 0.5, c, (c + a) * 0.5]);
    rays.extend(features.take(8192).map(at));
    for (n, ray) in rays.iter_mut().enumerate().skip(700).step_by(97) {
        match n % 9 {
            0 => ray.t_min = -1.0,
            1 => ray.t_min = f64::NAN,
            2 => ray.t_min = f64::INFINITY,
            3 => ray.t_max = f64::NAN,
            4 => ray.mask = 0,
            5 => ray.dir = Vec3::NAN,
            6 => ray.dir *= 1e-9,
            7 => ray.origin -= ray.dir.as_dvec3() * 1e4,
            _ => ray.t_max = 1e-3,
        }
    }
    // 1657 is prime to 16384: neighbours of the picture end up far apart.
    let order: Vec<usize> = (0..rays.len()).map(|i| i * 1657 % rays.len()).collect();
    let shuffled: Vec<Ray> = order.iter().map(|&i| rays[i]).collect();
    for isa in trees::isas() {
        let context =
            Context::new(ContextOptions { threads: 1, isa: Some(isa), ..Default::default() }).expect("a context");
        let (scene, _) = built::scene(&context, &file);
        for coherent in [false, true] {
            let options = QueryOptions { coherent, ..Default::default() };
            let (mut together, mut apart) = (vec![Hit::MISS; rays.len()], vec![Hit::MISS; rays.len()]);
            scene.state().closest(&rays, options, &mut together).expect("hits");
            scene.state().closest(&shuffled, QueryOptions::default(), &mut apart).expect("hits");
            for (place, &i) in order.iter().enumerate() {
                assert_eq!(together[i], apart[place], "{isa:?}, coherent {coherent}, ray {i}: {:?}", rays[i]);
            }
            let (mut any, mut any_apart) = (vec![2; rays.len()], vec![2; rays.len()]);
            scene.state().any(&rays, options, &mut any).expect("answers");
            scene.state().any(&shuffled, QueryOptions::default(), &mut any_apart).expect("answers");
            assert!(order.iter().zip(&any_apart).all(|(&i, &apart)| any[i] == apart), "{isa:?}, coherent {coherent}");
        }
    }
}

/// Rays of neighbouring pixels are told from others, by direction and by origin.
#[test]
fn rays_that_go_together_are_recognised() {
    let tree = TestTree::around_middle(&scenes::bumpy_sphere(40, 60, 1), 0.0);
    let view = tree.view(&tree.snapshot, Isa::best());
    let mut walk = PacketWalk::of_queries();
    let camera = |spread: f32, apart: f32| -> Vec<Ray32> {
        let ray = |i: usize| {
            let (x, y) = ((i % 8) as f32, (i / 8) as f32);
            let dir = Vec3::new(0.3 + spread * x, 0.2 + spread * y, -1.0);
            let org = Vec3::new(apart * x, apart * y, 2.0) * tree.max_coord;
            Ray32 { kind: RayKind::Grid, org, dir, t_min: 0.0, t_max: f32::INFINITY, cone: Cone::ZERO }
        };
        (0..PACKET).map(ray).collect()
    };
    let mut is_coherent = |rays: &[Ray32], says: bool| {
        trees::begin_together(&view, rays, &mut walk);
        walk.is_coherent(&view, says)
    };
    assert!(is_coherent(&camera(0.001, 0.0), false), "one origin");
    assert!(is_coherent(&camera(0.001, 0.001), false), "origins near each other");
    assert!(!is_coherent(&camera(0.001, 0.1), false), "origins all over");
    assert!(is_coherent(&camera(0.001, 0.1), true), "origins all over, but the caller says so");
    assert!(!is_coherent(&camera(-0.1, 0.0), true), "directions into several octants");
}
