//! What is seen first in each pixel.

use crate::math::PACKET;
use crate::query::{HitKind, NONE};

/// What is seen first in a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layer {
    pub depth: f32,
    pub normal: [f32; 3],
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
        part: NONE,
        prim: NONE,
        instance: NONE,
        kind: HitKind::Miss,
        error: 0.0,
        error_px: 0.0,
    };
}

/// What is seen first in the pixels of a packet. What nobody asks for may be that of an earlier packet.
pub(crate) struct First {
    /// Pixels that see something, and of these such that see a stand-in, as fine as asked for or for what is missing.
    pub met: u32,
    pub lod: u32,
    pub missing: u32,
    /// Pixels whose rays passed stand-ins before what they see, or before nothing.
    pub transmitted: u32,
    /// Pixels with an error; what is in `error_px` of others does not count.
    pub inexact: u32,
    pub error_px: [f32; PACKET],
    pub depth: [f32; PACKET],
    pub normal: [[f32; 3]; PACKET],
    pub part: [u64; PACKET],
    pub prim: [u64; PACKET],
    pub instance: [u64; PACKET],
    pub error: [f32; PACKET],
}

impl First {
    /// Nothing.
    pub const NOTHING: Self = Self {
        met: 0,
        lod: 0,
        missing: 0,
        transmitted: 0,
        inexact: 0,
        error_px: [0.0; PACKET],
        depth: [Layer::MISS.depth; PACKET],
        normal: [Layer::MISS.normal; PACKET],
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
        (self.depth[i], self.normal[i]) = (seen.depth, seen.normal);
        (self.part[i], self.prim[i], self.instance[i]) = (seen.part, seen.prim, seen.instance);
        (self.error[i], self.error_px[i]) = (seen.error, seen.error_px);
    }

    /// The error of pixel `i`: infinite for what is not a stand-in and is seen through one.
    pub fn error(&self, i: usize) -> f32 {
        if (self.transmitted & !self.lod & !self.missing) >> i & 1 == 1 { f32::INFINITY } else { self.error[i] }
    }

    /// What pixel `i` sees.
    pub fn kind(&self, i: usize) -> HitKind {
        match (self.met >> i & 1, self.lod >> i & 1, self.missing >> i & 1) {
            (0, ..) => HitKind::Miss,
            (_, 0, 0) => HitKind::Exact,
            (_, _, 0) => HitKind::Lod,
            _ => HitKind::Missing,
        }
    }
}
