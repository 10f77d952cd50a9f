//! Scenes in scenes at many levels, with more occurrences than 32 bits have numbers for.

use crate::common::built::{self, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use crate::nested::closest;
use glam::{DAffine3, DMat3, DVec3};
use outcrop::base::error::Error;
use outcrop::base::progress::Cancel;
use outcrop::math::{DBounds, Ray};
use outcrop::query::{Hit, HitKind, NearestOptions, NearestPoint};
use outcrop::render::{Frame, FrameOptions, FrameSettings, FrameState};
use outcrop::scene::camera::Camera;
use outcrop::scene::{
    Context, ContextOptions, Fit, Instances, Lens, Look, Model, Place, Prototypes, Scene, Scope, Transforms,
};
use std::sync::Arc;
use std::time::Duration;

/// 64 levels work; more are refused by the commit, and none are too many to drop.
#[test]
fn levels_are_limited() {
    let context = built::context(0);
    let file = built::parts(&[Part::white(5, scenes::cuboid(DVec3::splat(-0.5), DVec3::splat(0.5)))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let mut inner = Scene::new(&context);
    inner.add_instance(&model, 1, DAffine3::IDENTITY).expect("an instance");
    inner.commit().expect("a commit");
    for level in 2..=65 {
        let outer = Scene::new(&context);
        outer.add_scene(&inner, level, DAffine3::from_translation(DVec3::X)).expect("a scene");
        match outer.commit() {
            Ok(()) => assert!(level <= 64),
            Err(Error::BadArgument(why)) => assert!(level > 64 && why.contains("64 levels"), "{level}: {why}"),
            other => panic!("{other:?}"),
        }
        if level == 64 {
            let state = outer.state();
            let hit = closest(&state, &[Ray::new(DVec3::new(63.0, 0.0, 9.0), -glam::Vec3::Z)], false)[0];
            assert!((hit.t - 8.5).abs() < 1e-6 && hit.instance == 64, "{hit:?}");
            let (ids, place) = state.path(hit.occurrence).expect("a way");
            assert_eq!((ids.len(), ids[62], ids[63], place.translation.x), (64, 2, 1, 63.0));
        }
        inner = outer;
    }
    for _ in 0..3_000 {
        let outer = Scene::new(&context);
        outer.add_scene(&inner, 1, DAffine3::IDENTITY).expect("a scene");
        inner = outer;
    }
    drop(inner);
}

/// More placed trees than numbers are refused; fewer take memory for the scenes that were added alone.
#[test]
fn too_many_occurrences_are_refused() {
    let context = built::context(0);
    let file = built::parts(&[Part::white(5, scenes::cuboid(DVec3::ZERO, DVec3::ONE))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let mut inner = Scene::new(&context);
    let transforms = Transforms::Affine(vec![DAffine3::IDENTITY; 1 << 16].into());
    let (prototypes, prototype_of) = (vec![model].into(), Arc::from([]));
    inner
        .add_instances(&Instances {
            prototypes,
            prototype_of,
            transforms,
            first_id: 0,
            mask: 1,
            masks: None,
            tints: None,
        })
        .expect("an array");
    inner.commit().expect("a commit");
    let before = context.memory_used();
    for level in 1..=5 {
        let outer = Scene::new(&context);
        (0..1 << 10).for_each(|id| outer.add_scene(&inner, id, DAffine3::IDENTITY).expect("a scene"));
        match outer.commit() {
            Ok(()) => assert!(level < 5),
            Err(Error::BadArgument(why)) => assert!(level == 5 && why.contains("2^63"), "{level}: {why}"),
            other => panic!("{other:?}"),
        }
        if level < 5 {
            let count = 1u64 << (16 + 10 * level);
            assert_eq!(outer.state().instance_count() as u64, count);
            assert!(outer.state().path(count).is_none() && outer.state().path(count - 1).is_some());
        }
        inner = outer;
    }
    // Some 700 bytes a scene.
    let each = (context.memory_used() - before) / (5 << 10);
    assert!(each < 900, "{each} bytes for each scene");
}

/// Where a cell of [`dust`] is, given its digits from the outermost level to the innermost.
fn cell(digits: &[u64]) -> (DVec3, f64) {
    digits.iter().fold((DVec3::ZERO, 1.0), |(middle, size), digit| {
        let side = |axis: u64| (digit >> axis & 1) as f64 * 2.0 - 1.0;
        (middle + DVec3::new(side(0), side(1), side(2)) * (0.25 * size), size * 0.5)
    })
}

/// A scene of 8^levels cubes in the unit cube around zero, and ids from the outermost level to the innermost.
fn dust(context: &Context, model: &Model, levels: u64) -> Scene {
    let mut inner: Option<Scene> = None;
    for level in 0..levels {
        let scene = Scene::new(context);
        let first_id = 10 * (level + 1);
        let places = (0..8).map(|digit| {
            let (position, size) = cell(&[digit]);
            Place { position, rotation: [0.0, 0.0, 0.0, 1.0], scale: size as f32 }
        });
        let places: Vec<Place> = places.collect();
        match &inner {
            Some(inner) if level % 3 == 1 => {
                for (id, it) in (first_id..).zip(&places) {
                    let map = DAffine3 {
                        matrix3: DMat3::from_diagonal(DVec3::splat(it.scale.into())),
                        translation: it.position,
                    };
                    scene.add_scene(inner, id, map).expect("a scene");
                }
            }
            _ => {
                let prototypes = inner.map_or(vec![model.clone()].into(), |it| Prototypes::Scenes(vec![it]));
                let (prototype_of, transforms) = (Arc::from([]), Transforms::Places(places.into()));
                let all = Instances {
                    prototypes,
                    prototype_of,
                    transforms,
                    first_id,
                    mask: u32::MAX,
                    masks: None,
                    tints: None,
                };
                scene.add_instances(&all).expect("an array");
            }
        }
        scene.commit().expect("a commit");
        inner = Some(scene);
    }
    inner.expect("a level")
}

/// 2^48 cubes: a ray from before a cube meets it, and its occurrence, ids and map are those of its place.
#[test]
fn occurrences_beyond_32_bits_are_met_in_their_places() {
    const LEVELS: u64 = 16;
    let context = built::context(1);
    let file = built::parts(&[Part::white(5, scenes::cuboid(DVec3::splat(-0.2), DVec3::splat(0.2)))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let before = context.memory_used();
    let scene = dust(&context, &model, LEVELS);
    assert!(context.memory_used() - before < 200_000, "{} bytes", context.memory_used() - before);
    let state = scene.state();
    assert_eq!(state.instance_count(), 1 << (3 * LEVELS));
    let mut rng = Rng::new(9);
    let places: Vec<Vec<u64>> = (0..600).map(|_| (0..LEVELS).map(|_| rng.below(8) as u64).collect()).collect();
    let rays: Vec<Ray> = places
        .iter()
        .enumerate()
        .map(|(i, digits)| {
            let (middle, size) = cell(digits);
            let side = [DVec3::X, -DVec3::Y, DVec3::Z][i % 3];
            Ray::new(middle + side * (0.4 * size), -side.as_vec3())
        })
        .collect();
    // Packets, streams, and single rays.
    let together = [false, true].map(|coherent| closest(&state, &rays, coherent));
    let alone: Vec<Hit> = rays.iter().take(50).map(|ray| closest(&state, &[*ray], false)[0]).collect();
    for hits in together.iter().chain([&alone]) {
        for ((hit, digits), ray) in hits.iter().zip(&places).zip(&rays) {
            let (middle, size) = cell(digits);
            let number = digits.iter().fold(0, |number, digit| number * 8 + digit);
            assert_eq!((hit.kind, hit.occurrence, hit.part), (HitKind::Exact, number, 5), "{digits:?}");
            assert!((hit.t - 0.2 * size).abs() < 1e-4 * size, "{digits:?}: {} of {size}", hit.t);
            assert_eq!(hit.instance, 10 * LEVELS + digits[0]);
            let (ids, map) = state.path(number).expect("a way");
            let expected: Vec<u64> = (0..LEVELS).map(|k| 10 * (LEVELS - k) + digits[k as usize]).collect();
            assert_eq!(ids, expected);
            assert!(map.translation.distance(middle) < 1e-12 && ray.origin.distance(middle) < size);
        }
    }
    let half = 0.5 - 0.3 / f64::from(1 << LEVELS);
    let bounds = state.bounds();
    let is_near = |x: f64| (0.0..1e-3).contains(&(x - half + 1e-12));
    assert!(bounds.max.to_array().into_iter().chain((-bounds.min).to_array()).all(is_near), "{bounds:?}");
    // Searches go down to few of them.
    let (middle, size) = cell(&places[0]);
    let near = DBounds { min: middle - 0.1 * size, max: middle + 0.1 * size };
    assert!(state.overlap_box(&near).expect("parts").is_empty(), "it lies inside the cube");
    let wall = DBounds { min: middle - 0.25 * size, max: middle + 0.25 * size };
    assert_eq!(state.overlap_box(&wall).expect("parts").len(), 1);
    let mut nearest = vec![NearestPoint::MISS; 20];
    let points: Vec<DVec3> = places.iter().take(20).map(|digits| cell(digits).0).collect();
    state.nearest(&points, &NearestOptions::default(), &mut nearest).expect("points");
    assert!(nearest.iter().all(|it| (it.distance / size - 0.2).abs() < 1e-4), "{nearest:?}");
    let triangles = state.triangles(&together[0][..5], &Cancel::default()).expect("triangles");
    assert_eq!(triangles.len(), 5);
    let fit = Fit { direction: DVec3::Y, up: DVec3::Z, lens: Lens::Orthographic, size: (100, 100), margin: 0.0 };
    match state.fit(&fit, &[], Scope::Own).expect("a camera") {
        Camera::Orthographic { height, .. } => assert!((height - 2.0 * half).abs() < 4e-3, "{height}"),
        other => panic!("{other:?}"),
    }
}

/// Many levels of flat squares side by side: what is at the bounds is looked at only where it matters.
#[test]
fn flat_scenes_have_bounds_at_once() {
    const LEVELS: u32 = 14;
    let context = built::context(0);
    let file = built::parts(&[Part::white(5, scenes::cuboid(DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0)))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let mut inner: Option<Scene> = None;
    for level in 0..LEVELS {
        let (scene, side) = (Scene::new(&context), f64::from(1 << level));
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE - DVec3::Z];
        for (id, corner) in (0..).zip(corners) {
            let map = DAffine3::from_translation(corner * side);
            match &inner {
                None => scene.add_instance(&model, id, map).expect("an instance"),
                Some(inner) => scene.add_scene(inner, id, map).expect("a scene"),
            }
        }
        scene.commit().expect("a commit");
        inner = Some(scene);
    }
    let (bounds, side) = (inner.expect("a scene").state().bounds(), f64::from(1 << LEVELS));
    let off = (bounds.min.abs()).max((bounds.max - DVec3::new(side, side, 0.0)).abs());
    assert!(off.max_element() < side * 1e-3, "{bounds:?}");
}

/// Searches do not go down to what is in a hidden scene.
#[test]
fn hidden_scenes_are_passed_by() {
    let context = built::context(1);
    let file = built::parts(&[Part::white(5, scenes::cuboid(DVec3::splat(-0.2), DVec3::splat(0.2)))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let dust = dust(&context, &model, 14);
    let scene = Scene::new(&context);
    scene.add_scene(&dust, 1, DAffine3::IDENTITY).expect("a scene");
    let prototypes = Prototypes::Scenes(vec![dust.clone()]);
    let (prototype_of, transforms) = (Arc::from([]), Transforms::Affine([DAffine3::IDENTITY; 2].into()));
    let all = Instances { prototypes, prototype_of, transforms, first_id: 2, mask: u32::MAX, masks: None, tints: None };
    scene.add_instances(&all).expect("an array");
    scene.add_instance(&model, 9, DAffine3::from_translation(DVec3::X * 0.5)).expect("an instance");
    let hidden = Look { visible: false, ..Look::default() };
    (1..3).for_each(|id| scene.set_instance_look(id, hidden).expect("a look"));
    // The last is visible to other rays alone.
    scene.set_instance_mask(3, 2).expect("a mask");
    scene.commit().expect("a commit");
    let state = scene.state();
    let rays: Vec<Ray> = (0..64)
        .map(|i| {
            let at = DVec3::new(-0.6 + f64::from(i) * 0.02, -2.0, 0.05);
            Ray { mask: 1, ..Ray::new(at, glam::Vec3::Y) }
        })
        .collect();
    for coherent in [false, true] {
        for (ray, hit) in rays.iter().zip(closest(&state, &rays, coherent)) {
            let is_met = (ray.origin.x - 0.5).abs() < 0.2;
            assert_eq!((hit.kind != HitKind::Miss, hit.instance == 9), (is_met, is_met), "{ray:?}");
        }
    }
    scene.set_instance_look(3, hidden).expect("a look");
    scene.commit().expect("a commit");
    let state = scene.state();
    let mut nearest = [NearestPoint::MISS];
    state.nearest(&[DVec3::ZERO], &NearestOptions::default(), &mut nearest).expect("a point");
    assert!((nearest[0].distance - 0.3).abs() < 1e-6, "{nearest:?}");
    let fit = Fit { direction: DVec3::Y, up: DVec3::Z, lens: Lens::Orthographic, size: (10, 10), margin: 0.0 };
    match state.fit(&fit, &[], Scope::Own).expect("a camera") {
        Camera::Orthographic { height, .. } => assert!((height - 0.4).abs() < 1e-3, "{height}"),
        other => panic!("{other:?}"),
    }
    // Nothing is beside a hidden scene.
    let alone = Scene::new(&context);
    alone.add_scene(&dust, 1, DAffine3::IDENTITY).expect("a scene");
    alone.set_instance_look(1, hidden).expect("a look");
    alone.commit().expect("a commit");
    for coherent in [false, true] {
        let hits = closest(&alone.state(), &rays, coherent);
        assert!(hits.iter().all(|hit| hit.kind == HitKind::Miss));
    }
    let all = DBounds { min: DVec3::splat(-2.0), max: DVec3::splat(2.0) };
    assert!(alone.state().overlap_box(&all).expect("parts").is_empty());
    let parts = state.overlap_box(&all).expect("parts");
    assert!(parts.len() == 1 && parts[0].instance == 9, "{parts:?}");
    let options = FrameOptions { width: 48, height: 32, ..FrameOptions::default() };
    let frame = Frame::new(&context, options).expect("a frame");
    let camera = Camera::Orthographic { eye: DVec3::Y * -4.0, at: DVec3::ZERO, up: DVec3::Z, height: 2.0 };
    frame.request(&state, &camera, &FrameSettings::default()).expect("a request");
    assert_eq!(frame.wait(Duration::from_secs(60)).state, FrameState::Converged);
}

/// Scenes with nothing in them take members of arrays, but no numbers.
#[test]
fn empty_scenes_of_arrays_have_no_occurrences() {
    let context = built::context(0);
    let file = built::parts(&[Part::white(5, scenes::cuboid(DVec3::splat(-0.2), DVec3::splat(0.2)))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let (empty, two) = (Scene::new(&context), Scene::new(&context));
    for id in 0..2 {
        let map = DAffine3::from_translation(DVec3::Y * id as f64);
        two.add_instance(&model, id, map).expect("an instance");
    }
    two.commit().expect("a commit");
    let scene = Scene::new(&context);
    scene.add_scene(&empty, 1, DAffine3::IDENTITY).expect("a scene");
    let add = |first_id: u64, prototypes: Vec<Scene>, prototype_of: &[u32]| {
        let maps = (first_id..).map(|id| DAffine3::from_translation(DVec3::X * id as f64));
        let transforms = Transforms::Affine(maps.take(prototype_of.len()).collect());
        let (prototypes, prototype_of) = (Prototypes::Scenes(prototypes), Arc::from(prototype_of));
        scene
            .add_instances(&Instances {
                prototypes,
                prototype_of,
                transforms,
                first_id,
                mask: 1,
                masks: None,
                tints: None,
            })
            .expect("an array");
    };
    add(10, vec![empty.clone()], &[0, 0, 0]);
    add(20, vec![empty.clone(), two.clone(), empty.clone()], &[0, 1, 2, 1, 0]);
    add(30, vec![empty.clone()], &[0]);
    add(40, vec![two.clone()], &[0, 0]);
    scene.commit().expect("a commit");
    let state = scene.state();
    assert_eq!(state.instance_count(), 8);
    let expected = [(21, 0), (21, 1), (23, 0), (23, 1), (40, 0), (40, 1), (41, 0), (41, 1)];
    for (number, (outer, inner)) in (0..).zip(expected) {
        let (ids, map) = state.path(number).expect("a way");
        assert_eq!(ids, [outer, inner]);
        assert_eq!(map.translation, DVec3::new(outer as f64, inner as f64, 0.0));
        let ray = Ray::new(map.translation + DVec3::Z, -glam::Vec3::Z);
        assert_eq!(closest(&state, &[ray], false)[0].occurrence, number);
    }
    assert!(state.path(8).is_none());
    scene.set_transform(12, DAffine3::from_translation(DVec3::ONE)).expect("a transform");
    scene.commit().expect("a commit");
    assert_eq!(scene.state().instance_count(), 8);
}

/// The error of an array of scenes that is over the budget names one that suffices.
#[test]
fn arrays_of_scenes_count_against_the_budget() {
    let file = built::parts(&[Part::white(5, scenes::cuboid(DVec3::splat(-0.2), DVec3::splat(0.2)))]);
    let mut budget = 8u64 << 20;
    for round in 0..3 {
        let context = Context::new(ContextOptions { threads: 0, memory_budget: budget, ..Default::default() })
            .expect("a context");
        let model = Model::open(&context, &file.path).expect("a model");
        let (inner, outer) = (Scene::new(&context), Scene::new(&context));
        inner.add_instance(&model, 0, DAffine3::IDENTITY).expect("an instance");
        inner.commit().expect("a commit");
        let maps = (0..40_000).map(|i| DAffine3::from_translation(DVec3::X * f64::from(i)));
        let prototypes = Prototypes::Scenes(vec![inner.clone()]);
        let (prototype_of, transforms) = (Arc::from([]), Transforms::Affine(maps.collect()));
        let all = Instances { prototypes, prototype_of, transforms, first_id: 0, mask: 1, masks: None, tints: None };
        match outer.add_instances(&all).and_then(|()| outer.commit()) {
            Ok(()) => {
                assert!(round > 0 && context.memory_used() <= budget);
                assert_eq!(outer.state().instance_count(), 40_000);
                return;
            }
            Err(Error::OverBudget { need, have, .. }) => {
                assert!(have == budget && need > have);
                budget = need;
            }
            other => panic!("{other:?}"),
        }
    }
    panic!("{budget} bytes do not suffice");
}
