//! Coordinates ten million units from zero, at every accuracy: an instance taken there looks as it does at zero. Meshes
//! whose own coordinates are there, and shifts that are rounded, are `tests/far_away.rs`.

use super::pictures::{POE, Picture, Setting, Stage, perspective, sun};
use crate::common::built::{self, Part};
use crate::common::scenes;
use glam::{DAffine3, DVec3};
use outcrop::render::Buffer;
use outcrop::scene::Light;

const FAR: DVec3 = DVec3::new(1e7, -2e7, 1e7);

/// Pixels that differ in a buffer. Depths may be neighbouring floats: their last rounding may tip far from zero.
fn differing(a: &Picture, b: &Picture, buffer: Buffer) -> usize {
    let size = buffer.pixel_bytes();
    let bits = |p: &[u8]| i64::from(u32::from_ne_bytes(p.try_into().expect("a float")));
    let pixels = a.bytes(buffer).chunks(size).zip(b.bytes(buffer).chunks(size));
    pixels.filter(|(p, q)| p != q && !(buffer == Buffer::Depth && (bits(p) - bits(q)).abs() <= 1)).count()
}

#[test]
fn the_same_picture_at_any_accuracy() {
    let ball = scenes::bumpy_sphere(120, 200, 2);
    let floor = scenes::plane_grid(64, 0.0).into_iter().map(|t| t.map(|v| v / 8.0 - DVec3::new(4.0, 4.0, 1.5)));
    let file = built::parts(&[Part::white(1, ball), Part::white(2, floor.collect())]);
    let lights = vec![Light { intensity: 0.4, ..Light::HEADLIGHT }, sun(DVec3::new(-1.0, 0.5, -2.0))];
    let setting = Setting { lights, ambient: 0.1, samples: 2, ..Setting::default() };
    let places = |by| [DAffine3::from_translation(by), DAffine3::from_translation(by + DVec3::new(2.5, 0.5, 0.25))];
    let here = Stage::placed(&file.path, &places(DVec3::ZERO), setting.clone());
    let there = Stage::placed(&file.path, &places(FAR), setting);
    // Eyes on small fractions, so that moving them rounds nothing.
    let mut stand_ins = 0;
    for (eye, at) in
        [(DVec3::new(4.5, 5.25, 3.125), DVec3::ZERO), (DVec3::new(1.25, -1.5, 0.25), DVec3::new(0.5, 0.0, 0.25))]
    {
        for poe in POE {
            let truth = here.picture(&perspective(eye, at), poe);
            let far = there.picture(&perspective(eye + FAR, at + FAR), poe);
            // The error says more far from zero.
            for buffer in Buffer::ALL.into_iter().filter(|b| *b != Buffer::Error) {
                assert_eq!(differing(&truth, &far, buffer), 0, "PoE {poe}, {buffer:?}: pixels differ");
            }
            assert!(truth.covered().filter(|c| *c).count() > 2000, "PoE {poe}: little is seen");
            stand_ins += truth.stand_ins();
            println!("PoE {poe}: the same, {} stand-ins", truth.stand_ins());
        }
    }
    assert!(stand_ins > 1000, "{stand_ins}");
}
