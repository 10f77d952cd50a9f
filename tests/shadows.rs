//! Shadows of transparent parts: the share of light that comes through is that of the formula.

use crate::common::built::{self, Part, WHITE};
use crate::common::scenes;
use glam::DVec3;
use outcrop::import::MaterialDesc;
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Background, Camera, Light, LightKind, Look};
use std::time::Duration;

/// Two panes over a floor of 16 by 16, each over a half of it, and opaque plates over both.
fn panes() -> Vec<Part> {
    let glass = |opacity| MaterialDesc { opacity, ..WHITE };
    let plate = |from: [f64; 2], to: [f64; 2], z: f64| {
        let [a, b] = [from, to].map(|[x, y]| DVec3::new(x, y, z));
        let (c, d) = (DVec3::new(b.x, a.y, z), DVec3::new(a.x, b.y, z));
        vec![[a, c, b], [a, b, d]]
    };
    vec![
        Part::white(1, scenes::plane_grid(16, 0.0)),
        Part { id: 2, material: glass(0.25), tris: plate([0.0, 0.0], [8.0, 16.0], 2.0) },
        Part { id: 3, material: glass(0.5), tris: plate([0.0, 0.0], [16.0, 8.0], 3.0) },
        Part::white(4, [plate([2.0, 2.0], [4.0, 4.0], 4.0), plate([12.0, 12.0], [14.0, 14.0], 2.5)].concat()),
    ]
}

#[test]
fn light_comes_through_transparent_parts_and_not_through_opaque_ones() {
    for threads in [0, 2] {
        let context = built::context(threads);
        let (scene, _) = built::scene(&context, &built::parts(&panes()));
        let frame =
            Frame::new(&context, FrameOptions { width: 64, height: 64, outputs: Outputs::ALL, targets: Vec::new() })
                .expect("a frame");
        // Below the panes, looking at the floor; a pixel is a quarter.
        let eye = DVec3::new(8.0, 8.0, 1.0);
        let camera = Camera::Orthographic { eye, at: eye - DVec3::Z, up: DVec3::Y, height: 16.0 };
        let check = |what: &str, expected: &dyn Fn(DVec3) -> f32| {
            scene.commit().expect("a commit");
            let settings = FrameSettings { ambient: 0.0, ..Default::default() };
            frame.request(&scene.state(), &camera, &settings).expect("a request");
            assert_eq!(frame.wait(Duration::from_secs(60)).state, FrameState::Converged);
            let linear = frame.map(Buffer::ColourLinear).expect("a picture");
            for (i, pixel) in linear.floats().expect("floats").chunks(4).enumerate() {
                let p = DVec3::new((i % 64) as f64 + 0.5, 63.5 - (i / 64) as f64, 0.0) * 0.25;
                assert!((pixel[0] - expected(p)).abs() < 1e-4, "{what}, at {p}: {} not {}", pixel[0], expected(p));
            }
        };
        let dark = |p: DVec3| {
            let within = |from: f64| [p.x, p.y].iter().all(|x| (from..from + 2.0).contains(x));
            within(2.0) || within(12.0)
        };
        let halves = |p: DVec3, left: f32, lower: f32| {
            (if p.x < 8.0 { 1.0 - left } else { 1.0 }) * (if p.y < 8.0 { 1.0 - lower } else { 1.0 })
        };
        let through = |p: DVec3| if dark(p) { 0.0 } else { halves(p, 0.25, 0.5) };
        let light = |kind| Light { kind, shadows: true, ..Light::HEADLIGHT };
        let down = LightKind::Directional(-DVec3::Z);
        scene.set_lights(vec![light(down)]).expect("lights");
        check("from above", &through);
        // From so far that it is as good as parallel.
        let point = Light { intensity: 1e12, ..light(LightKind::Point(DVec3::new(8.0, 8.0, 1e6))) };
        scene.set_lights(vec![point]).expect("lights");
        check("from a point", &through);
        scene.set_lights(vec![Light { shadows: false, ..light(down) }]).expect("lights");
        check("without shadows", &|_| 1.0);
        scene.set_lights(vec![light(down)]).expect("lights");
        let paint = |part, alpha| {
            let state = Look { colour: Some([1.0, 1.0, 1.0, alpha]), ..Look::default() };
            scene.set_part_look(7, part, state).expect("a state");
        };
        paint(2, 1.0);
        check("one pane made opaque", &|p| if dark(p) { 0.0 } else { halves(p, 1.0, 0.5) });
        paint(4, 0.0);
        paint(3, 0.0);
        check("all else made invisible", &|p| halves(p, 1.0, 0.0));
        scene.set_part_look(7, 2, Look { visible: false, ..Look::default() }).expect("a state");
        check("and that one hidden", &|_| 1.0);
    }
}

