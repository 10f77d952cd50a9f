//! The relation of two triangles and their common points, by exact signs alone: no tolerance is anywhere.
//!
//! Triangles are closed sets of points, and may be degenerate: segments or points. Two triangles in general position
//! meet in the line in which their planes cross; each cuts a segment out of it, and the order of the ends of the two
//! segments is the sign of a volume (Guigue, Devillers, "Fast and Robust Triangle-Triangle Overlap Test Using
//! Orientation Predicates", Journal of Graphics Tools 8(1), 2003; with all cases of contact told apart).
//!
//! Answers are the same for (A, B) and (B, A) and for any order of the corners.

use super::flat;
use super::signs::{Plane, place_on_plane, side};
use glam::DVec3;

/// The way in which two triangles meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Relation {
    /// No point is in both.
    Apart,
    /// They touch, and their common points are exactly their common corner, or the edge between two common corners, as
    /// those of neighbours in a mesh are. Corners are common if their coordinates are equal.
    Adjacent,
    /// Points are in both, but neither passes properly through the other, and they do not overlap in a plane: a corner
    /// on a face, an edge on an edge, a face on one side of an edge, coplanar triangles with common borders only.
    Touching,
    /// They are in one plane, and their interiors overlap. Neither is degenerate.
    Coplanar,
    /// One of them has points strictly on both sides of the plane of the other, next to a common point that is in the
    /// other's relative interior. If neither is degenerate, this is so for both: they have a segment in common whose
    /// points, except the ends, are in both interiors. Triangles with an edge in the plane of the other touch at most.
    Crossing,
}

/// The relation of two triangles with finite corners.
pub fn relate(a: &[DVec3; 3], b: &[DVec3; 3]) -> Relation {
    match cut(a, b) {
        Cut::Apart => Relation::Apart,
        Cut::Flat => flat::relate(a, b),
        Cut::Chords(chords) if chords.is_proper => Relation::Crossing,
        Cut::Chords(chords) => match common_corners(a, b) {
            0 => Relation::Touching,
            // The common corner is an end of both segments, or all of one.
            1 if chords.is_end => Relation::Adjacent,
            1 => Relation::Touching,
            // A triangle has no points of the line of its edge but the edge.
            _ => Relation::Adjacent,
        },
    }
}

/// The number of points that are corners of both; neither triangle has two equal corners.
fn common_corners(a: &[DVec3; 3], b: &[DVec3; 3]) -> usize {
    a.iter().filter(|&p| b.contains(p)).count()
}

/// Ends of the common points of two triangles; `None` if they are apart.
///
/// The ends of the common segment, equal if it is one point; of an overlap in a plane, two of its corners that are
/// farthest from each other. The end that is less in x, or if equal in y or z, comes first. Corners are exact; other
/// coordinates have errors of at most 2^-40 of the triangles' extent along the axis, and 2^-52 of themselves.
pub fn meeting(a: &[DVec3; 3], b: &[DVec3; 3]) -> Option<[DVec3; 2]> {
    let (a, b) = in_order(a, b);
    match cut(&a, &b) {
        Cut::Apart => None,
        Cut::Flat => flat::meeting(&a, &b),
        Cut::Chords(chords) => Some(ordered(chords.common())),
    }
}

/// Orders points by x, then y, then z: on a line, this is their order along it.
#[inline]
pub(super) fn is_before(a: DVec3, b: DVec3) -> bool {
    if a.x != b.x {
        a.x < b.x
    } else if a.y != b.y {
        a.y < b.y
    } else {
        a.z < b.z
    }
}

/// Two points, the lesser one first.
#[inline]
pub(super) fn ordered([a, b]: [DVec3; 2]) -> [DVec3; 2] {
    if is_before(b, a) { [b, a] } else { [a, b] }
}

/// A triangle with its corners in ascending order, and without negative zeros.
#[inline]
pub(super) fn sorted(t: &[DVec3; 3]) -> [DVec3; 3] {
    let [a, b] = ordered([t[0] + 0.0, t[1] + 0.0]);
    let [b, c] = ordered([b, t[2] + 0.0]);
    let [a, b] = ordered([a, b]);
    [a, b, c]
}

/// Two triangles and their corners in an order that depends on the set of points only: so does what is rounded.
pub(super) fn in_order(a: &[DVec3; 3], b: &[DVec3; 3]) -> ([DVec3; 3], [DVec3; 3]) {
    let (a, b) = (sorted(a), sorted(b));
    let first = (0..3).find(|&i| a[i] != b[i]);
    if first.is_some_and(|i| is_before(b[i], a[i])) { (b, a) } else { (a, b) }
}

/// Two triangles and the line in which their planes cross.
enum Cut<'a> {
    Apart,
    /// One is degenerate, or they are in one plane.
    Flat,
    /// The line cuts a segment out of each, and the two meet.
    Chords(Chords<'a>),
}

