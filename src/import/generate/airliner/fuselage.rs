//! The fuselage, bay by bay: skin, windows, frames, stringers, clips, fasteners, cables and pipes.

use super::plan::{Look, Plan};
use super::routes::{self, Bundle};
use super::shape::{BAY, BAYS, FIRST_FRAME, fuselage, radius};
use super::soup::{Soup, Station, bolt_triangles, sides};
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// Number of stringers around the fuselage.
const STRINGERS: u64 = 44;
/// Number of skin panels around the fuselage.
const PANELS: u64 = 8;
/// Range of x that has windows.
const CABIN: std::ops::Range<f64> = 7.0..50.0;
/// Range of x in which the skin of the left side is left out.
const CUTAWAY: std::ops::Range<f64> = 12.0..38.0;
/// Borders of a window: as fractions of the bay along x, and as angles from the top in radians.
const WINDOW: ([f64; 2], [f64; 2]) = ([0.25, 0.75], [1.155, 1.30]);

/// Returns the x of frame `k`.
pub fn frame_x(k: u64) -> f64 {
    FIRST_FRAME + BAY * k as f64
}

/// Adds the fuselage section.
pub fn plan(plan: &mut Plan, root: u32) {
    let section = plan.group("fuselage", Some(root));
    ends(plan, section);
    for k in 0..BAYS {
        let bay = plan.group(format!("frame {k:03}"), Some(section));
        skin(plan, bay, k);
        frame(plan, bay, k);
        clips(plan, bay, k);
        around(plan, bay, k);
    }
    stringers(plan, section);
    long_runs(plan, section);
    bundles(plan, section);
    pipes(plan, section);
}

/// Adds nose cap, tail cone and cockpit windows.
fn ends(plan: &mut Plan, section: u32) {
    let (nu, nv) = (plan.scaled(10.0, 0.25, 5), plan.scaled(28.0, 0.25, 16));
    for (name, look, from, to) in
        [("radome", Look::White, 0.0, FIRST_FRAME), ("tail cone", Look::Aluminium, frame_x(BAYS), super::shape::LENGTH)]
    {
        let part = plan.part(name, section, look);
        plan.family(part, 1, 2 * nu * nv, move |_, soup| {
            soup.patch(nu, nv, &|u, v| fuselage(from + (to - from) * u * u.sqrt(), v * TAU, 0.0));
        });
    }
    let n = plan.scaled(4.0, 0.25, 2);
    for side in [-1.0, 1.0] {
        let part = plan.part("cockpit windows", section, Look::Rubber);
        plan.family(part, 3, 2 * n * n, move |i, soup| {
            let (a, x) = (0.06 + 0.36 * i as f64, 2.5 + 0.32 * i as f64);
            soup.patch(n, n, &|u, v| fuselage(x + 0.95 * u, side * (a + 0.3 * v) * (1.25 - 0.4 * u), -0.012));
        });
    }
}

/// True if the skin is left out here, as in a cutaway drawing.
fn is_cut(k: u64, panel: u64) -> bool {
    panel >= 5 && CUTAWAY.contains(&frame_x(k))
}

fn skin(plan: &mut Plan, bay: u32, k: u64) {
    let (nu, nv) = (plan.scaled(1.6, 0.25, 1), plan.scaled(11.0, 0.25, 3));
    let x = frame_x(k);
    for panel in (0..PANELS).filter(|&p| !is_cut(k, p)) {
        let look = match panel {
            _ if x > 51.0 => Look::Blue,
            3 | 4 => Look::Aluminium,
            _ => Look::White,
        };
        let part = plan.part(format!("skin {panel}"), bay, look);
        let (from, step) = (panel as f64 * TAU / PANELS as f64, TAU / PANELS as f64);
        if (panel == 1 || panel == 6) && CABIN.contains(&x) {
            window_panel(plan, bay, part, x, panel == 6);
            continue;
        }
        let make = move |_: u64, soup: &mut Soup| {
            soup.patch(nu, nv, &|u, v| fuselage(x + BAY * u, from + step * v, 0.0));
        };
        plan.family(part, 1, 2 * nu * nv, make);
        if k % 5 == panel % 5 {
            let doubler = plan.part(format!("doubler {panel}"), bay, Look::Primer);
            plan.double(doubler, make);
        }
    }
}

