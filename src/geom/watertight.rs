//! The watertight ray-triangle test.
//!
//! Source: Woop, Benthin, Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013, sections 2 and 3. Deviations:
//! both windings hit; `t` comes from one division per vector; edge functions, weights and `t` are evaluated again in
//! double precision, in which the products are exact, if an edge function is exactly zero in single precision, or if
//! the triangle looks far longer than wide from the ray.
//!
//! One body serves eight triangles against a ray, sixteen rays against a triangle, and the scalar twin for tests. It
//! uses no fused multiply-add: an edge that two triangles share must give exactly opposite values, and every
//! instruction set the same bits.

use crate::simd::{Lanes, Mask};
use glam::Vec3;

/// The constants of a ray that the test needs, prepared once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shear {
    /// Permutation of the axes: the last is the one along which the direction is greatest.
    pub k: [usize; 3],
    /// Shear along x, shear along y, and scale along z.
    pub s: [f32; 3],
}

impl Shear {
    /// Prepares a direction whose components are finite and not all zero.
    #[inline(always)]
    pub fn new(dir: Vec3) -> Self {
        let a = dir.abs();
        let kz = if a.x >= a.y && a.x >= a.z {
            0
        } else if a.y >= a.z {
            1
        } else {
            2
        };
        let (kx, ky) = ((kz + 1) % 3, (kz + 2) % 3);
        Self { k: [kx, ky, kz], s: [dir[kx] / dir[kz], dir[ky] / dir[kz], 1.0 / dir[kz]] }
    }
}

/// The intersection of a ray with a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangleHit {
    /// Distance in units of the direction's length.
    pub t: f32,
    /// Weight of the second vertex.
    pub u: f32,
    /// Weight of the third vertex.
    pub v: f32,
}

/// Results of all lanes; only those in `hits` are defined.
#[derive(Debug, Clone, Copy)]
pub struct LaneHits<L> {
    /// Bit `i`: lane `i` is a hit, and its `t` is in the ray's interval.
    pub hits: u32,
    /// Distances.
    pub t: L,
    /// Weights of the second vertex.
    pub u: L,
    /// Weights of the third vertex.
    pub v: L,
}

/// A vertex relative to the ray's origin, sheared so that the ray runs along z.
#[derive(Clone, Copy)]
pub struct Sheared<L> {
    pub(crate) x: L,
    pub(crate) y: L,
    /// Coordinate along the ray, in units of its direction's length.
    pub(crate) z: L,
}

/// Shears a vertex. `p`: the vertex minus the origin, with its components in the order `k`.
#[inline(always)]
pub fn shear<const N: usize, L: Lanes<N>>(p: [L; 3], s: [L; 3]) -> Sheared<L> {
    Sheared { x: p[0] - s[0] * p[2], y: p[1] - s[1] * p[2], z: s[2] * p[2] }
}

/// Tests each lane's triangle `abc` against that lane's ray.
///
/// `lanes`: the lanes to test; the others are no hits. `zero`: 0 in each lane. `t_min`, `t_max`: each lane's interval,
/// borders included.
#[inline(always)]
pub fn intersect<const N: usize, L: Lanes<N>>(
    lanes: u32,
    [a, b, c]: [Sheared<L>; 3],
    zero: L,
    t_min: L,
    t_max: L,
) -> LaneHits<L> {
    let products = [c.x * b.y, a.x * c.y, b.x * a.y];
    let u = products[0] - c.y * b.x;
    let v = products[1] - a.y * c.x;
    let w = products[2] - b.y * a.x;
    // The ray is inside if all three edge functions have one sign or are zero. The least and the greatest decide that;
    // if one of them is zero, the ray meets an edge.
    let (least, greatest) = (u.min(v).min(w), u.max(v).max(w));
    let inside = zero.le(least).or(greatest.le(zero));
    let hits = inside.bits() & lanes;
    // Most triangles of a leaf are missed by a ray that hits the leaf's box.
    if hits == 0 {
        return LaneHits { hits, t: zero, u: zero, v: zero };
    }
    let det = u + v + w;
    let on_edge = least.eq(zero).or(greatest.eq(zero));
    // Each of the other three products differs from one of these by an edge function, and so by at most `det`: the edge
    // functions have one sign.
    let greatest = products[0].max(products[1]).max(products[2]);
    let least = products[0].min(products[1]).min(products[2]);
    let thin = greatest.max(zero - least) * L::from_array_like(zero, [THIN; N]);
    let is_thin = det.max(zero - det).le(thin.max(L::from_array_like(zero, [TINY; N])));
    let doubtful = on_edge.or(is_thin).bits() & hits;
    let rdet = L::from_array_like(zero, [1.0; N]).div(det);
    // The weights are computed before the sum: a sum of products without weights would exceed the range of single
    // precision for models of less than 1e-12 or more than 1e12 units.
    let (v, w) = (v * rdet, w * rdet);
    let mut found = LaneHits { hits, t: u * rdet * a.z + v * b.z + w * c.z, u: v, v: w };
    if doubtful != 0 {
        // Copied inside the branch: the compiler would store values that a call takes by address before the branch.
        let corners = [
            [a.x.to_array(), a.y.to_array(), a.z.to_array()],
            [b.x.to_array(), b.y.to_array(), b.z.to_array()],
            [c.x.to_array(), c.y.to_array(), c.z.to_array()],
        ];
        let mut all = [found.t.to_array(), found.u.to_array(), found.v.to_array()];
        found.hits = hits & !exactly(&corners, &mut all, doubtful);
        found.t = L::from_array_like(zero, all[0]);
        found.u = L::from_array_like(zero, all[1]);
        found.v = L::from_array_like(zero, all[2]);
    }
    found.hits &= t_min.le(found.t).and(found.t.le(t_max)).bits();
    found
}

