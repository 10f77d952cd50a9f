//! Queries through the public API, against the f64 oracle.

use crate::common::asked::{ask, rays};
use crate::common::brute::{Oracle, Ray64, Tri};
use crate::common::built::{self, Part};
use crate::common::bvh64::Bvh64;
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DAffine3, DQuat, DVec3, Vec3};
use outcrop::math::{DBounds, Ray};
use outcrop::query::{Hit, HitKind, How, NONE, Policy, QueryOptions, QueryState, Want};
use outcrop::query::{Hits, Plane, Query, Rays};
use outcrop::scene::{Look, Model, Scene, SceneState};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const COHERENT: QueryOptions = QueryOptions { coherent: true, want: Want::ALL, policy: Policy::Exact };
const SINGLE: QueryOptions = QueryOptions { coherent: false, ..COHERENT };

fn sphere() -> Vec<Tri> {
    scenes::sphere(30, 60)
}

fn moved(tris: &[Tri], m: &DAffine3) -> Vec<Tri> {
    tris.iter().map(|t| t.map(|v| m.transform_point3(v))).collect()
}

/// Compares with the oracle over `tris`; `slack` is what single precision may do to a silhouette.
fn judge(rays: &[Ray], hits: &[Hit], oracle: &Bvh64, slack: f64) -> usize {
    let mut both = 0;
    for (ray, hit) in rays.iter().zip(hits) {
        let truth = oracle.closest(&Ray64::new(ray.origin, ray.dir.as_dvec3()));
        match (truth, hit.kind) {
            (None, HitKind::Miss) => {}
            (Some(t), HitKind::Exact) => {
                both += 1;
                let off = (t.t - hit.t).abs() * ray.dir.as_dvec3().length();
                assert!(off <= f64::from(hit.error) * 4.0 + slack, "{ray:?}: {hit:?}, oracle {t:?}");
                let position = ray.origin + ray.dir.as_dvec3() * hit.t;
                assert!(position.distance(hit.position) < slack);
                assert!(hit.t_free <= t.t, "a surface before t_free: {hit:?}, {t:?}");
                assert!(hit.normal.dot(ray.dir) <= 0.0 && (hit.normal.length() - 1.0).abs() < 1e-5);
            }
            // Only at silhouettes: the oracle must graze.
            _ => {
                let near = |d: DVec3| oracle.closest(&Ray64::new(ray.origin + d * slack, ray.dir.as_dvec3()));
                let axes = [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z];
                assert!(axes.iter().any(|&d| near(d).is_some() != truth.is_some()), "{ray:?}: {hit:?}, {truth:?}");
            }
        }
    }
    both
}

fn one_model_single_and_coherent_and_any() {
    let context = built::context(2);
    let tris = sphere();
    let file = built::parts(&[Part::white(42, tris.clone())]);
    let (scene, _) = built::scene(&context, &file);
    let (state, oracle) = (scene.state(), Bvh64::new(tris));
    let rays = rays(20_011, 1, DVec3::ZERO, 1.0);
    let hits = ask(&state, &rays, SINGLE);
    assert!(judge(&rays, &hits, &oracle, 1e-5) > 5000);
    assert_eq!(hits, ask(&state, &rays, COHERENT), "packets give other hits");
    let mut any = vec![9u8; rays.len()];
    for options in [SINGLE, COHERENT] {
        state.any(&rays, options, &mut any).unwrap();
        let same = hits.iter().zip(&any).all(|(h, &a)| (h.kind != HitKind::Miss) == (a == 1));
        assert!(same);
    }
    for (hit, ray) in hits.iter().zip(&rays).filter(|(h, _)| h.kind == HitKind::Exact) {
        assert_eq!((hit.part, hit.instance), (42, 7));
        let truth = oracle.closest(&Ray64::new(ray.origin, ray.dir.as_dvec3())).unwrap();
        if u64::from(truth.prim) != hit.prim {
            // A neighbour may be met instead at a shared edge.
            assert!(f64::from(hit.uv[0].min(hit.uv[1]).min(1.0 - hit.uv[0] - hit.uv[1])) < 1e-3, "{hit:?} {truth:?}");
        }
    }
}

