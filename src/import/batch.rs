//! Triangles on their way to the sink, a few thousand at a time.

use super::{MaterialDesc, MeshKey, Sink};
use crate::base::error::Result;
use glam::DVec3;

/// Triangles handed over at once; 300 KB of positions stay in the cache.
pub(crate) const BATCH: usize = 4096;

/// Collects triangles of one part until there are [`BATCH`] of them.
///
/// A batch in which only some triangles have a colour gives the others the colour of their
/// material, so that a file that colours every other triangle still comes in large batches.
pub(crate) struct Batch {
    mesh: MeshKey,
    part: u32,
    material_colour: [f32; 3],
    positions: Vec<[DVec3; 3]>,
    colours: Vec<[f32; 3]>,
}

impl Batch {
    /// For `part` of the triangles placed directly, with the default material.
    pub(crate) fn new(part: u32) -> Self {
        Self {
            mesh: MeshKey::DIRECT,
            part,
            material_colour: MaterialDesc::default().colour,
            positions: Vec::with_capacity(BATCH),
            colours: Vec::new(),
        }
    }

    /// What follows belongs to `part` of `mesh`, whose material has this colour.
    pub(crate) fn aim(
        &mut self,
        mesh: MeshKey,
        part: u32,
        material_colour: [f32; 3],
        sink: &mut dyn Sink,
    ) -> Result<()> {
        if (mesh, part) != (self.mesh, self.part) {
            self.flush(sink)?;
        }
        (self.mesh, self.part, self.material_colour) = (mesh, part, material_colour);
        Ok(())
    }

    /// Adds a triangle; `true` when it is time to [`Batch::flush`].
    #[inline]
    pub(crate) fn push(&mut self, triangle: [DVec3; 3], colour: Option<[f32; 3]>) -> bool {
        if let Some(colour) = colour {
            self.colours.resize(self.positions.len(), self.material_colour);
            self.colours.push(colour);
        } else if !self.colours.is_empty() {
            self.colours.push(self.material_colour);
        }
        self.positions.push(triangle);
        self.is_full()
    }

    #[inline]
    pub(crate) fn is_full(&self) -> bool {
        self.positions.len() >= BATCH
    }

    /// Hands over what was collected, unless cancelled.
    pub(crate) fn flush(&mut self, sink: &mut dyn Sink) -> Result<()> {
        sink.cancel().check()?;
        if !self.positions.is_empty() {
            let colours = (!self.colours.is_empty()).then_some(&self.colours[..]);
            sink.triangles(self.mesh, self.part, &self.positions, colours)?;
            self.positions.clear();
            self.colours.clear();
        }
        Ok(())
    }
}