/// Adds a panel with a hole, and the window glass in the hole.
fn window_panel(plan: &mut Plan, bay: u32, part: u32, x: f64, left: bool) {
    let nv = plan.scaled(3.0, 0.25, 1);
    let ([u0, u1], [a0, a1]) = WINDOW;
    let (us, angles) = ([0.0, u0, u1, 1.0], [TAU / 8.0, a0, a1, TAU / 4.0]);
    let side = if left { -1.0 } else { 1.0 };
    let at = move |u: f64, a: f64, inset: f64| fuselage(x + BAY * u, side * a, inset);
    plan.family(part, 1, 8 * 2 * nv, move |_, soup| {
        for cell in (0..9).filter(|&c| c != 4) {
            let (i, j) = (cell % 3, cell / 3);
            soup.patch(1, nv, &|u, v| {
                at(us[i] + (us[i + 1] - us[i]) * u, angles[j] + (angles[j + 1] - angles[j]) * v, 0.0)
            });
        }
    });
    let glass = plan.part("window", bay, Look::Glass);
    plan.family(glass, 1, 2 * nv, move |_, soup| {
        soup.patch(1, nv, &|u, v| at(u0 + (u1 - u0) * u, a0 + (a1 - a0) * v, 0.02));
    });
}

/// Returns the station at `angle` on a ring: `u` points inward, `v` along x.
fn on_ring(x: f64, angle: f64, inset: f64) -> Station {
    let u = DVec3::new(0.0, -angle.sin(), -angle.cos());
    Station { at: fuselage(x, angle, inset), u, v: DVec3::X }
}

/// Cross-section of a frame: a Z of 2 mm sheet, 11 cm deep.
const FRAME_PROFILE: [DVec2; 8] = [
    DVec2::new(0.0, -0.030),
    DVec2::new(0.0, 0.001),
    DVec2::new(0.108, 0.001),
    DVec2::new(0.108, 0.030),
    DVec2::new(0.110, 0.030),
    DVec2::new(0.110, -0.001),
    DVec2::new(0.002, -0.001),
    DVec2::new(0.002, -0.030),
];

fn frame(plan: &mut Plan, bay: u32, k: u64) {
    let part = plan.part("frame", bay, Look::Primer);
    let n = plan.scaled(72.0, 0.25, 8);
    let (profile, closed) = plan.profile(&FRAME_PROFILE, 4);
    let x = frame_x(k);
    let deep = (radius(x) / 3.1).min(1.0);
    plan.family(part, 1, 2 * n * sides(profile, closed), move |_, soup| {
        let path: Vec<Station> = (0..=n).map(|i| on_ring(x, TAU * i as f64 / n as f64, 0.018)).collect();
        let profile: Vec<DVec2> = profile.iter().map(|p| *p * DVec2::new(deep, 1.0)).collect();
        soup.sweep(&path, &profile, closed);
    });
}

/// Cross-section of a stringer: a hat of 1.5 mm sheet.
const HAT: [DVec2; 10] = [
    DVec2::new(0.0, -0.040),
    DVec2::new(0.0, -0.018),
    DVec2::new(0.030, -0.011),
    DVec2::new(0.030, 0.011),
    DVec2::new(0.0, 0.018),
    DVec2::new(0.0, 0.040),
    DVec2::new(0.0015, 0.040),
    DVec2::new(0.0315, 0.011),
    DVec2::new(0.0315, -0.011),
    DVec2::new(0.0015, -0.040),
];

/// Runs of stringers as (first bay, bays per piece, pieces): long pieces where the fuselage is straight, short ones at
/// its ends.
const RUNS: [(u64, u64, u64); 4] = [(0, 7, 2), (14, 16, 4), (78, 7, 4), (106, 6, 1)];

