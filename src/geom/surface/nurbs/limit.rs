//! Normals and curvatures at poles, collapsed edges and other points where du × dv is zero.
//!
//! Both are limits from inside, along the diagonal of the parameters towards the farther ends of the Bézier patch that
//! the point is in. At a pole of a smooth surface all paths have this limit. At the apex of a cone it depends on the
//! path: here it is that of the ruling through the point.

use super::bezier::BezierPatch;
use super::normals::binomials;
use super::surface::Nurbs;
use crate::geom::surface::SurfacePoint;
use crate::geom::surface::displacement::NormalFrame;
use glam::{DVec2, DVec3};

/// A normal is taken from the derivatives if rounding turns it by less than about 10⁻⁷.
const RELIABLE_NORMAL: f64 = 2e-8;
/// The same of curvatures, which divide by the square of a derivative.
const RELIABLE_CURVATURE: f64 = 1e-5;
/// Highest order of the Taylor polynomial that is examined.
const MAX_ORDER: usize = 12;
/// Paths into the patch, one after another if the Taylor polynomial vanishes along the former.
const PATHS: [DVec2; 3] = [DVec2::new(1.0, 1.0), DVec2::new(1.0, 0.5), DVec2::new(0.5, 1.0)];
/// Least terms of the Taylor polynomial, as shares of the longest control vector: first without regard to terms whose
/// direction is inexact, then to all but rounding.
const SHARES: [f64; 2] = [1e-6, 1e-12];
/// The size of the part that is examined, as share of the patch: in a small one, weights and steps vary little.
const NEAR: f64 = 0.125;
/// Distances along the path at which curvatures are measured, as shares of the sides of the part.
const STATIONS: [f64; 6] = [0.512, 0.384, 0.256, 0.192, 0.128, 0.096];

impl Nurbs {
    /// The unit normal at (u, v), or its limit from inside if du × dv is zero; zero only if the surface has none, as
    /// around a point without area.
    ///
    /// The limit is the direction of the first term of the Taylor polynomial of du × dv that is not zero, along the
    /// diagonal into the surface. Its error is some 10⁻¹² at a pole, and up to 10⁻⁷ beside one; beside a pole where
    /// both derivatives vanish up to 10⁻⁴, within that share of the domain.
    pub fn normal_limit(&self, u: f64, v: f64) -> DVec3 {
        self.normal_limit_of(&self.evaluate(u, v), u, v)
    }

    /// [`Nurbs::normal_limit`], where the surface has `point`.
    pub(super) fn normal_limit_of(&self, point: &SurfacePoint, u: f64, v: f64) -> DVec3 {
        if self.is_regular(point) {
            return point.normal();
        }
        let patch = self.patch_around(u, v);
        let is_reliable = is_reliable(point, patch.steepest(), RELIABLE_NORMAL);
        if is_reliable { point.normal() } else { Corner::at(&patch, u, v).normal() }
    }

    /// The principal curvatures at (u, v) as [`SurfacePoint::curvatures`], or their limits from inside if du × dv is
    /// zero. `None` if there are none, as at the apex of a cone.
    ///
    /// The limits are extrapolated from points along the diagonal into the surface, with a relative error of about
    /// 10⁻⁷ where the surface is smooth.
    pub fn curvature_limit(&self, u: f64, v: f64) -> Option<[f64; 2]> {
        let point = self.evaluate(u, v);
        if self.is_regular(&point) {
            return point.curvatures();
        }
        let patch = self.patch_around(u, v);
        let is_reliable = is_reliable(&point, patch.steepest(), RELIABLE_CURVATURE);
        if is_reliable { point.curvatures() } else { Corner::at(&patch, u, v).curvatures() }
    }

