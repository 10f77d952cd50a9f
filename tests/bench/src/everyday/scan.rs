//! `scan`: a sitting animal as a scanner would have it: blended balls and limbs with fur-like bumps, as one closed
//! surface of irregular triangles. The surface is found by naive surface nets (Gibson, "Constrained Elastic Surface
//! Nets", 1998): one vertex in each cell that the surface crosses, in the middle of the crossings of its edges; where
//! crossings are on the edges, not halfway, as usual today.

use super::shapes::Shape;
use super::{Maker, matt};
use crate::common::rng::Rng;
use glam::{DVec3, IVec3};
use std::collections::HashMap;
use std::f64::consts::TAU;

/// Cells of a block along each axis; blocks that the surface does not come near are skipped.
const BLOCK: i32 = 8;

/// Half the edge of the cube that holds the animal.
const HALF: f64 = 0.1;

/// A limb between two points with a radius at each, or a ball, with equal points.
struct Limb {
    ends: [DVec3; 2],
    radii: [f64; 2],
}

/// A wave of the bumps.
struct Wave {
    k: DVec3,
    phase: f64,
    high: f64,
}

struct Animal {
    limbs: Vec<Limb>,
    waves: Vec<Wave>,
    /// Bound of the gradient's length.
    steep: f64,
}

pub fn make(maker: &mut Maker) {
    let animal = Animal::new(maker.rng.bits());
    // 70,000 triangles at fineness 1.
    let cell = 0.001_05 / maker.fineness();
    maker.add("scan", matt(0.6, 0.5, 0.4), surface(&animal, cell));
}

impl Animal {
    fn new(seed: u64) -> Self {
        let limb = |a: [f64; 3], b: [f64; 3], radii: [f64; 2]| Limb { ends: [a.into(), b.into()], radii };
        let mut limbs = vec![
            // Body, chest, head, snout and tail.
            limb([0.02, 0.0, -0.045], [-0.005, 0.0, -0.02], [0.046, 0.036]),
            limb([-0.02, 0.0, -0.005], [-0.032, 0.0, 0.022], [0.03, 0.026]),
            limb([-0.04, 0.0, 0.03], [-0.062, 0.0, 0.022], [0.024, 0.014]),
            limb([0.07, 0.0, -0.06], [0.076, 0.0, -0.056], [0.016, 0.014]),
        ];
        for side in [-1.0, 1.0] {
            let at = |x: f64, y: f64, z: f64| [x, side * y, z];
            // Ear, thigh, hind foot, fore leg.
            limbs.push(limb(at(-0.028, 0.01, 0.05), at(0.006, 0.022, 0.088), [0.007, 0.0085]));
            limbs.push(limb(at(0.03, 0.034, -0.06), at(0.012, 0.04, -0.07), [0.027, 0.018]));
            limbs.push(limb(at(0.02, 0.042, -0.086), at(-0.02, 0.046, -0.088), [0.01, 0.009]));
            limbs.push(limb(at(-0.03, 0.018, -0.02), at(-0.044, 0.02, -0.086), [0.014, 0.009]));
        }
        let mut rng = Rng::new(seed);
        // Long, middle and short waves, each as steep as about a tenth.
        let wave = |i: usize| {
            let length = [0.04, 0.014, 0.006][i % 3] * rng.between(0.8, 1.25);
            let k = rng.direction() * (TAU / length);
            Wave { k, phase: rng.between(0.0, TAU), high: 0.1 / k.length() }
        };
        let waves: Vec<Wave> = (0..15).map(wave).collect();
        let steep = 1.0 + waves.iter().map(|wave| wave.high * wave.k.length()).sum::<f64>();
        Self { limbs, waves, steep }
    }

    /// Below 0 inside; near the surface about the distance.
    fn value(&self, at: DVec3) -> f64 {
        // Smooth least of the limbs' distances: its gradient is a mean of theirs, hence at most 1.
        const BLEND: f64 = 0.004;
        let sum: f64 = self.limbs.iter().map(|limb| (-limb.distance(at) / BLEND).exp()).sum();
        let smooth = -BLEND * sum.max(f64::MIN_POSITIVE).ln();
        smooth + self.waves.iter().map(|w| w.high * (w.k.dot(at) + w.phase).sin()).sum::<f64>()
    }
}