fn only_what_is_asked_is_filled() {
    let context = built::context(1);
    let file = built::parts(&[Part::white(42, sphere())]);
    let (scene, _) = built::scene(&context, &file);
    let ray = Ray::new(DVec3::new(0.1, 0.2, 5.0), -Vec3::Z);
    let hit = |want| ask(&scene.state(), &[ray], QueryOptions { want, ..SINGLE })[0];
    let bare = hit(Want::NOTHING);
    assert_eq!(bare, Hit { t: bare.t, kind: HitKind::Exact, ..Hit::MISS });
    assert_eq!(hit(Want::PART), Hit { part: 42, ..bare });
    assert_eq!(hit(Want::INSTANCE), Hit { instance: 7, occurrence: 0, ..bare });
    assert_ne!(hit(Want::PRIM).prim, NONE);
    let all = hit(Want::ALL);
    assert!((all.t - bare.t).abs() < 1e-5 && all.error > 0.0 && all.error < 1e-6);
}

fn instances_turned_stretched_and_far_away() {
    let context = built::context(2);
    let tris = sphere();
    let file = built::parts(&[Part::white(1, tris.clone())]);
    let model = Model::open(&context, &file.path).unwrap();
    let turn = DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(1.0);
    let maps = [
        DAffine3::from_translation(DVec3::new(3.0, 0.0, 0.0)),
        DAffine3::from_scale_rotation_translation(DVec3::new(2.0, 0.5, 1.0), turn, DVec3::new(-3.0, 1.0, 0.0)),
        DAffine3::from_scale_rotation_translation(DVec3::new(-1.0, 1.0, 1.0), turn, DVec3::new(0.0, 4.0, 0.0)),
        DAffine3::from_scale_rotation_translation(DVec3::splat(0.01), turn, DVec3::new(0.0, -1.0, 0.0)),
    ];
    for far in [DVec3::ZERO, DVec3::new(1e7, -3e7, 2e7)] {
        let scene = Scene::new(&context);
        let mut all = Vec::new();
        for (i, m) in maps.iter().enumerate() {
            let m = DAffine3::from_translation(far) * *m;
            scene.add_instance(&model, 100 + i as u64, m).unwrap();
            all.extend(moved(&tris, &m));
        }
        scene.commit().unwrap();
        let oracle = Bvh64::new(all);
        let rays = rays(10_000, 3, far, 5.0);
        let hits = ask(&scene.state(), &rays, SINGLE);
        assert!(judge(&rays, &hits, &oracle, 4e-5) > 1000);
        assert_eq!(hits, ask(&scene.state(), &rays, COHERENT));
        for (hit, ray) in hits.iter().zip(&rays).filter(|(h, _)| h.kind == HitKind::Exact) {
            let truth = oracle.closest(&Ray64::new(ray.origin, ray.dir.as_dvec3()));
            let which = truth.map(|t| 100 + u64::from(t.prim) / tris.len() as u64);
            assert!(which == Some(hit.instance) || (truth.unwrap().t - hit.t).abs() < 1e-4);
        }
    }
}

fn rays_from_very_far_keep_the_models_detail() {
    let context = built::context(0);
    let tris = sphere();
    let file = built::parts(&[Part::white(1, tris.clone())]);
    let (scene, _) = built::scene(&context, &file);
    let oracle = Bvh64::new(tris);
    let mut rng = Rng::new(5);
    let rays: Vec<Ray> = (0..5000)
        .map(|_| {
            let to = rng.direction() * rng.unit() * 0.9;
            let from = rng.direction() * 2e4;
            Ray::new(from, (to - from).as_vec3())
        })
        .collect();
    // The direction is given in single precision: the oracle gets the same one.
    let hits = ask(&scene.state(), &rays, SINGLE);
    assert!(judge(&rays, &hits, &oracle, 1e-5) > 4000);
}

