//! Seeded rays of every kind that a tracer may stumble over.
//!
//! Rays are made in single precision in the frame of the triangles (f32 corners in f64 variables), so that the
//! code under test and the oracle see the very same ray.

use super::brute::{Ray64, Tri};
use super::rng::Rng;
use glam::{DVec3, Vec3};
use outcrop::math::Cone;

/// How a ray was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RayKind {
    /// From a sphere around the bounds to a point inside them; any length of direction.
    Sphere,
    /// From a point inside the bounds, anywhere.
    Inside,
    /// Along an axis, either sign, the other components 0 or -0.
    Axis,
    /// In an axis-parallel plane through a corner: faces of bounding boxes, planes a builder splits at.
    Plane,
    /// Through a corner, or the middle of an edge.
    Feature,
    /// Along an edge.
    AlongEdge,
    /// From a point on a triangle; `t_min` 0 or tiny.
    Surface,
    /// A pinhole camera's: neighbours are alike.
    Grid,
    /// With denormal or nearly zero components.
    Tiny,
    /// With both ends of the range near things.
    Segment,
}

impl RayKind {
    pub const ALL: [RayKind; 10] = [
        RayKind::Sphere,
        RayKind::Inside,
        RayKind::Axis,
        RayKind::Plane,
        RayKind::Feature,
        RayKind::AlongEdge,
        RayKind::Surface,
        RayKind::Grid,
        RayKind::Tiny,
        RayKind::Segment,
    ];

    /// Its name, for summaries.
    pub fn name(self) -> &'static str {
        match self {
            RayKind::Sphere => "sphere",
            RayKind::Inside => "inside",
            RayKind::Axis => "axis",
            RayKind::Plane => "plane",
            RayKind::Feature => "feature",
            RayKind::AlongEdge => "along-edge",
            RayKind::Surface => "surface",
            RayKind::Grid => "grid",
            RayKind::Tiny => "tiny",
            RayKind::Segment => "segment",
        }
    }
}

/// A ray in single precision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray32 {
    pub kind: RayKind,
    pub org: Vec3,
    pub dir: Vec3,
    pub t_min: f32,
    pub t_max: f32,
    /// See [`outcrop::structure::LocalRay::cone`].
    pub cone: Cone,
}

impl Ray32 {
    fn new(kind: RayKind, org: DVec3, dir: DVec3) -> Self {
        let mut dir = dir.as_vec3();
        if dir == Vec3::ZERO || !dir.is_finite() {
            dir = Vec3::X;
        }
        Self { kind, org: org.as_vec3(), dir, t_min: 0.0, t_max: f32::INFINITY, cone: Cone::ZERO }
    }

    /// The same ray in double precision, exactly.
    pub fn wide(&self) -> Ray64 {
        Ray64 {
            org: self.org.as_dvec3(),
            dir: self.dir.as_dvec3(),
            t_min: f64::from(self.t_min),
            t_max: f64::from(self.t_max),
        }
    }
}

/// Makes rays for a set of triangles.
pub struct RayMaker<'a> {
    tris: &'a [Tri],
    min: DVec3,
    max: DVec3,
    rng: Rng,
    pixel: usize,
}

impl<'a> RayMaker<'a> {
    /// Rays for `tris` (not empty, finite), all from `seed`.
    pub fn new(tris: &'a [Tri], seed: u64) -> Self {
        let (min, max) =
            tris.iter().flatten().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
        Self { tris, min, max, rng: Rng::new(seed), pixel: 0 }
    }

    /// The next ray of every kind in turn.
    pub fn batch(&mut self, count: usize) -> Vec<Ray32> {
        (0..count).map(|i| self.make(RayKind::ALL[i % RayKind::ALL.len()])).collect()
    }

    /// One ray of a kind.
    pub fn make(&mut self, kind: RayKind) -> Ray32 {
        match kind {
            RayKind::Sphere => self.sphere(),
            RayKind::Inside => {
                let (org, dir) = (self.point(), self.rng.direction());
                Ray32::new(kind, org, dir)
            }
            RayKind::Axis => self.axis(),
            RayKind::Plane => self.plane(),
            RayKind::Feature => self.feature(),
            RayKind::AlongEdge => self.along_edge(),
            RayKind::Surface => self.surface(),
            RayKind::Grid => self.grid(),
            RayKind::Tiny => self.tiny(),
            RayKind::Segment => self.segment(),
        }
    }

    fn radius(&self) -> f64 {
        (self.max - self.min).length() * 0.5
    }

    fn outside(&mut self) -> DVec3 {
        let far = if self.rng.one_in(8) { self.rng.between(1.0, 50.0) } else { 1.5 };
        (self.min + self.max) * 0.5 + self.rng.direction() * self.radius() * far
    }

    fn point(&mut self) -> DVec3 {
        self.rng.inside(self.min, self.max)
    }

    fn tri(&mut self) -> Tri {
        let i = self.rng.below(self.tris.len());
        self.tris[i]
    }

    fn corner(&mut self) -> DVec3 {
        let i = self.rng.below(3);
        self.tri()[i]
    }

    fn zero(&mut self) -> f64 {
        if self.rng.one_in(2) { 0.0 } else { -0.0 }
    }

    fn sphere(&mut self) -> Ray32 {
        let (from, to) = (self.outside(), self.point());
        let length = if self.rng.one_in(2) { 1.0 } else { (self.rng.between(-20.0, 20.0)).exp2() };
        let from = from.as_vec3().as_dvec3();
        Ray32::new(RayKind::Sphere, from, (to - from).normalize_or(DVec3::X) * length)
    }

