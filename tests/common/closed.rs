//! Closed models on an integer grid, and their crossings with rays in integers: exact, also at edges and corners.

use super::brute::Tri;
use super::built;
use super::rng::Rng;
use super::stored;
use glam::{DVec3, Vec3};
use outcrop::base::progress::Cancel;
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::math::Ray;
use outcrop::query::Side;
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

/// Length of a step of the grid: vertices have whole numbers of steps.
pub const STEP: f64 = 1.0 / 64.0;

/// Greatest coordinate of vertices, and of the origins of rays, in steps. The integers of [`Closed::crossings`] do not
/// overflow, and the products of edge functions need more digits than double precision has.
const REACH: i64 = 512;
const FAR: i64 = 2048;

type Point = [i64; 3];

/// A model of one part or several.
pub struct Closed {
    pub name: &'static str,
    pub points: Vec<Point>,
    /// Corners of each triangle, and its part.
    pub faces: Vec<([u32; 3], u32)>,
    index: HashMap<Point, u32>,
}

/// A crossing in integers: the triangle, its side, and the distance as a fraction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exact {
    pub face: u32,
    pub side: Side,
    pub t: (i128, i128),
}

/// A ray in steps.
#[derive(Debug, Clone, Copy)]
pub struct GridRay {
    pub origin: Point,
    pub dir: Point,
}

impl GridRay {
    /// The ray in units.
    pub fn ray(&self) -> Ray {
        Ray::new(
            DVec3::from(self.origin.map(|x| x as f64)) * STEP,
            Vec3::from(self.dir.map(|x| x as f32)) * STEP as f32,
        )
    }
}

impl Closed {
    pub fn new(name: &'static str) -> Self {
        Self { name, points: Vec::new(), faces: Vec::new(), index: HashMap::new() }
    }

    fn point(&mut self, p: Point) -> u32 {
        assert!(p.iter().all(|x| x.abs() <= REACH), "{p:?}");
        *self.index.entry(p).or_insert_with(|| {
            self.points.push(p);
            self.points.len() as u32 - 1
        })
    }

    /// Adds a triangle, also one without area.
    pub fn triangle(&mut self, corners: [Point; 3], part: u32) {
        let corners = corners.map(|p| self.point(p));
        self.faces.push((corners, part));
    }

    /// The corners of a triangle in units.
    pub fn corners(&self, face: usize) -> Tri {
        self.faces[face].0.map(|i| DVec3::from(self.points[i as usize].map(|x| x as f64)) * STEP)
    }

    /// The triangles of a part, and their indices.
    pub fn part(&self, part: u32) -> Vec<Tri> {
        (0..self.faces.len()).filter(|&i| self.faces[i].1 == part).map(|i| self.corners(i)).collect()
    }

    /// Number of parts.
    pub fn parts(&self) -> u32 {
        self.faces.iter().map(|face| face.1 + 1).max().unwrap_or(0)
    }

    /// All crossings with the ray from its origin on, in any order. `projected` is scratch memory.
    pub fn crossings(&self, ray: &GridRay, projected: &mut Vec<[i64; 3]>) -> Vec<Exact> {
        let d = ray.dir;
        let size = d.map(i64::abs);
        let z = if size[0] >= size[1] && size[0] >= size[2] {
            0
        } else if size[1] >= size[2] {
            1
        } else {
            2
        };
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        projected.clear();
        projected.extend(self.points.iter().map(|p| {
            let p: Point = std::array::from_fn(|i| p[i] - ray.origin[i]);
            [p[x] * d[z] - d[x] * p[z], p[y] * d[z] - d[y] * p[z], p[z]]
        }));
        let mut found = Vec::new();
        for (face, (corners, _)) in self.faces.iter().enumerate() {
            let [a, b, c] = corners.map(|i| projected[i as usize]);
            let signs = [is_left(a, b), is_left(b, c), is_left(c, a)];
            let Some(left) = signs[0].filter(|_| signs[1] == signs[0] && signs[2] == signs[0]) else { continue };
            let wide =
                |p: [i64; 3], q: [i64; 3]| i128::from(p[0]) * i128::from(q[1]) - i128::from(p[1]) * i128::from(q[0]);
            let (u, v, w) = (wide(b, c), wide(c, a), wide(a, b));
            let sum = u + v + w;
            let t = u * i128::from(a[2]) + v * i128::from(b[2]) + w * i128::from(c[2]);
            // A positive denominator.
            let (t, under) = (t * sum.signum() * i128::from(d[z].signum()), sum.abs() * i128::from(d[z].abs()));
            if t >= 0 {
                let side = if left == (d[z] < 0) { Side::Front } else { Side::Back };
                found.push(Exact { face: face as u32, side, t: (t, under) });
            }
        }
        found
    }

