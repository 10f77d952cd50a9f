//! Meshes of parts: surfaces of revolution and bent tubes, about the axis z, in metres.

use glam::DVec3;
use std::f64::consts::TAU;

/// A mesh with shared corners.
#[derive(Debug, Clone, Default)]
pub struct Shape {
    pub vertices: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// The corners of each triangle.
    pub fn corners(&self) -> Vec<[DVec3; 3]> {
        self.triangles.iter().map(|t| t.map(|i| self.vertices[i as usize])).collect()
    }

    /// Rings of `sides` vertices each, joined one after the other.
    pub fn of_rings(rings: &[Vec<DVec3>]) -> Self {
        let sides = rings[0].len() as u32;
        let mut shape = Self { vertices: rings.concat(), triangles: Vec::new() };
        for ring in 0..rings.len() as u32 - 1 {
            for i in 0..sides {
                let (low, next) = (ring * sides + i, ring * sides + (i + 1) % sides);
                shape.triangles.extend([[low, next, next + sides], [low, next + sides, low + sides]]);
            }
        }
        shape
    }

    /// A fan from the ring that begins at vertex `first` to a new vertex.
    pub fn close(&mut self, first: u32, sides: u32, middle: DVec3) {
        let top = self.vertices.len() as u32;
        self.vertices.push(middle);
        self.triangles.extend((0..sides).map(|i| [first + i, first + (i + 1) % sides, top]));
    }
}

/// A closed surface of revolution: `profile` holds radius and height of each ring; the ends are closed on the axis.
pub fn turned(profile: &[(f64, f64)], sides: usize) -> Shape {
    let ring = |&(radius, height): &(f64, f64)| {
        around(sides).map(|(c, s)| DVec3::new(radius * c, radius * s, height)).collect()
    };
    let mut shape = Shape::of_rings(&profile.iter().map(ring).collect::<Vec<_>>());
    let last = ((profile.len() - 1) * sides) as u32;
    shape.close(0, sides as u32, DVec3::new(0.0, 0.0, profile[0].1));
    shape.close(last, sides as u32, DVec3::new(0.0, 0.0, profile[profile.len() - 1].1));
    shape
}

/// Directions around a circle.
pub fn around(sides: usize) -> impl Iterator<Item = (f64, f64)> {
    (0..sides).map(move |i| {
        let (s, c) = (TAU * i as f64 / sides as f64).sin_cos();
        (c, s)
    })
}

/// A bolt of at most so many triangles, and 72 at least: shank, thread, washer and a head of as many sides as all.
pub fn bolt(triangles: usize) -> Shape {
    let sides = if triangles < 200 { 6 } else { 12 };
    // Six rings, of which five are joined, and two ends take 12 triangles a side; a turn of the thread takes 4.
    let turns = (triangles / sides).saturating_sub(12) / 4;
    let (radius, length) = (0.4, 2.4);
    let mut profile = vec![(0.9 * radius, -length)];
    let step = 0.8 * length / turns.max(1) as f64;
    for turn in 0..turns {
        let at = -length + step * (turn as f64 + 0.5);
        profile.extend([(radius, at), (0.9 * radius, at + 0.5 * step)]);
    }
    let head = [(1.0, 0.0), (2.1, 0.0), (2.1, 0.3), (1.6, 0.3), (1.6, 1.5)];
    profile.extend(head.map(|(r, h)| (radius * r, radius * h)));
    turned(&profile, sides)
}

/// A ring around the axis with a round section.
pub fn ring(radius: f64, thickness: f64, sides: usize, across: usize) -> Shape {
    let rings = (0..=sides).map(|i| {
        let (s, c) = (TAU * i as f64 / sides as f64).sin_cos();
        around(across)
            .map(|(u, v)| DVec3::new(c * (radius + thickness * u), s * (radius + thickness * u), thickness * v))
            .collect()
    });
    Shape::of_rings(&rings.collect::<Vec<_>>())
}

/// An open pipe that goes up from the origin and turns by a right angle to x, `bend` away.
pub fn elbow(bend: f64, thickness: f64, along: usize, across: usize) -> Shape {
    let rings = (0..=along).map(|i| {
        let (s, c) = (0.25 * TAU * i as f64 / along as f64).sin_cos();
        let (middle, out) = (DVec3::new(bend * (1.0 - c), 0.0, bend * s), DVec3::new(-c, 0.0, s));
        around(across).map(|(u, v)| middle + thickness * (u * out + v * DVec3::Y)).collect()
    });
    Shape::of_rings(&rings.collect::<Vec<_>>())
}

/// A flat square of so many cells each way, its middle at the origin.
pub fn plate(side: f64, cells: usize) -> Shape {
    let at = |i: usize| side * (i as f64 / cells as f64 - 0.5);
    let vertices = (0..=cells).flat_map(|y| (0..=cells).map(move |x| DVec3::new(at(x), at(y), 0.0))).collect();
    let row = cells as u32 + 1;
    let cell = |y: u32, x: u32| [[0, 1, row + 1], [0, row + 1, row]].map(|t| t.map(|i| y * row + x + i));
    let triangles = (0..cells as u32).flat_map(|y| (0..cells as u32).flat_map(move |x| cell(y, x))).collect();
    Shape { vertices, triangles }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    #[test]
    fn bolts_are_closed_and_as_large_as_they_are_to_be() {
        for (wanted, got) in [(72, 72), (80, 72), (96, 96), (528, 528), (2000, 1968)] {
            let shape = bolt(wanted);
            assert_eq!(shape.triangles.len(), got, "{wanted}");
            let mut edges = HashMap::new();
            for t in &shape.triangles {
                for i in 0..3 {
                    let (a, b) = (t[i], t[(i + 1) % 3]);
                    *edges.entry((a.min(b), a.max(b))).or_insert(0) += 1;
                }
            }
            assert!(edges.values().all(|&n| n == 2), "an open edge");
        }
    }

    #[test]
    fn shapes_have_the_triangles_of_their_rings() {
        let count = |shape: Shape| {
            assert!(shape.vertices.iter().all(|v| v.is_finite()));
            shape.corners().len()
        };
        assert_eq!([count(ring(1.0, 0.2, 16, 8)), count(elbow(1.0, 0.2, 16, 8)), count(plate(2.0, 3))], [256, 256, 18]);
    }
}
