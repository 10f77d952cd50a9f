//! Spatial splits: a plane splits space instead of the set. A triangle that the plane cuts goes to both sides, each
//! with the box of its part there.
//!
//! Source: Stich, Friedrich, Dietrich, "Spatial Splits in Bounding Volume Hierarchies", HPG 2009. Deviations: no
//! unsplitting of references (tried: a thousandth fewer); candidates only where the sides of the best object split
//! overlap by more than [`OVERLAP`] of the root; the copies come out of a budget that each range holds as free room
//! after its references.

use super::chop::{self, Grid};
use super::partition::Sides;
use super::refs::Ref;
use super::sah::{BINS, Extents, FEW, FEW_BINS, PARALLEL, Split};
use super::sweep::{Bins, Plane};
use crate::math::Bounds;
use crate::structure::par::Par;
use glam::Vec3;

/// Overlap of the sides of an object split, as a fraction of the area of the mesh's box, above which a spatial split is
/// considered. With less (1e-6: more attempts), the room for copies is used up before the splits that matter: the
/// airliner of 5 million has a tenth more references, a SAH cost a seventh higher, and nearly twice the build time.
/// With more, less is gained. Sizes of the same model, and times of rays of queries:
///
/// | overlap | bytes a triangle | primary, ns | shadow, ns | bounce, ns |
/// |---|---|---|---|---|
/// | 3e-4 | 83.7 | 105 | 834 | 1,080 |
/// | 1e-3 | 79.6 | 110 | 881 | 1,135 |
/// | 3e-3 | 71.4 | 112 | 842 | 1,203 |
/// | 4e-3 | 69.4 | | | |
/// | no splits | 59.1 | 149 | 1,036 | 1,730 |
///
/// With more, forests of wires are also half a percent farther from their coverage.
const OVERLAP: f32 = 3e-4;

/// A plane that splits space.
#[derive(Debug, Clone, Copy)]
pub struct SpatialSplit {
    axis: usize,
    plane: f32,
    /// Sum over both sides of half area times references.
    pub cost: f32,
}

/// True if the sides of an object split overlap so much that a spatial split may be better.
pub fn is_worth_a_look(split: &Split, mesh_half_area: f32) -> bool {
    split.left.intersection(split.right).half_area() > OVERLAP * mesh_half_area
}

/// Returns the cheapest plane between bins of equal width, or `None` if there is none.
pub fn find(refs: &[Ref], triangles: &[[Vec3; 3]], bounds: &Bounds, par: &Par) -> Option<SpatialSplit> {
    if refs.len() < FEW {
        find_with::<FEW_BINS>(refs, triangles, bounds, par)
    } else {
        find_with::<BINS>(refs, triangles, bounds, par)
    }
}

fn find_with<const B: usize>(
    refs: &[Ref],
    triangles: &[[Vec3; 3]],
    bounds: &Bounds,
    par: &Par,
) -> Option<SpatialSplit> {
    let grid = Grid::<B>::new(bounds);
    let bins = if refs.len() < PARALLEL {
        chop::bin(refs, triangles, &grid)
    } else {
        let chunks: Vec<&[Ref]> = refs.chunks(PARALLEL / 4).collect();
        let parts = par.map_items(chunks, |c| chop::bin(c, triangles, &grid));
        parts.iter().fold(Bins::EMPTY, Bins::merge)
    };
    let Plane { axis, bin, cost, .. } = bins.cheapest()?;
    Some(SpatialSplit { axis, plane: grid.plane(axis, bin), cost })
}

/// Returns the boxes of the parts of a triangle on either side of a plane, inside `rest`. The box of a side without a
/// part is empty.
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
            // Double precision: the remaining rounding error is far below the slack of box tests.
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

/// Returns the parts of a reference on the left and on the right side.
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
        // Rounding may lose a corner that only touches the plane, but must never lose the triangle.
        (None, None) => (Some(*r), None),
        sides => sides,
    }
}

/// The references of a chunk after the split: left and right, with their extents.
struct Divided {
    refs: [Vec<Ref>; 2],
    extents: [Extents; 2],
}

fn divide(refs: &[Ref], split: &SpatialSplit, triangles: &[[Vec3; 3]]) -> Divided {
    let room = || Vec::with_capacity(refs.len());
    let mut out = Divided { refs: [room(), room()], extents: [Extents::EMPTY; 2] };
    for r in refs {
        let (left, right) = sides(r, split, triangles);
        for (side, r) in [left, right].into_iter().enumerate() {
            if let Some(r) = r {
                out.refs[side].push(r);
                out.extents[side].add(&r);
            }
        }
    }
    out
}

/// Splits the first `len` references of `room`: the left ones come first, the right ones follow. Returns their new
/// number, and the sides. Returns `None` and changes nothing if the room is too small, or if a side would be empty or
/// as large as the whole.
pub fn partition(
    room: &mut [Ref],
    len: usize,
    split: &SpatialSplit,
    triangles: &[[Vec3; 3]],
    par: &Par,
) -> Option<(usize, Sides)> {
    let divided = if len < PARALLEL {
        vec![divide(&room[..len], split, triangles)]
    } else {
        let chunks: Vec<&[Ref]> = room[..len].chunks(PARALLEL / 4).collect();
        par.map_items(chunks, |c| divide(c, split, triangles))
    };
    let [middle, after] = [0, 1].map(|side| divided.iter().map(|d| d.refs[side].len()).sum::<usize>());
    if middle + after > room.len() || [middle, after].iter().any(|&n| n == 0 || n == len) {
        return None;
    }
    let mut at = 0;
    for refs in [0, 1].into_iter().flat_map(|side| divided.iter().map(move |d| &d.refs[side])) {
        room[at..at + refs.len()].copy_from_slice(refs);
        at += refs.len();
    }
    let [left, right] = [0, 1].map(|side| divided.iter().map(|d| d.extents[side]).fold(Extents::EMPTY, Extents::merge));
    Some((at, Sides { middle, left, right }))
}

/// True if spatial splits are likely to pay off: much of the area of the triangles' boxes belongs to long thin
/// triangles.
///
/// A triangle is long and thin if its longest edge is more than `THIN` times the height over it. On scans, which have
/// regular triangles, splits cost memory and build time and gain nothing.
pub fn splits_pay(triangles: &[[Vec3; 3]]) -> bool {
    const THIN: f32 = 8.0;
    const SHARE: f64 = 0.3;
    // A sample of 65,536 triangles or a few more is enough.
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
    use crate::structure::bvh::build::clip::clipped_bounds;
    use proptest::prelude::*;

    fn grid() -> impl Strategy<Value = Vec3> {
        [-4i32..5, -4i32..5, -4i32..5].prop_map(|p| Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        /// Both sides contain the bounds that clipping finds there.
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
