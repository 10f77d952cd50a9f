//! Splitting space instead of the set: a triangle that the plane cuts goes to both sides, with
//! the box of what lies on each.
//!
//! Source: Stich, Friedrich, Dietrich, "Spatial Splits in Bounding Volume Hierarchies", HPG 2009.
//! Deviations: no unsplitting of references; candidates only where the best object split leaves sides
//! that overlap by more than [`OVERLAP`] of the root; the copies come out of a budget that each range
//! holds as free room behind its references.

use super::partition::Sides;
use super::refs::Ref;
use super::sah::{Extents, Split};
use crate::math::Bounds;
use glam::Vec3;

const BINS: usize = 16;

/// Overlap of the sides of an object split, as a share of the root's area, from which splitting space is
/// considered.
const OVERLAP: f32 = 1e-6;

/// A plane that divides space.
#[derive(Debug, Clone, Copy)]
pub struct SpatialSplit {
    axis: usize,
    plane: f32,
    /// Sum over both sides of half area times references.
    pub cost: f32,
    /// Sum over both sides of half area.
    pub side_areas: f32,
}

#[derive(Clone, Copy)]
struct Bin {
    bounds: Bounds,
    enter: u32,
    leave: u32,
}

/// Whether the sides of an object split overlap so much that dividing space may be better.
pub fn is_worth_a_look(split: &Split, root_half_area: f32) -> bool {
    split.left.intersection(split.right).half_area() > OVERLAP * root_half_area
}

/// The cheapest plane, of [`BINS`] a axis.
pub fn find(refs: &[Ref], triangles: &[[Vec3; 3]], bounds: &Bounds) -> Option<SpatialSplit> {
    let mut best: Option<SpatialSplit> = None;
    for axis in 0..3 {
        let (low, size) = (bounds.min[axis], bounds.max[axis] - bounds.min[axis]);
        let plane = |i: usize| low + size * (i as f32 / BINS as f32);
        // Too thin to hold sixteen planes.
        if !(plane(1) > low && plane(BINS - 1) > plane(BINS - 2)) {
            continue;
        }
        let mut bins = [Bin { bounds: Bounds::EMPTY, enter: 0, leave: 0 }; BINS];
        let scale = BINS as f32 * 0.9999 / size;
        for r in refs {
            let at = |x: f32| (((x - low) * scale) as usize).min(BINS - 1);
            let (first, last) = (at(r.low[axis]), at(r.high[axis]));
            bins[first].enter += 1;
            bins[last].leave += 1;
            let mut rest = r.bounds();
            for (i, bin) in bins.iter_mut().enumerate().take(last).skip(first) {
                let (left, right) = cut(&triangles[r.triangle()], &rest, axis, plane(i + 1));
                bin.bounds = bin.bounds.union(left);
                rest = right;
            }
            bins[last].bounds = bins[last].bounds.union(rest);
        }
        sweep(&bins, |i, cost, side_areas| {
            if best.is_none_or(|b| cost < b.cost) {
                best = Some(SpatialSplit { axis, plane: plane(i), cost, side_areas });
            }
        });
    }
    best
}

/// Calls `offer(first bin on the right, cost, areas)` for each plane with something on both sides.
fn sweep(bins: &[Bin; BINS], mut offer: impl FnMut(usize, f32, f32)) {
    let mut right = [(0.0f32, 0u32); BINS];
    let (mut bounds, mut count) = (Bounds::EMPTY, 0);
    for i in (1..BINS).rev() {
        bounds = bounds.union(bins[i].bounds);
        count += bins[i].leave;
        right[i] = (bounds.half_area(), count);
    }
    let (mut bounds, mut count) = (Bounds::EMPTY, 0);
    for i in 1..BINS {
        bounds = bounds.union(bins[i - 1].bounds);
        count += bins[i - 1].enter;
        let (left_area, (right_area, right_count)) = (bounds.half_area(), right[i]);
        if count > 0 && right_count > 0 {
            let cost = left_area * count as f32 + right_area * right_count as f32;
            offer(i, cost, left_area + right_area);
        }
    }
}

/// Boxes of the parts of a triangle on either side of a plane, inside `rest`. Empty where there is none.
fn cut(triangle: &[Vec3; 3], rest: &Bounds, axis: usize, plane: f32) -> (Bounds, Bounds) {
    let (mut left, mut right) = (Bounds::EMPTY, Bounds::EMPTY);
    for i in 0..3 {
        let (p, q) = (triangle[i], triangle[(i + 1) % 3]);
        if p[axis] <= plane {
            left = left.with(p);
        }
        if p[axis] >= plane {
            right = right.with(p);
        }
        if (p[axis] < plane) != (q[axis] < plane) && p[axis] != plane && q[axis] != plane {
            // Double precision: the rounding left is far below what box tests allow for.
            let w = (f64::from(plane) - f64::from(p[axis])) / (f64::from(q[axis]) - f64::from(p[axis]));
            let mut x = p.as_dvec3().lerp(q.as_dvec3(), w).as_vec3();
            x[axis] = plane;
            left = left.with(x);
            right = right.with(x);
        }
    }
    left.max[axis] = left.max[axis].min(plane);
    right.min[axis] = right.min[axis].max(plane);
    (left.intersection(*rest), right.intersection(*rest))
}

