//! `room`: a conference room: tables in rows, chairs, lamps, shelves with books, cups. Small curved parts stand between
//! walls of two triangles.

use super::shapes::{Shape, blob, circle, cuboid, drilled, prism, quad, ring, rounded, sheet, swept, turned};
use super::{Maker, glossy, matt, metal};
use glam::{DAffine3, DVec2, DVec3};
use outcrop::import::MaterialDesc;
use std::f64::consts::TAU;

/// Width, depth and height.
const SIZE: DVec3 = DVec3::new(14.0, 10.0, 3.2);

const WOOD: MaterialDesc = matt(0.42, 0.26, 0.13);
const WALL: MaterialDesc = matt(0.75, 0.73, 0.68);
const CLOTHS: [MaterialDesc; 3] = [matt(0.12, 0.16, 0.3), matt(0.35, 0.08, 0.08), matt(0.1, 0.25, 0.2)];

pub fn make(maker: &mut Maker) {
    shell(maker);
    for row in 0..3 {
        for column in 0..3 {
            let at = DVec3::new(3.2 + 3.4 * f64::from(column), 2.2 + 2.6 * f64::from(row), 0.0);
            let name = format!("table {row}-{column}");
            table(maker, &name, at);
            for place in 0..6 {
                let (x, is_back) = (0.8 * f64::from(place % 3) - 0.8, place >= 3);
                let side = if is_back { -1.0 } else { 1.0 };
                let turn = maker.rng.between(-0.35, 0.35) + if is_back { 0.5 * TAU } else { 0.0 };
                let out = side * maker.rng.between(0.75, 0.95);
                let stand = DAffine3::from_translation(at + DVec3::new(x, out, 0.0)) * DAffine3::from_rotation_z(turn);
                chair(maker, &format!("{name} chair {place}"), stand, CLOTHS[(row + column) as usize % 3]);
                if maker.rng.below(3) > 0 {
                    let cup = at + DVec3::new(x + maker.rng.between(-0.2, 0.2), 0.35 * side, 0.75);
                    cup_at(maker, &format!("{name} cup {place}"), cup);
                }
            }
        }
    }
    for (i, x) in (0..4).map(|i| (i, 1.6 + 3.1 * f64::from(i))) {
        shelf(maker, &format!("shelf {i}"), DVec3::new(x, SIZE.y - 0.36, 0.0));
    }
    for (i, j) in (0..4).flat_map(|i| (0..3).map(move |j| (i, j))) {
        let at = DVec3::new(2.0 + 3.3 * f64::from(i), 2.0 + 2.8 * f64::from(j), SIZE.z);
        lamp(maker, &format!("lamp {i}-{j}"), at);
    }
}

/// Floor, ceiling, walls, windows with blinds, a door and skirting.
fn shell(maker: &mut Maker) {
    let (x, y, z) = (SIZE.x * DVec3::X, SIZE.y * DVec3::Y, SIZE.z * DVec3::Z);
    maker.add("floor", matt(0.3, 0.28, 0.27), quad(DVec3::ZERO, x, y));
    maker.add("ceiling", WALL, quad(z, y, x));
    maker.add("front wall", WALL, quad(DVec3::ZERO, z, x));
    maker.add("back wall", WALL, quad(y, x, z));
    maker.add("door wall", WALL, quad(x, z, y));
    maker.add("window wall", WALL, quad(DVec3::ZERO, y, z));
    maker.add("door", WOOD, cuboid(DVec3::new(SIZE.x - 0.05, 1.0, 0.0), DVec3::new(0.04, 1.0, 2.1)));
    let board = cuboid(DVec3::new(4.5, 0.01, 1.0), DVec3::new(5.0, 0.03, 1.5));
    maker.add("board", matt(0.9, 0.9, 0.9), board);
    for (i, at) in [0.0, SIZE.y - 0.02].into_iter().enumerate() {
        maker.add(format!("skirting {i}"), WOOD, cuboid(at * DVec3::Y, DVec3::new(SIZE.x, 0.02, 0.1)));
    }
    for i in 0..3 {
        maker.begin();
        let from = DVec3::new(0.03, 1.0 + 3.0 * f64::from(i), 0.9);
        maker.add(format!("window {i}"), glossy(0.5, 0.6, 0.75), quad(from, 2.2 * DVec3::Y, 1.8 * DVec3::Z));
        // Each slat is bent a little.
        let fine = maker.sides(4.0);
        let slat = |k: usize| {
            let low = from + DVec3::new(0.04, 0.0, 0.045 * k as f64);
            sheet(fine, 1, |u, v| low + DVec3::new(0.03 * u, 2.2 * v, 0.02 * u + 0.03 * u * (1.0 - u)))
        };
        maker.add(format!("blind {i}"), matt(0.8, 0.8, 0.75), (0..40).map(slat).reduce(Shape::and).expect("slats"));
    }
    let lines =
        |length: f64, step: f64| (0..=(length / step).round() as usize).map(|i| step * i as f64).collect::<Vec<_>>();
    let vents = drilled(&lines(2.0, 0.25), &lines(1.0, 0.25), 0.02, maker.sides(16.0), |_, _| 0.08);
    maker.add("vents", metal(0.6), vents.moved(6.0, 4.5, SIZE.z - 0.03));
}

