//! Foliage and wires, baked into one model and placed as instances: how much is covered, and how bright the covered
//! part is, by the light of the eye, by a sun, and by a sun with shadows.
//!
//! `cargo test --test pictures stability::foliage -- --nocapture` prints each view.

use super::pictures::{Setting, Stage, sun, ways};
use super::table::judge;
use crate::common::brute::Tri;
use crate::common::built::{self, Built, Part};
use crate::common::models;
use crate::common::picture::{coverage_ratio, radiance_ratio};
use crate::common::rng::Rng;
use crate::common::scenes::{self, rounded};
use glam::{DAffine3, DQuat, DVec3};
use outcrop::scene::{Camera, Light};
use std::f64::consts::{PI, TAU};

/// Pixels of error.
const POE: [f32; 4] = [0.5, 1.0, 3.0, 10.0];
const SIZE: (u32, u32) = (128, 96);
const VIEWS: usize = 6;
/// Off a mean coverage and off a mean brightness, as a share of it, on the mean of the views. Single views may be off
/// by twice as much.
const COVERAGE_LINE: f64 = 0.03;
const BRIGHTNESS_LINE: f64 = 0.02;

/// A pine of 520 triangles, 9 high, in the manner of those of games: a trunk, and tiers of folded cards that are longer
/// than the spaces between them, most of them nearly level.
fn pine() -> Vec<Tri> {
    const TIERS: usize = 15;
    const AROUND: usize = 4;
    let mut rng = Rng::new(31);
    let mut tris = tube(&[DVec3::ZERO, DVec3::Z * 3.0, DVec3::Z * 6.0, DVec3::Z * 9.0], &[0.3, 0.22, 0.12, 0.0]);
    for tier in 0..TIERS {
        let up = tier as f64 / TIERS as f64;
        for side in 0..AROUND {
            let turn = TAU * (side as f64 + 0.37 * tier as f64 + rng.between(-0.2, 0.2)) / AROUND as f64;
            let (out, aside) = (DVec3::new(turn.cos(), turn.sin(), 0.0), DVec3::new(-turn.sin(), turn.cos(), 0.0));
            let length = (3.4 * (1.0 - up) + 0.4) * rng.between(0.8, 1.2);
            let (width, droop) = (length * rng.between(0.25, 0.4), rng.between(-0.35, 0.25));
            let from = DVec3::Z * (1.2 + 7.4 * up + rng.between(-0.15, 0.15));
            // Across: both edges, and the fold above them.
            let row = |s: f64, wide: f64| {
                let middle = from + out * (length * s) + DVec3::Z * (length * (droop * s - 0.15 * s * s));
                let aside = aside * (width * wide);
                [
                    middle - aside - DVec3::Z * (0.4 * width * wide),
                    middle,
                    middle + aside - DVec3::Z * (0.3 * width * wide),
                ]
            };
            let rows = [row(0.05, 0.3), row(0.5, 1.0), row(1.0, 0.15)];
            for pair in rows.windows(2) {
                for k in 0..2 {
                    let (a, b, c, d) = (pair[0][k], pair[0][k + 1], pair[1][k + 1], pair[1][k]);
                    tris.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
    }
    tris.into_iter().map(|t| t.map(rounded)).filter(scenes::has_area).collect()
}

/// A tube of five sides through `points`, of a radius at each.
fn tube(points: &[DVec3], radii: &[f64]) -> Vec<Tri> {
    const SIDES: usize = 5;
    let ring = |i: usize, j: usize| {
        let along = (points[(i + 1).min(points.len() - 1)] - points[i.saturating_sub(1)]).normalize();
        let (u, v) = along.any_orthonormal_pair();
        let angle = TAU * (j % SIDES) as f64 / SIDES as f64;
        points[i] + (u * angle.cos() + v * angle.sin()) * radii[i]
    };
    let quads = (1..points.len())
        .flat_map(|i| (0..SIDES).map(move |j| (i, j)))
        .map(|(i, j)| [ring(i - 1, j), ring(i - 1, j + 1), ring(i, j + 1), ring(i, j)]);
    quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).filter(scenes::has_area).collect()
}

/// Cables that hang between two masts 24 apart, 8 high, 1 to 3 hundredths thick, 24 pieces each.
fn cables() -> Vec<Tri> {
    const PIECES: usize = 24;
    let mut rng = Rng::new(32);
    let mut tris = Vec::new();
    for _ in 0..30 {
        let [from, to] = [-12.0, 12.0].map(|x| DVec3::new(x, rng.between(-1.5, 1.5), rng.between(5.0, 8.0)));
        let (sag, thick) = (rng.between(0.4, 2.0), rng.between(0.01, 0.03));
        let points: Vec<DVec3> = (0..=PIECES)
            .map(|i| i as f64 / PIECES as f64)
            .map(|s| from.lerp(to, s) - DVec3::Z * (4.0 * sag * s * (1.0 - s)))
            .collect();
        tris.extend(tube(&points, &[thick; PIECES + 1]));
    }
    for x in [-12.0, 12.0] {
        tris.extend(tube(&[DVec3::X * x, DVec3::new(x, 0.0, 8.0)], &[0.12, 0.08]));
    }
    tris.into_iter().map(|t| t.map(rounded)).filter(scenes::has_area).collect()
}

/// Places on a disc, apart from each other, turned and scaled.
fn places(count: usize, radius: f64, apart: f64, seed: u64) -> Vec<DAffine3> {
    let mut rng = Rng::new(seed);
    let mut at: Vec<DVec3> = Vec::new();
    while at.len() < count {
        let (turn, far) = (rng.between(0.0, TAU), radius * rng.unit().sqrt());
        let here = DVec3::new(far * turn.cos(), far * turn.sin(), 0.0);
        if at.iter().all(|there| there.distance(here) >= apart) {
            at.push(here);
        }
    }
    let place = |at| {
        let scale = DVec3::splat(rng.between(0.7, 1.3));
        DAffine3::from_scale_rotation_translation(scale, DQuat::from_rotation_z(rng.between(0.0, TAU)), at)
    };
    at.into_iter().map(place).collect()
}

/// One model at several places, or one model of all that.
struct Scene {
    file: Built,
    places: Vec<DAffine3>,
}

impl Scene {
    fn both(tris: Vec<Tri>, places: Vec<DAffine3>) -> [Self; 2] {
        let of = |place: &DAffine3| {
            let place = *place;
            tris.iter().map(move |t| t.map(|v| rounded(place.transform_point3(v)))).collect::<Vec<_>>()
        };
        let all = places.iter().flat_map(of).filter(scenes::has_area).collect();
        let baked = Self { file: built::parts(&[Part::white(1, all)]), places: vec![DAffine3::IDENTITY] };
        [baked, Self { file: built::parts(&[Part::white(1, tris)]), places }]
    }
}

/// From six sides, from near the ground to high above, with `near` and `far` to the height of a pixel, in turn.
fn views(middle: DVec3, [near, far]: [f64; 2]) -> [Camera; VIEWS] {
    std::array::from_fn(|v| {
        let (turn, rise): (f64, f64) = (v as f64 * 2.4 + 0.3, [0.12, 0.5, 0.9, 0.25, 0.15, 0.7][v]);
        let from = DVec3::new(turn.cos() * rise.cos(), turn.sin() * rise.cos(), rise.sin());
        let pixel = if v % 2 == 0 { near } else { far };
        let (fov, distance) = (20.0f64, pixel * f64::from(SIZE.1) / (2.0 * (10.0 * PI / 180.0).tan()));
        Camera::Perspective { eye: middle + from * distance, at: middle, up: DVec3::Z, fov_y_degrees: fov }
    })
}

/// The light of the eye; a sun; a sun with shadows: the names of the measures, and the lights.
fn lights() -> [(&'static str, Light); 3] {
    let sun = sun(DVec3::new(0.5, 0.7, -0.9));
    [
        ("brightness, headlight", Light::HEADLIGHT),
        ("brightness, sun", Light { shadows: false, ..sun }),
        ("brightness, shadows", sun),
    ]
}

/// Of each pixels of error, of each view.
type Ratios = [[f64; VIEWS]; POE.len()];

/// Coverage of all pixels, and brightness of what is covered, both relative to the exact picture's.
fn measure(name: &str, scene: &Scene, light: (&str, Light), cameras: &[Camera; VIEWS]) -> [Ratios; 2] {
    let setting = Setting { lights: vec![light.1], size: SIZE, samples: 4, ..Setting::default() };
    // One way is enough: others show the same to the bit, which other rows see to.
    let way = ways().pop().expect("a way");
    let stage = Stage::edited(&[way], &scene.file.path, &scene.places, setting, |_| ());
    let mut out = [[[0.0; VIEWS]; POE.len()]; 2];
    for (v, camera) in cameras.iter().enumerate() {
        let exact = stage.quick(camera, 0.0);
        let covered: f64 = exact.coverage().sum();
        assert!(covered > 200.0, "{name}, view {v}: {covered} pixels are covered");
        for (p, poe) in POE.into_iter().enumerate() {
            let picture = stage.quick(camera, poe);
            assert!(poe < 10.0 || picture.stand_ins() > 50, "{name}, PoE {poe}, view {v}: nothing stands in");
            let coverage = coverage_ratio(picture.coverage(), exact.coverage());
            let radiance = radiance_ratio(picture.colours(), exact.colours(), |_| true);
            (out[0][p][v], out[1][p][v]) = (coverage, radiance / coverage);
        }
    }
    for (what, ratios) in ["coverage", "brightness"].iter().zip(&out) {
        for (poe, of_views) in POE.iter().zip(ratios) {
            let mean = of_views.iter().sum::<f64>() / VIEWS as f64;
            println!("{name}, {}, PoE {poe}: {what} {mean:.4} on the mean, {of_views:.3?}", light.0);
        }
    }
    out
}

/// How far the mean of the views is off, or half of how far the worst view is, whichever is more.
fn off(ratios: &[f64; VIEWS]) -> f64 {
    let mean = ratios.iter().sum::<f64>() / VIEWS as f64;
    ratios.iter().fold((mean - 1.0).abs(), |most, ratio| most.max((ratio - 1.0).abs() * 0.5))
}

/// `names`: of all in one model, and of a model at several places.
fn check(names: [&str; 2], tris: Vec<Tri>, places: Vec<DAffine3>, cameras: &[Camera; VIEWS]) {
    for (name, scene) in names.into_iter().zip(Scene::both(tris, places)) {
        let of_lights = lights().map(|light| (light.0, measure(name, &scene, light, cameras)));
        let judge_all = |what: &str, ratios: &Ratios, line: f64| {
            judge(
                &format!("{name}: {what}"),
                &std::array::from_fn::<_, { POE.len() }, _>(|p| (POE[p], off(&ratios[p]), line)),
            );
        };
        judge_all("coverage", &of_lights[0].1[0], COVERAGE_LINE);
        for (what, [_, brightness]) in &of_lights {
            judge_all(what, brightness, BRIGHTNESS_LINE);
        }
    }
}

#[test]
fn pines() {
    check(["pines, baked", "pines, placed"], pine(), places(24, 36.0, 9.0, 33), &views(DVec3::Z * 4.0, [0.3, 0.9]));
}

/// The model that was found wrong, where it is there.
#[test]
fn scrub_pines() {
    let Some(file) = models::find("vegetation/scrub_pine.obj") else { return };
    let upright = |v: DVec3| rounded(DVec3::new(v.x, -v.z, v.y) * 0.01);
    let pine = models::read(&file).into_iter().map(|t| t.map(upright)).filter(scenes::has_area).collect();
    check(
        ["scrub pines, baked", "scrub pines, placed"],
        pine,
        places(24, 36.0, 9.0, 33),
        &views(DVec3::Z * 4.0, [0.3, 0.9]),
    );
}

#[test]
fn hanging_cables() {
    check(["cables, baked", "cables, placed"], cables(), places(9, 30.0, 12.0, 34), &views(DVec3::Z * 5.0, [0.2, 0.6]));
}
