//! `hall`: a hall with two rows of columns, arches, galleries, tiled vaults and large flat walls.

use super::shapes::{Shape, blob, circle, cuboid, quad, rounded, sheet, swept, turned};
use super::{Maker, matt};
use glam::{DAffine3, DVec2, DVec3};
use outcrop::import::MaterialDesc;
use std::f64::consts::TAU;

/// Distance of columns along the hall, and their number in a row.
const BAY: f64 = 5.0;
const BAYS: usize = 8;
const LENGTH: f64 = BAY * BAYS as f64;
/// Half the width of the nave, and of the whole.
const NAVE: f64 = 4.5;
const WIDE: f64 = 10.0;
/// Heights: of columns, of the arches' tops, and where the vault begins.
const COLUMN: f64 = 4.2;
const SPRING: f64 = 9.0;

const STONE: MaterialDesc = matt(0.62, 0.56, 0.46);
const PLASTER: MaterialDesc = matt(0.74, 0.68, 0.58);
const TILE: MaterialDesc = matt(0.5, 0.25, 0.16);

/// The angle of the hall's length to the x axis, in degrees.
const ASKEW: f64 = 5.0;

pub fn make(maker: &mut Maker) {
    walls(maker);
    floor(maker);
    for (side, y) in [("left", -NAVE), ("right", NAVE)] {
        for i in 0..=BAYS {
            column(maker, &format!("{side} column {i}"), DVec3::new(BAY * i as f64, y, 0.0));
        }
        for i in 0..BAYS {
            arch(maker, &format!("{side} arch {i}"), BAY * i as f64, y);
            curtain(maker, &format!("{side} curtain {i}"), BAY * i as f64, 1.08 * y, i);
        }
    }
    for i in 0..BAYS {
        vault(maker, i);
    }
    for i in 1..BAYS {
        vase(maker, i);
    }
    // Few buildings stand along the axes. (In a wall across an axis, splits of Embree 3.13.5 of high quality fail an
    // assertion, which ends the program.)
    maker.turn(ASKEW);
}

fn walls(maker: &mut Maker) {
    let (along, up) = (LENGTH * DVec3::X, (SPRING + NAVE) * DVec3::Z);
    for (name, y) in [("left wall", -WIDE), ("right wall", WIDE)] {
        maker.add(name, PLASTER, quad(y * DVec3::Y, along, 8.0 * DVec3::Z));
    }
    for (name, y) in [("left roof", -WIDE), ("right roof", WIDE)] {
        let inward = -y * (1.0 - NAVE / WIDE) * DVec3::Y;
        maker.add(name, STONE, quad(DVec3::new(0.0, y, 8.0), along, inward));
    }
    for (name, x) in [("first end", 0.0), ("last end", LENGTH)] {
        maker.add(name, PLASTER, quad(DVec3::new(x, -WIDE, 0.0), 2.0 * WIDE * DVec3::Y, up));
    }
    // Clerestory walls over the arches, and a cornice each.
    for (side, y) in [("left", -NAVE), ("right", NAVE)] {
        let low = COLUMN + 0.5 * BAY;
        let wall = quad(DVec3::new(0.0, y, low), along, (SPRING - low) * DVec3::Z);
        maker.add(format!("{side} upper wall"), PLASTER, wall);
        maker.begin();
        let pieces = maker.sides(10.0);
        let section: Vec<DVec2> = (0..=pieces)
            .map(|i| {
                let (s, c) = (0.5 * TAU * i as f64 / pieces as f64).sin_cos();
                DVec2::new(0.25 * c, 0.18 * s)
            })
            .collect();
        let path: Vec<DVec3> = (0..=BAYS).map(|i| DVec3::new(BAY * i as f64, y, SPRING - 0.3)).collect();
        maker.add(format!("{side} cornice"), STONE, swept(&path, &section));
    }
    for i in 0..BAYS {
        for (side, y) in [("left", -WIDE), ("right", WIDE)] {
            maker.begin();
            let steps = maker.sides(14.0);
            let frame = (0..=steps).map(|k| {
                let (s, c) = (0.5 * TAU * k as f64 / steps as f64).sin_cos();
                DVec3::new(BAY * (i as f64 + 0.5) + 0.9 * c, y, 5.0 + 0.9 * s)
            });
            let foot = |x: f64| DVec3::new(BAY * (i as f64 + 0.5) + x, y, 3.0);
            let path: Vec<DVec3> = std::iter::once(foot(0.9)).chain(frame).chain([foot(-0.9)]).collect();
            maker.add(format!("{side} window {i}"), STONE, swept(&path, &circle(0.15, maker.sides(8.0))));
        }
    }
}

