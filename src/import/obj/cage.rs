//! The faces of an OBJ file as the cage of a subdivision surface.

use super::tags::Tags;
use crate::base::error::{Error, Place, Result};
use crate::geom::surface::cage::CageDesc;
use crate::import::surfaces::CageMesh;
use crate::import::{MeshKey, Sink};
use glam::DVec3;
use std::path::Path;

/// The faces so far.
#[derive(Default)]
pub(super) struct Cage {
    sizes: Vec<u32>,
    indices: Vec<u32>,
    parts: Vec<u32>,
    pub tags: Tags,
}

impl Cage {
    /// Adds a face of a part, by its vertices.
    pub fn face(&mut self, part: u32, vertices: impl ExactSizeIterator<Item = u32>) {
        self.sizes.push(vertices.len() as u32);
        self.indices.extend(vertices);
        self.parts.push(part);
    }

    /// Gives the surface to the sink; an empty one is none. Faults name the file.
    pub fn finish(self, positions: &[[f64; 3]], file: &Path, sink: &mut dyn Sink) -> Result<()> {
        if self.sizes.is_empty() {
            return Ok(());
        }
        let positions: Vec<DVec3> = positions.iter().copied().map(DVec3::from).collect();
        let tags = &self.tags;
        let desc = CageDesc {
            face_sizes: &self.sizes,
            indices: &self.indices,
            creases: &tags.creases,
            corners: &tags.corners,
            holes: &tags.holes,
            boundary: tags.boundary.unwrap_or_default(),
            creasing: tags.creasing.unwrap_or_default(),
            triangles: tags.triangles.unwrap_or_default(),
        };
        let mesh = CageMesh { desc, positions: &positions, parts: &self.parts, displacement: None };
        sink.cage(MeshKey::DIRECT, &mesh).map_err(|error| match error {
            Error::BadArgument(why) => Error::parse(file, Place::File, why),
            other => other,
        })
    }
}
