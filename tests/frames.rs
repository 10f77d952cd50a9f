//! Frames through the public API: what is seen, and what stays whole while much goes on.

mod common;

use common::built::{self, Part, WHITE};
use common::scenes;
use glam::{DAffine3, DVec3, Vec3};
use outcrop::import::MaterialDesc;
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, NONE, QueryOptions};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Mapped, Outputs, Target};
use outcrop::scene::{Background, Camera, Light, LightKind, Model, Scene, State};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const LONG: Duration = Duration::from_secs(120);

fn perspective(eye: DVec3, at: DVec3) -> Camera {
    Camera::Perspective { eye, at, up: DVec3::Y, fov_y_degrees: 40.0 }
}

fn frame(context: &outcrop::Context, width: u32, height: u32) -> Frame {
    let options = FrameOptions { width, height, outputs: Outputs::ALL, ..Default::default() };
    Frame::new(context, options).expect("a frame")
}

fn render(frame: &Frame, scene: &Scene, camera: &Camera, settings: &FrameSettings) {
    frame.request(&scene.state(), camera, settings).expect("a request");
    let status = frame.wait(LONG);
    assert_eq!(status.state, FrameState::Converged, "{status:?}");
    assert_eq!((status.fraction, status.pixels_exact), (1.0, status.pixels_total));
}

fn all_bytes(frame: &Frame) -> Vec<Vec<u8>> {
    Buffer::ALL.iter().map(|&b| frame.map(b).unwrap().bytes().to_vec()).collect()
}

fn colour(linear: &Mapped, x: u32, y: u32) -> [f32; 4] {
    let at = (y * linear.width() + x) as usize * 4;
    linear.floats().unwrap()[at..at + 4].try_into().unwrap()
}

/// A sphere so fine that its facets do not show in the tests below.
fn fine_sphere() -> Vec<Part> {
    vec![Part::white(5, scenes::sphere(200, 400))]
}

fn a_sphere_is_where_and_what_the_formula_says_in_both_cameras() {
    let context = built::context(2);
    let (scene, _) = built::scene(&context, &built::parts(&fine_sphere()));
    let frame = frame(&context, 101, 81);
    let (eye, at) = (DVec3::new(1.0, 2.0, 4.0), DVec3::new(0.1, 0.0, 0.0));
    for camera in [
        perspective(eye, at),
        Camera::Orthographic { eye, at, up: DVec3::Y, height: 2.6 },
    ] {
        render(&frame, &scene, &camera, &FrameSettings::default());
        let rays = camera.prepare(101, 81).unwrap();
        let depth = frame.map(Buffer::Depth).unwrap();
        let normal = frame.map(Buffer::Normal).unwrap();
        let (kind, part) = (frame.map(Buffer::Kind).unwrap(), frame.map(Buffer::Part).unwrap());
        let mut hits = 0;
        for i in 0..101 * 81usize {
            let ray = rays.ray((i % 101) as f64 + 0.5, (i / 101) as f64 + 0.5);
            let (b, c) = (ray.origin.dot(ray.dir.as_dvec3()), ray.origin.length_squared() - 1.0);
            let inside = b * b - c;
            let hit = kind.bytes()[i] == HitKind::Exact as u8;
            // Facets lie up to 6e-5 inside of the sphere.
            assert!(inside.abs() < 2e-3 || hit == (inside > 0.0), "pixel {i}: {inside}");
            assert_eq!(part.ids().unwrap()[i], if hit { 5 } else { NONE });
            if hit && inside > 2e-3 {
                hits += 1;
                let t = -b - inside.sqrt();
                let expected = t * ray.dir.as_dvec3().dot(rays.forward());
                assert!((f64::from(depth.floats().unwrap()[i]) - expected).abs() < 3e-3 / inside.sqrt());
                let n = DVec3::new(0.0, 1.0, 2.0).map(|a| f64::from(normal.floats().unwrap()[3 * i + a as usize]));
                let point = ray.origin + ray.dir.as_dvec3() * t;
                assert!(n.dot(point) > 0.999, "normal {n} at {point}");
            } else if !hit {
                assert_eq!(depth.floats().unwrap()[i], f32::INFINITY);
            }
        }
        assert!(hits > 1000);
    }
}

