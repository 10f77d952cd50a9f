//! Packets that go together answer, to the bit, as those that begin at the root, and visit less.

use crate::common::rng::Rng;
use crate::common::scenes::{self, Soup, on_five_models};
use crate::common::trees::{self, TestTree};
use glam::DVec3;
use outcrop::Camera;
use outcrop::lod::summary_bit;
use outcrop::math::Cone;
use outcrop::math::{BUNDLE, PACKET};
use outcrop::scene::camera::PixelRays;
use outcrop::simd::Isa;
use outcrop::structure::bvh::trace::{Bundle, TreeView};
use outcrop::structure::{LocalRay, Outcome, PacketWalk, PartFilter, TriHit};

/// Pixels of a bundle along each side, and bundles of a picture that are looked at, along each side.
const TILE: u32 = 32;
const TILES: u32 = 4;

/// What was done: nodes visited by packets from the root, and by bundles and what they leave to packets; and rays that
/// had to wait for a block.
#[derive(Default, Debug)]
struct Tally {
    hits: u64,
    waited: u64,
    from_root: u64,
    together: u64,
}

/// From far, from near and from among the triangles.
fn cameras(tree: &TestTree, rng: &mut Rng) -> Vec<Camera> {
    let reach = f64::from(tree.max_coord);
    let mut point = |size: f64| DVec3::new(rng.unit(), rng.unit(), rng.unit()) * (2.0 * size) - DVec3::splat(size);
    let mut cameras = Vec::new();
    for (distance, fov_y_degrees) in [(4.0, 30.0), (1.6, 30.0), (1.2, 120.0), (0.3, 30.0), (0.3, 179.99)] {
        let from = point(1.0).normalize_or(DVec3::X);
        let (eye, at) = (from * (distance * reach), point(0.3 * reach));
        cameras.push(Camera::Perspective { eye, at, up: DVec3::new(0.1, 0.2, 1.0), fov_y_degrees });
    }
    cameras
}

/// Both ways of a tile, reusable.
#[derive(Default)]
struct Pair {
    root: PacketWalk,
    bundle: Bundle,
}

/// What is traced: `all` is the tree with all blocks; `poe`: 0 for exact rays.
struct Case<'a> {
    view: TreeView<'a>,
    all: TreeView<'a>,
    filter: Option<PartFilter<'a>>,
    poe: f32,
}

impl Case<'_> {
    /// To the end, whatever has to come for that; whether something had.
    fn finish(&self, walk: &mut PacketWalk) -> bool {
        let filter = self.filter.as_ref();
        match self.view.closest_together(filter, walk) {
            Outcome::Done => false,
            Outcome::Pending(_) => {
                assert_eq!(self.all.closest_together(filter, walk), Outcome::Done);
                true
            }
            Outcome::Member(_) => unreachable!("a tree of triangles has no members"),
        }
    }

    /// A tile's packets, both ways.
    fn compare(&self, rays: &PixelRays, (x, y): (u32, u32), pair: &mut Pair, rng: &mut Rng, tally: &mut Tally) {
        let org = rays.eye().as_vec3();
        let Pair { root, bundle } = pair;
        let mut packets = Vec::new();
        // In one of four tiles some packets do not take part, some pixels do not count, and packets differ.
        let is_mixed = rng.below(4) == 0;
        let some =
            |rng: &mut Rng| if is_mixed { (rng.below(1 << 16) | rng.below(1 << 16) << 16) as u32 } else { u32::MAX };
        let among = some(rng);
        for p in 0..BUNDLE {
            let at = (x + p as u32 % 4 * 8, y + p as u32 / 4 * 4);
            let mut locals = [LocalRay::NONE; PACKET];
            let (mut org, mut wide, mut reach) = (org, self.poe.sqrt(), [0.0, f32::INFINITY]);
            if is_mixed {
                match rng.below(8) {
                    0 => org.x += 0.01,
                    1 => wide = 0.0,
                    2 => reach = [org.length() * 0.9, org.length() * 1.1],
                    _ => {}
                }
            }
            for (i, local) in locals.iter_mut().enumerate() {
                let (px, py) = (at.0 + i as u32 % 8, at.1 + i as u32 / 8);
                // Anywhere in the pixel, borders included.
                let (dx, dy) = [(0.5, 0.5), (0.0, 1.0), (rng.unit(), rng.unit())][rng.below(3)];
                let (dir, one) = rays.toward(f64::from(px) + dx, f64::from(py) + dy);
                *local = LocalRay { org, dir, t_min: reach[0], t_max: reach[1], cone: Cone { a: 0.0, b: one * wide } };
            }
            let active = some(rng);
            bundle.packet(p).begin(&self.view, &locals, active);
            packets.push((locals, active));
        }
        bundle.closest(&self.view, self.filter.as_ref(), among);
        for (p, (locals, active)) in packets.iter().enumerate() {
            root.begin(&self.view, locals, *active);
            // Not for the same: what is met first may make a block needless.
            let waited = self.finish(root) | self.finish(bundle.packet(p));
            for (i, local) in locals.iter().enumerate() {
                let (a, b) = (root.best(i), bundle.packet(p).best(i));
                // A triangle may be in several leaves.
                let triangle =
                    |hit: &TriHit| trees::bits(&self.all, &Some(*hit).filter(|h| h.is_hit() && h.stand_in().is_none()));
                assert_eq!(triangle(&a), triangle(&b), "{a:?} {b:?}: {local:?}");
                let cell = |hit: &TriHit| hit.stand_in().map(|_| (hit.t.to_bits(), hit.block, hit.tri));
                assert_eq!(cell(&a), cell(&b), "{local:?}");
                tally.hits += u64::from(a.is_hit());
            }
            tally.waited += u64::from(waited);
        }
    }
}