fn intervals_masks_and_impossible_rays() {
    let context = built::context(0);
    let file = built::parts(&[Part::white(1, scenes::cuboid(-DVec3::ONE, DVec3::ONE))]);
    let (scene, _) = built::scene(&context, &file);
    let ray = Ray::new(DVec3::new(0.1, 0.2, 5.0), -Vec3::Z);
    let state = scene.state();
    let t = |r: Ray| ask(&state, &[r], SINGLE)[0].t;
    assert_eq!(t(ray), 4.0);
    assert_eq!(t(Ray { t_min: 4.5, ..ray }), 6.0, "the face behind");
    assert_eq!(t(Ray { t_max: 3.9, ..ray }), f64::INFINITY);
    assert_eq!(t(Ray { t_max: 4.0, ..ray }), 4.0, "ends are included");
    assert_eq!(t(Ray { t_min: 7.0, ..ray }), f64::INFINITY);
    for bad in [
        Ray { dir: Vec3::ZERO, ..ray },
        Ray { dir: Vec3::NAN, ..ray },
        Ray { dir: Vec3::INFINITY, ..ray },
        Ray { origin: DVec3::NAN, ..ray },
        Ray { origin: DVec3::INFINITY, ..ray },
        Ray { t_min: f64::NAN, ..ray },
        Ray { t_max: f64::NAN, ..ray },
        Ray { t_min: 5.0, t_max: 3.0, ..ray },
        // To single precision the ends are equal, and a surface is between.
        Ray { t_min: 4.0 + 2e-8, t_max: 4.0 + 1e-8, ..ray },
    ] {
        let opposite = Ray { dir: -bad.dir, ..bad };
        for options in [SINGLE, COHERENT] {
            assert_eq!(ask(&state, &[bad], options)[0], Hit::MISS, "{bad:?}");
            assert_eq!(ask(&state, &[bad, opposite, bad], options)[0], Hit::MISS, "{bad:?} side by side");
            let mut any = [2; 1];
            state.any(&[bad], options, &mut any).unwrap();
            assert_eq!(any, [0], "{bad:?}");
        }
    }
    // Lengths of directions do not matter, but for the unit of t.
    for size in [1e-30f32, 1e-20, 1e-3, 1e3, 1e20, 1e30] {
        let found = t(Ray { dir: -Vec3::Z * size, ..ray });
        assert!((found * f64::from(size) - 4.0).abs() < 1e-6, "{size}: {found}");
    }
    // Before 0 counts as 0, in all of an answer: also on a face, and just above it.
    for z in [5.0, 1.0 + 1e-9, 1.0, 0.5] {
        let from = Ray { origin: DVec3::new(0.1, 0.2, z), ..ray };
        for options in [SINGLE, COHERENT] {
            let (least, zero) = (Ray { t_min: -1.0, ..from }, ask(&state, &[from], options)[0]);
            assert!(zero.t_free >= 0.0, "{zero:?}");
            for count in [1, 3, 40] {
                assert!(
                    ask(&state, &vec![least; count], options).iter().all(|hit| *hit == zero),
                    "from {z}, {count} rays"
                );
            }
        }
    }
    // Masks.
    struct Masked(Ray);
    impl Rays for Masked {
        fn count(&self) -> usize {
            3
        }
        fn read(&self, first: usize, out: &mut [Ray]) {
            for (i, out) in out.iter_mut().enumerate() {
                *out = Ray { mask: [1, 2, 0][first + i], ..self.0 };
            }
        }
    }
    struct Kinds(Mutex<Vec<HitKind>>);
    impl Hits for Kinds {
        fn write(&self, first: usize, hits: &[Hit]) {
            assert_eq!(first, 0);
            self.0.lock().unwrap().extend(hits.iter().map(|h| h.kind));
        }
    }
    scene.set_instance_mask(7, 2).unwrap();
    scene.commit().unwrap();
    for options in [SINGLE, COHERENT] {
        let kinds = Kinds(Mutex::default());
        scene.state().closest_batch(&Masked(ray), &kinds, options).unwrap();
        assert_eq!(*kinds.0.lock().unwrap(), [HitKind::Miss, HitKind::Exact, HitKind::Miss]);
    }
}

