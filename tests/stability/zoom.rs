//! A slow zoom of 300 frames: what changes from frame to frame although the model does not is no larger than the pixels
//! of error explain.
//!
//! A pixel pops where what is shown changes by more than 1/8, from black to white being 1, beyond what the exact
//! picture changes ([`popping::pop`]); pixels that pop in the same frame and touch are a patch. A stand-in covers PoE
//! pixels, and up to 2^(1/2) PoE as thresholds dither; it appears or goes at once where all its pixels decide so at
//! once. Of neighbours some do in the same frame. So the line: no patch is larger than four stand-ins that meet at a
//! corner, with the pixel around them that rays through their rim may add,
//!
//! ```text
//! (2 * 2^(1/4) sqrt(PoE) + 2)^2
//! ```
//!
//! pixels: 14, 19, 37 and 91 at 0.5, 1, 3 and 10 pixels of error. (When the pixels of error jump to 8 times as many
//! from one frame to the next, the patches of the soup are of 29, 489 and 887 at the last three.)

use super::pictures::{Picture, Setting, Stage, perspective, sun};
use super::table::judge;
use crate::common::built::{self, Built, Part};
use crate::common::popping::{self, Shown};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::DVec3;
use outcrop::base::progress::Cancel;
use outcrop::import::MaterialDesc;
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::scene::{Camera, Light};

const FRAMES: usize = 300;
const SIZE: (u32, u32) = (72, 54);
const POE: [f32; 4] = [0.5, 1.0, 3.0, 10.0];

/// Zooms from `camera(0)` to `camera(1)`.
fn check(name: &str, file: &Built, camera: impl Fn(f64) -> Camera) {
    let lights = vec![Light { intensity: 0.3, ..Light::HEADLIGHT }, sun(DVec3::new(-1.0, 2.0, -2.0))];
    let stage = Stage::new(&file.path, Setting { lights, ambient: 0.1, size: SIZE, ..Setting::default() });
    let (mut pops, mut stand_ins) = ([0; POE.len()], [0; POE.len()]);
    // The exact picture, and those at each pixels of error.
    let mut last: Option<(Picture, [Picture; POE.len()])> = None;
    for n in 0..FRAMES {
        let camera = camera(n as f64 / (FRAMES - 1) as f64);
        // All ways now and then: that they are the same is other rows' business too.
        let picture = |poe| if n % 60 == 30 { stage.picture(&camera, poe) } else { stage.quick(&camera, poe) };
        let now = (picture(0.0), POE.map(picture));
        for p in 0..POE.len() {
            stand_ins[p] += now.1[p].stand_ins();
            if let Some((exact, shown)) = &last {
                let before = Shown { seen: shown[p].coded(), truth: exact.coded() };
                let after = Shown { seen: now.1[p].coded(), truth: now.0.coded() };
                pops[p] = pops[p].max(popping::pop(before, after, SIZE.0 as usize, 1.0 / 8.0).largest);
            }
        }
        last = Some(now);
    }
    for (n, poe) in stand_ins.into_iter().zip(POE) {
        println!("{name}, PoE {poe}: {} of {} pixels show stand-ins", n / FRAMES, SIZE.0 * SIZE.1);
        assert!(poe < 1.0 || n > 100 * FRAMES, "{name}, PoE {poe}: nothing stands in");
    }
    let line = |poe: f32| (2.0 * 2f64.powf(0.25) * f64::from(poe).sqrt() + 2.0).powi(2);
    let patches: [_; POE.len()] = std::array::from_fn(|p| (POE[p], pops[p] as f64, line(POE[p])));
    judge(&format!("{name}: largest patch that pops"), &patches);
}

#[test]
fn onto_a_mandelbulb() {
    let file = built::build(|builder| {
        let options = GenerateOptions { triangles: 200_000, seed: 0, ..Default::default() };
        generate("mandelbulb", &options, &Cancel::new(), builder).expect("a mandelbulb");
    });
    check("mandelbulb", &file, |s| {
        perspective(DVec3::new(1.0, -0.8, 0.6) * (4.0 - 2.4 * s), DVec3::new(0.1, 0.0, 0.2))
    });
}

/// Boxes and balls of all sizes in all colours.
fn soup() -> Built {
    let mut rng = Rng::new(19);
    let part = |k: u64| {
        let at = rng.inside(DVec3::splat(-4.0), DVec3::splat(4.0));
        let size = 0.6 * rng.unit().powi(3) + 0.05;
        let tris = if k.is_multiple_of(4) {
            scenes::sphere(32, 48).into_iter().map(|t| t.map(|v| scenes::rounded(v * size + at))).collect()
        } else {
            scenes::cuboid(scenes::rounded(at - size), scenes::rounded(at + size * rng.unit()))
        };
        Part { id: k, material: MaterialDesc { colour: [0; 3].map(|_| rng.unit() as f32), ..built::WHITE }, tris }
    };
    let parts: Vec<Part> = (0..400).map(part).collect();
    built::parts(&parts)
}

#[test]
fn onto_a_soup() {
    check("soup", &soup(), |s| perspective(DVec3::new(3.0, -9.0, 4.0) * (3.0 - 2.0 * s), DVec3::ZERO));
}

#[test]
fn onto_wires() {
    let file = built::parts(&[Part::white(1, scenes::wire_forest(500, 24, 4))]);
    let middle = DVec3::Z * 2.0;
    check("wires", &file, |s| perspective(middle + DVec3::new(3.0, -20.0, 5.0) * (2.0 - 1.3 * s), middle));
}
