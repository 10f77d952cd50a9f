//! Sixteen rays prepared for box and triangle tests at once, field by field.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::prepared::BOX_SLACK;
use super::ray::{MAX_DIR, MIN_DIR, abs};
use super::stream::{GROUP, Rays16};
use crate::simd::{Lanes, Mask, Simd};

/// One prepared ray (see [`super::prepared::PreparedRay`]). One cache line holds all data of a box test, a second one
/// the rest. The fields are words, because sixteen rays are prepared by field and then transposed.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct OneRay {
    line: [f32; 16],
    rest: [f32; 16],
}

impl OneRay {
    pub const NONE: Self = Self { line: [0.0; 16], rest: [0.0; 16] };

    /// Returns the reciprocal direction. The fourth element is unused.
    #[inline(always)]
    pub fn inv(&self) -> &[f32; 4] {
        first(&self.line[0..])
    }

    /// Returns the negated offsets of planes: near planes, and far planes from the fifth element on. The fourth and
    /// eighth elements are unused.
    #[inline(always)]
    pub fn off(&self) -> &[f32; 8] {
        first(&self.line[4..])
    }

    /// Returns the least distance of a hit.
    #[inline(always)]
    pub fn t_min(&self) -> f32 {
        self.line[12]
    }

    /// Returns the distance of the best hit.
    #[inline(always)]
    pub fn best(&self) -> f32 {
        self.line[13]
    }

    #[inline(always)]
    pub fn set_best(&mut self, t: f32) {
        self.line[13] = t;
    }

    /// Returns, for each axis, the row of planes (least x, y, z, then greatest) that the ray reaches first; from the
    /// fifth element on, the same for the row that it reaches last.
    #[inline(always)]
    pub fn planes(&self) -> &[u8; 8] {
        let words: &[f32; 2] = first(&self.line[14..]);
        bytemuck::must_cast_ref(words)
    }

    /// Returns the data of the stand-in test: width (`a`, `b`), magnitudes of the direction, origin.
    #[inline(always)]
    pub fn cone(&self) -> &[f32; 8] {
        first(&self.rest[7..])
    }

    /// Returns the axis order of the triangle test, the origin in that order, and the shear: see
    /// [`crate::geom::Shear`].
    #[inline(always)]
    pub fn shear(&self) -> ([usize; 3], [f32; 3], [f32; 3]) {
        let z = (self.rest[6].to_bits() & 3) as usize;
        let r = &self.rest;
        ([(z + 1) % 3, (z + 2) % 3, z], [r[0], r[1], r[2]], [r[3], r[4], r[5]])
    }
}

#[inline(always)]
fn first<const N: usize>(v: &[f32]) -> &[f32; N] {
    match v.first_chunk::<N>() {
        Some(first) => first,
        None => unreachable!(),
    }
}

/// Sixteen prepared rays, by field: each column is a [`OneRay`].
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub(super) struct Prepared {
    lines: [[f32; GROUP]; 16],
    rests: [[f32; GROUP]; 16],
    /// For each axis, the rays with directions that are not negative.
    positive: [u32; 3],
}

impl Prepared {
    pub const NONE: Self = Self { lines: [[0.0; GROUP]; 16], rests: [[0.0; GROUP]; 16], positive: [0; 3] };

    /// Reciprocal directions.
    #[inline(always)]
    pub fn inv(&self, axis: usize) -> &[f32; GROUP] {
        &self.lines[axis]
    }

    /// Negated offsets of the planes that rays reach first, and of those that they reach last.
    #[inline(always)]
    pub fn off(&self, axis: usize) -> [&[f32; GROUP]; 2] {
        [&self.lines[4 + axis], &self.lines[8 + axis]]
    }

    /// Least and greatest distances.
    #[inline(always)]
    pub fn interval(&self) -> [&[f32; GROUP]; 2] {
        [&self.lines[12], &self.lines[13]]
    }

    /// Rays with directions that are not negative along an axis.
    #[inline(always)]
    pub fn positive(&self, axis: usize) -> u32 {
        self.positive[axis]
    }

    /// Widths (`a`, `b`), for stand-ins.
    #[inline(always)]
    pub fn cone(&self) -> [&[f32; GROUP]; 2] {
        [&self.rests[7], &self.rests[8]]
    }

    /// Magnitudes of the directions, for stand-ins.
    #[inline(always)]
    pub fn size(&self, axis: usize) -> &[f32; GROUP] {
        &self.rests[9 + axis]
    }

    /// Origins.
    #[inline(always)]
    pub fn org(&self, axis: usize) -> &[f32; GROUP] {
        &self.rests[12 + axis]
    }

    /// Returns the origin of ray `i`.
    #[inline(always)]
    pub fn begins_at(&self, i: usize) -> [f32; 3] {
        let i = i & (GROUP - 1);
        [self.rests[12][i], self.rests[13][i], self.rests[14][i]]
    }

    /// Transposes the rays into `out`, one by one.
    #[inline(always)]
    pub fn each<S: Simd>(&self, s: S, out: &mut [OneRay; GROUP]) {
        let (mut line, mut rest) = ([[0.0; 16]; GROUP], [[0.0; 16]; GROUP]);
        s.transpose16(&self.lines, &mut line);
        s.transpose16(&self.rests, &mut rest);
        for i in 0..GROUP {
            out[i] = OneRay { line: line[i], rest: rest[i] };
        }
    }
}

