//! Mean radiance of five models, of what the exact picture covers: by the light of the eye and a sun, with and without shadows.

use super::pictures::{POE, Setting, Stage, sun};
use super::table::judge;
use crate::common::built::{self, Part};
use crate::common::picture::radiance_ratio;
use crate::common::scenes;
use glam::DVec3;
use outcrop::scene::{Camera, Light};

/// Off a mean radiance, as a share of it, by pixels of error.
fn line(poe: f32) -> f64 {
    if poe <= 1.0 { 0.01 } else { 0.03 }
}

#[test]
fn of_five_models() {
    for shadows in [false, true] {
        let mut off = [0.0f64; POE.len()];
        for soup in scenes::five() {
            let sun = Light { shadows, ..sun(DVec3::new(-1.0, 2.0, -2.5)) };
            let lights = vec![Light { intensity: 0.4, ..Light::HEADLIGHT }, sun];
            let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            soup.tris.iter().flatten().for_each(|v| (low, high) = (low.min(*v), high.max(*v)));
            let (middle, size) = ((low + high) * 0.5, (high - low).length());
            let file = built::parts(&[Part::white(1, soup.tris)]);
            let stage = Stage::new(&file.path, Setting { lights, ambient: 0.1, samples: 4, ..Setting::default() });
            for from in [DVec3::new(0.6, -0.9, 0.5), DVec3::new(-0.8, 0.3, 0.25)] {
                let camera = Camera::Perspective { eye: middle + from * size, at: middle, up: DVec3::Z, fov_y_degrees: 45.0 };
                let exact = stage.picture(&camera, 0.0);
                let is_covered: Vec<bool> = exact.coverage().map(|c| c > 0.0).collect();
                assert!(is_covered.iter().filter(|c| **c).count() > 500, "{}: little is seen", soup.name);
                let ratios = POE.map(|poe| {
                    radiance_ratio(stage.picture(&camera, poe).colours(), exact.colours(), |i| is_covered[i])
                });
                println!("{}, shadows {shadows}: {ratios:.4?} of the radiance", soup.name);
                off.iter_mut().zip(ratios).for_each(|(off, ratio)| *off = off.max((ratio - 1.0).abs()));
            }
        }
        let name = if shadows { "radiance with shadows" } else { "radiance without shadows" };
        judge(name, &std::array::from_fn::<_, 5, _>(|p| (POE[p], off[p], line(POE[p]))));
    }
}
