//! A slow zoom of 300 frames: what changes from frame to frame although the model does not is no larger than a stand-in may be.
//!
//! Let s be what a frame shows and t the exact picture from there, both coded as for a screen, 0 and 1 the frame before and
//! this one. A stand-in covers PoE pixels, and up to 2^(1/2) PoE as the threshold dithers; the surface in it lies within
//!
//! ```text
//! r = 1 + ceil(sqrt(2^(1/2) PoE))
//! ```
//!
//! pixels of where it is shown, unless it is long and thin. So the exact pictures explain a change by no more than they show
//! there, and a pixel p pops if, in any of its colours,
//!
//! ```text
//! abs(s1(p) - s0(p)) > max T - min T + 1/16,   T = { ti(q): i = 0, 1; abs(qx - px) <= r, abs(qy - py) <= r }
//! ```
//!
//! Pixels that pop in the same frame and touch are a patch. The line: no patch is larger than the area of a stand-in that
//! appears at once, 2^(1/2) PoE pixels, and the pixel around it that rays through its rim may add: (2^(1/4) sqrt(PoE) + 2)^2.

use super::pictures::{Picture, Setting, Stage, perspective, sun};
use super::table::judge;
use crate::common::built::{self, Built, Part};
use crate::common::picture::Colours;
use crate::common::popping::largest_patch;
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::DVec3;
use outcrop::base::progress::Cancel;
use outcrop::import::MaterialDesc;
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::scene::{Camera, Light};

const FRAMES: usize = 300;
const SIZE: (u32, u32) = (72, 54);
/// Of these every frame is looked at.
const POE: [f32; 4] = [0.5, 1.0, 3.0, 10.0];

/// What the exact pictures show around each pixel: the least and the most of each colour.
fn ranges(exact: &[Vec<[f64; 3]>; 2], radius: usize) -> Vec<[[f64; 2]; 3]> {
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let around = |at: usize, end: usize| at.saturating_sub(radius)..(at + radius + 1).min(end);
    let of = |i: usize| {
        let mut range = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
        for y in around(i / width, height) {
            for x in around(i % width, width) {
                for picture in exact {
                    for (range, value) in range.iter_mut().zip(picture[y * width + x]) {
                        *range = [range[0].min(value), range[1].max(value)];
                    }
                }
            }
        }
        range
    };
    (0..width * height).map(of).collect()
}

fn coded(picture: &Picture) -> Vec<[f64; 3]> {
    let colours: Colours = picture.coded();
    (0..colours.count()).map(|i| colours.coded(i)).collect()
}

/// Of each pixel, whether it pops.
fn popped(seen: &[Vec<[f64; 3]>; 2], exact: &[Vec<[f64; 3]>; 2], poe: f32) -> Vec<bool> {
    let radius = 1 + (2f64.sqrt() * f64::from(poe)).sqrt().ceil() as usize;
    let pops = |(i, range): (usize, &[[f64; 2]; 3])| {
        (0..3).any(|c| (seen[1][i][c] - seen[0][i][c]).abs() > range[c][1] - range[c][0] + 1.0 / 16.0)
    };
    ranges(exact, radius).iter().enumerate().map(pops).collect()
}

/// Zooms from `camera(0)` to `camera(1)`.
fn check(name: &str, file: &Built, camera: impl Fn(f64) -> Camera) {
    let lights = vec![Light { intensity: 0.3, ..Light::HEADLIGHT }, sun(DVec3::new(-1.0, 2.0, -2.0))];
    let setting = Setting { lights, ambient: 0.1, size: SIZE, ..Setting::default() };
    let stage = Stage::new(&file.path, setting);
    let (mut largest, mut pixels) = ([0usize; POE.len()], [0usize; POE.len()]);
    let mut exact: [Vec<[f64; 3]>; 2] = Default::default();
    let mut seen: [[Vec<[f64; 3]>; 2]; POE.len()] = Default::default();
    let mut stand_ins = [0; POE.len()];
    for n in 0..FRAMES {
        let camera = camera(n as f64 / (FRAMES - 1) as f64);
        // All ways now and then: that they are the same is other rows' business too.
        let picture = |poe| if n % 60 == 30 { stage.picture(&camera, poe) } else { stage.quick(&camera, poe) };
        exact = [std::mem::take(&mut exact[1]), coded(&picture(0.0))];
        for (p, poe) in POE.into_iter().enumerate() {
            let now = picture(poe);
            stand_ins[p] += now.stand_ins();
            seen[p] = [std::mem::take(&mut seen[p][1]), coded(&now)];
            if n > 0 {
                let popped = popped(&seen[p], &exact, poe);
                pixels[p] += popped.iter().filter(|p| **p).count();
                largest[p] = largest[p].max(largest_patch(popped, SIZE.0 as usize));
            }
        }
    }
    for (p, poe) in POE.into_iter().enumerate() {
        let each = pixels[p] as f64 / (FRAMES - 1) as f64;
        println!("{name}, PoE {poe}: {each:.2} of {} pixels pop a frame, {} stand-ins", SIZE.0 * SIZE.1, stand_ins[p] / FRAMES);
        assert!(poe < 1.0 || stand_ins[p] > 100 * FRAMES, "{name}, PoE {poe}: nothing stands in");
    }
    let line = |poe: f32| (2f64.powf(0.25) * f64::from(poe).sqrt() + 2.0).powi(2);
    let patches: Vec<_> = POE.iter().zip(largest).map(|(poe, n)| (*poe, n as f64, line(*poe))).collect();
    judge(&format!("{name}: largest patch that pops"), &patches);
}

#[test]
fn onto_a_mandelbulb() {
    let file = built::build(|builder| {
        let options = GenerateOptions { triangles: 200_000, seed: 0 };
        generate("mandelbulb", &options, &Cancel::new(), builder).expect("a mandelbulb");
    });
    check("mandelbulb", &file, |s| perspective(DVec3::new(1.0, -0.8, 0.6) * (4.0 - 2.4 * s), DVec3::new(0.1, 0.0, 0.2)));
}

/// Boxes and balls of all sizes in all colours, and wires among them.
fn soup() -> Built {
    let mut rng = Rng::new(19);
    let mut parts = Vec::new();
    for k in 0..400 {
        let at = rng.inside(DVec3::splat(-4.0), DVec3::splat(4.0));
        let size = 0.6 * rng.unit().powi(3) + 0.05;
        let tris = if k % 4 == 0 {
            scenes::sphere(16, 24).into_iter().map(|t| t.map(|v| scenes::rounded(v * size + at))).collect()
        } else {
            scenes::cuboid(scenes::rounded(at - size), scenes::rounded(at + size * rng.unit()))
        };
        let material = MaterialDesc { colour: [0; 3].map(|_| rng.unit() as f32), ..built::WHITE };
        parts.push(Part { id: k, material, tris });
    }
    let wires = scenes::wire_forest(150, 12, 4).into_iter().map(|t| t.map(|v| v - DVec3::Z * 3.0)).collect();
    parts.push(Part::white(1000, wires));
    built::parts(&parts)
}

#[test]
fn onto_a_soup() {
    check("soup", &soup(), |s| perspective(DVec3::new(3.0, -9.0, 4.0) * (3.0 - 2.0 * s), DVec3::ZERO));
}
