//! `car`: a body of smooth sheets with gaps between panels and openings for wheels, glass, tyres with treads, seats.
//! It drives along -x; y is to its right.

use super::shapes::{Shape, blob, circle, cuboid, lathe, prism, ring, rounded, sheet, spring, swept};
use super::{Maker, glass, glossy, matt, metal};
use glam::{DAffine3, DVec3};
use outcrop::import::MaterialDesc;
use std::f64::consts::TAU;

const LENGTH: f64 = 4.6;
const WIDTH: f64 = 1.84;
/// Height of sills over the ground.
const SILL: f64 = 0.22;
/// Of wheels: where they stand from the front, their radius, and how far their middles are from the middle plane.
const WHEELS: [f64; 2] = [0.85, 3.6];
const RADIUS: f64 = 0.33;
const TRACK: f64 = 0.78;

const PAINT: MaterialDesc = glossy(0.5, 0.03, 0.03);
const RUBBER: MaterialDesc = matt(0.03, 0.03, 0.03);
const LEATHER: MaterialDesc = matt(0.25, 0.15, 0.08);

fn smooth(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The body's skin: `s` along it from the front, `a` over it from the left sill to the right one, both 0 to 1.
fn skin(s: f64, a: f64) -> DVec3 {
    let nose = (1.0 - (2.0 * s - 1.0).abs().powi(5) * 0.28).max(0.0);
    let hood = 0.62 + 0.12 * smooth(0.0, 0.25, s) - 0.12 * smooth(0.85, 1.0, s);
    let cabin = 0.46 * smooth(0.26, 0.45, s) * (1.0 - smooth(0.64, 0.86, s));
    let ends = smooth(-0.06, 0.05, s) * (1.0 - smooth(0.96, 1.05, s));
    let high = (hood + cabin - SILL + 0.12) * (0.35 + 0.65 * ends);
    // A superellipse across, which leans in over the belt line.
    let (up, out) = (0.5 * TAU * a).sin_cos();
    let power = |x: f64, e: f64| x.signum() * x.abs().powf(e);
    let z = SILL + high * power(up, 0.55);
    let lean = 1.0 - 0.24 * smooth(0.7, 1.35, z);
    DVec3::new(LENGTH * s, 0.5 * WIDTH * nose * lean * power(out, 0.4), z)
}

/// A panel: a piece of the skin whose edges are folded inwards.
fn panel([s0, s1]: [f64; 2], [a0, a1]: [f64; 2], along: usize, across: usize) -> Shape {
    let (nu, nv) = (along + 2, across + 2);
    sheet(nu, nv, |u, v| {
        let (i, j) = ((u * nu as f64).round(), (v * nv as f64).round());
        let inner = |k: f64, n: usize| ((k - 1.0) / n as f64).clamp(0.0, 1.0);
        let at = skin(s0 + (s1 - s0) * inner(i, along), a0 + (a1 - a0) * inner(j, across));
        let is_fold = i == 0.0 || j == 0.0 || i == nu as f64 || j == nv as f64;
        let inside = DVec3::new(at.x, 0.0, 0.5);
        if is_fold { at + (inside - at).normalize() * 0.025 } else { at }
    })
    .without(is_wheel_opening)
}

fn is_wheel_opening(p: DVec3) -> bool {
    p.y.abs() > 0.45 && WHEELS.iter().any(|x| (p.x - x).hypot(p.z - RADIUS) < RADIUS + 0.06)
}

/// Both sides of a panel on the left.
fn sides_of(a: [f64; 2]) -> [(&'static str, [f64; 2]); 2] {
    [("left", a), ("right", [1.0 - a[1], 1.0 - a[0]])]
}

pub fn make(maker: &mut Maker) {
    body(maker);
    for (axle, x) in [("front", WHEELS[0]), ("rear", WHEELS[1])] {
        for (side, y) in [("left", TRACK), ("right", -TRACK)] {
            wheel(maker, &format!("{axle} {side} wheel"), DVec3::new(x, y, RADIUS));
        }
    }
    for (row, x) in [("front", 1.95), ("rear", 2.75)] {
        for (side, y) in [("left", 0.36), ("right", -0.36)] {
            seat(maker, &format!("{row} {side} seat"), DVec3::new(x, y, 0.35));
        }
    }
    inside(maker);
    trim(maker);
}

fn body(maker: &mut Maker) {
    let add = |maker: &mut Maker, name: &str, material, s: [f64; 2], a: [f64; 2]| {
        maker.begin();
        // About 2 cm a cell.
        let (along, across) = (maker.sides(260.0 * (s[1] - s[0])), maker.sides(170.0 * (a[1] - a[0])));
        maker.add(name, material, panel(s, a, along, across));
    };
    add(maker, "bonnet", PAINT, [0.03, 0.268], [0.222, 0.778]);
    add(maker, "nose", PAINT, [0.0, 0.027], [0.0, 1.0]);
    add(maker, "windscreen", glass(), [0.272, 0.418], [0.3, 0.7]);
    add(maker, "roof", PAINT, [0.422, 0.655], [0.352, 0.648]);
    add(maker, "rear window", glass(), [0.659, 0.8], [0.3, 0.7]);
    add(maker, "boot lid", PAINT, [0.804, 0.97], [0.222, 0.778]);
    add(maker, "tail", PAINT, [0.973, 1.0], [0.0, 1.0]);
    let sides = [
        ("front wing", PAINT, [0.03, 0.268], [0.0, 0.219]),
        ("sill", PAINT, [0.271, 0.76], [0.0, 0.03]),
        ("front door", PAINT, [0.271, 0.498], [0.033, 0.262]),
        ("rear door", PAINT, [0.501, 0.7], [0.033, 0.262]),
        ("rear wing", PAINT, [0.703, 0.97], [0.033, 0.219]),
        ("front side window", glass(), [0.36, 0.498], [0.265, 0.349]),
        ("rear side window", glass(), [0.501, 0.66], [0.265, 0.349]),
        ("front pillar", PAINT, [0.272, 0.357], [0.265, 0.297]),
        ("rear pillar", PAINT, [0.663, 0.8], [0.222, 0.297]),
    ];
    for (name, material, s, a) in sides {
        for (side, a) in sides_of(a) {
            add(maker, &format!("{side} {name}"), material, s, a);
        }
    }
}

/// Tyre, treads, rim with spokes, nuts, brake, spring and the arch over all.
fn wheel(maker: &mut Maker, name: &str, at: DVec3) {
    maker.begin();
    let out = at.y.signum();
    // z to the outside.
    let place = DAffine3::from_translation(at) * DAffine3::from_rotation_x(-0.25 * TAU * out);
    let (around_it, across) = (maker.sides(72.0), maker.sides(14.0));
    let tyre: Vec<(f64, f64)> = (0..=across)
        .map(|i| {
            let (s, c) = (TAU * i as f64 / across as f64).sin_cos();
            let power = |x: f64| x.signum() * x.abs().sqrt();
            (RADIUS - 0.07 + 0.06 * power(c), 0.1 * power(s))
        })
        .collect();
    maker.add(format!("{name} tyre"), RUBBER, lathe(&tyre, around_it).at(place));
    let blocks = maker.sides(56.0);
    let tread = |row: usize, i: usize| {
        let turn = TAU * (i as f64 + 0.5 * (row % 2) as f64) / blocks as f64;
        let size = DVec3::new(0.012, 0.7 * TAU * RADIUS / blocks as f64, 0.03);
        let block = cuboid(DVec3::new(RADIUS - 0.012, -0.5 * size.y, 0.038 * row as f64 - 0.091), size);
        block.at(place * DAffine3::from_rotation_z(turn))
    };
    let treads = (0..5).flat_map(|row| (0..blocks).map(move |i| (row, i))).map(|(row, i)| tread(row, i));
    maker.add(format!("{name} treads"), RUBBER, treads.reduce(Shape::and).expect("treads"));
    let rim = [
        (0.2, -0.08),
        (0.21, -0.07),
        (0.18, 0.0),
        (0.19, 0.06),
        (0.215, 0.085),
        (0.205, 0.09),
        (0.175, 0.05),
        (0.17, -0.02),
    ];
    maker.add(format!("{name} rim"), metal(0.7), lathe(&rim, around_it).at(place));
    let (fine, coarse) = (maker.sides(14.0), maker.sides(12.0));
    for i in 0..5 {
        let turn = DAffine3::from_rotation_z(TAU * f64::from(i) / 5.0);
        let spoke = blob(DVec3::new(0.08, 0.022, 0.015), 0.6, fine, coarse).moved(0.105, 0.0, 0.05);
        maker.add(format!("{name} spoke {i}"), metal(0.7), spoke.at(place * turn));
        let nut = prism(&circle(0.012, 6), 0.02).moved(0.04, 0.0, 0.06);
        maker.add(format!("{name} nut {i}"), metal(0.4), nut.at(place * turn));
    }
    let hub = [(0.0001, 0.062), (0.055, 0.06), (0.06, 0.05), (0.06, -0.1)];
    maker.add(format!("{name} hub"), metal(0.5), lathe(&hub, around_it / 2 + 2).at(place));
    let disc = [(0.06, -0.03), (0.15, -0.03), (0.15, -0.05), (0.06, -0.05), (0.06, -0.03)];
    maker.add(format!("{name} brake"), metal(0.45), lathe(&disc, around_it).at(place));
    let coil = spring(0.055, 0.008, 0.28, 6.0, maker.sides(16.0), maker.sides(7.0));
    maker.add(format!("{name} spring"), metal(0.3), coil.moved(at.x, at.y - 0.2 * out, at.z));
    // A lip around the opening, where the body is there.
    let steps = maker.sides(30.0);
    let lip: Vec<DVec3> = (0..=steps)
        .map(|i| {
            let (s, c) = (0.5 * TAU * i as f64 / steps as f64).sin_cos();
            let r = RADIUS + 0.07;
            let p = DVec3::new(at.x - r * c, 0.0, RADIUS + r * s);
            DVec3::new(p.x, out * beside(p.x, p.z), p.z)
        })
        .collect();
    maker.add(format!("{name} lip"), RUBBER, swept(&lip, &circle(0.018, maker.sides(8.0))));
    let liner = sheet(steps, 2, |u, v| {
        let (s, c) = (0.5 * TAU * u).sin_cos();
        let r = RADIUS + 0.06;
        DVec3::new(at.x - r * c, out * (0.5 + 0.36 * v), RADIUS + r * s)
    });
    maker.add(format!("{name} liner"), RUBBER, liner);
}

/// How far from the middle plane the skin is at a height.
fn beside(x: f64, z: f64) -> f64 {
    let (s, mut low, mut high) = (x / LENGTH, 0.0, 0.5);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if skin(s, middle).z < z { low = middle } else { high = middle }
    }
    skin(s, low).y
}

fn seat(maker: &mut Maker, name: &str, at: DVec3) {
    maker.begin();
    let (around_it, rings) = (maker.sides(36.0), maker.sides(22.0));
    let cushion = blob(DVec3::new(0.27, 0.25, 0.08), 0.45, around_it, rings);
    maker.add(format!("{name} cushion"), LEATHER, cushion.moved(at.x, at.y, at.z));
    let lean = DAffine3::from_translation(at + DVec3::new(0.33, 0.0, 0.3)) * DAffine3::from_rotation_y(0.3);
    let back = blob(DVec3::new(0.07, 0.25, 0.32), 0.45, around_it, rings);
    // Hollow, with seams.
    let shaped = Shape {
        vertices: back
            .vertices
            .iter()
            .map(|v| DVec3::new(v.x - 0.8 * v.y * v.y + 0.004 * (60.0 * v.z).cos(), v.y, v.z))
            .collect(),
        ..back
    };
    maker.add(format!("{name} back"), LEATHER, shaped.at(lean));
    let head = blob(DVec3::new(0.05, 0.13, 0.08), 0.6, around_it, rings / 2 + 2).moved(0.0, 0.0, 0.4);
    maker.add(format!("{name} head rest"), LEATHER, head.at(lean));
}

/// Floor, dashboard, steering wheel, gauges, levers.
fn inside(maker: &mut Maker) {
    maker.begin();
    let floor = sheet(2, 1, |u, v| DVec3::new(0.5 + 3.5 * u, 0.7 * (2.0 * v - 1.0), SILL + 0.03));
    maker.add("floor", matt(0.08, 0.08, 0.08), floor);
    let (around_it, rings) = (maker.sides(48.0), maker.sides(24.0));
    let dash = blob(DVec3::new(0.2, 0.68, 0.13), 0.5, around_it, rings).moved(1.42, 0.0, 0.72);
    maker.add("dashboard", matt(0.06, 0.06, 0.06), dash);
    let column = DAffine3::from_translation(DVec3::new(1.72, 0.36, 0.75)) * DAffine3::from_rotation_y(-1.1);
    maker.add("steering wheel", RUBBER, ring(0.18, 0.015, maker.sides(48.0), maker.sides(12.0)).at(column));
    for i in 0..3 {
        let turn = DAffine3::from_rotation_z(TAU * f64::from(i) / 3.0);
        let spoke = blob(DVec3::new(0.085, 0.02, 0.01), 0.6, 10, 6).moved(0.09, 0.0, 0.0);
        maker.add(format!("steering wheel spoke {i}"), RUBBER, spoke.at(column * turn));
    }
    for (i, y) in [0.24, 0.36, 0.48].into_iter().enumerate() {
        let gauge = [(0.0001, 0.0), (0.05, 0.0), (0.055, 0.02), (0.06, 0.0)];
        let place = DAffine3::from_translation(DVec3::new(1.6, y, 0.86)) * DAffine3::from_rotation_y(1.2);
        maker.add(format!("gauge {i}"), glossy(0.8, 0.8, 0.8), lathe(&gauge, maker.sides(28.0)).at(place));
    }
    let lever = rounded(&[DVec3::new(1.8, 0.0, 0.3), DVec3::new(1.85, 0.0, 0.5), DVec3::new(1.8, 0.0, 0.6)], 0.05, 5);
    maker.add("gear lever", metal(0.5), swept(&lever, &circle(0.012, maker.sides(10.0))));
}

/// Lamps, grille, mirrors, handles, exhausts.
fn trim(maker: &mut Maker) {
    for (side, out) in [("left", 1.0), ("right", -1.0)] {
        maker.begin();
        let (around_it, rings) = (maker.sides(28.0), maker.sides(14.0));
        for (name, x, z, material) in [
            ("head lamp", 0.14, 0.58, glossy(0.9, 0.9, 0.85)),
            ("tail lamp", LENGTH - 0.14, 0.62, glossy(0.6, 0.02, 0.02)),
        ] {
            let lamp = blob(DVec3::new(0.1, 0.16, 0.06), 0.8, around_it, rings);
            maker.add(format!("{side} {name}"), material, lamp.moved(x, 0.56 * out, z));
        }
        let mirror = blob(DVec3::new(0.05, 0.1, 0.07), 0.7, around_it, rings);
        maker.add(format!("{side} mirror"), PAINT, mirror.moved(1.55, 0.98 * out, 0.92));
        for (door, x) in [("front", 2.1), ("rear", 3.05)] {
            let y = beside(x, 0.72);
            let corners = [(0.0, -0.01), (0.0, 0.03), (0.18, 0.03), (0.18, -0.01)];
            let path =
                rounded(&corners.map(|(dx, dy)| DVec3::new(x + dx, out * (y + dy), 0.72)), 0.03, maker.sides(5.0));
            maker.add(format!("{side} {door} handle"), metal(0.6), swept(&path, &circle(0.011, maker.sides(10.0))));
        }
        let pipe =
            [DVec3::new(3.2, 0.4 * out, 0.2), DVec3::new(3.9, 0.5 * out, 0.24), DVec3::new(4.6, 0.5 * out, 0.24)];
        let exhaust = swept(&rounded(&pipe, 0.2, maker.sides(8.0)), &circle(0.035, maker.sides(16.0)));
        maker.add(format!("{side} exhaust"), metal(0.5), exhaust);
    }
    for i in 0..10 {
        maker.begin();
        let z = 0.34 + 0.025 * f64::from(i);
        let slat = rounded(
            &[DVec3::new(0.06, -0.4, z), DVec3::new(0.0, 0.0, z), DVec3::new(0.06, 0.4, z)],
            0.4,
            maker.sides(10.0),
        );
        maker.add(format!("grille slat {i}"), metal(0.3), swept(&slat, &circle(0.008, maker.sides(8.0))));
    }
}