/// A table with rounded corners on two feet.
fn table(maker: &mut Maker, name: &str, at: DVec3) {
    maker.begin();
    let corner = maker.sides(8.0);
    let outline: Vec<DVec2> = (0..4 * corner)
        .map(|i| {
            let (s, c) = (TAU * (i as f64 + 0.5) / (4 * corner) as f64).sin_cos();
            DVec2::new(1.25 * c.signum() + 0.1 * c, 0.4 * s.signum() + 0.1 * s)
        })
        .collect();
    maker.add(format!("{name} top"), WOOD, prism(&outline, 0.03).moved(at.x, at.y, 0.72));
    for (i, x) in [-1.0, 1.0].into_iter().enumerate() {
        let sides = maker.sides(14.0);
        let post = turned(&[(0.2, 0.0), (0.2, 0.02), (0.05, 0.06), (0.04, 0.6), (0.06, 0.7), (0.15, 0.72)], sides);
        maker.add(format!("{name} foot {i}"), metal(0.5), post.moved(at.x + x, at.y, 0.0));
    }
}

/// A swivel chair: it faces along -y, its middle is on the axis.
fn chair(maker: &mut Maker, name: &str, stand: DAffine3, cloth: MaterialDesc) {
    maker.begin();
    let (fine, coarse) = (maker.sides(20.0), maker.sides(9.0));
    let seat = blob(DVec3::new(0.25, 0.24, 0.05), 0.4, fine, coarse).moved(0.0, 0.0, 0.45);
    maker.add(format!("{name} seat"), cloth, seat.at(stand));
    // A back that is hollow towards the sitter, both sides and the rim in one sheet around.
    let back = blob(DVec3::new(0.24, 0.03, 0.28), 0.45, fine, maker.sides(14.0));
    let bent = Shape {
        vertices: back.vertices.iter().map(|v| DVec3::new(v.x, v.y - 2.0 * v.x * v.x - 0.3 * v.z * v.z, v.z)).collect(),
        ..back
    };
    maker.add(format!("{name} back"), cloth, bent.moved(0.0, 0.27, 0.82).at(stand));
    let tube = circle(0.015, maker.sides(8.0));
    let bends = maker.sides(5.0);
    for (side, x) in [("left", -0.27), ("right", 0.27)] {
        let corners = [(0.05, 0.45), (0.1, 0.66), (-0.2, 0.66), (-0.22, 0.5)].map(|(y, z)| DVec3::new(x, y, z));
        let arm = swept(&rounded(&corners, 0.06, bends), &tube);
        maker.add(format!("{name} {side} arm"), metal(0.3), arm.at(stand));
    }
    let stem = [DVec3::new(0.0, 0.1, 0.42), DVec3::new(0.0, 0.3, 0.44), DVec3::new(0.0, 0.29, 0.8)];
    let stem = swept(&rounded(&stem, 0.1, bends), &tube).and(turned(&[(0.03, 0.1), (0.025, 0.42)], maker.sides(10.0)));
    let legs = (0..5).map(|i| {
        let (s, c) = (TAU * f64::from(i) / 5.0).sin_cos();
        let path = [DVec3::new(0.02 * c, 0.02 * s, 0.12), DVec3::new(0.27 * c, 0.27 * s, 0.07)];
        let wheel = ring(0.02, 0.012, maker.sides(9.0), maker.sides(6.0));
        let wheel = wheel.at(DAffine3::from_rotation_x(0.25 * TAU)).moved(0.27 * c, 0.27 * s, 0.035);
        swept(&path, &tube).and(wheel)
    });
    let stand_up = legs.fold(stem, Shape::and);
    maker.add(format!("{name} stand"), metal(0.3), stand_up.at(stand));
}

