//! The five test models, and small ones by formula, as triangle lists.

use super::brute::Tri;
use super::models;
use super::rng::Rng;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// A named list of triangles in the caller's coordinates; a primitive is an index.
pub struct Soup {
    pub name: &'static str,
    pub tris: Vec<Tri>,
}

/// Scan, CAD, slivers, coplanar doubles, far from zero.
pub fn five() -> Vec<Soup> {
    vec![scan(), cad(), slivers(), doubles(), far_from_zero()]
}

/// A test for each of the five models, named after it: `on_five_models!(check)` calls `check(soup)`.
#[allow(unused_macros)]
macro_rules! on_five_models {
    ($check:ident) => {
        on_five_models!($check: scan, cad, slivers, doubles, far_from_zero);
    };
    ($check:ident: $($model:ident),*) => {
        $(
            #[test]
            fn $model() {
                $check($crate::common::scenes::$model());
            }
        )*
    };
}
#[allow(unused_imports)]
pub(crate) use on_five_models;

/// Not a point or a line once its corners are rounded to f32: what a builder keeps.
pub fn has_area(tri: &Tri) -> bool {
    (tri[1] - tri[0]).cross(tri[2] - tri[0]).length_squared() > 0.0
}

fn model_or(name: &'static str, file: &str, fallback: impl FnOnce() -> Vec<Tri>) -> Soup {
    let tris = match models::find(file) {
        Some(path) => models::read(&path),
        None => fallback(),
    };
    Soup { name, tris: tris.into_iter().filter(has_area).collect() }
}

/// The Stanford bunny.
pub fn scan() -> Soup {
    model_or("scan", "scans/bun_zipper.ply", || bumpy_sphere(186, 186, 1))
}

/// A machined part.
pub fn cad() -> Soup {
    model_or("cad", "cad/counter.unitsmm.stl", || boxes(6000, 2))
}

/// Half of its triangles are a thousand times longer than wide.
pub fn slivers() -> Soup {
    model_or("slivers", "hostile/thingi_1514499_slivers.stl", || stretched(1000.0))
}

/// A closed bumpy ball, so many times longer than wide, and so are its triangles.
pub fn stretched(times: f64) -> Vec<Tri> {
    let stretch = DVec3::new(times, 1.0, 1.0);
    bumpy_sphere(100, 130, 3).into_iter().map(|t| t.map(|v| rounded(v * stretch))).collect()
}

/// Blocks on an integer grid (coplanar faces, edges met by corners, faces twice) and a chair with every face twice.
pub fn doubles() -> Soup {
    let mut tris = blocks(40, 4);
    if let Some(path) = models::find("hostile/chair_dup_faces.obj") {
        let at = DVec3::new(20.0, 20.0, 20.0);
        tris.extend(models::read(&path).into_iter().map(|t| t.map(|v| rounded(v * 8.0 + at))));
    }
    tris.retain(has_area);
    Soup { name: "doubles", tris }
}

/// The scan, 10^7 units from zero in every coordinate.
pub fn far_from_zero() -> Soup {
    let shift = DVec3::new(1e7, -1e7, 1e7);
    let tris = scan().tris.into_iter().map(|t| t.map(|v| v + shift)).collect();
    Soup { name: "far", tris }
}

/// The nearest f32 values.
pub fn rounded(v: DVec3) -> DVec3 {
    v.as_vec3().as_dvec3()
}

/// A closed mesh over the sphere's angles: `radius(theta, phi)` around zero, poles on z, f32 corners.
pub fn polar(rings: usize, segments: usize, radius: impl Fn(f64, f64) -> f64) -> Vec<Tri> {
    let at = |i: usize, j: usize| {
        let theta = PI * i as f64 / rings as f64;
        let phi = TAU * (j % segments) as f64 / segments as f64;
        let pole = i == 0 || i == rings;
        let (st, ct) = if pole { (0.0, if i == 0 { 1.0 } else { -1.0 }) } else { theta.sin_cos() };
        let r = radius(theta, if pole { 0.0 } else { phi });
        rounded(DVec3::new(st * phi.cos(), st * phi.sin(), ct) * r)
    };
    let mut tris = Vec::with_capacity(rings * segments * 2);
    for i in 0..rings {
        for j in 0..segments {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            tris.extend([[a, b, c], [a, c, d]].into_iter().filter(has_area));
        }
    }
    tris
}

/// A unit sphere, closed.
pub fn sphere(rings: usize, segments: usize) -> Vec<Tri> {
    polar(rings, segments, |_, _| 1.0)
}

