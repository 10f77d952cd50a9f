//! Free edges: those at which a surface ends, as leaves do, and closed surfaces do not.

use super::content::Scene;
use super::tree::Sub;
use crate::math::Bounds;
use glam::Vec3;

/// Greatest number of edges that are looked at.
const EDGES: usize = 48;
/// Greatest number of parts of loose content: trees are made of bark and leaves. Where more parts lie together, what
/// transmits rays shows parts that are hidden. (Of an airliner, whose skin and frames have free edges, the
/// pixels at 30 pixels of error that show a part which is hidden there would be 8.2 to 10.8 % for 7.2.)
const PARTS: usize = 2;
/// An edge is free if its middle is farther than this part of its length from all other triangles. (Facets of adjacent
/// faces that are divided differently do not share corners, and leave small gaps.)
const APART: f32 = 1.0 / 64.0;
/// Distance, as a fraction of the coordinates, that counts as none: corners are rounded to single precision. (Around
/// the poles of spheres triangles are that small.)
const ROUNDED: f32 = 4.0 * f32::EPSILON;

impl Scene<'_> {
    /// True if triangles belong to at most [`PARTS`] parts.
    pub(super) fn has_few_parts(&self, triangles: &[u32]) -> bool {
        let mut parts: Vec<u32> = Vec::with_capacity(PARTS + 1);
        for id in triangles {
            let part = self.input.parts[*id as usize];
            if !parts.contains(&part) {
                parts.push(part);
                if parts.len() > PARTS {
                    return false;
                }
            }
        }
        true
    }

    /// Returns the share of the edges of some triangles that are free, from a sample of them. Triangles on top of each
    /// other count as one.
    #[inline(never)]
    pub(super) fn free_edges(&self, triangles: &[u32]) -> f32 {
        let step = triangles.len().div_ceil(EDGES).max(1);
        let (mut free, mut all, mut stack) = (0u32, 0u32, Vec::new());
        for (i, &id) in triangles.iter().step_by(step).enumerate() {
            let corners = self.input.triangles[id as usize];
            // Cards are mostly made of triangles in the same order, so steps that repeat would meet the same edges.
            let k = (i as u32).wrapping_mul(0x9e37_79b9) as usize >> 8;
            let (a, b) = (corners[k % 3], corners[(k + 1) % 3]);
            let (middle, rounded) = ((a + b) * 0.5, a.abs().max(b.abs()).max_element() * ROUNDED);
            let apart = (b - a).length() * APART + rounded;
            all += 1;
            free += u32::from(!self.touches(middle, apart, &corners, &mut stack));
        }
        free as f32 / all.max(1) as f32
    }

    /// True if a point is within `apart` of any triangle with other corners than `corners`.
    fn touches<'a>(&'a self, point: Vec3, apart: f32, corners: &[Vec3; 3], stack: &mut Vec<&'a Sub>) -> bool {
        let holds = |cell: Bounds| (cell.min - apart).cmple(point).all() && (cell.max + apart).cmpge(point).all();
        stack.clear();
        stack.extend(self.pieces.iter().map(|p| &p.sub));
        while let Some(sub) = stack.pop() {
            match sub {
                Sub::Leaf { first, count, .. } => {
                    for r in self.refs(*first, *count).iter().filter(|r| holds(r.bounds())) {
                        let other = &self.input.triangles[r.triangle()];
                        if !other.iter().all(|v| corners.contains(v)) && is_near(other.map(|v| v - point), apart) {
                            return true;
                        }
                    }
                }
                Sub::InnerNode(inner) => {
                    for (slot, (_, sub)) in inner.children.iter().enumerate() {
                        if holds(inner.node.stored_box(slot)) {
                            stack.push(sub);
                        }
                    }
                }
                Sub::Placed(_) => {}
            }
        }
        false
    }
}

/// True if a triangle is within `apart` of zero.
fn is_near([a, b, c]: [Vec3; 3], apart: f32) -> bool {
    let normal = (b - a).cross(c - a);
    let is_inside = [(a, b), (b, c), (c, a)].iter().all(|(a, b)| a.cross(*b).dot(normal) >= 0.0);
    let is_in_plane = normal.dot(a).abs() <= apart * normal.length();
    let is_near_edge = |a: Vec3, b: Vec3| {
        let ab = b - a;
        let along = (-a.dot(ab) / ab.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        (a + ab * along).length_squared() <= apart * apart
    };
    is_inside && is_in_plane || is_near_edge(a, b) || is_near_edge(b, c) || is_near_edge(c, a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_is_near_points_over_it_and_beside_it() {
        let triangle = |point: [f32; 3]| [Vec3::ZERO, Vec3::X * 4.0, Vec3::Y * 4.0].map(|v| v - Vec3::from(point));
        for (point, distance) in [
            ([1.0, 1.0, 0.5], 0.5),
            ([1.0, 1.0, -0.5], 0.5),
            ([-0.3, 1.0, 0.4], 0.5),
            ([2.0, -0.5, 0.0], 0.5),
            ([3.0, 3.0, 0.0], 2f32.sqrt()),
            ([7.0, -4.0, 0.0], 5.0),
        ] {
            assert!(is_near(triangle(point), distance * 1.001), "{point:?}");
            assert!(!is_near(triangle(point), distance * 0.999), "{point:?}");
        }
    }
}