/// Transparency that comes with states only, in a model that has none.
#[test]
fn states_make_shadows_lighter() {
    let context = built::context(1);
    let opaque: Vec<Part> = panes().into_iter().map(|part| Part { material: WHITE, ..part }).collect();
    let (scene, _) = built::scene(&context, &built::parts(&opaque));
    scene.set_background(Background::Colour([0.0; 4])).expect("a background");
    let sun = LightKind::Directional(-DVec3::Z);
    scene.set_lights(vec![Light { kind: sun, shadows: true, ..Light::HEADLIGHT }]).expect("lights");
    let frame = Frame::new(&context, FrameOptions { width: 4, height: 4, outputs: Outputs::ALL, targets: Vec::new() })
        .expect("a frame");
    let eye = DVec3::new(1.0, 12.0, 1.0);
    let camera = Camera::Orthographic { eye, at: eye - DVec3::Z, up: DVec3::Y, height: 0.1 };
    let seen = || {
        scene.commit().expect("a commit");
        let settings = FrameSettings { ambient: 0.0, ..Default::default() };
        frame.request(&scene.state(), &camera, &settings).expect("a request");
        assert_eq!(frame.wait(Duration::from_secs(60)).state, FrameState::Converged);
        frame.map(Buffer::ColourLinear).expect("a picture").floats().expect("floats")[0]
    };
    assert_eq!(seen(), 0.0);
    let pale = Look { colour: Some([1.0, 1.0, 1.0, 0.25]), ..Look::default() };
    scene.set_part_look(7, 2, pale).expect("a state");
    assert!((seen() - 0.75).abs() < 1e-5);
    scene.set_part_look(7, 2, Look::default()).expect("a state");
    assert_eq!(seen(), 0.0);
    // Of an instance: the floor, too, is then seen through by three quarters, and lit by what comes through a pane.
    scene.set_instance_look(7, pale).expect("a state");
    assert!((seen() - 0.25 * 0.75).abs() < 1e-5);
}

/// What is exact beside stand-ins is not in the shadow of those of its own surface: under a low sun a bumpy sphere was
/// by 1.2 % too dark at one pixel of error. (Brighter it is for what stands out at its rim.)
#[test]
fn surfaces_beside_stand_ins_are_not_in_their_shadow() {
    let context = built::context(2);
    let (scene, _) = built::scene(&context, &built::parts(&[Part::white(1, scenes::bumpy_sphere(300, 600, 6))]));
    scene.set_background(Background::Colour([0.0; 4])).expect("a background");
    let frame =
        Frame::new(&context, FrameOptions { width: 160, height: 120, outputs: Outputs::ALL, targets: Vec::new() })
            .expect("a frame");
    let eye = DVec3::new(2.0, -2.0, 1.5);
    let camera = Camera::Perspective { eye, at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
    let low = LightKind::Directional(DVec3::new(-1.0, 0.3, -0.2));
    scene.set_lights(vec![Light { kind: low, shadows: true, ..Light::HEADLIGHT }]).expect("lights");
    scene.commit().expect("a commit");
    let brightness = |poe| {
        let settings = FrameSettings { ambient: 0.0, poe, ..Default::default() };
        frame.request(&scene.state(), &camera, &settings).expect("a request");
        assert_eq!(frame.wait(Duration::from_secs(60)).state, FrameState::Converged);
        let linear = frame.map(Buffer::ColourLinear).expect("a picture");
        linear.floats().expect("floats").chunks(4).map(|p| f64::from(p[0])).sum::<f64>()
    };
    let exact = brightness(0.0);
    for (poe, most) in [(0.5, 1.005), (1.0, 1.01), (3.0, 1.02), (10.0, 1.03)] {
        let ratio = brightness(poe) / exact;
        assert!((0.998..most).contains(&ratio), "{ratio} at {poe} pixels of error");
    }
}