fn white_matt_surfaces_have_the_values_of_the_formula() {
    let context = built::context(0);
    let (scene, _) = built::scene(&context, &built::parts(&fine_sphere()));
    let frame = frame(&context, 33, 33);
    let camera = perspective(DVec3::Z * 6.0, DVec3::ZERO);
    let middle = |settings: &FrameSettings| {
        render(&frame, &scene, &camera, settings);
        colour(&frame.map(Buffer::ColourLinear).unwrap(), 16, 16)
    };
    let close = |c: [f32; 4], v: f32| assert!((c[0] - v).abs() < 1e-3 && c[3] == 1.0, "{c:?}, expected {v}");
    let dark = FrameSettings { ambient: 0.0, ..Default::default() };
    // Facing the headlight: the irradiance itself. And the ambient term adds.
    close(middle(&dark), 1.0);
    close(middle(&FrameSettings { ambient: 0.25, ..dark }), 1.25);
    // All ambient light and nothing else: every pixel of the sphere is 1, as in a furnace.
    scene.set_lights(vec![]).unwrap();
    scene.commit().unwrap();
    let furnace = FrameSettings { ambient: 1.0, samples: 4, ..dark };
    render(&frame, &scene, &camera, &furnace);
    let (linear, kind) = (frame.map(Buffer::ColourLinear).unwrap(), frame.map(Buffer::Kind).unwrap());
    scene.set_background(Background::Colour([1.0; 4])).unwrap();
    scene.commit().unwrap();
    render(&frame, &scene, &camera, &furnace);
    let white = frame.map(Buffer::ColourLinear).unwrap();
    assert!(white.floats().unwrap().iter().all(|&c| (c - 1.0).abs() < 1e-6), "white on white is invisible");
    assert!(kind.bytes().contains(&1) && linear.floats().unwrap().iter().all(|c| c.is_finite()));
    // A directional light at 60 degrees, and a point light at distance 2 of the surface.
    let light = |kind| Light { kind, intensity: 2.0, colour: [1.0; 3], shadows: true };
    let slanted = DVec3::new(3.0f64.sqrt(), 0.0, -1.0);
    for (kind, value) in [
        (LightKind::Directional(slanted), 1.0),
        (LightKind::Directional(-slanted), 0.0),
        (LightKind::Point(DVec3::Z * 3.0), 0.5),
    ] {
        scene.set_lights(vec![light(kind)]).unwrap();
        scene.commit().unwrap();
        let c = middle(&dark);
        // The facets at the pole are tilted by 0.45 degrees.
        assert!((c[0] - value).abs() < 0.016, "{c:?}, expected {value}");
    }
}

fn shadows_fall_where_they_should_and_nowhere_else() {
    let context = built::context(2);
    let floor = scenes::plane_grid(16, 0.0);
    let middle = DVec3::new(8.0, 8.0, 2.0);
    let cube = scenes::cuboid(middle - 0.5, middle + 0.5);
    let file = built::parts(&[Part::white(1, floor), Part::white(2, cube)]);
    let far = DVec3::new(1e6, -2e6, 3e6);
    for at in [DVec3::ZERO, far] {
        let model = Model::open(&context, &file.path).unwrap();
        let scene = Scene::new(&context);
        scene.add_instance(&model, 1, DAffine3::from_translation(at)).unwrap();
        let sun = LightKind::Directional(DVec3::new(-0.5, 0.0, -1.0));
        scene.set_lights(vec![Light { kind: sun, shadows: true, ..Light::HEADLIGHT }]).unwrap();
        scene.commit().unwrap();
        let frame = frame(&context, 160, 160);
        // From below the cube, looking down at the floor from the side.
        let camera = Camera::Orthographic { eye: at + DVec3::new(8.0, 8.0, 1.0), at: at + DVec3::new(8.0, 8.0, 0.0), up: DVec3::Y, height: 16.0 };
        render(&frame, &scene, &camera, &FrameSettings { ambient: 0.1, ..Default::default() });
        let linear = frame.map(Buffer::ColourLinear).unwrap();
        let lit = 0.1 + 1.0 / 1.25f32.sqrt();
        let mut wrong = 0;
        for y in 0..160 {
            for x in 0..160 {
                let p = DVec3::new(f64::from(x) + 0.5, 159.5 - f64::from(y), 0.0) * 0.1;
                // The cube's shadow: from its bottom at 1.5 to its top at 2.5, moved by half of that.
                let dx = p.x - 8.0;
                let shadow = (-1.75..=-0.25).contains(&dx) && (p.y - 8.0).abs() <= 0.5;
                let value = colour(&linear, x, y)[0];
                let expected = if shadow { 0.1 } else { lit };
                let edge = [-1.75, -0.25].iter().any(|e| (dx - e).abs() < 0.06) || ((p.y - 8.0).abs() - 0.5).abs() < 0.06;
                wrong += u32::from(!edge && (value - expected).abs() > 1e-4);
            }
        }
        assert_eq!(wrong, 0, "at {at}");
    }
}