/// Which sides a reference goes to.
fn sides(r: &Ref, split: &SpatialSplit, triangles: &[[Vec3; 3]]) -> (Option<Ref>, Option<Ref>) {
    if r.high[split.axis] <= split.plane {
        return (Some(*r), None);
    }
    if r.low[split.axis] >= split.plane {
        return (None, Some(*r));
    }
    let (left, right) = cut(&triangles[r.triangle()], &r.bounds(), split.axis, split.plane);
    let side = |b: Bounds| (!b.is_empty()).then(|| Ref::new(b, r.triangle() as u32));
    match (side(left), side(right)) {
        // Rounding may lose a corner that only touches the plane: never lose the triangle.
        (None, None) => (Some(*r), None),
        sides => sides,
    }
}

/// Divides the first `len` references of `room`: the left ones come first, the right ones follow. Returns
/// how many there are now. `None`, and nothing changed, if the room is too small or a side would be
/// empty or as large as the whole.
pub fn partition(
    room: &mut [Ref],
    len: usize,
    split: &SpatialSplit,
    triangles: &[[Vec3; 3]],
) -> Option<(usize, Sides)> {
    let mut left = Vec::with_capacity(len);
    let mut right = Vec::with_capacity(len);
    let mut extents = [Extents::EMPTY; 2];
    for r in &room[..len] {
        let (a, b) = sides(r, split, triangles);
        a.iter().for_each(|r| extents[0].add(r));
        b.iter().for_each(|r| extents[1].add(r));
        left.extend(a);
        right.extend(b);
    }
    let (middle, now) = (left.len(), left.len() + right.len());
    if now > room.len() || left.is_empty() || right.is_empty() || left.len() == len || right.len() == len {
        return None;
    }
    room[..middle].copy_from_slice(&left);
    room[middle..now].copy_from_slice(&right);
    let [left, right] = extents;
    Some((now, Sides { middle, left, right }))
}

/// Whether spatial splits are likely to pay: much of the triangles' boxes belongs to long thin ones.
///
/// Long thin: the longest edge is more than [`THIN`] times the height over it. On scans (regular triangles)
/// splits cost memory and build time and gain nothing.
pub fn splits_pay(triangles: &[[Vec3; 3]]) -> bool {
    const THIN: f32 = 8.0;
    const SHARE: f64 = 0.3;
    // A few thousand say enough.
    let step = (triangles.len() / 65536).max(1);
    let (mut thin, mut all) = (0.0f64, 0.0f64);
    for [a, b, c] in triangles.iter().step_by(step) {
        let area = f64::from(Bounds::of(&[*a, *b, *c]).half_area());
        let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
        let double_area = (b - a).cross(c - a).length();
        all += area;
        if longest > THIN * double_area {
            thin += area;
        }
    }
    thin > SHARE * all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::clip::clipped_bounds;
    use proptest::prelude::*;

    fn grid() -> impl Strategy<Value = Vec3> {
        [-4i32..5, -4i32..5, -4i32..5].prop_map(|p| Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        /// Both sides hold what clipping finds there.
        #[test]
        fn a_cut_loses_nothing(a in grid(), b in grid(), c in grid(), axis in 0usize..3, plane in -4i32..5) {
            let (triangle, plane) = ([a, b, c], plane as f32 + 0.25);
            let whole = Bounds::of(&triangle);
            let (left, right) = cut(&triangle, &whole, axis, plane);
            let (mut below, mut above) = (whole, whole);
            below.max[axis] = below.max[axis].min(plane);
            above.min[axis] = above.min[axis].max(plane);
            for (side, cell) in [(left, below), (right, above)] {
                if let Some(exact) = clipped_bounds(&triangle, &cell) {
                    let grown = Bounds { min: side.min - 1e-5, max: side.max + 1e-5 };
                    prop_assert!(grown.contains(&exact), "{side:?} {exact:?}");
                }
            }
        }
    }

    #[test]
    fn thin_triangles_are_told_from_regular_ones() {
        let regular = [[Vec3::ZERO, Vec3::X, Vec3::Y]; 10];
        let thin = [[Vec3::ZERO, Vec3::ONE * 10.0, Vec3::new(10.0, 10.0, 10.1)]; 10];
        assert!(!splits_pay(&regular) && splits_pay(&thin));
        assert!(!splits_pay(&[]));
    }
}
