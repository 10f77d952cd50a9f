//! The limit surface of one quad, and of a whole cage.

use super::super::point::SurfacePoint;
use super::around::{Finder, Neighbourhood};
use super::bicubic;
use super::level::Cage;
use super::pattern::Pattern;
use super::plan::{Node, Plan, Plans};
use crate::base::error::{Error, Result};
use glam::DVec3;
use std::sync::Arc;

/// Levels around an irregular vertex after which its own limit is the answer: parameters below 2⁻⁴⁸ there.
const DEEPEST: u32 = 48;

/// The limit surface of a quad of a cage: a plan with points.
#[derive(Debug, Clone)]
pub struct QuadSurface {
    pub(super) plan: Arc<Plan>,
    pub(super) points: Vec<DVec3>,
}

impl QuadSurface {
    /// The surface of a plan for control points in the neighbourhood's order.
    ///
    /// # Errors
    /// [`Error::BadArgument`] unless there are [`Plan::control_points`] of them.
    pub fn new(plan: Arc<Plan>, control: impl IntoIterator<Item = DVec3>) -> Result<Self> {
        let mut surface = QuadSurface { points: Vec::with_capacity(plan.points()), plan };
        surface.set_points(control)?;
        Ok(surface)
    }

    /// Other control points for the same plan, as of another key frame.
    ///
    /// # Errors
    /// As [`QuadSurface::new`]; the surface is unusable then until this succeeds.
    pub fn set_points(&mut self, control: impl IntoIterator<Item = DVec3>) -> Result<()> {
        self.points.clear();
        self.points.extend(control);
        let (given, wanted) = (self.points.len(), self.plan.control_points());
        if given != wanted {
            self.points.resize(self.plan.points(), DVec3::ZERO);
            return Err(Error::bad_argument(format!("{given} control points for a plan of {wanted}")));
        }
        for i in 0..self.plan.rows.len() {
            let point = self.plan.rows.point(i, &self.points);
            self.points.push(point);
        }
        Ok(())
    }

    /// The plan.
    pub fn plan(&self) -> &Arc<Plan> {
        &self.plan
    }

    /// The point at u, v, which are clamped to 0 to 1 (NaN to 0), with derivatives by u and v.
    ///
    /// Between two bicubic patches and at infinitely sharp edges the second derivatives are those of one side. At an
    /// irregular vertex itself the first derivatives, which grow without bounds towards it or vanish, are replaced by two
    /// vectors that span the tangent plane, of the same orientation; the second ones are zero there.
    pub fn evaluate(&self, u: f64, v: f64) -> SurfacePoint {
        let clamped = |t: f64| if t > 0.0 { t.min(1.0) } else { 0.0 };
        let (mut u, mut v, mut scale, mut node) = (clamped(u), clamped(v), 1.0, 0);
        loop {
            match self.plan.nodes[node] {
                Node::Split(first) => {
                    node = first as usize + descend(&mut u, &mut v);
                    scale *= 2.0;
                }
                Node::Regular(list) => return scaled(bicubic::evaluate(&self.patch(list), u, v), scale),
                Node::Irregular(list, pattern, corner) => {
                    let pattern = &self.plan.patterns[pattern as usize];
                    let (u, v) = to_corner(u, v, corner);
                    return scaled(from_corner(near_vertex(pattern, self.ring(list, pattern), u, v), corner), scale);
                }
            }
        }
    }

    pub(super) fn patch(&self, list: u32) -> [DVec3; 16] {
        let list = &self.plan.lists[list as usize..list as usize + 16];
        std::array::from_fn(|i| self.points[list[i] as usize])
    }

    pub(super) fn ring(&self, list: u32, pattern: &Pattern) -> Vec<DVec3> {
        let list = &self.plan.lists[list as usize..list as usize + pattern.ring.len()];
        list.iter().map(|&point| self.points[point as usize]).collect()
    }
}

/// The child that holds (u, v), which become its parameters.
fn descend(u: &mut f64, v: &mut f64) -> usize {
    let (right, upper) = (*u >= 0.5, *v >= 0.5);
    *u = 2.0 * *u - f64::from(u8::from(right));
    *v = 2.0 * *v - f64::from(u8::from(upper));
    match (right, upper) {
        (false, false) => 0,
        (true, false) => 1,
        (true, true) => 2,
        (false, true) => 3,
    }
}

/// Multiplies derivatives for parameters that run `scale` times as slowly.
fn scaled(p: SurfacePoint, scale: f64) -> SurfacePoint {
    let square = scale * scale;
    SurfacePoint {
        du: p.du * scale,
        dv: p.dv * scale,
        duu: p.duu * square,
        duv: p.duv * square,
        dvv: p.dvv * square,
        ..p
    }
}

/// Parameters of the quad turned so that it begins at `corner`.
fn to_corner(u: f64, v: f64, corner: u32) -> (f64, f64) {
    match corner {
        0 => (u, v),
        1 => (v, 1.0 - u),
        2 => (1.0 - u, 1.0 - v),
        _ => (1.0 - v, u),
    }
}