struct Chords<'a> {
    triangles: [&'a [DVec3; 3]; 2],
    /// An order of the corners of each triangle: the first is alone on its side of the plane of the other. Along the
    /// line, the first triangle ends on its edges from corner 0 to 2 and from 0 to 1, the second on 0 to 1 and 0 to 2.
    orders: [[usize; 3]; 2],
    /// The sides of the corners relative to the plane of the other triangle.
    sides: [[i32; 3]; 2],
    /// They meet in an end of both, which is their only common point.
    is_end: bool,
    /// Both triangles are strictly on both sides of the plane of the other, and share a segment.
    is_proper: bool,
}

/// True if all sides are the same, and not zero.
#[inline(always)]
fn is_aside(sides: [i32; 3]) -> bool {
    (sides[0] + sides[1] + sides[2]).abs() == 3
}

#[inline(always)]
fn cut<'a>(a: &'a [DVec3; 3], b: &'a [DVec3; 3]) -> Cut<'a> {
    let of_a = Plane::new(b).sides(a);
    if is_aside(of_a) {
        return Cut::Apart;
    }
    if of_a == [0; 3] {
        return Cut::Flat;
    }
    let of_b = Plane::new(a).sides(b);
    if is_aside(of_b) {
        return Cut::Apart;
    }
    if of_b == [0; 3] {
        return Cut::Flat;
    }
    // A triangle with two corners swapped faces the other way: each must see the other's corner alone above it.
    let (alone_a, alone_b) = (alone(of_a), alone(of_b));
    let (order_a, order_b) = (order(alone_a.corner, alone_b.is_above), order(alone_b.corner, alone_a.is_above));
    let ([p, q, r], [k, l, m]) = (order_a, order_b);
    let first = side([a[p], a[q], b[k], b[l]]);
    if first > 0 {
        return Cut::Apart;
    }
    let last = side([a[p], a[r], b[m], b[k]]);
    if last > 0 {
        return Cut::Apart;
    }
    let is_end = first == 0 || last == 0;
    let is_proper = !is_end && is_split(of_a) && is_split(of_b);
    let (triangles, orders, sides) = ([a, b], [order_a, order_b], [of_a, of_b]);
    Cut::Chords(Chords { triangles, orders, sides, is_end, is_proper })
}

/// True if corners are strictly on both sides.
#[inline(always)]
fn is_split(sides: [i32; 3]) -> bool {
    sides.contains(&1) && sides.contains(&-1)
}

/// A corner from which the line to each of the others meets the plane in one point: it is strictly on one side and the
/// others are not, or it is on the plane and the others are not.
#[derive(Clone, Copy)]
struct Alone {
    corner: usize,
    /// It is above the plane, or the others are below.
    is_above: bool,
}

/// [`Alone`] for all sides that three corners may have.
const ALONE: [Alone; 27] = {
    let mut table = [Alone { corner: 0, is_above: false }; 27];
    let mut code = 0;
    while code < 27 {
        let sides = [code as i32 / 9 - 1, code as i32 / 3 % 3 - 1, code as i32 % 3 - 1];
        let mut i = 0;
        while i < 3 {
            let (one, next, last) = (sides[i], sides[(i + 1) % 3], sides[(i + 2) % 3]);
            if one * next <= 0 && one * last <= 0 && (one != 0 || next * last > 0) {
                table[code] = Alone { corner: i, is_above: one > 0 || (one == 0 && next < 0) };
            }
            i += 1;
        }
        code += 1;
    }
    table
};

#[inline(always)]
fn alone(sides: [i32; 3]) -> Alone {
    ALONE[((sides[0] + 1) * 9 + (sides[1] + 1) * 3 + sides[2] + 1) as usize % 27]
}

/// The corners from `first` on, the others swapped unless `is_kept`.
#[inline(always)]
fn order(first: usize, is_kept: bool) -> [usize; 3] {
    let (next, last) = ([1, 2, 0][first], [2, 0, 1][first]);
    if is_kept { [first, next, last] } else { [first, last, next] }
}

impl Chords<'_> {
    /// The ends of the common segment.
    fn common(&self) -> [DVec3; 2] {
        let ([a, b], [[p, q, r], [k, l, m]]) = (self.triangles, self.orders);
        // The greater of the first ends, and the lesser of the last.
        let start = if side([a[p], a[r], b[k], b[l]]) > 0 { self.end(1, 1) } else { self.end(0, 2) };
        if self.is_end {
            return [start; 2];
        }
        [start, if side([a[p], a[q], b[k], b[m]]) < 0 { self.end(1, 2) } else { self.end(0, 1) }]
    }

    /// The point in which an edge from the first corner meets the plane of the other triangle.
    fn end(&self, triangle: usize, to: usize) -> DVec3 {
        let (t, order) = (self.triangles[triangle], self.orders[triangle]);
        let (from, to) = (order[0], order[to]);
        match (self.sides[triangle][from], self.sides[triangle][to]) {
            (0, _) => t[from],
            (_, 0) => t[to],
            _ => between(t[from], t[to], place_on_plane(self.triangles[1 - triangle], t[from], t[to])),
        }
    }
}

/// The point of a segment at a place from 0 to 1, inside the box of its ends.
pub(super) fn between(from: DVec3, to: DVec3, place: f64) -> DVec3 {
    (from + (to - from) * place).max(from.min(to)).min(from.max(to))
}
