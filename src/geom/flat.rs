//! Pairs of triangles in one plane, and pairs with degenerate triangles: segments and points.
//!
//! The common points of two convex sets are the hull of the corners of each that are in the other, and of the points in
//! which edges cross. Signs of areas are taken of projections along an axis along which the plane does not vanish.

use super::pairs::{Relation, between, is_before, ordered};
use super::signs::{open_axis, place_on_line, place_on_plane, side, turn};
use glam::DVec3;

/// A closed convex set: the hull of one, two or three corners that are on no common line.
#[derive(Debug, Clone, Copy)]
struct Shape {
    corners: [DVec3; 3],
    count: usize,
    /// If it has three corners, an axis along which their projections are not on a line.
    axis: usize,
}

impl Shape {
    fn new(corners: &[DVec3; 3]) -> Self {
        if let Some(axis) = open_axis(corners) {
            return Self { corners: *corners, count: 3, axis };
        }
        let [a, b, c] = *corners;
        let least = [b, c].into_iter().fold(a, |p, q| ordered([p, q])[0]);
        let greatest = [b, c].into_iter().fold(a, |p, q| ordered([p, q])[1]);
        Self { corners: [least, greatest, greatest], count: if least == greatest { 1 } else { 2 }, axis: 0 }
    }

    fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    fn edges(&self) -> impl Iterator<Item = [DVec3; 2]> + use<> {
        let (corners, count) = (self.corners, [0, 0, 1, 3][self.count]);
        (0..count).map(move |i| [corners[i], corners[(i + 1) % 3]])
    }

    fn contains(&self, point: DVec3) -> bool {
        let [a, b, c] = self.corners;
        match self.count {
            1 => point == a,
            2 => {
                let is_inside = !is_before(point, a) && !is_before(b, point);
                is_inside && open_axis(&[a, b, point]).is_none()
            }
            _ => side([a, b, c, point]) == 0 && has_one_sign(turns(self.axis, &self.corners, point)),
        }
    }

    /// The point in which a segment passes through the inside, with its ends strictly on both sides of the plane.
    fn pierced_by(&self, [p, q]: [DVec3; 2]) -> Option<DVec3> {
        let [a, b, c] = self.corners;
        if self.count < 3 || side([a, b, c, p]) * side([a, b, c, q]) >= 0 {
            return None;
        }
        let around = [side([p, q, a, b]), side([p, q, b, c]), side([p, q, c, a])];
        let is_inside = has_one_sign(around) && !around.contains(&0);
        is_inside.then(|| between(p, q, place_on_plane(&self.corners, p, q)))
    }
}

fn has_one_sign(signs: [i32; 3]) -> bool {
    signs.iter().all(|&s| s >= 0) || signs.iter().all(|&s| s <= 0)
}

fn turns(axis: usize, [a, b, c]: &[DVec3; 3], point: DVec3) -> [i32; 3] {
    [turn(axis, [*a, *b, point]), turn(axis, [*b, *c, point]), turn(axis, [*c, *a, point])]
}

fn are_boxes_apart(a: &[DVec3; 3], b: &[DVec3; 3]) -> bool {
    let span = |t: &[DVec3; 3]| (t[0].min(t[1]).min(t[2]), t[0].max(t[1]).max(t[2]));
    let ((low_a, high_a), (low_b, high_b)) = (span(a), span(b));
    low_a.cmpgt(high_b).any() || low_b.cmpgt(high_a).any()
}

/// The relation of two triangles that are in one plane, or one of which is degenerate.
#[inline(never)]
pub(super) fn relate(a: &[DVec3; 3], b: &[DVec3; 3]) -> Relation {
    if are_boxes_apart(a, b) {
        return Relation::Apart;
    }
    // Of a degenerate triangle, also a corner between two others.
    let is_common = |p: &DVec3| a.contains(p) && b.contains(p);
    let is_joined = a.iter().any(is_common);
    let (a, b) = (Shape::new(a), Shape::new(b));
    if a.count == 3 && b.count == 3 {
        match split(&a, &b).min(split(&b, &a)) {
            Split::Strict => return Relation::Apart,
            Split::None => return Relation::Coplanar,
            Split::Touching if !is_joined => return Relation::Touching,
            Split::Touching => {}
        }
    }
    let common = common(&a, &b);
    let Some([first, last]) = common.ends() else { return Relation::Apart };
    if common.is_pierced {
        return Relation::Crossing;
    }
    // Two segments that cross have one point in common.
    let is_one_point = is_joined && a.count == 2 && b.count == 2 && !common.is_exact;
    // Otherwise the common points are on a line. If both ends are common corners, they are the hull of these.
    if is_one_point || common.is_exact && is_common(&first) && is_common(&last) {
        Relation::Adjacent
    } else {
        Relation::Touching
    }
}

