//! Packets that begin at what a beam around them meets answer, to the bit, as those that begin at the root, and visit less.

mod common;

use common::rng::Rng;
use common::scenes::{self, Soup, on_five_models};
use common::trees::{self, TestTree};
use glam::{DVec3, Vec3};
use outcrop::math::Cone;
use outcrop::scene::camera::PixelRays;
use outcrop::simd::Isa;
use outcrop::structure::bvh::trace::{Beam, Entries, LocalRay, Outcome, PACKET, PacketWalk, TreeView, TriHit};
use outcrop::Camera;

/// Pixels of a beam along each side, and beams of a picture that are looked at, along each side.
const TILE: u32 = 32;
const TILES: u32 = 4;

/// What was done, beams aside: packets, those in beams with entries, and nodes visited from the root and from entries.
#[derive(Default, Debug)]
struct Tally {
    packets: u64,
    with_entries: u64,
    hits: u64,
    from_root: u64,
    from_entries: u64,
}

/// From far, from near and from among the triangles.
fn cameras(tree: &TestTree, rng: &mut Rng) -> Vec<Camera> {
    let reach = f64::from(tree.reach);
    let mut point = |size: f64| DVec3::new(rng.unit(), rng.unit(), rng.unit()) * (2.0 * size) - DVec3::splat(size);
    let mut cameras = Vec::new();
    for (distance, fov_y_degrees) in [(4.0, 30.0), (1.6, 30.0), (1.2, 120.0), (0.3, 30.0), (0.3, 179.99)] {
        let from = point(1.0).normalize_or(DVec3::X);
        let (eye, at) = (from * (distance * reach), point(0.3 * reach));
        cameras.push(Camera::Perspective { eye, at, up: DVec3::new(0.1, 0.2, 1.0), fov_y_degrees });
    }
    cameras
}

/// A tile's packets, both ways. `all`: the tree with all blocks. `poe`: 0 for exact rays.
fn compare(view: &TreeView, all: &TreeView, rays: &PixelRays, (x, y): (u32, u32), poe: f32, rng: &mut Rng, tally: &mut Tally) {
    let org = rays.eye().as_vec3();
    let corner = |x: u32, y: u32| rays.across(x.into(), y.into()).as_vec3();
    let corners = [corner(x, y), corner(x + TILE, y), corner(x, y + TILE), corner(x + TILE, y + TILE)];
    let width = poe.sqrt() * rays.pixel_width(1.0) as f32;
    let beam = Beam::new(view, org, &corners, width);
    let entries = beam.and_then(|beam| Entries::of(view, &beam));
    let (mut root, mut entered) = (PacketWalk::new(), PacketWalk::new());
    for packet in 0..(TILE * TILE) as usize / PACKET {
        let at = (x + packet as u32 % 4 * 8, y + packet as u32 / 4 * 4);
        let mut locals = [LocalRay::NONE; PACKET];
        for (i, local) in locals.iter_mut().enumerate() {
            let (px, py) = (at.0 + i as u32 % 8, at.1 + i as u32 / 8);
            // Anywhere in the pixel, borders included.
            let (dx, dy) = [(0.5, 0.5), (0.0, 1.0), (rng.unit(), rng.unit())][rng.below(3)];
            let (dir, one) = rays.toward(f64::from(px) + dx, f64::from(py) + dy);
            *local = LocalRay { org, dir, t_max: f32::INFINITY, cone: Cone { a: 0.0, b: one * poe.sqrt() }, ..LocalRay::NONE };
        }
        root.begin(view, &locals, u32::MAX);
        entered.begin(view, &locals, u32::MAX);
        if let Some(entries) = &entries {
            entered.enter(view, entries);
        }
        assert_eq!(view.closest_together(None, &mut root), Outcome::Done);
        assert_eq!(view.closest_together(None, &mut entered), Outcome::Done);
        for (i, local) in locals.iter().enumerate() {
            let (a, b) = (root.best(i), entered.best(i));
            // A triangle may be in several leaves.
            let triangle = |hit: &TriHit| trees::bits(all, &Some(*hit).filter(|h| h.is_hit() && h.stand_in().is_none()));
            assert_eq!(triangle(&a), triangle(&b), "{a:?} {b:?}: {local:?}");
            let cell = |hit: &TriHit| hit.stand_in().map(|_| (hit.t.to_bits(), hit.block, hit.tri));
            assert_eq!(cell(&a), cell(&b), "{local:?}");
            tally.hits += u64::from(a.is_hit());
        }
        tally.packets += 1;
        tally.with_entries += u64::from(entries.is_some());
    }
    tally.from_root += root.counters().nodes;
    tally.from_entries += entered.counters().nodes;
}

