//! Calls for few rays: each goes its own way through the query API, and all answer as a large batch does.

use crate::common::asked::{ask, rays};
use crate::common::built::{self, Part};
use crate::common::scenes;
use glam::{DAffine3, DQuat, DVec3, Vec3};
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, Hits, Policy, QueryOptions, Want};
use outcrop::scene::{Model, Scene, SceneState};
use std::cell::RefCell;
use std::sync::{Arc, Mutex};

const COHERENT: QueryOptions = QueryOptions { coherent: true, want: Want::ALL, policy: Policy::Exact };
const SINGLE: QueryOptions = QueryOptions { coherent: false, ..COHERENT };

/// Batches of one chunk are answered at once, and rays of which there are one or two each alone; what lacks blocks goes
/// on in rounds. Each answer is that of the whole batch, in a model of which nothing is in memory as in one of which
/// all is, and is written once.
fn few_rays_at_a_time_are_answered_as_many_are_and_each_once() {
    struct Once(Mutex<Vec<Option<Hit>>>);
    impl Hits for Once {
        fn write(&self, first: usize, hits: &[Hit]) {
            for (place, hit) in self.0.lock().unwrap()[first..].iter_mut().zip(hits) {
                assert!(place.replace(*hit).is_none(), "written twice");
            }
        }
    }
    let (rings, boxes) = built::sized((150, 3000), (40, 300));
    let parts = [Part::white(1, scenes::sphere(rings, 2 * rings)), Part::white(2, scenes::boxes(boxes, 4))];
    let file = built::parts(&parts);
    let context = built::context(1);
    let (scene, _) = built::scene(&context, &file);
    let mut rays = rays(600, 12, DVec3::ZERO, 3.0);
    let fan = |i: i32| Vec3::new((i % 8 - 4) as f32 / 40.0, (i / 8 % 75 - 37) as f32 / 40.0, -1.0);
    rays.extend((0..600).map(|i| Ray {
        cone: Cone { b: 0.003 * (i % 3) as f32, ..Cone::ZERO },
        ..Ray::new(DVec3::new(0.1, 0.2, 3.0), fan(i))
    }));
    // Widths that are none.
    rays.iter_mut().step_by(17).for_each(|ray| ray.cone.a = -1.0);
    let expected = ask(&scene.state(), &rays, SINGLE);
    let met = expected.iter().filter(|hit| hit.kind != HitKind::Miss).count();
    assert!((300..1100).contains(&met), "{met} of {}", rays.len());
    let cold = || {
        let model = Model::open_cold(&context, &file.path).unwrap();
        let scene = Scene::new(&context);
        scene.add_instance(&model, 7, DAffine3::IDENTITY).unwrap();
        scene.commit().unwrap();
        (scene, model)
    };
    for few in [1, 2, 3, 5, 33, 34, 600, 1200] {
        for is_cold in [false, true] {
            let (colds, model) = cold();
            let (colds_any, _) = cold();
            let [state, state_any] =
                if is_cold { [colds.state(), colds_any.state()] } else { [scene.state(), scene.state()] };
            for (rays, expected) in rays.chunks(few).zip(expected.chunks(few)) {
                let once = Once(Mutex::new(vec![None; rays.len()]));
                state.closest_batch(&rays, &once, SINGLE).unwrap();
                let got: Vec<Hit> = once.0.into_inner().unwrap().into_iter().map(|hit| hit.expect("written")).collect();
                let differ = (0..got.len()).find(|&i| got[i] != expected[i]);
                assert_eq!(differ.map(|i| (got[i], expected[i])), None, "{few} at a time, cold: {is_cold}");
                let mut any = vec![2u8; rays.len()];
                state_any.any(rays, COHERENT, &mut any).unwrap();
                assert!(
                    expected.iter().zip(&any).all(|(h, &a)| u8::from(h.kind != HitKind::Miss) == a),
                    "{few} at a time, cold: {is_cold}"
                );
            }
            assert_eq!(model.memory().resident > 0, is_cold);
        }
    }
    // Whatever is asked for, in scenes of one tree and of several, turned ones and some that the rays do not see.
    let several = Scene::new(&context);
    let (_, model) = cold();
    for (id, axis, mask) in [(1, DVec3::X, 1), (2, DVec3::Y, 2), (3, DVec3::Z, u32::MAX)] {
        several
            .add_instance(
                &model,
                id,
                DAffine3::from_rotation_translation(DQuat::from_axis_angle(axis, 0.7), axis * 0.4),
            )
            .unwrap();
        several.set_instance_mask(id, mask).unwrap();
    }
    several.commit().unwrap();
    for state in [scene.state(), several.state()] {
        for want in [Want::NOTHING, Want::NORMAL | Want::UV | Want::PART, Want::POSITION | Want::INSTANCE, Want::ALL] {
            let (options, mut asked) = (QueryOptions { want, ..SINGLE }, rays.clone());
            asked.iter_mut().step_by(3).for_each(|ray| ray.mask = 1);
            asked.iter_mut().step_by(31).for_each(|ray| ray.t_min = -1.0);
            let many = ask(&state, &asked, options);
            for few in [1, 2, 4] {
                let each: Vec<Hit> = asked.chunks(few).flat_map(|rays| ask(&state, rays, options)).collect();
                let differ = (0..each.len()).find(|&i| each[i] != many[i]);
                assert_eq!(differ.map(|i| (each[i], many[i])), None, "{few} at a time, {want:?}");
            }
        }
    }
    assert!(ask(&scene.state(), &[], SINGLE).is_empty());
    // Without waiting, of a model of which a part is in memory.
    let (part, _) = cold();
    ask(&part.state(), &rays[..9], SINGLE);
    for options in [
        QueryOptions { policy: Policy::Now, ..SINGLE },
        QueryOptions { policy: Policy::Now, want: Want::NORMAL | Want::UV, ..SINGLE },
    ] {
        let now = ask(&part.state(), &rays, options);
        for kind in [HitKind::Miss, HitKind::Exact, HitKind::Missing] {
            assert!(now.iter().any(|hit| hit.kind == kind), "{kind:?}");
        }
        for (ray, now) in rays.iter().zip(&now) {
            assert_eq!(ask(&part.state(), &[*ray], options)[0], *now, "{ray:?}");
        }
    }
    // From several threads, each by itself.
    std::thread::scope(|scope| {
        for first in 0..4 {
            let (scene, rays, expected) = (&scene, &rays, &expected);
            scope.spawn(move || {
                for i in (0..rays.len()).map(|i| (i + first * 300) % rays.len()) {
                    assert_eq!(ask(&scene.state(), &rays[i..=i], SINGLE)[0], expected[i], "{:?}", rays[i]);
                }
            });
        }
    });
}