    fn axis(&mut self) -> Ray32 {
        let k = self.rng.below(3);
        let mut dir = DVec3::new(self.zero(), self.zero(), self.zero());
        let sign = if self.rng.one_in(2) { 1.0 } else { -1.0 };
        dir[k] = sign;
        // Through a corner's coordinates often: then the ray runs in faces and along edges of boxes.
        let mut org = if self.rng.one_in(2) { self.corner() } else { self.point() };
        org[k] = match self.rng.below(4) {
            0 => self.point()[k],
            1 => org[k],
            _ if sign > 0.0 => self.min[k] - self.radius(),
            _ => self.max[k] + self.radius(),
        };
        Ray32::new(RayKind::Axis, org, dir)
    }

    fn plane(&mut self) -> Ray32 {
        let k = self.rng.below(3);
        let at = match self.rng.below(8) {
            0 => self.min[k],
            1 => self.max[k],
            2 => ((self.min[k] + self.max[k]) * 0.5) as f32 as f64,
            _ => self.corner()[k],
        };
        let (mut org, mut to) = (self.outside(), if self.rng.one_in(2) { self.corner() } else { self.point() });
        (org[k], to[k]) = (at, at);
        let org = org.as_vec3().as_dvec3();
        let mut dir = (to - org).normalize_or(DVec3::Y);
        dir[k] = self.zero();
        Ray32::new(RayKind::Plane, org, dir)
    }

    fn feature(&mut self) -> Ray32 {
        let tri = self.tri();
        let target = if self.rng.one_in(2) { tri[0] } else { (tri[0] + tri[1]) * 0.5 };
        let org = if self.rng.one_in(3) { self.point() } else { self.outside() };
        let org = org.as_vec3().as_dvec3();
        // Not normalised: the rounded direction then often meets a corner exactly.
        Ray32::new(RayKind::Feature, org, target - org)
    }

    fn along_edge(&mut self) -> Ray32 {
        let tri = self.tri();
        let i = self.rng.below(3);
        let (a, b) = (tri[i], tri[(i + 1) % 3]);
        let back = if self.rng.one_in(2) { self.rng.between(0.0, 10.0).floor() } else { 0.0 };
        Ray32::new(RayKind::AlongEdge, a - (b - a) * back, b - a)
    }

    fn surface(&mut self) -> Ray32 {
        let tri = self.tri();
        let (mut u, mut v) = (self.rng.unit(), self.rng.unit());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let at = match self.rng.below(4) {
            0 => tri[0],
            1 => (tri[0] + tri[1]) * 0.5,
            _ => tri[0] + (tri[1] - tri[0]) * u + (tri[2] - tri[0]) * v,
        };
        let dir = self.rng.direction();
        let mut ray = Ray32::new(RayKind::Surface, at, dir);
        ray.t_min = match self.rng.below(3) {
            0 => 0.0,
            1 => f32::MIN_POSITIVE,
            _ => (self.radius() * 1e-6) as f32,
        };
        ray
    }

    fn grid(&mut self) -> Ray32 {
        const SIDE: usize = 64;
        let (i, j) = (self.pixel % SIDE, self.pixel / SIDE % SIDE);
        self.pixel += 1;
        let side = 1.0 / SIDE as f64;
        let (x, y) = ((i as f64 + 0.5) * side * 2.0 - 1.0, (j as f64 + 0.5) * side * 2.0 - 1.0);
        let center = (self.min + self.max) * 0.5;
        let org = center + DVec3::new(0.3, 0.4, 2.2) * self.radius();
        let to = center + DVec3::new(x, y, 0.0) * self.radius();
        Ray32::new(RayKind::Grid, org, (to - org).normalize_or(DVec3::X))
    }

    fn tiny(&mut self) -> Ray32 {
        let mut ray = self.sphere();
        ray.dir = ray.dir.normalize_or(Vec3::X);
        let values = [f32::from_bits(1), 1e-40, -1e-40, f32::MIN_POSITIVE, 1e-30, -1e-20, 1e-12];
        for _ in 0..=self.rng.below(2) {
            ray.dir[self.rng.below(3)] = values[self.rng.below(values.len())];
        }
        if ray.dir.abs().max_element() < 0.1 {
            ray.dir[self.rng.below(3)] = 1.0;
        }
        // Aimed again along the component that is left.
        let k = (0..3).fold(0, |k, i| if ray.dir[i].abs() > ray.dir[k].abs() { i } else { k });
        let to = self.point().as_vec3();
        let s = (to[k] - ray.org[k]) / ray.dir[k];
        let mut org = to - ray.dir * s;
        org[k] = ray.org[k];
        if org.is_finite() {
            ray.org = org;
        }
        if ray.dir[k] * (to[k] - ray.org[k]) < 0.0 {
            ray.dir = -ray.dir;
        }
        ray.kind = RayKind::Tiny;
        ray
    }

    fn segment(&mut self) -> Ray32 {
        let mut ray = if self.rng.one_in(2) { self.sphere() } else { self.feature() };
        let tri = self.tri();
        let (dir, len2) = (ray.dir.as_dvec3(), ray.dir.as_dvec3().length_squared());
        let t = ((tri[0] - ray.org.as_dvec3()).dot(dir) / len2).abs() as f32;
        if self.rng.one_in(2) && t.is_finite() {
            ray.t_min = t * self.rng.unit() as f32;
        }
        if t.is_finite() {
            ray.t_max = ray.t_min + t;
        }
        ray.kind = RayKind::Segment;
        ray
    }
}
