//! Packets of queries: what is worked out for many rays at once is what is worked out for each.

use crate::common::asked::ask;
use crate::common::brute::Tri;
use crate::common::built::{self, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DAffine3, DVec3};
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, Hits, PACKET, Policy, Query, QueryOptions, QueryState, Rays, Want};
use outcrop::scene::{Camera, Model, Scene, SceneState};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const COHERENT: QueryOptions = QueryOptions { coherent: true, want: Want::ALL, policy: Policy::Exact };
const SINGLE: QueryOptions = QueryOptions { coherent: false, ..COHERENT };

/// A camera's rays in blocks of 8 x 4, of which each is a packet.
fn camera_rays(eye: DVec3, poe: f32) -> Vec<Ray> {
    let camera = Camera::Perspective { eye, at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 77.0 };
    let pixels = camera.prepare(128, 128).expect("a camera");
    let mut rays = Vec::new();
    for block in 0..16 * 32 {
        for i in 0..32 {
            let (x, y) = (block % 16 * 8 + i % 8, block / 16 * 4 + i / 8);
            let ray = pixels.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            rays.push(Ray { cone: Cone { b: ray.cone.b * poe.sqrt(), ..ray.cone }, ..ray });
        }
    }
    rays
}

/// Packets of a batch and rays side by side in a batch have the answers, to the bit, that a call with one ray gives,
/// whichever members are asked for. (Of the rays side by side each seventh is asked alone.) Looks at zero from
/// distances of some `unit`s; returns how many hits were of each kind.
fn packets_answer_as_single_rays_do(state: &SceneState, unit: f64) -> [usize; 4] {
    let wants = [
        Want::NORMAL | Want::UV | Want::PART,
        Want::NORMAL,
        Want::PART | Want::INSTANCE,
        Want::UV,
        Want::NOTHING,
        Want::ALL,
    ];
    let (mut kinds, mut order) = ([0; 4], Vec::new());
    for (v, eye) in [DVec3::new(0.5, -2.6, 0.3), DVec3::new(-2.0, -0.3, 1.1), DVec3::new(0.9, 0.7, 0.2)]
        .into_iter()
        .enumerate()
        .take(built::sized(3, 1))
    {
        for poe in [0.0, 0.3, 3.0, 100.0] {
            let mut rays = camera_rays(eye * unit, poe);
            // Some end early, some begin late.
            for (i, ray) in rays.iter_mut().enumerate().filter(|(i, _)| i / 320 % 3 == v) {
                (ray.t_min, ray.t_max) =
                    [(0.0, (1.9 + i as f64 * 1e-5) * unit), (1.7 * unit, f64::INFINITY)][i / 32 % 2];
            }
            // Some are not of length 1: their widths count otherwise.
            for (i, ray) in rays.iter_mut().enumerate().filter(|(i, _)| i / 320 % 3 == (v + 1) % 3 && i % 5 != 3) {
                let longer = 1.0 + (i % 7) as f32 * 0.25;
                (ray.dir, ray.cone.b, ray.t_max) =
                    (ray.dir * longer, ray.cone.b * longer, ray.t_max / f64::from(longer));
            }
            order.clear();
            order.extend((0..rays.len()).map(|i| i * 7919 % rays.len()));
            let shuffled: Vec<_> = order.iter().map(|&i| rays[i]).collect();
            for want in wants {
                let together = ask(state, &rays, QueryOptions { want, ..COHERENT });
                let side_by_side = ask(state, &shuffled, QueryOptions { want, ..SINGLE });
                for (at, (&i, beside)) in order.iter().zip(&side_by_side).enumerate() {
                    assert_eq!(together[i], *beside, "{:?}, {want:?}", rays[i]);
                    if at % 7 == 0 {
                        let alone = ask(state, &rays[i..=i], QueryOptions { want, ..SINGLE });
                        assert_eq!(together[i], alone[0], "{:?}, {want:?}", rays[i]);
                        kinds[alone[0].kind as usize] += 7;
                    }
                }
            }
        }
    }
    kinds
}

