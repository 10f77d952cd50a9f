//! Wires and leaves thinner than a voxel: their mean coverage is the oracle's.

use super::pictures::{POE, Setting, Stage};
use super::table::judge_each;
use crate::common::brute::Tri;
use crate::common::built::{self, Part};
use crate::common::bvh64::Bvh64;
use crate::common::light::Lighting;
use crate::common::picture::coverage_ratio;
use crate::common::rng::Rng;
use crate::common::samples::Samples;
use crate::common::scenes;
use crate::common::view::View;
use glam::DVec3;
use outcrop::scene::Camera;

const SIZE: (u32, u32) = (96, 72);
const VIEWS: usize = 6;
/// Off a mean coverage, as a share of it.
const LINE: f64 = 0.03;

/// From all around, seen whole, 1.5 pixels of a wire's cell across, and from among them.
fn wires() -> (Vec<Tri>, [Camera; VIEWS]) {
    let camera = |eye: DVec3, at: DVec3| Camera::Perspective { eye, at, up: DVec3::Z, fov_y_degrees: 40.0 };
    let around = |turn: f64| DVec3::new(turn.sin(), -turn.cos(), 0.0);
    let whole = |n: f64| camera(around(n * 2.1) * 26.0 + DVec3::Z * 6.0, DVec3::Z * 2.0);
    let among = |n: f64| camera(around(n * 2.1) * 4.0 + DVec3::Z * 2.0, DVec3::new(0.5, 0.0, 2.2));
    (scenes::wire_forest(500, 24, 3), [whole(0.0), whole(1.0), whole(2.0), among(0.0), among(1.0), among(2.0)])
}

/// Cards of two triangles, turned anyhow, in a ball of radius 4.
fn leaf_cards(count: usize) -> (Vec<Tri>, [Camera; VIEWS]) {
    let mut rng = Rng::new(11);
    let card = |_| {
        let at = rng.direction() * 4.0 * rng.unit().cbrt();
        let normal = rng.direction();
        let across = normal.cross(rng.direction()).normalize();
        let (u, v) = (across * 0.03, normal.cross(across) * 0.02);
        let [a, b, c, d] = [at - u - v, at + u - v, at + u + v, at - u + v].map(scenes::rounded);
        [[a, b, c], [a, c, d]]
    };
    let tris = (0..count).flat_map(card).collect();
    let camera = |eye: DVec3| Camera::Perspective { eye, at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
    let eyes = [[3.0, -12.0, 4.0], [-1.0, 5.5, -1.0], [12.0, 2.0, -3.0], [-5.0, 1.0, 3.0], [-8.0, 7.0, 6.0], [1.0, -5.0, -2.5]];
    (tris, eyes.map(|eye| camera(eye.into())))
}

/// How much of all pixels is covered is judged, in the worst view. (Not which: where a cell stands in, some rays that would hit pass,
/// and others hit.)
fn check(name: &str, (tris, cameras): (Vec<Tri>, [Camera; VIEWS])) {
    let setting = Setting { size: SIZE, samples: 16, ..Setting::default() };
    let file = built::parts(&[Part::white(1, tris.clone())]);
    let stage = Stage::new(&file.path, setting);
    let oracle = Bvh64::new(tris);
    let lighting = Lighting::new(&oracle);
    let samples = Samples { points: 32, rounds: 2, seed: 5 };
    let mut ratios = [0.0f64; POE.len()];
    for camera in &cameras {
        let view = View::new(camera, SIZE.0, SIZE.1);
        let truth = view.pixels(|x, y| lighting.coverage(&view, x, y, &samples).mean);
        assert!(truth.iter().sum::<f64>() > 0.02 * truth.len() as f64, "{name}: hardly anything is seen");
        let exact = stage.picture(camera, 0.0);
        for (ratio, poe) in ratios.iter_mut().zip(POE) {
            let picture = stage.picture(camera, poe);
            let now = coverage_ratio(picture.coverage(), truth.iter().copied());
            println!("{name}, PoE {poe}: {} holes, {now:.3} of the oracle's coverage, {} stand-ins", picture.holes(&exact), picture.stand_ins());
            assert!(poe < 1.0 || picture.stand_ins() > 100, "{name}, PoE {poe}: nothing stands in");
            // The worst of all views.
            if (now - 1.0).abs() > (*ratio - 1.0).abs() || *ratio == 0.0 {
                *ratio = now;
            }
        }
    }
    judge_each(&format!("{name}: coverage"), ratios.map(|ratio| (ratio - 1.0).abs()), LINE);
}

#[test]
fn coverage_of_wires() {
    check("wires", wires());
}

#[test]
fn coverage_of_leaf_cards() {
    check("leaf cards", leaf_cards(20_000));
}