fn cup_at(maker: &mut Maker, name: &str, at: DVec3) {
    maker.begin();
    let profile =
        [(0.025, 0.0), (0.035, 0.01), (0.042, 0.05), (0.045, 0.09), (0.042, 0.09), (0.038, 0.05), (0.03, 0.012)];
    let (s, c) = maker.rng.between(0.0, TAU).sin_cos();
    let loop_ = [(0.038, 0.075), (0.075, 0.075), (0.075, 0.025), (0.036, 0.025)];
    let path = rounded(&loop_.map(|(r, z)| DVec3::new(r * c, r * s, z)), 0.025, maker.sides(4.0));
    let handle = swept(&path, &circle(0.005, maker.sides(6.0)));
    let cup = turned(&profile, maker.sides(20.0)).and(handle).at(DAffine3::from_translation(at));
    maker.add(name, glossy(0.85, 0.85, 0.8), cup);
}

/// Boards and books.
fn shelf(maker: &mut Maker, name: &str, at: DVec3) {
    for (i, x) in [0.0, 1.97].into_iter().enumerate() {
        maker.add(format!("{name} side {i}"), WOOD, cuboid(at + x * DVec3::X, DVec3::new(0.03, 0.34, 2.1)));
    }
    for level in 0..6 {
        let z = 0.06 + 0.4 * f64::from(level);
        maker.add(
            format!("{name} board {level}"),
            WOOD,
            cuboid(at + DVec3::new(0.03, 0.0, z), DVec3::new(1.94, 0.34, 0.025)),
        );
        let (mut x, mut book) = (0.05, 0);
        while level < 5 && x < 1.85 {
            maker.begin();
            let [wide, high, deep] =
                [(0.015, 0.06), (0.2, 0.34), (0.15, 0.25)].map(|(lo, hi)| maker.rng.between(lo, hi));
            if !maker.rng.one_in(12) {
                let colour = [(); 3].map(|()| maker.rng.between(0.05, 0.7) as f32);
                // A round spine; the other sides are flat.
                let pieces = maker.sides(7.0);
                let spine = (0..=pieces).map(|i| {
                    let (s, c) = (0.5 * TAU * i as f64 / pieces as f64).sin_cos();
                    DVec2::new(0.5 * wide * (1.0 - c), -0.3 * wide * s)
                });
                let outline: Vec<DVec2> = spine.chain([DVec2::new(wide, deep), DVec2::new(0.0, deep)]).collect();
                let place = at + DVec3::new(x, 0.04, z + 0.025);
                let shape = prism(&outline, high).moved(place.x, place.y, place.z);
                maker.add(format!("{name} book {level}-{book}"), matt(colour[0], colour[1], colour[2]), shape);
                book += 1;
            }
            x += wide + 0.002;
        }
    }
}

/// A lamp on a cord.
fn lamp(maker: &mut Maker, name: &str, at: DVec3) {
    maker.begin();
    let rings = maker.sides(12.0);
    let bell = |i: usize, r: f64| {
        let t = i as f64 / rings as f64;
        (r * (0.1 + 0.9 * (0.25 * TAU * t).sin()), -0.5 - 0.25 * t)
    };
    let profile: Vec<(f64, f64)> =
        (0..=rings).map(|i| bell(i, 0.25)).chain((0..=rings).rev().map(|i| bell(i, 0.24))).collect();
    let sides = maker.sides(28.0);
    let place = DAffine3::from_translation(at);
    maker.add(format!("{name} shade"), glossy(0.8, 0.35, 0.1), turned(&profile, sides).at(place));
    maker.add(
        format!("{name} bulb"),
        matt(0.95, 0.95, 0.9),
        blob(DVec3::splat(0.05), 1.0, sides / 2 + 2, rings).moved(at.x, at.y, at.z - 0.62),
    );
    maker.add(format!("{name} cord"), matt(0.05, 0.05, 0.05), turned(&[(0.004, -0.5), (0.004, 0.0)], 6).at(place));
}