/// Tiles in two colours, each of two triangles, over a floor that shows in the joints.
fn floor(maker: &mut Maker) {
    maker.add("ground", matt(0.2, 0.2, 0.2), quad(-WIDE * DVec3::Y, LENGTH * DVec3::X, 2.0 * WIDE * DVec3::Y));
    let mut tiles = [Shape::default(), Shape::default()];
    for (i, j) in (0..40).flat_map(|i| (0..20).map(move |j| (i, j))) {
        let from = DVec3::new(f64::from(i) + 0.01, f64::from(j) - WIDE + 0.01, 0.01);
        let tile = &mut tiles[(i + j) as usize % 2];
        *tile = std::mem::take(tile).and(quad(from, 0.98 * DVec3::X, 0.98 * DVec3::Y));
    }
    let [light, dark] = tiles;
    maker.add("light tiles", matt(0.7, 0.66, 0.6), light);
    maker.add("dark tiles", matt(0.3, 0.26, 0.24), dark);
}

/// Plinth, base, fluted shaft, and a capital of leaves.
fn column(maker: &mut Maker, name: &str, at: DVec3) {
    maker.begin();
    let place = DAffine3::from_translation(at);
    maker.add(format!("{name} plinth"), STONE, cuboid(at + DVec3::new(-0.55, -0.55, 0.0), DVec3::new(1.1, 1.1, 0.25)));
    let torus = [(0.5, 0.25), (0.54, 0.3), (0.5, 0.36), (0.43, 0.4), (0.45, 0.46), (0.4, 0.5)];
    let sides = maker.sides(18.0);
    maker.add(format!("{name} base"), STONE, turned(&torus, sides).at(place));
    // Flutes: the radius waves around; the shaft tapers.
    let (flutes, points, rings) = (12, 12 * maker.at_least(2, 3.0), maker.at_least(2, 5.0));
    let shaft = Shape::of_rings(
        &(0..=rings)
            .map(|k| {
                let t = k as f64 / rings as f64;
                let radius = 0.38 - 0.06 * t * t;
                (0..points)
                    .map(|i| {
                        let angle = TAU * i as f64 / points as f64;
                        let r = radius - 0.03 * (0.5 * f64::from(flutes) * angle).sin().abs();
                        DVec3::new(r * angle.cos(), r * angle.sin(), 0.5 + 3.1 * t)
                    })
                    .collect()
            })
            .collect::<Vec<_>>(),
    );
    maker.add(format!("{name} shaft"), STONE, shaft.at(place));
    let bell = turned(&[(0.32, 3.6), (0.36, 3.7), (0.34, 3.75), (0.4, 3.95), (0.55, 4.05)], sides);
    let (along, across) = (maker.sides(4.0), maker.at_least(2, 2.0));
    let leaves = (0..16).map(|i| {
        let turn = DAffine3::from_rotation_z(TAU * f64::from(i) / 16.0);
        let low = 3.62 + 0.14 * f64::from(i % 2);
        sheet(across, along, |u, v| {
            let out = 0.35 + 0.05 * v + 0.16 * v * v * v;
            DVec3::new(out, 0.09 * (2.0 * u - 1.0) * (1.0 - v * v), low + 0.3 * v - 0.12 * v * v * v)
        })
        .at(turn)
    });
    maker.add(format!("{name} capital"), STONE, leaves.fold(bell, Shape::and).at(place));
    let top = cuboid(at + DVec3::new(-0.6, -0.6, 4.05), DVec3::new(1.2, 1.2, COLUMN - 4.05));
    maker.add(format!("{name} abacus"), STONE, top);
}

/// A round arch from column to column, of voussoirs, and the wall beside it.
fn arch(maker: &mut Maker, name: &str, x: f64, y: f64) {
    maker.begin();
    let (pieces, deep) = (maker.at_least(6, 18.0), 0.45);
    let radius = 0.5 * BAY - 0.55;
    let at = |angle: f64, r: f64, y: f64| DVec3::new(x + 0.5 * BAY - r * angle.cos(), y, COLUMN + r * angle.sin());
    let stone = |k: usize| {
        let [from, to] = [k, k + 1].map(|k| 0.5 * TAU * (k as f64 + 0.04 * (k & 1) as f64) / pieces as f64);
        let ring = |angle: f64| {
            let (low, high) = (radius, radius + 0.4);
            [(low, -deep), (high, -deep), (high, deep), (low, deep)].map(|(r, dy)| at(angle, r, y + dy)).to_vec()
        };
        Shape::of_rings(&[ring(from), ring(to)])
    };
    maker.add(name, STONE, (0..pieces).map(stone).reduce(Shape::and).expect("stones"));
    // From the arch's back up to the upper wall: long triangles.
    let spandrel = sheet(pieces, 1, |u, v| {
        let low = at(0.5 * TAU * u, radius + 0.4, y);
        low.lerp(DVec3::new(x + BAY * u, y, COLUMN + 0.5 * BAY + 0.3), v)
    });
    maker.add(format!("{name} wall"), PLASTER, spandrel);
}

