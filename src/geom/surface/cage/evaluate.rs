//! The limit surface of a plan's quad at any parameters.

use super::super::point::SurfacePoint;
use super::bicubic;
use super::pattern::Pattern;
use super::plan::{Node, Plan};
use glam::DVec3;

/// Levels around an irregular vertex after which its own limit is the answer: parameters below 2⁻⁴⁸ there.
const DEEPEST: u32 = 48;

/// The point at u, v, which are clamped. `point`: the plan's points by number.
pub(super) fn evaluate(plan: &Plan, point: impl Fn(u32) -> DVec3, u: f64, v: f64) -> SurfacePoint {
    // NaN becomes 0.
    let clamped = |t: f64| if t > 0.0 { t.min(1.0) } else { 0.0 };
    let (mut u, mut v, mut scale, mut node) = (clamped(u), clamped(v), 1.0, 0);
    loop {
        match plan.nodes[node] {
            Node::Split(first) => {
                node = first as usize + descend(&mut u, &mut v);
                scale *= 2.0;
            }
            Node::Regular(list) => return scaled(bicubic::evaluate(&plan.patch(list, &point), u, v), scale),
            Node::Creased(list, patches, side) => {
                let (u, v) = to_corner(u, v, side);
                let (patch, v, across) = across_crease(patches, v);
                let found = bicubic::evaluate(&plan.patch(list + 16 * patch, &point), u, v);
                return scaled(from_corner(scaled_across(found, across), side), scale);
            }
            Node::Irregular(list, pattern, corner) => {
                let pattern = &plan.patterns[pattern as usize];
                let (u, v) = to_corner(u, v, corner);
                let found = near_vertex(pattern, plan.ring(list, pattern, &point), u, v);
                return scaled(from_corner(found, corner), scale);
            }
        }
    }
}

impl Plan {
    /// The 16 control points of a regular node.
    pub(super) fn patch(&self, list: u32, point: impl Fn(u32) -> DVec3) -> [DVec3; 16] {
        let list = &self.lists[list as usize..list as usize + 16];
        std::array::from_fn(|i| point(list[i]))
    }

    /// The ring of an irregular node.
    pub(super) fn ring(&self, list: u32, pattern: &Pattern, point: impl Fn(u32) -> DVec3) -> Vec<DVec3> {
        self.lists[list as usize..list as usize + pattern.ring.len()].iter().map(|&i| point(i)).collect()
    }
}

/// The child that holds (u, v), which become its parameters.
fn descend(u: &mut f64, v: &mut f64) -> usize {
    let (right, upper) = (*u >= 0.5, *v >= 0.5);
    *u = 2.0 * *u - f64::from(u8::from(right));
    *v = 2.0 * *v - f64::from(u8::from(upper));
    match (right, upper) {
        (false, false) => 0,
        (true, false) => 1,
        (true, true) => 2,
        (false, true) => 3,
    }
}

/// Multiplies derivatives for parameters that run `scale` times as slowly.
fn scaled(p: SurfacePoint, scale: f64) -> SurfacePoint {
    let square = scale * scale;
    SurfacePoint {
        du: p.du * scale,
        dv: p.dv * scale,
        duu: p.duu * square,
        duv: p.duv * square,
        dvv: p.dvv * square,
        ..p
    }
}

/// The patch at a distance from a crease, the parameter in it, and how many times as fast that runs.
fn across_crease(patches: u32, mut v: f64) -> (u32, f64, f64) {
    let mut scale = 1.0;
    for patch in 0..patches - 1 {
        v *= 2.0;
        scale *= 2.0;
        if v >= 1.0 {
            return (patch, v - 1.0, scale);
        }
    }
    (patches - 1, v, scale)
}

/// [`scaled`] for v alone.
fn scaled_across(p: SurfacePoint, scale: f64) -> SurfacePoint {
    SurfacePoint { dv: p.dv * scale, duv: p.duv * scale, dvv: p.dvv * (scale * scale), ..p }
}

/// Parameters of the quad turned so that it begins at `corner`.
pub(super) fn to_corner(u: f64, v: f64, corner: u32) -> (f64, f64) {
    match corner {
        0 => (u, v),
        1 => (v, 1.0 - u),
        2 => (1.0 - u, 1.0 - v),
        _ => (1.0 - v, u),
    }
}

/// A point of the turned quad with derivatives by the quad's own parameters.
fn from_corner(p: SurfacePoint, corner: u32) -> SurfacePoint {
    match corner {
        0 => p,
        1 => SurfacePoint { du: -p.dv, dv: p.du, duu: p.dvv, duv: -p.duv, dvv: p.duu, ..p },
        2 => SurfacePoint { du: -p.du, dv: -p.dv, ..p },
        _ => SurfacePoint { du: p.dv, dv: -p.du, duu: p.dvv, duv: -p.duv, dvv: p.duu, ..p },
    }
}

/// The point of a quad whose corner at u = v = 0 is irregular.
fn near_vertex(pattern: &Pattern, mut ring: Vec<DVec3>, mut u: f64, mut v: f64) -> SurfacePoint {
    let dot = |mask: &[f64], ring: &[DVec3]| mask.iter().zip(ring).fold(DVec3::ZERO, |sum, (&w, &p)| sum + p * w);
    let (masks, mut deeper) = (&pattern.masks, ring.clone());
    // Numbers relative to the limit at the vertex keep their precision while the ring shrinks towards it.
    let mut limit = DVec3::ZERO;
    let (mut scale, mut depth) = (1.0, 0);
    loop {
        let step = dot(&masks.position, &ring);
        limit += step;
        ring.iter_mut().for_each(|p| *p -= step);
        if depth == DEEPEST || u == 0.0 && v == 0.0 {
            let (du, dv) = (dot(&masks.du, &ring), dot(&masks.dv, &ring));
            return SurfacePoint { position: limit, du: du * scale, dv: dv * scale, ..SurfacePoint::default() };
        }
        let child = descend(&mut u, &mut v);
        scale *= 2.0;
        if child > 0 {
            let points = std::array::from_fn(|i| pattern.children.point(16 * (child - 1) + i, &ring));
            let point = scaled(bicubic::evaluate(&points, u, v), scale);
            return SurfacePoint { position: point.position + limit, ..point };
        }
        deeper.iter_mut().enumerate().for_each(|(i, p)| *p = pattern.ring.point(i, &ring));
        std::mem::swap(&mut ring, &mut deeper);
        depth += 1;
    }
}
