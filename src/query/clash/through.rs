//! Whether a solid goes through another: its surface outside of the other is in several pieces, as that of a rod in a
//! plate is, and as that of the plate is not. Decided at corners and edges: corners outside are in one piece if edges
//! that do not meet the other surface join them.

use super::depth::{Sides, Two};
use super::solid::{Solid, around};
use crate::geom::{Relation, relate};
use crate::math::DBounds;
use glam::DVec3;
use std::collections::HashMap;

/// True if solid `of` goes through the other one.
pub(super) fn goes_through(two: &Two, of: usize, sides: &Sides) -> bool {
    let (own, other, shift) = (two.solids[of], two.solids[1 - of], two.shift(of));
    let numbers = own.corner_numbers();
    let count = numbers.iter().flatten().max().map_or(0, |&last| last as usize + 1);
    let (mut outside, mut whole) = (Groups::new(count), Groups::new(count));
    let mut is_outside = vec![false; count];
    // A corner of each number, in the frame of the other solid.
    let mut places = vec![DVec3::ZERO; count];
    let has = |list: &[u32], index: u32| list.binary_search(&index).is_ok();
    for (index, (of_triangle, triangle)) in (0u32..).zip(numbers.iter().zip(&own.triangles)) {
        let corners = triangle.map(|p| p + shift);
        (0..3).for_each(|i| places[of_triangle[i] as usize] = corners[i]);
        let edges = [(0, 1), (1, 2), (2, 0)];
        edges.iter().for_each(|&(i, j)| whole.join(of_triangle[i], of_triangle[j]));
        if has(&sides.inside, index) {
            continue;
        }
        let is_cut = has(&sides.cut, index);
        let is_out = corners.map(|p| !is_cut || !other.holds(p));
        (0..3).for_each(|i| is_outside[of_triangle[i] as usize] |= is_out[i]);
        for (i, j) in edges {
            if is_out[i] && is_out[j] && !(is_cut && meets(other, corners[i], corners[j])) {
                outside.join(of_triangle[i], of_triangle[j]);
            }
        }
    }
    // Corners on the surface are on either side of it by rounding: a piece needs one that is farther away.
    let mut found: HashMap<u32, u32> = HashMap::new();
    for number in 0..count as u32 {
        if is_outside[number as usize] {
            let (piece, all) = (outside.of(number), whole.of(number));
            if found.get(&all) != Some(&piece) && is_away(other, places[number as usize], two.tolerance) {
                if found.contains_key(&all) {
                    return true;
                }
                found.insert(all, piece);
            }
        }
    }
    false
}

/// True if a segment meets the surface of a solid.
fn meets(solid: &Solid, p: DVec3, q: DVec3) -> bool {
    let segment = [p, p, q];
    let mut is_met = false;
    solid.near(&around(&[segment]), |index| {
        is_met = relate(&segment, &solid.triangles[index as usize]) != Relation::Apart;
        !is_met
    });
    is_met
}

/// True if a point is farther than a distance from a surface.
fn is_away(solid: &Solid, p: DVec3, distance: f64) -> bool {
    let b = &solid.bounds;
    let grown = DBounds { min: b.min - distance, max: b.max + distance };
    !grown.contains(&DBounds { min: p, max: p })
        || solid.nearest(p).is_none_or(|(near, _)| near.squared > distance * distance)
}

/// Disjoint sets of numbers (Tarjan 1975, with halved paths).
struct Groups(Vec<u32>);

impl Groups {
    fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    fn of(&mut self, mut number: u32) -> u32 {
        while self.0[number as usize] != number {
            let next = self.0[number as usize];
            self.0[number as usize] = self.0[next as usize];
            number = next;
        }
        number
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.of(a), self.of(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
