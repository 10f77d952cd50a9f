//! Rational Bézier patches.

use super::basis::Place;
use super::tensor::Homogeneous;
use crate::geom::surface::SurfacePoint;
use glam::{DVec3, DVec4};

/// A Bézier patch, rational or not: a surface over a rectangle of its parameters.
///
/// Patches that were split from one surface have equal bits in the control points of their common borders, as long as
/// their other borders agree: along one row of pieces, all are split at the same parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct BezierPatch {
    pub(super) degree: [usize; 2],
    /// First and last parameter of u, and of v; not empty.
    pub(super) domain: [[f64; 2]; 2],
    pub(super) origin: DVec3,
    /// Control points around the origin in homogeneous coordinates, v fastest; all weights are positive.
    pub(super) points: Vec<DVec4>,
    /// False if all weights are 1.
    pub(super) is_rational: bool,
    /// Greatest distance of a control point of the whole surface from the origin, along an axis.
    pub(super) reach: f64,
    /// Number of rounded interpolations that led to a control point.
    pub(super) steps: u32,
}

impl BezierPatch {
    /// Degrees along u and v, each at least 1.
    pub fn degree(&self) -> [usize; 2] {
        self.degree
    }

    /// First and last parameter of u, and of v, as parameters of the whole surface.
    pub fn domain(&self) -> [[f64; 2]; 2] {
        self.domain
    }

    /// True unless all weights are equal.
    pub fn is_rational(&self) -> bool {
        self.is_rational
    }

    /// The control points (w (P − O), w) in homogeneous coordinates, and their origin O. That with the indices i along
    /// u and j along v is number `i * (degree[1] + 1) + j`. All weights w are positive, and 1 unless the patch
    /// is rational.
    pub fn control_points(&self) -> (DVec3, &[DVec4]) {
        (self.origin, &self.points)
    }

    /// The point at (u, v), which are parameters of the whole surface, and its derivatives by them. Parameters outside
    /// of the patch are moved to its border; NaN is taken as the first parameter.
    pub fn evaluate(&self, u: f64, v: f64) -> SurfacePoint {
        let place = |axis: usize, t: f64| {
            let ends = self.domain[axis];
            Place::Interval(t.max(ends[0]).min(ends[1]), ends)
        };
        let net = |i: usize, j: usize| self.points[i * (self.degree[1] + 1) + j];
        Homogeneous::at(self.degree, &[place(0, u), place(1, v)], net).project(self.origin, self.is_rational)
    }

    /// Splits the patch at a parameter of u (axis 0) or v (axis 1), which is moved into the domain, by de Casteljau's
    /// algorithm. At a border, one part is that line of the surface, with equal control points across and an empty
    /// domain.
    pub fn split(&self, axis: usize, at: f64) -> [Self; 2] {
        let [begin, end] = self.domain[axis];
        let at = at.max(begin).min(end);
        let share = if end > begin { (at - begin) / (end - begin) } else { 0.0 };
        let [mut lower, mut upper] = [self.clone(), self.clone()];
        lower.domain[axis][1] = at;
        upper.domain[axis][0] = at;
        let (rows, columns) = (self.degree[0] + 1, self.degree[1] + 1);
        let (lines, step, stride) = if axis == 0 { (columns, columns, 1) } else { (rows, 1, columns) };
        for line in 0..lines {
            split_line(&mut lower.points, &mut upper.points, share, |i| line * stride + i * step, self.degree[axis]);
        }
        for part in [&mut lower, &mut upper] {
            part.steps = part.steps.saturating_add(self.degree[axis] as u32);
        }
        [lower, upper]
    }

    /// Splits the patch in the middle of u (axis 0) or v (axis 1).
    pub fn halves(&self, axis: usize) -> [Self; 2] {
        let [begin, end] = self.domain[axis];
        self.split(axis, begin + (end - begin) * 0.5)
    }

    /// The part of the patch over a rectangle of parameters, moved into the domain. It may be a line
    /// or a point.
    pub fn part(&self, domain: [[f64; 2]; 2]) -> Self {
        let mut part = self.clone();
        for (axis, [begin, end]) in domain.into_iter().enumerate() {
            if end < part.domain[axis][1] {
                [part, _] = part.split(axis, end);
            }
            if begin > part.domain[axis][0] {
                [_, part] = part.split(axis, begin);
            }
        }
        part
    }
}

/// De Casteljau's algorithm on one line of control points, which both arrays hold: they become those of both parts.
fn split_line(lower: &mut [DVec4], upper: &mut [DVec4], share: f64, at: impl Fn(usize) -> usize, degree: usize) {
    for level in 1..=degree {
        for i in 0..=degree - level {
            upper[at(i)] = upper[at(i)] * (1.0 - share) + upper[at(i + 1)] * share;
        }
        lower[at(level)] = upper[at(0)];
    }
}
