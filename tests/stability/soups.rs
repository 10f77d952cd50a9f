//! A soup as of an old CAD file (the Boeing 777's): parts there twice, again a millionth beside, pushed through each
//! other.

use super::pictures::{POE, Setting, Stage, perspective, sun};
use crate::common::brute::Tri;
use crate::common::built::{self, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::DVec3;
use outcrop::import::MaterialDesc;
use outcrop::render::Buffer;
use outcrop::scene::Light;

const MILLIONTH: f64 = 1e-6;

fn colour(rng: &mut Rng) -> MaterialDesc {
    MaterialDesc { colour: [0; 3].map(|_| rng.unit() as f32), ..built::WHITE }
}

/// Boxes in [0, 4]^3, of each: itself, its double in another part and colour, and three copies jittered by a millionth,
/// some of them with all corners moved alike, some with each corner by itself, so that faces cross.
fn soup() -> Vec<Part> {
    let mut rng = Rng::new(777);
    let mut parts = Vec::new();
    for _ in 0..1500 {
        let at = rng.inside(DVec3::ZERO, DVec3::splat(3.7));
        let size = rng.inside(DVec3::splat(0.02), DVec3::splat(0.3));
        let own: Vec<Tri> = scenes::cuboid(scenes::rounded(at), scenes::rounded(at + size));
        let moved = own.iter().map(|t| t.map(|v| v + DVec3::splat(MILLIONTH))).collect();
        let jitter = |rng: &mut Rng| {
            let tris = own.iter().map(|t| t.map(|v| v + rng.direction() * MILLIONTH));
            tris.collect::<Vec<Tri>>()
        };
        let copies = [own.clone(), own.clone(), moved, jitter(&mut rng), jitter(&mut rng)];
        for tris in copies {
            parts.push(Part { id: parts.len() as u64, material: colour(&mut rng), tris });
        }
    }
    parts
}

#[test]
fn jittered_and_coincident_parts_do_not_flicker() {
    let lights = vec![Light { intensity: 0.4, ..Light::HEADLIGHT }, sun(DVec3::new(-1.0, 2.0, -3.0))];
    let setting = Setting { lights, ambient: 0.1, samples: 2, ..Setting::default() };
    let file = built::parts(&soup());
    let (stage, again) = (Stage::new(&file.path, setting.clone()), Stage::new(&file.path, setting));
    let middle = DVec3::splat(2.0);
    let cameras = [perspective(DVec3::new(9.0, -4.0, 6.0), middle), perspective(DVec3::new(-0.5, 0.2, 4.4), middle)];
    for poe in POE {
        let before = cameras.each_ref().map(|camera| stage.picture(camera, poe));
        let parts: std::collections::BTreeSet<&[u8]> = before[0].bytes(Buffer::Part).chunks(8).collect();
        assert!(parts.len() > 100, "PoE {poe}: of all parts {} are seen", parts.len());
        // The camera rests, was elsewhere, or the file is opened anew.
        for (camera, before) in cameras.iter().zip(&before) {
            for (now, what) in [(stage.quick(camera, poe), "rests"), (again.quick(camera, poe), "is opened anew")] {
                let differs = Buffer::ALL.into_iter().find(|b| now.bytes(*b) != before.bytes(*b));
                assert_eq!(differs, None, "PoE {poe}: it flickers where it {what}");
            }
        }
        println!("PoE {poe}: {} parts seen, {} stand-ins", parts.len(), before[0].stand_ins());
    }
}
