//! Frames under test: cameras, requests that must converge, and scenes with something of everything.

use super::built::{self, Part, WHITE};
use super::scenes;
use glam::{DAffine3, DVec3};
use outcrop::import::MaterialDesc;
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Camera, Light, LightKind, Scene};
use std::time::Duration;

/// Longer than any request of a test takes: what a test waits before it fails.
pub const LONG: Duration = Duration::from_secs(120);

pub fn perspective(eye: DVec3, at: DVec3) -> Camera {
    Camera::Perspective { eye, at, up: DVec3::Y, fov_y_degrees: 40.0 }
}

pub fn frame(context: &outcrop::Context, width: u32, height: u32) -> Frame {
    let options = FrameOptions { width, height, outputs: Outputs::ALL, ..Default::default() };
    Frame::new(context, options).expect("a frame")
}

pub fn render(frame: &Frame, scene: &Scene, camera: &Camera, settings: &FrameSettings) {
    frame.request(&scene.state(), camera, settings).expect("a request");
    let status = frame.wait(LONG);
    assert_eq!(status.state, FrameState::Converged, "{status:?}");
    assert_eq!((status.fraction, status.pixels_exact), (1.0, status.pixels_total));
}

pub fn all_bytes(frame: &Frame) -> Vec<Vec<u8>> {
    Buffer::ALL.iter().map(|&b| frame.map(b).unwrap().bytes().to_vec()).collect()
}

/// A sphere so fine that its facets do not show in the tests below.
pub fn fine_sphere() -> Vec<Part> {
    vec![Part::white(5, scenes::sphere(200, 400))]
}

pub fn busy_scene(context: &outcrop::Context) -> Scene {
    let rings = built::sized(200, 60);
    let mut parts = vec![Part::white(5, scenes::sphere(rings, 2 * rings))];
    parts.push(Part::white(6, scenes::boxes(400, 3)));
    parts.push(Part { id: 8, material: MaterialDesc { opacity: 0.5, ..WHITE }, tris: scenes::plane_grid(4, -1.0) });
    let (scene, model) = built::scene(context, &built::parts(&parts));
    let aside = DAffine3::from_rotation_z(0.5) * DAffine3::from_translation(DVec3::new(2.0, 1.0, -1.0));
    scene.add_instance(&model, 9, aside).unwrap();
    let sun = LightKind::Directional(DVec3::new(1.0, -2.0, -3.0));
    let lamp = LightKind::Point(DVec3::new(3.0, 3.0, 3.0));
    let shadows = |kind, intensity| Light { kind, intensity, shadows: true, ..Light::HEADLIGHT };
    scene.set_lights(vec![Light::HEADLIGHT, shadows(sun, 0.5), shadows(lamp, 4.0)]).unwrap();
    scene.commit().unwrap();
    scene
}