/// How well an edge of a triangle separates it from another in its plane.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
enum Split {
    /// All corners of the other are strictly outside.
    Strict,
    /// They are outside or on the line of the edge.
    Touching,
    None,
}

/// The best of the edges of `a`.
fn split(a: &Shape, b: &Shape) -> Split {
    let inward = turn(a.axis, a.corners);
    let mut best = Split::None;
    for edge in a.edges() {
        let sides = b.corners.map(|p| turn(a.axis, [edge[0], edge[1], p]) * inward);
        match sides.into_iter().max() {
            Some(-1) => return Split::Strict,
            Some(0) => best = Split::Touching,
            _ => {}
        }
    }
    best
}

/// Points of which the common points of two shapes are the hull.
struct Common {
    /// Each triangle has three corners, and each of its edges crosses two edges of the other.
    points: [DVec3; 12],
    count: usize,
    /// All points are corners, not rounded.
    is_exact: bool,
    /// A segment passes through the inside of a triangle.
    is_pierced: bool,
}

impl Common {
    fn push(&mut self, point: DVec3) {
        if self.count < self.points.len() && !self.points[..self.count].contains(&point) {
            self.points[self.count] = point;
            self.count += 1;
        }
    }

    /// The ends of points on a line.
    fn ends(&self) -> Option<[DVec3; 2]> {
        let points = &self.points[..self.count];
        let first = *points.first()?;
        // Lengths are rounded, the order of exact points is not.
        let [least, greatest] = [0, 1].map(|end| points.iter().fold(first, |p, q| ordered([p, *q])[end]));
        Some([least, greatest])
    }

    /// Two points that are farthest from each other.
    fn farthest(&self) -> Option<[DVec3; 2]> {
        let points = &self.points[..self.count];
        let mut best = ([*points.first()?; 2], 0.0);
        for (i, p) in points.iter().enumerate() {
            for q in &points[..i] {
                let length = p.distance(*q);
                if length > best.1 {
                    best = ([*p, *q], length);
                }
            }
        }
        Some(ordered(best.0))
    }
}

fn common(a: &Shape, b: &Shape) -> Common {
    let mut found = Common { points: [DVec3::ZERO; 12], count: 0, is_exact: true, is_pierced: false };
    for (one, other) in [(a, b), (b, a)] {
        one.corners().iter().filter(|p| other.contains(**p)).for_each(|p| found.push(*p));
        for point in one.edges().filter_map(|edge| other.pierced_by(edge)) {
            found.push(point);
            (found.is_exact, found.is_pierced) = (false, true);
        }
    }
    for edge in a.edges() {
        for point in b.edges().filter_map(|other| crossing(edge, other)) {
            found.push(point);
            found.is_exact = false;
        }
    }
    found
}

/// The point in which two segments cross: both have ends strictly on both sides of the line of the other.
fn crossing([p, q]: [DVec3; 2], [r, s]: [DVec3; 2]) -> Option<DVec3> {
    let axis = open_axis(&[p, q, r])?;
    let is_crossed = turn(axis, [p, q, r]) * turn(axis, [p, q, s]) < 0
        && turn(axis, [r, s, p]) * turn(axis, [r, s, q]) < 0
        && side([p, q, r, s]) == 0;
    is_crossed.then(|| between(p, q, place_on_line(axis, [r, s], p, q)))
}

/// Ends of the common points, as [`super::pairs::meeting`]; the triangles are as for [`relate`].
pub(super) fn meeting(a: &[DVec3; 3], b: &[DVec3; 3]) -> Option<[DVec3; 2]> {
    if are_boxes_apart(a, b) {
        return None;
    }
    let (a, b) = (Shape::new(a), Shape::new(b));
    let common = common(&a, &b);
    let is_area = a.count == 3 && b.count == 3 && split(&a, &b).min(split(&b, &a)) == Split::None;
    if is_area { common.farthest() } else { common.ends() }
}