/// The rows of the low planes of x, y and z: a byte each.
const LOW_PLANES: u32 = 0x0002_0100;
/// Rows from the low planes of an axis to the high ones.
const TO_HIGH: u32 = 3;

impl Rays16 {
    /// Prepares all rays like [`super::prepared::PreparedRay::new`]; returns the valid ones.
    #[inline(always)]
    pub(super) fn prepare<S: Simd>(&self, s: S, max_coord: f32, out: &mut Prepared) -> u32 {
        let zero = s.splat16(0.0);
        let org = [s.load16(&self.org[0]), s.load16(&self.org[1]), s.load16(&self.org[2])];
        let dir = [s.load16(&self.dir[0]), s.load16(&self.dir[1]), s.load16(&self.dir[2])];
        let size = [abs(zero, dir[0]), abs(zero, dir[1]), abs(zero, dir[2])];
        let greatest = size[0].max(size[1]).max(size[2]);
        let least = greatest * s.splat16(1e-18);
        let Prepared { lines, rests, positive } = out;
        for axis in 0..3 {
            let magnitude = s.splat16(1.0).div(size[axis].max(least));
            let is_positive = zero.le(dir[axis]);
            positive[axis] = is_positive.bits();
            let inv = magnitude.select(is_positive, zero - magnitude);
            let slack = magnitude * abs(zero, org[axis]).max(s.splat16(max_coord)) * s.splat16(BOX_SLACK);
            let off = org[axis] * inv;
            lines[axis] = inv.to_array();
            lines[4 + axis] = (zero - off - slack).to_array();
            lines[8 + axis] = (slack - off).to_array();
        }
        lines[12] = self.t_min;
        lines[13] = self.t_max;
        let is_x = size[1].le(size[0]).and(size[2].le(size[0]));
        let is_y = size[2].le(size[1]);
        let signs = [zero.le(dir[0]), zero.le(dir[1]), zero.le(dir[2])];
        lines[14] = rows(s, signs, 0).to_array();
        lines[15] = rows(s, signs, 0x0001_0101).to_array();
        // Axis of the greatest component: 0 for x, 1 for y, 2 for z.
        let axis = s.splat16(f32::from_bits(1)).select(is_y, s.splat16(f32::from_bits(2)));
        rests[6] = s.splat16(0.0).select(is_x, axis).to_array();
        let [a, b, c] = turned(is_x, is_y, org);
        (rests[0], rests[1], rests[2]) = (a.to_array(), b.to_array(), c.to_array());
        let [a, b, c] = turned(is_x, is_y, dir);
        let scale = s.splat16(1.0).div(c);
        (rests[3], rests[4], rests[5]) = (a.div(c).to_array(), b.div(c).to_array(), scale.to_array());
        (rests[7], rests[8]) = (self.cone[0], self.cone[1]);
        for axis in 0..3 {
            (rests[9 + axis], rests[12 + axis]) = (size[axis].to_array(), self.org[axis]);
        }
        self.valid(s, org, dir, greatest)
    }

    /// Returns the rays that [`crate::structure::LocalRay::is_valid`] accepts.
    #[inline(always)]
    fn valid<S: Simd>(&self, s: S, org: [S::F16; 3], dir: [S::F16; 3], greatest: S::F16) -> u32 {
        let zero = s.splat16(0.0);
        let t_min = s.load16(&self.t_min);
        let mut ok = s.splat16(MIN_DIR).le(greatest).and(greatest.le(s.splat16(MAX_DIR)));
        ok = ok.and(zero.le(t_min)).and(t_min.le(s.load16(&self.t_max)));
        for axis in 0..3 {
            // A comparison with NaN is false.
            ok = ok.and(abs(zero, org[axis]).le(s.splat16(f32::MAX))).and(abs(zero, dir[axis]).le(s.splat16(MAX_DIR)));
        }
        ok.bits()
    }
}

/// Returns the words that name the rows of planes which rays reach first; with all bits in `flip`, last. `positive`:
/// the rays with directions that are not negative, axis by axis.
#[inline(always)]
fn rows<S: Simd>(s: S, positive: [<S::F16 as Lanes<GROUP>>::Mask; 3], flip: u32) -> S::F16 {
    let [x, y, z] = positive;
    let low = row(s, flip, 0).select(z, row(s, flip, 4)).select(y, row(s, flip, 2).select(z, row(s, flip, 6)));
    let high = row(s, flip, 1).select(z, row(s, flip, 5)).select(y, row(s, flip, 3).select(z, row(s, flip, 7)));
    low.select(x, high)
}

/// [`rows`] of one combination of signs: a bit of `negative` for each axis.
#[inline(always)]
fn row<S: Simd>(s: S, flip: u32, negative: u32) -> S::F16 {
    let signs = (negative & 1 | (negative & 2) << 7 | (negative & 4) << 14) ^ flip;
    s.splat16(f32::from_bits(LOW_PLANES + signs * TO_HIGH))
}

/// Returns the two components that follow the greatest one cyclically, then the greatest: the order of
/// [`crate::geom::Shear`].
#[inline(always)]
fn turned<L: Lanes<GROUP>>(is_x: L::Mask, is_y: L::Mask, [x, y, z]: [L; 3]) -> [L; 3] {
    [y.select(is_x, z.select(is_y, x)), z.select(is_x, x.select(is_y, y)), x.select(is_x, y.select(is_y, z))]
}
