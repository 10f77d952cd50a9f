//! Scenes in scenes against the same instances in one scene: the same hits, whatever the depth and the transforms.

use crate::common::asked::ask;
use crate::common::built::{self, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use outcrop::base::error::Error;
use outcrop::math::{Cone, DBounds, Ray};
use outcrop::query::{Hit, HitKind, NONE, NearestOptions, NearestPoint, QueryOptions};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::camera::{Camera, PixelRays};
use outcrop::scene::{Context, Instances, Look, Model, Prototypes, Scene, SceneState, Transforms};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

/// Turned, some mirrored, some sheared.
fn place(rng: &mut Rng, reach: f64) -> DAffine3 {
    let turn = DQuat::from_axis_angle(rng.direction(), rng.between(0.0, 3.0));
    let scale = DVec3::new(rng.between(0.6, 1.2), if rng.one_in(3) { -0.8 } else { 1.0 }, 1.0);
    let shear =
        if rng.one_in(3) { DMat3::from_cols(DVec3::X, DVec3::new(0.4, 1.0, 0.0), DVec3::Z) } else { DMat3::IDENTITY };
    let at = rng.inside(DVec3::splat(-reach), DVec3::splat(reach));
    DAffine3 { matrix3: DMat3::from_quat(turn) * shear * DMat3::from_diagonal(scale), translation: at }
}

/// What a scene of one level has: its instances, and their ways.
type Flat = Vec<(DAffine3, Look, u32, Vec<u64>)>;

/// A scene of one instance.
fn one(context: &Context, model: &Model, rng: &mut Rng) -> (Scene, Flat) {
    let (scene, map) = (Scene::new(context), place(rng, 1.0));
    scene.add_instance(model, 77, map).expect("an instance");
    scene.commit().expect("a commit");
    (scene, vec![(map, Look::default(), u32::MAX, vec![77])])
}

/// Adds an array of scenes of different sizes, one hidden and one selected.
fn add_array(scene: &Scene, prototypes: [&(Scene, Flat); 2], (rng, reach): (&mut Rng, f64), flat: &mut Flat) {
    const FIRST: u64 = 30;
    let prototype_of = [0, 1, 1, 0, 1];
    let maps = prototype_of.map(|_| place(rng, reach));
    let instances = Instances {
        prototypes: Prototypes::Scenes(prototypes.map(|it| it.0.clone()).to_vec()),
        prototype_of: Arc::from(prototype_of),
        transforms: Transforms::Affine(maps.to_vec().into()),
        first_id: FIRST,
        mask: 7,
        masks: None,
        tints: None,
    };
    scene.add_instances(&instances).expect("an array of scenes");
    let looks = [1, 3].map(|i| Look { visible: i != 1, selected: i == 3, ..Look::default() });
    scene.set_instance_look(FIRST + 1, looks[0]).expect("a look");
    scene.set_instance_look(FIRST + 3, looks[1]).expect("a look");
    scene.set_instance_mask(FIRST + 4, 6).expect("a mask");
    for (i, (at, prototype)) in maps.iter().zip(prototype_of).enumerate() {
        let look = if i % 2 == 1 { looks[i / 2] } else { Look::default() };
        for (map, inner, inner_mask, path) in &prototypes[prototype as usize].1 {
            let both = Look {
                visible: look.visible && inner.visible,
                selected: look.selected || inner.selected,
                ..Look::default()
            };
            let path = [FIRST + i as u64].iter().chain(path).copied().collect();
            flat.push((*at * *map, both, inner_mask & if i == 4 { 6 } else { 7 }, path));
        }
    }
}

/// A scene of so many levels, and its instances in order.
fn nested(context: &Context, model: &Model, levels: usize, rng: &mut Rng) -> (Scene, Flat) {
    let scene = Scene::new(context);
    let reach = 2.0 * 1.6f64.powi(levels as i32);
    let mut flat: Flat = Vec::new();
    for id in 0..2 {
        let (at, look) = (place(rng, reach), Look { selected: rng.one_in(2), ..Look::default() });
        scene.add_instance(model, id, at).expect("an instance");
        scene.set_instance_look(id, look).expect("a look");
        flat.push((at, look, u32::MAX, vec![id]));
    }
    let maps: Vec<DAffine3> = (0..3).map(|_| place(rng, reach)).collect();
    let (prototypes, prototype_of) = (vec![model.clone()].into(), Arc::from([]));
    let transforms = Transforms::Affine(maps.clone().into());
    let (first_id, mask) = (10, 3);
    let all = Instances { prototypes, prototype_of, transforms, first_id, mask, masks: None, tints: None };
    scene.add_instances(&all).expect("an array");
    let hidden = Look { visible: false, ..Look::default() };
    scene.set_instance_look(11, hidden).expect("a look");
    for (i, map) in maps.into_iter().enumerate() {
        flat.push((map, if i == 1 { hidden } else { Look::default() }, 3, vec![10 + i as u64]));
    }
    if levels > 1 {
        let below = nested(context, model, levels - 1, rng);
        let (inner, of_inner) = &below;
        for id in 20..22 {
            let (at, mask) = (place(rng, reach), if id == 20 { u32::MAX } else { 2 });
            let look = Look { visible: !rng.one_in(5), selected: id == 21, ..Look::default() };
            scene.add_scene(inner, id, at).expect("a scene");
            scene.set_instance_look(id, look).expect("a look");
            scene.set_instance_mask(id, mask).expect("a mask");
            for (map, inner, inner_mask, path) in of_inner {
                let visible = look.visible && inner.visible;
                let both = Look { visible, selected: look.selected || inner.selected, ..Look::default() };
                let path = [id].iter().chain(path).copied().collect();
                flat.push((at * *map, both, mask & inner_mask, path));
            }
        }
        let single = one(context, model, rng);
        add_array(&scene, [&below, &single], (rng, reach), &mut flat);
    }
    scene.commit().expect("a commit");
    (scene, flat)
}

fn flattened(context: &Context, model: &Model, flat: &Flat, by: DVec3) -> Scene {
    let scene = Scene::new(context);
    for (id, (map, look, mask, _)) in (0..).zip(flat) {
        let moved = DAffine3 { translation: map.translation + by, ..*map };
        scene.add_instance(model, id, moved).expect("an instance");
        scene.set_instance_look(id, *look).expect("a look");
        scene.set_instance_mask(id, *mask).expect("a mask");
    }
    scene.commit().expect("a commit");
    scene
}

pub fn closest(state: &SceneState, rays: &[Ray], coherent: bool) -> Vec<Hit> {
    ask(state, rays, QueryOptions { coherent, ..QueryOptions::default() })
}

/// Five levels, also 10⁷ from zero: the same hits, occurrences, ways and looks as in one scene. Rounding of the
/// transforms' products is the only difference.
#[test]
fn scenes_in_scenes_equal_one_flat_scene() {
    let context = built::context(1);
    let file = built::parts(&[Part::white(5, scenes::bumpy_sphere(8, 12, 3)), Part::white(6, scenes::sphere(6, 8))]);
    let model = Model::open(&context, &file.path).expect("a model");
    for (levels, by) in [(1, DVec3::ZERO), (2, DVec3::ZERO), (5, DVec3::ZERO), (5, DVec3::new(1e7, -2e7, 3e7))] {
        let (scene, flat) = nested(&context, &model, levels, &mut Rng::new(levels as u64));
        let outer = Scene::new(&context);
        outer.add_scene(&scene, 99, DAffine3::from_translation(by)).expect("a scene");
        outer.commit().expect("a commit");
        let one = flattened(&context, &model, &flat, by);
        let (state, one) = (outer.state(), one.state());
        assert_eq!(state.instance_count(), flat.len());
        let (mut rng, reach) = (Rng::new(5), 2.0 * 1.6f64.powi(levels as i32));
        let rays: Vec<Ray> = (0..3000)
            .map(|i| {
                let [eye, to] = [2.0, 1.0].map(|k| rng.inside(DVec3::splat(-k * reach), DVec3::splat(k * reach)));
                let mask = if i % 4 == 0 { 2 } else { u32::MAX };
                Ray { mask, ..Ray::new(by + eye, (to - eye).as_vec3().normalize()) }
            })
            .collect();
        let size = (by.abs().max_element() + 4.0 * reach) * 1e-6;
        for coherent in [false, true] {
            let (a, b) = (closest(&state, &rays, coherent), closest(&one, &rays, coherent));
            let same = |a: &Hit, b: &Hit| {
                let alike = (a.kind, a.part, a.prim, a.occurrence) == (b.kind, b.part, b.prim, b.occurrence);
                alike && (a.kind == HitKind::Miss || (a.t - b.t).abs() < size.max(1e-5))
            };
            let differ = a.iter().zip(&b).filter(|(a, b)| !same(a, b)).count();
            // Rounding decides at the edges of triangles.
            assert!(differ <= 6, "{levels} levels: {differ} differ");
            let met: Vec<&Hit> = a.iter().filter(|hit| hit.kind != HitKind::Miss).collect();
            assert!(met.len() > 60, "{} hits", met.len());
            for hit in met {
                assert_eq!(hit.instance, 99);
                let (path, world_from_model) = state.path(hit.occurrence).expect("a way");
                let (map, .., ids) = &flat[hit.occurrence as usize];
                assert_eq!((path[0], &path[1..]), (99, &ids[..]));
                let moved = DAffine3 { translation: map.translation + by, ..*map };
                assert!(world_from_model.abs_diff_eq(moved, size * 1e-3));
            }
        }
        let far = flat.len() as u64;
        assert!(state.path(far).is_none() && state.path(NONE).is_none() && state.path(far - 1).is_some());
        let points: Vec<DVec3> = rays.iter().take(100).map(|ray| ray.origin).collect();
        let [a, b] = [&state, &one].map(|state| {
            let mut out = vec![NearestPoint::MISS; points.len()];
            state.nearest(&points, &NearestOptions::default(), &mut out).expect("points");
            out
        });
        assert!(a.iter().zip(&b).all(|(a, b)| (a.distance - b.distance).abs() < size.max(1e-6)));
        let around = DBounds { min: by - reach, max: by + reach };
        let parts = |state: &SceneState| state.overlap_box(&around).expect("parts").len();
        // Of all that is in a scene each part is named once.
        assert!(parts(&state) == 2 && parts(&one) > 2, "{} {}", parts(&state), parts(&one));
        let wide: Vec<Ray> = rays.iter().map(|ray| Ray { cone: Cone { a: 0.0, b: 0.05 }, ..*ray }).collect();
        let kinds = |state: &SceneState| {
            let hits = closest(state, &wide, false);
            [HitKind::Exact, HitKind::Lod].map(|kind| hits.iter().filter(|hit| hit.kind == kind).count())
        };
        let (a, b) = (kinds(&state), kinds(&one));
        assert!(a[1] > 20 && (0..2).all(|i| a[i].abs_diff(b[i]) < 20), "{a:?} {b:?}");
    }
}

/// The look of one place of an instance is that of this instance alone in one flat scene. It stays where it is when
/// other instances change the numbers, and is forgotten with the way there.
#[test]
fn one_place_of_an_instance_has_a_look_of_its_own() {
    let context = built::context(1);
    let file = built::parts(&[Part::white(5, scenes::bumpy_sphere(8, 12, 3))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let (scene, flat) = nested(&context, &model, 3, &mut Rng::new(31));
    let one = flattened(&context, &model, &flat, DVec3::ZERO);
    let mut rng = Rng::new(8);
    let rays: Vec<Ray> = (0..4000)
        .map(|_| {
            let [eye, to] = [18.0, 9.0].map(|k| rng.inside(DVec3::splat(-k), DVec3::splat(k)));
            Ray::new(eye, (to - eye).as_vec3().normalize())
        })
        .collect();
    let occurrences = |state: &SceneState, shift: u64| {
        let hits = closest(state, &rays, false);
        hits.iter().map(|hit| if hit.kind == HitKind::Miss { NONE } else { hit.occurrence - shift }).collect::<Vec<_>>()
    };
    let met: BTreeSet<u64> = occurrences(&scene.state(), 0).into_iter().filter(|it| *it != NONE).collect();
    let chosen: Vec<u64> = met.iter().copied().step_by(3).collect();
    assert!(chosen.len() > 8 && chosen.iter().any(|it| flat[*it as usize].3.len() == 3), "{chosen:?}");
    let hidden = Look { visible: false, ..Look::default() };
    for &occurrence in &chosen {
        scene.set_occurrence_look(occurrence, hidden).expect("a look");
        one.set_instance_look(occurrence, hidden).expect("a look");
    }
    let before = scene.state();
    scene.commit().expect("a commit");
    one.commit().expect("a commit");
    let without = occurrences(&one.state(), 0);
    assert!(without.iter().all(|it| !chosen.contains(it)));
    let differ = |a: &[u64], b: &[u64]| a.iter().zip(b).filter(|(a, b)| a != b).count();
    // Rounding decides at edges.
    assert!(differ(&occurrences(&scene.state(), 0), &without) <= 6);
    assert!(occurrences(&before, 0).iter().any(|it| chosen.contains(it)), "what began before has no look");
    // Around it all is as it was, and another instance has the first number.
    let outer = Scene::new(&context);
    outer.add_instance(&model, 1, DAffine3::from_translation(DVec3::X * 1e4)).expect("an instance");
    outer.add_scene(&scene, 2, DAffine3::IDENTITY).expect("a scene");
    outer.commit().expect("a commit");
    let shifted = |state: &SceneState| {
        occurrences(state, 0).iter().map(|it| if *it == NONE { NONE } else { it - 1 }).collect::<Vec<_>>()
    };
    assert!(differ(&shifted(&outer.state()), &without) <= 6);
    let shown = |state: &SceneState| occurrences(state, 0).into_iter().find(|it| *it != NONE).expect("a hit");
    let first = shown(&outer.state());
    let (path, _) = outer.state().path(first).expect("a way");
    outer.set_occurrence_look(first, hidden).expect("a look");
    outer.add_instance(&model, 3, DAffine3::from_translation(DVec3::X * 2e4)).expect("an instance");
    outer.commit().expect("a commit");
    assert!(!occurrences(&outer.state(), 0).contains(&(first + 1)) && first != 0);
    assert_eq!(outer.state().path(first + 1).expect("a way").0, path);
    outer.set_occurrence_look(first + 1, Look::default()).expect("a look");
    outer.commit().expect("a commit");
    assert!(occurrences(&outer.state(), 0).contains(&(first + 1)));
    outer.set_occurrence_look(first + 1, hidden).expect("a look");
    outer.remove_instance(2).expect("removed");
    outer.commit().expect("a commit");
    outer.add_scene(&scene, 2, DAffine3::IDENTITY).expect("a scene");
    outer.commit().expect("a commit");
    assert!(occurrences(&outer.state(), 0).contains(&(first + 1)), "it was forgotten");
    assert!(matches!(outer.set_occurrence_look(1 << 40, hidden), Err(Error::BadArgument(_))));
}

/// A commit takes the scenes in it as they were committed last; what began before keeps what it began with.
#[test]
fn a_commit_takes_scenes_as_they_are() {
    let context = built::context(0);
    let file = built::parts(&[Part::white(5, scenes::cuboid(DVec3::splat(-0.5), DVec3::splat(0.5)))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let [outer, middle, inner] = [(); 3].map(|()| Scene::new(&context));
    inner.add_instance(&model, 1, DAffine3::IDENTITY).expect("an instance");
    middle.add_scene(&inner, 2, DAffine3::from_translation(DVec3::X * 10.0)).expect("a scene");
    outer.add_scene(&middle, 3, DAffine3::from_translation(DVec3::Y * 10.0)).expect("a scene");
    outer.add_scene(&inner, 4, DAffine3::IDENTITY).expect("a scene");
    let met = |state: &SceneState| {
        let down = |x, y| Ray::new(DVec3::new(x, y, 9.0), -glam::Vec3::Z);
        let rays = [down(10.0, 10.0), down(0.0, 0.0), down(12.0, 10.0), down(2.0, 0.0)];
        closest(state, &rays, false).iter().map(|hit| hit.instance).collect::<Vec<_>>()
    };
    // Nothing in it was committed.
    outer.commit().expect("a commit");
    assert_eq!(met(&outer.state()), [NONE; 4]);
    inner.commit().expect("a commit");
    outer.commit().expect("a commit");
    assert_eq!(met(&outer.state()), [NONE, 4, NONE, NONE]);
    middle.commit().expect("a commit");
    outer.commit().expect("a commit");
    let before = outer.state();
    assert_eq!(met(&before), [3, 4, NONE, NONE]);
    inner.set_transform(1, DAffine3::from_translation(DVec3::X * 2.0)).expect("a transform");
    inner.commit().expect("a commit");
    outer.commit().expect("a commit");
    // The one in the middle still has it as it was.
    assert_eq!(met(&outer.state()), [3, NONE, NONE, 4]);
    middle.commit().expect("a commit");
    outer.set_transform(4, DAffine3::from_translation(DVec3::X * -2.0)).expect("a transform");
    outer.commit().expect("a commit");
    assert_eq!(met(&outer.state()), [NONE, 4, 3, NONE]);
    outer.remove_instance(4).expect("removed");
    outer.commit().expect("a commit");
    assert_eq!(met(&outer.state()), [NONE, NONE, 3, NONE]);
    assert_eq!(met(&before), [3, 4, NONE, NONE]);
    let bad = |result: outcrop::Result<()>, why: &str| match result {
        Err(Error::BadArgument(said)) => assert!(said.contains(why), "{said}"),
        other => panic!("{why}: {other:?}"),
    };
    bad(inner.add_scene(&outer, 9, DAffine3::IDENTITY), "in itself");
    bad(inner.add_scene(&middle, 9, DAffine3::IDENTITY), "in itself");
    bad(inner.add_scene(&inner, 9, DAffine3::IDENTITY), "in itself");
    bad(outer.add_scene(&inner, 3, DAffine3::IDENTITY), "instance 3 already exists");
    bad(outer.add_instance(&model, 3, DAffine3::IDENTITY), "instance 3 already exists");
    bad(outer.add_scene(&inner, 9, DAffine3::from_scale(DVec3::ZERO)), "singular");
    bad(outer.add_scene(&Scene::new(&built::context(0)), 9, DAffine3::IDENTITY), "another context");
    let array = |scene: &Scene| Instances {
        prototypes: Prototypes::Scenes(vec![scene.clone()]),
        prototype_of: Arc::from([]),
        transforms: Transforms::Affine([DAffine3::IDENTITY; 2].into()),
        first_id: 50,
        mask: 1,
        masks: None,
        tints: None,
    };
    bad(inner.add_instances(&array(&outer)), "in itself");
    bad(inner.add_instances(&array(&inner)), "in itself");
    bad(outer.add_instances(&array(&Scene::new(&built::context(0)))), "another context");
    bad(
        outer.add_instances(&Instances { prototypes: Prototypes::Scenes(Vec::new()), ..array(&inner) }),
        "at least one",
    );
    outer.add_instances(&array(&inner)).expect("an array");
    bad(outer.set_part_look(51, 5, Look::default()), "is a scene");
    bad(outer.remove_instances(51), "begins with 51");
    bad(inner.add_scene(&outer, 9, DAffine3::IDENTITY), "in itself");
    outer.remove_instances(50).expect("removed");
    bad(outer.set_part_look(3, 5, Look::default()), "is a scene");
    bad(outer.clear_part_looks(3), "is a scene");
    bad(outer.set_model(3, &model), "instance 3");
    bad(outer.remove_instance(4), "instance 4");
}

/// Each transform alone is sound, all together are not.
#[test]
fn transforms_that_are_singular_together_are_refused() {
    let context = built::context(0);
    let file = built::parts(&[Part::white(5, scenes::cuboid(DVec3::splat(-0.5), DVec3::splat(0.5)))]);
    let model = Model::open(&context, &file.path).expect("a model");
    for scale in [DVec3::new(1e-9, 1.0, 1.0), DVec3::splat(1e90)] {
        let [outer, inner] = [(); 2].map(|()| Scene::new(&context));
        inner.add_instance(&model, 1, DAffine3::from_scale(scale)).expect("an instance");
        inner.commit().expect("a commit");
        outer.add_scene(&inner, 7, DAffine3::from_scale(scale)).expect("a scene");
        match outer.commit() {
            Err(Error::BadArgument(why)) => assert!(why.contains("scene 7"), "{why}"),
            other => panic!("{other:?}"),
        }
        assert_eq!(outer.state().instance_count(), 0);
        outer.set_transform(7, DAffine3::IDENTITY).expect("a transform");
        outer.commit().expect("a commit");
    }
}

/// Two scenes at each of many levels, each with both of the level below: looked through once each.
#[test]
fn scenes_with_many_ways_are_looked_through_once() {
    let context = built::context(0);
    let mut below = [Scene::new(&context), Scene::new(&context)];
    let first = below[0].clone();
    for _ in 0..60 {
        let level = [Scene::new(&context), Scene::new(&context)];
        for outer in &level {
            for (id, inner) in (0..).zip(&below) {
                outer.add_scene(inner, id, DAffine3::IDENTITY).expect("a scene");
            }
        }
        below = level;
    }
    assert!(matches!(first.add_scene(&below[1], 1, DAffine3::IDENTITY), Err(Error::BadArgument(_))));
    // There is nothing in them.
    below[1].commit().expect("a commit");
    assert_eq!(below[1].state().instance_count(), 0);
}

/// Members of an array of scenes that move are where a scene with them there from the start has them; what began before
/// has them where they were.
#[test]
fn scenes_of_an_array_move() {
    const COUNT: usize = 400;
    let context = built::context(0);
    let file = built::parts(&[Part::white(5, scenes::bumpy_sphere(6, 8, 3))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let mut rng = Rng::new(12);
    let inner = nested(&context, &model, 2, &mut rng).0;
    let mut maps: Vec<DAffine3> = (0..COUNT).map(|_| place(&mut rng, 60.0)).collect();
    let (small, other) = (one(&context, &model, &mut rng).0, place(&mut rng, 40.0));
    let scene_of = |maps: &[DAffine3]| {
        let scene = Scene::new(&context);
        scene.add_instance(&model, 5000, other).expect("an instance");
        scene.add_scene(&inner, 5001, other).expect("a scene");
        let prototypes = vec![model.clone()].into();
        let (prototype_of, transforms) = (Arc::from([]), Transforms::Affine([other; 3].into()));
        let (first_id, mask) = (6000, u32::MAX);
        let all = Instances { prototypes, prototype_of, transforms, first_id, mask, masks: None, tints: None };
        scene.add_instances(&all).expect("an array");
        let prototypes = Prototypes::Scenes(vec![inner.clone(), Scene::new(&context), small.clone()]);
        let prototype_of = (0..maps.len() as u32).map(|i| i % 3).collect();
        let transforms = Transforms::Affine(maps.to_vec().into());
        let all =
            Instances { prototypes, prototype_of, transforms, first_id: 0, mask: u32::MAX, masks: None, tints: None };
        scene.add_instances(&all).expect("an array");
        scene.commit().expect("a commit");
        scene
    };
    let rays: Vec<Ray> = (0..800)
        .map(|_| {
            let [eye, to] = [90.0, 50.0].map(|k| rng.inside(DVec3::splat(-k), DVec3::splat(k)));
            Ray::new(eye, (to - eye).as_vec3().normalize())
        })
        .collect();
    let key = |hit: &Hit| (hit.kind, hit.occurrence, hit.part, hit.prim, hit.t.to_bits());
    let hits = |state: &SceneState| closest(state, &rays, false).iter().map(key).collect::<Vec<_>>();
    let scene = scene_of(&maps);
    for round in 0..4 {
        let (before, was) = (scene.state(), hits(&scene.state()));
        for _ in 0..5 {
            let at = rng.below(COUNT);
            maps[at] = place(&mut rng, 55.0);
            scene.set_transform(at as u64, maps[at]).expect("a transform");
        }
        scene.commit().expect("a commit");
        assert!(hits(&before) == was, "{round}");
        let now = hits(&scene.state());
        assert!(now == hits(&scene_of(&maps).state()) && now != was, "{round}");
        let bounds = [scene.state().bounds(), scene_of(&maps).state().bounds()];
        let size = bounds[0].extent().max_element() * 2e-3;
        assert!((bounds[0].min - bounds[1].min).abs().max_element() < size, "{round}");
    }
    assert!(hits(&scene.state()).iter().filter(|hit| hit.0 == HitKind::Exact).count() > 100);
    let turned = Transforms::Affine([DAffine3::from_scale(DVec3::new(1e-9, 1.0, 1.0))].into());
    scene.set_transforms(6, &turned).expect("a transform");
    match scene.commit() {
        Err(Error::BadArgument(why)) => assert!(why.contains("scene 6"), "{why}"),
        other => panic!("{other:?}"),
    }
}

/// The occurrences of a picture are those of picks of its pixels, and lead to the instances that it shows.
#[test]
fn pictures_name_occurrences() {
    let context = built::context(1);
    let file = built::parts(&[Part::white(5, scenes::bumpy_sphere(8, 12, 3)), Part::white(6, scenes::sphere(6, 8))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let (scene, flat) = nested(&context, &model, 3, &mut Rng::new(3));
    let state = scene.state();
    let outputs = [Buffer::Occurrence, Buffer::Instance, Buffer::Kind].map(Outputs::of);
    let outputs = outputs.into_iter().fold(Outputs(0), |all, one| all | one);
    let (width, height) = (64, 48);
    let frame = Frame::new(&context, FrameOptions { width, height, outputs, ..FrameOptions::default() });
    let frame = frame.expect("a frame");
    let eye = DVec3::new(0.3, -24.0, 6.0);
    let camera = Camera::Perspective { eye, at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 50.0 };
    for poe in [0.0, 6.0] {
        frame.request(&state, &camera, &FrameSettings { poe, ..FrameSettings::default() }).expect("a request");
        assert_eq!(frame.wait(Duration::from_secs(120)).state, FrameState::Converged);
        let ids = |buffer| frame.map(buffer).expect("a buffer").ids().expect("ids").to_vec();
        let (occurrences, instances) = (ids(Buffer::Occurrence), ids(Buffer::Instance));
        let kinds = frame.map(Buffer::Kind).expect("a buffer").bytes().to_vec();
        let mut seen = BTreeSet::new();
        for (pixel, (&occurrence, &instance)) in occurrences.iter().zip(&instances).enumerate() {
            let is_miss = kinds[pixel] == HitKind::Miss as u8;
            assert_eq!(is_miss, occurrence == NONE);
            if is_miss {
                continue;
            }
            let (ids, map) = state.path(occurrence).expect("a way");
            // The id of an instance in a scene is that of the scene.
            assert_eq!(ids[0], instance);
            assert_eq!(flat[occurrence as usize].3, ids);
            assert!(map.abs_diff_eq(flat[occurrence as usize].0, 1e-9));
            seen.insert(occurrence);
            if kinds[pixel] == HitKind::Exact as u8 {
                let (x, y) = (pixel as u32 % width, pixel as u32 / width);
                let hit = frame.pick(x, y).expect("a hit");
                assert_eq!((hit.occurrence, hit.instance), (occurrence, instance), "{x}, {y}");
            }
        }
        assert!(seen.len() > 8, "{} occurrences", seen.len());
        let has_cells = kinds.contains(&(HitKind::Lod as u8));
        assert_eq!(has_cells, poe > 0.0);
    }
}

/// The ray whose hit a pixel of a picture shows: through its centre, as wide as the threshold makes the pixel there.
/// The threshold is dithered, by the additive recurrence of the plastic number in steps of 1/256.
fn ray_of(rays: &PixelRays, (x, y): (u32, u32), poe: f32) -> Ray {
    const PLASTIC: f64 = 1.324_717_957_244_746;
    let part = |power: i32| (PLASTIC.powi(-power) * 4_294_967_296.0) as u32;
    let step = x.wrapping_mul(part(1)).wrapping_add(y.wrapping_mul(part(2))) >> 24;
    let factor = poe.sqrt() * (0.5 * ((f64::from(step) + 0.5) / 256.0 - 0.5)).exp2() as f32;
    let ray = rays.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
    Ray { cone: Cone { a: ray.cone.a * factor, b: ray.cone.b * factor }, ..ray }
}

pub fn seen_from(eye: DVec3, at: DVec3, fov_y_degrees: f64) -> Camera {
    Camera::Perspective { eye, at, up: DVec3::Z, fov_y_degrees }
}

/// A picture whose occurrences, of triangles and stand-ins, are in each pixel those of the hit that a query with the
/// pixel's ray returns, also if no other buffer is asked for. Returns the hits.
pub fn hits_of_a_picture(context: &Context, state: &Arc<SceneState>, camera: &Camera, poe: f32) -> Vec<Hit> {
    let (width, height) = (90, 70);
    let rendered = |outputs: Outputs| {
        let frame = Frame::new(context, FrameOptions { width, height, outputs, ..FrameOptions::default() });
        let frame = frame.expect("a frame");
        frame.request(state, camera, &FrameSettings { poe, ..FrameSettings::default() }).expect("a request");
        assert_eq!(frame.wait(Duration::from_secs(120)).state, FrameState::Converged);
        frame
    };
    let (frame, alone) = (rendered(Outputs::ALL), rendered(Outputs::of(Buffer::Occurrence)));
    let ids = |frame: &Frame, buffer| frame.map(buffer).expect("a buffer").ids().expect("ids").to_vec();
    let (occurrences, instances) = (ids(&frame, Buffer::Occurrence), ids(&frame, Buffer::Instance));
    assert!(ids(&alone, Buffer::Occurrence) == occurrences, "{camera:?} at {poe}: other buffers change it");
    let kinds = frame.map(Buffer::Kind).expect("a buffer").bytes().to_vec();
    let rays = camera.prepare(width, height).expect("rays");
    let rays: Vec<Ray> = (0..width * height).map(|i| ray_of(&rays, (i % width, i / width), poe)).collect();
    let [hits, coherent] = [false, true].map(|coherent| closest(state, &rays, coherent));
    for (i, (a, b)) in hits.iter().zip(&coherent).enumerate() {
        let shown = (kinds[i], occurrences[i], instances[i]);
        assert_eq!(shown, (a.kind as u8, a.occurrence, a.instance), "{camera:?} at {poe}, pixel {i}");
        assert_eq!(shown, (b.kind as u8, b.occurrence, b.instance), "{camera:?} at {poe}, pixel {i}");
    }
    hits
}

/// Pictures name each place of a mesh, in the array and in inner scenes, by a number of its own.
fn occurrences_of_pictures_are_those_of_queries() {
    let context = built::context(2);
    // Triangles of a pixel in the second view.
    let rings = built::sized(140, 40);
    let bumpy = scenes::bumpy_sphere(rings, rings * 3 / 2, 3);
    let file = built::parts(&[Part::white(5, bumpy), Part::white(6, scenes::sphere(30, 40))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let (scene, flat) = nested(&context, &model, 2, &mut Rng::new(2));
    let state = scene.state();
    let eye = DVec3::new(0.3, -24.0, 6.0);
    let cameras = [
        seen_from(eye, DVec3::ZERO, 30.0),
        // A member of the array fills the picture: packets that enter one tree are traced in bundles.
        seen_from(eye, flat[2].0.translation, 4.0),
        Camera::Orthographic { eye, at: DVec3::ZERO, up: DVec3::Z, height: 12.0 },
    ];
    let (mut places, mut stand_ins) = (BTreeMap::<u64, BTreeSet<u64>>::new(), 0);
    for (camera, poe) in cameras.iter().flat_map(|camera| [0.0, 3.0].map(|poe| (camera, poe))) {
        let hits = hits_of_a_picture(&context, &state, camera, poe);
        for hit in hits.iter().filter(|hit| hit.kind != HitKind::Miss) {
            places.entry(hit.instance).or_default().insert(hit.occurrence);
        }
        let [exact, cells] =
            [HitKind::Exact, HitKind::Lod].map(|kind| hits.iter().filter(|hit| hit.kind == kind).count());
        // The few triangles of other structures are larger than the threshold in the second view.
        let least = built::sized(500, 0);
        assert!(if poe == 0.0 { exact > 500 && cells == 0 } else { cells >= least }, "{poe}: {exact} {cells}");
        stand_ins += cells;
    }
    assert!(stand_ins > 50, "{stand_ins} stand-ins");
    let seen = |instance| places.get(&instance).map_or(0, BTreeSet::len);
    assert_eq!([10, 11, 12].map(seen), [1, 0, 1], "the second member is hidden: {places:?}");
    assert!(seen(20) > 2 && seen(21) > 2, "{places:?}");
    let all: Vec<u64> = places.values().flatten().copied().collect();
    assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), all.len(), "two instances share one: {places:?}");
}

/// Of places that coincide, pictures and queries name the same: the first.
fn pictures_name_the_first_of_places_that_coincide() {
    let context = built::context(2);
    let file = built::parts(&[Part::white(5, scenes::bumpy_sphere(60, 90, 3)), Part::white(6, scenes::sphere(30, 40))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let (inner, flat) = nested(&context, &model, 2, &mut Rng::new(2));
    let scene = Scene::new(&context);
    (0..3).for_each(|id| scene.add_scene(&inner, id, DAffine3::IDENTITY).expect("a scene"));
    scene.commit().expect("a commit");
    let (state, eye) = (scene.state(), DVec3::new(0.3, -24.0, 6.0));
    for camera in [seen_from(eye, DVec3::ZERO, 30.0), seen_from(eye, flat[2].0.translation, 4.0)] {
        for poe in [0.0, 3.0] {
            let hits = hits_of_a_picture(&context, &state, &camera, poe);
            let met: Vec<&Hit> = hits.iter().filter(|hit| hit.kind != HitKind::Miss).collect();
            assert!(met.len() > 500 && met.iter().all(|hit| hit.instance == 0), "{camera:?} at {poe}");
        }
    }
}

built::on_each_structure!(
    occurrences_of_pictures_are_those_of_queries,
    pictures_name_the_first_of_places_that_coincide,
);
