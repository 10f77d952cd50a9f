//! The bicubic patches that a quad's surface consists of.

use super::bicubic::bezier;
use super::plan::{Node, Plan};
use crate::geom::surface::dice::{BicubicPatch, Interval, intervals};
use glam::{DVec3, DVec4};

const WHOLE: [f64; 2] = [0.0, 1.0];

/// The patch that the square of a place is a part of; `None` if several are. `point`: the plan's points by number.
pub(super) fn bicubic(plan: &Plan, point: impl Fn(u32) -> DVec3, mut place: [u32; 3]) -> Option<BicubicPatch> {
    let mut node = 0;
    loop {
        match plan.nodes[node] {
            Node::Split(first) => {
                let (child, below) = descend(place)?;
                (node, place) = (first as usize + child, below);
            }
            Node::Regular(list) => {
                let points = bezier(&plan.patch(list, &point), WHOLE, WHOLE);
                return Some(turned(points, 0, intervals(place)));
            }
            Node::Creased(list, patches, side) => {
                let [along, across] = intervals(to_corner(place, side));
                let (patch, across) = across_crease(patches, across)?;
                let points = bezier(&plan.patch(list + 16 * patch, &point), WHOLE, WHOLE);
                return Some(turned(points, side, [along, across]));
            }
            Node::Irregular(list, pattern, corner) => {
                let pattern = &plan.patterns[pattern as usize];
                let mut ring = plan.ring(list, pattern, &point);
                let mut at = to_corner(place, corner);
                loop {
                    let (child, below) = descend(at)?;
                    at = below;
                    if child > 0 {
                        let points = std::array::from_fn(|i| pattern.children.point(16 * (child - 1) + i, &ring));
                        return Some(turned(bezier(&points, WHOLE, WHOLE), corner, intervals(at)));
                    }
                    ring = (0..ring.len()).map(|i| pattern.ring.point(i, &ring)).collect();
                }
            }
        }
    }
}

/// The patch at a crease that holds an interval of distances from it, and the interval there: see `evaluate`.
fn across_crease(patches: u32, [mut level, index]: Interval) -> Option<(u32, Interval)> {
    for patch in 0..patches - 1 {
        level = level.checked_sub(1)?;
        if index >> level == 1 {
            return Some((patch, [level, index - (1 << level)]));
        }
    }
    Some((patches - 1, [level, index]))
}

/// The quarter of a square of a place, as the child of its first level, and the place in that child. `None` for the
/// whole square. Children are those at the corners of the square, anticlockwise from that at u = v = 0.
fn descend([level, column, row]: [u32; 3]) -> Option<(usize, [u32; 3])> {
    let below = level.checked_sub(1)?;
    let (right, upper) = (column >> below & 1, row >> below & 1);
    let child = [0, 1, 3, 2][(right + 2 * upper) as usize];
    let own = (1 << below) - 1;
    Some((child, [below, column & own, row & own]))
}

/// The place of a square in the quad that is turned so that it begins at `corner`: see `evaluate::to_corner`.
fn to_corner(place: [u32; 3], corner: u32) -> [u32; 3] {
    let [[level, column], [_, row]] = from_corner(intervals(place), (4 - corner) % 4);
    [level, column, row]
}

/// The place in a quad of one in the quad that is turned so that it begins at `corner`.
fn from_corner([u, v]: [Interval; 2], corner: u32) -> [Interval; 2] {
    let mirrored = |[level, index]: Interval| [level, (1 << level) - 1 - index];
    match corner {
        0 => [u, v],
        1 => [mirrored(v), u],
        2 => [mirrored(u), mirrored(v)],
        _ => [v, mirrored(u)],
    }
}

/// The patch of Bézier points of the quad that is turned so that it begins at `corner`, with a place there.
fn turned(points: [DVec3; 16], corner: u32, place: [Interval; 2]) -> BicubicPatch {
    // At (column, row) of the quad are the points of the turned quad's column and row.
    let from = |i: usize| {
        let [_, column, row] = to_corner([2, (i % 4) as u32, (i / 4) as u32], corner);
        points[(4 * row + column) as usize]
    };
    let points: [DVec4; 16] = std::array::from_fn(|i| from(i).extend(1.0));
    BicubicPatch { points, is_rational: false, place: from_corner(place, corner) }
}