/// A groin vault over one bay: two barrels that meet, of tiles, with ribs along the groins.
fn vault(maker: &mut Maker, bay: usize) {
    maker.begin();
    let x = BAY * bay as f64;
    let cells = maker.at_least(6, 20.0);
    let height = |u: f64, v: f64| {
        let arc = |t: f64| (1.0 - (2.0 * t - 1.0).powi(2)).max(0.0).sqrt();
        SPRING + NAVE * 0.8 * arc(u).max(arc(v))
    };
    let at = |u: f64, v: f64| DVec3::new(x + BAY * u, NAVE * (2.0 * v - 1.0), height(u, v));
    // Each tile has corners of its own, and hangs a little askew.
    let mut tiles = Shape::default();
    for (i, j) in (0..cells).flat_map(|i| (0..cells).map(move |j| (i, j))) {
        let lift = lift_of(i, j);
        let tile = sheet(1, 1, |u, v| {
            let corner = |k: usize, t: f64| (k as f64 + 0.03 + 0.94 * t) / cells as f64;
            at(corner(i, u), corner(j, v)) + lift * DVec3::Z
        });
        tiles = tiles.and(tile);
    }
    maker.add(format!("vault {bay} tiles"), TILE, tiles);
    maker.add(format!("vault {bay}"), PLASTER, sheet(cells, cells, |u, v| at(u, v) + 0.06 * DVec3::Z));
    let steps = maker.sides(20.0);
    for (k, is_other) in [false, true].into_iter().enumerate() {
        let path: Vec<DVec3> = (0..=steps)
            .map(|i| {
                let t = i as f64 / steps as f64;
                at(t, if is_other { 1.0 - t } else { t }) - 0.03 * DVec3::Z
            })
            .collect();
        maker.add(format!("vault {bay} rib {k}"), STONE, swept(&path, &circle(0.12, maker.sides(8.0))));
    }
}

/// How much a tile hangs down, metres.
fn lift_of(i: usize, j: usize) -> f64 {
    0.01 * ((7 * i + 3 * j) % 5) as f64 / 5.0
}

/// Cloth in folds between two columns.
fn curtain(maker: &mut Maker, name: &str, x: f64, y: f64, number: usize) {
    maker.begin();
    let (across, down) = (maker.at_least(8, 26.0), maker.at_least(3, 8.0));
    let cloth = sheet(across, down, |u, v| {
        let fold = 0.12 * (TAU * 5.0 * u + number as f64).sin() * (0.3 + 0.7 * v);
        DVec3::new(x + 0.7 + (BAY - 1.4) * u, y + fold, 3.6 - 2.2 * v + 0.2 * (2.0 * u - 1.0).powi(2))
    });
    let colour = [matt(0.5, 0.06, 0.05), matt(0.05, 0.3, 0.1), matt(0.08, 0.12, 0.45)][number % 3];
    maker.add(name, colour, cloth);
}

/// A vase with a plant's ball on a bent stem, in the middle of the nave.
fn vase(maker: &mut Maker, number: usize) {
    maker.begin();
    let side = if number.is_multiple_of(2) { 2.6 } else { -2.6 };
    let place = DAffine3::from_translation(DVec3::new(BAY * (number as f64 + 0.5), side, 0.0));
    let profile = [(0.25, 0.0), (0.3, 0.05), (0.18, 0.15), (0.4, 0.5), (0.42, 0.7), (0.3, 0.85), (0.36, 0.95)];
    let sides = maker.sides(16.0);
    maker.add(format!("vase {number}"), STONE, turned(&profile, sides).at(place));
    let bend = maker.rng.between(-0.3, 0.3);
    let stem = rounded(&[DVec3::new(0.0, 0.0, 0.8), DVec3::new(0.0, 0.0, 1.3), DVec3::new(bend, 0.1, 1.7)], 0.3, 4);
    let ball = blob(DVec3::new(0.4, 0.4, 0.35), 1.0, sides, maker.sides(10.0)).moved(bend, 0.1, 1.9);
    maker.add(format!("plant {number}"), matt(0.1, 0.3, 0.08), swept(&stem, &circle(0.03, 6)).and(ball).at(place));
}
