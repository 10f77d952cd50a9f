//! Arrays of instances against the same instances added one by one: hits, pictures, queries and looks are equal to the
//! bit, for every form of transform; each takes a fraction of the memory.

use crate::common::asked::ask;
use crate::common::built::{self, Built, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DAffine3, DQuat, DVec3};
use outcrop::base::error::Error;
use outcrop::base::progress::Cancel;
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::{Cone, DBounds, Ray};
use outcrop::query::{Hit, HitKind, NearestOptions, NearestPoint, QueryOptions};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{
    Camera, Context, ContextOptions, Instances, Look, Model, Place, Scene, SceneState, Scope, Transforms,
};
use std::sync::Arc;
use std::time::Duration;

const FIRST: u64 = 1000;

/// Two parts, the second placed twice in the model itself.
fn assembly() -> Built {
    built::build(|builder| {
        for id in 0..3 {
            builder.part(PartDesc { id: Some(100 + id), ..Default::default() }).expect("a part");
        }
        builder.triangles(MeshKey::DIRECT, 0, &scenes::sphere(10, 12), Attributes::NONE).expect("triangles");
        let cube = builder.shared_mesh(1).expect("a mesh");
        builder.triangles(cube, 0, &scenes::cuboid(-DVec3::ONE, DVec3::ONE), Attributes::NONE).expect("triangles");
        for (i, part) in [(1.2, 1), (-1.3, 2)] {
            let place = DAffine3::from_scale_rotation_translation(
                DVec3::splat(0.3),
                DQuat::from_rotation_x(i),
                DVec3::new(i, 0.4, 0.2),
            );
            builder.instance(cube, place, part).expect("an instance");
        }
    })
}

/// The transforms in one form, and as affine maps.
fn transforms(form: usize, count: usize) -> (Transforms, Vec<DAffine3>) {
    let (mut rng, side) = (Rng::new(count as u64), (count as f64).sqrt() * 0.8);
    let mut place = || {
        let at = rng.inside(DVec3::new(-side, -side, -1.0), DVec3::new(side, side, 1.0));
        (at, DQuat::from_axis_angle(rng.direction(), rng.between(0.0, 3.0)), rng.between(0.5, 1.5), rng.one_in(4))
    };
    if form == 2 {
        let places: Arc<[Place]> = (0..count)
            .map(|_| {
                let (position, turn, scale, mirrors) = place();
                let scale = if mirrors { -scale } else { scale } as f32;
                Place { position, rotation: turn.to_array().map(|x| 3.0 * x as f32), scale }
            })
            .collect();
        let affine = |it: &Place| {
            let turn = DQuat::from_array(it.rotation.map(f64::from)).normalize();
            DAffine3 { matrix3: glam::DMat3::from_quat(turn) * f64::from(it.scale), translation: it.position }
        };
        let maps = places.iter().map(affine).collect();
        return (Transforms::Places(places), maps);
    }
    let maps: Vec<DAffine3> = (0..count)
        .map(|_| {
            let (at, turn, scale, mirrors) = place();
            let scale = if mirrors { DVec3::new(1.0, -0.5, 2.0) } else { DVec3::splat(scale) };
            DAffine3::from_scale_rotation_translation(scale, turn, at)
        })
        .collect();
    if form == 0 {
        return (Transforms::Affine(maps.clone().into()), maps);
    }
    let single: Vec<[f32; 12]> = maps.iter().map(|map| map.to_cols_array().map(|x| x as f32)).collect();
    let maps = single.iter().map(|map| DAffine3::from_cols_array(&map.map(f64::from))).collect();
    (Transforms::Affine32(single.into()), maps)
}