fn hidden_parts_and_instances_and_what_a_commit_isolates() {
    let context = built::context(1);
    let near = scenes::cuboid(DVec3::new(-1.0, -1.0, 1.0), DVec3::new(1.0, 1.0, 2.0));
    let far = scenes::cuboid(DVec3::new(-1.0, -1.0, -2.0), DVec3::new(1.0, 1.0, -1.0));
    let file = built::parts(&[Part::white(10, near), Part::white(20, far)]);
    let (scene, _) = built::scene(&context, &file);
    let ray = Ray::new(DVec3::new(0.1, 0.2, 5.0), -Vec3::Z);
    let part = |s: &SceneState| ask(s, &[ray], SINGLE)[0].part;
    let before = scene.state();
    let hidden = Look { visible: false, ..Look::default() };
    scene.set_part_look(7, 10, hidden).unwrap();
    assert_eq!(part(&scene.state()), 10, "not committed yet");
    scene.commit().unwrap();
    assert_eq!((part(&scene.state()), part(&before)), (20, 10), "the old state stays as it was");
    scene.set_part_look(7, 20, hidden).unwrap();
    scene.commit().unwrap();
    assert_eq!(part(&scene.state()), NONE);
    scene.set_part_look(7, 10, Look::default()).unwrap();
    scene.commit().unwrap();
    assert_eq!(part(&scene.state()), 10);
    scene.set_instance_look(7, hidden).unwrap();
    scene.commit().unwrap();
    assert_eq!(part(&scene.state()), NONE);
    scene.set_instance_look(7, Look::default()).unwrap();
    scene.set_transform(7, DAffine3::from_translation(DVec3::X * 50.0)).unwrap();
    scene.commit().unwrap();
    assert_eq!(part(&scene.state()), NONE, "moved away");
    scene.remove_instance(7).unwrap();
    scene.commit().unwrap();
    assert_eq!((scene.state().instance_count(), before.instance_count()), (0, 1));
    assert_eq!(part(&before), 10);
    for bad in [scene.remove_instance(7), scene.set_part_look(7, 10, hidden), scene.set_instance_mask(1, 1)] {
        assert!(matches!(bad, Err(outcrop::Error::BadArgument(_))));
    }
}

fn overlaps_agree_with_every_triangle() {
    let context = built::context(2);
    let mut rng = Rng::new(9);
    let cubes: Vec<Part> = (0..60)
        .map(|i| {
            let at = rng.inside(DVec3::splat(-5.0), DVec3::splat(5.0));
            Part::white(1000 + i, scenes::cuboid(at - 0.5, at + rng.inside(DVec3::splat(0.1), DVec3::splat(1.5))))
        })
        .collect();
    let file = built::parts(&cubes);
    let (scene, _) = built::scene(&context, &file);
    let turned = DAffine3::from_rotation_z(0.6) * DAffine3::from_scale(DVec3::splat(0.8));
    let model = Model::open(&context, &file.path).unwrap();
    scene.add_instance(&model, 8, turned).unwrap();
    scene.commit().unwrap();
    let state = scene.state();
    let (mut crossed, mut inside) = (0, 0);
    for _ in 0..40 {
        let at = rng.inside(DVec3::splat(-5.0), DVec3::splat(5.0));
        let volume = DBounds { min: at, max: at + rng.inside(DVec3::splat(0.2), DVec3::splat(6.0)) };
        let found = state.overlap_box(&volume).unwrap();
        let planes: Vec<Plane> = (0..3)
            .flat_map(|a| {
                let n = DVec3::AXES[a];
                [Plane { normal: n * 3.0, d: -3.0 * volume.min[a] }, Plane { normal: -n, d: volume.max[a] }]
            })
            .collect();
        assert_eq!(found, state.overlap_frustum(&planes).unwrap());
        let mut expected = Vec::new();
        for (instance, m) in [(7, DAffine3::IDENTITY), (8, turned)] {
            for part in &cubes {
                let sides: Vec<usize> = moved(&part.tris, &m).iter().map(|t| side(&volume, t)).collect();
                if sides.iter().all(|&s| s == 2) {
                    expected.push((instance, part.id, How::Inside));
                } else if sides.iter().any(|&s| s > 0) {
                    expected.push((instance, part.id, How::Intersects));
                }
            }
        }
        crossed += expected.iter().filter(|e| e.2 == How::Intersects).count();
        inside += expected.iter().filter(|e| e.2 == How::Inside).count();
        let found: Vec<_> = found.iter().map(|o| (o.instance, o.part, o.how)).collect();
        assert_eq!(found, expected, "{volume:?}");
    }
    assert!(crossed > 100 && inside > 5, "{crossed} {inside}");
    assert!(state.overlap_box(&DBounds::EMPTY).unwrap().is_empty());
    assert!(state.overlap_box(&DBounds { min: DVec3::NAN, max: DVec3::ONE }).is_err());
    assert!(state.overlap_frustum(&[]).is_err());
}

