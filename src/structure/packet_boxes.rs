//! Packets and boxes: tests of all rays at once, by intervals of their origins and reciprocal directions, and of
//! sixteen rays at a time.
//!
//! Source of the interval test: Boulos, Wald, Shirley, "Geometric and Arithmetic Culling Methods for Entire Ray
//! Packets", University of Utah UUCS-06-010, 2006, section 3.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::packet::{PacketWalk, Row, VECTORS};
use super::packet_prepare::Common;
use super::ray::abs;
use crate::simd::{Lanes, Mask, Simd};

/// Returns the greatest distance that any ray may go.
#[inline(always)]
pub(in crate::structure) fn farthest<S: Simd>(s: S, t: &Row) -> f32 {
    let mut far = s.load16(&t[0]);
    for h in 1..VECTORS {
        far = s.load16(&t[h]).max(far);
    }
    far.greatest()
}

/// Returns the rays that may go as far as `t`, or farther.
#[inline(always)]
pub(in crate::structure) fn reaching<S: Simd>(s: S, t: f32, far: &Row) -> u32 {
    let mut rays = 0;
    for h in 0..VECTORS {
        rays |= s.splat16(t).le(s.load16(&far[h])).bits() << (16 * h);
    }
    rays
}

/// Returns a lower bound of the distances at which rays enter boxes, and an upper bound, at most `far`, of the
/// distances at which they leave them. The planes are relative to the extremes of the origins.
#[inline(always)]
pub(in crate::structure) fn cross<S: Simd>(
    s: S,
    from: [S::F8; 3],
    to: [S::F8; 3],
    common: &Common,
    far: f32,
) -> [S::F8; 2] {
    let (mut enter, mut leave) = (s.splat8(0.0), s.splat8(far));
    for axis in 0..3 {
        // Rounded products are monotonic: no ray between the extremes has a smaller entry or a greater exit.
        let (low, high) = (s.splat8(common.inv_min[axis]), s.splat8(common.inv_max[axis]));
        enter = (from[axis] * low).min(from[axis] * high).max(enter);
        leave = (to[axis] * low).max(to[axis] * high).min(leave);
    }
    [enter, leave]
}

/// Returns the rays that hit a box between planes, which are relative to the origin if the rays share one.
#[inline(always)]
pub(in crate::structure) fn meet<S: Simd>(s: S, planes: &[[f32; 2]; 3], one_origin: bool, walk: &PacketWalk) -> u32 {
    let mut all = 0;
    for h in 0..VECTORS {
        let [enter, leave] = way(s, planes, one_origin, walk, h, s.load16(&walk.hits.t[h]));
        all |= enter.le(leave).bits() << (16 * h);
    }
    all
}

/// Returns the intervals of a vector of rays in a box between planes, up to `far`.
#[inline(always)]
pub(in crate::structure) fn way<S: Simd>(
    s: S,
    planes: &[[f32; 2]; 3],
    one_origin: bool,
    walk: &PacketWalk,
    h: usize,
    far: S::F16,
) -> [S::F16; 2] {
    let (mut enter, mut leave) = (s.load16(&walk.rays.t_min[h]), far);
    for axis in 0..3 {
        let inv = s.load16(&walk.rays.inv[axis][h]);
        let mut near = s.splat16(planes[axis][0]);
        let mut far = s.splat16(planes[axis][1]);
        if !one_origin {
            let org = s.load16(&walk.rays.org[axis][h]);
            (near, far) = (near - org, far - org);
        }
        enter = (near * inv).max(enter);
        leave = (far * inv).min(leave);
    }
    [enter, leave]
}

/// Returns the areas of the faces of cells between planes as stored.
#[inline(always)]
pub(in crate::structure) fn faces<const N: usize, L: Lanes<N>>(near: [L; 3], far: [L; 3], zero: L) -> [L; 3] {
    let x = abs(zero, far[0] - near[0]);
    let y = abs(zero, far[1] - near[1]);
    let z = abs(zero, far[2] - near[2]);
    [y * z, z * x, x * y]
}

/// Returns the projected area of a cell: the sum of the areas of its faces, each times |dir| across it.
#[inline(always)]
pub(in crate::structure) fn area<const N: usize, L: Lanes<N>>(faces: [L; 3], dir: [L; 3]) -> L {
    dir[0] * faces[0] + dir[1] * faces[1] + dir[2] * faces[2]
}
