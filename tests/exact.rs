//! Exactness: over the stored vertices the answers are those of brute force in double precision.
//!
//! On each of the five models 10^4 rays are compared with brute force and 10^6 with the f64 tree (which is
//! itself compared with brute force on the former), a tenth of each kind of [`common::rays::RayKind`]. What agreement
//! means is defined in [`common::errors`]; whatever is neither the same, tied, nor grazing an edge within the
//! rounding of single precision fails the test.

mod common;

use common::brute::{Brute, Oracle};
use common::bvh64::Bvh64;
use common::errors::{Answer, Judge, Summary};
use common::rays::{Ray32, RayMaker};
use common::rounding::Rounding;
use common::scenes::{self, Soup};
use common::trees::{self, TestTree};
use outcrop::simd::Isa;
use outcrop::structure::bvh::trace::{TreeView, TriHit, Walk};

const BRUTE_RAYS: usize = 10_000;
const TREE_RAYS: usize = 1_000_000;

fn answer(view: &TreeView, hit: &TriHit) -> Answer {
    Answer::new(f64::from(hit.t), view.prim(hit).expect("all blocks are here"))
}

/// Judges closest and any hits of `rays`.
fn judge(tree: &TestTree, oracle: &dyn Oracle, rays: &[Ray32]) -> (Summary, Summary) {
    let judge = Judge::new(oracle, Rounding::NONE);
    let view = tree.view(&tree.snapshot, Isa::best());
    let (mut closest, mut any) = (Summary::default(), Summary::default());
    let mut walk = Walk::new();
    for ray in rays {
        let hit = trees::closest(&view, ray, &mut walk);
        let got = hit.map(|h| answer(&view, &h));
        let truth = oracle.closest(&ray.wide());
        let ruling = judge.closest(&ray.wide(), truth, got);
        closest.add(ray.kind.name(), &ruling, || format!("{ray:?}: {got:?}, oracle {truth:?}"));
        let hits = trees::any(&view, ray, &mut walk);
        assert_eq!(hits, hit.is_some(), "closest and any hit differ: {ray:?}");
        any.add_verdict(ray.kind.name(), judge.any(&ray.wide(), truth.is_some(), hits), || format!("{ray:?}: {hits}"));
    }
    (closest, any)
}

fn check(soup: Soup) {
    let tree = TestTree::around_middle(&soup.tris, 0.3);
    tree.assert_holds_its_triangles();
    let tris: Vec<_> = tree.stored.clone();
    let oracle = Bvh64::new(tris.clone());
    let brute = Brute::new(tris);
    let few = RayMaker::new(brute.tris(), 1).batch(BRUTE_RAYS);
    for ray in &few {
        assert_eq!(brute.closest(&ray.wide()), oracle.closest(&ray.wide()), "the oracles differ: {ray:?}");
    }
    let (closest, any) = judge(&tree, &oracle, &few);
    closest.assert_clean(&format!("{}, brute force, closest", soup.name));
    any.assert_clean(&format!("{}, brute force, any", soup.name));
    let (closest, any) = judge(&tree, &oracle, &RayMaker::new(oracle.tris(), 2).batch(TREE_RAYS));
    closest.assert_clean(&format!("{}, f64 tree, closest", soup.name));
    any.assert_clean(&format!("{}, f64 tree, any", soup.name));
}

#[test]
fn scan() {
    check(scenes::scan());
}

#[test]
fn cad() {
    check(scenes::cad());
}

#[test]
fn slivers() {
    check(scenes::slivers());
}

#[test]
fn coplanar_doubles() {
    check(scenes::doubles());
}

#[test]
fn far_from_zero() {
    check(scenes::far_from_zero());
}
