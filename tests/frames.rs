//! Frames through the public API: what is seen. The life of requests is `tests/frame_requests.rs`.

use crate::common::built::{self, Part, WHITE};
use crate::common::frames::{LONG, all_bytes, busy_scene, fine_sphere, frame, perspective, render};
use crate::common::scenes;
use glam::{DAffine3, DVec3};
use outcrop::import::MaterialDesc;
use outcrop::query::{HitKind, NONE};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Mapped, Outputs};
use outcrop::scene::{Background, Camera, Light, LightKind, Look, Model, Scene};
use std::time::Duration;

fn colour(linear: &Mapped, x: u32, y: u32) -> [f32; 4] {
    let at = (y * linear.width() + x) as usize * 4;
    linear.floats().unwrap()[at..at + 4].try_into().unwrap()
}

fn a_sphere_is_where_and_what_the_formula_says_in_both_cameras() {
    let context = built::context(2);
    let (scene, _) = built::scene(&context, &built::parts(&fine_sphere()));
    let frame = frame(&context, 101, 81);
    let (eye, at) = (DVec3::new(1.0, 2.0, 4.0), DVec3::new(0.1, 0.0, 0.0));
    for camera in [perspective(eye, at), Camera::Orthographic { eye, at, up: DVec3::Y, height: 2.6 }] {
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
        let camera = Camera::Orthographic {
            eye: at + DVec3::new(8.0, 8.0, 1.0),
            at: at + DVec3::new(8.0, 8.0, 0.0),
            up: DVec3::Y,
            height: 16.0,
        };
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
                let edge =
                    [-1.75, -0.25].iter().any(|e| (dx - e).abs() < 0.06) || ((p.y - 8.0).abs() - 0.5).abs() < 0.06;
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
        scene.set_part_look(7, part, state).unwrap();
        scene.commit().unwrap();
    };
    state(3, Look { visible: false, ..Look::default() });
    close(see(), [0.0, 0.75 * 0.75, blue, blue]);
    state(1, Look { colour: Some([1.0, 1.0, 0.0, 1.0]), ..Look::default() });
    close(see(), [1.0, 1.0, 0.0, 1.0]);
    scene.set_instance_look(7, Look { colour: Some([0.5, 0.5, 0.5, 1.0]), ..Look::default() }).unwrap();
    scene.commit().unwrap();
    close(see(), [1.0, 1.0, 0.0, 1.0]);
    state(1, Look::default());
    close(see(), [0.5, 0.5, 0.5, 1.0]);
    let plain = see();
    state(1, Look { selected: true, ..Look::default() });
    let selected = see();
    assert!(selected[0] > plain[0] + 0.1 && selected[2] < plain[2] - 0.1, "{selected:?} is not highlighted");
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
            let frame =
                Frame::new(&context, FrameOptions { width: 150, height: 97, outputs, ..Default::default() }).unwrap();
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

/// Depths, errors and primitive ids are further work on the same surfaces. Nothing else may change by that, whatever
/// the materials, states and lights, in exact pictures and with stand-ins, with any vectors.
fn further_buffers_change_no_other_bit() {
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
        part(
            6,
            material([0.4, 0.9, 0.2], 0.3, 0.3, 1.0),
            scenes::sphere(20, 40).into_iter().map(|t| t.map(|v| scenes::rounded(v * TINY))).collect(),
        ),
    ]);
    let cameras = [
        perspective(DVec3::new(3.0, 1.5, 4.0), DVec3::new(0.2, 0.0, 0.0)),
        perspective(DVec3::new(-2.0, -1.5, -2.5) * TINY, DVec3::ZERO),
    ];
    for isa in Isa::ALL.into_iter().rev().filter(|isa| isa.is_available()).take(built::sized(Isa::ALL.len(), 1)) {
        let context = Context::new(ContextOptions { threads: 2, isa: Some(isa), ..Default::default() }).unwrap();
        let (scene, _) = built::scene(&context, &model);
        let blue = LightKind::Headlight;
        scene
            .set_lights(vec![
                Light::HEADLIGHT,
                Light { kind: blue, colour: [0.1, 0.2, 0.9], intensity: 0.5, shadows: false },
            ])
            .unwrap();
        scene.set_part_look(7, 1, Look { colour: Some([0.1, 0.9, 0.9, 1.0]), ..Look::default() }).unwrap();
        scene.set_part_look(7, 3, Look { selected: true, ..Look::default() }).unwrap();
        scene.set_part_look(7, 5, Look { visible: false, ..Look::default() }).unwrap();
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
            const FURTHER: [Buffer; 3] = [Buffer::Depth, Buffer::Error, Buffer::Primitive];
            let asked = Buffer::ALL
                .into_iter()
                .filter(|b| !FURTHER.contains(b))
                .fold(Outputs(0), |all, b| all | Outputs::of(b));
            let ((plain, a), (other, b)) = (rendered(asked), rendered(Outputs::ALL));
            for buffer in Buffer::ALL.into_iter().filter(|b| !FURTHER.contains(b)) {
                let (plain, other) = (plain.map(buffer).unwrap(), other.map(buffer).unwrap());
                assert!(plain.bytes() == other.bytes(), "{buffer:?} at PoE {poe}, {isa:?}");
            }
            assert_eq!(
                (a.pixels_exact, a.pixels_lod, a.pixels_missing),
                (b.pixels_exact, b.pixels_lod, b.pixels_missing)
            );
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

built::on_each_structure!(
    a_sphere_is_where_and_what_the_formula_says_in_both_cameras,
    white_matt_surfaces_have_the_values_of_the_formula,
    shadows_fall_where_they_should_and_nowhere_else,
    glass_hidden_recoloured_selected,
    the_same_bits_at_any_number_of_threads_and_with_any_vectors,
    a_buffer_is_the_same_whatever_else_is_asked_for,
    further_buffers_change_no_other_bit,
    what_is_not_in_memory_is_read_and_the_picture_is_the_same,
    picks_are_what_the_buffers_say,
);
