//! Coordinates 10^7 units from zero: the same picture as at zero, to the pixel, whether the mesh itself lies there or
//! an instance takes it there.

use crate::common::brute::Tri;
use crate::common::built::{self, Built, Part};
use crate::common::scenes;
use glam::{DAffine3, DVec3};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Camera, Context, Light, LightKind, Model, Scene};
use std::time::Duration;

const FAR: DVec3 = DVec3::new(1e7, -2e7, 1e7);
const SIZE: (u32, u32) = (200, 150);

/// Coordinates are multiples of 2^-12, so that adding [`FAR`] is exact.
fn on_lattice(tris: Vec<Tri>) -> Vec<Tri> {
    let snapped = tris.into_iter().map(|t| t.map(|v| (v * 4096.0).round() / 4096.0));
    snapped.filter(scenes::has_area).collect()
}

fn parts(shift: DVec3) -> Built {
    let moved = |tris: Vec<Tri>| on_lattice(tris).into_iter().map(|t| t.map(|v| v + shift)).collect();
    let floor = scenes::cuboid(DVec3::new(-3.0, -3.0, -1.75), DVec3::new(3.0, 3.0, -1.5));
    let ball = scenes::bumpy_sphere(60, 90, 2);
    built::parts(&[Part::white(1, moved(ball)), Part::white(2, moved(floor))])
}

fn cameras() -> [Camera; 3] {
    let (at, up, fov_y_degrees) = (DVec3::ZERO, DVec3::Z, 40.0);
    [
        Camera::Perspective { eye: DVec3::new(4.5, 5.25, 3.125), at, up, fov_y_degrees },
        Camera::Perspective { eye: DVec3::new(1.25, -1.5, 0.25), at: DVec3::new(0.5, 0.0, 0.25), up, fov_y_degrees },
        Camera::Orthographic { eye: DVec3::new(-4.0, 2.0, 2.5), at, up, height: 4.0 },
    ]
}

fn moved(camera: Camera, by: DVec3) -> Camera {
    match camera {
        Camera::Perspective { eye, at, up, fov_y_degrees } => {
            Camera::Perspective { eye: eye + by, at: at + by, up, fov_y_degrees }
        }
        Camera::Orthographic { eye, at, up, height } => Camera::Orthographic { eye: eye + by, at: at + by, up, height },
    }
}

/// One buffer of a picture.
type Picture = (Buffer, Vec<u8>);

/// All buffers but the error, which says more far from zero.
fn pictures(context: &Context, file: &Built, placed: DVec3, seen_from: DVec3) -> Vec<Picture> {
    let model = Model::open(context, &file.path).expect("a model");
    let scene = Scene::new(context);
    scene.add_instance(&model, 3, DAffine3::from_translation(placed)).expect("an instance");
    let sun = Light { kind: LightKind::Directional(DVec3::new(-1.0, 0.5, -2.0)), shadows: true, ..Light::HEADLIGHT };
    scene.set_lights(vec![Light { intensity: 0.4, ..Light::HEADLIGHT }, sun]).expect("lights");
    scene.commit().expect("a commit");
    let options = FrameOptions { width: SIZE.0, height: SIZE.1, outputs: Outputs::ALL, ..Default::default() };
    let frame = Frame::new(context, options).expect("a frame");
    let mut all = Vec::new();
    for camera in cameras() {
        let settings = FrameSettings { samples: 2, ..Default::default() };
        frame.request(&scene.state(), &moved(camera, seen_from), &settings).expect("a request");
        assert_eq!(frame.wait(Duration::from_secs(600)).state, FrameState::Converged);
        let buffers = Buffer::ALL.iter().filter(|b| **b != Buffer::Error);
        all.extend(buffers.map(|&b| (b, frame.map(b).expect("a picture").bytes().to_vec())));
    }
    all
}

/// Whether two depths are the same number, or neighbours: the origins of orthographic rays lie between pixels' lattice
/// points and are rounded far from zero, which may tip the last rounding of a depth.
fn same_depth(a: &[u8], b: &[u8]) -> bool {
    let bits = |p: &[u8]| i64::from(u32::from_ne_bytes(p.try_into().expect("a float")));
    (bits(a) - bits(b)).abs() <= 1
}

/// Whether two pairs of weights of corners differ by a few roundings at most, for the same reason: an origin that is
/// off by 10^7 * 2^-53 moves them by that over the width of a triangle.
fn same_weights(a: &[u8], b: &[u8]) -> bool {
    let all = |p: &[u8]| p.as_chunks().0.iter().map(|bytes| f32::from_ne_bytes(*bytes)).collect::<Vec<f32>>();
    all(a).iter().zip(all(b)).all(|(a, b)| (a - b).abs() <= 1e-6)
}

/// Pixels whose bytes differ, by buffer and camera.
fn differing(a: &[Picture], b: &[Picture]) -> Vec<(Buffer, usize)> {
    let count = |(x, y): (&Picture, &Picture)| {
        let size = x.0.pixel_bytes();
        let same = |p: &[u8], q: &[u8]| match x.0 {
            Buffer::Depth => same_depth(p, q),
            Buffer::Uv => same_weights(p, q),
            _ => p == q,
        };
        (x.0, x.1.chunks(size).zip(y.1.chunks(size)).filter(|(p, q)| !same(p, q)).count())
    };
    a.iter().zip(b).map(count).filter(|(_, n)| *n > 0).collect()
}

fn the_same_picture_to_the_pixel() {
    let context = built::context(2);
    let near = parts(DVec3::ZERO);
    let truth = pictures(&context, &near, DVec3::ZERO, DVec3::ZERO);
    let kinds: Vec<_> = truth.iter().filter(|(b, _)| *b == Buffer::Kind).flat_map(|(_, p)| p).collect();
    assert!(kinds.iter().filter(|k| ***k == 1).count() * 4 > kinds.len(), "too little is seen");
    let far = parts(FAR);
    assert_eq!(differing(&truth, &pictures(&context, &far, DVec3::ZERO, FAR)), [], "a mesh far away");
    assert_eq!(differing(&truth, &pictures(&context, &near, FAR, FAR)), [], "an instance far away");
    assert_eq!(differing(&truth, &pictures(&context, &far, -FAR, DVec3::ZERO)), [], "a far mesh brought back");
}

fn nearly_the_same_picture_where_the_shift_is_rounded() {
    // Here every corner and the eye are rounded to 10^7 * 2^-53: silhouettes may move by that, and no more.
    let context = built::context(2);
    let shift = DVec3::new(1e7 / 3.0, 1e7 / 7.0, -1e7 / 11.0);
    let truth = pictures(&context, &parts(DVec3::ZERO), DVec3::ZERO, DVec3::ZERO);
    let far = pictures(&context, &parts(shift), DVec3::ZERO, shift);
    let what_is_seen = [Buffer::Kind, Buffer::Part, Buffer::Instance, Buffer::ColourSrgb8];
    for (buffer, pixels) in differing(&truth, &far) {
        let limit = if what_is_seen.contains(&buffer) { 1000 } else { 1 };
        assert!(pixels * limit <= (SIZE.0 * SIZE.1) as usize, "{buffer:?}: {pixels} pixels differ");
    }
}

built::on_each_structure!(the_same_picture_to_the_pixel, nearly_the_same_picture_where_the_shift_is_rounded,);