/// A sphere with bumps by seed: stands in for a scan.
pub fn bumpy_sphere(rings: usize, segments: usize, seed: u64) -> Vec<Tri> {
    let mut rng = Rng::new(seed);
    let waves: Vec<(f64, f64, f64)> =
        (1..24).map(|k| (f64::from(k), rng.between(0.0, TAU), rng.between(-0.15, 0.15) / f64::from(k))).collect();
    polar(rings, segments, |theta, phi| {
        1.0 + waves.iter().map(|(k, p, a)| a * (k * theta + p).sin() * (k.floor() * phi).cos()).sum::<f64>()
    })
}

/// The twelve triangles of a box.
pub fn cuboid(min: DVec3, max: DVec3) -> Vec<Tri> {
    let p = |i: usize| {
        let pick = |bit: usize, k: usize| if i >> bit & 1 == 0 { min[k] } else { max[k] };
        DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2))
    };
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    quads.iter().flat_map(|q| [[p(q[0]), p(q[1]), p(q[2])], [p(q[0]), p(q[2]), p(q[3])]]).collect()
}

/// Random boxes: stands in for CAD.
pub fn boxes(count: usize, seed: u64) -> Vec<Tri> {
    let mut rng = Rng::new(seed);
    (0..count)
        .flat_map(|_| {
            let at = rng.inside(DVec3::splat(-100.0), DVec3::splat(100.0));
            let size = DVec3::new(rng.unit(), rng.unit(), rng.unit()) * 10.0;
            cuboid(rounded(at), rounded(at + size))
        })
        .collect()
}

/// Unit cubes on an integer grid of `side` cells a side, about a sixth of them full, with all their faces: faces that
/// touch are there twice, all coordinates are small integers. A few large quads span many cells in the same planes.
pub fn blocks(side: usize, seed: u64) -> Vec<Tri> {
    let mut rng = Rng::new(seed);
    let mut tris = Vec::new();
    let hill: Vec<usize> = (0..side * side).map(|_| rng.below(8)).collect();
    for (i, &h) in hill.iter().enumerate() {
        let at = DVec3::new((i % side) as f64, (i / side) as f64, h as f64);
        tris.extend(cuboid(at, at + 1.0));
    }
    for _ in 0..side {
        let at = DVec3::new(rng.below(side) as f64, rng.below(side) as f64, rng.below(8) as f64);
        let size = DVec3::new(1.0 + rng.below(9) as f64, 1.0 + rng.below(9) as f64, 0.0);
        tris.extend(cuboid(at, at + size).into_iter().filter(has_area));
    }
    tris
}

/// A square of `n` by `n` cells in the plane z = `z`, integer coordinates.
pub fn plane_grid(n: usize, z: f64) -> Vec<Tri> {
    let at = |i: usize, j: usize| DVec3::new(i as f64, j as f64, z);
    (0..n * n)
        .flat_map(|k| {
            let (i, j) = (k % n, k / n);
            [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
        })
        .collect()
}

/// A forest of `wires` thin closed tubes on a round clearing of radius 10, each bent in `segments` pieces, from 2 to 6
/// high and 4 to 12 thousandths thick: at every distance from which the whole is seen they are thinner than a pixel.
pub fn wire_forest(wires: usize, segments: usize, seed: u64) -> Vec<Tri> {
    self::wires(wires, segments, seed).flatten().collect()
}

/// The wires of [`wire_forest`], one by one.
pub fn wires(count: usize, segments: usize, seed: u64) -> impl Iterator<Item = Vec<Tri>> {
    let mut rng = Rng::new(seed);
    (0..count).map(move |_| wire(&mut rng, segments))
}

/// A tube of five sides along a bent line, pointed at both ends.
fn wire(rng: &mut Rng, segments: usize) -> Vec<Tri> {
    const SIDES: usize = 5;
    let (way, far) = (rng.between(0.0, TAU), 10.0 * rng.unit().sqrt());
    let (height, radius) = (rng.between(2.0, 6.0), rng.between(0.002, 0.006));
    let (toward, bend, sway) = (rng.between(0.0, TAU), rng.between(0.0, 0.3), rng.between(0.0, 0.1));
    let line = |i: usize| {
        let s = i as f64 / segments as f64;
        let aside = height * (bend * s * s + sway * (3.0 * PI * s).sin());
        DVec3::new(far * way.cos() + aside * toward.cos(), far * way.sin() + aside * toward.sin(), height * s)
    };
    let at = |i: usize, j: usize| {
        let thick = if i == 0 || i == segments { 0.0 } else { radius };
        let angle = TAU * (j % SIDES) as f64 / SIDES as f64;
        rounded(line(i) + DVec3::new(angle.cos(), angle.sin(), 0.0) * thick)
    };
    let cells = (0..segments).flat_map(|i| (0..SIDES).map(move |j| (i, j)));
    let quads = cells.map(|(i, j)| [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
    quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).filter(has_area).collect()
}
