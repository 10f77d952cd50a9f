//! Floor, seats, bins, lining and cargo.

use super::fuselage::frame_x;
use super::plan::{Look, Plan};
use super::shape::{BAY, BAYS, fuselage, radius, rise};
use super::soup::{Soup, bolt_triangles};
use glam::DVec3;

/// Height of the floor.
const FLOOR: f64 = -0.55;
/// Lateral positions (y) of the seat centres.
const SEATS: [f64; 10] = [-2.55, -2.07, -1.59, -0.72, -0.24, 0.24, 0.72, 1.59, 2.07, 2.55];

/// Adds the cabin section.
pub fn plan(plan: &mut Plan, root: u32) {
    let section = plan.group("cabin", Some(root));
    for k in (0..BAYS).filter(|&k| (6.0..52.0).contains(&frame_x(k))) {
        let bay = plan.group(format!("bay {k:03}"), Some(section));
        floor(plan, bay, k);
        lining(plan, bay, k);
        if k % 2 == 0 {
            seats(plan, bay, k);
        }
        if k % 4 == 1 && (11.0..46.0).contains(&frame_x(k)) {
            cargo(plan, bay, k);
        }
    }
}

/// Returns half of the cabin's width at height `z`.
fn half_width(x: f64, z: f64) -> f64 {
    let r = radius(x) - 0.16;
    (r * r - (z - rise(x)).powi(2)).max(0.01).sqrt()
}

fn floor(plan: &mut Plan, bay: u32, k: u64) {
    let x = frame_x(k);
    let beams = plan.part("floor beam", bay, Look::Primer);
    let coarse = plan.is_coarse();
    let n = plan.scaled(9.0, 0.25, 1);
    plan.family(beams, 1, if coarse { 12 } else { 36 + 24 * n }, move |_, soup| {
        let w = half_width(x, FLOOR - 0.1);
        if coarse {
            soup.cuboid(DVec3::new(x, 0.0, FLOOR - 0.1), [DVec3::X * 0.03, DVec3::Y * w, DVec3::Z * 0.1]);
            return;
        }
        for (z, half) in [
            (-0.03, DVec3::new(0.03, w, 0.001)),
            (-0.2, DVec3::new(0.03, w, 0.001)),
            (-0.115, DVec3::new(0.001, w, 0.085)),
        ] {
            let half = [DVec3::X * half.x, DVec3::Y * half.y, DVec3::Z * half.z];
            soup.cuboid(DVec3::new(x, 0.0, FLOOR + z), half);
        }
        for i in 0..2 * n {
            // Struts alternately lean left and right.
            let y = w * 0.9 * ((i as f64 + 0.5) / n as f64 - 1.0);
            let lean = DVec3::new(0.0, if i % 2 == 0 { 0.03 } else { -0.03 }, 0.083);
            soup.cuboid(DVec3::new(x + 0.012, y, FLOOR - 0.115), [DVec3::X * 0.01, DVec3::Y * 0.006, lean]);
        }
    });
    let panels = plan.part("floor panels", bay, Look::Floor);
    let count = if plan.is_coarse() { 1 } else { 4 };
    plan.family(panels, count, 12, move |i, soup| {
        let w = half_width(x, FLOOR) / count as f64;
        let center = DVec3::new(x + 0.5 * BAY, w * (2.0 * i as f64 + 1.0 - count as f64), FLOOR - 0.01);
        soup.cuboid(center, [DVec3::X * 0.262, DVec3::Y * (w - 0.004), DVec3::Z * 0.008]);
    });
    let screws = plan.part("floor screws", bay, Look::Steel);
    let (count, sides) = (plan.scaled(10.0, 0.6, 1), plan.scaled(6.0, 0.3, 4));
    plan.family(screws, count, bolt_triangles(sides), move |_, soup| {
        let w = half_width(x, FLOOR);
        let at = DVec3::new(x + soup.rng.range(0.0, BAY), soup.rng.range(-w, w), FLOOR);
        soup.bolt(at, DVec3::Z, 0.004, 0.03, sides);
    });
    plan.with_twins(16);
}