/// Limit of twice a triangle's projected area, as a fraction of the products whose differences are the edge functions.
/// Below it rounding of the products matters, and the edge functions are evaluated again. (Single precision gave the
/// distance of a triangle 10 units long and 0.00006 wide only to 0.1.)
const THIN: f32 = 1.0 / 1024.0;
/// Absolute limit of the same area: near the least numbers of single precision, products lose digits.
const TINY: f32 = 1e-30;

/// Evaluates `lanes` again in double precision, in which the products of the edge functions are exact. The other lanes
/// are unchanged: a lane's result must not depend on its neighbours. `found`: distances, and weights of the second and
/// the third vertex.
///
/// Returns the lanes that miss their triangle. Only lanes on an edge can: rounding keeps the order of two products, so
/// the sign of a non-zero difference is right.
#[inline(never)]
#[cold]
fn exactly<const N: usize>([a, b, c]: &[[[f32; N]; 3]; 3], found: &mut [[f32; N]; 3], lanes: u32) -> u32 {
    let mut outside = 0;
    for i in (0..N).filter(|i| lanes >> i & 1 == 1) {
        let [a, b, c] = [a, b, c].map(|p| [f64::from(p[0][i]), f64::from(p[1][i]), f64::from(p[2][i])]);
        let edge = |p: [f64; 3], q: [f64; 3]| p[0] * q[1] - p[1] * q[0];
        let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        let det = u + v + w;
        let is_inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
        outside |= u32::from(!is_inside || det == 0.0) << i;
        let t = (u * a[2] + v * b[2] + w * c[2]) / det;
        (found[0][i], found[1][i], found[2][i]) = (t as f32, (v / det) as f32, (w / det) as f32);
    }
    outside
}