/// Two scenes of the same instances of two models beside one of their own: one by one, and as an array.
fn both(context: &Context, files: [&Built; 2], form: usize, count: usize) -> [Scene; 2] {
    let models = files.map(|file| Model::open(context, &file.path).expect("a model"));
    let (transforms, maps) = transforms(form, count);
    let prototype_of: Arc<[u32]> = (0..count as u32).map(|i| i % 3 % 2).collect();
    let scenes = [Scene::new(context), Scene::new(context)];
    for scene in &scenes {
        scene.add_instance(&models[1], 7, DAffine3::from_translation(DVec3::Z * 4.0)).expect("an instance");
    }
    for (i, map) in maps.iter().enumerate() {
        scenes[0].add_instance(&models[prototype_of[i] as usize], FIRST + i as u64, *map).expect("an instance");
    }
    let prototypes = models.to_vec().into();
    scenes[1]
        .add_instances(&Instances {
            prototypes,
            prototype_of,
            transforms,
            first_id: FIRST,
            mask: u32::MAX,
            masks: None,
            tints: None,
        })
        .expect("instances");
    for scene in &scenes {
        let mut rng = Rng::new(9);
        for id in (FIRST..FIRST + count as u64).filter(|_| rng.one_in(4)) {
            scene.set_instance_mask(id, 1 + id as u32 % 3).expect("a mask");
            let look = Look { visible: id % 5 != 0, colour: Some([1.0, 0.2, 0.0, 1.0]), selected: id % 2 == 0 };
            scene.set_instance_look(id, look).expect("a look");
        }
        let (hidden, part) =
            (Look { visible: false, ..Look::default() }, models[0].parts().iter().last().expect("one"));
        scene.set_parts_look(FIRST, &[part.id], Scope::Own, hidden).expect("a look");
        scene.commit().expect("a commit");
    }
    scenes
}

fn rays(count: usize) -> Vec<Ray> {
    let (mut rng, side) = (Rng::new(77), (count as f64).sqrt() * 0.8);
    let (low, high) = (DVec3::new(-side, -side, -1.0), DVec3::new(side, side, 1.0));
    (0..1500)
        .map(|i| {
            let (eye, to) =
                (rng.inside(low * 1.5 - DVec3::Z * 9.0, high * 1.5 + DVec3::Z * 9.0), rng.inside(low, high));
            let cone = if i % 3 == 0 { Cone { a: 0.02, b: 0.02 } } else { Cone::ZERO };
            let mask = if i % 5 == 0 { 2 } else { u32::MAX };
            Ray { cone, mask, ..Ray::new(eye, (to - eye).as_vec3().normalize()) }
        })
        .collect()
}

fn closest(state: &SceneState, rays: &[Ray], coherent: bool) -> Vec<Hit> {
    ask(state, rays, QueryOptions { coherent, ..QueryOptions::default() })
}