/// Adds the bins over the seats on both sides, and the wall lining on the right, where the skin is complete.
fn lining(plan: &mut Plan, bay: u32, k: u64) {
    let x = frame_x(k);
    let n = plan.scaled(6.0, 0.25, 2);
    for side in [-1.0, 1.0] {
        let part = plan.part("bin", bay, Look::Cream);
        plan.family(part, 1, 4 * n + 12, move |_, soup| {
            for deep in [0.0, 0.004] {
                soup.patch(1, n, &|u, v| {
                    let a = v * 1.9;
                    let y = half_width(x, 1.15) - 0.72 + deep + 0.25 * (a.cos() - 0.2);
                    DVec3::new(x + (BAY - 0.01) * u, side * y, rise(x) + 1.15 + 0.26 * (a - 0.6).sin())
                });
            }
            let y = side * (half_width(x, 1.15) - 0.4);
            soup.cuboid(
                DVec3::new(x + 0.5 * BAY, y, rise(x) + 1.02),
                [DVec3::X * 0.26, DVec3::Y * 0.3, DVec3::Z * 0.004],
            );
        });
    }
    let part = plan.part("lining", bay, Look::Cream);
    plan.family(part, 1, 2 * n, move |_, soup| {
        soup.patch(1, n, &|u, v| fuselage(x + BAY * u, 1.3 + 0.45 * v, 0.15));
    });
    let part = plan.part("insulation", bay, Look::Wool);
    plan.family(part, 1, 4 * n, move |_, soup| {
        soup.patch(2, n, &|u, v| fuselage(x + BAY * u, 0.35 + 0.7 * v, 0.04 + 0.06 * (u * 3.1).sin()));
    });
}

fn seats(plan: &mut Plan, bay: u32, k: u64) {
    let x = frame_x(k);
    // At low detail a seat has no legs and armrests, only a cushion and a back.
    let sides = if plan.is_coarse() { 0 } else { plan.scaled(6.0, 0.25, 3) };
    let triangles = if sides == 0 { 24 } else { 6 * 12 + 4 * 2 * 2 * sides };
    // Outer seats are left out where the fuselage narrows.
    let wide = half_width(x, FLOOR + 0.2) > 2.85;
    for (name, seats) in [("left seats", 0..3), ("middle seats", 3..7), ("right seats", 7..10)] {
        if !wide && seats.start != 3 {
            continue;
        }
        let part = plan.part(name, bay, Look::Seat);
        let first = seats.start;
        plan.family(part, seats.len() as u64, triangles, move |i, soup| {
            seat(soup, DVec3::new(x, SEATS[first + i as usize], FLOOR), sides);
        });
    }
}

fn seat(soup: &mut Soup, foot: DVec3, sides: u64) {
    let lean = DVec3::new(soup.rng.range(0.10, 0.16), 0.0, 0.34);
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    soup.cuboid(foot + z * 0.43, [x * 0.23, y * 0.215, z * 0.06]);
    soup.cuboid(foot + x * 0.3 + z * 0.82, [x * 0.045, y * 0.21, lean]);
    if sides == 0 {
        return;
    }
    soup.cuboid(foot + x * 0.42 + z * 1.2, [x * 0.05, y * 0.13, lean * 0.25]);
    for side in [-0.23, 0.23] {
        soup.cuboid(foot + y * side + x * 0.05 + z * 0.64, [x * 0.2, y * 0.018, z * 0.015]);
    }
    soup.cuboid(foot + x * 0.37 + z * 0.85, [x * 0.004, y * 0.19, lean * 0.5]);
    for (dx, dy) in [(-0.18, -0.17), (-0.18, 0.17), (0.2, -0.17), (0.2, 0.17)] {
        let top = foot + x * dx + y * dy + z * 0.4;
        soup.tube(&[foot + x * (dx * 1.2) + y * dy, top - z * 0.15, top], 0.012, sides);
    }
}

/// Adds a pair of containers under the floor.
fn cargo(plan: &mut Plan, bay: u32, k: u64) {
    let x = frame_x(k);
    let n = plan.scaled(8.0, 0.3, 1);
    for side in [-1.0, 1.0] {
        let part = plan.part("container", bay, Look::Aluminium);
        plan.family(part, 1, 12 * (1 + 2 * n), move |_, soup| {
            let center = DVec3::new(x + 1.0, side * 0.95, -1.75);
            soup.cuboid(center, [DVec3::X * 0.78, DVec3::Y * 0.72, DVec3::Z * 0.8]);
            for i in 0..2 * n {
                let (row, face) = (i / 2, if i % 2 == 0 { 1.0 } else { -1.0 });
                let along = DVec3::X * (0.75 * (2.0 * (row as f64 + 0.5) / n as f64 - 1.0));
                soup.cuboid(
                    center + along + DVec3::Y * face * 0.725,
                    [DVec3::X * 0.01, DVec3::Y * 0.012, DVec3::Z * 0.79],
                );
            }
        });
    }
}
