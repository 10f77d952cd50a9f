//! Triangles of one mesh, kept as they arrive and without loss: in single precision where that is exact. They stay in
//! memory up to a limit over all meshes, and go encoded to a scratch file beyond it.

use super::batch::{self, BATCH, Batch, Extent, Positions};
use super::edges::Edges;
use super::origin;
use super::values::{Has, Value};
use crate::base::error::{Error, Result};
use crate::base::scratch::Scratch;
use crate::math::DBounds;
use crate::structure::Par;
use glam::DVec3;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Triangles that another tree counts, by part: their number, and the edges of those that both trees have in the same
/// place. (The edges of the others count twice: then the part is not closed.)
pub type Copies = BTreeMap<u32, (u64, Edges)>;

/// A mesh that is being read.
pub struct Spool {
    /// The first batches, in order of arrival, in the scratch file.
    spilled: Vec<Extent>,
    /// The other batches.
    kept: Vec<Batch>,
    /// Number of bytes of all batches in memory except the last.
    full: u64,
    /// Bounds of all triangles, except those that cannot be stored.
    pub bounds: DBounds,
    /// The point that stored positions are relative to, once it is chosen (`split`).
    pub origin: DVec3,
    /// Number of local parts that the triangles may belong to.
    pub local_parts: u32,
    /// The values that any triangle has.
    pub has: Has,
    /// True if every coordinate is exact in single precision.
    pub is_single: bool,
    /// Number of triangles.
    pub triangles: u64,
    /// The triangles of each part that another tree has too (`split`), and counts.
    pub copies: Copies,
    /// The step of the input's decimal positions, if it has few digits (`split`).
    pub step: Option<f64>,
    /// Greatest distance between a corner of the input and the stored corner, of those that `split` moved.
    pub moved: f64,
}

impl Spool {
    /// An empty mesh.
    pub fn new(local_parts: u32) -> Self {
        Self {
            spilled: Vec::new(),
            kept: Vec::new(),
            full: 0,
            bounds: DBounds::EMPTY,
            origin: DVec3::ZERO,
            local_parts,
            has: Has::default(),
            is_single: true,
            triangles: 0,
            copies: Copies::new(),
            step: None,
            moved: 0.0,
        }
    }

    /// Number of bytes of memory.
    pub fn bytes(&self) -> u64 {
        self.full + self.kept.last().map_or(0, Batch::bytes)
    }

    /// Adds a triangle whose corners are finite. Fails with `NoMemory`; then it is not added.
    pub fn push(&mut self, corners: &[DVec3; 3], part: u32, prim: u32, value: Value) -> Result<()> {
        let single = corners.map(|c| c.as_vec3());
        let exact = corners.iter().zip(&single).all(|(d, s)| s.as_dvec3() == *d);
        let room = self
            .kept
            .last()
            .is_some_and(|c| c.parts.len() < BATCH && matches!(c.positions, Positions::Single(_)) == exact);
        if !room {
            self.full = self.bytes();
            self.kept.push(self.next_batch(exact)?);
        }
        let Some(batch) = self.kept.last_mut() else { return Ok(()) };
        batch.make_room(1, &value)?;
        if !origin::is_too_large(corners) {
            self.bounds = corners.iter().fold(self.bounds, |b, &c| b.with(c));
            self.is_single &= exact;
        }
        self.triangles += 1;
        match &mut batch.positions {
            Positions::Single(p) => p.push(single),
            Positions::Double(p) => p.push(*corners),
        }
        batch.values.push(batch.parts.len(), value);
        self.has.colours |= value.colours.is_some();
        self.has.normals |= value.normals.is_some();
        batch.parts.push(part);
        batch.prims.push(prim);
        Ok(())
    }

    /// Adds a batch whole. If it was taken from the scratch file, it stays there, and is not written again.
    pub fn push_batch(
        &mut self,
        batch: Batch,
        was_spilled: Option<Taken>,
        bounds: DBounds,
        to: Option<&Scratch>,
        par: &Par,
    ) -> Result<()> {
        self.bounds = self.bounds.union(bounds);
        self.is_single &= matches!(batch.positions, Positions::Single(_));
        self.has.colours |= !batch.values.colours.is_empty();
        self.has.normals |= !batch.values.normals.is_empty();
        self.triangles += batch.positions.len() as u64;
        match (was_spilled, to) {
            (Some(Taken::Spilled(extent)), Some(to)) => {
                // The triangles before it go there first.
                self.spill(to, par)?;
                self.spilled.push(extent);
            }
            _ => {
                self.full = self.bytes();
                self.kept.push(batch);
            }
        }
        Ok(())
    }

    /// Returns an empty batch with as much room as the last one has triangles. Most meshes are small, but a mesh that
    /// has filled one batch will mostly fill the next.
    fn next_batch(&self, exact: bool) -> Result<Batch> {
        let spilled = || self.spilled.last().map_or(0, |extent| extent.count as usize);
        let room = self.kept.last().map_or_else(spilled, |batch| batch.parts.len());
        let mut batch = Batch::empty(exact);
        batch.make_room(room, &Value::default())?;
        Ok(batch)
    }

    /// Moves all triangles in memory to the scratch file.
    pub fn spill(&mut self, to: &Scratch, par: &Par) -> Result<()> {
        let batches: Vec<&Batch> = self.kept.iter().collect();
        // A few at a time, because encoded batches take memory too.
        for few in batches.chunks(8) {
            self.spilled.extend(batch::write(few, to, par)?);
        }
        self.kept = Vec::new();
        self.full = 0;
        Ok(())
    }

    /// True if some of its batches are in a scratch file.
    pub fn is_spilled(&self) -> bool {
        !self.spilled.is_empty()
    }

    /// Number of batches.
    pub fn batches(&self) -> usize {
        self.spilled.len() + self.kept.len()
    }

    /// Returns a batch, by order of arrival, which is read from the scratch file if it was spilled.
    pub fn batch(&self, index: usize, scratch: Option<&Scratch>) -> Result<Cow<'_, Batch>> {
        match (self.spilled.get(index), scratch) {
            (Some(extent), Some(scratch)) => batch::read(scratch, extent).map(Cow::Owned),
            (Some(_), None) => Err(Error::Internal("the temporary file of a mesh is missing".into())),
            (None, _) => Ok(Cow::Borrowed(&self.kept[index - self.spilled.len()])),
        }
    }

    /// Returns all batches, to be used once each by [`Taken::batch`].
    pub fn take(self) -> Vec<Taken> {
        self.spilled.into_iter().map(Taken::Spilled).chain(self.kept.into_iter().map(Taken::Kept)).collect()
    }
}

/// A batch that was taken out of its spool.
pub enum Taken {
    Spilled(Extent),
    Kept(Batch),
}

impl Taken {
    /// The same batch once more, if it is in the scratch file.
    pub fn again(&self) -> Option<Self> {
        match self {
            Self::Spilled(extent) => Some(Self::Spilled(*extent)),
            Self::Kept(_) => None,
        }
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        match self {
            Taken::Kept(batch) => batch.parts.len(),
            Taken::Spilled(extent) => extent.count as usize,
        }
    }

    /// Returns the batch, which is read from the scratch file if it was spilled.
    pub fn batch(self, scratch: Option<&Scratch>) -> Result<Batch> {
        match (self, scratch) {
            (Taken::Kept(batch), _) => Ok(batch),
            (Taken::Spilled(extent), Some(scratch)) => batch::read(scratch, &extent),
            (Taken::Spilled(_), None) => Err(Error::Internal("the temporary file of a mesh is missing".into())),
        }
    }
}