fn glass_hidden_recoloured_selected() {
    let context = built::context(1);
    let glass = MaterialDesc { colour: [0.0, 0.0, 1.0], opacity: 0.25, ..WHITE };
    let panes = |z: f64| scenes::plane_grid(2, z);
    let parts = [
        Part { id: 1, material: glass, tris: panes(2.0) },
        Part { id: 2, material: glass, tris: panes(1.0) },
        Part { id: 3, material: MaterialDesc { colour: [1.0, 0.0, 0.0], ..WHITE }, tris: panes(0.0) },
    ];
    let (scene, _) = built::scene(&context, &built::parts(&parts));
    scene.set_background(Background::Colour([0.0, 1.0, 0.0, 0.0])).unwrap();
    scene.commit().unwrap();
    let frame = frame(&context, 8, 8);
    let eye = DVec3::new(0.7, 0.6, 9.0);
    let camera = Camera::Orthographic { eye, at: eye - DVec3::Z, up: DVec3::Y, height: 0.1 };
    let see = || {
        render(&frame, &scene, &camera, &FrameSettings { ambient: 0.0, ..Default::default() });
        colour(&frame.map(Buffer::ColourLinear).unwrap(), 4, 4)
    };
    let close = |a: [f32; 4], b: [f32; 4]| {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{a:?}, expected {b:?}");
    };
    let blue = 0.25 + 0.75 * 0.25;
    close(see(), [0.75 * 0.75, 0.0, blue, 1.0]);
    assert_eq!(frame.map(Buffer::Part).unwrap().ids().unwrap()[0], 1, "what is seen first");
    let state = |part, state| {
        scene.set_part_state(7, part, state).unwrap();
        scene.commit().unwrap();
    };
    state(3, State { visible: false, ..State::default() });
    close(see(), [0.0, 0.75 * 0.75, blue, blue]);
    state(1, State { colour: Some([1.0, 1.0, 0.0, 1.0]), ..State::default() });
    close(see(), [1.0, 1.0, 0.0, 1.0]);
    scene.set_instance_state(7, State { colour: Some([0.5, 0.5, 0.5, 1.0]), ..State::default() }).unwrap();
    scene.commit().unwrap();
    close(see(), [1.0, 1.0, 0.0, 1.0]);
    state(1, State::default());
    close(see(), [0.5, 0.5, 0.5, 1.0]);
    let plain = see();
    state(1, State { selected: true, ..State::default() });
    let selected = see();
    assert!(selected[0] > plain[0] + 0.1 && selected[2] < plain[2] - 0.1, "{selected:?} is not highlighted");
}

