//! Exactness through the whole house: a file is built, opened, put into a scene and asked through the public API; the
//! answers are those of the f64 oracle over the vertices that the file stores. Every field of a hit is judged:
//! distance and stated error, primitive, part, normal. Stored vertices are within the stated error of the input's.

use crate::common::brute::{Oracle, Ray64, Tri};
use crate::common::built;
use crate::common::bvh64::Bvh64;
use crate::common::errors::{Judge, Summary, Verdict};
use crate::common::rays::{Ray32, RayMaker};
use crate::common::rounding::{Rounding, Seen, shift};
use crate::common::scenes::{Soup, on_five_models};
use crate::common::stored::{self, StoredTree};
use outcrop::build::Structure;
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, Policy, QueryOptions, Want};
use outcrop::scene::SceneState;

const RAYS: usize = 100_000;
/// Of a structure that takes time in proportion to the triangles.
const FEWER: usize = 20_000;
/// Parts take turns in runs of this many triangles.
const RUN: usize = 64;
const PARTS: usize = 5;

/// `t_free` says nothing of surfaces met within 0.9 degrees of edge-on.
const EDGE_ON: f64 = 1.0 / 64.0;

/// Not edge-on, and not at an edge.
fn is_plainly_met(ray: &Ray64, tri: &Tri) -> bool {
    let normal = (tri[1] - tri[0]).cross(tri[2] - tri[0]).normalize_or_zero();
    let cosine = normal.dot(ray.dir.normalize()).abs();
    cosine > EDGE_ON && Seen::new(ray, tri).depth() > shift(ray, tri, Rounding::LOCALISED)
}

fn part_id(part: u32) -> u64 {
    1000 + 7 * u64::from(part)
}

fn build(soup: &Soup) -> built::Built {
    built::build(|builder| {
        for p in 0..PARTS as u32 {
            builder.part(PartDesc { id: Some(part_id(p)), ..Default::default() }).expect("a part");
        }
        for (i, run) in soup.tris.chunks(RUN).enumerate() {
            builder.triangles(MeshKey::DIRECT, (i % PARTS) as u32, run, Attributes::NONE).expect("triangles");
        }
    })
}

fn assert_stored_is_input(soup: &Soup, tree: &StoredTree) {
    // Degenerate after rounding: counted and left out.
    assert!(tree.tris.len() * 1000 >= soup.tris.len() * 999, "{} of {}", tree.tris.len(), soup.tris.len());
    let scale = soup.tris.iter().flatten().map(|v| v.abs().max_element()).fold(0.0, f64::max);
    for (prim, part, corners) in &tree.tris {
        assert_eq!(*part as usize, *prim as usize / RUN % PARTS);
        for (stored, input) in corners.iter().zip(&soup.tris[*prim as usize]) {
            let off = (*stored + tree.origin - *input).length();
            assert!(off <= tree.position_error + scale * 4.0 * f64::EPSILON, "{prim}: {off}");
        }
    }
    let size = tree.tris.iter().flat_map(|t| t.2).map(|v| v.abs().max_element()).fold(0.0, f64::max);
    assert!(tree.position_error <= size * 1.8 / f64::from(1 << 24), "more is lost than f32 around the origin loses");
}

fn ask(scene: &SceneState, rays: &[Ray], coherent: bool) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    let options = QueryOptions { coherent, want: Want::ALL, policy: Policy::Exact };
    scene.closest(rays, options, &mut hits).expect("hits");
    hits
}

fn check(soup: Soup) {
    let file = build(&soup);
    let tree = stored::trees(&file.path).swap_remove(0);
    assert_stored_is_input(&soup, &tree);
    let oracle = Bvh64::new(tree.corners());
    let judge = Judge::new(&oracle, Rounding::LOCALISED);
    let context = built::context(1);
    let (scene, _) = built::scene(&context, &file);
    let state = scene.state();
    let rays: Vec<Ray32> = RayMaker::new(oracle.tris(), 21).batch(built::sized(RAYS, FEWER));
    let (world, local): (Vec<Ray>, Vec<Ray64>) = rays.iter().map(|r| tree.place(r)).unzip();
    let hits = ask(&state, &world, false);
    let mut any = vec![2u8; rays.len()];
    state.any(&world, QueryOptions::default(), &mut any).expect("answers");
    let mut summary = Summary::default();
    for ((ray, hit), (local, any)) in rays.iter().zip(&hits).zip(local.iter().zip(&any)) {
        let truth = oracle.closest(local);
        let got = tree.answer(hit, part_id);
        let ruling = judge.closest(local, truth, got);
        summary.add(ray.kind.name(), &ruling, || format!("{ray:?}: {hit:?} ({got:?}), oracle {truth:?}"));
        assert!(hit.kind == HitKind::Miss || hit.kind == HitKind::Exact && hit.instance == 7);
        if matches!(ruling.verdict, Verdict::Same | Verdict::Tied) {
            let missed = oracle.all(local, hit.t_free.next_down());
            // Nor of the surface that the ray starts on.
            let mut missed = missed.iter().filter(|q| q.t > local.t_min + (hit.t - hit.t_free));
            let seen = missed.find(|q| is_plainly_met(local, &oracle.tris()[q.prim as usize]));
            assert_eq!(seen, None, "a surface before t_free: {ray:?}: {hit:?}");
        }
        assert_eq!(u8::from(hit.kind != HitKind::Miss), *any, "closest and any differ: {ray:?}");
    }
    summary.assert_clean(soup.name);
    let together = ask(&state, &world, true);
    assert!(hits == together, "packets answer otherwise");
}

mod bvh {
    use super::*;

    fn check(soup: Soup) {
        built::with(Structure::Bvh, || super::check(soup));
    }
    on_five_models!(check);
}

mod brute {
    use super::*;

    fn check(soup: Soup) {
        built::with(Structure::Brute, || super::check(soup));
    }
    on_five_models!(check);
}
