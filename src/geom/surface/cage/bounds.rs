//! Boxes around parts of a quad.
//!
//! Catmull-Clark masks have no negative weights, so that the surface lies in the convex hull of the points that it
//! depends on; Bézier points of bicubic parts are a tighter hull.

use super::bicubic::bezier;
use super::evaluate::to_corner;
use super::pattern::Pattern;
use super::plan::{Node, Plan};
use crate::math::DBounds;
use glam::DVec3;

/// The deepest level of parts.
const MAX_LEVEL: u32 = 30;

/// Levels around an irregular vertex, below that of the part, whose bicubic parts are enclosed one by one.
const FINER: u32 = 4;

/// The common part of an interval with a half of 0 to 1, in parameters of the half.
fn half([a, b]: [f64; 2], upper: bool) -> Option<[f64; 2]> {
    let offset = f64::from(u8::from(upper));
    let (a, b) = ((2.0 * a - offset).max(0.0), (2.0 * b - offset).min(1.0));
    (a < b).then_some([a, b])
}

/// A rectangle of parameters.
#[derive(Debug, Clone, Copy)]
struct Part {
    u: [f64; 2],
    v: [f64; 2],
}

impl Part {
    /// The common part with a quarter, in the quarter's own parameters.
    fn within(self, quarter: usize) -> Option<Part> {
        let (right, upper) = (quarter == 1 || quarter == 2, quarter >= 2);
        Some(Part { u: half(self.u, right)?, v: half(self.v, upper)? })
    }

    /// The common part with v ≥ 1/2, all of u, in parameters of this half.
    fn far_half(self) -> Option<Part> {
        Some(Part { u: self.u, v: half(self.v, true)? })
    }

    fn near_half(self) -> Option<Part> {
        Some(Part { u: self.u, v: half(self.v, false)? })
    }

    fn turned(self, corner: u32) -> Part {
        let (a, b) = (to_corner(self.u[0], self.v[0], corner), to_corner(self.u[1], self.v[1], corner));
        Part { u: [a.0.min(b.0), a.0.max(b.0)], v: [a.1.min(b.1), a.1.max(b.1)] }
    }

    fn is_whole(self) -> bool {
        self.u == [0.0, 1.0] && self.v == [0.0, 1.0]
    }
}

/// See `QuadSurface::bounds`.
pub(super) fn bounds(plan: &Plan, point: impl Fn(u32) -> DVec3, level: u32, i: u32, j: u32) -> DBounds {
    let level = level.min(MAX_LEVEL);
    let side = 1.0 / f64::from(1u32 << level);
    let from = |i: u32| f64::from(i.min((1 << level) - 1)) * side;
    let whole = Part { u: [from(i), from(i) + side], v: [from(j), from(j) + side] };
    let mut found = DBounds::EMPTY;
    let mut todo = vec![(0, whole)];
    while let Some((node, part)) = todo.pop() {
        match plan.nodes[node] {
            Node::Split(first) => {
                let quarters = (0..4).filter_map(|quarter| Some((first as usize + quarter, part.within(quarter)?)));
                todo.extend(quarters);
            }
            Node::Regular(list) => found = around(found, &bezier(&plan.patch(list, &point), part.u, part.v)),
            Node::Creased(list, patches, side) => {
                let mut part = part.turned(side);
                for patch in 0..patches {
                    let points = plan.patch(list + 16 * patch, &point);
                    let inside = if patch + 1 < patches { part.far_half() } else { Some(part) };
                    if let Some(part) = inside {
                        found = around(found, &bezier(&points, part.u, part.v));
                    }
                    let Some(near) = part.near_half() else { break };
                    part = near;
                }
            }
            Node::Irregular(list, pattern, corner) => {
                let pattern = &plan.patterns[pattern as usize];
                found = near_vertex(found, pattern, plan.ring(list, pattern, &point), part.turned(corner));
            }
        }
    }
    let reach = (0..plan.vertices).map(|i| point(i).abs().max_element()).fold(0.0, f64::max);
    let margin = DVec3::splat(plan.rounding() * reach);
    DBounds { min: found.min - margin, max: found.max + margin }
}

fn around(found: DBounds, points: &[DVec3]) -> DBounds {
    points.iter().fold(found, |found, &point| found.with(point))
}

/// The part of an irregular quad that begins at its vertex.
fn near_vertex(mut found: DBounds, pattern: &Pattern, mut ring: Vec<DVec3>, mut part: Part) -> DBounds {
    let mut finer = FINER;
    loop {
        if part.is_whole() {
            if finer == 0 {
                return around(found, &ring);
            }
            finer -= 1;
        }
        for child in 1..4 {
            if let Some(part) = part.within(child) {
                let points = std::array::from_fn(|i| pattern.children.point(16 * (child - 1) + i, &ring));
                found = around(found, &bezier(&points, part.u, part.v));
            }
        }
        let Some(next) = part.within(0) else { return found };
        part = next;
        ring = (0..ring.len()).map(|i| pattern.ring.point(i, &ring)).collect();
    }
}

impl Plan {
    /// Greatest rounding of a point of the quad, and of the plan's own points, as a share of the greatest coordinate of
    /// a control point.
    ///
    /// A sum of n weighted points, of weights that sum to 1, errs by at most (n + 2) u of the greatest of them, u =
    /// 2⁻⁵³ (weights are rounded once or twice, products once, sums n − 1 times). Each level adds as much, and mirrored
    /// points grow it ninefold at most, once. Near irregular vertices errors shrink with the ring; twice the first
    /// level holds for all. Evaluation adds two sums of four.
    pub fn rounding(&self) -> f64 {
        let levels = f64::from(self.depth + 2) * f64::from(self.longest + 2);
        let levels = if self.depth == 0 && self.patterns.is_empty() { 0.0 } else { levels };
        9.0 * (levels + 16.0) * 0.5 * f64::EPSILON
    }
}
