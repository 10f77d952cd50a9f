//! Exactness: over the stored vertices the answers are those of brute force in double precision.
//!
//! On each of the five models 10^4 rays are compared with brute force and 10^6 with the f64 tree (which is
//! itself compared with brute force on the former), a tenth of each kind of [`common::rays::RayKind`]. What agreement
//! means is defined in [`common::errors`]; whatever is neither the same, tied, nor grazing an edge within the
//! rounding of single precision fails the test.

use crate::common::brute::{Brute, Oracle, Ray64, Tri, meet_line};
use crate::common::bvh64::Bvh64;
use crate::common::errors::{Answer, Judge, Summary};
use crate::common::rays::{Ray32, RayMaker};
use crate::common::rounding::{Rounding, Seen, shift};
use crate::common::scenes::{Soup, on_five_models};
use crate::common::trees::{self, TestTree};
use outcrop::geom::watertight::{Shear, intersect_one};
use outcrop::simd::Isa;
use outcrop::structure::bvh::trace::TreeView;
use outcrop::structure::{TriHit, Walk};

const BRUTE_RAYS: usize = 10_000;
const TREE_RAYS: usize = 1_000_000;
const LEAST_RAYS: usize = 100_000;

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

/// The hit is the least (distance, primitive) over *all* triangles that the single-precision test accepts, to the
/// bit: no order of visits, box or early end may show. The f64 tree only says which triangles lie near the ray.
///
/// Only ill-determined hits may be left out: an edge-on triangle answers with any of its depths, also with one
/// outside of its box, which then need not be visited. Box tests have a slack of 2^-19 of the largest
/// coordinate; where rounding may move `t` by more (or makes the hit in the first place) order may show.
fn assert_least(name: &str, tree: &TestTree, oracle: &dyn Oracle, rays: &[Ray32]) {
    let judge = Judge::new(oracle, Rounding::NONE);
    let view = tree.view(&tree.snapshot, Isa::best());
    let mut walk = Walk::new();
    let (mut left_out, mut wrong) = (0, Vec::new());
    for ray in rays {
        let (shear, wide) = (Shear::new(ray.dir), ray.wide());
        let mut accepted: Vec<(f32, u32, bool)> = Vec::new();
        oracle.near_line(&wide, judge.widest_shift(&wide), &mut |prim, tri| {
            let corners = tri.map(|v| v.as_vec3());
            if let Some(hit) = intersect_one(ray.org, &shear, ray.t_min, ray.t_max, corners) {
                // Adding zero turns -0 into 0: they are one distance.
                accepted.push((hit.t + 0.0, prim, is_determined(&wide, tri, tree.max_coord)));
            }
        });
        accepted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let got = trees::closest(&view, ray, &mut walk);
        let got = got.map(|h| (h.t + 0.0, view.prim(&h).expect("all blocks are here")));
        // In order: some that may be left out, then the first that may not.
        let last = accepted.iter().position(|a| a.2).map_or(accepted.len(), |i| i + 1);
        match accepted[..last].iter().position(|a| Some((a.0, a.1)) == got) {
            Some(0) => {}
            Some(_) => left_out += 1,
            None if got.is_none() && last == accepted.len() && !accepted.iter().any(|a| a.2) => {
                left_out += usize::from(last > 0)
            }
            None => wrong.push(format!("{ray:?}: {got:?} of {:?}", &accepted[..last])),
        }
    }
    println!(
        "{name}: the least of all for {} rays, {left_out} but for rounding, {} ties",
        rays.len(),
        walk.counters.ties
    );
    assert!(
        wrong.is_empty(),
        "{name}: {} hits are not the least\n{}",
        wrong.len(),
        wrong[..wrong.len().min(5)].join("\n")
    );
    assert!(left_out * 10_000 <= rays.len(), "{name}: {left_out} of {} hits depend on the order of visits", rays.len());
}

fn is_determined(ray: &Ray64, tri: &Tri, reach: f32) -> bool {
    let seen = Seen::new(ray, tri);
    let slack = ray.org.abs().max_element().max(f64::from(reach)) / f64::from(1 << 19);
    meet_line(ray, tri).is_some() && seen.t_bound(shift(ray, tri, Rounding::NONE)) <= slack * seen.t_per_unit
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
    assert_least(soup.name, &tree, &oracle, &RayMaker::new(oracle.tris(), 3).batch(LEAST_RAYS));
    let (closest, any) = judge(&tree, &oracle, &RayMaker::new(oracle.tris(), 2).batch(TREE_RAYS));
    closest.assert_clean(&format!("{}, f64 tree, closest", soup.name));
    any.assert_clean(&format!("{}, f64 tree, any", soup.name));
}

on_five_models!(check);
