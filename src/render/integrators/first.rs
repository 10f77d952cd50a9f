//! The first surface in each pixel.

use crate::math::PACKET;
use crate::query::{HitKind, NONE};

/// The first surface in a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layer {
    pub depth: f32,
    pub normal: [f32; 3],
    pub shading_normal: [f32; 3],
    pub part: u64,
    pub prim: u64,
    pub instance: u64,
    pub kind: HitKind,
    pub error: f32,
    pub error_px: f32,
}

impl Layer {
    pub const MISS: Self = Self {
        depth: f32::INFINITY,
        normal: [0.0; 3],
        shading_normal: [0.0; 3],
        part: NONE,
        prim: NONE,
        instance: NONE,
        kind: HitKind::Miss,
        error: 0.0,
        error_px: 0.0,
    };
}

/// The first surfaces in the pixels of a packet. Values that are not requested may be those of an earlier packet.
pub(crate) struct First {
    /// Mask of the pixels with a hit. `lod`: of these, pixels with a stand-in within the threshold; `missing`: of
    /// these, pixels with a stand-in for missing data.
    pub met: u32,
    pub lod: u32,
    pub missing: u32,
    /// Mask of the pixels with a ray that a stand-in transmitted before the hit or the miss.
    pub transmitted: u32,
    /// Mask of the pixels with an error. Other elements of `error_px` are not valid.
    pub inexact: u32,
    pub error_px: [f32; PACKET],
    pub depth: [f32; PACKET],
    pub normal: [[f32; 3]; PACKET],
    pub shading_normal: [[f32; 3]; PACKET],
    pub part: [u64; PACKET],
    pub prim: [u64; PACKET],
    pub instance: [u64; PACKET],
    pub error: [f32; PACKET],
}

impl First {
    /// No hits.
    pub const NOTHING: Self = Self {
        met: 0,
        lod: 0,
        missing: 0,
        transmitted: 0,
        inexact: 0,
        error_px: [0.0; PACKET],
        depth: [Layer::MISS.depth; PACKET],
        normal: [Layer::MISS.normal; PACKET],
        shading_normal: [Layer::MISS.normal; PACKET],
        part: [NONE; PACKET],
        prim: [NONE; PACKET],
        instance: [NONE; PACKET],
        error: [0.0; PACKET],
    };

    pub(super) fn set(&mut self, i: usize, seen: &Layer) {
        self.met |= u32::from(seen.kind != HitKind::Miss) << i;
        self.lod |= u32::from(seen.kind == HitKind::Lod) << i;
        self.missing |= u32::from(seen.kind == HitKind::Missing) << i;
        self.inexact |= u32::from(seen.error_px != 0.0) << i;
        (self.depth[i], self.normal[i], self.shading_normal[i]) = (seen.depth, seen.normal, seen.shading_normal);
        (self.part[i], self.prim[i], self.instance[i]) = (seen.part, seen.prim, seen.instance);
        (self.error[i], self.error_px[i]) = (seen.error, seen.error_px);
    }

    /// Returns the error of pixel `i`: infinite for a triangle or a miss behind a transmitting stand-in.
    pub fn error(&self, i: usize) -> f32 {
        if (self.transmitted & !self.lod & !self.missing) >> i & 1 == 1 { f32::INFINITY } else { self.error[i] }
    }

    /// Returns the kind of the hit in pixel `i`.
    pub fn kind(&self, i: usize) -> HitKind {
        match (self.met >> i & 1, self.lod >> i & 1, self.missing >> i & 1) {
            (0, ..) => HitKind::Miss,
            (_, 0, 0) => HitKind::Exact,
            (_, _, 0) => HitKind::Lod,
            _ => HitKind::Missing,
        }
    }
}