/// A point of the turned quad with derivatives by the quad's own parameters.
fn from_corner(p: SurfacePoint, corner: u32) -> SurfacePoint {
    match corner {
        0 => p,
        1 => SurfacePoint { du: -p.dv, dv: p.du, duu: p.dvv, duv: -p.duv, dvv: p.duu, ..p },
        2 => SurfacePoint { du: -p.du, dv: -p.dv, ..p },
        _ => SurfacePoint { du: p.dv, dv: -p.du, duu: p.dvv, duv: -p.duv, dvv: p.duu, ..p },
    }
}

/// The point of a quad whose corner at u = v = 0 is irregular.
fn near_vertex(pattern: &Pattern, mut ring: Vec<DVec3>, mut u: f64, mut v: f64) -> SurfacePoint {
    let dot = |mask: &[f64], ring: &[DVec3]| mask.iter().zip(ring).fold(DVec3::ZERO, |sum, (&w, &p)| sum + p * w);
    let (masks, mut deeper) = (&pattern.masks, ring.clone());
    // Numbers relative to the limit at the vertex keep their precision while the ring shrinks towards it.
    let mut limit = DVec3::ZERO;
    let (mut scale, mut depth) = (1.0, 0);
    loop {
        let step = dot(&masks.position, &ring);
        limit += step;
        ring.iter_mut().for_each(|p| *p -= step);
        if depth == DEEPEST || u == 0.0 && v == 0.0 {
            let (du, dv) = (dot(&masks.du, &ring), dot(&masks.dv, &ring));
            return SurfacePoint { position: limit, du: du * scale, dv: dv * scale, ..SurfacePoint::default() };
        }
        let child = descend(&mut u, &mut v);
        scale *= 2.0;
        if child > 0 {
            let points = std::array::from_fn(|i| pattern.children.point(16 * (child - 1) + i, &ring));
            let point = scaled(bicubic::evaluate(&points, u, v), scale);
            return SurfacePoint { position: point.position + limit, ..point };
        }
        deeper.iter_mut().enumerate().for_each(|(i, p)| *p = pattern.ring.point(i, &ring));
        std::mem::swap(&mut ring, &mut deeper);
        depth += 1;
    }
}

/// The limit surface of a cage, with the points of all its quads: a few hundred bytes a regular quad, up to some
/// hundred kilobytes at edges of high sharpness. Who needs less at once makes a [`QuadSurface`] at a time.
#[derive(Debug, Clone)]
pub struct CageSurface {
    /// First quad of each face.
    first: Vec<u32>,
    quads: Vec<QuadSurface>,
}

impl CageSurface {
    /// The surface of a cage with one position a vertex.
    ///
    /// # Errors
    /// [`Error::BadArgument`] unless there is one position a vertex.
    pub fn new(cage: &Cage, positions: &[DVec3]) -> Result<Self> {
        if positions.len() != cage.vertex_count() {
            let (given, wanted) = (positions.len(), cage.vertex_count());
            return Err(Error::bad_argument(format!("{given} positions for a cage of {wanted} vertices")));
        }
        let (mut finder, mut plans) = (Finder::new(cage), Plans::new());
        let (mut found, mut vertices) = (Neighbourhood::default(), Vec::new());
        let (mut first, mut quads) = (Vec::with_capacity(cage.face_count()), Vec::new());
        for face in 0..cage.face_count() as u32 {
            first.push(quads.len() as u32);
            for corner in 0..cage.quads_of(face) {
                finder.find(face, corner, &mut found, &mut vertices);
                let control = vertices.iter().map(|&vertex| positions[vertex as usize]);
                quads.push(QuadSurface::new(plans.plan(&found)?, control)?);
            }
        }
        Ok(CageSurface { first, quads })
    }

    /// The surface of a face at a corner (0 for a face of four corners), if there is one; holes have one too.
    pub fn quad(&self, face: u32, corner: u32) -> Option<&QuadSurface> {
        let first = *self.first.get(face as usize)?;
        let end = self.first.get(face as usize + 1).map_or(self.quads.len(), |&end| end as usize);
        self.quads[first as usize..end].get(corner as usize)
    }

    /// The point of a face, see [`QuadSurface::evaluate`]. A face of four corners has `corner` 0 and u, v from its first
    /// corner, u along its first edge. A face of n corners is n quads, of which `corner` is one: u runs along the edge from
    /// this corner to the middle, v along the edge that ends there, (1, 1) is the middle of the face, as in Ptex.
    ///
    /// # Errors
    /// [`Error::BadArgument`] if there is no such face or corner.
    pub fn evaluate(&self, face: u32, corner: u32, u: f64, v: f64) -> Result<SurfacePoint> {
        let quad = self.quad(face, corner);
        Ok(quad.ok_or_else(|| Error::bad_argument(format!("face {face}, corner {corner}: not there")))?.evaluate(u, v))
    }
}
