//! Batches of triangles on their way to the sink, a few thousand each.

use super::{Attributes, MaterialDesc, MeshKey, Sink};
use crate::base::error::Result;
use glam::{DVec3, Vec3};

/// Values at the corners of a triangle.
#[derive(Clone, Copy, Default)]
pub(crate) struct Corners {
    /// Linear colours.
    pub(crate) colours: Option<[[f32; 3]; 3]>,
    pub(crate) normals: Option<[Vec3; 3]>,
}

impl Corners {
    /// One colour for the whole triangle, or none.
    pub(crate) fn plain(colour: Option<[f32; 3]>) -> Self {
        Self { colours: colour.map(|c| [c; 3]), normals: None }
    }
}

/// Number of triangles in a batch. Its positions (300 KB) stay in the cache.
pub(crate) const BATCH: usize = 4096;

/// Collects the triangles of one part until there are [`BATCH`] of them.
///
/// In a batch in which only some triangles have a colour, the others get the colour of their material. A file that
/// colours every other triangle therefore still arrives in large batches.
pub(crate) struct Batch {
    mesh: MeshKey,
    part: u32,
    material_colour: [f32; 3],
    positions: Vec<[DVec3; 3]>,
    colours: Vec<[[f32; 3]; 3]>,
    normals: Vec<[Vec3; 3]>,
}

impl Batch {
    /// Creates a batch for part `part` of the directly placed triangles, with the default material.
    pub(crate) fn new(part: u32) -> Self {
        Self {
            mesh: MeshKey::DIRECT,
            part,
            material_colour: MaterialDesc::default().colour,
            positions: Vec::with_capacity(BATCH),
            colours: Vec::new(),
            normals: Vec::new(),
        }
    }

    /// Directs the following triangles to part `part` of `mesh`. `material_colour` is the colour of its material.
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

    /// Adds a triangle. Returns `true` if the batch is full and the caller must call [`Batch::flush`].
    #[inline]
    pub(crate) fn push(&mut self, triangle: [DVec3; 3], at: Corners) -> bool {
        let material = [self.material_colour; 3];
        if let Some(colours) = at.colours {
            self.colours.resize(self.positions.len(), material);
            self.colours.push(colours);
        } else if !self.colours.is_empty() {
            self.colours.push(material);
        }
        self.positions.push(triangle);
        if let Some(normals) = at.normals {
            self.normals.push(normals);
        }
        self.is_full()
    }

    /// Announces triangles with normals, or without.
    #[inline]
    pub(crate) fn with_normals(&mut self, is_with: bool, sink: &mut dyn Sink) -> Result<()> {
        if is_with == self.normals.is_empty() { self.flush(sink) } else { Ok(()) }
    }

    #[inline]
    pub(crate) fn is_full(&self) -> bool {
        self.positions.len() >= BATCH
    }

    /// Sends the collected triangles to the sink. Fails if the user cancelled.
    pub(crate) fn flush(&mut self, sink: &mut dyn Sink) -> Result<()> {
        sink.cancel().check()?;
        if !self.positions.is_empty() {
            let colours = (!self.colours.is_empty()).then_some(&self.colours[..]);
            let normals = (!self.normals.is_empty()).then_some(&self.normals[..]);
            sink.triangles(self.mesh, self.part, &self.positions, Attributes { colours, normals })?;
            self.positions.clear();
            self.colours.clear();
            self.normals.clear();
        }
        Ok(())
    }
}
