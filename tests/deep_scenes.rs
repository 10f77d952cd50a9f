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
use outcrop::scene::camera::Camera;
use outcrop::scene::{Context, Fit, Instances, Lens, Model, Place, Prototypes, Scene, Scope, Transforms};
use std::sync::Arc;

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
    inner.add_instances(&Instances { prototypes, prototype_of, transforms, first_id: 0, mask: 1 }).expect("an array");
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
                let all = Instances { prototypes, prototype_of, transforms, first_id, mask: u32::MAX };
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