/// 0 outside, 1 crossing, 2 inside: by points of a fine raster of the triangle, enough for these boxes.
fn side(volume: &DBounds, t: &Tri) -> usize {
    let inside = |p: DVec3| p.cmpge(volume.min).all() && p.cmple(volume.max).all();
    if t.iter().all(|&p| inside(p)) {
        return 2;
    }
    // Cut the polygon by the six planes.
    let mut polygon = t.to_vec();
    for axis in 0..3 {
        for (sign, limit) in [(1.0, volume.min[axis]), (-1.0, -volume.max[axis])] {
            let height = |p: DVec3| sign * p[axis] - limit;
            let mut next = Vec::new();
            for i in 0..polygon.len() {
                let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                if height(a) >= 0.0 {
                    next.push(a);
                }
                if height(a) * height(b) < 0.0 {
                    next.push(a.lerp(b, height(a) / (height(a) - height(b))));
                }
            }
            polygon = next;
        }
    }
    usize::from(!polygon.is_empty())
}

struct Many(usize);

impl Rays for Many {
    fn count(&self) -> usize {
        self.0
    }
    fn read(&self, first: usize, out: &mut [Ray]) {
        for (i, out) in out.iter_mut().enumerate() {
            let x = ((first + i) % 100) as f64 * 0.01 - 0.5;
            *out = Ray { mask: 1, ..Ray::new(DVec3::new(x, 0.1, 5.0), -Vec3::Z) };
        }
    }
}

struct Count(Mutex<usize>);

impl Hits for Count {
    fn write(&self, _: usize, hits: &[Hit]) {
        *self.0.lock().unwrap() += hits.iter().filter(|h| h.kind == HitKind::Exact).count();
    }
}

fn queries_in_the_background_can_be_polled_waited_for_and_cancelled() {
    for threads in [0, 2] {
        let context = built::context(threads);
        let file = built::parts(&[Part::white(1, sphere())]);
        let (scene, _) = built::scene(&context, &file);
        let state = scene.state();
        let hits = Arc::new(Count(Mutex::default()));
        let first = Query::closest(&state, Arc::new(Many(100_000)), hits.clone(), COHERENT).unwrap();
        let woken = Arc::new(Mutex::new(0));
        let count = Arc::clone(&woken);
        first.set_wake(Some(Arc::new(move || *count.lock().unwrap() += 1)));
        let mut fraction = 0.0;
        loop {
            let status = first.wait(Duration::from_millis(1));
            assert!(status.fraction >= fraction && status.fraction <= 1.0);
            fraction = status.fraction;
            if status.state == QueryState::Done {
                break;
            }
            assert_eq!(status.state, QueryState::Running);
        }
        assert_eq!((*hits.0.lock().unwrap(), *woken.lock().unwrap(), fraction), (100_000, 1, 1.0));
        let query = Query::any(&state, Arc::new(Many(10_000_000)), hits.clone(), SINGLE).unwrap();
        query.cancel();
        assert_eq!(query.wait(Duration::from_secs(60)).state, QueryState::Cancelled);
        let dropped = Query::any(&state, Arc::new(Many(10_000_000)), hits.clone(), SINGLE).unwrap();
        drop((dropped, query, first));
        // A worker may be about to let go of the job that has ended.
        while Arc::strong_count(&hits) > 1 {
            std::thread::yield_now();
        }
    }
}

/// A wait that says that a batch has ended, and a batch that is gone, leave no thread in its wake function.
fn waits_for_a_batch_end_after_its_wake_function() {
    let context = built::context(2);
    let (scene, _) = built::scene(&context, &built::parts(&[Part::white(1, sphere())]));
    for is_dropped in [false, true] {
        for _ in 0..8 {
            let query =
                Query::any(&scene.state(), Arc::new(Many(100)), Arc::new(Count(Mutex::default())), SINGLE).unwrap();
            let counts = Arc::new(Mutex::new([0; 2]));
            let within = Arc::clone(&counts);
            query.set_wake(Some(Arc::new(move || {
                within.lock().unwrap()[0] += 1;
                std::thread::sleep(Duration::from_millis(10));
                within.lock().unwrap()[1] += 1;
            })));
            while !is_dropped && query.wait(Duration::from_millis(3)).state == QueryState::Running {}
            drop(query);
            let [begun, ended] = *counts.lock().unwrap();
            assert_eq!(begun, ended);
        }
    }
}