    /// A ray from the grid: along axes and diagonals, through corners, edges and anywhere.
    pub fn ray(&self, rng: &mut Rng) -> GridRay {
        let pick = |rng: &mut Rng| self.points[rng.below(self.points.len())];
        let some = |rng: &mut Rng, reach: i64| rng.below(2 * reach as usize + 1) as i64 - reach;
        let target = match rng.below(4) {
            0 => {
                let (corners, _) = self.faces[rng.below(self.faces.len())];
                let (a, b) = (self.points[corners[0] as usize], self.points[corners[1] as usize]);
                std::array::from_fn(|i| (a[i] + b[i]) / 2)
            }
            1 => std::array::from_fn(|_| some(rng, REACH)),
            _ => pick(rng),
        };
        let dir: Point = match rng.below(4) {
            0 => {
                let mut dir = [0; 3];
                dir[rng.below(3)] = if rng.one_in(2) { 1 } else { -1 };
                dir
            }
            1 => std::array::from_fn(|_| some(rng, 1)),
            2 => {
                let other = pick(rng);
                std::array::from_fn(|i| other[i] - target[i])
            }
            _ => std::array::from_fn(|_| some(rng, REACH)),
        };
        if dir == [0; 3] {
            return self.ray(rng);
        }
        let greatest = dir.iter().map(|x| x.abs()).max().unwrap_or(1);
        let back = (rng.below(FAR as usize) as i64 / greatest).max(1);
        GridRay { origin: std::array::from_fn(|i| target[i] - dir[i] * back), dir }
    }
}

/// True if (e, e²) is on the left of the line from `p` to `q`.
fn is_left(p: [i64; 3], q: [i64; 3]) -> Option<bool> {
    let first = p[0] * q[1] - p[1] * q[0];
    [first, p[1] - q[1], q[0] - p[0]].into_iter().find(|x| *x != 0).map(|x| x > 0)
}

/// The surface of a grid of `wide` by `high` points that `at` places; the last row or column may be the first again.
fn sheet(out: &mut Closed, part: u32, [wide, high]: [usize; 2], at: impl Fn(f64, f64) -> Point) {
    let at = |i: usize, j: usize| at(i as f64 / wide as f64, j as f64 / high as f64);
    for (i, j) in (0..wide).flat_map(|i| (0..high).map(move |j| (i, j))) {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        out.triangle([a, b, c], part);
        out.triangle([a, c, d], part);
    }
}

fn rounded(p: DVec3) -> Point {
    p.to_array().map(|x| x.round() as i64)
}

/// A box with `parts` divisions of each edge.
fn add_box(out: &mut Closed, part: u32, min: Point, max: Point, divisions: i64) {
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (level, turn) in [(min[axis], true), (max[axis], false)] {
            let at = |i: i64, j: i64| {
                let mut p = min;
                p[axis] = level;
                p[u] = min[u] + (max[u] - min[u]) * i / divisions;
                p[v] = min[v] + (max[v] - min[v]) * j / divisions;
                p
            };
            for (i, j) in (0..divisions).flat_map(|i| (0..divisions).map(move |j| (i, j))) {
                let quad = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                let quad = if turn { [quad[0], quad[3], quad[2], quad[1]] } else { quad };
                out.triangle([quad[0], quad[1], quad[2]], part);
                out.triangle([quad[0], quad[2], quad[3]], part);
            }
        }
    }
}

