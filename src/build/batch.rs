//! Batches: consecutive triangles of a mesh, in memory or encoded in a scratch file.

use super::coding;
use super::values::{Value, Values};
use crate::base::error::{Error, Result};
use crate::base::memory;
use crate::base::scratch::Scratch;
use glam::{DVec3, Vec3};

/// Maximum number of triangles of a batch, which is the unit of parallel work.
pub const BATCH: usize = 1 << 15;

/// Positions of a batch.
#[derive(Debug, Clone, PartialEq)]
pub enum Positions {
    /// Every coordinate is exact in single precision.
    Single(Vec<[Vec3; 3]>),
    /// Some coordinates are not.
    Double(Vec<[DVec3; 3]>),
}

impl Positions {
    /// Number of triangles.
    pub fn len(&self) -> usize {
        match self {
            Positions::Single(p) => p.len(),
            Positions::Double(p) => p.len(),
        }
    }

    /// The corners of triangle `i`.
    #[inline]
    pub fn triangle(&self, i: usize) -> [DVec3; 3] {
        match self {
            Positions::Single(p) => p[i].map(Vec3::as_dvec3),
            Positions::Double(p) => p[i],
        }
    }
}

/// Consecutive triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct Batch {
    /// Corners; finite.
    pub positions: Positions,
    /// Part of each triangle.
    pub parts: Vec<u32>,
    /// Primitive id of each triangle, ascending.
    pub prims: Vec<u32>,
    /// Colours and normals.
    pub values: Values,
}

impl Batch {
    /// A batch without triangles, in single precision or not.
    pub fn empty(is_single: bool) -> Self {
        let positions = if is_single { Positions::Single(Vec::new()) } else { Positions::Double(Vec::new()) };
        Self { positions, parts: Vec::new(), prims: Vec::new(), values: Values::default() }
    }

    /// Makes room for so many more triangles with values like `next`. Fails with `NoMemory`.
    pub fn make_room(&mut self, triangles: usize, next: &Value) -> Result<()> {
        let what = "the triangles of the input";
        self.values.make_room(self.parts.len(), triangles, next)?;
        match &mut self.positions {
            Positions::Single(p) => memory::make_room(p, triangles, what)?,
            Positions::Double(p) => memory::make_room(p, triangles, what)?,
        }
        memory::make_room(&mut self.parts, triangles, what)?;
        memory::make_room(&mut self.prims, triangles, what)
    }

    /// Number of bytes of memory.
    pub fn bytes(&self) -> u64 {
        let positions = match &self.positions {
            Positions::Single(p) => size_of::<[Vec3; 3]>() * p.capacity(),
            Positions::Double(p) => size_of::<[DVec3; 3]>() * p.capacity(),
        };
        (positions + 4 * (self.parts.capacity() + self.prims.capacity()) + self.values.bytes()) as u64
    }
}

/// The place of a batch in a scratch file.
#[derive(Debug, Clone, Copy)]
pub struct Extent {
    /// Offset of its first byte.
    at: u64,
    /// Number of its bytes.
    len: u32,
    /// Number of its triangles.
    pub count: u32,
}

/// Encodes batches in parallel and writes them in order. Returns their places.
pub fn write(batches: &[&Batch], to: &Scratch, par: &crate::structure::Par) -> Result<Vec<Extent>> {
    let coded = par.map(batches.len(), |i| coding::encode(batches[i]));
    let mut extents = Vec::with_capacity(batches.len());
    for (batch, bytes) in batches.iter().zip(coded) {
        let (len, count) = (bytes.len() as u32, batch.positions.len() as u32);
        extents.push(Extent { at: to.append(&bytes)?, len, count });
    }
    Ok(extents)
}

/// Reads a batch.
pub fn read(from: &Scratch, extent: &Extent) -> Result<Batch> {
    let mut bytes = vec![0; extent.len as usize];
    from.read_at(extent.at, &mut bytes)?;
    let batch = coding::decode(&bytes).filter(|b| b.positions.len() == extent.count as usize);
    batch.ok_or_else(|| Error::Internal("a temporary file does not contain the data that was written to it".into()))
}