/// Whoever is woken may let go of the batch: nobody waits for himself.
fn a_batch_may_be_dropped_in_its_own_wake_function() {
    struct One;
    impl Rays for One {
        fn count(&self) -> usize {
            5000
        }
        fn read(&self, _: usize, out: &mut [Ray]) {
            out.fill(Ray::new(DVec3::new(0.1, 0.1, 5.0), -Vec3::Z));
        }
    }
    struct Nowhere;
    impl Hits for Nowhere {
        fn write(&self, _: usize, _: &[Hit]) {}
    }
    let drops = |threads: usize| {
        let context = built::context(threads);
        let file = built::parts(&[Part::white(1, sphere())]);
        let (scene, _) = built::scene(&context, &file);
        for i in 0..200 {
            let handle = Arc::new(Query::closest(&scene.state(), Arc::new(One), Arc::new(Nowhere), COHERENT).unwrap());
            let (told, hears) = std::sync::mpsc::channel();
            let last = Mutex::new(Some(Arc::clone(&handle)));
            let is_kept = i % 2 == 1;
            handle.set_wake(Some(Arc::new(move || {
                // In the call, or when what was called goes.
                if !is_kept {
                    drop(last.lock().unwrap().take());
                }
                told.send(()).unwrap();
            })));
            if i % 3 == 0 {
                handle.cancel();
            }
            drop(handle);
            while hears.recv_timeout(Duration::from_millis(if threads == 0 { 0 } else { 20_000 })).is_err() {
                assert!(threads == 0 && context.step(), "waits for itself");
            }
        }
    };
    // Without threads of the context whoever steps would wait for himself: not this thread.
    let (ended, end) = std::sync::mpsc::channel();
    let structure = built::structure();
    std::thread::spawn(move || {
        built::with(structure, || (0..3).for_each(drops));
        ended.send(()).unwrap();
    });
    end.recv_timeout(Duration::from_secs(100)).expect("all are dropped");
}

/// Every ray meets missing blocks, is put down, and resumed when they have been read: the answers are those of the
/// model that is in memory as a whole, whatever else was fetched before.
fn what_is_not_in_memory_is_read_and_the_answer_is_the_same() {
    let (rings, boxes) = built::sized((150, 3000), (40, 300));
    let parts = [Part::white(1, scenes::sphere(rings, 2 * rings)), Part::white(2, scenes::boxes(boxes, 4))];
    let file = built::parts(&parts);
    let warm = built::context(2);
    let (scene, model) = built::scene(&warm, &file);
    assert!(model.info().geometry_blocks > 20, "{} blocks", model.info().geometry_blocks);
    // Packets of rays from one point, and others.
    let fan = |i: i32| Vec3::new((i % 8 + i / 256 * 8 - 32) as f32 / 40.0, (i / 8 % 32 - 16) as f32 / 20.0, -1.0);
    let mut all: Vec<Ray> = (0..2048).map(|i| Ray::new(DVec3::new(0.1, 0.2, 3.0), fan(i))).collect();
    all.extend(rays(3000, 11, DVec3::ZERO, 1.5));
    let rays = all;
    let expected = ask(&scene.state(), &rays, SINGLE);
    let mut any = vec![0u8; rays.len()];
    let volume = DBounds { min: DVec3::splat(-0.5), max: DVec3::splat(0.6) };
    for (threads, options) in [(0, SINGLE), (2, SINGLE), (0, COHERENT), (2, COHERENT)] {
        let context = built::context(threads);
        let cold = |instances: u64| {
            let model = Model::open_cold(&context, &file.path).unwrap();
            assert_eq!(model.memory().resident, 0);
            let scene = Scene::new(&context);
            // A second instance far away: then the scene is more than one tree.
            for i in 0..instances {
                scene.add_instance(&model, 7 + i, DAffine3::from_translation(DVec3::X * 1e9 * i as f64)).unwrap();
            }
            scene.commit().unwrap();
            (scene.state(), model)
        };
        for instances in [1, 2] {
            let (state, model) = cold(instances);
            let got = ask(&state, &rays, options);
            let differ = (0..rays.len()).find(|&i| got[i] != expected[i]);
            assert_eq!(differ.map(|i| (got[i], expected[i])), None, "{instances}, {threads} threads, {options:?}");
            assert!(model.memory().resident > 0);
            state.any(&rays, options, &mut any).unwrap();
            assert!(expected.iter().zip(&any).all(|(h, &a)| (h.kind != HitKind::Miss) == (a == 1)));
            let (state, _) = cold(instances);
            state.any(&rays, options, &mut any).unwrap();
            assert!(expected.iter().zip(&any).all(|(h, &a)| (h.kind != HitKind::Miss) == (a == 1)));
            let (state, _) = cold(instances);
            assert_eq!(state.overlap_box(&volume).unwrap(), scene.state().overlap_box(&volume).unwrap());
        }
        // Answers at once say that they lack something.
        let (state, _) = cold(1);
        let now = ask(&state, &rays, QueryOptions { policy: Policy::Now, ..options });
        assert!(now.iter().any(|h| h.kind == HitKind::Missing));
        assert!(now.iter().all(|h| h.kind != HitKind::Exact));
        // And promise nothing of it.
        let unknown = now.iter().filter(|h| h.kind == HitKind::Missing && h.t == f64::INFINITY);
        assert!(unknown.clone().count() > 0);
        assert!(unknown.clone().all(|h| h.error == f32::INFINITY && h.t_free.is_finite()));
    }
}