fn picture(context: &Context, state: &Arc<SceneState>, poe: f32) -> Vec<Vec<u8>> {
    let options = FrameOptions { width: 64, height: 48, outputs: Outputs::ALL, ..FrameOptions::default() };
    let frame = Frame::new(context, options).expect("a frame");
    let eye = DVec3::new(0.3, -14.0, 6.0);
    let camera = Camera::Perspective { eye, at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
    frame.request(state, &camera, &FrameSettings { poe, ..FrameSettings::default() }).expect("a request");
    assert_eq!(frame.wait(Duration::from_secs(120)).state, FrameState::Converged);
    Buffer::ALL.iter().map(|&buffer| frame.map(buffer).expect("a buffer").bytes().to_vec()).collect()
}

fn assert_equal(context: &Context, states: [&Arc<SceneState>; 2], count: usize) {
    let rays = rays(count);
    for coherent in [false, true] {
        let [one_by_one, array] = states.map(|state| closest(state, &rays, coherent));
        let hits = one_by_one.iter().filter(|hit| hit.kind != HitKind::Miss).count();
        assert!(hits > 50, "{hits} hits");
        assert!(one_by_one == array, "coherent: {coherent}");
    }
    let alone = |state: &Arc<SceneState>| -> Vec<Hit> {
        rays.iter().take(200).map(|ray| closest(state, std::slice::from_ref(ray), false)[0]).collect()
    };
    assert!(alone(states[0]) == alone(states[1]));
    for poe in [0.0, 3.0] {
        assert!(picture(context, states[0], poe) == picture(context, states[1], poe), "PoE {poe}");
    }
    let [a, b] = states.map(|state| state.bounds());
    assert_eq!((a.min, a.max), (b.min, b.max));
    let points: Vec<DVec3> = rays.iter().take(60).map(|ray| ray.origin).collect();
    let [a, b] = states.map(|state| {
        let mut out = vec![NearestPoint::MISS; points.len()];
        state.nearest(&points, &NearestOptions::default(), &mut out).expect("points");
        out
    });
    assert_eq!(a, b);
    let around = DBounds { min: DVec3::splat(-2.0), max: DVec3::new(2.0, 2.0, 4.5) };
    let [a, b] = states.map(|state| state.overlap_box(&around).expect("parts"));
    assert!(!a.is_empty());
    assert_eq!(a, b);
}

/// Members of an array are instances like others, whatever the form of their transforms; also after they were moved.
#[test]
fn members_of_an_array_are_instances() {
    let context = built::context(1);
    let (assembly, ball) = (assembly(), built::parts(&[Part::white(5, scenes::bumpy_sphere(8, 12, 3))]));
    for form in 0..3 {
        for count in [1, 60] {
            // With one tree for each member, and with several.
            for files in [[&assembly, &ball], [&ball, &ball]] {
                let scenes = both(&context, files, form, count);
                let [a, b] = scenes.each_ref().map(Scene::state);
                assert_eq!(a.instance_count(), count + 1);
                assert_equal(&context, [&a, &b], count);
                if form == 2 {
                    let to = DAffine3::from_translation(DVec3::X);
                    assert!(matches!(scenes[1].set_transform(FIRST, to), Err(Error::BadArgument(_))));
                    continue;
                }
                // The latter half takes the places of the first.
                let (half, moved) = (count / 2, transforms(form, count / 2));
                scenes[1].set_transforms(FIRST + half as u64, &moved.0).expect("transforms");
                for (i, map) in moved.1.iter().enumerate() {
                    scenes[0].set_transform(FIRST + (half + i) as u64, *map).expect("a transform");
                }
                for scene in &scenes {
                    let to = DAffine3::from_scale_rotation_translation(
                        DVec3::new(2.0, 1.0, 0.5),
                        DQuat::IDENTITY,
                        DVec3::new(0.5, 0.25, 2.0),
                    );
                    scene.set_transform(FIRST + count as u64 - 1, to).expect("a transform");
                    scene.commit().expect("a commit");
                }
                let [a, b] = scenes.each_ref().map(Scene::state);
                assert_equal(&context, [&a, &b], count);
            }
        }
    }
}

/// Few of many members move, again and again, inside of the scene and across its edge: hits, bounds and distances are
/// those of a scene in which all are placed anew.
#[test]
fn few_members_move_as_all_do() {
    let context = built::context(1);
    let (assembly, ball) = (assembly(), built::parts(&[Part::white(5, scenes::bumpy_sphere(8, 12, 3))]));
    let count = 200;
    for form in 0..3 {
        let scenes = both(&context, [&assembly, &ball], form, count);
        let mut rng = Rng::new(form as u64 + 1);
        for round in 0..12 {
            for _ in 0..3 {
                let member = rng.below(count) as u64;
                // Those that `transforms` makes, in other places: the last rounds leave the scene.
                let (to, maps) = transforms(form, 2 + round);
                let (to, map) = (last_of(&to), maps[1 + round]);
                let far = if round > 9 { DVec3::X * 40.0 * round as f64 } else { DVec3::ZERO };
                let (to, map) = (shifted(&to, far), DAffine3 { translation: map.translation + far, ..map });
                let map = match &to {
                    Transforms::Affine32(all) => DAffine3::from_cols_array(&all[0].map(f64::from)),
                    _ => map,
                };
                scenes[1].set_transforms(FIRST + member, &to).expect("a transform");
                scenes[0].set_transform(FIRST + member, map).expect("a transform");
            }
            scenes.iter().for_each(|scene| scene.commit().expect("a commit"));
            let [a, b] = scenes.each_ref().map(Scene::state);
            let [all, refitted] = [&a, &b].map(|state| state.bounds());
            assert_eq!((all.min, all.max), (refitted.min, refitted.max), "round {round}");
            let rays = rays(count);
            for coherent in [false, true] {
                assert!(closest(&a, &rays, coherent) == closest(&b, &rays, coherent), "form {form}, round {round}");
            }
            if round % 6 == 5 {
                assert_equal(&context, [&a, &b], count);
            }
        }
    }
}

/// The last of some transforms.
fn last_of(all: &Transforms) -> Transforms {
    match all {
        Transforms::Affine(all) => Transforms::Affine([all[all.len() - 1]].into()),
        Transforms::Affine32(all) => Transforms::Affine32([all[all.len() - 1]].into()),
        Transforms::Places(all) => Transforms::Places([all[all.len() - 1]].into()),
    }
}

/// A transform moved by `by`.
fn shifted(one: &Transforms, by: DVec3) -> Transforms {
    match one {
        Transforms::Affine(all) => {
            Transforms::Affine([DAffine3 { translation: all[0].translation + by, ..all[0] }].into())
        }
        Transforms::Affine32(all) => {
            let mut one = all[0];
            (0..3).for_each(|axis| one[9 + axis] += by[axis] as f32);
            Transforms::Affine32([one].into())
        }
        Transforms::Places(all) => Transforms::Places([Place { position: all[0].position + by, ..all[0] }].into()),
    }
}

/// A wrong instance is named, and nothing is added.
#[test]
fn wrong_arrays_are_refused() {
    let context = built::context(0);
    let file = built::parts(&[Part::white(5, scenes::cuboid(DVec3::ZERO, DVec3::ONE))]);
    let (model, scene) = (Model::open(&context, &file.path).expect("a model"), Scene::new(&context));
    let foreign = Model::open(&built::context(0), &file.path).expect("a model");
    scene.add_instance(&model, 5, DAffine3::IDENTITY).expect("an instance");
    let good = Instances {
        prototypes: vec![model.clone()].into(),
        prototype_of: Arc::new([]),
        transforms: Transforms::Affine(vec![DAffine3::IDENTITY; 4].into()),
        first_id: 6,
        mask: u32::MAX,
        masks: None,
        tints: None,
    };
    let with = |edit: &dyn Fn(&mut [DAffine3])| {
        let mut maps = vec![DAffine3::IDENTITY; 4];
        edit(&mut maps);
        Instances { transforms: Transforms::Affine(maps.into()), ..good.clone() }
    };
    let place = Place { position: DVec3::ZERO, rotation: [0.0, 0.0, 0.0, 1.0], scale: 1.0 };
    let places = |last: Place| Instances { transforms: Transforms::Places([place, last].into()), ..good.clone() };
    let wrong = [
        ("instance 2: ", with(&|maps| maps[2].matrix3.x_axis = DVec3::ZERO)),
        ("instance 3: ", with(&|maps| maps[3].translation.y = f64::NAN)),
        ("instance 0: ", with(&|maps| maps[0].matrix3.z_axis.z = f64::INFINITY)),
        ("instance 1: ", places(Place { scale: 0.0, ..place })),
        ("instance 1: ", places(Place { rotation: [0.0; 4], ..place })),
        ("instance 1: ", places(Place { position: DVec3::splat(f64::INFINITY), ..place })),
        ("instance 1 has prototype 1", Instances { prototype_of: Arc::new([0, 1, 0, 0]), ..good.clone() }),
        ("4 transforms, but 3", Instances { prototype_of: Arc::new([0; 3]), ..good.clone() }),
        ("at least one", Instances { prototypes: Vec::new().into(), ..good.clone() }),
        ("at least one", Instances { transforms: Transforms::Affine(Arc::new([])), ..good.clone() }),
        ("another context", Instances { prototypes: vec![foreign].into(), ..good.clone() }),
        ("instance 5 already exists", Instances { first_id: 2, ..good.clone() }),
        ("too many", Instances { first_id: u64::MAX - 3, ..good.clone() }),
    ];
    for (why, instances) in &wrong {
        match scene.add_instances(instances) {
            Err(Error::BadArgument(said)) => assert!(said.contains(why), "{said}"),
            other => panic!("{why}: {other:?}"),
        }
    }
    scene.add_instances(&good).expect("instances");
    for (why, instances) in [("6 already", &good), ("8 already", &Instances { first_id: 8, ..good.clone() })] {
        match scene.add_instances(instances) {
            Err(Error::BadArgument(said)) => assert!(said.contains(why), "{said}"),
            other => panic!("{why}: {other:?}"),
        }
    }
    assert!(matches!(scene.add_instance(&model, 9, DAffine3::IDENTITY), Err(Error::BadArgument(_))));
    let two = Transforms::Affine(vec![DAffine3::from_translation(DVec3::X); 2].into());
    let three = Transforms::Affine(vec![DAffine3::IDENTITY, DAffine3::IDENTITY, DAffine3::ZERO].into());
    for (first, transforms, why) in [
        (5, &two, "instance 5 is of no array"),
        (9, &two, "2 transforms, but 1 instances from 9 on"),
        (6, &three, "transform 2: "),
        (6, &Transforms::Places([place].into()), "another form"),
    ] {
        match scene.set_transforms(first, transforms) {
            Err(Error::BadArgument(said)) => assert!(said.contains(why), "{said}"),
            other => panic!("{why}: {other:?}"),
        }
    }
    assert!(matches!(scene.remove_instance(7), Err(Error::BadArgument(_))));
    assert!(matches!(scene.set_model(7, &model), Err(Error::BadArgument(_))));
    scene.commit().expect("a commit");
    assert_eq!(scene.state().instance_count(), 5);
    assert!(matches!(scene.remove_instances(7), Err(Error::BadArgument(_))));
    scene.remove_instances(6).expect("removed");
    scene.commit().expect("a commit");
    assert_eq!(scene.state().instance_count(), 1);
    scene.add_instances(&good).expect("the ids are free again");
}

/// All memory of an array counts against the budget. A scene over it keeps its last state.
#[test]
fn arrays_count_against_the_budget() {
    let file = built::parts(&[Part::white(5, scenes::cuboid(DVec3::ZERO, DVec3::ONE))]);
    let budget = 64 << 20;
    let context = Context::new(ContextOptions { memory_budget: budget, threads: 0, ..ContextOptions::default() })
        .expect("a context");
    let (model, scene) = (Model::open(&context, &file.path).expect("a model"), Scene::new(&context));
    model.load(&Cancel::new()).expect("it loads");
    let of = |count: usize, first_id| {
        let places: Vec<Place> = (0..count)
            .map(|i| Place {
                position: DVec3::new((i % 1000) as f64, (i / 1000) as f64, 0.0) * 3.0,
                rotation: [0.0, 0.0, 0.0, 1.0],
                scale: 1.0,
            })
            .collect();
        let transforms = Transforms::Places(places.into());
        Instances {
            prototypes: vec![model.clone()].into(),
            prototype_of: Arc::new([]),
            transforms,
            first_id,
            mask: u32::MAX,
            masks: None,
            tints: None,
        }
    };
    let before = context.memory_used();
    scene.add_instances(&of(100_000, 0)).expect("instances");
    scene.commit().expect("a commit");
    let each = (context.memory_used() - before) as f64 / 100_000.0;
    assert!((124.0..126.0).contains(&each), "{each} bytes an instance");
    // 350 MB: the transforms alone do not fit.
    match scene.add_instances(&of(2_000_000, 200_000)) {
        Err(Error::OverBudget { need, have, .. }) => assert!(need > have && have == budget),
        other => panic!("{other:?}"),
    }
    // The transforms fit, the tree over them does not.
    scene.add_instances(&of(500_000, 200_000)).expect("instances");
    assert!(matches!(scene.commit(), Err(Error::OverBudget { .. })));
    assert_eq!(scene.state().instance_count(), 100_000);
    scene.remove_instances(200_000).expect("removed");
    scene.commit().expect("a commit");
}
