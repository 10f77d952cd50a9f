//! Basic shapes as triangles without connectivity.

use super::super::rng::Rng;
use glam::{DAffine3, DVec2, DVec3};

/// Largest displacement of each coordinate of each corner, in metres.
const JITTER: f64 = 0.000_15;

/// A point of a path with two unit vectors that are perpendicular to the path and to each other.
#[derive(Debug, Clone, Copy)]
pub struct Station {
    /// The point.
    pub at: DVec3,
    /// First vector across the path.
    pub u: DVec3,
    /// Second vector across the path.
    pub v: DVec3,
}

/// A collector of triangles that transforms them to the world and jitters each corner independently.
pub struct Soup<'a> {
    /// Random numbers for the jitter and for the makers of shapes.
    pub rng: Rng,
    world: &'a DAffine3,
    out: &'a mut Vec<[[f32; 3]; 3]>,
}

impl<'a> Soup<'a> {
    /// Creates a collector that adds to `out`, with the transform `world` and the random stream `rng`.
    pub fn new(rng: Rng, world: &'a DAffine3, out: &'a mut Vec<[[f32; 3]; 3]>) -> Self {
        Self { rng, world, out }
    }

    /// Adds a triangle.
    pub fn triangle(&mut self, a: DVec3, b: DVec3, c: DVec3) {
        let corners = [a, b, c].map(|p| {
            let mut j = || (self.rng.unit() * 2.0 - 1.0) * JITTER;
            let p = p + DVec3::new(j(), j(), j());
            self.world.transform_point3(p).as_vec3().to_array()
        });
        self.out.push(corners);
    }

    /// Adds two triangles; the corners are in order around the quadrilateral.
    pub fn quad(&mut self, a: DVec3, b: DVec3, c: DVec3, d: DVec3) {
        self.triangle(a, b, c);
        self.triangle(a, c, d);
    }

    /// Adds `2 · nu · nv` triangles over the image of the unit square.
    pub fn patch(&mut self, nu: u64, nv: u64, f: &dyn Fn(f64, f64) -> DVec3) {
        let at = |i: u64, j: u64| f(i as f64 / nu as f64, j as f64 / nv as f64);
        for i in 0..nu {
            for j in 0..nv {
                self.quad(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            }
        }
    }

    /// Sweeps a profile along a path: two triangles for each side of the profile between each two stations. `closed`
    /// joins the last point to the first.
    pub fn sweep(&mut self, path: &[Station], profile: &[DVec2], closed: bool) {
        let at = |s: &Station, p: DVec2| s.at + s.u * p.x + s.v * p.y;
        for pair in path.windows(2) {
            for i in 0..sides(profile, closed) as usize {
                let (p, q) = (profile[i], profile[(i + 1) % profile.len()]);
                self.quad(at(&pair[0], p), at(&pair[0], q), at(&pair[1], q), at(&pair[1], p));
            }
        }
    }

    /// Adds a tube with `sides` sides around a path of points.
    pub fn tube(&mut self, path: &[DVec3], radius: f64, sides: u64) {
        let turn = self.rng.range(0.0, std::f64::consts::TAU);
        let ring: Vec<DVec2> = (0..sides)
            .map(|i| DVec2::from_angle(turn + std::f64::consts::TAU * i as f64 / sides as f64) * radius)
            .collect();
        self.sweep(&stations(path), &ring, true);
    }

    /// Adds a box of 12 triangles; `half` holds its three half edges.
    pub fn cuboid(&mut self, center: DVec3, half: [DVec3; 3]) {
        let [x, y, z] = half;
        for (n, a, b) in [(x, y, z), (y, z, x), (z, x, y)] {
            for s in [1.0, -1.0] {
                let (c, a) = (center + n * s, a * s);
                self.quad(c - a - b, c + a - b, c + a + b, c - a + b);
            }
        }
    }

    /// Adds a fastener: hexagonal head, washer and shank of `sides` sides, with [`bolt_triangles`] triangles, most of
    /// them slivers. `axis` is a unit vector that points out of the material.
    pub fn bolt(&mut self, foot: DVec3, axis: DVec3, radius: f64, length: f64, sides: u64) {
        let (u, v) = axis.any_orthonormal_pair();
        let spin = self.rng.range(0.0, 1.0);
        let ring = |n: u64, r: f64, h: f64| -> Vec<DVec3> {
            (0..n)
                .map(|i| {
                    let (s, c) = (spin + std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
                    foot + (u * c + v * s) * r + axis * h
                })
                .collect()
        };
        let (head, washer, shank) = (radius * 1.6, radius * 2.1, radius);
        let mut wall = |low: &[DVec3], high: &[DVec3]| {
            for i in 0..low.len() {
                let j = (i + 1) % low.len();
                self.quad(low[i], low[j], high[j], high[i]);
            }
        };
        wall(&ring(6, head, radius * 0.3), &ring(6, head, radius * 1.5));
        wall(&ring(sides, washer, 0.0), &ring(sides, washer, radius * 0.3));
        wall(&ring(sides, shank, -length), &ring(sides, shank, 0.0));
        for cap in [ring(6, head, radius * 1.5), ring(sides, washer, radius * 0.3), ring(sides, shank, -length)] {
            for i in 1..cap.len() - 1 {
                self.triangle(cap[0], cap[i], cap[i + 1]);
            }
        }
    }
}

/// Returns the number of triangles of a [`Soup::bolt`].
pub fn bolt_triangles(sides: u64) -> u64 {
    12 + 4 * sides + 4 + 2 * (sides - 2)
}

/// Returns the number of sides of a profile.
pub fn sides(profile: &[DVec2], closed: bool) -> u64 {
    profile.len() as u64 - u64::from(!closed)
}

/// Returns stations along a path of points, with minimal rotation about the path.
pub fn stations(path: &[DVec3]) -> Vec<Station> {
    let mut u = DVec3::ZERO;
    (0..path.len())
        .map(|i| {
            let along = path[(i + 1).min(path.len() - 1)] - path[i.saturating_sub(1)];
            let along = along.normalize_or(DVec3::X);
            let across = u - along * u.dot(along);
            u = if across.length_squared() > 1e-6 { across.normalize() } else { along.any_orthonormal_vector() };
            Station { at: path[i], u, v: along.cross(u) }
        })
        .collect()
}
