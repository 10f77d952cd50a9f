//! The first surface in each pixel.

use super::direct::Asks;
use crate::math::PACKET;
use crate::query::{HitKind, NONE};

/// The first surfaces in the pixels of a packet. Values that are not requested may be those of an earlier packet.
pub(crate) struct First {
    /// Mask of the pixels with a hit. `lod`: of these, pixels with a stand-in within the threshold; `missing`: of
    /// these, pixels with a stand-in for missing data.
    pub met: u32,
    pub lod: u32,
    pub missing: u32,
    /// Mask of the pixels with a ray that entered a stand-in before the hit or the miss.
    pub behind_cells: u32,
    /// Mask of the pixels with an error. Other elements of `error_px` are not valid.
    pub inexact: u32,
    pub error_px: [f32; PACKET],
    pub depth: [f32; PACKET],
    pub normal: [[f32; 3]; PACKET],
    pub shading_normal: [[f32; 3]; PACKET],
    pub part: [u64; PACKET],
    pub prim: [u64; PACKET],
    pub instance: [u64; PACKET],
    pub occurrence: [u64; PACKET],
    pub error: [f32; PACKET],
    pub uv: [[f32; 2]; PACKET],
}

impl First {
    /// No hits.
    pub const NOTHING: Self = Self {
        met: 0,
        lod: 0,
        missing: 0,
        behind_cells: 0,
        inexact: 0,
        error_px: [0.0; PACKET],
        depth: [f32::INFINITY; PACKET],
        normal: [[0.0; 3]; PACKET],
        shading_normal: [[0.0; 3]; PACKET],
        part: [NONE; PACKET],
        prim: [NONE; PACKET],
        instance: [NONE; PACKET],
        occurrence: [NONE; PACKET],
        error: [0.0; PACKET],
        uv: [[0.0; 2]; PACKET],
    };

    /// Removes all hits from what `asks` asks for.
    pub(super) fn clear(&mut self, asks: Asks) {
        let Self { met, lod, missing, behind_cells, inexact, .. } = self;
        (*met, *lod, *missing, *behind_cells, *inexact) = (0, 0, 0, 0, 0);
        if asks.precise {
            (self.depth, self.error) = (Self::NOTHING.depth, Self::NOTHING.error);
        }
        if asks.normals {
            (self.normal, self.shading_normal) = (Self::NOTHING.normal, Self::NOTHING.normal);
        }
        if asks.ids {
            (self.part, self.instance) = (Self::NOTHING.part, Self::NOTHING.part);
            self.occurrence = Self::NOTHING.part;
        }
        if asks.prims {
            self.prim = Self::NOTHING.prim;
        }
        if asks.uvs {
            self.uv = Self::NOTHING.uv;
        }
    }

    /// Returns the error of pixel `i`: infinite for a triangle or a miss behind a transmitting stand-in.
    pub fn error(&self, i: usize) -> f32 {
        if (self.behind_cells & !self.lod & !self.missing) >> i & 1 == 1 { f32::INFINITY } else { self.error[i] }
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