    /// The normal and its derivatives at (u, v), or at a pole the limit of the normal with derivatives from the mean of
    /// the limits of both curvatures; 0 where these have none. `None` if the surface has no normal.
    pub fn frame_limit(&self, u: f64, v: f64) -> Option<NormalFrame> {
        let point = self.evaluate(u, v);
        if self.is_regular(&point) || is_reliable(&point, self.patch_around(u, v).steepest(), RELIABLE_CURVATURE) {
            return NormalFrame::of(&point);
        }
        let normal = Some(self.normal_limit(u, v)).filter(|normal| *normal != DVec3::ZERO)?;
        let curvature = self.curvature_limit(u, v).map_or(0.0, |[a, b]| 0.5 * (a + b));
        Some(NormalFrame::at_pole(&point, normal, curvature))
    }

    /// True if no derivative is so short, and no angle of theirs so small, that a pole may be near: the fast way.
    fn is_regular(&self, point: &SurfacePoint) -> bool {
        let [[u0, u1], [v0, v1]] = self.domain();
        let (least, long) = (1e-3 * self.reach, point.du.length() * point.dv.length());
        let is_steep = point.du.length() * (u1 - u0) > least && point.dv.length() * (v1 - v0) > least;
        is_steep && point.du.cross(point.dv).length() > 1e-3 * long
    }

    /// The Bézier patch over the span that (u, v) is in.
    fn patch_around(&self, u: f64, v: f64) -> BezierPatch {
        let at = [(0, u), (1, v)].map(|(axis, t)| self.knots[axis].find(self.knots[axis].clamp(t)));
        self.piece(at)
    }
}

/// True if rounding of the derivatives turns the normal by little. A derivative errs in proportion to the longest one
/// of the patch, and the cross product by that times the other derivative.
fn is_reliable(point: &SurfacePoint, [du, dv]: [f64; 2], least: f64) -> bool {
    let area = point.du.cross(point.dv).length();
    area > 0.0 && area >= least * (point.du.length() * dv + point.dv.length() * du)
}

impl BezierPatch {
    /// Bounds of the lengths of du and dv, but for the ratio of weights.
    fn steepest(&self) -> [f64; 2] {
        let columns = self.degree[1] + 1;
        let at = |i: usize| self.points[i].truncate() / self.points[i].w;
        let mut longest = [0.0f64; 2];
        for i in 0..self.points.len() {
            if i + columns < self.points.len() {
                longest[0] = longest[0].max(at(i).distance(at(i + columns)));
            }
            if (i + 1) % columns != 0 {
                longest[1] = longest[1].max(at(i).distance(at(i + 1)));
            }
        }
        [0, 1].map(|axis| longest[axis] * self.degree[axis] as f64 / (self.domain[axis][1] - self.domain[axis][0]))
    }
}

/// The part of a patch beside a point, towards its farther ends.
struct Corner {
    part: BezierPatch,
    /// True, of a direction, if the point is at the end of the part.
    is_end: [bool; 2],
}

impl Corner {
    fn at(patch: &BezierPatch, u: f64, v: f64) -> Self {
        let mut is_end = [false; 2];
        let mut domain = patch.domain;
        for (axis, t) in [u, v].into_iter().enumerate() {
            let [begin, end] = patch.domain[axis];
            let t = t.max(begin).min(end);
            is_end[axis] = t - begin > end - t;
            domain[axis] = if is_end[axis] { [t - (t - begin) * NEAR, t] } else { [t, t + (end - t) * NEAR] };
        }
        Self { part: patch.part(domain), is_end }
    }

    /// A point on the path into the part, at a share of its sides.
    fn inside(&self, share: f64) -> SurfacePoint {
        let [u, v] = [0, 1].map(|axis| {
            let [begin, end] = self.part.domain[axis];
            if self.is_end[axis] { end - (end - begin) * share } else { begin + (end - begin) * share }
        });
        self.part.evaluate(u, v)
    }

