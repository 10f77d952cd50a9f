//! Generated cages.

use super::super::{Cage, CageDesc};
use glam::DVec3;

/// Random numbers: SplitMix64 (Steele, Lea, Flood, OOPSLA 2014).
pub struct Rng(pub u64);

impl Rng {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, n: u32) -> u32 {
        (self.bits() % u64::from(n)) as u32
    }

    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }
}

/// Owned arrays of a cage.
#[derive(Debug, Clone, Default)]
pub struct Shape {
    pub sizes: Vec<u32>,
    pub indices: Vec<u32>,
    pub points: Vec<DVec3>,
    pub creases: Vec<(u32, u32, f32)>,
    pub corners: Vec<(u32, f32)>,
}

impl Shape {
    pub fn desc(&self) -> CageDesc<'_> {
        let (face_sizes, indices) = (self.sizes.as_slice(), self.indices.as_slice());
        CageDesc { face_sizes, indices, creases: &self.creases, corners: &self.corners, ..CageDesc::default() }
    }

    pub fn cage(&self) -> Cage {
        Cage::new(&self.desc(), self.points.len()).unwrap()
    }

    fn add(&mut self, face: &[u32]) {
        self.sizes.push(face.len() as u32);
        self.indices.extend_from_slice(face);
    }
}

/// A grid of n × n quads with random points.
pub fn grid(n: u32, rng: &mut Rng) -> Shape {
    let points = (0..(n + 1) * (n + 1)).map(|_| rng.vector()).collect();
    let mut shape = Shape { points, ..Shape::default() };
    for j in 0..n {
        for i in 0..n {
            let first = j * (n + 1) + i;
            shape.add(&[first, first + 1, first + n + 2, first + n + 1]);
        }
    }
    shape
}

/// A vertex, number 0, with n quads around it, each with edges 1 + 2 i to 3 + 2 i, and `rings` − 1 rings of quads.
pub fn fan(n: u32, rings: u32, rng: &mut Rng) -> Shape {
    let mut shape = Shape { points: vec![DVec3::Z * 0.4], ..Shape::default() };
    for ring in 1..=rings {
        for i in 0..2 * n {
            let (sin, cos) = (f64::from(i) * std::f64::consts::PI / f64::from(n)).sin_cos();
            shape.points.push(DVec3::new(cos, sin, 0.0) * f64::from(ring) + rng.vector() * 0.1);
        }
    }
    let at = |ring: u32, i: u32| 1 + ring * 2 * n + i % (2 * n);
    (0..n).for_each(|i| shape.add(&[0, at(0, 2 * i), at(0, 2 * i + 1), at(0, 2 * i + 2)]));
    for ring in 0..rings - 1 {
        (0..2 * n).for_each(|i| shape.add(&[at(ring, i), at(ring + 1, i), at(ring + 1, i + 1), at(ring, i + 1)]));
    }
    shape
}

/// Random faces on few vertices: often with shared, repeated and turned edges, with random sharpness.
pub fn tangle(rng: &mut Rng) -> Shape {
    let vertices = 4 + rng.below(12);
    let mut shape = Shape { points: (0..vertices).map(|_| rng.vector()).collect(), ..Shape::default() };
    for _ in 0..1 + rng.below(14) {
        let mut left: Vec<u32> = (0..vertices).collect();
        let size = (3 + rng.below(4)).min(vertices);
        let mut face: Vec<u32> = (0..size).map(|_| left.swap_remove(rng.below(left.len() as u32) as usize)).collect();
        if rng.below(12) == 0 {
            face[rng.below(size) as usize] = face[0];
        }
        shape.add(&face);
        if rng.below(2) == 0 {
            shape.creases.push((face[0], face[1], [0.3, 1.0, 2.5, 10.0, f32::INFINITY][rng.below(5) as usize]));
        }
        if rng.below(4) == 0 {
            shape.corners.push((face[2], [0.5, 3.5, 10.0][rng.below(3) as usize]));
        }
    }
    shape
}
