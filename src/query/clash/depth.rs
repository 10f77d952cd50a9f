//! How far the surfaces of two solids reach into each other: the greatest distance from a point of one's surface that
//! is inside of the other to the other's surface, either way.
//!
//! The distance to a surface is 1-Lipschitz: nowhere on a piece is it greater than in the middle plus the distance from
//! there to the farthest corner. And the distance to one triangle is a convex function, so on a piece it is greatest at
//! a corner, and nowhere on the piece is the distance to the surface greater than that. The piece with the greatest
//! bound is divided until no bound exceeds the greatest distance found by more than the tolerance (branch and bound, as
//! for the Hausdorff distance of meshes: Tang, Lee, Kim, "Interactive Hausdorff Distance Computation for General
//! Polygonal Models", ACM Transactions on Graphics 28(3), 2009).

use super::cut::{Polygon, cut_up, halves};
use super::solid::Solid;
use super::through::goes_through;
use crate::geom::distances::error;
use crate::geom::point_triangle;
use crate::math::DBounds;
use glam::DVec3;
use std::collections::BinaryHeap;

/// Pieces that are tried at most for two parts, beside some for each triangle.
const TRIES: usize = 1 << 17;
const TRIES_EACH: usize = 16;
/// Least width of a part of a piece, as a share of its length, with which a division pays: beyond it is rounding.
const SLIVER: f64 = 1.0 / (1 << 20) as f64;

/// How two solids, whose surfaces have common points or of which one is in the other, reach into each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reach {
    /// The depth; 0 if no point of a surface is inside of the other solid.
    pub depth: f64,
    /// The depth is at most this much greater.
    pub error: f64,
    /// World space: the deepest point and the point of the other surface that is nearest to it, in the order of the
    /// solids.
    pub points: [DVec3; 2],
    /// True for each solid of whose surface a point is outside of the other solid, and farther than about the tolerance
    /// from its surface.
    pub is_outside: [bool; 2],
    /// True if one solid goes through the other: its surface outside of the other is in several pieces.
    pub goes_through: bool,
}

/// Two solids, and the tolerance.
pub(super) struct Two<'a> {
    pub solids: [&'a Solid; 2],
    pub tolerance: f64,
}

/// The triangles of one solid beside those whose boxes are away from the other.
#[derive(Default)]
pub(super) struct Sides {
    /// Triangles that the other surface cuts into pieces, in order.
    pub cut: Vec<u32>,
    /// Other triangles inside of the other solid, in order.
    pub inside: Vec<u32>,
    /// Pieces outside, unless some point is known to be far outside.
    outside: Vec<Polygon>,
}

/// A piece of a solid's surface, in the frame of the other solid.
struct Piece {
    corners: Polygon,
    /// The solid whose surface it is on.
    of: usize,
    /// Bound of the distances of its points from the surface of the other solid.
    upper: f64,
    /// A point of a plane along which it pays to divide the piece, and its normal.
    across: [DVec3; 2],
}

impl PartialEq for Piece {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Piece {}
impl PartialOrd for Piece {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Piece {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.upper.total_cmp(&other.upper)
    }
}

/// The greatest distance so far, and a bound of what is left aside.
struct Search<'a> {
    two: &'a Two<'a>,
    heap: BinaryHeap<Piece>,
    best: f64,
    /// The solid whose surface has the deepest point, that point and its nearest, in the frame of the other solid.
    at: Option<(usize, [DVec3; 2])>,
    /// Bound of the rounding error of `best`.
    rounding: f64,
    /// The greatest bound of pieces that are left aside.
    left: f64,
    /// A bound that is no more than this above the best is near enough.
    tolerance: f64,
    /// So is a bound up to this, while the best is not above it.
    enough: f64,
    tries: usize,
}