fn stringers(plan: &mut Plan, section: u32) {
    let group = plan.group("stringers", Some(section));
    let n = plan.scaled(1.5, 0.35, 1);
    let (profile, closed) = plan.profile(&HAT, 6);
    for s in 0..STRINGERS {
        let part = plan.part(format!("stringer {s:02}"), group, Look::Stringer);
        let angle = TAU * (s as f64 + 0.5) / STRINGERS as f64;
        for (first, bays, pieces) in RUNS {
            // Straight pieces need no intermediate stations.
            let n = if bays > 7 { 1 } else { n };
            plan.family(part, pieces, 2 * n * sides(profile, closed), move |i, soup| {
                // Neighbouring pieces overlap by 10 cm at the splice.
                let (x, length) = (frame_x(first + i * bays), BAY * bays as f64 + 0.1);
                let path: Vec<Station> =
                    (0..=n).map(|j| beside(x + length * j as f64 / n as f64, angle, 0.012)).collect();
                soup.sweep(&path, profile, closed);
            });
        }
    }
}

/// Returns the station at `angle` on a ring for a sweep along x: `u` points inward, `v` around the fuselage.
fn beside(x: f64, angle: f64, inset: f64) -> Station {
    let ring = on_ring(x, angle, inset);
    Station { v: ring.v.cross(ring.u), ..ring }
}

/// Adds control cables and ducts that are straight over many metres, so that their triangles are as long.
fn long_runs(plan: &mut Plan, section: u32) {
    let group = plan.group("long runs", Some(section));
    let (lines, round) = (plan.scaled(30.0, 0.5, 1), plan.scaled(6.0, 0.2, 3));
    for (i, angle) in [-0.5, 0.5, 2.3, 2.7, 3.5, 3.9].into_iter().enumerate() {
        let part = plan.part(format!("control cables {i}"), group, Look::Steel);
        plan.family(part, lines, 2 * 3 * round, move |_, soup| {
            let (a, deep) = (angle + soup.rng.range(-0.15, 0.15), soup.rng.range(0.12, 0.5));
            let (x, step) = (soup.rng.range(8.0, 12.0), soup.rng.range(8.0, 10.3));
            let at = |j: u64| fuselage(x + step * j as f64, a, deep);
            let path: Vec<DVec3> = (0..4).map(at).collect();
            soup.tube(&path, 0.003, round);
        });
    }
    let count = plan.scaled(10.0, 0.4, 1);
    for (name, angle, deep, look) in [
        ("left duct", -0.8, 0.35, Look::Cream),
        ("right duct", 0.8, 0.35, Look::Cream),
        ("belly duct", PI, 0.8, Look::Aluminium),
    ] {
        let part = plan.part(name, group, look);
        plan.family(part, 4 * count, 2 * 4, move |i, soup| {
            // The ducts run side by side and intersect each other.
            let (a, r) = (angle + 0.02 * (i / 4) as f64, soup.rng.range(0.03, 0.07));
            let x = frame_x(14 + 16 * (i % 4));
            let path = [beside(x, a, deep), beside(x + 16.2 * BAY, a + soup.rng.range(-0.03, 0.03), deep)];
            soup.sweep(&path, &[DVec2::new(-r, -r), DVec2::new(r, -r), DVec2::new(r, r), DVec2::new(-r, r)], true);
        });
    }
}

/// Adds brackets where stringers cross the frame, and their fasteners.
fn clips(plan: &mut Plan, bay: u32, k: u64) {
    let x = frame_x(k);
    let part = plan.part("clips", bay, Look::Clip);
    let count = plan.scaled(STRINGERS as f64, 0.3, 1);
    let coarse = plan.is_coarse();
    plan.family(part, count, if coarse { 12 } else { 36 }, move |i, soup| {
        let angle = TAU * (i as f64 + 0.62) / count as f64 + soup.rng.range(-0.006, 0.006);
        let s = on_ring(x + 0.02, angle, 0.05);
        let w = s.v.cross(s.u);
        soup.cuboid(s.at, [s.u * 0.045, w * 0.022, s.v * 0.001]);
        if coarse {
            return;
        }
        soup.cuboid(s.at - s.u * 0.044 + s.v * 0.02, [s.u * 0.001, w * 0.022, s.v * 0.02]);
        soup.cuboid(s.at + w * 0.021 + s.v * 0.015, [s.u * 0.03, w * 0.001, s.v * 0.015]);
    });
    plan.with_twins(23);
    let part = plan.part("fasteners", bay, Look::Steel);
    let round = plan.scaled(8.0, 0.3, 4);
    let count = plan.scaled(30.0, 0.6, 1);
    plan.family(part, count, bolt_triangles(round), move |i, soup| {
        let angle = TAU * (i as f64 + soup.rng.range(0.0, 0.6)) / count as f64;
        let (deep, along) = (soup.rng.range(0.02, 0.1), soup.rng.range(-0.002, 0.03));
        let s = on_ring(x + along, angle, deep);
        let size = soup.rng.range(0.002, 0.005);
        let axis = (s.v + s.u * soup.rng.range(-0.3, 0.3)).normalize();
        soup.bolt(s.at, axis, size, size * 5.0, round);
    });
    plan.with_twins(40);
    plan.fills();
}