/// A host's thread may ask in what runs while it ends, after what it kept for such calls has gone.
fn a_thread_may_ask_while_it_ends() {
    struct AsksLast(Arc<SceneState>, Ray, Arc<Mutex<Vec<Hit>>>);
    impl Drop for AsksLast {
        fn drop(&mut self) {
            let mut answers = self.2.lock().unwrap();
            answers.extend(ask(&self.0, &[self.1], SINGLE));
            // As a batch of one chunk, and of several.
            [40, 3000].iter().for_each(|&count| answers.push(ask(&self.0, &vec![self.1; count], SINGLE)[count - 1]));
        }
    }
    thread_local! {
        static LAST: RefCell<Option<AsksLast>> = const { RefCell::new(None) };
    }
    let file = built::parts(&[Part::white(1, scenes::sphere(20, 40))]);
    let context = built::context(1);
    let (scene, _) = built::scene(&context, &file);
    let (state, ray) = (scene.state(), Ray::new(DVec3::new(0.1, 0.2, 3.0), Vec3::NEG_Z));
    let expected = ask(&state, &[ray], SINGLE);
    let answers = Arc::new(Mutex::new(Vec::new()));
    let last = AsksLast(Arc::clone(&state), ray, Arc::clone(&answers));
    // First the one that asks in the end: what is made later goes earlier, or the other way round.
    std::thread::spawn(move || {
        LAST.with(|place| *place.borrow_mut() = Some(last));
        [1, 40, 3000].iter().for_each(|&count| drop(ask(&state, &vec![ray; count], SINGLE)));
    })
    .join()
    .unwrap();
    let last = AsksLast(scene.state(), ray, Arc::clone(&answers));
    std::thread::spawn(move || {
        [1, 40, 3000].iter().for_each(|&count| drop(ask(&last.0, &vec![ray; count], SINGLE)));
        LAST.with(|place| *place.borrow_mut() = Some(last));
    })
    .join()
    .unwrap();
    assert_eq!(*answers.lock().unwrap(), expected.repeat(6));
}

built::on_each_structure!(few_rays_at_a_time_are_answered_as_many_are_and_each_once, a_thread_may_ask_while_it_ends,);