/// Rays that are lent where they are are those that are copied; so are the last ones, which are no whole packet.
fn rays_that_are_lent_are_answered_as_copied_ones() {
    struct Copied(Vec<Ray>);
    impl Rays for Copied {
        fn count(&self) -> usize {
            self.0.len()
        }
        fn read(&self, first: usize, out: &mut [Ray]) {
            out.copy_from_slice(&self.0[first..first + out.len()]);
        }
    }
    struct Lent(Vec<Ray>);
    impl Rays for Lent {
        fn count(&self) -> usize {
            self.0.len()
        }
        fn read(&self, first: usize, out: &mut [Ray]) {
            assert!(out.len() < PACKET, "these are lent");
            out.copy_from_slice(&self.0[first..first + out.len()]);
        }
        fn packet(&self, first: usize) -> Option<&[Ray; PACKET]> {
            self.0[first..].first_chunk()
        }
    }
    struct Taken(Mutex<Vec<Hit>>);
    impl Hits for Taken {
        fn write(&self, first: usize, hits: &[Hit]) {
            self.0.lock().unwrap()[first..first + hits.len()].copy_from_slice(hits);
        }
    }
    let context = built::context(2);
    let tris = scenes::bumpy_sphere(120, 240, 5);
    let file = built::parts(&[Part::white(5, tris)]);
    let (one, model) = built::scene(&context, &file);
    let two = Scene::new(&context);
    two.add_instance(&model, 1, DAffine3::IDENTITY).unwrap();
    two.add_instance(&model, 2, DAffine3::from_translation(DVec3::Y)).unwrap();
    two.commit().unwrap();
    for state in [one.state(), two.state()] {
        for poe in [0.0, 3.0] {
            let mut rays = camera_rays(DVec3::new(0.5, -2.6, 0.3), poe);
            rays.drain(..4000);
            rays.truncate(5000);
            // Widths that are none, of some packets.
            rays.iter_mut()
                .enumerate()
                .filter(|(i, _)| i / 32 % 4 == 1 && i % 3 == 0)
                .for_each(|(_, ray)| ray.cone.b = -1.0);
            for options in [SINGLE, COHERENT] {
                let lent = ask(&state, &rays, options);
                let taken = Taken(Mutex::new(vec![Hit::MISS; rays.len()]));
                state.closest_batch(&Copied(rays.clone()), &taken, options).unwrap();
                assert!(*taken.0.lock().unwrap() == lent);
                state.closest_batch(&Lent(rays.clone()), &taken, options).unwrap();
                assert!(*taken.0.lock().unwrap() == lent);
                let taken = Arc::new(taken);
                let query = Query::closest(&state, Arc::new(Lent(rays.clone())), taken.clone(), options).unwrap();
                assert_eq!(query.wait(Duration::from_secs(60)).state, QueryState::Done);
                assert!(*taken.0.lock().unwrap() == lent);
                // The last ones, which are no whole packet, one by one.
                let last = &rays[rays.len() / PACKET * PACKET..];
                let each: Vec<Hit> = last.iter().flat_map(|ray| ask(&state, &[*ray], options)).collect();
                assert!(!last.is_empty() && each == lent[rays.len() - last.len()..]);
                let met = lent.iter().filter(|hit| hit.kind != HitKind::Miss).count();
                assert!((500..4500).contains(&met), "{met}");
            }
        }
    }
}

/// On several parts, with slivers that have no normal, on stand-ins with one sample and with six.
fn packets_answer_as_single_rays_do_whatever_is_asked() {
    let context = built::context(2);
    let mut tris = scenes::bumpy_sphere(120, 240, 5);
    tris.extend(scenes::boxes(400, 3));
    let third = tris.len() / 3;
    let mut slivers = tris.split_off(2 * third);
    slivers.extend(scenes::slivers().tris);
    let parts = [(5, tris.split_off(third)), (u64::MAX - 1, tris), (9, slivers)];
    let file = built::parts(&parts.map(|(id, tris)| Part::white(id, tris)));
    let (scene, _) = built::scene(&context, &file);
    let kinds = packets_answer_as_single_rays_do(&scene.state(), 1.0);
    assert!(kinds[0] > 10_000 && kinds[1] > 10_000 && kinds[2] > 10_000, "{kinds:?}");
}

/// Triangles so small that the squares of their normals leave the range of single precision.
fn packets_answer_as_single_rays_do_on_tiny_triangles() {
    const TINY: f64 = 1e-11;
    let context = built::context(2);
    let tris = scenes::bumpy_sphere(60, 120, 5).into_iter().map(|t| t.map(|v| scenes::rounded(v * TINY))).collect();
    let (scene, _) = built::scene(&context, &built::parts(&[Part::white(1, tris)]));
    let kinds = packets_answer_as_single_rays_do(&scene.state(), TINY);
    assert!(kinds[0] > 10_000 && kinds[1] > 10_000 && kinds[2] > built::sized(10_000, 1000), "{kinds:?}");
}

/// What rays meet, asked two at a time, which are walked one by one.
fn none_passes_by(state: &SceneState, rays: &[Ray]) -> Vec<Hit> {
    rays.chunks(2).flat_map(|two| ask(state, two, SINGLE)).collect()
}