/// The scalar twin: one ray and one triangle. It returns the same bits as a lane of [`intersect`].
pub fn intersect_one(
    org: Vec3,
    shear_of_ray: &Shear,
    t_min: f32,
    t_max: f32,
    [a, b, c]: [Vec3; 3],
) -> Option<TriangleHit> {
    use crate::simd::{Portable, Simd};
    let simd = Portable::new();
    let lane = |v: Vec3| {
        let p = v - org;
        let k = shear_of_ray.k;
        let p = [simd.splat8(p[k[0]]), simd.splat8(p[k[1]]), simd.splat8(p[k[2]])];
        shear(p, shear_of_ray.s.map(|s| simd.splat8(s)))
    };
    let (t_min, t_max) = (simd.splat8(t_min), simd.splat8(t_max));
    let found = intersect::<8, _>(1, [lane(a), lane(b), lane(c)], simd.splat8(0.0), t_min, t_max);
    let first = |l: crate::simd::Array<8>| l.to_array()[0];
    (found.hits & 1 == 1).then(|| TriangleHit { t: first(found.t), u: first(found.u), v: first(found.v) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Distance by Cramer's rule in double precision: a formula that differs from the tested one.
    fn oracle(org: Vec3, dir: Vec3, [a, b, c]: [Vec3; 3]) -> Option<(f64, f64, f64)> {
        let (o, d) = (org.as_dvec3(), dir.as_dvec3());
        let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
        let (e1, e2) = (b - a, c - a);
        let p = d.cross(e2);
        let det = e1.dot(p);
        let s = o - a;
        let u = s.dot(p) / det;
        let q = s.cross(e1);
        let v = d.dot(q) / det;
        (det != 0.0).then(|| (e2.dot(q) / det, u, v))
    }

    fn grid() -> impl Strategy<Value = Vec3> {
        [-8i32..9, -8i32..9, -8i32..9].prop_map(|p| Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32) * 0.5)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]
        /// On a half-integer grid, ties and hits of edges and corners are common.
        #[test]
        fn agrees_with_cramer_away_from_edges(org in grid(), dir in grid(), a in grid(), b in grid(), c in grid()) {
            prop_assume!(dir != Vec3::ZERO);
            let found = intersect_one(org, &Shear::new(dir), 0.0, f32::INFINITY, [a, b, c]);
            let Some((t, u, v)) = oracle(org, dir, [a, b, c]) else {
                return Ok(());
            };
            let inside = u.min(v).min(1.0 - u - v).min(t);
            if inside > 1e-4 {
                let hit = found.expect("a hit well inside");
                prop_assert!((f64::from(hit.t) - t).abs() <= 1e-4 * (1.0 + t.abs()), "{} {t}", hit.t);
                prop_assert!((f64::from(hit.u) - u).abs() < 1e-4 && (f64::from(hit.v) - v).abs() < 1e-4);
            } else if inside < -1e-4 {
                prop_assert!(found.is_none());
            }
        }

        /// A ray at a point of the edge that two triangles share hits at least one of them.
        #[test]
        fn no_gap_along_a_shared_edge(
            org in grid(), a in grid(), b in grid(), w in 0.0f32..1.0,
            side in [0.1f32..1.0, 0.1f32..1.0, 0.1f32..1.0],
        ) {
            let target = a + (b - a) * w;
            let dir = target - org;
            let edge = b - a;
            let out = edge.cross(dir);
            prop_assume!(out.length() > 1e-3 && dir.length() > 1e-3);
            // Two triangles, one on each side of the edge as seen from the origin.
            let (c, d) = (target + out.normalize() * side[0], target - out.normalize() * side[1]);
            let shear = Shear::new(dir);
            let first = intersect_one(org, &shear, 0.0, f32::INFINITY, [a, b, c]);
            let second = intersect_one(org, &shear, 0.0, f32::INFINITY, [b, a, d]);
            // Near the ends of the edge, other triangles of a closed mesh would be hit.
            if w > 1e-4 && w < 1.0 - 1e-4 {
                prop_assert!(first.is_some() || second.is_some());
            }
        }
    }

    /// Seen at 20 degrees or more, a triangle ten units long, and up to a million times longer than wide, is as far
    /// away as its plane, to 0.002.
    #[test]
    fn distances_of_slivers_are_accurate() {
        let mut state = 7u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 24) as f32
        };
        let mut met = 0;
        for _ in 0..200_000 {
            let [a, along, side, org] =
                [1.0, 1.0, 1.0, 9.0].map(|size| Vec3::new(next() - 0.5, next() - 0.5, next() - 0.5) * (2.0 * size));
            let (thin, at, over) = (10f32.powf(-2.0 - 4.0 * next()), 0.05 + 0.5 * next(), 0.1 + 0.8 * next());
            let along = along.normalize_or(Vec3::X) * 10.0;
            let across = along.cross(side).normalize_or(Vec3::Y) * (10.0 * thin);
            let (b, c) = (a + along, a + along + across);
            let [pa, pb, pc] = [a, b, c].map(|p| p.as_dvec3());
            let target = pa + (pb - pa) * f64::from(at + over * (1.0 - at)) + (pc - pb) * f64::from(at * over);
            let dir = (target - org.as_dvec3()).as_vec3();
            let normal = (pb - pa).cross(pc - pa).normalize_or_zero();
            if normal.dot(dir.as_dvec3()).abs() < 0.35 * f64::from(dir.length()) {
                continue;
            }
            let (t, ..) = oracle(org, dir, [a, b, c]).expect("a plane");
            // Rounding may move the ray beside the triangle; it then misses. Triangles just not thin enough for double
            // precision have errors of some thousandths.
            if let Some(hit) = intersect_one(org, &Shear::new(dir), 0.0, f32::INFINITY, [a, b, c]) {
                let off = (f64::from(hit.t) - t).abs() * f64::from(dir.length());
                assert!(off < 2e-3, "{off:e}: {org}, {dir}, {a}, {b}, {c}");
                met += 1;
            }
        }
        assert!(met > 50_000, "{met}");
    }

    #[test]
    fn both_windings_and_the_interval() {
        let tri = [Vec3::new(0.0, 0.0, 2.0), Vec3::new(1.0, 0.0, 2.0), Vec3::new(0.0, 1.0, 2.0)];
        let flipped = [tri[0], tri[2], tri[1]];
        let org = Vec3::new(0.25, 0.25, 0.0);
        let shear = Shear::new(Vec3::Z);
        let hit = intersect_one(org, &shear, 0.0, 10.0, tri).expect("hit");
        assert_eq!((hit.t, hit.u, hit.v), (2.0, 0.25, 0.25));
        assert_eq!(intersect_one(org, &shear, 0.0, 10.0, flipped).map(|h| h.t), Some(2.0));
        assert!(intersect_one(org, &shear, 2.0, 2.0, tri).is_some());
        assert!(intersect_one(org, &shear, 0.0, 1.9, tri).is_none());
        assert!(intersect_one(org, &shear, 2.1, 9.0, tri).is_none());
        assert!(intersect_one(org, &Shear::new(Vec3::NEG_Z), 0.0, 9.0, tri).is_none());
    }
}