impl Limb {
    /// At most as steep as 1 + the change of radius along the limb, of at most a third.
    fn distance(&self, at: DVec3) -> f64 {
        let [a, b] = self.ends;
        let along = b - a;
        let t = ((at - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        at.distance(a + along * t) - (self.radii[0] + (self.radii[1] - self.radii[0]) * t)
    }
}

/// The corners of a cell, x fastest.
fn corner(i: usize) -> IVec3 {
    IVec3::new((i & 1) as i32, (i >> 1 & 1) as i32, (i >> 2) as i32)
}

/// The edges of a cell by their corners.
const EDGES: [[usize; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

fn surface(animal: &Animal, cell: f64) -> Shape {
    let place = |p: IVec3| p.as_dvec3() * cell;
    let blocks = (HALF / (cell * f64::from(BLOCK))).ceil() as i32;
    let near = 0.5 * 3f64.sqrt() * f64::from(BLOCK + 2) * cell * (animal.steep + 0.5);
    let mut shape = Shape::default();
    let mut vertex_of: HashMap<IVec3, u32> = HashMap::new();
    let mut cells: Vec<(IVec3, u8)> = Vec::new();
    let edge = (BLOCK + 1) as usize;
    let mut values = vec![0.0; edge * edge * edge];
    let index = |p: IVec3| p.x as usize + edge * (p.y as usize + edge * p.z as usize);
    for first in cube(-blocks, blocks).map(|block| block * BLOCK) {
        if animal.value(place(first) + DVec3::splat(0.5 * f64::from(BLOCK) * cell)).abs() > near {
            continue;
        }
        cube(0, BLOCK + 1).for_each(|p| values[index(p)] = animal.value(place(first + p)));
        for own in cube(0, BLOCK) {
            let at: [f64; 8] = std::array::from_fn(|i| values[index(own + corner(i))]);
            let mask = (0..8).fold(0u8, |mask, i| mask | u8::from(at[i] < 0.0) << i);
            if mask == 0 || mask == 255 {
                continue;
            }
            let crossings = EDGES.iter().filter(|[a, b]| (at[*a] < 0.0) != (at[*b] < 0.0)).map(|&[a, b]| {
                let t = at[a] / (at[a] - at[b]);
                corner(a).as_dvec3().lerp(corner(b).as_dvec3(), t)
            });
            let (sum, count) = crossings.fold((DVec3::ZERO, 0), |(sum, count), at| (sum + at, count + 1));
            vertex_of.insert(first + own, shape.vertices.len() as u32);
            shape.vertices.push(place(first + own) + sum / f64::from(count) * cell);
            cells.push((first + own, mask));
        }
    }
    // Around each crossed edge there are four cells; the edges at a cell's least corner stand for all.
    for (own, mask) in cells {
        let is_inside = |i: u8| mask >> i & 1 == 1;
        for (far, side, other) in [(1, IVec3::Y, IVec3::Z), (2, IVec3::Z, IVec3::X), (4, IVec3::X, IVec3::Y)] {
            if is_inside(0) == is_inside(far) {
                continue;
            }
            let mut around = [own, own - side, own - side - other, own - other].map(|cell| vertex_of[&cell]);
            if !is_inside(0) {
                around.reverse();
            }
            shape.triangles.extend(halves(&shape.vertices, around));
        }
    }
    shape
}

/// Two triangles, cut along the shorter diagonal.
fn halves(vertices: &[DVec3], [a, b, c, d]: [u32; 4]) -> [[u32; 3]; 2] {
    let apart = |i: u32, j: u32| vertices[i as usize].distance_squared(vertices[j as usize]);
    if apart(a, c) <= apart(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
}

fn cube(from: i32, to: i32) -> impl Iterator<Item = IVec3> {
    (from..to).flat_map(move |z| (from..to).flat_map(move |y| (from..to).map(move |x| IVec3::new(x, y, z))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_is_closed_and_faces_outwards() {
        let shape = surface(&Animal::new(1), 0.003);
        let mut edges = HashMap::new();
        for [a, b, c] in &shape.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry((from.min(to), from.max(to))).or_insert(0) += if from < to { 1 } else { -1 };
            }
        }
        assert!(edges.values().all(|n| *n == 0), "an open edge");
        let volume: f64 = shape.corners().iter().map(|t| t[0].dot(t[1].cross(t[2])) / 6.0).sum();
        assert!((2e-4..2e-3).contains(&volume), "{volume}");
    }
}
