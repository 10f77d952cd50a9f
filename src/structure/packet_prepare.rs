//! Prepares packets: the constants of each ray for box and triangle tests, and the values that all rays share.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::packet::{PacketRays, Row, VECTORS};
use super::ray::{MAX_DIR, MIN_DIR, USUAL_DIRS, abs, slack};
use crate::simd::{Lanes, Mask, Simd};

/// A box counts as narrow if its area is at most this multiple of the packet's cross-section. Narrow boxes are tested
/// ray by ray.
const NARROW: f32 = 2.0;

/// Values shared by coherent rays: signs of the direction, axis order of the triangle test, and ranges.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Common {
    /// For each axis, which of a node's six rows of planes holds the near planes.
    pub near: [usize; 3],
    pub k: [usize; 3],
    /// Extreme of the origins on each axis that minimises the distance to the near plane.
    pub org_near: [f32; 3],
    /// Extreme of the origins on each axis that maximises the distance to the far plane.
    pub org_far: [f32; 3],
    pub inv_min: [f32; 3],
    pub inv_max: [f32; 3],
    /// Tolerance of the planes: see [`slack`].
    pub slack: [f32; 3],
    /// Signs of the directions.
    pub sign: [f32; 3],
    /// True if all rays start at the same point.
    pub one_origin: bool,
    /// Least and greatest shear along x and along y.
    pub shear_min: [f32; 2],
    pub shear_max: [f32; 2],
    /// Least and greatest shear of each vector's rays: vector, axis, least and greatest.
    pub shears: [[[f32; 2]; 2]; VECTORS],
    /// Limit of a narrow box's area, divided by the square of the distance: [`NARROW`] times the packet's cross-section
    /// at distance 1.
    pub spread_area: f32,
    /// The least magnitudes of the directions' components, and the greatest footprint (see [`super::LocalRay::cone`]).
    /// They bound whether a stand-in is acceptable for any ray.
    pub dir_min: [f32; 3],
    pub cone_max: [f32; 2],
}

impl Common {
    /// Greatest distance between origins along an axis.
    #[inline(always)]
    pub fn spread(&self) -> f32 {
        let along = |axis: usize| (self.org_near[axis] - self.org_far[axis]).abs();
        along(0).max(along(1)).max(along(2))
    }
}

/// Prepares all rays, each as [`super::prepared::PreparedRay::new`] does, and the values that they share. Returns
/// false if the rays cannot be traced as one packet, because the signs or the greatest components of their directions
/// differ. `common` is written in place: a returned struct would be stored in small pieces and then read in large ones,
/// which stalls.
#[inline(always)]
pub(super) fn prepare<S: Simd>(s: S, rays: &mut PacketRays, max_coord: f32, common: &mut Common) -> bool {
    let Some(kz) = greatest_axis(s, rays) else { return false };
    let k = [(kz + 1) % 3, (kz + 2) % 3, kz];
    let (zero, one) = (s.splat16(0.0), s.splat16(1.0));
    let mut one_origin = true;
    for axis in 0..3 {
        let first = s.load16(&rays.org[axis][0]);
        let origin = s.splat16(rays.org[axis][0][0]);
        let mut equal = origin.eq(first);
        let (mut org_low, mut org_high) = (first, first);
        let (mut inv_low, mut inv_high) = (s.splat16(f32::INFINITY), s.splat16(f32::NEG_INFINITY));
        let mut signs = [0; VECTORS];
        for h in 0..VECTORS {
            let dir = s.load16(&rays.dir[axis][h]);
            let least = abs(zero, s.load16(&rays.dir[kz][h])) * s.splat16(1e-18);
            let magnitude = one.div(abs(zero, dir).max(least));
            let positive = zero.le(dir);
            signs[h] = positive.bits();
            let inv = magnitude.select(positive, zero - magnitude);
            let org = s.load16(&rays.org[axis][h]);
            rays.inv[axis][h] = inv.to_array();
            equal = equal.and(origin.eq(org));
            (org_low, org_high) = (org.min(org_low), org.max(org_high));
            (inv_low, inv_high) = (inv.min(inv_low), inv.max(inv_high));
        }
        let negative = match signs {
            signs if signs == [0xffff; VECTORS] => false,
            signs if signs == [0; VECTORS] => true,
            _ => return false,
        };
        common.near[axis] = if negative { axis + 3 } else { axis };
        (common.inv_min[axis], common.inv_max[axis]) = (inv_low.least(), inv_high.greatest());
        let (low, high) = if equal.bits() == 0xffff {
            // The most frequent case.
            (rays.org[axis][0][0], rays.org[axis][0][0])
        } else {
            one_origin = false;
            (org_low.least(), org_high.greatest())
        };
        (common.org_near[axis], common.org_far[axis]) = if negative { (low, high) } else { (high, low) };
        let (far, inv) = (low.abs().max(high.abs()), rays.inv[axis][0][0]);
        common.slack[axis] = slack(far, inv, max_coord);
        common.sign[axis] = 1.0f32.copysign(inv);
    }
    for axis in 0..2 {
        let (mut least, mut greatest) = (f32::INFINITY, f32::NEG_INFINITY);
        for h in 0..VECTORS {
            let shear = s.load16(&rays.dir[k[axis]][h]).div(s.load16(&rays.dir[kz][h]));
            rays.shear[axis][h] = shear.to_array();
            let ends = [shear.least(), shear.greatest()];
            common.shears[h][axis] = ends;
            (least, greatest) = (least.min(ends[0]), greatest.max(ends[1]));
        }
        (common.shear_min[axis], common.shear_max[axis]) = (least, greatest);
    }
    for axis in 0..3 {
        let mut least = s.splat16(f32::INFINITY);
        for h in 0..VECTORS {
            least = abs(zero, s.load16(&rays.dir[axis][h])).min(least);
        }
        common.dir_min[axis] = least.least();
    }
    let across = |axis: usize| common.shear_max[axis] - common.shear_min[axis];
    common.spread_area = across(0) * across(1) * common.dir_min[kz] * common.dir_min[kz] * NARROW;
    for part in 0..2 {
        let mut greatest = zero;
        for h in 0..VECTORS {
            greatest = s.load16(&rays.cone[part][h]).max(greatest);
        }
        common.cone_max[part] = greatest.greatest();
    }
    // The greatest component is never clamped to `least`, so this is exactly its reciprocal.
    rays.shear[2] = rays.inv[kz];
    (common.k, common.one_origin) = (k, one_origin);
    true
}