impl Two<'_> {
    /// What to add to a point of the frame of solid `of` for the frame of the other.
    pub fn shift(&self, of: usize) -> DVec3 {
        self.solids[of].origin - self.solids[1 - of].origin
    }

    /// Finds the depth, as far as [`TRIES`] pieces go.
    pub fn reach(&self) -> Reach {
        let triangles: usize = self.solids.iter().map(|s| s.triangles.len()).sum();
        let tries = TRIES + TRIES_EACH * triangles;
        let mut search = Search { enough: self.tolerance, ..Search::new(self, self.tolerance, 0.0, tries) };
        let [(is_outside_a, a), (is_outside_b, b)] = [0, 1].map(|of| self.sides(of, &mut search));
        search.finish(f64::INFINITY);
        let of_point = |of: usize, p: DVec3| p + self.solids[of].origin;
        let points = search.at.map_or([DVec3::ZERO; 2], |(of, [p, q])| {
            let [p, q] = [of_point(1 - of, p), of_point(1 - of, q)];
            if of == 0 { [p, q] } else { [q, p] }
        });
        let is_outside =
            [is_outside_a || self.is_far_outside(0, &a, tries), is_outside_b || self.is_far_outside(1, &b, tries)];
        let is_deep = search.best > self.tolerance;
        let goes_through =
            is_deep && is_outside == [true; 2] && (goes_through(self, 0, &a) || goes_through(self, 1, &b));
        let error = (search.upper() - search.best).max(0.0) + search.rounding;
        Reach { depth: search.best, error, points, is_outside, goes_through }
    }

    /// Sorts the triangles of a solid by their sides of the other one, and adds the pieces inside to the search. The
    /// first result is true if a point is known to be far outside.
    fn sides(&self, of: usize, search: &mut Search) -> (bool, Sides) {
        let (own, other, shift) = (self.solids[of], self.solids[1 - of], self.shift(of));
        let grown = |by: f64| DBounds { min: other.bounds.min - by, max: other.bounds.max + by };
        let mut is_outside = !grown(self.tolerance).contains(&moved(&own.bounds, shift));
        let (mut sides, within) = (Sides::default(), grown(0.0));
        let mut indices = Vec::new();
        own.near(&moved(&within, -shift), |index| {
            indices.push(index);
            true
        });
        // In order, so that the result does not depend on the way through the tree.
        indices.sort_unstable();
        for index in indices {
            let triangle = own.triangles[index as usize].map(|p| p + shift);
            let pieces = cut_up(&triangle, other, self.tolerance);
            let is_whole = pieces.len() == 1;
            if !is_whole {
                sides.cut.push(index);
            }
            for piece in pieces {
                if other.holds(middle(&piece)) {
                    if is_whole {
                        sides.inside.push(index);
                    }
                    search.add(of, piece);
                } else if !is_outside {
                    is_outside = piece.iter().any(|&p| !grown(self.tolerance).contains(&DBounds { min: p, max: p }));
                    sides.outside.push(piece);
                }
            }
        }
        if is_outside {
            sides.outside = Vec::new();
        }
        (is_outside, sides)
    }

    /// True if a point of the pieces outside is farther than about the tolerance from the other surface: it may be so
    /// up to one and a half of it.
    fn is_far_outside(&self, of: usize, sides: &Sides, tries: usize) -> bool {
        let mut search = Search::new(self, 0.5 * self.tolerance, self.tolerance, tries);
        for piece in &sides.outside {
            search.add(of, piece.clone());
            if search.best > self.tolerance {
                return true;
            }
        }
        search.finish(self.tolerance);
        search.best > self.tolerance
    }
}

impl<'a> Search<'a> {
    fn new(two: &'a Two<'a>, tolerance: f64, least: f64, tries: usize) -> Self {
        let (heap, at) = (BinaryHeap::new(), None);
        Self { two, heap, best: least, at, rounding: 0.0, left: 0.0, tolerance, enough: 0.0, tries }
    }

    /// Pieces with bounds up to this are left aside.
    fn settled(&self) -> f64 {
        // Whether the depth is above the tolerance is decided to a sixteenth of it.
        let near = if self.best > self.enough { self.tolerance } else { self.tolerance / 16.0 };
        (self.best + near).max(self.enough)
    }