/// `size`: pixels of the picture along each side.
fn check(tree: &TestTree, size: u32, seed: u64) -> Tally {
    let mut rng = Rng::new(seed);
    let mut tally = Tally::default();
    for (c, camera) in cameras(tree, &mut rng).iter().enumerate() {
        let rays = camera.prepare(size, size).expect("a camera");
        let isas = trees::isas();
        let isa = isas[c % isas.len()];
        // All there; and holes that cells stand in for.
        let holes = tree.snapshot.filtered(|id| id.0 == 0 || id.0 % 3 != 2);
        for (snapshot, never_waits) in [(&tree.snapshot, false), (&tree.snapshot, true), (&holes, true)] {
            let (view, all) = (TreeView { never_waits, ..tree.view(snapshot, isa) }, tree.view(&tree.snapshot, isa));
            for poe in [0.0, 1.0, 30.0] {
                for i in 0..TILES * TILES {
                    // The middle, and of every second picture a corner: of a wide one nearly across the view.
                    let first = if c % 2 == 0 { 0 } else { (size - TILES * TILE) / 2 };
                    let at = (first + i % TILES * TILE, first + i / TILES * TILE);
                    compare(&view, &all, &rays, at, poe, &mut rng, &mut tally);
                }
            }
        }
    }
    tally
}

/// To the bit, whatever the model.
fn answer_as_from_the_root(soup: Soup) {
    let tree = TestTree::around_middle(&soup.tris, 0.3);
    let tally = check(&tree, 128, 7);
    println!("{tally:?}");
    assert!(tally.hits > 500, "{tally:?}");
}

on_five_models!(answer_as_from_the_root);

#[test]
fn packets_of_a_beam_visit_less() {
    let tree = TestTree::around_middle(&scenes::bumpy_sphere(300, 400, 1), 0.0);
    let tally = check(&tree, 1024, 3);
    println!("{tally:?}");
    assert!(tally.with_entries * 10 > tally.packets * 5, "{tally:?}");
    assert!(tally.from_entries * 100 < tally.from_root * 85, "{tally:?}");
}

/// Nearly across the view, where the rays of a tile differ least.
#[test]
fn beams_of_wide_pictures_lose_nothing_at_their_border() {
    let rays = Camera::Perspective { eye: DVec3::ZERO, at: DVec3::new(0.5, 0.7, -0.4), up: DVec3::Y, fov_y_degrees: 179.99 };
    let rays = rays.prepare(1024, 1024).expect("a camera");
    // A patch across the corner, whose triangles are smaller than a pixel.
    let (middle, side) = (rays.across(64.0, 64.0).normalize(), rays.across(128.0, 0.0).normalize());
    let (right, down) = ((side - middle).normalize(), (side - middle).cross(middle).normalize());
    let n = 400;
    let at = |i: usize, j: usize| (middle + (right * (i as f64 / n as f64 - 0.5) + down * (j as f64 / n as f64 - 0.5)) * 0.1) * 8.0;
    let cell = |i: usize, j: usize| [[at(i, j), at(i + 1, j), at(i, j + 1)], [at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]];
    let tris: Vec<_> = (0..n * n).flat_map(|k| cell(k % n, k / n)).collect();
    let tree = TestTree::build(&tris, DVec3::ZERO, 0.0);
    let view = tree.view(&tree.snapshot, Isa::best());
    let (mut rng, mut tally) = (Rng::new(9), Tally::default());
    for poe in [0.0, 1.0] {
        for i in 0..TILES * TILES {
            compare(&view, &view, &rays, (i % TILES * TILE, i / TILES * TILE), poe, &mut rng, &mut tally);
        }
    }
    println!("{tally:?}");
    assert!(tally.hits > 10_000 && tally.with_entries > 0, "{tally:?}");
}

#[test]
fn beams_to_both_sides_are_none() {
    let tree = TestTree::around_middle(&scenes::bumpy_sphere(20, 20, 1), 0.0);
    let view = tree.view(&tree.snapshot, Isa::Baseline);
    let at = |x: f32, y: f32| Vec3::new(x, y, -1.0);
    let beam = |corners: [Vec3; 4]| Beam::new(&view, Vec3::Z * 3.0, &corners, 0.0);
    assert!(beam([at(0.1, 0.1), at(0.2, 0.1), at(0.1, 0.2), at(0.2, 0.2)]).is_some());
    assert!(beam([at(-0.1, 0.1), at(0.2, 0.1), at(-0.1, 0.2), at(0.2, 0.2)]).is_none());
    assert!(beam([at(0.0, 0.1), at(0.2, 0.1), at(0.0, 0.2), at(0.2, 0.2)]).is_none());
    assert!(beam([Vec3::NAN; 4]).is_none());
}
