//! All crossings of rays, against integers: rays through corners and edges of closed models cross them as often from
//! the front as from the back.

use crate::common::asked::ask;
use crate::common::built::{self, Part, on_each_structure};
use crate::common::closed::{Closed, GridRay, twelve};
use crate::common::rng::Rng;
use crate::common::scenes::has_area;
use glam::{DAffine3, DQuat, DVec3, Vec3};
use outcrop::math::Ray;
use outcrop::query::{Crossing, HitKind, Holds, PartAt, Policy, QueryOptions, Side};
use outcrop::scene::{Look, Model, Scene, SceneState};
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

/// A million rays. Run it with optimised code: `cargo test --test rays a_million -- --ignored`.
#[test]
#[ignore = "takes a minute"]
fn a_million_rays_cross_as_integers_say() {
    compare(1_000_000 / 12 + 1);
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

on_each_structure!(
    crossings_equal_those_of_integers,
    closed_parts_are_entered_as_often_as_left,
    parts_say_whether_they_are_closed,
    a_point_is_in_the_parts_around_it,
    an_open_part_is_undecided_within_its_bounds,
    thickness_is_the_distance_to_the_opposite_side,
);

fn parts_say_whether_they_are_closed() {
    let context = built::context(1);
    for closed in twelve() {
        let whole = parts_of(&closed);
        let mut open = parts_of(&closed);
        // One without area may have no edge of its own.
        let solid = open[0].tris.iter().position(has_area).expect("a triangle");
        open[0].tris.remove(solid);
        let mut turned = parts_of(&closed);
        turned[0].tris[solid].swap(0, 1);
        let flags = |parts: &[Part]| {
            let model = Model::open(&context, &built::parts(parts).path).expect("a model");
            model.parts().iter().map(|part| (part.is_closed, part.is_oriented)).collect::<Vec<_>>()
        };
        let is_bottle = closed.name == "bottle of Klein";
        assert_eq!(flags(&whole), vec![(true, !is_bottle); whole.len()], "{}", closed.name);
        assert_eq!(flags(&open)[0], (false, false), "{}", closed.name);
        assert_eq!(flags(&turned)[0], (true, false), "{}", closed.name);
        assert_eq!(flags(&turned)[1..], flags(&whole)[1..], "{}", closed.name);
    }
}

/// The parts at each point.
fn parts_at(scene: &SceneState, points: &[DVec3]) -> Vec<Vec<PartAt>> {
    let mut all = Vec::new();
    scene.parts_at(points, &mut |_, parts| all.push(parts.to_vec())).expect("parts");
    assert_eq!(all.len(), points.len());
    all
}

fn a_point_is_in_the_parts_around_it() {
    let context = built::context(1);
    let models = twelve();
    let named = |name| models.iter().find(|closed| closed.name == name).expect("a model");
    let ids = |closed: &Closed, points: &[DVec3]| {
        let (scene, _) = built::scene(&context, &built::parts(&parts_of(closed)));
        let found = parts_at(&scene.state(), points);
        assert!(found.iter().flatten().all(|at| at.instance == 7 && at.winding == 1 && at.holds == Holds::Inside));
        found.iter().map(|at| at.iter().map(|at| at.part).collect::<Vec<_>>()).collect::<Vec<_>>()
    };
    let along = |x: [f64; 4]| x.map(|x| DVec3::new(x, 0.0, 0.0));
    let nested = ids(named("nested boxes"), &along([0.5, 1.5, 3.0, 4.5]));
    assert_eq!(nested, [vec![100, 101, 102], vec![100, 101], vec![100], vec![]]);
    assert_eq!(
        ids(named("coincident boxes"), &along([0.1, -1.9, -2.1, 3.9])),
        [vec![100, 101], vec![100, 101], vec![], vec![100, 101]]
    );
    // On faces, edges and corners that boxes share, and there is space on no other side.
    let touching = named("touching boxes");
    let lattice = |i: i32| DVec3::new(f64::from(i % 7) - 3.0, f64::from(i / 7) - 3.0, -2.0);
    let found = ids(touching, &(0..49).map(lattice).collect::<Vec<_>>());
    let inside = |i: i32| (lattice(i).x < 0.0 && lattice(i).y < 0.0, lattice(i).x > 0.0);
    for i in (0..49).filter(|&i| inside(i).0 || inside(i).1) {
        assert_eq!(found[i as usize].len(), 1, "{}: {:?}", lattice(i), found[i as usize]);
    }
    // Of the bottle: by parity.
    let bottle = ids(named("bottle of Klein"), &[DVec3::ZERO, DVec3::new(5.6, 0.01, 0.02)]);
    assert_eq!(bottle, [vec![], vec![100]]);
    let (scene, _) = built::scene(&context, &built::parts(&parts_of(named("box"))));
    assert_eq!(
        parts_at(&scene.state(), &[DVec3::NAN, DVec3::INFINITY, DVec3::ZERO]).iter().map(Vec::len).collect::<Vec<_>>(),
        [0, 0, 1]
    );
}

fn an_open_part_is_undecided_within_its_bounds() {
    let context = built::context(1);
    let closed = twelve().into_iter().find(|closed| closed.name == "nested boxes").expect("a model");
    let mut parts = parts_of(&closed);
    parts[1].tris.pop();
    // Inward: the winding number says so.
    parts[2].tris.iter_mut().for_each(|tri| tri.swap(0, 1));
    let (scene, _) = built::scene(&context, &built::parts(&parts));
    let at = |part, winding, holds| PartAt { instance: 7, part, winding, holds };
    let all = [at(100, 1, Holds::Inside), at(101, 0, Holds::Undecided), at(102, -1, Holds::Inside)];
    let points = [0.5, 1.5, 3.0].map(|x| DVec3::new(0.1, x, 0.2));
    assert_eq!(parts_at(&scene.state(), &points), [all.to_vec(), all[..2].to_vec(), all[..1].to_vec()]);
    // Hidden parts hold nothing.
    scene.set_part_look(7, 101, Look { visible: false, ..Look::default() }).expect("a look");
    scene.set_part_look(7, 100, Look { visible: false, ..Look::default() }).expect("a look");
    scene.commit().expect("a commit");
    assert_eq!(parts_at(&scene.state(), &points), [all[2..].to_vec(), vec![], vec![]]);
}

fn thickness_is_the_distance_to_the_opposite_side() {
    let context = built::context(1);
    let closed = twelve().into_iter().find(|closed| closed.name == "nested boxes").expect("a model");
    let file = built::parts(&parts_of(&closed));
    let model = Model::open(&context, &file.path).expect("a model");
    let scene = Scene::new(&context);
    let turn = DQuat::from_rotation_y(0.3) * DQuat::from_rotation_x(0.8);
    let map = DAffine3::from_scale_rotation_translation(DVec3::new(-2.0, 2.0, 2.0), turn, DVec3::new(100.0, 5.0, -7.0));
    scene.add_instance(&model, 7, DAffine3::IDENTITY).expect("an instance");
    scene.add_instance(&model, 8, map).expect("an instance");
    scene.commit().expect("a commit");
    let state = scene.state();
    let mut rays = vec![Ray::new(DVec3::new(0.3, 0.2, 9.0), Vec3::NEG_Z), Ray::new(DVec3::splat(50.0), Vec3::Z)];
    rays.push(Ray { t_min: 6.0, ..rays[0] });
    rays.push(Ray::new(map.transform_point3(rays[0].origin), map.transform_vector3(-DVec3::Z).as_vec3()));
    // From inside, through the wall of the large box: into the space outside.
    rays.push(Ray::new(DVec3::new(0.3, 0.2, 3.0), Vec3::Z));
    // An edge of all quads.
    rays.push(Ray::new(DVec3::new(0.0, 0.0, 9.0), Vec3::NEG_Z));
    let hits = ask(&state, &rays, QueryOptions::default());
    let found = state.thickness(&hits).expect("thickness");
    let expected = [8.0, f64::INFINITY, 4.0, 16.0, f64::INFINITY, 8.0];
    for ((found, expected), hit) in found.iter().zip(expected).zip(&hits) {
        assert!(*found == expected || (found - expected).abs() < 1e-5, "{found}, not {expected}: {hit:?}");
    }
}
