//! `machine`: a gear train of some two thousand parts: drilled plates, shafts with gears and bearings between them,
//! bolts, pipes with bends, springs. Finely cut rounds stand beside large flats and the slivers around their holes.

use super::shapes::{Shape, blob, bolt, circle, cuboid, drilled, gear, lathe, rounded, spring, swept, turned};
use super::{Maker, glossy, matt, metal};
use glam::{DAffine3, DVec3};
use outcrop::import::MaterialDesc;
use std::f64::consts::TAU;

/// Length along x, and where the upright plates stand in y.
const LENGTH: f64 = 7.0;
const PLATES: [f64; 5] = [0.4, 1.25, 2.2, 3.05, 4.0];
/// Thickness and height of an upright plate, which stands on the base plate.
const THICK: f64 = 0.06;
const HIGH: f64 = 3.2;
const BASE: f64 = 0.1;
/// Shafts: so many along x and in height, and how far apart.
const ALONG: usize = 12;
const ROWS: usize = 4;
/// Rows that the first plate holds: over it the gears of the first span are seen.
const FIRST_ROWS: usize = 2;
const STEP: f64 = 0.54;
const RISE: f64 = 0.76;

const STEEL: MaterialDesc = metal(0.55);
const IRON: MaterialDesc = metal(0.35);
const BRASS: MaterialDesc = MaterialDesc { colour: [0.7, 0.5, 0.2], opacity: 1.0, metalness: 1.0, roughness: 0.35 };
const PAINT: MaterialDesc = glossy(0.1, 0.25, 0.35);

/// Turns z to y.
fn along_y(at: DVec3) -> DAffine3 {
    DAffine3::from_translation(at) * DAffine3::from_rotation_x(-0.25 * TAU)
}

fn shaft_at(i: usize, row: usize) -> DVec3 {
    DVec3::new(0.53 + STEP * i as f64, 0.0, BASE + 0.46 + RISE * row as f64)
}

pub fn make(maker: &mut Maker) {
    housing(maker);
    for (i, row) in (0..ALONG).flat_map(|i| (0..ROWS).map(move |row| (i, row))) {
        train(maker, i, row);
    }
    for i in 0..24 {
        pipe(maker, i);
    }
    for i in 0..24 {
        let at = DVec3::new(0.4 + 0.27 * f64::from(i), 0.18, BASE);
        maker.begin();
        let coil = spring(0.09, 0.014, 0.7, 9.0, maker.sides(18.0), maker.sides(8.0));
        maker.add(format!("spring {i}"), STEEL, coil.moved(at.x, at.y, at.z + 0.03));
        let cap = [(0.11, 0.0), (0.11, 0.02), (0.05, 0.03), (0.05, 0.76), (0.11, 0.76), (0.11, 0.78)];
        maker.add(format!("spring {i} guide"), IRON, turned(&cap, maker.sides(16.0)).moved(at.x, at.y, at.z));
    }
}

/// How many rows of shafts upright plate `n` holds, and how high it is.
fn rows_of(n: usize) -> (usize, f64) {
    if n == 0 { (FIRST_ROWS, HIGH - RISE * (ROWS - FIRST_ROWS) as f64) } else { (ROWS, HIGH) }
}

/// The base plate, upright plates with a hole for each shaft, lids, and their bolts.
fn housing(maker: &mut Maker) {
    maker.begin();
    let lines =
        |from: f64, to: f64, n: usize| (0..=n).map(|i| from + (to - from) * i as f64 / n as f64).collect::<Vec<_>>();
    let sides = maker.sides(40.0);
    // Few small holes in a large plate: long slivers.
    let base =
        drilled(
            &lines(0.0, LENGTH, 6),
            &lines(0.0, 4.4, 3),
            BASE,
            sides,
            |i, j| if (i + j) % 2 == 0 { 0.04 } else { 0.0 },
        );
    maker.add("base plate", PAINT, base);
    let first = shaft_at(0, 0);
    let mut xs = vec![0.0];
    xs.extend((0..=ALONG).map(|i| first.x + STEP * (i as f64 - 0.5)));
    xs.push(LENGTH);
    for (n, y) in PLATES.into_iter().enumerate() {
        maker.begin();
        let (rows, high) = rows_of(n);
        let mut zs = vec![0.0];
        zs.extend((0..=rows).map(|i| first.z - BASE + RISE * (i as f64 - 0.5)));
        zs.push(high);
        let is_shaft = |i: usize, j: usize| (1..=ALONG).contains(&i) && (1..=rows).contains(&j);
        let plate = drilled(&xs, &zs, THICK, maker.sides(44.0), |i, j| if is_shaft(i, j) { 0.14 } else { 0.0 });
        // Height to z, the plate's own up to -y.
        let place =
            DAffine3::from_translation(DVec3::new(0.0, y + THICK, BASE)) * DAffine3::from_rotation_x(0.25 * TAU);
        maker.add(format!("plate {n}"), PAINT, plate.at(place));
        for (k, z) in [0.02, high - 0.08].into_iter().enumerate() {
            let flange = cuboid(DVec3::new(0.0, y + THICK, BASE + z), DVec3::new(LENGTH, 0.16, 0.06));
            maker.add(format!("plate {n} flange {k}"), PAINT, flange);
            for i in 0..24 {
                maker.begin();
                let place = DAffine3::from_translation(DVec3::new(
                    0.2 + 0.287 * f64::from(i),
                    y + THICK + 0.08,
                    BASE + z + 0.06,
                )) * DAffine3::from_rotation_z(maker.rng.between(0.0, TAU))
                    * DAffine3::from_scale(DVec3::splat(0.03));
                let screw = bolt(maker.at_least(72, 260.0));
                maker.add(format!("plate {n} bolt {k}-{i}"), STEEL, screw.at(place));
            }
        }
    }
}