/// Rays that [`super::LocalRay::is_valid`] accepts.
#[inline(always)]
pub(super) fn valid<S: Simd>(s: S, rays: &PacketRays, t_max: &Row) -> u32 {
    let (zero, largest) = (s.splat16(0.0), s.splat16(MAX_DIR));
    let mut all = 0;
    for h in 0..VECTORS {
        let t_min = s.load16(&rays.t_min[h]);
        let mut ok = zero.le(t_min).and(t_min.le(s.load16(&t_max[h])));
        let mut size = zero;
        for axis in 0..3 {
            let (org, dir) = (abs(zero, s.load16(&rays.org[axis][h])), abs(zero, s.load16(&rays.dir[axis][h])));
            // Comparisons with NaN are false.
            ok = ok.and(org.le(s.splat16(f32::MAX))).and(dir.le(largest));
            size = dir.max(size);
        }
        all |= ok.and(s.splat16(MIN_DIR).le(size)).bits() << (16 * h);
    }
    all
}

/// See [`super::PacketWalk::is_within`].
#[inline(always)]
pub(super) fn within<S: Simd>(s: S, rays: &mut PacketRays, near: f32) -> u32 {
    let (zero, near) = (s.splat16(0.0), s.splat16(near));
    let (least, greatest) = (s.splat16(*USUAL_DIRS.start()), s.splat16(*USUAL_DIRS.end()));
    let mut all = 0;
    for h in 0..VECTORS {
        let t_min = s.load16(&rays.t_min[h]);
        // Comparisons with NaN are false.
        let mut ok = abs(zero, t_min).le(s.splat16(f32::MAX));
        let mut size = zero;
        for axis in 0..3 {
            let dir = abs(zero, s.load16(&rays.dir[axis][h]));
            ok = ok.and(abs(zero, s.load16(&rays.org[axis][h])).le(near)).and(dir.le(greatest));
            size = dir.max(size);
        }
        rays.t_min[h] = t_min.max(zero).to_array();
        all |= ok.and(least.le(size)).bits() << (16 * h);
    }
    all
}

/// Returns the axis on which the directions of all rays are greatest, with ties as in [`crate::geom::Shear`]; `None` if
/// the axes differ.
#[inline(always)]
fn greatest_axis<S: Simd>(s: S, rays: &PacketRays) -> Option<usize> {
    let zero = s.splat16(0.0);
    let (mut is_x, mut is_y) = ([0; VECTORS], [0; VECTORS]);
    for h in 0..VECTORS {
        let x = abs(zero, s.load16(&rays.dir[0][h]));
        let y = abs(zero, s.load16(&rays.dir[1][h]));
        let z = abs(zero, s.load16(&rays.dir[2][h]));
        is_x[h] = y.le(x).and(z.le(x)).bits();
        is_y[h] = z.le(y).bits() & !is_x[h];
    }
    let (all, none) = ([0xffff; VECTORS], [0; VECTORS]);
    match (is_x == all, is_y == all) {
        (true, _) => Some(0),
        (_, true) => Some(1),
        _ if is_x == none && is_y == none => Some(2),
        _ => None,
    }
}