/// `size`: pixels of the picture along each side.
fn check(tree: &TestTree, size: u32, seed: u64) -> Tally {
    let mut rng = Rng::new(seed);
    let (mut tally, mut pair) = (Tally::default(), Pair::default());
    // One of the trees' three parts.
    let filter = PartFilter { hidden: &[1 << 1], first_part: 0, touched: summary_bit(1), ..PartFilter::default() };
    for (c, camera) in cameras(tree, &mut rng).iter().enumerate() {
        let rays = camera.prepare(size, size).expect("a camera");
        let isas = trees::isas();
        let isa = isas[c % isas.len()];
        // All there; and holes that cells stand in for, or that are waited for.
        let holes = tree.snapshot.filtered(|id| id.0 == 0 || id.0 % 3 != 2);
        // What ties are decided by is to be waited for.
        let no_prims = tree.snapshot.filtered(|id| id.0 < tree.blocks() / 2);
        let whole = &tree.snapshot;
        for (snapshot, accept_missing) in
            [(whole, false), (whole, true), (&holes, true), (&holes, false), (&no_prims, false)]
        {
            for (poe, is_filtered) in [(0.0, false), (0.0, true), (1.0, false), (30.0, false), (30.0, true)] {
                let filter = is_filtered.then_some(filter);
                // Walks that accept missing data do not wait for ids either.
                let view = TreeView { accept_missing, ties_by_place: accept_missing, ..tree.view(snapshot, isa) };
                let all = tree.view(&tree.snapshot, isa);
                let case = Case { view, all, filter, poe };
                for i in 0..TILES * TILES {
                    // The middle, and of every second picture a corner: of a wide one nearly across the view.
                    let first = if c % 2 == 0 { 0 } else { (size - TILES * TILE) / 2 };
                    let at = (first + i % TILES * TILE, first + i / TILES * TILE);
                    case.compare(&rays, at, &mut pair, &mut rng, &mut tally);
                }
            }
        }
    }
    tally.from_root = pair.root.counters().nodes;
    tally.together =
        pair.bundle.counters.nodes + (0..BUNDLE).map(|p| pair.bundle.packet(p).counters().nodes).sum::<u64>();
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
fn packets_that_go_together_visit_less() {
    let tree = TestTree::around_middle(&scenes::bumpy_sphere(300, 400, 1), 0.0);
    let tally = check(&tree, 1024, 3);
    println!("{tally:?}");
    assert!(tally.together * 100 < tally.from_root * 75, "{tally:?}");
    assert!(tally.waited > 0, "{tally:?}");
}

/// Nearly across the view, where the rays of a tile differ least: their packets' extremes round to the same.
#[test]
fn tiles_of_wide_pictures_lose_nothing_at_their_border() {
    let rays =
        Camera::Perspective { eye: DVec3::ZERO, at: DVec3::new(0.5, 0.7, -0.4), up: DVec3::Y, fov_y_degrees: 179.99 };
    let rays = rays.prepare(1024, 1024).expect("a camera");
    let along = |x: f64, y: f64| rays.toward(x, y).0.as_dvec3();
    // A patch across the corner, whose triangles are smaller than a pixel.
    let (middle, side) = (along(64.0, 64.0), along(128.0, 0.0));
    let (right, down) = ((side - middle).normalize(), (side - middle).cross(middle).normalize());
    let n = 400;
    let at = |i: usize, j: usize| {
        (middle + (right * (i as f64 / n as f64 - 0.5) + down * (j as f64 / n as f64 - 0.5)) * 0.1) * 8.0
    };
    let cell =
        |i: usize, j: usize| [[at(i, j), at(i + 1, j), at(i, j + 1)], [at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]];
    let tris: Vec<_> = (0..n * n).flat_map(|k| cell(k % n, k / n)).collect();
    let tree = TestTree::build(&tris, DVec3::ZERO, 0.0);
    let view = tree.view(&tree.snapshot, Isa::best());
    let (mut rng, mut tally, mut pair) = (Rng::new(9), Tally::default(), Pair::default());
    for poe in [0.0, 1.0] {
        let case = Case { view, all: view, filter: None, poe };
        for i in 0..TILES * TILES {
            case.compare(&rays, (i % TILES * TILE, i / TILES * TILE), &mut pair, &mut rng, &mut tally);
        }
    }
    println!("{tally:?}");
    assert!(tally.hits > 10_000, "{tally:?}");
}
