//! Triangles of one mesh as they arrive, without loss: single precision where that is exact.

use crate::math::DBounds;
use glam::{DVec3, Vec3};

/// Triangles of a chunk, at most: a chunk is the unit of parallel work afterwards.
const CHUNK: usize = 1 << 16;

/// Positions of a chunk.
pub enum Positions {
    /// Every coordinate is a single-precision number.
    Single(Vec<[Vec3; 3]>),
    /// Some are not.
    Double(Vec<[DVec3; 3]>),
}

impl Positions {
    /// Triangles.
    pub fn len(&self) -> usize {
        match self {
            Positions::Single(p) => p.len(),
            Positions::Double(p) => p.len(),
        }
    }

    /// The corners of triangle `i`.
    pub fn triangle(&self, i: usize) -> [DVec3; 3] {
        match self {
            Positions::Single(p) => p[i].map(Vec3::as_dvec3),
            Positions::Double(p) => p[i],
        }
    }
}

/// Consecutive triangles.
pub struct Chunk {
    /// Corners.
    pub positions: Positions,
    /// Part of each.
    pub parts: Vec<u32>,
    /// Primitive id of each.
    pub prims: Vec<u32>,
    /// sRGB of each; empty if none of the chunk has a colour. Alpha 0: the part's material.
    pub colours: Vec<[u8; 4]>,
}

/// A mesh being read.
pub struct Spool {
    /// In order of arrival.
    pub chunks: Vec<Chunk>,
    /// Of all that was kept.
    pub bounds: DBounds,
    /// Local parts that its triangles may name.
    pub local_parts: u32,
    /// Whether any triangle has a colour.
    pub has_colours: bool,
}

impl Spool {
    /// An empty mesh.
    pub fn new(local_parts: u32) -> Self {
        Self { chunks: Vec::new(), bounds: DBounds::EMPTY, local_parts, has_colours: false }
    }

    /// Adds a triangle whose corners are finite.
    pub fn push(&mut self, corners: &[DVec3; 3], part: u32, prim: u32, colour: Option<[u8; 4]>) {
        let single = corners.map(|c| c.as_vec3());
        let exact = corners.iter().zip(&single).all(|(d, s)| s.as_dvec3() == *d);
        self.bounds = corners.iter().fold(self.bounds, |b, &c| b.with(c));
        let room = self.chunks.last().is_some_and(|c| {
            c.parts.len() < CHUNK && matches!(c.positions, Positions::Single(_)) == exact
        });
        if !room {
            // Most meshes are small; one that has filled a chunk will mostly fill the next.
            let room = self.chunks.last().map_or(0, |c| c.parts.len());
            let positions = if exact {
                Positions::Single(Vec::with_capacity(room))
            } else {
                Positions::Double(Vec::with_capacity(room))
            };
            let (parts, prims, colours) = (Vec::with_capacity(room), Vec::with_capacity(room), Vec::new());
            self.chunks.push(Chunk { positions, parts, prims, colours });
        }
        let Some(chunk) = self.chunks.last_mut() else { return };
        match &mut chunk.positions {
            Positions::Single(p) => p.push(single),
            Positions::Double(p) => p.push(*corners),
        }
        if colour.is_some() || !chunk.colours.is_empty() {
            // Triangles of the chunk before the first coloured one have none.
            chunk.colours.resize(chunk.parts.len(), [0; 4]);
            chunk.colours.push(colour.unwrap_or([0; 4]));
            self.has_colours = true;
        }
        chunk.parts.push(part);
        chunk.prims.push(prim);
    }

    /// Whether every coordinate is a single-precision number.
    pub fn is_single(&self) -> bool {
        self.chunks.iter().all(|c| matches!(c.positions, Positions::Single(_)))
    }
}
