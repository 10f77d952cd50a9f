//! From light to bytes: gradients without bands, white parts that keep their shading, exposure, and exact colours.

use crate::common::built::{self, Part};
use crate::common::frames::{fine_sphere, frame, perspective, render};
use crate::common::scenes;
use glam::DVec3;
use outcrop::math::srgb;
use outcrop::render::{Buffer, Frame, FrameSettings};
use outcrop::scene::{Background, Scene};

fn colours(frame: &Frame) -> Vec<[u8; 4]> {
    frame.map(Buffer::ColourSrgb8).unwrap().bytes().as_chunks().0.to_vec()
}

/// The nearest level to each linear colour; alpha too.
fn levels(frame: &Frame) -> Vec<[u8; 4]> {
    let linear = frame.map(Buffer::ColourLinear).unwrap();
    let of = |c: &[f32; 4]| {
        let [r, g, b, a] = *c;
        [srgb::level(r), srgb::level(g), srgb::level(b), (a * 255.0).round() as u8]
    };
    linear.floats().unwrap().as_chunks().0.iter().map(of).collect()
}

const EXACT: FrameSettings =
    FrameSettings { poe: 0.0, samples: 1, ambient: 0.15, at_once: false, exposure: 1.0, exact_colours: true };
const USUAL: FrameSettings = FrameSettings { exact_colours: false, ..EXACT };

/// Height of the highest band: rows that have one and the same colour.
fn highest_band(colours: &[[u8; 4]], width: usize) -> usize {
    let rows: Vec<_> = colours.chunks(width).collect();
    let is_plain = |row: &[[u8; 4]]| row.iter().all(|c| *c == row[0]);
    rows.chunk_by(|a, b| is_plain(a) && a == b).map(<[_]>::len).max().unwrap_or(0)
}

#[test]
fn the_background_has_no_bands() {
    let context = built::context(2);
    let scene = Scene::new(&context);
    scene.set_background(Background::Gradient { bottom: [0.2, 0.2, 0.2, 0.4], top: [0.3, 0.3, 0.3, 0.4] }).unwrap();
    scene.commit().unwrap();
    let frame = frame(&context, 64, 768);
    let camera = perspective(DVec3::Z, DVec3::ZERO);
    render(&frame, &scene, &camera, &EXACT);
    let banded = highest_band(&colours(&frame), 64);
    render(&frame, &scene, &camera, &USUAL);
    let dithered = colours(&frame);
    let left = highest_band(&dithered, 64);
    assert!(banded > 30 && left <= banded / 4, "bands of {banded} rows, dithered of {left}");
    let nearest = levels(&frame);
    assert!(dithered.iter().zip(&nearest).all(|(a, b)| (0..3).all(|c| a[c].abs_diff(b[c]) <= 1) && a[3] == 102));
    // Each row has the mean that bytes alone cannot have, and there is no visible step from one row to the next.
    let mean = |row: &[[u8; 4]]| row.iter().map(|c| f64::from(c[0])).sum::<f64>() / row.len() as f64;
    let rows: Vec<f64> = dithered.chunks(64 * 8).map(mean).collect();
    assert!(rows.windows(2).all(|two| two[1] < two[0] && two[0] - two[1] < 0.5), "{rows:?}");
}

#[test]
fn flat_colours_are_exact_and_bytes_do_not_depend_on_threads() {
    let camera = perspective(DVec3::Z, DVec3::ZERO);
    let mut seen = Vec::new();
    for threads in [1, 3] {
        let context = built::context(threads);
        let scene = Scene::new(&context);
        let frame = frame(&context, 70, 50);
        for level in [0u8, 1, 17, 128, 200, 254, 255] {
            let linear = srgb::decode(f32::from(level) / 255.0);
            scene.set_background(Background::Colour([linear, linear, linear, 1.0])).unwrap();
            scene.commit().unwrap();
            render(&frame, &scene, &camera, &USUAL);
            assert!(colours(&frame).iter().all(|c| *c == [level, level, level, 255]), "{level}");
        }
        scene.set_background(Background::default()).unwrap();
        scene.commit().unwrap();
        render(&frame, &scene, &camera, &USUAL);
        seen.push(colours(&frame));
    }
    assert!(seen.windows(2).all(|two| two[0] == two[1]));
}

#[test]
fn white_parts_stay_below_white_and_keep_their_shading() {
    let context = built::context(2);
    let (scene, _) = built::scene(&context, &built::parts(&fine_sphere()));
    scene.set_background(Background::Colour([1.0; 4])).unwrap();
    scene.commit().unwrap();
    let frame = frame(&context, 160, 160);
    let camera = perspective(DVec3::Z * 4.0, DVec3::ZERO);
    let share = |settings: FrameSettings| {
        render(&frame, &scene, &camera, &settings);
        let (seen, kinds) = (colours(&frame), frame.map(Buffer::Kind).unwrap());
        let on = |hit: bool| seen.iter().zip(kinds.bytes()).filter(move |(_, k)| (**k != 0) == hit).map(|(c, _)| *c);
        assert!(on(false).all(|c| c == [255; 4]), "the white background stays white");
        on(true).filter(|c| c[0] == 255).count() as f64 / on(true).count() as f64
    };
    let (burnt, left) = (share(EXACT), share(USUAL));
    assert!(burnt > 0.2 && left == 0.0, "{burnt:.3} of the sphere at 255, {left:.3} with the curve");
    // From the middle outwards the sphere darkens, within the rounding of dithering.
    let seen = colours(&frame);
    let row: Vec<u8> = (80..120).map(|x| seen[80 * 160 + x][0]).collect();
    assert!(row.windows(2).all(|two| two[1] <= two[0] + 1) && row[0] > row[39] + 8 && row[0] < 253, "{row:?}");
    // The linear buffer is as before.
    let linear = frame.map(Buffer::ColourLinear).unwrap();
    assert!((linear.floats().unwrap()[4 * (80 * 160 + 80)] - 1.15).abs() < 0.01);
}

#[test]
fn exposure_is_a_factor_to_surfaces_and_exact_colours_are_levels() {
    let context = built::context(1);
    let (scene, _) = built::scene(&context, &built::parts(&[Part::white(1, scenes::plane_grid(2, 0.0))]));
    scene.set_lights(Vec::new()).unwrap();
    scene.commit().unwrap();
    let frame = frame(&context, 64, 64);
    let camera = perspective(DVec3::new(0.0, 0.0, 6.0), DVec3::ZERO);
    for (ambient, exposure, shown) in [(0.2, 1.0, 0.2), (0.2, 3.0, 0.6), (0.5, 0.0, 0.0), (0.6, 2.0, 1.2)] {
        render(&frame, &scene, &camera, &FrameSettings { ambient, exposure, ..EXACT });
        let (seen, kinds) = (colours(&frame), frame.map(Buffer::Kind).unwrap());
        for ((seen, kind), nearest) in seen.iter().zip(kinds.bytes()).zip(levels(&frame)) {
            let expected = if *kind != 0 { [srgb::level(shown); 3] } else { [nearest[0], nearest[1], nearest[2]] };
            assert!((0..3).all(|c| seen[c].abs_diff(expected[c]) <= 1), "{seen:?} is not {expected:?}");
        }
        assert!(kinds.bytes().iter().any(|k| *k != 0) && kinds.bytes().contains(&0));
    }
    for exposure in [-1.0, f32::NAN, f32::INFINITY] {
        assert!(frame.request(&scene.state(), &camera, &FrameSettings { exposure, ..USUAL }).is_err());
    }
}