/// Packets that pass by a model need not be traced: at the corners and edges of its bounds, from wherever, no hit may
/// be lost.
fn packets_beside_a_model_lose_no_hit() {
    let context = built::context(2);
    // Triangles in all corners of the bounds, and nothing between.
    // Sizes that the grids of nodes do not have.
    let size = DVec3::new(0.83, 0.91, 1.07).as_vec3().as_dvec3();
    let corner = |i: usize| DVec3::from_array([0, 1, 2].map(|axis| if i >> axis & 1 == 1 { 1.0 } else { -1.0 })) * size;
    let inward = |i: usize, axis: usize| corner(i) * (DVec3::ONE - DVec3::AXES[axis] * 0.25);
    let tris: Vec<Tri> =
        (0..8).flat_map(|i| (0..3).map(move |k| [corner(i), inward(i, k), inward(i, (k + 1) % 3)])).collect();
    let file = built::parts(&[Part::white(5, tris)]);
    let model = Model::open(&context, &file.path).unwrap();
    let mut rng = Rng::new(17);
    let [mut met, mut missed, mut mixed, mut beyond] = [0; 4];
    for offset in [DVec3::ZERO, DVec3::new(3e4, -2e4, 1e4), DVec3::new(3e11, -2e11, 1e11)] {
        let scene = Scene::new(&context);
        scene.add_instance(&model, 1, DAffine3::from_translation(offset)).unwrap();
        scene.commit().unwrap();
        let state = scene.state();
        for _ in 0..6000 {
            // In front of, beside and inside of its sides; near and far.
            let far = rng.between(-1.0, 8.0).exp2();
            let eye = rng.direction() * far;
            let eye = if rng.one_in(3) { DVec3::new(eye.x, 0.3, if rng.one_in(2) { 1.0 } else { eye.z }) } else { eye };
            let (at, spread) =
                (corner(rng.below(8)), if rng.one_in(3) { 0.0 } else { rng.between(-24.0, -2.0).exp2() });
            // At a corner, at an edge, or beside one by more or less.
            let out = rng.between(-22.0, -2.0).exp2();
            let at = [at, at * DVec3::new(1.0, 1.0, 0.9), at * (1.0 + out), at * DVec3::new(1.0 + out, 1.0, 0.9)]
                [rng.below(4)];
            let length = if rng.one_in(2) { 1.0 } else { rng.between(-10.0, 10.0).exp2() };
            let mut ray = || {
                let aside = DVec3::new(rng.between(-1.0, 1.0), rng.between(-1.0, 1.0), rng.between(-1.0, 1.0)) * spread;
                Ray::new(offset + eye, ((at - eye).normalize_or(DVec3::X) * length + aside * length).as_vec3())
            };
            let mut rays: Vec<Ray> = (0..PACKET).map(|_| ray()).collect();
            if rng.one_in(8) {
                rays[7].dir.y = [f32::NAN, f32::INFINITY, 0.0, 1e-42][rng.below(4)];
            }
            let count = [PACKET, 3, 17, PACKET - 1][rng.below(4)];
            let each = none_passes_by(&state, &rays);
            assert!(ask(&state, &rays, COHERENT) == each, "{:?}", rays[0]);
            assert!(ask(&state, &rays[..count], COHERENT) == each[..count], "{count}: {:?}", rays[0]);
            // Stand-ins reach out of the bounds of triangles.
            let width = [0.003, 0.03, 0.3][rng.below(3)];
            rays.iter_mut().for_each(|ray| ray.cone.b = width * ray.dir.length());
            let wide = none_passes_by(&state, &rays);
            assert!(ask(&state, &rays, COHERENT) == wide, "{:?}", rays[0]);
            assert!(ask(&state, &rays[..count], COHERENT) == wide[..count], "{count}: {:?}", rays[0]);
            beyond += wide
                .iter()
                .zip(&each)
                .filter(|(wide, exact)| wide.kind == HitKind::Lod && exact.kind == HitKind::Miss)
                .count();
            let hits = each.iter().filter(|hit| hit.kind != HitKind::Miss).count();
            (met, missed) = (met + usize::from(hits == PACKET), missed + usize::from(hits == 0));
            mixed += usize::from(hits > 0 && hits < PACKET);
        }
    }
    assert!(met > 100 && missed > 500 && mixed > 100 && beyond > 1000, "{met}, {missed}, {mixed}, {beyond}");
}

built::on_each_structure!(
    rays_that_are_lent_are_answered_as_copied_ones,
    packets_answer_as_single_rays_do_whatever_is_asked,
    packets_answer_as_single_rays_do_on_tiny_triangles,
    packets_beside_a_model_lose_no_hit,
);
