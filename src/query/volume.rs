//! Tests of convex volumes against boxes and triangles, in double precision.

use super::overlap::Plane;
use crate::math::DBounds;
use glam::DVec3;

/// A closed convex volume.
#[derive(Debug, Clone)]
pub(super) enum Volume {
    Box(DBounds),
    Planes(Vec<Plane>),
}

/// The position of a box or a triangle relative to a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Outside,
    Crossing,
    Inside,
}

impl Volume {
    /// False only if the volume certainly does not intersect the box.
    pub fn may_meet(&self, b: &DBounds) -> bool {
        match self {
            Volume::Box(own) => own.overlaps(b),
            Volume::Planes(planes) => planes.iter().all(|p| height(p, extreme(b, p.normal)) >= -slack(p, b)),
        }
    }

    /// True if the whole box is inside.
    pub fn holds(&self, b: &DBounds) -> bool {
        match self {
            Volume::Box(own) => own.contains(b),
            Volume::Planes(planes) => planes.iter().all(|p| height(p, extreme(b, -p.normal)) >= 0.0),
        }
    }

    /// The side of a triangle, tested with its own points instead of its box.
    pub fn side(&self, triangle: &[DVec3; 3]) -> Side {
        let inside = |v: &DVec3| match self {
            Volume::Box(b) => v.cmpge(b.min).all() && v.cmple(b.max).all(),
            Volume::Planes(planes) => planes.iter().all(|p| height(p, *v) >= 0.0),
        };
        let corners = triangle.iter().filter(|v| inside(v)).count();
        let meets = corners > 0
            || match self {
                Volume::Box(b) => box_meets(b, triangle),
                Volume::Planes(planes) => clipped_is_left(planes, triangle),
            };
        match (corners, meets) {
            (3, _) => Side::Inside,
            (_, true) => Side::Crossing,
            (_, false) => Side::Outside,
        }
    }
}

/// Signed distance from the plane, in units of its normal's length.
fn height(p: &Plane, v: DVec3) -> f64 {
    p.normal.dot(v) + p.d
}

/// The corner of a box farthest along `dir`.
fn extreme(b: &DBounds, dir: DVec3) -> DVec3 {
    DVec3::select(dir.cmpge(DVec3::ZERO), b.max, b.min)
}

/// Bound of the rounding of `height` over a box.
fn slack(p: &Plane, b: &DBounds) -> f64 {
    let size = b.min.abs().max(b.max.abs());
    (p.normal.abs().dot(size) + p.d.abs()) * (8.0 * f64::EPSILON)
}

/// Separating-axis test of a triangle and a box (Akenine-Möller 2001): three axes of the box, the triangle's normal,
/// nine cross products of edges. Touching counts as intersecting.
fn box_meets(b: &DBounds, triangle: &[DVec3; 3]) -> bool {
    if !DBounds::of(triangle).overlaps(b) {
        return false;
    }
    let (center, half) = (b.center(), b.extent() * 0.5);
    let v = triangle.map(|p| p - center);
    let edges = [v[1] - v[0], v[2] - v[1], v[0] - v[2]];
    let apart = |axis: DVec3| {
        let p = v.map(|v| axis.dot(v));
        let radius = half.dot(axis.abs());
        p[0].min(p[1]).min(p[2]) > radius || p[0].max(p[1]).max(p[2]) < -radius
    };
    let across = edges.iter().flat_map(|&e| DVec3::AXES.map(|a| a.cross(e)));
    !apart(edges[0].cross(edges[1])) && !across.into_iter().any(apart)
}

/// True if any part of a triangle remains after it is clipped by each plane (Sutherland and Hodgman 1974).
fn clipped_is_left(planes: &[Plane], triangle: &[DVec3; 3]) -> bool {
    let mut polygon = triangle.to_vec();
    let mut next = Vec::with_capacity(8);
    for plane in planes {
        next.clear();
        for (i, &a) in polygon.iter().enumerate() {
            let b = polygon[(i + 1) % polygon.len()];
            let (ha, hb) = (height(plane, a), height(plane, b));
            if ha >= 0.0 {
                next.push(a);
            }
            if (ha > 0.0 && hb < 0.0) || (ha < 0.0 && hb > 0.0) {
                next.push(a + (b - a) * (ha / (ha - hb)));
            }
        }
        std::mem::swap(&mut polygon, &mut next);
        if polygon.is_empty() {
            return false;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planes_of(b: &DBounds) -> Volume {
        let mut planes = Vec::new();
        for (i, axis) in DVec3::AXES.into_iter().enumerate() {
            planes.push(Plane { normal: axis, d: -b.min[i] });
            planes.push(Plane { normal: -axis, d: b.max[i] });
        }
        Volume::Planes(planes)
    }

    #[test]
    fn box_and_planes_agree_on_a_grid() {
        let unit = DBounds { min: DVec3::ZERO, max: DVec3::splat(2.0) };
        let volumes = [Volume::Box(unit), planes_of(&unit)];
        let mut seed = 1u64;
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((seed >> 33) % 7) as f64 - 2.0
        };
        let mut seen = [0; 3];
        for _ in 0..20_000 {
            let t: [DVec3; 3] = std::array::from_fn(|_| DVec3::new(random(), random(), random()));
            let sides = [volumes[0].side(&t), volumes[1].side(&t)];
            // Clipping divides: rounding may lose a corner where triangle and box only touch, and nowhere else.
            let inner = DBounds { min: unit.min + 1e-9, max: unit.max - 1e-9 };
            if sides[0] != sides[1] {
                assert_eq!((sides[0], box_meets(&inner, &t)), (Side::Crossing, false), "{t:?}");
            }
            seen[sides[0] as usize] += 1;
        }
        assert!(seen.iter().all(|&n| n > 4), "all three kinds occur: {seen:?}");
    }

    #[test]
    fn a_triangle_round_the_box_and_one_through_it() {
        let unit = DBounds { min: DVec3::ZERO, max: DVec3::ONE };
        let wide = [DVec3::new(-9.0, -9.0, 0.5), DVec3::new(20.0, -9.0, 0.5), DVec3::new(-9.0, 20.0, 0.5)];
        let above = wide.map(|v| v + DVec3::Z);
        for volume in [Volume::Box(unit), planes_of(&unit)] {
            assert_eq!(volume.side(&wide), Side::Crossing, "no corner inside, and yet it cuts");
            assert_eq!(volume.side(&above), Side::Outside);
            assert!(volume.may_meet(&DBounds::of(&wide)) && !volume.holds(&DBounds::of(&wide)));
        }
    }
}
