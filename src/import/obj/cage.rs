//! The faces of an OBJ file as the cage of a subdivision surface.

use super::tags::Tags;
use crate::base::error::{Error, Place, Result};
use crate::base::memory;
use crate::base::progress::Cancel;
use crate::geom::surface::cage::{CageDesc, Displacement};
use crate::geom::surface::displacement::Heights;
use crate::import::heights::{HeightOptions, decode};
use crate::import::input::Input;
use crate::import::surfaces::CageMesh;
use crate::import::{MeshKey, ReadOptions, Sink};
use glam::DVec3;
use std::path::Path;

/// The faces so far.
#[derive(Default)]
pub(super) struct Cage {
    sizes: Vec<u32>,
    indices: Vec<u32>,
    parts: Vec<u32>,
    /// Of each corner, if the surface is displaced.
    coordinates: Vec<[f64; 2]>,
    pub tags: Tags,
}

impl Cage {
    /// Adds a face of a part, by its vertices.
    pub fn face(&mut self, part: u32, vertices: impl ExactSizeIterator<Item = u32>) {
        self.sizes.push(vertices.len() as u32);
        self.indices.extend(vertices);
        self.parts.push(part);
    }

    /// Adds the texture coordinates of a corner.
    pub fn coordinates(&mut self, at: [f32; 2]) {
        self.coordinates.push(at.map(f64::from));
    }

    /// Gives the surface to the sink; an empty one is none. Faults name the file.
    pub fn finish(self, positions: &[[f64; 3]], file: &Path, options: &ReadOptions, sink: &mut dyn Sink) -> Result<()> {
        if self.sizes.is_empty() {
            return Ok(());
        }
        let positions: Vec<DVec3> = positions.iter().copied().map(DVec3::from).collect();
        let map = options.displacement.as_ref();
        let heights = map.map(|map| heights(&map.path, options, sink.cancel())).transpose()?;
        let displacement = heights.as_ref().zip(map).map(|(heights, map)| Displacement {
            heights,
            scale: map.scale,
            coordinates: &self.coordinates,
        });
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
        let mesh = CageMesh { desc, positions: &positions, parts: &self.parts, displacement };
        sink.cage(MeshKey::DIRECT, &mesh).map_err(|error| match error {
            Error::BadArgument(why) => Error::parse(file, Place::File, why),
            other => other,
        })
    }
}

/// Reads a picture of heights.
fn heights(path: &Path, options: &ReadOptions, cancel: &Cancel) -> Result<Heights> {
    let mut input = Input::open(path)?;
    input.stamp().report(&options.inputs);
    let mut bytes = memory::zeroed(input.total() as usize, "a map of heights")?;
    if !input.read_range(0, &mut bytes)? {
        return Err(input.fault("the file ends before its length"));
    }
    input.stamp().unchanged()?;
    decode(&bytes, path, &HeightOptions::default(), cancel)
}
