//! A white skin over coloured ribs, stringers, boxes and cables, as of an aircraft: what is inside lies closer to the
//! skin than a stand-in is wide. The skin is one sheet of small triangles, in panels that are parts. Ribs end at the
//! skin, or a millimetre below. Units are metres; nothing is parallel to an axis.

use super::brute::Tri;
use super::built::{self, Part};
use super::rng::Rng;
use super::scenes::{cuboid, has_area, rounded};
use glam::{DQuat, DVec3};
use outcrop::import::MaterialDesc;
use outcrop::scene::Camera;
use std::f64::consts::TAU;

/// A skin and what it hides.
pub struct Ribbed {
    pub parts: Vec<Part>,
    /// Views in which the skin hides the rest.
    pub outside: Vec<Camera>,
    /// Views of the rest, with the skin between.
    pub within: Vec<Camera>,
}

/// Number of the first part that is not skin.
const INNER: u64 = 1000;

/// Whether a part belongs to the skin; [`outcrop::query::NONE`] does not.
pub fn is_skin(part: u64) -> bool {
    part < INNER
}

/// Whether a part is hidden by the skin, and coloured.
pub fn is_inner(part: u64) -> bool {
    (INNER..1 << 32).contains(&part)
}

/// Linear colours far from grey: primers, cables, pipes.
const COLOURS: [[f32; 3]; 6] = [
    [0.22, 0.34, 0.05],
    [0.80, 0.25, 0.03],
    [0.05, 0.22, 0.55],
    [0.55, 0.04, 0.03],
    [0.60, 0.48, 0.05],
    [0.03, 0.30, 0.25],
];

/// Parts in the order of their ids.
struct Parts {
    all: Vec<Part>,
    turn: DQuat,
}

impl Parts {
    fn new(turn: DQuat) -> Self {
        Self { all: Vec::new(), turn }
    }

    fn add(&mut self, id: u64, material: MaterialDesc, tris: Vec<Tri>) {
        let tris = tris.into_iter().map(|t| t.map(|v| rounded(self.turn * v))).filter(has_area).collect();
        self.all.push(Part { id, material, tris });
    }

    /// Adds panels of the skin, of cells in order of columns.
    fn skin(&mut self, first: u64, panels: [usize; 2], cells: [usize; 2], at: impl Fn(f64, f64) -> DVec3) {
        for panel in 0..panels[0] * panels[1] {
            let of = [panel % panels[0], panel / panels[0]];
            let ranges = [0, 1].map(|k| cells[k] * of[k] / panels[k]..cells[k] * (of[k] + 1) / panels[k]);
            self.add(first + panel as u64, built::WHITE, patch(ranges, cells, &at));
        }
    }

    /// Adds a part of the next colour.
    fn inner(&mut self, tris: Vec<Tri>) {
        let id = self.all.iter().map(|part| part.id + 1).max().unwrap_or(0).max(INNER);
        let colour = COLOURS[(id % COLOURS.len() as u64) as usize];
        self.add(id, MaterialDesc { colour, ..built::WHITE }, tris);
    }

    /// Cameras from eyes to points.
    fn looking(&self, fov_y_degrees: f64, views: &[[[f64; 3]; 2]]) -> Vec<Camera> {
        let camera = |view: &[[f64; 3]; 2]| {
            let [eye, at] = view.map(|point| self.turn * DVec3::from(point));
            Camera::Perspective { eye, at, up: DVec3::Z, fov_y_degrees }
        };
        views.iter().map(camera).collect()
    }
}

