//! A triangle cut where the surface of a solid crosses it, so that each piece is on one side of the surface, but for
//! rounding; and along the edges of triangles that lie in its plane up to a tolerance, so that each piece that lies on
//! such a triangle lies on one only.

use super::solid::{Solid, around};
use crate::geom::distances::error;
use glam::DVec3;

/// A convex polygon.
pub(super) type Polygon = Vec<DVec3>;

/// A segment in the plane of the triangle, and a normal of the plane across that it is cut along.
struct Cut {
    ends: [DVec3; 2],
    across: DVec3,
}

/// Returns the pieces of a triangle, which is given in the frame of the solid; one if nothing cuts it.
pub(super) fn cut_up(triangle: &[DVec3; 3], solid: &Solid, tolerance: f64) -> Vec<Polygon> {
    let whole = || vec![triangle.to_vec()];
    let normal = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]).normalize_or_zero();
    if normal == DVec3::ZERO {
        return whole();
    }
    let mut bounds = around(std::slice::from_ref(triangle));
    (bounds.min, bounds.max) = (bounds.min - tolerance, bounds.max + tolerance);
    let mut cuts = Vec::new();
    solid.near(&bounds, |index| {
        let other = &solid.triangles[index as usize];
        let slack = error(triangle.iter().chain(other).copied());
        cuts_of(triangle[0], normal, other, slack, slack.max(tolerance), &mut cuts);
        true
    });
    if cuts.is_empty() {
        return whole();
    }
    let slack = error(*triangle);
    let (mut left, mut pieces) = (vec![(triangle.to_vec(), cuts.iter().collect::<Vec<&Cut>>())], Vec::new());
    while let Some((piece, mut cuts)) = left.pop() {
        cuts.retain(|cut| cut.meets(&piece, normal, slack));
        let Some(cut) = cuts.pop() else {
            pieces.push(piece);
            continue;
        };
        let [low, high] = halves(&piece, cut.ends[0], cut.across);
        left.extend([(low, cuts.clone()), (high, cuts)]);
    }
    pieces
}

/// Adds the segments along which `other` cuts the plane through `at`.
fn cuts_of(at: DVec3, normal: DVec3, other: &[DVec3; 3], slack: f64, flat: f64, cuts: &mut Vec<Cut>) {
    let snapped = |h: f64| if h.abs() <= slack { 0.0 } else { h };
    let heights = other.map(|p| normal.dot(p - at));
    let mut add = |ends: [DVec3; 2]| {
        let across = normal.cross(ends[1] - ends[0]).normalize_or_zero();
        if across != DVec3::ZERO {
            cuts.push(Cut { ends, across });
        }
    };
    if heights.iter().all(|h| h.abs() <= flat) {
        let flat = [0, 1, 2].map(|i| other[i] - normal * heights[i]);
        return (0..3).for_each(|i| add([flat[i], flat[(i + 1) % 3]]));
    }
    let heights = heights.map(snapped);
    let mut ends = Vec::with_capacity(3);
    for (i, j) in [(0, 1), (1, 2), (2, 0)] {
        if heights[i] == 0.0 {
            ends.push(other[i]);
        } else if heights[i] * heights[j] < 0.0 {
            ends.push(other[i] + (other[j] - other[i]) * (heights[i] / (heights[i] - heights[j])));
        }
    }
    if let [a, b] = ends[..] {
        add([a, b]);
    }
}

impl Cut {
    /// True if the segment divides the inside of a piece.
    fn meets(&self, piece: &[DVec3], normal: DVec3, slack: f64) -> bool {
        let (low, high) = piece.iter().fold((0.0f64, 0.0f64), |(low, high), &p| {
            let h = self.across.dot(p - self.ends[0]);
            (low.min(h), high.max(h))
        });
        if low >= -slack || high <= slack {
            return false;
        }
        // The part of the segment that is inside of all edges.
        let (mut from, mut to) = (0.0f64, 1.0f64);
        let way = self.ends[1] - self.ends[0];
        for (i, &p) in piece.iter().enumerate() {
            let edge = piece[(i + 1) % piece.len()] - p;
            if edge.length_squared() <= slack * slack {
                // Its direction is rounding; both ends are on other edges.
                continue;
            }
            let inward = normal.cross(edge).normalize_or_zero();
            let (height, rise) = (inward.dot(self.ends[0] - p) - slack, inward.dot(way));
            if rise > 0.0 {
                from = from.max(-height / rise);
            } else if rise < 0.0 {
                to = to.min(-height / rise);
            } else if height < 0.0 {
                return false;
            }
        }
        (to - from) * way.length() > slack
    }
}

/// Both parts of a convex polygon, below and above a plane that divides it.
pub(super) fn halves(piece: &[DVec3], at: DVec3, across: DVec3) -> [Polygon; 2] {
    let (mut low, mut high) = (Vec::with_capacity(piece.len() + 1), Vec::with_capacity(piece.len() + 1));
    let height = |p: DVec3| across.dot(p - at);
    for (i, &p) in piece.iter().enumerate() {
        let q = piece[(i + 1) % piece.len()];
        let (h, next) = (height(p), height(q));
        if h <= 0.0 {
            low.push(p);
        }
        if h >= 0.0 {
            high.push(p);
        }
        if h * next < 0.0 {
            let between = p + (q - p) * (h / (h - next));
            low.push(between);
            high.push(between);
        }
    }
    [low, high]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::point_triangle;
    use glam::DQuat;

    /// A square in a turned plane, of triangles of one grid cut at those of another: each piece lies on one triangle.
    #[test]
    fn pieces_lie_on_one_triangle() {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.8, 1.1);
        let square = |count: usize, at: f64| -> Vec<[DVec3; 3]> {
            let corner = |i: usize, j: usize| {
                let of = |k: usize| at + 2.0 * k as f64 / count as f64;
                turn * DVec3::new(of(i), of(j), 0.0)
            };
            let cells = (0..count * count).map(|k| (k % count, k / count));
            cells
                .flat_map(|(i, j)| {
                    let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                    [[a, b, c], [a, c, d]]
                })
                .collect()
        };
        for (first, second, at) in [(1, 2, 0.0), (2, 1, 0.0), (3, 2, 0.0), (2, 5, 0.25), (1, 8, -0.75)] {
            let (own, other) = (square(first, 0.0), Solid::new(DVec3::ZERO, square(second, at), true));
            for t in own {
                let pieces = cut_up(&t, &other, 1e-6);
                let area = |p: &[DVec3]| -> f64 {
                    (1..p.len() - 1).map(|i| 0.5 * (p[i] - p[0]).cross(p[i + 1] - p[0]).length()).sum()
                };
                let whole: f64 = pieces.iter().map(|p| area(p)).sum();
                assert!((whole - area(&t)).abs() < 1e-12);
                for piece in pieces {
                    let far = |u: &[DVec3; 3]| piece.iter().map(|p| point_triangle(*p, u).squared).fold(0.0, f64::max);
                    let best = other.triangles.iter().map(far).fold(f64::INFINITY, f64::min);
                    let middle = piece.iter().sum::<DVec3>() / piece.len() as f64;
                    let is_on = other.triangles.iter().any(|u| point_triangle(middle, u).squared < 1e-24);
                    assert!(!is_on || best < 1e-24, "{first} {second} {at}: {piece:?} {best}");
                }
            }
        }
    }
}
