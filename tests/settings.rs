//! Pictures in each setting, pixel by pixel: what the buffers say of the first surface is what a query answers to the
//! ray of the pixel. Queries of single rays and pictures share neither the walk nor the way into the frames of trees.

use crate::common::brute::Tri;
use crate::common::built::{self, Part};
use crate::common::frames::{LONG, perspective};
use crate::common::scenes;
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use outcrop::import::MaterialDesc;
use outcrop::math::Cone;
use outcrop::query::{Hit, HitKind, Policy, QueryOptions, Want};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Mapped, Outputs};
use outcrop::scene::{Camera, Light, LightKind, Scene};

const WIDTH: u32 = 131;
const HEIGHT: u32 = 90;

fn part(id: u64, opacity: f32, tris: Vec<Tri>) -> Part {
    let material = MaterialDesc { colour: [0.7, 0.5, 0.3], metalness: 0.2, roughness: 0.4, opacity };
    Part { id, material, tris }
}

/// Places of the model: as it is, turned and scaled, mirrored, and several that overlap.
fn places() -> Vec<(&'static str, Vec<DAffine3>)> {
    let turn = |angle: f64| DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), angle));
    let at = |matrix3: DMat3, translation: DVec3| DAffine3 { matrix3, translation };
    let far = DVec3::new(3e6, -2e6, 5e5);
    let turned = at(turn(1.1) * DMat3::from_diagonal(DVec3::new(2.0, 0.5, 1.3)), DVec3::new(0.3, 0.2, -0.1));
    let mirrored = at(turn(2.0) * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)), DVec3::ZERO);
    let small = at(turn(0.4) * DMat3::from_diagonal(DVec3::splat(1e-9)), DVec3::ZERO);
    let several = (0..4).map(|i| at(turn(f64::from(i)), DVec3::X * (f64::from(i) * 0.6 - 0.9))).collect();
    vec![
        ("as it is", vec![DAffine3::IDENTITY]),
        ("turned", vec![turned]),
        ("mirrored", vec![mirrored]),
        ("far from zero", vec![at(DMat3::IDENTITY, far)]),
        ("turned, far from zero", vec![at(turn(0.7), far)]),
        ("a thousand-millionth of its size", vec![small]),
        ("several that overlap", several),
    ]
}

/// The cameras of a place: perspective and orthographic, from outside, from within, and from far away.
fn cameras(place: &DAffine3) -> [Camera; 5] {
    let to = |p: DVec3| place.transform_point3(p);
    let size = place.matrix3.determinant().abs().cbrt();
    let up = place.transform_vector3(DVec3::Y);
    let turned = |camera| match camera {
        Camera::Perspective { eye, at, fov_y_degrees, .. } => {
            Camera::Perspective { eye: to(eye), at: to(at), up, fov_y_degrees }
        }
        other => other,
    };
    // No plane of the model goes through the eye: pictures leave out surfaces that do.
    let outside = DVec3::new(2.03, 1.57, 3.11);
    let wide = |eye| Camera::Perspective { eye, at: DVec3::new(0.2, 0.0, 0.0), up: DVec3::Y, fov_y_degrees: 4.0 };
    let parallel = |eye| Camera::Orthographic { eye: to(eye), at: to(DVec3::ZERO), up, height: 2.5 * size };
    [
        turned(perspective(outside, DVec3::ZERO)),
        turned(perspective(DVec3::new(0.05, 0.1, 0.02), DVec3::X)),
        turned(wide(outside * 12.1)),
        parallel(outside),
        parallel(outside * 9.1),
    ]
}

fn lights(sun: bool) -> Vec<Light> {
    if !sun {
        return vec![Light::HEADLIGHT];
    }
    let of = |kind| Light { kind, shadows: true, ..Light::HEADLIGHT };
    vec![of(LightKind::Directional(DVec3::new(1.0, -2.0, -0.5))), of(LightKind::Point(DVec3::new(2.0, 3.0, 1.0)))]
}

fn buffers_say_what_queries_of_their_pixels_answer() {
    let model = built::parts(&[
        part(1, 1.0, scenes::bumpy_sphere(60, 120, 4)),
        part(2, 0.4, scenes::boxes(200, 3)),
        part(3, 1.0, scenes::blocks(8, 2)),
    ]);
    let context = built::context(0);
    let (mut hits, mut seen) = ([0u32; 2], 0);
    for (name, places) in places() {
        let opened = outcrop::scene::Model::open(&context, &model.path).unwrap();
        let scene = Scene::new(&context);
        for (id, place) in (10..).zip(&places) {
            scene.add_instance(&opened, id, *place).unwrap();
        }
        for (number, camera) in cameras(&places[0]).into_iter().enumerate() {
            scene.set_lights(lights(number % 2 == 1)).unwrap();
            scene.commit().unwrap();
            let options = FrameOptions { width: WIDTH, height: HEIGHT, outputs: Outputs::ALL, ..Default::default() };
            let frame = Frame::new(&context, options).unwrap();
            frame.request(&scene.state(), &camera, &FrameSettings::default()).unwrap();
            assert_eq!(frame.wait(LONG).state, FrameState::Converged);
            let buffer = |buffer| frame.map(buffer).unwrap();
            let floats = |mapped: &Mapped| mapped.floats().unwrap().to_vec();
            let [depth, normal, error] = [Buffer::Depth, Buffer::Normal, Buffer::Error].map(|b| floats(&buffer(b)));
            let [parts, prims, instances] =
                [Buffer::Part, Buffer::Primitive, Buffer::Instance].map(|b| buffer(b).ids().unwrap().to_vec());
            let kinds = buffer(Buffer::Kind).bytes().to_vec();
            let rays = camera.prepare(WIDTH, HEIGHT).unwrap();
            for i in 0..(WIDTH * HEIGHT) as usize {
                let (x, y) = (i as u32 % WIDTH, i as u32 / WIDTH);
                let ray = outcrop::math::Ray { cone: Cone::ZERO, ..rays.ray(f64::from(x) + 0.5, f64::from(y) + 0.5) };
                let mut hit = [Hit::MISS];
                let options = QueryOptions { coherent: false, want: Want::ALL, policy: Policy::Exact };
                scene.state().closest(&[ray], options, &mut hit).unwrap();
                let hit = hit[0];
                let said = (kinds[i], instances[i], parts[i], prims[i]);
                let answered = (hit.kind as u8, hit.instance, hit.part, hit.prim);
                assert_eq!(said, answered, "{name}, camera {number}, pixel {x} {y}");
                hits[usize::from(hit.kind != HitKind::Miss)] += 1;
                if hit.kind == HitKind::Miss {
                    assert_eq!(depth[i], f32::INFINITY);
                    continue;
                }
                seen |= 1u32 << hit.part;
                let along = (ray.dir.as_dvec3() * hit.t).dot(rays.forward()) as f32;
                assert_eq!(depth[i], along, "{name}, camera {number}, pixel {x} {y}");
                assert_eq!(error[i], hit.error, "{name}, camera {number}, pixel {x} {y}");
                let normal = Vec3::from_slice(&normal[3 * i..]);
                assert!((normal - hit.normal).length() < 1e-6, "{name}, camera {number}: {normal}, {}", hit.normal);
            }
        }
    }
    assert!(hits[0] > 10_000 && hits[1] > 100_000 && seen == 0b1110, "{hits:?}, {seen:b}");
}

built::on_each_structure!(buffers_say_what_queries_of_their_pixels_answer);
