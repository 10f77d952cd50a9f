//! The exact test of a line against the triangles of a mesh: a line crosses a closed surface as often as it enters and
//! leaves it, also where it meets edges and corners.
//!
//! The corners are projected along the line to points in a plane, with the line at zero. The projection of a corner
//! depends on the line and the corner alone, so that all triangles around a corner see the same point. The signs of the
//! edge functions of projected points are exact. If one is zero, the line meets an edge; it is then taken at (e, e²)
//! instead of (0, 0), with an infinitesimal e > 0 (Edelsbrunner, Mücke, "Simulation of Simplicity", ACM Transactions on
//! Graphics 9(1), 1990). That point is on no edge, so it is inside exactly those triangles that a line next to this one
//! crosses: of two triangles that share an edge it crosses one if they are side by side, and both or none at a
//! silhouette. Triangles parallel to the line are never crossed.
//!
//! Products and differences of the projection are rounded, which moves the corners by a few roundings, for all
//! triangles alike. They are exact if coordinates and direction have few digits.

use super::signs;
use glam::DVec3;

/// The side of a triangle that a line meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Side {
    /// The side from which the corners appear counter-clockwise: the line enters a solid whose triangles face outward.
    Front = 1,
    /// The other side: the line leaves such a solid.
    Back = 2,
}

/// A line, prepared for the test.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// Permutation of the axes: the last is the one along which the direction is greatest.
    axes: [usize; 3],
    origin: DVec3,
    /// The direction, scaled by a power of two so that its greatest component is about 1.
    dir: DVec3,
}

impl Line {
    /// Prepares a direction whose components are finite and not all zero.
    pub fn new(origin: DVec3, dir: DVec3) -> Self {
        let size = dir.abs();
        let last = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let scale = 0.5f64.powi(size[last].log2().floor().clamp(-1000.0, 1000.0) as i32);
        Self { axes: [(last + 1) % 3, (last + 2) % 3, last], origin, dir: dir * scale }
    }

    /// The side of the triangle that the line crosses; `None` if it passes by.
    #[inline]
    pub fn crosses(&self, corners: &[DVec3; 3]) -> Option<Side> {
        let [a, b, c] = corners.map(|corner| self.project(corner));
        let apart = |axis: usize| {
            let (least, greatest) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
            // The line is at e or e² on this axis.
            least > 0.0 || greatest <= 0.0
        };
        if apart(0) || apart(1) {
            return None;
        }
        let turns_left = is_left(a, b)?;
        if is_left(b, c)? != turns_left || is_left(c, a)? != turns_left {
            return None;
        }
        // The projection keeps the orientation that the corners have as seen from the end of the last axis.
        Some(if turns_left == (self.dir[self.axes[2]] < 0.0) { Side::Front } else { Side::Back })
    }

    /// True if the crossing of a triangle that the line crosses with this side is not behind the line's origin. Exact.
    #[inline]
    pub fn is_ahead(&self, corners: &[DVec3; 3], side: Side) -> bool {
        let of_origin = signs::side([corners[0], corners[1], corners[2], self.origin]);
        match side {
            Side::Front => of_origin >= 0,
            Side::Back => of_origin <= 0,
        }
    }

    /// The projection of a point.
    #[inline]
    fn project(&self, point: DVec3) -> [f64; 2] {
        let (p, [x, y, z]) = (point - self.origin, self.axes);
        [p[x] * self.dir[z] - self.dir[x] * p[z], p[y] * self.dir[z] - self.dir[y] * p[z]]
    }

    /// The least and the greatest distance of the corners along the line, on the axis along which the direction is
    /// greatest. `dir` is the direction that the line was made of.
    pub fn span(&self, corners: &[DVec3; 3], dir: DVec3) -> [f64; 2] {
        let z = self.axes[2];
        let [a, b, c] = corners.map(|corner| (corner[z] - self.origin[z]) / dir[z]);
        [a.min(b).min(c), a.max(b).max(c)]
    }
}

