//! Ray against triangle in double precision, and the answers that need nothing else.
//!
//! With the vertices A, B, C relative to the ray's origin and d its direction, the signed volumes
//!
//! ```text
//! wa = d . (B x C)    wb = d . (C x A)    wc = d . (A x B)
//! ```
//!
//! are the barycentric weights of the point where the line meets the plane, times their sum
//! (Cramer's rule on s d = a A + b B + c C). The line meets the triangle when no two weights have
//! opposite signs and the sum is not zero; `t` is the mean of the vertices' own distances
//! `A . d / |d|^2` under these weights, so it never leaves their range.
//!
//! Two-sided. Borders count as inside. A ray in the triangle's plane does not meet it. Swapping the
//! two ends of an edge negates its volume exactly, so two triangles that share an edge never both
//! lose a ray to it.

use glam::DVec3;

/// Corners.
pub type Tri = [DVec3; 3];

/// A ray; distances are in units of `|dir|`, and `t_min <= t <= t_max` counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray64 {
    pub org: DVec3,
    pub dir: DVec3,
    pub t_min: f64,
    pub t_max: f64,
}

impl Ray64 {
    /// Unbounded.
    pub fn new(org: DVec3, dir: DVec3) -> Self {
        Self { org, dir, t_min: 0.0, t_max: f64::INFINITY }
    }

    /// The point at `t`.
    pub fn at(&self, t: f64) -> DVec3 {
        self.org + self.dir * t
    }
}

/// Where a ray meets a triangle: `u` and `v` are the weights of the second and third corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit64 {
    pub t: f64,
    pub u: f64,
    pub v: f64,
    pub prim: u32,
}

impl Hit64 {
    /// Nearer first, then the lower primitive.
    pub fn before(&self, o: &Self) -> bool {
        (self.t, self.prim) < (o.t, o.prim)
    }
}

/// Where `ray`'s line meets `tri`, whatever `t` is; `None` when it passes by or lies in its plane.
#[inline]
pub fn meet_line(ray: &Ray64, tri: &Tri) -> Option<(f64, f64, f64)> {
    let d = ray.dir;
    let [a, b, c] = tri.map(|v| v - ray.org);
    let wa = d.dot(b.cross(c));
    let wb = d.dot(c.cross(a));
    let wc = d.dot(a.cross(b));
    let any_negative = wa < 0.0 || wb < 0.0 || wc < 0.0;
    let any_positive = wa > 0.0 || wb > 0.0 || wc > 0.0;
    if any_negative && any_positive {
        return None;
    }
    let sum = wa + wb + wc;
    if sum == 0.0 || !sum.is_finite() {
        return None;
    }
    let z = |v: DVec3| v.dot(d);
    let t = (wa * z(a) + wb * z(b) + wc * z(c)) / sum / d.length_squared();
    t.is_finite().then_some((t, wb / sum, wc / sum))
}

/// Where `ray` meets `tri` within its range.
#[inline]
pub fn meet(ray: &Ray64, tri: &Tri, prim: u32) -> Option<Hit64> {
    let (t, u, v) = meet_line(ray, tri)?;
    (t >= ray.t_min && t <= ray.t_max).then_some(Hit64 { t, u, v, prim })
}

/// What is asked of a set of triangles; `brute` and `bvh64` answer the same.
pub trait Oracle: Sync {
    /// The triangles; a primitive is an index into them.
    fn tris(&self) -> &[Tri];
    /// Calls `visit` with (at least) every triangle that the ray meets at `t <= limit`, in any order;
    /// `visit` returns the new limit.
    fn scan(&self, ray: &Ray64, visit: &mut dyn FnMut(u32, &Tri) -> f64);
    /// Calls `visit` with (at least) every triangle within `eps` of the ray's line, whatever its `t`.
    fn near_line(&self, ray: &Ray64, eps: f64, visit: &mut dyn FnMut(u32, &Tri));

    /// The nearest hit; among equal distances the lowest primitive.
    fn closest(&self, ray: &Ray64) -> Option<Hit64> {
        let mut best: Option<Hit64> = None;
        self.scan(ray, &mut |prim, tri| {
            if let Some(hit) = meet(ray, tri, prim)
                && best.is_none_or(|b| hit.before(&b))
            {
                best = Some(hit);
            }
            best.map_or(ray.t_max, |b| b.t)
        });
        best
    }

    /// Whether the ray meets anything.
    fn any(&self, ray: &Ray64) -> bool {
        let mut found = false;
        self.scan(ray, &mut |prim, tri| {
            found |= meet(ray, tri, prim).is_some();
            if found { f64::NEG_INFINITY } else { ray.t_max }
        });
        found
    }

    /// Every hit up to `limit`, nearest first.
    fn all(&self, ray: &Ray64, limit: f64) -> Vec<Hit64> {
        let ray = Ray64 { t_max: ray.t_max.min(limit), ..*ray };
        let mut hits = Vec::new();
        self.scan(&ray, &mut |prim, tri| {
            hits.extend(meet(&ray, tri, prim));
            ray.t_max
        });
        hits.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.prim.cmp(&b.prim)));
        hits
    }

    /// The nearest hit and the primitives of all hits at most `tolerance` behind it (itself too).
    fn closest_tied(&self, ray: &Ray64, tolerance: f64) -> Option<(Hit64, Vec<u32>)> {
        let best = self.closest(ray)?;
        let tied = self.all(ray, best.t + tolerance).iter().map(|h| h.prim).collect();
        Some((best, tied))
    }
}

/// Looks at every triangle.
pub struct Brute {
    tris: Vec<Tri>,
}

impl Brute {
    pub fn new(tris: Vec<Tri>) -> Self {
        Self { tris }
    }
}

impl Oracle for Brute {
    fn tris(&self) -> &[Tri] {
        &self.tris
    }

    fn scan(&self, _ray: &Ray64, visit: &mut dyn FnMut(u32, &Tri) -> f64) {
        for (i, tri) in self.tris.iter().enumerate() {
            visit(i as u32, tri);
        }
    }

    fn near_line(&self, _ray: &Ray64, _eps: f64, visit: &mut dyn FnMut(u32, &Tri)) {
        for (i, tri) in self.tris.iter().enumerate() {
            visit(i as u32, tri);
        }
    }

    // The loop of the trait, without a call through a pointer for each triangle.
    fn closest(&self, ray: &Ray64) -> Option<Hit64> {
        let mut best: Option<Hit64> = None;
        for (i, tri) in self.tris.iter().enumerate() {
            if let Some(hit) = meet(ray, tri, i as u32)
                && best.is_none_or(|b| hit.before(&b))
            {
                best = Some(hit);
            }
        }
        best
    }
}
