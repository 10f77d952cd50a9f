//! Secondary rays that start on a stand-in: they neither meet the surface that it stands for nor pass it.

use super::pictures::{POE, Picture, Setting, Stage, perspective, sun};
use super::table::judge_each;
use crate::common::brute::Tri;
use crate::common::built::{self, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DQuat, DVec3};
use outcrop::query::HitKind;
use outcrop::render::Buffer;
use outcrop::scene::{Light, LightKind};

/// A plane of 160 by 160 cells, 0.1 each, around zero; turned, so that the boxes of its cells are thick.
fn plane(height: impl Fn(f64, f64) -> f64) -> Vec<Tri> {
    let turn = DQuat::from_rotation_x(0.6) * DQuat::from_rotation_y(0.4);
    let at = |v: DVec3| {
        let v = v * 0.1 - DVec3::new(8.0, 8.0, 0.0);
        scenes::rounded(turn * (v + DVec3::Z * height(v.x, v.y)))
    };
    scenes::plane_grid(160, 0.0).into_iter().map(|t| t.map(at)).collect()
}

/// Of the pixels that `exact` has lit, the share that has lost half of its light, and the mean brightness over the
/// exact one.
fn shadow(now: &[f64], exact: &[f64]) -> (f64, f64) {
    let lit = || now.iter().zip(exact).filter(|(_, y)| **y > 0.05);
    let lost = lit().filter(|(now, exact)| **now < 0.5 * **exact).count();
    let (sum, truth) = lit().fold((0.0, 0.0), |(a, b), (now, exact)| (a + now, b + exact));
    (lost as f64 / lit().count() as f64, sum / truth)
}

/// Of the pixels in false shadow, the share that shows triangles: rays that start there meet the stand-ins beside them.
fn exact_hits(picture: &Picture, exact: &[f64]) -> f64 {
    let kinds = picture.bytes(Buffer::Kind).iter().zip(picture.luminance()).zip(exact);
    let lost: Vec<u8> =
        kinds.filter(|((_, now), y)| **y > 0.05 && *now < 0.5 * **y).map(|((kind, _), _)| *kind).collect();
    lost.iter().filter(|kind| **kind == HitKind::Exact as u8).count() as f64 / lost.len().max(1) as f64
}

fn check_plane(name: &str, tris: Vec<Tri>) {
    // Steep, slanting, and from a point; one after the other.
    let turn = DQuat::from_rotation_x(0.6) * DQuat::from_rotation_y(0.4);
    let lamp = Light { kind: LightKind::Point(turn * DVec3::new(2.0, 1.0, 9.0)), intensity: 80.0, ..sun(DVec3::Z) };
    let lights = [sun(turn * DVec3::new(0.1, 0.2, -1.0)), sun(turn * DVec3::new(1.0, 0.4, -0.7)), lamp];
    let file = built::parts(&[Part::white(1, tris)]);
    let (mut false_shadow, mut off) = ([0.0f64; POE.len()], [0.0f64; POE.len()]);
    for light in lights {
        let stage = Stage::new(&file.path, Setting { lights: vec![light], ..Setting::default() });
        for eye in [DVec3::new(3.0, -9.0, 16.0), DVec3::new(1.0, -7.5, 3.0)] {
            let camera = perspective(turn * eye, DVec3::ZERO);
            let exact = stage.picture(&camera, 0.0).luminance();
            let lit = exact.iter().filter(|y| **y > 0.05).count();
            assert!(lit * 3 > exact.len(), "{name}: {lit} pixels are lit");
            for (p, poe) in POE.into_iter().enumerate() {
                let picture = stage.picture(&camera, poe);
                let (lost, ratio) = shadow(&picture.luminance(), &exact);
                println!(
                    "{name}, {:.1?}, PoE {poe}: {lost:.4} in false shadow, {:.2} of these exact hits; {ratio:.4} of the light; {} stand-ins",
                    light.kind,
                    exact_hits(&picture, &exact),
                    picture.stand_ins()
                );
                assert!(poe < 3.0 || picture.stand_ins() > 500, "{name}, PoE {poe}: nothing stands in");
                false_shadow[p] = false_shadow[p].max(lost);
                off[p] = off[p].max((ratio - 1.0).abs());
            }
        }
    }
    judge_each(&format!("{name}: false shadow"), false_shadow, 0.0);
    judge_each(&format!("{name}: brightness"), off, 0.01);
}

#[test]
fn no_false_shadow_on_a_lit_plane() {
    check_plane("flat plane", plane(|_, _| 0.0));
}

/// Bumps so shallow that no light of the three throws a shadow: their steepest slope is 0.12, the lowest light's 0.65.
#[test]
fn no_false_shadow_on_a_bumpy_plane() {
    check_plane("bumpy plane", plane(|x, y| 0.06 * (2.0 * x).sin() * (1.7 * y).cos()));
}

/// A room of single sheets, each of 100 by 100 cells and not quite flat, turned.
fn room() -> (Vec<Tri>, DQuat) {
    let mut rng = Rng::new(5);
    let turn = DQuat::from_axis_angle(rng.direction(), 0.7);
    let n = 100;
    let face = |k: usize, z: f64| {
        let place = move |v: DVec3| DVec3::from(std::array::from_fn(|i| v[(i + k) % 3]));
        scenes::plane_grid(n, z).into_iter().map(move |t| t.map(place))
    };
    let tris = (0..3).flat_map(|k| face(k, 0.0).chain(face(k, n as f64)));
    let bent = move |v: DVec3| {
        let v = v / n as f64 * 2.0 - 1.0;
        // Corners and edges meet: all move by what they are.
        scenes::rounded(turn * (v * (1.0 + 0.02 * (5.0 * v.x).sin() * (4.0 * v.y).cos() * (6.0 * v.z).sin())))
    };
    (tris.map(|t| t.map(bent)).collect(), turn)
}

#[test]
fn no_light_into_a_closed_box() {
    let (tris, turn) = room();
    let lamp = Light { kind: LightKind::Point(turn * DVec3::new(0.3, 0.2, 1.4)), intensity: 20.0, ..sun(DVec3::Z) };
    let lights = vec![lamp, sun(turn * DVec3::new(1.0, 0.7, 0.4)), sun(turn * DVec3::new(-0.05, -1.0, 0.1))];
    let file = built::parts(&[Part::white(1, tris)]);
    let setting = Setting { lights, ambient: 0.15, samples: 4, ..Setting::default() };
    let stage = Stage::new(&file.path, setting);
    let mut lit = [0usize; POE.len()];
    // Into a corner, at a wall, along one.
    let looks = [
        ([0.5, 0.4, 0.3], [-1.0, -1.0, -1.0]),
        ([0.0, 0.0, 0.0], [0.0, 0.1, 1.0]),
        ([-0.9, 0.0, 0.9], [1.0, 0.2, 0.9]),
    ];
    for (eye, at) in looks {
        let camera = perspective(turn * DVec3::from(eye), turn * DVec3::from(at));
        for (p, poe) in POE.into_iter().enumerate() {
            let picture = stage.picture(&camera, poe);
            let bright = picture.luminance().iter().filter(|y| **y > 0.15 + 1e-4).count();
            assert!(picture.covered().all(|c| c), "PoE {poe}: a hole in the wall");
            println!("closed box, PoE {poe}: {bright} pixels lit from outside, {} stand-ins", picture.stand_ins());
            assert!(poe < 10.0 || picture.stand_ins() > 500, "PoE {poe}: nothing stands in");
            lit[p] += bright;
        }
    }
    judge_each("closed box: lit from outside", lit.map(|n| n as f64), 0.0);
}