/// True if the point (e, e²) is on the left of the directed line from `a` to `b`. `None` if the points are equal.
#[inline]
fn is_left(a: [f64; 2], b: [f64; 2]) -> Option<bool> {
    // The edge function is a × b + e (ay - by) + e² (bx - ax).
    let (first, second) = (a[0] * b[1], a[1] * b[0]);
    if first != second {
        // Rounding keeps the order of two products.
        return Some(first > second);
    }
    on_line(a, b, first)
}

/// [`is_left`] if both products round to `product`.
#[cold]
fn on_line(a: [f64; 2], b: [f64; 2], product: f64) -> Option<bool> {
    // A fused operation yields the exact error of a product.
    let (first, second) = (a[0].mul_add(b[1], -product), a[1].mul_add(b[0], -product));
    let pairs = [(first, second), (a[1], b[1]), (b[0], a[0])];
    pairs.iter().find(|(greater, less)| greater != less).map(|(greater, less)| greater > less)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point(p: [i32; 3]) -> DVec3 {
        DVec3::from(p.map(f64::from))
    }

    /// Exact in integers: the determinant of the direction and two corners relative to the origin.
    fn volume(d: [i64; 3], p: [i64; 3], q: [i64; 3]) -> i64 {
        d[0] * (p[1] * q[2] - p[2] * q[1]) + d[1] * (p[2] * q[0] - p[0] * q[2]) + d[2] * (p[0] * q[1] - p[1] * q[0])
    }

    fn grid() -> [std::ops::Range<i32>; 3] {
        [-4..5, -4..5, -4..5]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        /// The triangle is crossed wherever the line is strictly inside, and never where it is strictly outside.
        #[test]
        fn agrees_with_integers_off_the_edges(o in grid(), d in grid(), a in grid(), b in grid(), c in grid()) {
            prop_assume!(d != [0; 3]);
            let line = Line::new(point(o), point(d));
            let found = line.crosses(&[a, b, c].map(point));
            let from = |p: [i32; 3]| std::array::from_fn(|i| i64::from(p[i] - o[i]));
            let d = d.map(i64::from);
            let (a, b, c) = (from(a), from(b), from(c));
            let signs = [volume(d, a, b), volume(d, b, c), volume(d, c, a)].map(i64::signum);
            match signs {
                // The volume is positive if the corners turn left as seen along the direction.
                [1, 1, 1] => prop_assert_eq!(found, Some(Side::Back)),
                [-1, -1, -1] => prop_assert_eq!(found, Some(Side::Front)),
                _ if signs.contains(&1) && signs.contains(&-1) => prop_assert_eq!(found, None),
                _ => {}
            }
        }

        /// The lines of a plane through a corner, an edge or the inside of a tetrahedron enter it as often as they
        /// leave it.
        #[test]
        fn closed_surfaces_are_entered_and_left(o in grid(), d in grid(), t in [grid(), grid(), grid(), grid()]) {
            prop_assume!(d != [0; 3]);
            let line = Line::new(point(o), point(d));
            let faces = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
            let sides = faces.map(|face| line.crosses(&face.map(|i| point(t[i]))));
            let count = |side| sides.iter().filter(|&&s| s == Some(side)).count();
            prop_assert_eq!(count(Side::Front), count(Side::Back));
            prop_assert!(count(Side::Front) <= 2);
        }
    }

    /// Of the four quarters of a square, each with a corner in the middle, a line through the middle crosses one.
    #[test]
    fn a_line_through_a_corner_crosses_one_triangle() {
        let ring = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]].map(point);
        for dir in [DVec3::Z, DVec3::NEG_Z, DVec3::new(0.1, 0.3, 1.0)] {
            let line = Line::new(dir * -4.0, dir);
            let quarter = |i: usize| line.crosses(&[DVec3::ZERO, ring[i], ring[(i + 1) % 4]]);
            let crossed: Vec<Side> = (0..4).filter_map(quarter).collect();
            assert_eq!(crossed, [if dir.z > 0.0 { Side::Back } else { Side::Front }]);
        }
        // Seen edge-on, none is crossed.
        let line = Line::new(DVec3::X * 9.0, DVec3::X);
        assert!((0..4).all(|i| line.crosses(&[DVec3::ZERO, ring[i], ring[(i + 1) % 4]]).is_none()));
    }
}
