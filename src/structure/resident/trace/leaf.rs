//! The test of a leaf's triangles against one ray.

use crate::geom::watertight::{LaneHits, Sheared, intersect, shear};
use crate::simd::{Lanes, Simd};
use crate::structure::filter::PartFilter;
use crate::structure::resident::layout::{Leaf, ROWS, Resident};

/// A ray for the triangle test, in all lanes.
pub(super) struct LeafRay<S: Simd> {
    /// Origin, in the axis order `k`.
    pub org: [S::F8; 3],
    pub shear: [S::F8; 3],
    pub t_min: S::F8,
    /// Axis order, see [`crate::geom::Shear`].
    pub k: [usize; 3],
}

/// Returns the nearest hit in a leaf up to `t_max`: lane, distance and weights. Of equal distances the lowest lane
/// wins, which has the lowest primitive id.
#[inline(always)]
pub(super) fn nearest<S: Simd>(
    s: S,
    form: &Resident,
    leaf: &Leaf,
    ray: &LeafRay<S>,
    filter: Option<&PartFilter>,
    t_max: f32,
) -> Option<(u32, f32, f32, f32)> {
    let corners = [corner(s, leaf, ray, 0), corner(s, leaf, ray, 3), corner(s, leaf, ray, 6)];
    let all = (1 << leaf.triangles) - 1;
    let found = intersect::<8, _>(all, corners, s.splat8(0.0), ray.t_min, s.splat8(t_max));
    let mut hits = found.hits;
    if hits == 0 {
        return None;
    }
    if let Some(filter) = filter {
        hits = visible(form, leaf, filter, hits);
    }
    least(&found, hits)
}

/// Returns the nearest of `hits`: lane, distance and weights. Of equal distances the lowest lane wins.
#[inline(always)]
pub(super) fn least<L: Lanes<8>>(found: &LaneHits<L>, mut hits: u32) -> Option<(u32, f32, f32, f32)> {
    if hits == 0 {
        return None;
    }
    let t = found.t.to_array();
    let mut lane = hits.trailing_zeros() as usize & 7;
    hits &= hits - 1;
    while hits != 0 {
        let next = hits.trailing_zeros() as usize & 7;
        hits &= hits - 1;
        if t[next] < t[lane] {
            lane = next;
        }
    }
    Some((lane as u32, t[lane], found.u.to_array()[lane], found.v.to_array()[lane]))
}

/// Returns those of `hits` that are on visible parts.
#[inline(never)]
pub(super) fn visible(form: &Resident, leaf: &Leaf, filter: &PartFilter, hits: u32) -> u32 {
    (0..leaf.triangles)
        .filter(|i| hits >> i & 1 == 1 && !filter.hides(form.part(leaf, *i)))
        .fold(0, |all, i| all | 1 << i)
}

/// Returns one corner of all triangles, sheared for a ray. `first`: the row of its x.
#[inline(always)]
fn corner<S: Simd>(s: S, leaf: &Leaf, ray: &LeafRay<S>, first: usize) -> Sheared<S::F8> {
    let [x, y, z] = ray.k;
    let moved = [
        row(s, leaf, first + x) - ray.org[0],
        row(s, leaf, first + y) - ray.org[1],
        row(s, leaf, first + z) - ray.org[2],
    ];
    shear(moved, ray.shear)
}

/// Returns a row of a leaf. Lanes past the last triangle hold other numbers.
#[inline(always)]
pub(super) fn row<S: Simd>(s: S, leaf: &Leaf, row: usize) -> S::F8 {
    // There are nine rows of at most eight.
    let at = (row * leaf.triangles).min(ROWS - 8);
    match leaf.rows[at..at + 8].first_chunk::<8>() {
        Some(row) => s.load8(row),
        None => unreachable!(),
    }
}
