//! Mean radiance of five models, of what the exact picture covers: by the light of the eye and a sun, with and without
//! shadows.

use super::pictures::{POE, Picture, Setting, Stage, sun};
use super::table::judge;
use crate::common::brute::Tri;
use crate::common::built::{self, Part};
use crate::common::picture::radiance_ratio;
use crate::common::scenes;
use glam::DVec3;
use outcrop::scene::{Camera, Light};

/// Off a mean radiance, as a share of it, by pixels of error.
fn line(poe: f32) -> f64 {
    if poe <= 1.0 { 0.01 } else { 0.03 }
}

/// A scan, parts of a machine, slivers, blocks with faces twice, and the scan far from zero; none from a file, so that
/// the figures are the same everywhere.
fn five() -> [(&'static str, Vec<Tri>); 5] {
    let scan = || scenes::bumpy_sphere(200, 300, 1);
    let stretch = |t: Tri| t.map(|v| scenes::rounded(v * DVec3::new(1.0, 0.02, 1.0)));
    let slivers = scenes::bumpy_sphere(600, 40, 3).into_iter().map(stretch).filter(scenes::has_area).collect();
    let far = scan().into_iter().map(|t| t.map(|v| v + DVec3::new(1e7, -1e7, 1e7))).collect();
    [
        ("scan", scan()),
        ("cad", scenes::boxes(6000, 2)),
        ("slivers", slivers),
        ("blocks", scenes::blocks(60, 4)),
        ("far", far),
    ]
}

#[test]
fn of_five_models() {
    // Without shadows and with.
    let mut off = [[0.0f64; POE.len()]; 2];
    for (name, tris) in five() {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        tris.iter().flatten().for_each(|v| (low, high) = (low.min(*v), high.max(*v)));
        let (middle, size) = ((low + high) * 0.5, (high - low).length());
        let file = built::parts(&[Part::white(1, tris)]);
        for (shadows, off) in [false, true].into_iter().zip(&mut off) {
            let sun = Light { shadows, ..sun(DVec3::new(-1.0, 2.0, -2.5)) };
            let lights = vec![Light { intensity: 0.4, ..Light::HEADLIGHT }, sun];
            let stage = Stage::new(&file.path, Setting { lights, ambient: 0.1, samples: 4, ..Setting::default() });
            for from in [DVec3::new(0.6, -0.9, 0.5), DVec3::new(-0.8, 0.3, 0.25)] {
                let camera =
                    Camera::Perspective { eye: middle + from * size, at: middle, up: DVec3::Z, fov_y_degrees: 45.0 };
                let exact = stage.picture(&camera, 0.0);
                let is_covered: Vec<bool> = exact.coverage().map(|c| c > 0.0).collect();
                assert!(is_covered.iter().filter(|c| **c).count() > 500, "{name}: little is seen");
                let covered = |picture: &Picture| -> f64 {
                    picture.coverage().zip(&is_covered).filter(|(_, counts)| **counts).map(|(c, _)| c).sum()
                };
                let (ratios, coverages): (Vec<f64>, Vec<f64>) = POE
                    .map(|poe| {
                        let picture = stage.picture(&camera, poe);
                        let ratio = radiance_ratio(picture.colours(), exact.colours(), |i| is_covered[i]);
                        (ratio, covered(&picture) / covered(&exact))
                    })
                    .into_iter()
                    .unzip();
                println!("{name}, shadows {shadows}: {ratios:.4?} of the radiance, {coverages:.4?} of the coverage");
                off.iter_mut().zip(ratios).for_each(|(off, ratio)| *off = off.max((ratio - 1.0).abs()));
            }
        }
    }
    for (name, off) in ["radiance without shadows", "radiance with shadows"].into_iter().zip(off) {
        judge(name, &std::array::from_fn::<_, 5, _>(|p| (POE[p], off[p], line(POE[p]))));
    }
}