fn busy_scene(context: &outcrop::Context) -> Scene {
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

fn the_same_bits_at_any_number_of_threads_and_with_any_vectors() {
    use outcrop::scene::{Context, ContextOptions};
    use outcrop::simd::Isa;
    let mut reference = None;
    for (threads, isa) in [(0, None), (1, None), (2, None), (3, Some(Isa::Baseline)), (1, Some(Isa::Avx2))] {
        if isa.is_some_and(|isa| !isa.is_available()) {
            continue;
        }
        let context = Context::new(ContextOptions { threads, isa, ..Default::default() }).unwrap();
        let scene = busy_scene(&context);
        let frame = frame(&context, 150, 97);
        let settings = FrameSettings { samples: 3, ..Default::default() };
        render(&frame, &scene, &perspective(DVec3::new(4.0, 3.0, 7.0), DVec3::ZERO), &settings);
        let bytes = all_bytes(&frame);
        assert!(*reference.get_or_insert_with(|| bytes.clone()) == bytes, "{threads} threads, {isa:?}");
    }
}

fn a_buffer_is_the_same_whatever_else_is_asked_for() {
    let context = built::context(2);
    let scene = busy_scene(&context);
    let camera = perspective(DVec3::new(4.0, 3.0, 7.0), DVec3::ZERO);
    for poe in [0.0, 30.0] {
        let settings = FrameSettings { poe, ..Default::default() };
        let rendered = |outputs: Outputs| {
            let frame = Frame::new(&context, FrameOptions { width: 150, height: 97, outputs, ..Default::default() }).unwrap();
            frame.request(&scene.state(), &camera, &settings).unwrap();
            assert_eq!(frame.wait(LONG).state, FrameState::Converged);
            frame
        };
        let all = rendered(Outputs::ALL);
        for buffer in Buffer::ALL {
            let alone = rendered(Outputs::of(buffer)).map(buffer).unwrap();
            assert!(alone.bytes() == all.map(buffer).unwrap().bytes(), "{buffer:?} at PoE {poe}");
        }
    }
}

/// Packets of plain pictures are worked out all at once, others surface by surface. Asking for depths makes all the latter:
/// nothing else may change by that, whatever the materials, states and lights, in exact pictures and with stand-ins, with any
/// vectors.
fn plain_packets_show_to_the_bit_what_others_show() {
    use outcrop::scene::{Context, ContextOptions};
    use outcrop::simd::Isa;
    const TINY: f64 = 1e-11;
    let material = |colour, metalness, roughness, opacity| MaterialDesc { colour, metalness, roughness, opacity };
    let part = |id, material, tris| Part { id, material, tris };
    let model = built::parts(&[
        part(1, material([0.9, 0.3, 0.1], 0.0, 0.6, 1.0), scenes::bumpy_sphere(150, 300, 4)),
        part(2, material([0.2, 0.8, 0.4], 0.7, 0.2, 1.0), scenes::boxes(500, 3)),
        part(3, material([0.3, 0.3, 0.9], 0.2, 0.0, 1.0), scenes::blocks(12, 2)),
        part(4, material([0.5, 0.6, 0.7], 0.0, 1.0, 0.4), scenes::plane_grid(6, -0.8)),
        part(5, material([1.0, 1.0, 0.2], 1.0, 0.05, 1.0), scenes::slivers().tris),
        // So small that the squares of normals leave the range of single precision.
        part(6, material([0.4, 0.9, 0.2], 0.3, 0.3, 1.0), scenes::sphere(20, 40).into_iter().map(|t| t.map(|v| scenes::rounded(v * TINY))).collect()),
    ]);
    let cameras = [
        perspective(DVec3::new(3.0, 1.5, 4.0), DVec3::new(0.2, 0.0, 0.0)),
        perspective(DVec3::new(-2.0, -1.5, -2.5) * TINY, DVec3::ZERO),
    ];
    for isa in Isa::ALL.into_iter().rev().filter(|isa| isa.is_available()).take(built::sized(Isa::ALL.len(), 1)) {
        let context = Context::new(ContextOptions { threads: 2, isa: Some(isa), ..Default::default() }).unwrap();
        let (scene, _) = built::scene(&context, &model);
        let blue = LightKind::Headlight;
        scene.set_lights(vec![Light::HEADLIGHT, Light { kind: blue, colour: [0.1, 0.2, 0.9], intensity: 0.5, shadows: false }]).unwrap();
        scene.set_part_state(7, 1, State { colour: Some([0.1, 0.9, 0.9, 1.0]), ..State::default() }).unwrap();
        scene.set_part_state(7, 3, State { selected: true, ..State::default() }).unwrap();
        scene.set_part_state(7, 5, State { visible: false, ..State::default() }).unwrap();
        scene.commit().unwrap();
        // Cells of a bvh go down to few triangles.
        let wide = built::sized(300.0, 10_000.0);
        for (poe, samples, camera) in [(0.0, 1, 0), (2.0, 3, 0), (wide, 1, 0), (10.0 * wide, 2, 0), (0.0, 1, 1)] {
            let settings = FrameSettings { poe, samples, ..Default::default() };
            let rendered = |outputs: Outputs| {
                let options = FrameOptions { width: 173, height: 110, outputs, ..Default::default() };
                let frame = Frame::new(&context, options).unwrap();
                frame.request(&scene.state(), &cameras[camera], &settings).unwrap();
                let status = frame.wait(LONG);
                assert_eq!(status.state, FrameState::Converged);
                (frame, status)
            };
            const NOT_PLAIN: [Buffer; 3] = [Buffer::Depth, Buffer::Error, Buffer::Primitive];
            let asked = Buffer::ALL.into_iter().filter(|b| !NOT_PLAIN.contains(b)).fold(Outputs(0), |all, b| all | Outputs::of(b));
            let ((plain, a), (other, b)) = (rendered(asked), rendered(Outputs::ALL));
            for buffer in Buffer::ALL.into_iter().filter(|b| !NOT_PLAIN.contains(b)) {
                let (plain, other) = (plain.map(buffer).unwrap(), other.map(buffer).unwrap());
                assert!(plain.bytes() == other.bytes(), "{buffer:?} at PoE {poe}, {isa:?}");
            }
            assert_eq!((a.pixels_exact, a.pixels_lod, a.pixels_missing), (b.pixels_exact, b.pixels_lod, b.pixels_missing));
            assert!((a.worst_error_px == b.worst_error_px) || a.pixels_lod == 0, "{a:?}, {b:?}");
            assert!(poe < wide || a.pixels_lod > 500, "{a:?}");
            let tiny = plain.map(Buffer::Part).unwrap().ids().unwrap().iter().filter(|id| **id == 6).count();
            assert_eq!(tiny > 5000, camera == 1, "{tiny} pixels of the small sphere");
        }
    }
}

fn what_is_not_in_memory_is_read_and_the_picture_is_the_same() {
    let context = built::context(2);
    let file = built::parts(&fine_sphere());
    let camera = perspective(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO);
    let sun = LightKind::Directional(DVec3::new(1.0, -2.0, -3.0));
    let picture = |model: Model| {
        let scene = Scene::new(&context);
        scene.add_instance(&model, 1, DAffine3::IDENTITY).unwrap();
        scene.set_lights(vec![Light { kind: sun, shadows: true, ..Light::HEADLIGHT }]).unwrap();
        scene.commit().unwrap();
        let frame = frame(&context, 120, 90);
        frame.request(&scene.state(), &camera, &FrameSettings::default()).unwrap();
        let mut fraction = 0.0;
        loop {
            let status = frame.wait(Duration::from_micros(200));
            assert!(status.fraction >= fraction, "from {fraction} back to {}", status.fraction);
            fraction = status.fraction;
            if status.state != FrameState::Running {
                assert_eq!(status.state, FrameState::Converged);
                return all_bytes(&frame);
            }
        }
    };
    let warm = picture(Model::open(&context, &file.path).unwrap());
    assert!(warm == picture(Model::open_cold(&context, &file.path).unwrap()));
}

fn picks_are_what_the_buffers_say() {
    let context = built::context(2);
    let scene = busy_scene(&context);
    let frame = frame(&context, 64, 48);
    assert!(frame.pick(0, 0).is_err() && frame.map(Buffer::Depth).is_err(), "before the first request");
    let camera = perspective(DVec3::new(4.0, 3.0, 7.0), DVec3::ZERO);
    render(&frame, &scene, &camera, &FrameSettings::default());
    let (part, prim) = (frame.map(Buffer::Part).unwrap(), frame.map(Buffer::Primitive).unwrap());
    for (x, y) in [(0, 0), (32, 24), (40, 20), (20, 30), (63, 47)] {
        let hit = frame.pick(x, y).unwrap();
        let at = (y * 64 + x) as usize;
        assert_eq!((hit.part, hit.prim), (part.ids().unwrap()[at], prim.ids().unwrap()[at]));
    }
    assert!(matches!(frame.pick(64, 0), Err(outcrop::Error::BadArgument(_))));
}

#[test]
fn bad_requests_change_nothing() {
    let (context, other) = (built::context(0), built::context(0));
    let scene = busy_scene(&context);
    let frame = frame(&context, 16, 16);
    let good = perspective(DVec3::Z * 9.0, DVec3::ZERO);
    render(&frame, &scene, &good, &FrameSettings::default());
    let before = all_bytes(&frame);
    let defaults = FrameSettings::default();
    let bad_settings = [
        FrameSettings { samples: 0, ..defaults },
        FrameSettings { samples: 1025, ..defaults },
        FrameSettings { poe: -1.0, ..defaults },
        FrameSettings { ambient: f32::NAN, ..defaults },
    ];
    for settings in bad_settings {
        assert!(frame.request(&scene.state(), &good, &settings).is_err());
    }
    let eye = DVec3::Z * 9.0;
    for camera in [
        perspective(eye, eye),
        perspective(DVec3::NAN, DVec3::ZERO),
        Camera::Perspective { eye, at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 },
        Camera::Perspective { eye, at: DVec3::ZERO, up: DVec3::Y, fov_y_degrees: 180.0 },
        Camera::Orthographic { eye, at: DVec3::ZERO, up: DVec3::Y, height: 0.0 },
    ] {
        assert!(frame.request(&scene.state(), &camera, &defaults).is_err(), "{camera:?}");
    }
    assert!(frame.request(&Scene::new(&other).state(), &good, &defaults).is_err());
    assert!(frame.resize(0, 5).is_err() && frame.resize(70_000, 5).is_err());
    assert_eq!((frame.poll().state, frame.poll().request), (FrameState::Converged, 1));
    assert!(before == all_bytes(&frame));
}

fn resizing_and_mapping_across_requests() {
    let context = built::context(1);
    let scene = busy_scene(&context);
    let frame = frame(&context, 40, 30);
    let camera = perspective(DVec3::Z * 9.0, DVec3::ZERO);
    render(&frame, &scene, &camera, &FrameSettings::default());
    let old = frame.map(Buffer::ColourSrgb8).unwrap();
    let copy = old.bytes().to_vec();
    frame.resize(50, 20).unwrap();
    assert_eq!(frame.map(Buffer::Depth).unwrap().width(), 40, "until the next is complete");
    for _ in 0..3 {
        render(&frame, &scene, &camera, &FrameSettings::default());
    }
    let new = frame.map(Buffer::ColourSrgb8).unwrap();
    assert_eq!((new.width(), new.height(), new.row_pitch(), new.bytes().len()), (50, 20, 200, 4000));
    assert_eq!((new.request(), old.request()), (4, 1));
    assert!(old.bytes() == copy, "a mapping stays as it was");
}

/// The caller's memory; notices two writers at once.
struct Memory {
    rows: Vec<Mutex<Vec<u8>>>,
    size: usize,
}

impl Target for Memory {
    fn write(&self, x: u32, y: u32, pixels: &[u8]) {
        let mut row = self.rows[y as usize].lock().unwrap();
        let at = x as usize * self.size;
        row[at..at + pixels.len()].copy_from_slice(pixels);
    }
}

fn the_callers_memory_gets_what_a_mapping_shows() {
    let context = built::context(2);
    let scene = busy_scene(&context);
    let (width, height) = (70, 45);
    let memory = |b: Buffer| {
        let row = || Mutex::new(vec![0xEE; width as usize * b.pixel_bytes()]);
        Arc::new(Memory { rows: (0..height).map(|_| row()).collect(), size: b.pixel_bytes() })
    };
    let all = Buffer::ALL.map(|b| (b, memory(b)));
    let targets = all.iter().map(|(b, m)| (*b, m.clone() as Arc<dyn Target>)).collect();
    let frame = Frame::new(&context, FrameOptions { width, height, outputs: Outputs::ALL, targets }).unwrap();
    let camera = perspective(DVec3::new(4.0, 3.0, 7.0), DVec3::ZERO);
    for i in 0..5 {
        let aside = perspective(DVec3::new(f64::from(i), 3.0, 7.0), DVec3::ZERO);
        frame.request(&scene.state(), &aside, &FrameSettings::default()).unwrap();
    }
    render(&frame, &scene, &camera, &FrameSettings::default());
    for (buffer, memory) in &all {
        let rows: Vec<u8> = memory.rows.iter().flat_map(|r| r.lock().unwrap().clone()).collect();
        assert!(rows == frame.map(*buffer).unwrap().bytes(), "{buffer:?}");
    }
    frame.request(&scene.state(), &camera, &FrameSettings::default()).unwrap();
    frame.resize(30, 30).unwrap();
    assert!(all.iter().all(|(_, m)| Arc::strong_count(m) == 1), "a resize lets go of the targets");
}

fn wake_is_called_once_for_each_ending_and_never_for_what_was_replaced() {
    for threads in [0, 2] {
        let context = built::context(threads);
        let scene = busy_scene(&context);
        let frame = Arc::new(frame(&context, 64, 64));
        let seen = Arc::new(Mutex::new(Vec::new()));
        let (log, weak) = (Arc::clone(&seen), Arc::downgrade(&frame));
        frame.set_wake(Some(Arc::new(move || {
            // The status is final when the wake comes.
            let status = weak.upgrade().unwrap().poll();
            // Better pictures wake too.
            if status.state != FrameState::Running {
                log.lock().unwrap().push((status.request, status.state));
            }
        })));
        let camera = perspective(DVec3::Z * 9.0, DVec3::ZERO);
        render(&frame, &scene, &camera, &FrameSettings::default());
        frame.request(&scene.state(), &camera, &FrameSettings { samples: 1024, ..Default::default() }).unwrap();
        frame.cancel();
        assert_eq!(frame.wait(LONG).state, FrameState::Cancelled);
        while Arc::strong_count(&frame) > 1 || seen.lock().unwrap().len() < 2 {
            std::thread::yield_now();
        }
        assert_eq!(*seen.lock().unwrap(), [(1, FrameState::Converged), (2, FrameState::Cancelled)]);
        frame.set_wake(None);
    }
}

/// 1000 requests and cancels of one frame while another renders and queries run: cancels are prompt, fractions
/// never go back, and what is mapped is always exactly one of the two pictures.
#[test]
fn a_thousand_requests_and_cancels_while_queries_run() {
    let context = built::context(2);
    let scene = busy_scene(&context);
    let frame = frame(&context, 1024, 768);
    let cameras = [perspective(DVec3::new(4.0, 3.0, 7.0), DVec3::ZERO), perspective(DVec3::new(-4.0, 1.0, 6.0), DVec3::ZERO)];
    let settings = FrameSettings::default();
    let references: Vec<Vec<u8>> = cameras
        .iter()
        .map(|camera| {
            render(&frame, &scene, camera, &settings);
            frame.map(Buffer::ColourSrgb8).unwrap().bytes().to_vec()
        })
        .collect();
    let stop = AtomicBool::new(false);
    let (asked, pictures) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let mut cancels = Vec::new();
    std::thread::scope(|threads| {
        threads.spawn(|| {
            let state = scene.state();
            let rays: Vec<Ray> = (0..4096)
                .map(|i| Ray::new(DVec3::new(f64::from(i % 64) * 0.05 - 1.6, f64::from(i / 64) * 0.05 - 1.6, 9.0), -Vec3::Z))
                .collect();
            let mut hits = vec![Hit::MISS; rays.len()];
            let mut first = None;
            while !stop.load(SeqCst) {
                state.closest(&rays, QueryOptions::default(), &mut hits).unwrap();
                assert!(*first.get_or_insert_with(|| hits.clone()) == hits);
                asked.fetch_add(1, SeqCst);
            }
        });
        threads.spawn(|| {
            let other = Frame::new(&context, FrameOptions { width: 200, height: 150, ..Default::default() }).unwrap();
            while !stop.load(SeqCst) {
                other.request(&scene.state(), &cameras[0], &settings).unwrap();
                assert_eq!(other.wait(LONG).state, FrameState::Converged);
                pictures.fetch_add(1, SeqCst);
            }
        });
        for i in 0..1000usize {
            frame.request(&scene.state(), &cameras[i % 2], &settings).unwrap();
            if i % 250 == 249 {
                assert_eq!(frame.wait(LONG).state, FrameState::Converged);
            } else {
                let mut fraction = 0.0;
                for _ in 0..i % 4 {
                    let status = frame.wait(Duration::from_micros(500));
                    assert!(status.fraction >= fraction && status.request == i as u64 + 3);
                    fraction = status.fraction;
                }
                if i % 3 != 0 {
                    let begun = Instant::now();
                    frame.cancel();
                    let status = frame.wait(LONG);
                    cancels.push(begun.elapsed());
                    assert!(matches!(status.state, FrameState::Cancelled | FrameState::Converged));
                }
            }
            if i % 20 == 0 {
                let mapped = frame.map(Buffer::ColourSrgb8).unwrap();
                assert!(references.iter().any(|r| r == mapped.bytes()), "request {i}: a torn picture");
            }
        }
        stop.store(true, SeqCst);
    });
    cancels.sort();
    let at = |share: f64| cancels[(cancels.len() as f64 * share) as usize];
    println!("cancel at 1024x768: median {:?}, p99 {:?}, worst {:?}, of {}", at(0.5), at(0.99), cancels[cancels.len() - 1], cancels.len());
    println!("meanwhile {} batches of 4096 rays and {} pictures", asked.load(SeqCst), pictures.load(SeqCst));
    assert!(asked.load(SeqCst) > 0 && pictures.load(SeqCst) > 0);
}

/// Once a frame is gone nobody is in its wake function any more: what that uses may go too.
fn dropping_a_frame_waits_for_whoever_is_being_woken() {
    let context = built::context(2);
    let (scene, _) = built::scene(&context, &built::parts(&fine_sphere()));
    let mut called = 0;
    for i in 0..30 {
        let frame = frame(&context, 64, 48);
        let counts = Arc::new([const { AtomicUsize::new(0) }; 2]);
        let within = Arc::clone(&counts);
        frame.set_wake(Some(Arc::new(move || {
            within[0].fetch_add(1, SeqCst);
            std::thread::sleep(Duration::from_millis(5));
            within[1].fetch_add(1, SeqCst);
        })));
        let settings = FrameSettings { samples: 4, ..Default::default() };
        frame.request(&scene.state(), &perspective(DVec3::new(1.0, 2.0, 4.0), DVec3::ZERO), &settings).expect("a request");
        std::thread::sleep(Duration::from_millis(i));
        drop(frame);
        let [begun, ended] = [0, 1].map(|at| counts[at].load(SeqCst));
        assert_eq!(begun, ended, "somebody is still in the wake function");
        called += begun;
    }
    assert!(called > 0);
}

built::on_each_structure!(
    a_sphere_is_where_and_what_the_formula_says_in_both_cameras,
    white_matt_surfaces_have_the_values_of_the_formula,
    shadows_fall_where_they_should_and_nowhere_else,
    glass_hidden_recoloured_selected,
    the_same_bits_at_any_number_of_threads_and_with_any_vectors,
    a_buffer_is_the_same_whatever_else_is_asked_for,
    plain_packets_show_to_the_bit_what_others_show,
    what_is_not_in_memory_is_read_and_the_picture_is_the_same,
    picks_are_what_the_buffers_say,
    resizing_and_mapping_across_requests,
    the_callers_memory_gets_what_a_mapping_shows,
    wake_is_called_once_for_each_ending_and_never_for_what_was_replaced,
    dropping_a_frame_waits_for_whoever_is_being_woken,
);