/// A shaft with a gear in each span between plates and a bearing in each plate.
fn train(maker: &mut Maker, i: usize, row: usize) {
    let (at, name) = (shaft_at(i, row), format!("shaft {i}-{row}"));
    maker.begin();
    let mut profile = vec![(0.035, 0.25), (0.04, 0.26)];
    for y in PLATES {
        profile.extend([(0.05, y - 0.1), (0.045, y - 0.09), (0.045, y + THICK + 0.09), (0.05, y + THICK + 0.1)]);
    }
    profile.extend([(0.04, 4.2), (0.03, 4.21), (0.03, 4.3)]);
    maker.add(&name, STEEL, turned(&profile, maker.sides(24.0)).at(along_y(at)));
    for (span, y) in PLATES[..4].iter().enumerate() {
        maker.begin();
        let teeth = 18 + maker.rng.below(10);
        let wheel = gear(teeth, 0.5 * STEP - 0.005, 0.05, 0.1, maker.at_least(1, 2.0));
        let spin = DAffine3::from_rotation_z(maker.rng.between(0.0, TAU));
        let along = y + 0.25 + if (i + row).is_multiple_of(2) { 0.0 } else { 0.12 } + 0.05 * span as f64;
        let material = if teeth.is_multiple_of(3) { BRASS } else { IRON };
        let place = along_y(at + along * DVec3::Y) * spin;
        maker.add(format!("{name} gear {span}"), material, wheel.at(place));
        let hub = [(0.05, -0.05), (0.09, -0.05), (0.1, -0.04), (0.1, 0.0), (0.05, 0.0), (0.05, -0.05)];
        maker.add(format!("{name} hub {span}"), material, lathe(&hub, maker.sides(24.0)).at(place));
    }
    for (n, y) in PLATES.into_iter().enumerate().filter(|(n, _)| row < rows_of(*n).0) {
        maker.begin();
        let place = along_y(at + y * DVec3::Y);
        let sides = maker.sides(30.0);
        let outer = [
            (0.14, 0.0),
            (0.14, 0.06),
            (0.115, 0.06),
            (0.112, 0.045),
            (0.12, 0.03),
            (0.112, 0.015),
            (0.115, 0.0),
            (0.14, 0.0),
        ];
        let inner = outer.map(|(r, z)| (0.045 + (0.14 - r), z));
        maker.add(format!("{name} bearing {n} outer"), STEEL, lathe(&outer, sides).at(place));
        maker.add(format!("{name} bearing {n} inner"), STEEL, lathe(&inner, sides).at(place));
        let (around, rings) = (maker.sides(9.0), maker.at_least(2, 5.0));
        let balls = (0..8).map(|k| {
            let (s, c) = (TAU * f64::from(k) / 8.0).sin_cos();
            blob(DVec3::splat(0.02), 1.0, around, rings).moved(0.0925 * c, 0.0925 * s, 0.03)
        });
        maker.add(format!("{name} bearing {n} balls"), metal(0.7), balls.reduce(Shape::and).expect("balls").at(place));
    }
}

/// A pipe over the top, from plate to plate, with two to four bends and a flange at each end.
fn pipe(maker: &mut Maker, number: u32) {
    maker.begin();
    let x = 0.35 + 0.27 * f64::from(number);
    let top = BASE + HIGH;
    let (low, high) = (top + maker.rng.between(0.2, 0.5), top + maker.rng.between(0.6, 1.3));
    let (from, to) = (maker.rng.between(1.3, 1.5), maker.rng.between(3.1, 3.3));
    let middle = maker.rng.between(1.8, 2.4);
    let aside = x + maker.rng.between(-0.15, 0.15);
    let corners = [
        DVec3::new(x, from, top),
        DVec3::new(x, from, high),
        DVec3::new(aside, middle, high),
        DVec3::new(aside, middle + 0.3, low),
        DVec3::new(aside, to, low),
        DVec3::new(aside, to, top),
    ];
    let radius = maker.rng.between(0.03, 0.06);
    let path = rounded(&corners, 0.2, maker.sides(10.0));
    let sides = maker.sides(18.0);
    maker.add(
        format!("pipe {number}"),
        if number.is_multiple_of(3) { BRASS } else { matt(0.5, 0.1, 0.05) },
        swept(&path, &circle(radius, sides)),
    );
    for (k, end) in [corners[0], corners[5]].into_iter().enumerate() {
        let flange = [(radius, 0.0), (2.0 * radius, 0.0), (2.0 * radius, 0.03), (radius, 0.03), (radius, 0.0)];
        let flange = lathe(&flange, sides).at(DAffine3::from_translation(end));
        maker.add(format!("pipe {number} flange {k}"), STEEL, flange);
    }
}
