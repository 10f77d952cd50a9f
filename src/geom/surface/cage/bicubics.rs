//! The bicubic patches that a quad's surface consists of.

use super::bicubic::bezier;
use super::plan::{Node, Plan};
use crate::geom::surface::dice::{BicubicPatch, descend};
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
                return Some(turned(points, 0, place));
            }
            Node::Creased(list, patches, side) => {
                let [level, column, row] = to_corner(place, side);
                let size = 1.0 / f64::from(1u32 << level);
                let ends = |at: u32| [f64::from(at) * size, f64::from(at + 1) * size];
                let (patch, across) = across_crease(patches, ends(row))?;
                let points = bezier(&plan.patch(list + 16 * patch, &point), ends(column), across);
                return Some(turned(points, side, [0; 3]));
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
                        return Some(turned(bezier(&points, WHOLE, WHOLE), corner, from_corner(at, corner)));
                    }
                    ring = (0..ring.len()).map(|i| pattern.ring.point(i, &ring)).collect();
                }
            }
        }
    }
}

/// The patch at a crease that holds an interval of distances from it, and the interval there: see `evaluate`.
fn across_crease(patches: u32, [mut low, mut high]: [f64; 2]) -> Option<(u32, [f64; 2])> {
    for patch in 0..patches - 1 {
        (low, high) = (2.0 * low, 2.0 * high);
        if low >= 1.0 {
            return Some((patch, [low - 1.0, high - 1.0]));
        }
        if high > 1.0 {
            return None;
        }
    }
    Some((patches - 1, [low, high]))
}

/// The place of a square in the quad that is turned so that it begins at `corner`: see `evaluate::to_corner`.
fn to_corner([level, column, row]: [u32; 3], corner: u32) -> [u32; 3] {
    let last = (1 << level) - 1;
    match corner {
        0 => [level, column, row],
        1 => [level, row, last - column],
        2 => [level, last - column, last - row],
        _ => [level, last - row, column],
    }
}

/// The inverse of [`to_corner`].
fn from_corner(place: [u32; 3], corner: u32) -> [u32; 3] {
    to_corner(place, (4 - corner) % 4)
}

/// The patch of Bézier points of the quad that is turned so that it begins at `corner`.
fn turned(points: [DVec3; 16], corner: u32, place: [u32; 3]) -> BicubicPatch {
    // At (column, row) of the quad are the points of the turned quad's column and row.
    let from = |i: usize| {
        let [_, column, row] = to_corner([2, (i % 4) as u32, (i / 4) as u32], corner);
        points[(4 * row + column) as usize]
    };
    let points: [DVec4; 16] = std::array::from_fn(|i| from(i).extend(1.0));
    BicubicPatch { points, is_rational: false, place }
}