/// The cells of a range of a grid of `cells` over the unit square, each in two triangles.
fn patch(ranges: [std::ops::Range<usize>; 2], cells: [usize; 2], at: impl Fn(f64, f64) -> DVec3) -> Vec<Tri> {
    let corner = |i: usize, j: usize| at(i as f64 / cells[0] as f64, j as f64 / cells[1] as f64);
    let [columns, rows] = ranges;
    let all = columns.flat_map(|i| rows.clone().map(move |j| (i, j)));
    let quad = |(i, j)| [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
    all.map(quad).flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()
}

fn whole_patch(cells: [usize; 2], at: impl Fn(f64, f64) -> DVec3) -> Vec<Tri> {
    patch([0..cells[0], 0..cells[1]], cells, at)
}

/// A bar without its ends and the side at depth 0, where it meets the skin: `along` pieces, the deep sides in `deep`
/// pieces. `at`: a point at shares of its length, depth and thickness.
fn bar(along: usize, deep: usize, at: impl Fn(f64, f64, f64) -> DVec3) -> Vec<Tri> {
    let deep_sides = [0.0, 1.0].map(|t| whole_patch([along, deep], |s, d| at(s, d, t)));
    let foot = whole_patch([along, 1], |s, t| at(s, 1.0, t));
    deep_sides.into_iter().flatten().chain(foot).collect()
}

/// A tube of six sides along a line.
fn cable(along: usize, radius: f64, line: impl Fn(f64) -> DVec3, [u, v]: [DVec3; 2]) -> Vec<Tri> {
    whole_patch([along, 6], |s, a| {
        let (sin, cos) = (TAU * a).sin_cos();
        line(s) + (u * cos + v * sin) * radius
    })
}

/// How far the `i`-th rib ends below the skin.
fn gap(i: usize) -> f64 {
    if i.is_multiple_of(2) { 0.0 } else { 0.001 }
}

/// A plate of 4 m by 3 m in 12 panels. Below it 15 ribs, 19 stringers, 400 boxes and 50 cables.
pub fn flat() -> Ribbed {
    let mut rng = Rng::new(31);
    let mut parts =
        Parts::new(DQuat::from_rotation_x(0.7) * DQuat::from_rotation_y(0.45) * DQuat::from_rotation_z(0.3));
    let on = |u: f64, v: f64, deep: f64| DVec3::new(4.0 * u - 2.0, 3.0 * v - 1.5, -deep);
    parts.skin(0, [4, 3], [200, 150], |u, v| on(u, v, 0.0));
    for i in 0..15 {
        let (u, below) = ((i as f64 + 0.6) / 15.0, gap(i));
        parts.inner(bar(70, 4, |s, d, t| on(u + 0.003 / 4.0 * t, s, below + 0.12 * d)));
    }
    for i in 0..19 {
        let (v, below) = ((i as f64 + 0.4) / 19.0, gap(i));
        parts.inner(bar(90, 2, |s, d, t| on(s, v + 0.002 / 3.0 * t, below + 0.04 * d)));
    }
    for _ in 0..400 {
        let low = rng.inside(DVec3::new(-2.0, -1.5, -0.3), DVec3::new(1.85, 1.35, -0.15));
        parts.inner(cuboid(low, low + rng.inside(DVec3::splat(0.03), DVec3::splat(0.14))));
    }
    for _ in 0..50 {
        let (v, deep, sway) = (rng.between(0.02, 0.98), rng.between(0.02, 0.15), rng.between(0.0, 0.01));
        let line = |s: f64| on(s, v + sway * (19.0 * s).sin(), deep);
        parts.inner(cable(60, rng.between(0.004, 0.012), line, [DVec3::Y, DVec3::Z]));
    }
    let outside =
        [[[0.3, -0.2, 4.4], [0.0; 3]], [[2.6, -3.4, 2.3], [0.1, 0.0, 0.0]], [[-1.7, 0.9, 1.6], [-0.5, 0.2, 0.0]]];
    let within = [[[0.4, 0.3, -3.2], [0.0; 3]], [[-1.3, -1.0, -1.6], [0.1, 0.1, 0.0]]];
    let (outside, within) = (parts.looking(40.0, &outside), parts.looking(45.0, &within));
    Ribbed { parts: parts.all, outside, within }
}

/// Length and radius of the tube.
const LENGTH: f64 = 6.0;
const RADIUS: f64 = 1.5;

/// A closed tube, 6 m long and 3 m wide, in 40 panels and two ends. In it 23 ring frames, 32 stringers, bulkheads, a
/// floor, 300 boxes and 50 cables.
pub fn tube() -> Ribbed {
    let mut rng = Rng::new(77);
    let mut parts =
        Parts::new(DQuat::from_rotation_z(0.65) * DQuat::from_rotation_y(0.14) * DQuat::from_rotation_x(0.2));
    // `a` around from the top, `deep` below the skin.
    let on = |u: f64, a: f64, deep: f64| {
        let (sin, cos) = (TAU * a).sin_cos();
        DVec3::new(LENGTH * (u - 0.5), (RADIUS - deep) * sin, (RADIUS - deep) * cos)
    };
    parts.skin(0, [5, 8], [150, 240], |u, a| on(u, a, 0.0));
    // Ends bulge outwards, by 30 cm.
    let end = |side: f64, r: f64, a: f64, deep: f64| {
        let rim = on(0.5 + 0.5 * side, a, 0.0);
        DVec3::new(rim.x + side * (0.3 * (1.0 - r * r) - deep), rim.y * r, rim.z * r)
    };
    for (id, side) in [(100, -1.0), (101, 1.0)] {
        parts.add(id, built::WHITE, whole_patch([30, 120], |r, a| end(side, r, a, 0.0)));
        parts.inner(whole_patch([8, 60], |r, a| end(side, 0.97 * r, a, 0.002)));
    }
    for i in 0..23 {
        let (u, below) = ((i as f64 + 0.7) / 23.5, gap(i));
        parts.inner(bar(240, 1, |a, d, t| on(u + 0.003 / LENGTH * t, a, below + 0.1 * d)));
    }
    for i in 0..32 {
        // The skin's facets are up to 0.13 mm inside of the cylinder.
        let (a, below) = ((i as f64 + 0.3) / 32.0, gap(i) + 0.0002);
        parts.inner(bar(75, 2, |s, d, t| on(s, a + 0.002 / (TAU * RADIUS) * t, below + 0.03 * d)));
    }
    let floor = -0.6;
    parts.inner(whole_patch([60, 30], |u, v| DVec3::new(LENGTH * 0.98 * (u - 0.5), 2.6 * (v - 0.5), floor)));
    for i in 0..300 {
        // Seats on the floor, boxes below it.
        let (low, high) = if i % 3 == 0 { (-1.1, -0.9) } else { (floor, floor + 0.1) };
        let at = rng.inside(DVec3::new(-2.9, -1.0, low), DVec3::new(2.7, 0.85, high));
        parts.inner(cuboid(at, at + rng.inside(DVec3::splat(0.05), DVec3::splat(0.22))));
    }
    for _ in 0..50 {
        let (a, deep, sway) = (rng.unit(), rng.between(0.02, 0.13), rng.between(0.0, 0.004));
        let line = |s: f64| on(s, a + sway * (19.0 * s).sin(), deep);
        let out = on(0.5, a, 0.0) / RADIUS;
        parts.inner(cable(60, rng.between(0.004, 0.012), line, [out, DVec3::X.cross(out)]));
    }
    let outside = [[[3.0, -7.5, 3.0], [0.0; 3]], [[-7.0, 3.5, -2.0], [0.0; 3]], [[1.2, -4.2, 1.3], [0.2, -1.2, 0.3]]];
    let within = [[[-2.4, 0.1, 0.4], [2.5, 0.3, 0.3]], [[-0.4, -1.1, 0.1], [0.4, 1.4, 0.5]]];
    // As a wide lens sees it: there is little room.
    let (outside, within) = (parts.looking(40.0, &outside), parts.looking(90.0, &within));
    Ribbed { parts: parts.all, outside, within }
}
