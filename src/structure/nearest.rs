//! The distances from a point to what is below a place of a tree, by lanes: bounds for boxes and for triangles.
//!
//! A tree is placed in a frame whose origin is the point, so corners near the point keep their digits. If the map to
//! that frame changes all lengths almost alike, boxes are tested in the tree's frame, where they are tight; otherwise
//! around their image.

use super::rows::{COLUMNS, Lanes, Rows};
use glam::{DAffine3, DMat3, DVec3};

/// A tree around a point.
#[derive(Debug, Clone, Copy)]
pub struct PointFrame {
    map: DAffine3,
    /// True if the map only moves.
    is_shift: bool,
    /// The point in the tree's frame, and the square of the factor by which lengths grow at least; `None` if lengths
    /// change too differently.
    local: Option<(DVec3, f64)>,
}

/// The least ratio of the factors by which lengths grow, for tests in the tree's frame.
const ALIKE: f64 = 0.7;

impl PointFrame {
    /// `map` leads from the tree's frame to that around the point, `local` is the point in the tree's frame. Lengths
    /// grow by factors within `factors`.
    #[inline]
    pub fn new(map: DAffine3, local: DVec3, factors: [f64; 2]) -> Self {
        let [least, most] = factors;
        let is_alike = least >= ALIKE * most;
        Self { map, is_shift: map.matrix3 == DMat3::IDENTITY, local: is_alike.then_some((local, least * least)) }
    }

    /// Squared distances from the point to boxes: not above those of all that is in the boxes, but for rounding.
    #[inline(always)]
    pub fn squared(&self, bounds: &[Lanes; 6]) -> Lanes {
        match self.local {
            Some((point, scale)) => {
                let mut sum = squared_to(bounds, point);
                sum.iter_mut().for_each(|x| *x *= scale);
                sum
            }
            None => {
                let image = self.image(bounds);
                let mut sum = [0.0; COLUMNS];
                for [middle, half] in &image {
                    for lane in 0..COLUMNS {
                        let beyond = positive(middle[lane].abs() - half[lane]);
                        sum[lane] += beyond * beyond;
                    }
                }
                sum
            }
        }
    }

    /// Squared distances from the point to the farthest points of boxes: not below those of all that is in the boxes,
    /// but for rounding.
    #[inline(always)]
    pub fn farthest(&self, bounds: &[Lanes; 6]) -> Lanes {
        let mut sum = [0.0; COLUMNS];
        for [middle, half] in &self.image(bounds) {
            for lane in 0..COLUMNS {
                let far = middle[lane].abs() + half[lane];
                sum[lane] += far * far;
            }
        }
        sum
    }

    /// The middle and half of the extent, along each axis, of boxes around the images of boxes.
    #[inline(always)]
    pub fn image(&self, bounds: &[Lanes; 6]) -> [[Lanes; 2]; 3] {
        let mut out = [[[0.0; COLUMNS]; 2]; 3];
        let [x, y, z] = self.map.matrix3.to_cols_array_2d();
        for (axis, [middle, half]) in out.iter_mut().enumerate() {
            let (row, from) = ([x[axis], y[axis], z[axis]], self.map.translation[axis]);
            for lane in 0..COLUMNS {
                let (mut at, mut reach) = (from, 0.0);
                for k in 0..3 {
                    let (low, high) = (bounds[k][lane], bounds[k + 3][lane]);
                    at += row[k] * ((low + high) * 0.5);
                    reach += row[k].abs() * ((high - low) * 0.5);
                }
                (middle[lane], half[lane]) = (at, reach);
            }
        }
        out
    }

    /// Places the corners of triangles.
    #[inline(always)]
    pub fn corners(&self, rows: &Rows) -> [[Lanes; 3]; 3] {
        rows.placed(&self.map, self.is_shift)
    }
}

/// Squared distances from the origin to the boxes of triangles.
#[inline(always)]
pub fn squared_to_triangles(corners: &[[Lanes; 3]; 3]) -> Lanes {
    let mut sum = [0.0; COLUMNS];
    let [a, b, c] = corners;
    for axis in 0..3 {
        for lane in 0..COLUMNS {
            let (x, y, z) = (a[axis][lane], b[axis][lane], c[axis][lane]);
            let beyond = positive(greater(lesser(lesser(x, y), z), -greater(greater(x, y), z)));
            sum[lane] += beyond * beyond;
        }
    }
    sum
}

/// Squared distances from a point to boxes.
#[inline(always)]
fn squared_to(bounds: &[Lanes; 6], point: DVec3) -> Lanes {
    let mut sum = [0.0; COLUMNS];
    for axis in 0..3 {
        let at = point[axis];
        for lane in 0..COLUMNS {
            let beyond = positive(greater(bounds[axis][lane] - at, at - bounds[axis + 3][lane]));
            sum[lane] += beyond * beyond;
        }
    }
    sum
}

/// The triangle of a lane.
#[inline(always)]
pub fn triangle_of(corners: &[[Lanes; 3]; 3], lane: usize) -> [DVec3; 3] {
    let lane = lane % COLUMNS;
    corners.each_ref().map(|c| DVec3::new(c[0][lane], c[1][lane], c[2][lane]))
}

/// The lanes with numbers of at most `limit`.
#[inline(always)]
pub fn at_most(lanes: &Lanes, limit: f64) -> u32 {
    (0..COLUMNS).fold(0, |mask, lane| mask | u32::from(lanes[lane] <= limit) << lane)
}

/// The greater one: one instruction, without the rules for NaN.
#[inline(always)]
pub fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The lesser one.
#[inline(always)]
pub fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The number, or 0 if it is negative.
#[inline(always)]
pub fn positive(x: f64) -> f64 {
    greater(x, 0.0)
}

/// Sorts what a walk visits next by squared distance, the nearest last; keeps the order of equal ones. Most are the
/// children of one place, few enough to be inserted one by one.
#[inline(always)]
pub fn sort_nearest_last<T: Copy>(all: &mut [T], squared: impl Fn(&T) -> f64) {
    if all.len() > COLUMNS {
        return all.sort_by(|a, b| squared(b).total_cmp(&squared(a)));
    }
    for i in 1..all.len() {
        let one = all[i];
        let mut at = i;
        while at > 0 && squared(&all[at - 1]) < squared(&one) {
            all[at] = all[at - 1];
            at -= 1;
        }
        all[at] = one;
    }
}