    fn normal(&self) -> DVec3 {
        let [p, q] = self.part.degree;
        let corner = if self.is_end[0] { p * (q + 1) } else { 0 } + if self.is_end[1] { q } else { 0 };
        let corner = self.part.points[corner];
        let polynomial = self.part.normal_polynomial(corner.truncate() / corner.w);
        let mut taylor = polynomial.coefficients();
        self.turn_to_corner(&mut taylor, polynomial.degree[1] + 1);
        let longest = taylor.iter().fold(0.0, |most: f64, v| most.max(v.length()));
        differences(&mut taylor, polynomial.degree);
        let found = SHARES.into_iter().find_map(|share| first_term(&taylor, polynomial.degree, share * longest));
        found.map_or(DVec3::ZERO, DVec3::normalize_or_zero)
    }

    /// Reverses the directions in which the point is at the end.
    fn turn_to_corner(&self, vectors: &mut [DVec3], columns: usize) {
        if self.is_end[0] {
            let rows = vectors.len() / columns;
            for i in 0..rows / 2 {
                (0..columns).for_each(|j| vectors.swap(i * columns + j, (rows - 1 - i) * columns + j));
            }
        }
        if self.is_end[1] {
            vectors.chunks_exact_mut(columns).for_each(<[_]>::reverse);
        }
    }

    /// Neville's extrapolation of both curvatures to the corner; `None` unless the last two stages agree.
    fn curvatures(&self) -> Option<[f64; 2]> {
        let mut values = [[0.0; 2]; STATIONS.len()];
        for (value, share) in values.iter_mut().zip(STATIONS) {
            *value = self.inside(share).curvatures()?;
        }
        let mut before = values[STATIONS.len() - 1];
        for stage in 1..STATIONS.len() {
            before = values[STATIONS.len() - 1];
            for i in (stage..STATIONS.len()).rev() {
                let (near, far) = (STATIONS[i], STATIONS[i - stage]);
                values[i] = [0, 1].map(|k| (far * values[i][k] - near * values[i - 1][k]) / (far - near));
            }
        }
        let found = values[STATIONS.len() - 1];
        let size = found[0].abs().max(found[1].abs());
        let is_steady = (0..2).all(|k| (found[k] - before[k]).abs() <= 1e-3 * size || size * self.part.reach < 1e-6);
        is_steady.then_some(found)
    }
}

/// The first term of the Taylor polynomial that exceeds `least`, times the greatest sum of its order. The differences
/// of order (i, j) are at `i * (n + 1) + j`.
fn first_term(differences: &[DVec3], [m, n]: [usize; 2], least: f64) -> Option<DVec3> {
    let binomials = [m, n].map(binomials);
    let factor = |(i, j): (usize, usize)| binomials[0][i] * binomials[1][j];
    for order in 0..=MAX_ORDER.min(m + n) {
        let terms = (0..=order.min(m)).filter(|i| order - i <= n).map(|i| (i, order - i));
        let most = terms.clone().map(factor).sum::<f64>() * f64::powi(2.0, order as i32);
        for path in PATHS {
            let term = |(i, j)| differences[i * (n + 1) + j] * (factor((i, j)) * weight(path, i, j));
            let found: DVec3 = terms.clone().map(term).sum();
            if found.length() > least * most {
                return Some(found);
            }
        }
    }
    None
}

/// The weight of the Taylor term of order (i, j) along a path.
fn weight(path: DVec2, i: usize, j: usize) -> f64 {
    path.x.powi(i as i32) * path.y.powi(j as i32)
}

/// Replaces Bernstein coefficients by their forward differences of all orders at the first one.
fn differences(vectors: &mut [DVec3], [m, n]: [usize; 2]) {
    let columns = n + 1;
    for order in 1..=m {
        for i in (order..=m).rev() {
            for j in 0..columns {
                let before = vectors[(i - 1) * columns + j];
                vectors[i * columns + j] -= before;
            }
        }
    }
    for row in vectors.chunks_exact_mut(columns) {
        for order in 1..=n {
            (order..=n).rev().for_each(|j| row[j] -= row[j - 1]);
        }
    }
}
