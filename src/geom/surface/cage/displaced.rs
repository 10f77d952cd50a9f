//! Displacement of the limit surface of a cage by a map of heights.

use super::level::Cage;
use crate::base::error::{Error, Result};
use crate::geom::surface::SurfacePoint;
use crate::geom::surface::dice::{MOST_LEVEL, Sample};
use crate::geom::surface::displacement::{Heights, NormalFrame, displace};

/// Heights along the normal of a surface.
#[derive(Debug, Clone, Copy)]
pub struct Displacement<'a> {
    /// One map, or a grid for each face.
    pub heights: &'a Heights,
    /// Factor of all heights: their unit in units of the surface.
    pub scale: f64,
    /// Coordinates (s, t) of the map at each corner of each face, in the order of the cage's indices. They are
    /// interpolated bilinearly over a quad, and over the quads at the corners of any other face. Empty: each face has a
    /// grid of its own, along its u and v, and must be a quad.
    pub coordinates: &'a [[f64; 2]],
}

/// Number of texels that a cell of a diced quad spans at most, before the tolerance is looked at: more could hide a
/// bump between the samples.
const TEXELS: f64 = 4.0;
/// Highest level that is dictated by that.
const LEAST: u32 = 9;

/// Greatest magnitude of a height: that of coordinates.
const MOST_HEIGHT: f64 = 1e30;

impl Displacement<'_> {
    /// Fails with `BadArgument`, which names the face or corner, if numbers do not match or are not finite.
    pub(super) fn check(&self, cage: &Cage) -> Result<()> {
        let bad = |why: String| Err(Error::BadArgument(format!("displacement: {why}")));
        if !self.scale.is_finite() {
            return bad(format!("scale {} is not finite", self.scale));
        }
        let most = (0..self.heights.count())
            .flat_map(|map| self.heights.range(map, [[0.0, 1.0]; 2]))
            .map(|height| (height * self.scale).abs());
        if most.fold(0.0, f64::max) > MOST_HEIGHT {
            return bad(format!("heights times the scale exceed {MOST_HEIGHT:e}"));
        }
        let (faces, corners, maps) = (cage.face_count(), cage.topology.corners.len(), self.heights.count());
        if self.coordinates.is_empty() {
            let is_no_quad = |face: &u32| cage.face(*face).len() != 4;
            return match (0..faces as u32).find(is_no_quad) {
                Some(face) => bad(format!("face {face} is no quad, and has no coordinates")),
                None if maps as usize != faces => bad(format!("{maps} grids for {faces} faces")),
                None => Ok(()),
            };
        }
        if maps != 1 {
            return bad(format!("{maps} maps; coordinates need one"));
        }
        if self.coordinates.len() != corners {
            return bad(format!("{} coordinates for {corners} corners of faces", self.coordinates.len()));
        }
        match self.coordinates.iter().position(|it| !it.iter().all(|c| c.is_finite())) {
            Some(corner) => bad(format!("the coordinates of corner {corner} are not finite")),
            None => Ok(()),
        }
    }

    /// The coordinates at the corners of a quad of a face, at (0, 0), (1, 0), (0, 1) and (1, 1).
    fn corners(&self, cage: &Cage, face: u32, corner: u32) -> [[f64; 2]; 4] {
        if self.coordinates.is_empty() {
            return [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        }
        let (first, size) = (cage.topology.face_start[face as usize] as usize, cage.face(face).len());
        let all = &self.coordinates[first..first + size];
        if size == 4 {
            return [all[0], all[1], all[3], all[2]];
        }
        let mean = |of: &[[f64; 2]]| [0, 1].map(|axis| of.iter().map(|it| it[axis]).sum::<f64>() / of.len() as f64);
        let at = corner as usize;
        let (here, next, before) = (all[at], all[(at + 1) % size], all[(at + size - 1) % size]);
        [here, mean(&[here, next]), mean(&[here, before]), mean(all)]
    }

    fn map(&self, face: u32) -> u32 {
        if self.coordinates.is_empty() { face } else { 0 }
    }

    /// The displaced point of a quad of a face at (u, v), where the surface has `point`.
    pub(super) fn sample(
        &self,
        cage: &Cage,
        [face, corner]: [u32; 2],
        [u, v]: [f64; 2],
        point: &SurfacePoint,
    ) -> Sample {
        let Some(frame) = NormalFrame::of(point) else {
            return Sample { position: point.position, normal: point.normal() };
        };
        let [a, b, c, d] = self.corners(cage, face, corner);
        let along = |axis: usize| {
            let value = (a[axis] * (1.0 - u) + b[axis] * u) * (1.0 - v) + (c[axis] * (1.0 - u) + d[axis] * u) * v;
            let by_u = (b[axis] - a[axis]) * (1.0 - v) + (d[axis] - c[axis]) * v;
            let by_v = (c[axis] - a[axis]) * (1.0 - u) + (d[axis] - b[axis]) * u;
            (value, [by_u, by_v])
        };
        let ((s, by_s), (t, by_t)) = (along(0), along(1));
        let height = self.heights.sample(self.map(face), s, t);
        let gradient = height.gradient_by(by_s, by_t).map(|it| it * self.scale);
        let moved = displace(point, &frame, height.value * self.scale, gradient);
        Sample { position: moved.position, normal: moved.normal() }
    }

    /// The level from which on cells of a quad span few texels.
    pub(super) fn least_level(&self, cage: &Cage, face: u32, corner: u32) -> u32 {
        let ([a, b, c, d], size) = (self.corners(cage, face, corner), self.heights.size());
        let span = |p: [f64; 2], q: [f64; 2]| {
            let of = |axis: usize| (p[axis] - q[axis]).abs() * f64::from(size[axis]);
            of(0).max(of(1))
        };
        let most = span(a, b).max(span(c, d)).max(span(a, c)).max(span(b, d));
        ((most / TEXELS).log2().ceil().max(0.0) as u32).min(LEAST.min(MOST_LEVEL))
    }
}