/// Twelve closed models.
pub fn twelve() -> Vec<Closed> {
    let named = |name, fill: &dyn Fn(&mut Closed)| {
        let mut out = Closed::new(name);
        fill(&mut out);
        out
    };
    let ball = |out: &mut Closed, part: u32, radius: f64, at: DVec3, count: usize| {
        sheet(out, part, [2 * count, count], |u, v| {
            // Exact at the seam and at the poles.
            let (u, v) = (u % 1.0 * TAU, v * PI);
            rounded(at + DVec3::new(v.sin() * u.cos(), v.sin() * u.sin(), -v.cos()) * radius)
        });
    };
    vec![
        named("tetrahedron", &|out| {
            let p = [[-256, -256, -256], [256, 256, -256], [256, -256, 256], [-256, 256, 256]];
            for [a, b, c] in [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]] {
                out.triangle([p[a], p[b], p[c]], 0);
            }
        }),
        named("box", &|out| add_box(out, 0, [-256; 3], [256; 3], 1)),
        named("divided box", &|out| add_box(out, 0, [-256; 3], [256; 3], 8)),
        named("sphere", &|out| ball(out, 0, 500.0, DVec3::ZERO, 16)),
        named("torus", &|out| {
            sheet(out, 0, [24, 12], |u, v| {
                let (u, v) = (u % 1.0 * TAU, v % 1.0 * TAU);
                let ring = 320.0 + 128.0 * v.cos();
                rounded(DVec3::new(ring * u.cos(), ring * u.sin(), 128.0 * v.sin()))
            });
        }),
        named("cylinder", &|out| {
            let at = |i: i64, z: i64| {
                let turn = (i % 32) as f64 / 32.0 * TAU;
                [(256.0 * turn.cos()).round() as i64, (256.0 * turn.sin()).round() as i64, z]
            };
            for i in 0..32 {
                let [a, b, c, d] = [at(i, -384), at(i + 1, -384), at(i + 1, 384), at(i, 384)];
                out.triangle([a, b, c], 0);
                out.triangle([a, c, d], 0);
                out.triangle([[0, 0, -384], b, a], 0);
                out.triangle([[0, 0, 384], d, c], 0);
            }
        }),
        named("nested boxes", &|out| {
            for (part, size) in [(0, 256), (1, 128), (2, 64)] {
                add_box(out, part, [-size; 3], [size; 3], 2);
            }
        }),
        named("coincident boxes", &|out| {
            for part in 0..2 {
                add_box(out, part, [-128; 3], [256; 3], 3);
            }
        }),
        named("touching boxes", &|out| {
            // They share a face, an edge, and a corner.
            add_box(out, 0, [-256, -256, -256], [0, 0, 0], 2);
            add_box(out, 1, [0, -256, -256], [256, 0, 0], 2);
            add_box(out, 2, [0, 0, -256], [256, 256, 0], 2);
            add_box(out, 2, [-256, 0, 0], [0, 256, 256], 2);
        }),
        named("mandelbulb", &mandelbulb),
        named("spheres through each other", &|out| {
            for part in 0..3 {
                ball(out, part, 200.0, DVec3::X * (f64::from(part) * 150.0 - 150.0), 10);
            }
        }),
        named("bottle of Klein", &|out| {
            // Closed, but without an inside: it goes through itself.
            sheet(out, 0, [32, 16], |u, v| {
                let half = u * TAU;
                // One turn of the ring turns the figure of eight by half.
                let (eight, turned) = (v % 1.0 * TAU, half / 2.0);
                let eight = if u >= 1.0 { (1.0 - v) % 1.0 * TAU } else { eight };
                let (half, turned) = if u >= 1.0 { (0.0, 0.0) } else { (half, turned) };
                let ring = 280.0 + 160.0 * (turned.cos() * eight.sin() - turned.sin() * (2.0 * eight).sin() / 2.0);
                let z = 160.0 * (turned.sin() * eight.sin() + turned.cos() * (2.0 * eight).sin() / 2.0);
                rounded(DVec3::new(ring * half.cos(), ring * half.sin(), z))
            });
        }),
    ]
}

/// The generated surface, moved to the grid: some of its triangles lose their area.
fn mandelbulb(out: &mut Closed) {
    let options = GenerateOptions { triangles: 2000, seed: 0, ..Default::default() };
    let file = built::build(|to| {
        generate("mandelbulb", &options, &Cancel::new(), to).expect("triangles");
    });
    for tri in stored::trees(&file.path)[0].corners() {
        out.triangle(tri.map(|p| rounded(p * 300.0)), 0);
    }
}