    /// Tries a piece: its middle, and its corner that is farthest from the triangle nearest to the middle.
    fn add(&mut self, of: usize, corners: Polygon) {
        let other = self.two.solids[1 - of];
        let centre = middle(&corners);
        let Some((near, index)) = other.nearest(centre) else { return };
        self.tries = self.tries.saturating_sub(1);
        let farthest = corners.iter().map(|p| p.distance(centre)).fold(0.0, f64::max);
        let triangle = &other.triangles[index as usize];
        let at_corner = |p: &DVec3| (point_triangle(*p, triangle).bounds()[1], *p);
        let corner = corners.iter().map(at_corner).max_by(|a, b| a.0.total_cmp(&b.0));
        let (greatest, corner) = corner.unwrap_or((f64::INFINITY, centre));
        self.offer(of, centre, &near);
        // The corners of pieces have errors of a few roundings.
        let upper = (near.bounds()[1] + farthest).min(greatest) + near.error;
        if upper <= self.settled() {
            self.left = self.left.max(upper);
            return;
        }
        let Some((of_corner, _)) = other.nearest(corner) else { return };
        self.offer(of, corner, &of_corner);
        let across =
            beyond(corner, triangle).unwrap_or_else(|| between([centre, near.point], [corner, of_corner.point]));
        self.heap.push(Piece { corners, of, upper, across });
    }

    fn offer(&mut self, of: usize, p: DVec3, near: &crate::geom::Nearest) {
        let distance = near.squared.sqrt();
        if distance > self.best {
            (self.best, self.at, self.rounding) = (distance, Some((of, [p, near.point])), 2.0 * near.error);
        }
    }

    /// Divides pieces until none may be deeper than the best by more than the tolerance, the best exceeds `enough`, or
    /// all tries are used up.
    fn finish(&mut self, enough: f64) {
        while let Some(piece) = self.heap.pop() {
            if piece.upper <= self.settled() || self.tries == 0 || self.best > enough {
                // No other piece has a greater bound.
                self.left = self.left.max(piece.upper);
                return;
            }
            for half in divided(&piece) {
                self.add(piece.of, half);
            }
        }
    }

    /// Bound of all distances.
    fn upper(&self) -> f64 {
        self.left.max(self.best)
    }
}

/// The mean of the corners.
fn middle(corners: &[DVec3]) -> DVec3 {
    corners.iter().sum::<DVec3>() / corners.len() as f64
}

/// A plane through an edge of a triangle, across its plane: the one that a point is farthest beyond. `None` if the
/// point is above or below the triangle.
fn beyond(p: DVec3, triangle: &[DVec3; 3]) -> Option<[DVec3; 2]> {
    let normal = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
    let edges = [0, 1, 2].map(|i| {
        let outward = (triangle[(i + 1) % 3] - triangle[i]).cross(normal).normalize_or_zero();
        (outward.dot(p - triangle[i]), [triangle[i], outward])
    });
    let (height, plane) = edges.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    (height > error(triangle.iter().copied().chain([p]))).then_some(plane)
}

/// A plane whose points are equally far from two planes: each goes through the second point of a pair and faces the
/// first. A point of it, and its normal.
fn between([p, q]: [DVec3; 2], [r, s]: [DVec3; 2]) -> [DVec3; 2] {
    let (m, n) = ((p - q).normalize_or_zero(), (r - s).normalize_or_zero());
    let normal = m - n;
    [p + normal * ((n.dot(p - s) - m.dot(p - q)) / normal.length_squared()), normal.normalize_or_zero()]
}

/// Both halves of a piece. The distance to one triangle bounds that to the surface well on one side of an edge, or of a
/// middle line between two faces, and the distance to another on the other side: so a piece is divided there, and else
/// across the longest way between two of its corners.
fn divided(piece: &Piece) -> [Polygon; 2] {
    let ([at, normal], corners) = (piece.across, &piece.corners);
    let pairs = corners.iter().enumerate().flat_map(|(i, p)| corners[..i].iter().map(move |q| (*p, *q)));
    let longest = pairs.max_by(|a, b| a.0.distance_squared(a.1).total_cmp(&b.0.distance_squared(b.1)));
    let (p, q) = longest.unwrap_or_default();
    let heights = corners.iter().map(|&p| normal.dot(p - at));
    let (low, high) = heights.fold((0.0f64, 0.0f64), |(low, high), x| (low.min(x), high.max(x)));
    let least = p.distance(q) * SLIVER;
    if low < -least && high > least { halves(corners, at, normal) } else { halves(corners, (p + q) * 0.5, q - p) }
}

fn moved(b: &DBounds, by: DVec3) -> DBounds {
    DBounds { min: b.min + by, max: b.max + by }
}