/// An eye at the border of what is moved nearer to the model: packets and streams agree on who is.
fn at_the_border_of_near_packets_and_streams_agree() {
    let context = built::context(0);
    let file = built::parts(&[Part::white(1, scenes::sphere(30, 60))]);
    let (scene, _) = built::scene(&context, &file);
    let options = QueryOptions { want: Want::NOTHING, ..SINGLE };
    for beyond in [-1e-7, -1e-9, 0.0, 1e-9, 5e-8, 1e-7, 1e-6] {
        let eye = DVec3::new(0.1, 0.2, 4.0 * (1.0 + beyond));
        let dir = |i: usize| DVec3::new(0.03 + (i % 8) as f64 * 1e-3, 0.02 + (i / 8) as f64 * 1e-3, -1.0).as_vec3();
        let rays: Vec<Ray> = (0..320).map(|i| Ray::new(eye, dir(i))).collect();
        let together = ask(&scene.state(), &rays, options);
        assert!(together.iter().any(|h| h.kind == HitKind::Exact));
        for (ray, together) in rays.iter().zip(&together) {
            // Beside an opposite ray it goes in a stream.
            let apart = ask(&scene.state(), &[*ray, Ray { dir: -ray.dir, ..*ray }], options)[0];
            assert_eq!(apart, *together, "{beyond}: {ray:?}");
        }
    }
}

/// Where only the primitive's id is missing, all else is that of the hit, and nothing of what was asked before.
fn what_is_known_of_a_missing_hit_is_its_own() {
    let context = built::context(0);
    let other = built::parts(&[Part::white(99, scenes::cuboid(-DVec3::ONE, DVec3::ONE))]);
    let (other, _) = built::scene(&context, &other);
    let rings = built::sized(150, 40);
    let file = built::parts(&[Part::white(1, scenes::sphere(rings, 2 * rings))]);
    let model = Model::open_cold(&context, &file.path).unwrap();
    let scene = Scene::new(&context);
    scene.add_instance(&model, 7, DAffine3::from_translation(DVec3::Z * 0.5)).unwrap();
    scene.commit().unwrap();
    let ray = Ray::new(DVec3::new(0.1, 0.2, 4.0), -Vec3::Z);
    // Its geometry is read, its ids are not.
    ask(&scene.state(), &[ray], QueryOptions { want: Want::PART | Want::NORMAL, ..SINGLE });
    for _ in 0..2 {
        assert_eq!(ask(&other.state(), &[ray], SINGLE)[0].part, 99);
    }
    let now = ask(&scene.state(), &[ray], QueryOptions { policy: Policy::Now, ..SINGLE })[0];
    assert_eq!((now.kind, now.prim, now.part, now.instance), (HitKind::Missing, NONE, 1, 7));
    let exact = ask(&scene.state(), &[ray], SINGLE)[0];
    assert_eq!(Hit { kind: HitKind::Exact, prim: exact.prim, ..now }, exact);
}

built::on_each_structure!(
    one_model_single_and_coherent_and_any,
    only_what_is_asked_is_filled,
    instances_turned_stretched_and_far_away,
    rays_from_very_far_keep_the_models_detail,
    intervals_masks_and_impossible_rays,
    hidden_parts_and_instances_and_what_a_commit_isolates,
    overlaps_agree_with_every_triangle,
    queries_in_the_background_can_be_polled_waited_for_and_cancelled,
    waits_for_a_batch_end_after_its_wake_function,
    a_batch_may_be_dropped_in_its_own_wake_function,
    what_is_not_in_memory_is_read_and_the_answer_is_the_same,
    at_the_border_of_near_packets_and_streams_agree,
    what_is_known_of_a_missing_hit_is_its_own,
);