/// Adds cables that run along the frame, around the fuselage.
fn around(plan: &mut Plan, bay: u32, k: u64) {
    let x = frame_x(k);
    for (i, (from, to)) in [(-2.9, -0.9), (0.7, 2.6)].into_iter().enumerate() {
        let part = plan.part(format!("frame cables {i}"), bay, routes::cable_look(k + i as u64));
        let bundle = Bundle { cables: 16.0, radius: 0.04, length: 2.0 * radius(x) };
        routes::cables(plan, part, bundle, move |t| {
            let sway = 0.09 + 0.05 * (k as f64 * 1.7 + t * 9.0).sin();
            on_ring(x + sway, from + (to - from) * t, 0.10 + 0.03 * (t * 17.0 + k as f64).sin())
        });
    }
}

/// Adds bundles of cables along the fuselage, densest at the belly.
fn bundles(plan: &mut Plan, section: u32) {
    const SPAN: u64 = 12;
    let group = plan.group("cables", Some(section));
    for start in (0..BAYS - SPAN / 2).step_by(SPAN as usize / 2) {
        for lane in 0..38u64 {
            let i = start * 38 + lane;
            let part = plan.part(format!("bundle {start:03}-{lane:02}"), group, routes::cable_look(i));
            let spread = (lane as f64 + 0.5) / 38.0 * 2.0 - 1.0;
            // The angle is a cubic function of `spread` that is flat at 0, so that most bundles are near the belly.
            let angle = PI + spread.signum() * PI * (0.25 * spread.abs() + 0.75 * spread.abs().powi(3));
            let x = frame_x(start);
            let length = BAY * SPAN.min(BAYS - start) as f64;
            let phase = (i as f64 * 0.618_034).fract() * TAU;
            let deep = 0.05 + 0.25 * (i as f64 * 0.754_877).fract();
            let bundle = Bundle { cables: 34.0, radius: 0.06, length };
            routes::cables(plan, part, bundle, move |t| {
                let sway = 0.09 * (t * 5.3 + phase).sin() + 0.02 * (t * 21.0 + phase).cos();
                beside(x + length * t, angle + sway, deep + 0.03 * (t * 12.0 - phase).sin())
            });
        }
    }
}

/// Adds pipes along the fuselage, under the floor and over the ceiling.
fn pipes(plan: &mut Plan, section: u32) {
    const SPAN: u64 = 10;
    let group = plan.group("pipes", Some(section));
    for start in (0..BAYS - SPAN).step_by(SPAN as usize - 2) {
        for lane in 0..16u64 {
            let i = start * 16 + lane;
            let part = plan.part(format!("pipes {start:03}-{lane:02}"), group, routes::pipe_look(i));
            let (x, length) = (frame_x(start), BAY * SPAN as f64);
            let angle = if lane < 4 { -0.45 + 0.3 * lane as f64 } else { 2.1 + 0.19 * (lane - 4) as f64 };
            let deep = 0.2 + 0.35 * (i as f64 * 0.569_84).fract();
            let thick = 0.008 + 0.03 * (i as f64 * 0.324_7).fract().powi(2);
            let route = move |t: f64| beside(x + length * t, angle, deep);
            routes::pipes(plan, part, 3.0, (0.6 * thick, thick), length, route);
        }
    }
}
