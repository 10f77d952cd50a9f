//! All crossings of rays, against integers: rays through corners and edges of closed models cross them as often from
//! the front as from the back.

use crate::common::built::{self, Part, on_each_structure};
use crate::common::closed::{Closed, GridRay, twelve};
use crate::common::rng::Rng;
use outcrop::math::Ray;
use outcrop::query::{Crossing, HitKind, Policy, Side};
use outcrop::scene::SceneState;
use std::collections::BTreeMap;

/// The crossings of each ray, which must be complete.
pub fn all(scene: &SceneState, rays: &[Ray]) -> Vec<Vec<Crossing>> {
    let mut found = Vec::new();
    scene
        .crossings(&rays, Policy::Exact, &mut |ray, crossings, is_complete| {
            assert!(is_complete && ray == found.len());
            found.push(crossings.to_vec());
        })
        .expect("crossings");
    assert_eq!(found.len(), rays.len());
    found
}

/// A model with the parts of `closed`; the ids of parts are 100 and above.
fn parts_of(closed: &Closed) -> Vec<Part> {
    (0..closed.parts()).map(|part| Part::white(100 + u64::from(part), closed.part(part))).collect()
}

/// Index in the input of the build of each triangle.
fn input_order(closed: &Closed) -> Vec<u64> {
    let mut order: Vec<usize> = (0..closed.faces.len()).collect();
    order.sort_by_key(|&face| closed.faces[face].1);
    let mut prims = vec![0; order.len()];
    order.iter().enumerate().for_each(|(prim, &face)| prims[face] = prim as u64);
    prims
}

/// Fails unless the crossings are those of integers, in order.
fn judge(closed: &Closed, prims: &[u64], ray: &GridRay, found: &[Crossing], scratch: &mut Vec<[i64; 3]>) {
    let mut exact = closed.crossings(ray, scratch);
    let key = |face: u32| (prims[face as usize], closed.faces[face as usize].1);
    exact.sort_by_key(|e| key(e.face));
    let mut by_prim: Vec<&Crossing> = found.iter().collect();
    by_prim.sort_by_key(|c| c.prim);
    let named = |prim, side, part| (prim, side, 100 + u64::from(part));
    let expected: Vec<_> = exact.iter().map(|e| named(key(e.face).0, e.side, key(e.face).1)).collect();
    let got: Vec<_> = by_prim.iter().map(|c| (c.prim, c.side, c.part)).collect();
    assert_eq!(got, expected, "{}: {ray:?}", closed.name);
    for (exact, found) in exact.iter().zip(by_prim) {
        let t = exact.t.0 as f64 / exact.t.1 as f64;
        assert!((found.t - t).abs() <= 1e-9 * t.abs().max(1.0), "{}: {ray:?}: {found:?}, {t}", closed.name);
        assert!(found.kind == HitKind::Exact && found.normal.dot(ray.ray().dir) <= 0.0);
    }
    let order = |c: &Crossing| (c.part, c.instance, c.prim);
    let in_order = |w: &[Crossing]| w[0].t < w[1].t || w[0].t == w[1].t && order(&w[0]) < order(&w[1]);
    assert!(found.windows(2).all(in_order), "{}: {ray:?}: {found:?}", closed.name);
}

/// Numbers of crossings from the front and from the back of each part.
fn by_part(found: &[Crossing]) -> BTreeMap<(u64, u64), [u32; 2]> {
    let mut all = BTreeMap::<_, [u32; 2]>::new();
    for c in found {
        all.entry((c.instance, c.part)).or_default()[usize::from(c.side == Side::Back)] += 1;
    }
    all
}

/// Compares the crossings of `count` rays for each model.
fn compare(count: usize) {
    let context = built::context(2);
    for (number, closed) in twelve().into_iter().enumerate() {
        let file = built::parts(&parts_of(&closed));
        let (scene, _) = built::scene(&context, &file);
        let mut rng = Rng::new(number as u64);
        let rays: Vec<GridRay> = (0..count).map(|_| closed.ray(&mut rng)).collect();
        let (prims, mut scratch) = (input_order(&closed), Vec::new());
        let found = all(&scene.state(), &rays.iter().map(GridRay::ray).collect::<Vec<_>>());
        let mut most = 0;
        for (ray, found) in rays.iter().zip(&found) {
            judge(&closed, &prims, ray, found, &mut scratch);
            most = most.max(found.len());
        }
        assert!(most >= 2, "{}: {most}", closed.name);
    }
}

fn crossings_equal_those_of_integers() {
    compare(built::sized(9_000, 700));
}

/// Rays from outside of the model, through corners and edges.
fn lines(closed: &Closed, rng: &mut Rng, count: usize) -> Vec<Ray> {
    let far = |ray: GridRay| {
        let size = ray.dir.iter().map(|x| x.abs()).max().unwrap_or(1);
        let back = 4096 / size + 1;
        GridRay { origin: std::array::from_fn(|i| ray.origin[i] - ray.dir[i] * back), ..ray }.ray()
    };
    (0..count).map(|_| far(closed.ray(rng))).collect()
}

fn closed_parts_are_entered_as_often_as_left() {
    let context = built::context(2);
    for (number, closed) in twelve().into_iter().enumerate() {
        let file = built::parts(&parts_of(&closed));
        let (scene, _) = built::scene(&context, &file);
        let rays = lines(&closed, &mut Rng::new(77 + number as u64), built::sized(2_000, 200));
        for (ray, found) in rays.iter().zip(all(&scene.state(), &rays)) {
            for (part, [front, back]) in by_part(&found) {
                assert_eq!((front + back) % 2, 0, "{}, part {part:?}: {ray:?}", closed.name);
                if closed.name != "bottle of Klein" {
                    assert_eq!(front, back, "{}, part {part:?}: {ray:?}", closed.name);
                }
            }
        }
    }
}

on_each_structure!(crossings_equal_those_of_integers, closed_parts_are_entered_as_often_as_left);
